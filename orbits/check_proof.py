"""Verifies a saved proof from its statement alone: a second program, with another method than the one that proved it.

It reads the formulas of the stated machine (`parse`), derives Lagrange's equations from them (`Machine`, `Field`), and
follows motions by Taylor series in Arb's balls with direct bounds (`Part`): a box B that holds the motion over a step
by Picard's inclusion X + [0, h] f(B) in B, the Taylor coefficients from the box X at its start, and the next one over B
as remainder. So are the derivatives by the start; over several steps they are P (1 + E) with a rounded matrix P and a
small E (`Leg`), so that the errors of the steps add and do not multiply. By the mean value theorem the states of a set
are those of its centre and the derivatives times the deviations. Existence and uniqueness follow from Krawczyk's test
(`Solution`), on the stated enclosures and on these with the radius of uniqueness around them. Signs along the motion
are those of functions, and of their derivatives by time, on stretches of it (`stretches`).

Contact differs from flight by a force along the gap's gradient that keeps the gap's acceleration 0. A law in pieces
makes legs of a phase, in each of which one law holds. The times of the legs are further unknowns, and equations that
the extension is at the breakpoint at their ends. So each leg is smooth.

Nothing of `orbits.proof` and nothing of CasADi is used: python-flint and the standard library alone. What is verified
is what the file says in fields; its sentences in words are not read.
"""

import ast
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise, product
from typing import Any, NamedTuple

from flint import arb, arb_mat, arb_series, ctx, fmpq

# The orders of Taylor polynomials per bit and of those for derivatives, halvings of stretches, and of parameters.
ORDER_PER_BIT, DERIVED_ORDER, MOST_HALVINGS, MOST_SPLITS = 0.3, 14, 16, 3
# What a step's remainder may be in a derivative, the shortest step as a share of a leg, and the largest whole power.
COARSE, SHORTEST, MOST_POWER = Fraction(1, 2**36), Fraction(1, 2**14), 2**16
# Bits beside those of the enclosures, and bits for uniqueness.
GUARD_BITS, BITS_OF_UNIQUENESS = 64, 90


class Unverified(Exception):
    """What cannot be verified, in words."""


class Tree:
    """A formula: `kind` is "number", with a Fraction as its value, "name", with a text, "pi", an operation on its
    parts, or the name of a function. Equal ones are one object (`tree`)."""

    def __init__(self, kind: str, parts: tuple["Tree", ...], value: Any):
        self.kind, self.parts, self.value = kind, parts, value

    # The results hold 0 + x as x, 0 x as 0, and so on: what a formula needs to have a value is seen of itself.
    def __add__(self, other: "Tree") -> "Tree":
        return other if self.value == 0 else self if other.value == 0 else made("+", self, other)

    def __sub__(self, other: "Tree") -> "Tree":
        return self + number(-1) * other

    def __mul__(self, other: "Tree") -> "Tree":
        if self.value == 0 or other.value == 0:
            return number(0)
        return other if self.value == 1 else self if other.value == 1 else made("*", self, other)

    def __truediv__(self, other: "Tree") -> "Tree":
        return self if self.value == 0 or other.value == 1 else made("/", self, other)


@lru_cache(maxsize=None)
def tree(kind: str, *parts: Tree, value: Any = None) -> Tree:
    """The one tree of this kind and these parts."""
    return Tree(kind, parts, value)


def number(value: Fraction | int) -> Tree:
    """The tree of a rational number."""
    return tree("number", value=Fraction(value))


OPERATIONS: dict[str, Callable] = {
    "+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": lambda a, b: a * b, "/": lambda a, b: a / b,
}  # fmt: skip
KINDS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
# The derivatives of functions of x, and functions that these define.
SLOPES = {
    "exp": "exp(x)", "log": "1/x", "sqrt": "1/(2*sqrt(x))", "sin": "cos(x)", "cos": "-sin(x)", "atan": "1/(1 + x**2)",
    "asin": "1/sqrt(1 - x**2)", "asinh": "1/sqrt(1 + x**2)",
}  # fmt: skip
DEFINED = {
    "expm1": "exp(x) - 1", "log1p": "log(1 + x)", "tan": "sin(x)/cos(x)", "acos": "pi/2 - asin(x)",
    "sinh": "(exp(x) - exp(-x))/2", "cosh": "(exp(x) + exp(-x))/2", "tanh": "1 - 2/(exp(2*x) + 1)",
    "acosh": "log(x + sqrt(x - 1)*sqrt(x + 1))", "atanh": "log((1 + x)/(1 - x))/2",
}  # fmt: skip


def made(kind: str, a: Tree, b: Tree) -> Tree:
    """An operation on two trees; a number where both are and it has a value."""
    if kind == "**":
        if b.kind != "number" or b.value.denominator != 1:
            return tree("exp", made("*", b, tree("log", a)))
        if abs(b.value) > MOST_POWER:
            raise Unverified(f"the power {b.value} is too large")
        if b.value < 0:
            return made("/", number(1), made("**", a, number(-b.value)))
        return number(a.value**b.value) if a.kind == "number" else tree("**", a, b)
    if a.kind == b.kind == "number" and not (kind == "/" and b.value == 0):
        return number(OPERATIONS[kind](a.value, b.value))
    return tree(kind, a, b)


