"""Formulas of a saved proof as trees, for the program that verifies it: read, differentiated, and compared exactly.

Numbers are exact fractions. Nothing of the prover is used.
"""

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import cache, lru_cache, partial
from itertools import pairwise
from operator import add, mul, sub, truediv
from typing import Any

from flint import Ordering, fmpq, fmpq_mpoly_ctx

from .check_statement import CHECKS, Unverified, decimal, heed

TOKENS = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[A-Za-z_]\w*|\*\*|[-+*/()]", re.ASCII)
# The derivatives of functions of x, their values at 0, and functions that these define.
SLOPES = {"exp": "exp(x)", "log": "1/x", "sqrt": ".5/sqrt(x)", "sin": "cos(x)", "cos": "-sin(x)", "atan": "1/(1 + x*x)"}
AT_ZERO = {"sin": 0, "atan": 0, "cos": 1, "exp": 1}
DEFINED = {
    "asin": "atan(x/sqrt(1 - x**2))", "acos": "2*atan(1) - asin(x)", "asinh": "2*atanh(x/(1 + sqrt(1 + x**2)))",
    "expm1": "exp(x) - 1", "log1p": "log(1 + x)", "tan": "sin(x)/cos(x)",
    "sinh": "(exp(x) - exp(-x))/2", "cosh": "(exp(x) + exp(-x))/2", "tanh": "1 - 2/(exp(2*x) + 1)",
    "acosh": "log(x + sqrt(x - 1)*sqrt(x + 1))", "atanh": "log((1 + x)/(1 - x))/2",
}  # fmt: skip
Names = Mapping[str, "Tree"]

OPERATIONS: dict[Any, Callable] = {"+": add, "*": mul, "/": truediv}
OPERATIONS |= {ast.Add: add, ast.Sub: sub, ast.Mult: mul, ast.Div: truediv, ast.Pow: pow}


class Tree:
    """A formula: a "number", with a Fraction as its value, a "name", with a text, an operation on its parts, a
    function, or a function in "pieces". Equal ones are one object, see `tree`. Sums and products leave out 0 and 1, and
    a product has one number, which is first."""

    def __init__(self, kind: str, parts: tuple["Tree", ...], value: Any):
        self.kind, self.parts, self.value = kind, parts, value

    def __add__(self, other: "Tree") -> "Tree":
        return other if self is ZERO else self if other is ZERO else tree("+", self, other)

    def __sub__(self, other: "Tree") -> "Tree":
        return ZERO if other is self else self + LESS * other

    def __mul__(self, other: "Tree") -> "Tree":
        if ZERO in (self, other):
            return ZERO
        first, then = (other, self) if other.kind == "number" else (self, other)
        if first.kind == "number" and then.kind == "*" and then.parts[0].kind == "number":
            first, then = first * then.parts[0], then.parts[1]
        return then if first is ONE else tree("*", first, then)

    def __truediv__(self, other: "Tree") -> "Tree":
        return self if self is ZERO or other is ONE else tree("/", self, other)

    def __pow__(self, other: "Tree") -> "Tree":
        if other.kind != "number" or other.value.denominator != 1:
            return tree("exp", other * tree("log", self))
        if abs(other.value) > CHECKS.power:
            raise Unverified(f"the power {other.value} is too large")
        product_of = ONE
        for bit in bin(abs(int(other.value)))[2:]:
            product_of = product_of * product_of * (self if bit == "1" else ONE)
        return product_of if other.value >= 0 else ONE / product_of


@lru_cache(maxsize=100_000)
def tree(kind: str, *parts: Tree, value: object = None) -> Tree:
    """The one tree of this kind and these parts; a number where they are numbers."""
    heed()
    if kind in OPERATIONS and parts[0].kind == parts[1].kind == "number":
        if kind == "/" and not parts[1].value:
            raise Unverified("a formula divides by 0")
        found = OPERATIONS[kind](parts[0].value, parts[1].value)
        if max(abs(found.numerator), found.denominator).bit_length() > CHECKS.bits_of_numbers:
            raise Unverified("a number in a formula has too many digits")
        return number(found)
    if kind in AT_ZERO and parts[0] is ZERO:
        return number(AT_ZERO[kind])
    return Tree(kind, parts, value)


def number(value: Fraction | int) -> Tree:
    """The tree of a rational number."""
    return tree("number", value=Fraction(value))


ZERO, ONE, LESS = map(number, (0, 1, -1))


