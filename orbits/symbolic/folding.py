"""Numerals of a formula, worked out in rational numbers before they are rounded to doubles.

Subtrees of numerals alone, of + - * / and whole powers, become one numeral: `1e16 + 3 - 1e16` is 3, which doubles would
make 4. So do sums from which numerals cancel, as in `1e16 + c - 1e16`, and equal products of names, as in
`1e16*x + 3*x - 1e16*x`. All other formulas are left as they are written.
"""

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache
from typing import TypeAlias

# A sum of terms: the tree of each, without its number, with that number. The tree of the number itself is ().
Sum: TypeAlias = dict[tuple, Fraction]

BARE: tuple = ()
# Powers beyond these, the exponent and the binary digits of the result, are left to the arithmetic of doubles.
LARGEST_POWER, LONGEST_NUMBER = 64, 8192


@lru_cache(maxsize=1024)
def exact_numeral(text: str) -> Fraction:
    """The rational number that a numeral, or a quotient of whole numbers, is; 0 where it is 0 as a double."""
    if "/" in text:
        return Fraction(text)
    return Fraction(Decimal(text)) if float(text) else Fraction(0)


def numeral(value: Fraction) -> tuple | None:
    """The tree of a number; None where it is beyond the doubles."""
    try:
        rounded = float(abs(value))
    except OverflowError:
        return None
    if value and not rounded:
        return None
    tree = ("number", rounded, str(abs(value)))
    return ("negative", tree) if value < 0 else tree


def folded(nodes: list[tuple]) -> tuple:
    """The tree whose nodes these are, each after its branches, with its numerals worked out."""
    stack: list[tuple[tuple, Sum]] = []  # of each branch its tree, and the sum that it is
    for node in nodes:
        if node[0] == "number":
            stack.append((node, {BARE: exact_numeral(node[2])}))
        elif node[0] == "name":
            stack.append((node, {node: Fraction(1)}))
        elif node[0] == "call":
            inner, _ = stack.pop()
            stack.append(_alone(("call", node[1], inner)))
        elif node[0] == "negative":
            inner, terms = stack.pop()
            stack.append((("negative", inner), {tree: -value for tree, value in terms.items()}))
        else:
            right, left = stack.pop(), stack.pop()
            stack.append(_FOLDS[node[0]](left, right))
    return stack.pop()[0]


def _alone(tree: tuple) -> tuple[tuple, Sum]:
    """A branch that is one term, which cancels with no other: it may have no value."""
    return tree, {("alone", object(), tree): Fraction(1)}


def _only_number(terms: Sum) -> Fraction | None:
    """The number that a sum is, None for another."""
    if not terms:
        return Fraction(0)
    return terms[BARE] if terms.keys() == {BARE} else None


def _as_numeral(tree: tuple, terms: Sum) -> tuple[tuple, Sum]:
    """A branch with its tree replaced by a numeral where it is a number."""
    value = _only_number(terms)
    simpler = None if value is None else numeral(value)
    return simpler or tree, terms


def _added(left: tuple, right: tuple, sign: int) -> tuple[tuple, Sum]:
    terms, cancels = dict(left[1]), False
    for tree, value in right[1].items():
        total = terms.get(tree, Fraction(0)) + sign * value
        cancels = cancels or (tree in terms and (terms[tree] > 0) != (sign * value > 0))
        terms[tree] = total
        if not total:
            del terms[tree]
    tree = ("+" if sign > 0 else "-", left[0], right[0])
    if _only_number(terms) is None and cancels:
        tree = _written(terms) or tree
    return _as_numeral(tree, terms)


def _written(terms: Sum) -> tuple | None:
    """The tree of a sum, None where one of its numbers is beyond the doubles."""
    tree: tuple | None = None
    for atom, value in terms.items():
        body = atom[2] if atom and atom[0] == "alone" else atom
        if (number := numeral(abs(value))) is None:
            return None
        term = body if body and abs(value) == 1 else ("*", number, body) if body else number
        first = term if value > 0 else ("negative", term)
        tree = first if tree is None else ("+" if value > 0 else "-", tree, term)
    return tree


def _multiplied(left: tuple, right: tuple) -> tuple[tuple, Sum]:
    tree = ("*", left[0], right[0])
    for number, terms in ((_only_number(left[1]), right[1]), (_only_number(right[1]), left[1])):
        if number == 0 and _only_number(terms) is None:
            return _alone(tree)  # the other may have no value
        if number is not None:
            return _as_numeral(tree, {atom: number * value for atom, value in terms.items() if number})
    if len(left[1]) == len(right[1]) == 1:
        ((a, x),), ((b, y),) = left[1].items(), right[1].items()
        if "alone" not in (a[0], b[0]):
            return tree, {("*", a, b): x * y}
    return _alone(tree)


def _quotient(left: tuple, right: tuple) -> tuple[tuple, Sum]:
    tree, number = ("/", left[0], right[0]), _only_number(right[1])
    if not number:
        return _alone(tree)
    return _as_numeral(tree, {atom: value / number for atom, value in left[1].items()})


def _raised(left: tuple, right: tuple) -> tuple[tuple, Sum]:
    base, exponent, stated = _only_number(left[1]), _only_number(right[1]), right[0]
    if stated[0] == "number" and len(stated) == 3:
        stated = (*stated, "exponent")  # a constant, so that a power of a number stays one
    tree = ("**", left[0], stated)
    if base is None or exponent is None or exponent.denominator != 1 or not (base or exponent > 0):
        return _alone(tree)
    bits = base.numerator.bit_length() + base.denominator.bit_length()
    if abs(exponent) > LARGEST_POWER or bits * abs(exponent) > LONGEST_NUMBER:
        return _alone(tree)
    return _as_numeral(tree, {BARE: base ** int(exponent)} if base else {})


_FOLDS: dict[str, Callable[[tuple, tuple], tuple[tuple, Sum]]] = {
    "+": lambda left, right: _added(left, right, 1),
    "-": lambda left, right: _added(left, right, -1),
    "*": _multiplied,
    "/": _quotient,
    "**": _raised,
}