def parse(text: str, names: Mapping[str, Tree]) -> Tree:
    """The tree of a formula, with trees in the place of its names; its numerals are the decimals that are written."""
    # An underscore ends each name, as Python's keywords are names like others.
    marked = re.sub(r"(?<![\w.])[A-Za-z_]\w*", r"\g<0>_", " ".join(text.split()), flags=re.ASCII)

    def tree_of(node: ast.AST) -> Tree:
        match node:
            case ast.Constant():
                return number(Fraction(marked[node.col_offset : node.end_col_offset].replace("_", "?")))
            case ast.Name(id=name):
                return names[name[:-1]]
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name[:-1] in DEFINED:
                return parse(DEFINED[name[:-1]], {"x": tree_of(argument), "pi": tree("pi")})
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name[:-1] in SLOPES:
                return tree(name[:-1], tree_of(argument))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return made("*", number(-1), tree_of(operand))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return tree_of(operand)
            case ast.BinOp(left=left, op=op, right=right):
                return made(KINDS[type(op)], tree_of(left), tree_of(right))
        raise SyntaxError

    try:
        if not re.fullmatch(r"[\w\s.+*/()-]*", marked, re.ASCII):
            raise SyntaxError
        return tree_of(ast.parse(marked, mode="eval").body)
    except (SyntaxError, ValueError, KeyError) as error:
        why = f": {error} is not said or not smooth" if isinstance(error, KeyError) else ""
        raise Unverified(f"the formula '{text[:60]}' cannot be read{why}") from None


@lru_cache(maxsize=None)
def slope(of: Tree, name: str) -> Tree:
    """The derivative of a tree by a name."""
    if not of.parts:
        return number(int(of.kind == "name" and of.value == name))
    (a, da), *rest = [(part, slope(part, name)) for part in of.parts]
    if not rest:
        return parse(SLOPES[of.kind], {"x": a}) * da
    b, db = rest[0]
    match of.kind:
        case "+":
            return da + db
        case "-":
            return da - db
        case "*":
            return da * b + a * db
        case "/":
            return (da - of * db) / b
    return b * made("**", a, b - number(1)) * da if b.value else number(0)


class Values(dict[Tree, Any]):
    """Balls or power series of balls that enclose trees, each computed once, where names have such values; raises
    `Unverified` where an operation has no finite one."""

    def __missing__(self, of: Tree) -> Any:
        if not of.parts:
            return ball(of.value) if of.kind == "number" else arb.pi()
        x, *rest = (self[part] for part in of.parts)
        if of.kind in OPERATIONS:
            found = OPERATIONS[of.kind](x, *rest)
        elif of.kind == "**":
            found = power(x, int(of.parts[1].value))
        elif of.kind == "asinh" and isinstance(x, arb_series):  # which Arb has of balls alone
            found = (Values({X: x})[parse(SLOPES["asinh"], {"x": X})] * x.derivative()).integral() + x[0].asinh()
        else:
            found = getattr(x, of.kind)()
        if not coefficient(found, 0).is_finite():
            raise Unverified(f"the motion comes to where a formula has no value ({of.kind})")
        self[of] = found
        return found


X = tree("name", value="x")


def ball(value: Fraction) -> arb:
    """An enclosure of a fraction."""
    return arb(fmpq(value.numerator, value.denominator))


def power(x: Any, n: int) -> Any:
    """A whole power from 0, by products: Arb takes others by logarithms."""
    result = arb(1)
    for bit in bin(n)[2:]:
        result = result * result * x if bit == "1" else result * result
    return result


def coefficient(value: Any, order: int) -> arb:
    """A coefficient of a series, no number where that is cut off before, or of a constant."""
    if isinstance(value, arb_series):
        return value[order] if order < value.prec else arb("nan")
    return value if order == 0 else arb(0)


def dot(a: Sequence[Any], b: Sequence[Any], start: Any) -> Any:
    """The sum of products."""
    return sum((x * y for x, y in zip(a, b, strict=True)), start)