def parse(text: str, names: Names, needed: list[Tree]) -> Tree:
    """The tree of a formula, with trees in the place of its names; its numerals are the decimals that are written.
    Quotients, roots and whatever else may have no value are added to `needed`, also where they cancel."""
    tokens = TOKENS.findall(text)
    # Python's parser reads numerals and names as plain names: 007 is a number, and its keywords are names like others.
    marked = " ".join(each if each[0] in "*-+/()" else f"_{i}" for i, each in enumerate(tokens))

    def tree_of(node: ast.AST) -> Tree:
        match node:
            case ast.Name(id=place):
                token = tokens[int(place[1:])]
                return number(decimal(token)) if token[0] in ".0123456789" else names[token]
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() as op, operand=operand):
                return (LESS if isinstance(op, ast.USub) else ONE) * tree_of(operand)
            case ast.Call(func=ast.Name(id=place), args=[argument], keywords=[]):
                function, x = tokens[int(place[1:])], tree_of(argument)
                if function in DEFINED:
                    return parse(DEFINED[function], {"x": x}, needed)
                if function in SLOPES:
                    needed.append(tree(function, x))
                    return needed[-1]
            case ast.BinOp(left=left, op=op, right=right):
                a, b = tree_of(left), tree_of(right)
                needed.extend([tree("/", ONE, b) if isinstance(op, ast.Div) else a, OPERATIONS[type(op)](a, b)])
                return needed[-1]
        raise KeyError

    try:
        if "".join(tokens) != re.sub(r"\s", "", text, flags=re.ASCII) or len(text) > CHECKS.formula_length:
            raise SyntaxError
        return tree_of(ast.parse(marked, mode="eval").body)
    except (SyntaxError, KeyError):
        raise Unverified(
            f"'{text[:50]}' cannot be read, or contains a name that is not stated, or is not smooth"
        ) from None


def in_pieces(pieces: Sequence[Tree]) -> Tree:
    """The tree of a function with a formula on each piece of a law. Where a step crosses from a piece to the next one,
    the hull of both holds the function, and that of their derivatives the quotients of its differences."""
    return pieces[0] if len({*pieces}) == 1 else tree("pieces", *pieces)


@lru_cache(maxsize=100_000)
def slope(of: Tree, by: str) -> Tree:
    """The derivative of a tree by a name."""
    if of.kind == "pieces":
        return in_pieces([slope(part, by) for part in of.parts])
    if not of.parts:
        return ONE if of.kind == "name" and of.value == by else ZERO
    (a, da), *rest = [(part, slope(part, by)) for part in of.parts]
    if not rest:
        return parse(SLOPES[of.kind], {"x": a}, []) * da
    b, db = rest[0]
    return da + db if of.kind == "+" else da * b + a * db if of.kind == "*" else (da - of * db) / b


def replaced(of: Tree, places: Names, flips: bool = False) -> Tree:
    """A tree with others in the places of names and, if `flips`, with the pieces of a law in the opposite order."""

    @cache
    def new(of: Tree) -> Tree:
        parts = [new(part) for part in of.parts]
        if of.kind == "pieces":
            return in_pieces(parts[::-1] if flips else parts)
        return OPERATIONS.get(of.kind, partial(tree, of.kind))(*parts) if parts else places.get(of.value, of)

    return new(of)


def is_zero(of: Tree, piece: int = 0) -> bool:
    """Whether a tree is 0 on a piece of a law: as a quotient of polynomials in names and values of functions. These are
    equal at equal arguments, at opposite ones as f(-x) follows from f(x), and log(1/x) is -log(x)."""
    ring = fmpq_mpoly_ctx.get([f"x{i}" for i in range(CHECKS.names)], Ordering.lex)
    one, new, seen = ring.constant(1), iter(ring.gens()), list[tuple]()

    def value(kind: str, a: Any, b: Any) -> tuple:
        for c, d, p, q in [each for known, *each in seen if known == kind]:
            if a * d == c * b:
                return p, q
            if a * d == -c * b and kind in ("sin", "cos", "atan", "exp"):
                return (q, p) if kind == "exp" else (p if kind == "cos" else -p, q)
            if a * c == b * d and kind == "log":
                return -p, q
        seen.append((kind, a, b, next(new), one))
        return seen[-1][3:]

    @cache
    def form(of: Tree) -> tuple:
        heed()
        parts = [form(part) for part in ([of.parts[piece]] if of.kind == "pieces" else of.parts)]
        (a, b), (c, d) = [*parts, (one, one), (one, one)][:2]
        if of.kind in OPERATIONS:
            found = (a * d + c * b, b * d) if of.kind == "+" else (a * c, b * d) if of.kind == "*" else (a * d, b * c)
        elif of.kind == "number":
            found = ring.constant(fmpq(of.value.numerator, of.value.denominator)), one
        else:
            found = (next(new), one) if of.kind == "name" else (a, b) if of.kind == "pieces" else value(of.kind, a, b)
        if found[1] == 0 or max(map(len, found)) > CHECKS.terms:
            raise Unverified("formulas are too long to be compared, or have no value anywhere")
        return found

    try:
        return bool(form(of)[0] == 0)
    except StopIteration:
        raise Unverified("formulas have too many names to be compared") from None