class Machine:
    """Lagrange's equations of a stated machine, with exact bounds of its parameters.

    names, states : of the n coordinates; these, their rates, the time of a leg, and parameters' places in intervals
    momentum, inertia : M v and M (n, n), M the inertia
    loads, forces : for each law, the forces (n,) of springs, weights and potentials, and what M y'' is without contact
    edges : the extension less each breakpoint of its law, which changes there
    stated : for each law, whatever has to have a value
    gap, weights : the gap, and those of the coordinates in it
    unknowns : the contact's coordinates by number, with the names of their places and rates at the launch
    embedded : the exact matrix (n, n - 1) from the contact's coordinates to all
    """

    def __init__(self, stated: Mapping[str, Any], bounds: Mapping[str, tuple[Fraction, Fraction]]):
        names = self.names = list(stated["coordinates"])
        n, wide = len(names), [name for name, (low, high) in bounds.items() if low < high]
        self.states = [*names, *(f"{name}'" for name in names), "time of the leg", *(f"place of {p}" for p in wide)]
        symbols = [tree("name", value=each) for each in self.states]
        self.rates, places = symbols[n : 2 * n], dict(zip(wide, symbols[2 * n + 1 :], strict=True))
        parameters = {name: number((low + high) / 2) for name, (low, high) in bounds.items()}
        parameters |= {p: parameters[p] + number((bounds[p][1] - bounds[p][0]) / 2) * places[p] for p in wide}
        parameters["pi"] = tree("pi")
        known = {**dict(zip(names, symbols, strict=False)), **parameters}
        masses, weights, inerters = (
            [(parse(place, known), parse(size, parameters)) for place, size in stated[kind]]
            for kind in ("masses", "weights", "inerters")
        )
        rows = [[parse(entry, known) for entry in row] for row in stated["inertia"]] or [[number(0)] * n] * n
        if any(rows[i][j] is not rows[j][i] for i, j in product(range(n), repeat=2)):
            raise Unverified("the stated inertia is not plainly symmetric")
        half, v = number(Fraction(1, 2)), self.rates
        moved = [(m, self.rate(place)) for place, m in masses + inerters]
        energy = sum((half * rows[i][j] * v[i] * v[j] for i, j in product(range(n), repeat=2)), number(0))
        energy = sum((half * m * rate * rate for m, rate in moved), energy)
        self.momentum = [slope(energy, each.value) for each in v]
        self.inertia = [[slope(each, w.value) for w in v] for each in self.momentum]
        turning = [self.rate(p) - slope(energy, y) for p, y in zip(self.momentum, names, strict=True)]
        pull = parse(stated["surface_gravity"], known)
        falling = [(m * pull * parse(stated["gravity"], {**known, "z": h}), h) for h, m in masses + weights]
        potentials = [parse(each, known) for each in stated["potentials"]]
        springs = [(each, parse(each["extension"], known)) for each in stated["springs"]]
        self.counts = parse(stated["counts"], known)
        self.separation = None if stated["separation"] is None else parse(stated["separation"], known)
        in_pieces = [(each["breaks"], e) for each, e in springs if each["breaks"]]
        if len(in_pieces) > 1:
            raise Unverified("more than one spring has a law in pieces")
        self.edges = [e - parse(text, parameters) for texts, e in in_pieces for text in texts]
        common = [each for pair in masses + weights + inerters for each in pair] + sum(rows, [])
        common += [self.counts, *([self.separation] if self.separation else [])] + self.edges
        self.loads, self.forces, self.stated = list[list[Tree]](), list[list[Tree]](), list[list[Tree]]()
        for law in range(len(self.edges) + 1):
            laws = [
                (parse(each["force"][law if each["breaks"] else 0], {**parameters, "r": e}), e, each["potential"])
                for each, e in springs
            ]
            along = [*falling, *((force, e) for force, e, potential in laws if not potential)]
            energies = [*potentials, *(energy for energy, _, potential in laws if potential)]
            along += [(number(1), each) for each in energies]
            load = [sum((number(0) - size * slope(at, y) for size, at in along), number(0)) for y in names]
            self.loads.append(load)
            self.forces.append([q - c for q, c in zip(load, turning, strict=True)])
            self.stated.append([*common, *(each for pair in along for each in pair)])
        self.gap = parse(stated["gap"], known)
        self.weights = [slope(self.gap, name) for name in names]
        at_zero = parse(stated["gap"], {**known, **dict.fromkeys(names, number(0))})
        if at_zero.value != 0 or any(each.kind != "number" for each in self.weights):
            raise Unverified("the gap is no sum of coordinates with numbers before them")
        out, launch = names.index(stated["eliminated"]), names.index(stated["launch"])
        if not self.weights[out].value or launch == out:
            raise Unverified("the gap does not determine the coordinate that it is said to")
        self.unknowns = {i: (name, f"{name}'") for i, name in enumerate(names) if i != out}
        self.unknowns[launch] = "liftoff", "alpha"
        unit = [[Fraction(int(i == j)) for j in self.unknowns] for i in range(n)]
        unit[out] = [-self.weights[j].value / self.weights[out].value for j in self.unknowns]
        self.embedded = unit

    def rate(self, of: Tree) -> Tree:
        """The derivative by time of a function of the coordinates."""
        return sum((slope(of, y) * v for y, v in zip(self.names, self.rates, strict=True)), number(0))


def solved(matrix: list[list[Tree]], *right: Sequence[Tree]) -> tuple[list[Tree], list[list[Tree]]]:
    """The pivots of a symmetric matrix, which are positive where it is positive definite, and the solutions of the
    systems with these right hand sides, by elimination."""
    rows, pivots = [[*row, *(each[i] for each in right)] for i, row in enumerate(matrix)], list[Tree]()
    for k in range(len(rows)):
        pivots.append(rows[k][k])
        rows[k] = [each / pivots[k] for each in rows[k]]
        for i in range(len(rows)):
            if i != k:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    return pivots, [[row[len(rows) + j] for row in rows] for j in range(len(right))]


# Of each state: itself, and where they are followed its derivatives by all states at the start.
Rows = list[list[Any]]


class Field:
    """The motion of the states in a phase of a machine while one law of its spring holds, with time scaled such that a
    leg lasts from 0 to 1. The first 2 n states move, and the time of the leg and the parameters' places stay.

    force : the contact force that keeps the gap's acceleration 0
    rates : of the moving states
    """

    def __init__(self, machine: Machine, law: int, contact: bool):
        self.machine, self.law, self.states = machine, law, machine.states
        self.pivots, (free, pushed) = solved(machine.inertia, machine.forces[law], machine.weights)
        self.push = dot(machine.weights, pushed, number(0))
        self.force = number(-1) * dot(machine.weights, free, number(0)) / self.push
        held = [a + self.force * b for a, b in zip(free, pushed, strict=True)] if contact else free
        self.rates = [tree("name", value="time of the leg") * each for each in (*machine.rates, *held)]
        self.slopes = [[slope(each, name) for name in self.states] for each in self.rates]

    def values(self, x: Sequence[Any]) -> Values:
        """The values of trees at states."""
        return Values(zip((tree("name", value=each) for each in self.states), x, strict=True))

    def along(self, of: Tree, order: int) -> Tree:
        """A derivative by the scaled time of a function of the states."""
        for _ in range(order):
            of = sum((slope(of, name) * rate for name, rate in zip(self.states, self.rates, strict=False)), number(0))
        return of

    def motion(self, rows: Rows) -> Rows:
        """The rates of the moving states, and of their derivatives."""
        at, columns = self.values([row[0] for row in rows]), list(zip(*rows, strict=True))[1:]
        found = [[at[rate]] for rate in self.rates]
        for row, slopes in zip(found, self.slopes if columns else [], strict=False):
            places = [k for k, each in enumerate(slopes) if each.value != 0]
            row += [sum((at[slopes[k]] * each[k] for k in places), arb(0)) for each in columns]
        return found

    def taylor(self, rows: Rows, order: int) -> list[Rows]:
        """Taylor coefficients of the moving rows, one list for each entry."""
        found, still, cap = (
            [[[each] for each in row] for row in rows[: len(self.rates)]],
            rows[len(self.rates) :],
            ctx.cap,
        )
        try:
            for k in range(order):
                ctx.cap = k + 1
                moving = [[arb_series(each, k + 1) for each in row] for row in found]
                for row, rates in zip(found, self.motion([*moving, *still]), strict=True):
                    for each, rate in zip(row, rates, strict=True):
                        each.append(coefficient(rate, k) / (k + 1))
        except (ZeroDivisionError, ValueError):
            raise Unverified("the motion comes to where a formula has no value") from None
        finally:
            ctx.cap = cap
        return found

    def inclusion(self, rows: Rows, h: arb) -> Rows:
        """Rows that hold the motion for a time h from these: Picard's inclusion. All that is stated has a value there,
        and the inertia is positive definite."""
        count, box = len(self.rates), rows
        for _ in range(12):
            new = [
                [x + arb(0).union(h) * rate for x, rate in zip(row, rates, strict=True)]
                for row, rates in zip(rows, self.motion(box), strict=False)
            ]
            pairs = [pair for rows in zip(new, box, strict=False) for pair in zip(*rows, strict=True)]
            if all(a.is_finite() and b.contains(a) for a, b in pairs):
                at = self.values([row[0] for row in box])
                if all(at[each].is_finite() for each in self.machine.stated[self.law]) and all(
                    at[each] > 0 for each in self.pivots
                ):
                    return box
            box = [*([wider(each) for each in row] for row in new), *rows[count:]]
        raise Unverified("no box holds the motion for so long")


def wider(value: arb) -> arb:
    """A ball with more room about it, to be tried."""
    return value + arb(0, 0.1) * (value - value.mid()) + arb(0, (abs(value) + 1).abs_upper() * arb(2) ** (8 - ctx.prec))


class Part:
    """A step of length h from rows of balls: their Taylor polynomials, with the next coefficient over the whole step as
    the last; raises `Unverified` where h is too long."""

    def __init__(self, field: Field, rows: Rows, h: arb, order: int):
        self.field, self.h, self.still = field, h, rows[len(field.rates) :]
        rests = field.taylor(field.inclusion(rows, h), order)
        self.polynomials = field.taylor(rows, order - 1)
        for row, rest in zip(self.polynomials, rests, strict=True):
            for each, last in zip(row, rest, strict=True):
                each.append(last[order])

    def at(self, t: arb, columns: int | None = None) -> Rows:
        """Enclosures of the rows at a time, or at all times of a ball, within the step."""
        moving = [[horner(each, t) for each in row[:columns]] for row in self.polynomials]
        return moving + [row[:columns] for row in self.still]

    def states(self, t: arb) -> list[arb]:
        """Enclosures of the states alone."""
        return [row[0] for row in self.at(t, 1)]