def dot(a: Sequence[Any], b: Sequence[Any], start: Any = ZERO) -> Any:
    """The sum of products."""
    return sum((x * y for x, y in zip(a, b, strict=True)), start)


def solved(matrix: list[list[Tree]], *right: Sequence[Tree]) -> tuple[list[Tree], list[list[Tree]]]:
    """The pivots of a symmetric matrix, positive where it is positive definite, and the solutions of linear systems."""
    rows, pivots = [[*row, *(each[i] for each in right)] for i, row in enumerate(matrix)], list[Tree]()
    for k in range(len(rows)):
        pivots.append(rows[k][k])
        rows[k] = [each / pivots[k] for each in rows[k]]
        for i in range(len(rows)):
            if i != k:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    return pivots, [[row[len(rows) + j] for row in rows] for j in range(len(right))]


def solved_apart(matrix: list[list[Tree]], right: Sequence[Tree]) -> list[Tree] | None:
    """The solution of a linear system: by entries that are numbers, as long as there are some, and for at most two
    unknowns that are left by Cramer's rule; None for more."""
    rows, left, known = [[*row, each] for row, each in zip(matrix, right, strict=True)], [*range(len(right))], {}
    while place := next(((i, j) for i, row in enumerate(rows) for j in left if row[j].kind == "number"
                         and row[j] is not ZERO), None):  # fmt: skip
        i, j = place
        known[j] = pivot = [each / row[j] for row in [rows.pop(i)] for each in row]
        rows = [[a - row[j] * b for a, b in zip(row, pivot, strict=True)] for row in rows]
        left.remove(j)
    if len(left) > 2:
        return None
    found = [ZERO] * len(right)
    if len(left) == 1:
        found[left[0]] = rows[0][-1] / rows[0][left[0]]
    if len(left) == 2:
        (a, b, p), (c, d, q) = ([row[left[0]], row[left[1]], row[-1]] for row in rows)
        found[left[0]], found[left[1]] = (p * d - b * q) / (a * d - b * c), (a * q - p * c) / (a * d - b * c)
    for j, row in reversed(known.items()):
        found[j] = row[-1] - dot([*row[:j], ZERO, *row[j + 1 : -1]], found)
    return found


def quintic(row: Sequence[str], other: Sequence[str], r: Tree) -> Tree:
    """The polynomial of degree 5 between two rows (r, value, slope, curvature) of a table with these: Taylor's at one
    end, and what that lacks at the other."""
    (a, *low), (b, *high) = ([number(decimal(each)) for each in ends] for ends in (row, other))
    two, three, h = number(2), number(3), b - a
    (y, v, w), (p, q, s) = ((value, rate * h, bend * h * h / two) for value, rate, bend in (low, high))
    p, q, s = p - y - v - w, q - v - two * w, s - w
    t, u = (r - a) / h, (r - b) / h
    return y + t * (v + t * (w + t * (p + u * (q - three * p + u * (s - three * (q - two * p))))))


def law_of(spring: Mapping[str, Any], known: Names, r: Tree, needed: list[Tree]) -> tuple[Tree, list[Tree]]:
    """The force of a spring at an extension, or its energy, and the edges of its pieces: piece k is where edge k is
    positive and edge k + 1 negative. A table's is its formula times the polynomials between its rows, where two rows
    share each polynomial, and has no value beyond."""
    rows, ends = spring.get("rows"), [parse(each, known, []) for each in spring["breaks"]]

    def law_on(piece: int, r: Tree, needed: list[Tree]) -> Tree:
        return parse(spring["force"][piece], known if rows else {**known, "r": r}, needed)

    if not all(is_zero(law_on(k, end, []) - law_on(k + 1, end, [])) for k, end in enumerate(ends)):
        raise Unverified("a spring's force is not shown to be continuous where its pieces meet")
    lists = [list[Tree]() for _ in spring["force"]]
    laws = [law_on(k, r, each) for k, each in enumerate(lists)]
    needed.append(in_pieces([sum(each, ZERO) for each in lists]))
    if rows:
        (scale,), beyond, ends = laws, parse("log(-1 - r*r)", {"r": r}, []), [number(decimal(row[0])) for row in rows]
        laws = [beyond, *(scale * quintic(*pair, r) for pair in pairwise(rows)), beyond]
    if ends and spring["potential"]:
        raise Unverified("an energy has pieces")
    needed.extend(tree("log", b - a) for a, b in pairwise(ends))  # has a value where the ends are in order
    return in_pieces(laws), [ONE, *(r - end for end in ends), LESS]