def horner(coefficients: Sequence[arb], t: arb) -> arb:
    """The value of a polynomial."""
    value = arb(0)
    for each in reversed(coefficients):
        value = value * t + each
    return value


def unit_matrix(n: int) -> arb_mat:
    """The unit matrix."""
    return arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def moved(values: Sequence[arb], matrix: arb_mat, deviations: Sequence[arb]) -> list[arb]:
    """Values and a matrix times deviations from these."""
    added = (matrix * arb_mat(len(deviations), 1, list(deviations))).tolist()
    return [value + row[0] for value, row in zip(values, added, strict=True)]


class Leg:
    """The motions of a field over the scaled times from 0 to 1, from the starts c + S w with deviations w in a box.

    parts : its steps
    start, end : of c, enclosures of all, and those of the derivatives by w of all, at either end
    """

    def __init__(self, field: Field, centre: Sequence[arb], seeds: arb_mat, reach: Sequence[arb]):
        n, order = len(centre), max(DERIVED_ORDER, int(ORDER_PER_BIT * ctx.prec))
        rounded, error, slopes = unit_matrix(n), arb_mat(n, n, [0] * n**2), seeds
        self.field, self.parts, small = field, list[Part](), arb(2) ** (12 - ctx.prec)
        box = moved(centre, seeds, reach)
        self.start = list(centre), box, seeds
        left, length = Fraction(1), Fraction(1, 8)
        while left:
            length = min(length, left)
            try:
                ends = Part(field, [[each] for each in centre], ball(length), order).states(ball(length))
                if any(d.rad() > small * (1 + abs(d)) + 4 * c.rad() for c, d in zip(centre, ends, strict=True)):
                    raise Unverified("the step is too long")
                rows = [[x, *row] for x, row in zip(box, unit_matrix(n).tolist(), strict=True)]
                part = Part(field, rows, ball(length), DERIVED_ORDER)
                rests = (each[-1] for row in part.polynomials for each in row[1:])
                if not all(abs(each) * ball(length) ** DERIVED_ORDER < ball(COARSE) for each in rests):
                    raise Unverified("the step is too long")
            except Unverified as error_of_step:
                if length < SHORTEST:
                    raise Unverified(f"the motion is not enclosed: {error_of_step}") from None
                length /= 2
                continue
            transition = arb_mat([row[1:] for row in part.at(part.h)])
            before, rounded = rounded, (transition.mid() * rounded).mid()
            error = rounded.inv() * (transition * before) * (unit_matrix(n) + error) - unit_matrix(n)
            slopes, centre = rounded * (unit_matrix(n) + error) * seeds, ends
            box = moved(centre, slopes, reach)
            self.parts.append(part)
            left, length = left - length, length * Fraction(5, 4)
        self.end = list(centre), box, slopes

    def linear(self, of: Tree, at_end: bool) -> tuple[arb, list[arb]]:
        """A function of the states at one end: its value for the centre, and its derivatives by w for all motions."""
        centre, box, slopes = self.end if at_end else self.start
        at = self.field.values(box)
        row = arb_mat([[at[slope(of, name)] for name in self.field.states]]) * slopes
        return self.field.values(centre)[of], row.tolist()[0]


def stretches(parts: Sequence[Part], test: Callable[[Field, list[arb], bool, bool], Any], what: str) -> list[Any]:
    """What a test finds on stretches of a motion, one after the other, which are halved where it finds nothing. It
    takes a field, the states on a stretch, and whether that holds the beginning and the end of the motion."""
    found, last = list[Any](), len(parts) - 1
    waiting = [(each, arb(0), each.h, i == 0, i == last, MOST_HALVINGS) for i, each in enumerate(parts)][::-1]
    while waiting:
        part, low, high, begins, ends, left = waiting.pop()
        if result := test(part.field, part.states(low.union(high)), begins, ends):
            found.append(result)
        elif left:
            middle = (low + high) / 2
            waiting += [(part, middle, high, False, ends, left - 1), (part, low, middle, begins, False, left - 1)]
        else:
            raise Unverified(f"{what} is not shown")
    return found


def sign_of(value: arb) -> int:
    """The sign of a ball, 0 where it has none."""
    return int(value > 0) - int(value < 0)


def check_positive(what: str, parts: Sequence[Part], of: Callable, at_start: int = 0, at_end: int = 0) -> None:
    """See that a function, of a field, is positive inside the motion. At the ends it is known to have zeros of these
    orders, and is positive beside them by Taylor's formula where the derivative of that order has the fitting sign."""

    def test(field: Field, x: list[arb], begins: bool, ends: bool) -> bool:
        order = at_start if begins and at_start else at_end if ends else 0
        sign = -1 if order and not (begins and at_start) and order % 2 else 1
        return sign_of(field.values(x)[field.along(of(field), order)]) == sign

    stretches(parts, test, what)


def turns(parts: Sequence[Part], of: Tree) -> int:
    """How often a function turns inside the motion, at whose end it is known to turn. On each stretch its rate has a
    sign, or the rate's rate has: then the rate has one zero there or none, as the signs before and after tell."""

    def test(field: Field, x: list[arb], begins: bool, ends: bool) -> tuple[int, int] | None:
        at = field.values(x)
        rate = sign_of(at[field.along(of, 1)])
        bend = 0 if rate else sign_of(at[field.along(of, 2)])
        return (rate, bend) if rate or bend else None

    marks = stretches(parts, test, "how often the extension turns")
    first = parts[0].field
    before, bends = sign_of(first.values(parts[0].states(arb(0)))[first.along(of, 1)]), set[int]()
    if not before or marks[-1][0]:
        raise Unverified("the extension hangs where the motion begins or ends")
    count = 0
    for rate, bend in marks:
        bends = set() if rate else bends | {bend}
        if len(bends) > 1:
            raise Unverified("two turns of the extension are not told apart")
        count, before = count + (rate not in (0, before)), rate or before
    return count


Itinerary = tuple[list[int], list[arb]]


def itinerary(machine: Machine, contact: bool, start: Sequence[arb], left: arb) -> Itinerary:
    """A guess, of which nothing is believed: the laws that hold one after the other along the motion from a start, and
    for how long all but the last do."""
    at, x = Values(zip((tree("name", value=each) for each in machine.states), start, strict=True)), list(start)
    laws, times = [sum(bool(at[each] > 0) for each in machine.edges)], list[arb]()
    since, step = arb(0), left / 32
    while machine.edges and left > step / 2:
        law, field = laws[-1], Field(machine, laws[-1], contact)
        part = Part(field, [[each.mid()] for each in x], step.mid(), DERIVED_ORDER)

        def passed(t: arb, law: int = law, part: Part = part, field: Field = field) -> int:
            """The law that follows at a time of the step, if another does."""
            at = field.values(part.states(t))
            signs = [at[each].mid() > 0 for each in machine.edges]
            return law + (law < len(signs) and signs[law]) - (law > 0 and not signs[law - 1])

        low, high = arb(0), part.h
        if passed(high) != law:
            for _ in range(ctx.prec):
                middle = ((low + high) / 2).mid()
                low, high = (middle, high) if passed(middle) == law else (low, middle)
            laws.append(passed(high))
            times.append((since + high).mid())
            since = arb(0)
        else:
            since += high
        x, left = [each.mid() for each in part.states(high)], (left - high).mid()
    return laws, times


class Solution:
    """The equations of half an orbit on a box of unknowns, for all values of the parameters, and `image`, that of the
    box by Krawczyk's operator.

    names : of the unknowns; the times of the legs but for the last of a phase follow
    laws : of the phases, flight and contact, where the second is one of the equations
    phases : the legs of each
    """

    def __init__(self, machine: Machine, names: Sequence[str], laws: Sequence[Sequence[int]], box: Sequence[arb]):
        self.machine, self.names, self.laws, self.box = machine, list(names), laws, list(box)
        wide = len(machine.states) - 2 * len(machine.names) - 1
        self.count, self.width = len(box), len(box) + wide
        self.centre = [*(each.mid() for each in box), *[arb(0)] * wide]
        self.reach = [*(each - c for each, c in zip(box, self.centre, strict=False)), *[arb(0, 1)] * wide]
        times = iter(range(len(names), self.count))
        self.times = [[next(times) for _ in each[1:]] for each in laws]
        self.phases = [list(self._legs(bool(i), each, self.durations(i))) for i, each in enumerate(laws)]
        flight = self.phases[0]
        rates = [each.value for each in machine.rates]
        launch = Leg.__new__(Leg)
        launch.field, launch.start = Field(machine, laws[0][0], True), flight[0].start
        self.lifted = launch.linear(launch.field.force, False)
        equations = [self.lifted]
        self.passed = list[tuple[int, arb, list[arb]]]()
        for legs, own, times_of in zip(self.phases, laws, self.times, strict=True):
            for leg, pair, j in zip(legs, pairwise(own), times_of, strict=False):
                self.passed.append((j, *leg.linear(machine.edges[min(pair)], True)))
        equations += [(value, row) for _, value, row in self.passed]
        for legs, those in zip(self.phases, (range(len(rates)), machine.unknowns), strict=False):
            equations += [legs[-1].linear(tree("name", value=rates[i]), True) for i in those]
        by_all = arb_mat([row for _, row in equations])
        jacobian = arb_mat([row[: self.count] for row in by_all.tolist()])
        try:
            inverse = jacobian.mid().inv().mid()
        except ZeroDivisionError:
            raise Unverified("the equations are singular") from None
        change = unit_matrix(self.count) - inverse * jacobian
        inner = moved([arb(0)] * self.count, change, self.reach[: self.count])
        inner = moved(inner, inverse, [-value for value, _ in equations])
        inner = moved(inner, inverse * by_all, [*[arb(0)] * self.count, *self.reach[self.count :]])
        self.image = [c + d for c, d in zip(self.centre, inner, strict=False)]
        self.deviations = [*inner, *self.reach[self.count :]]

    def durations(self, phase: int) -> Rows:
        """The times of the legs of half a phase, as rows of weights of the unknowns: the last is what is left."""
        last, own = [arb(0)] * self.width, self.times[phase]
        last[self.names.index("contact_time" if phase else "flight_time")] = arb(0.5)
        for j in own:
            last[j] = arb(-1)
        return [*([arb(int(i == j)) for i in range(self.width)] for j in own), last]

    def _legs(self, contact: bool, laws: Sequence[int], durations: Rows) -> Iterator[Leg]:
        """The legs of a phase from the launch, of these laws and durations."""
        machine, rows, n = self.machine, list[list[arb]](), len(self.machine.names)
        for i, rate in product((0, 1), range(n)):
            row = [arb(0)] * self.width
            for weight, pair in zip(machine.embedded[rate], machine.unknowns.values(), strict=True):
                row[self.names.index(pair[i])] = ball(-weight if i and contact else weight)
            rows.append(row)
        still = [[arb(int(i == j)) for j in range(self.width)] for i in range(self.count, self.width)]
        centre = moved([arb(0)] * 2 * n, arb_mat(rows), self.centre)
        for law, duration in zip(laws, durations, strict=True):
            start = [*centre, *moved([arb(0)], arb_mat([duration]), self.centre), *self.centre[self.count :]]
            yield (leg := Leg(Field(machine, law, contact), start, arb_mat([*rows, duration, *still]), self.reach))
            centre, rows = leg.end[0][: 2 * n], leg.end[2].tolist()[: 2 * n]

    def check_legs(self) -> None:
        """See that from every launch of the box each leg ends at its breakpoint within the box of its time, and is
        inside its piece before."""
        for j, value, row in self.passed:
            others = abs(value) + sum((abs(d * r) for i, (d, r) in enumerate(zip(row, self.reach)) if i != j), arb(0))
            if not abs(row[j]) * self.reach[j].rad() > others:
                raise Unverified("the time at which the spring's law changes is not enclosed")
        for legs, laws in zip(self.phases, self.laws, strict=True):
            for i, (leg, law) in enumerate(zip(legs, laws, strict=True)):
                for edge, side in ((law - 1, 1), (law, -1)):
                    if 0 <= edge < len(self.machine.edges):
                        of = number(side) * self.machine.edges[edge]
                        since, until = (
                            int(0 <= k < len(laws) and min(law, laws[k]) == edge) for k in (i - 1, i + 1)
                        )
                        check_positive("in which piece the law is", leg.parts, lambda _, of=of: of, since, until)

    def enclosed(self, leg: Leg, of: Tree, at_end: bool) -> arb:
        """A function of the states at one end of a leg, of the solution."""
        value, row = leg.linear(of, at_end)
        return dot(row, self.deviations, value)


def check(document: Mapping[str, Any]) -> list[str]:
    """Why a saved proof is not verified, in words; empty where all of its theorem is."""
    try:
        if document.get("format") != "persistent-orbits proof 2" or document.get("kind") != "orbit":
            return ["this program verifies proofs of orbits, saved by this version"]
        if not document.get("proved"):
            return ["the file itself says that not all is proved"]
        _check_parts(document)
        for part in document["parts"]:
            _check_part(document, part, part["parameters"], MOST_SPLITS)
    except Unverified as error:
        return [str(error)]
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, ArithmeticError, RecursionError) as error:
        return [f"the file cannot be read as a proof: {type(error).__name__}: {error}"]
    return []


def bounds_of(pair: Any) -> tuple[Fraction, Fraction]:
    """The exact bounds of an interval."""
    low, high = (Fraction(each) for each in pair)
    if low > high:
        raise Unverified("an interval has its bounds in the wrong order")
    return low, high


def _check_parts(document: Mapping[str, Any]) -> None:
    """See that the parts cover the parameters, and that what is said of all of them holds what is said of each."""
    whole = {name: bounds_of(pair) for name, pair in document["machine"]["parameters"].items()}
    boxes = [{name: bounds_of(pair) for name, pair in part["parameters"].items()} for part in document["parts"]]
    if any(box.keys() != whole.keys() for box in boxes):
        raise Unverified("a part has other parameters than the machine")
    edges = [sorted({*whole[n], *(e for box in boxes for e in box[n] if whole[n][0] < e < whole[n][1])}) for n in whole]
    for cell in product(*(list(pairwise(each)) or [(each[0], each[0])] for each in edges)):
        if not any(
            all(box[n][0] <= low and high <= box[n][1] for n, (low, high) in zip(whole, cell, strict=True))
            for box in boxes
        ):
            raise Unverified("the parts do not cover the intervals of the parameters")
    for name in ("alpha", "flight_time", "contact_time"):
        for part in document["parts"]:
            if name in document["enclosures"]:
                inner, outer = bounds_of(part["unknowns"][name]), bounds_of(document["enclosures"][name])
                if not outer[0] <= inner[0] <= inner[1] <= outer[1]:
                    raise Unverified(f"{name} of a part is not within that of the whole")


def _check_part(document: Mapping[str, Any], part: Mapping[str, Any], parameters: Mapping[str, Any], left: int) -> None:
    """See that the theorem holds for parameters within bounds, which are halved where that is not shown at once."""
    bounds = {name: bounds_of(pair) for name, pair in parameters.items()}
    try:
        _check_box(document, part, bounds)
    except Unverified:
        widest = max(bounds, key=lambda n: (bounds[n][1] - bounds[n][0]) / (abs(sum(bounds[n])) or 1), default="")
        if left == 0 or not widest or bounds[widest][0] == bounds[widest][1]:
            raise
        low, high = bounds[widest]
        for ends in ((low, (low + high) / 2), ((low + high) / 2, high)):
            _check_part(document, part, {**parameters, widest: ends}, left - 1)


def _check_box(
    document: Mapping[str, Any], part: Mapping[str, Any], bounds: Mapping[str, tuple[Fraction, Fraction]]
) -> None:
    machine = Machine(document["machine"], bounds)
    claims = {name: bounds_of(pair) for name, pair in part["unknowns"].items()}
    names = [name for pair in machine.unknowns.values() for name in pair]
    names += ["flight_time", *(["contact_time"] if "contact_time" in claims else [])]
    if claims.keys() != {*names} or (
        (len(machine.names) > 2 or document["motion"]) and "contact_time" not in claims
    ):
        raise Unverified("the theorem does not enclose the unknowns of its equations")
    narrow = min((high - low) / (abs(high) + abs(low) + Fraction(1, 10**9)) for low, high in claims.values())
    if not narrow:
        raise Unverified("an enclosure has no width")
    bits = narrow.denominator.bit_length() - narrow.numerator.bit_length()
    radius = Fraction(part["uniqueness_radius"])
    if radius <= 0:
        raise Unverified("the radius of uniqueness is not positive")
    for name in ("alpha", "flight_time", "contact_time"):
        if name in claims and claims[name][0] <= 0:
            raise Unverified(f"{name} is not positive")
    with ctx.workprec(BITS_OF_UNIQUENESS):
        around = [ball(low - radius).union(ball(high + radius)) for low, high in (claims[name] for name in names)]
        middles = [each.mid() for each in around]
        laws, times = [[0], [0]][: 1 + ("contact_time" in claims)], []
        if machine.edges:
            seed = Solution(machine, names, laws, middles)
            raise Unverified("TODO")
        image = Solution(machine, names, laws, around).image
        if not all(abs(c - each.mid()) < each.rad() for c, each in zip(image, around, strict=True)):
            raise Unverified("the solution is not shown to be the only one within the radius of uniqueness")
    with ctx.workprec(max(BITS_OF_UNIQUENESS, bits + GUARD_BITS)):
        boxes = [ball(low).union(ball(high)) for low, high in (claims[name] for name in names)]
        solution = Solution(machine, names, laws, boxes)
        for _ in range(3):  # the solution is in the image of the wider box, and so in that of what it is known to be in
            if all(each.contains(c) for c, each in zip(solution.image, boxes, strict=True)):
                break
            solution = Solution(machine, names, laws, image)
            image = solution.image
        for name, c in zip(names, solution.image, strict=False):
            if not (ball(claims[name][0]) < c and c < ball(claims[name][1])):
                raise Unverified(f"{name} is not shown to lie in its enclosure")
        _check_motion(document, solution)


def _check_motion(document: Mapping[str, Any], solution: Solution) -> None:
    machine = solution.machine
    n = len(machine.names)
    flight = [part for leg in solution.phases[0] for part in leg.parts]
    if not document["motion"]:
        if document["family"] is not None or document["conditions"]:
            raise Unverified("more is said of the motion than is to be verified")
        return
    contact = [part for leg in solution.phases[1] for part in leg.parts]
    if document["family"] != turns(flight, machine.counts):
        raise Unverified("the family is another one")
    expected = {"clearance", "contact_force", "contact_end", *(["separation"] if machine.separation else [])}
    if document["conditions"] != dict.fromkeys(expected, "proved"):
        raise Unverified("not all conditions of a motion are stated to be proved")
    check_positive("that the gap stays open in flight", flight, lambda field: machine.gap, at_start=3)
    check_positive("that the contact pushes", contact, lambda field: field.force, at_start=1)
    for parts in (flight, contact):
        if machine.separation:
            check_positive("that the separation is positive", parts, lambda field: machine.separation)
    if n == 2:
        (k,) = machine.unknowns
        falls = number(-1) * machine.rates[k]
        check_positive("that the contact first rests in its middle", contact, lambda field: falls, at_end=1)
    for name, leg, at_end in (("liftoff_extension", solution.phases[0][0], False), ("mid_flight_extension", solution.phases[0][-1], True)):
        low, high = bounds_of(document["enclosures"][name])
        value = solution.enclosed(leg, machine.counts, at_end)
        if not (ball(low) <= value and value <= ball(high)):
            raise Unverified(f"{name} is not shown to lie in its enclosure")
