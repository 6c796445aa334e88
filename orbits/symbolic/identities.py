"""Decisions about exact expressions: whether one is 0, is a number, or depends on some symbols.

They are exact. First the expression is evaluated modulo a prime at fixed residues of its symbols and functions, where
functions by whose identities `normal_forms` decides have values that satisfy them: a result that is not 0 shows that it
does not vanish, and two different results that it varies. Only what these leave open is decided by its normal form.
What vanishes by another identity of functions, or is too long to be worked out, is not recognised: it counts as one
that depends on all its symbols, which costs time and changes no result.
"""

from collections.abc import Collection
from fractions import Fraction
from hashlib import blake2b
from typing import TypeAlias

from .normal_forms import constant, free_of, is_zero, normal_form, written
from .tree import ExactExpression, exact_number, in_order, noted, parity_of

# A Mersenne prime that is 3 modulo 4, so that a root of x is x^((p + 1)/4).
PRIME = 2**61 - 1
# Longer expressions are left as they are.
LONGEST_SIMPLIFIED = 200
# Where residues are taken: the symbols that have other residues than usual, None for all of them.
Place: TypeAlias = frozenset[ExactExpression] | None
USUAL: Place = frozenset()
_TURNING = ("sin", "cos", "tan")


def vanishes(each: ExactExpression) -> bool:
    """Whether an expression is 0 everywhere."""
    if each.is_number:
        return not each.value
    return not residue(each, USUAL) and is_zero(normal_form(each))


def number_of(each: ExactExpression) -> Fraction | None:
    """The rational number that an expression is everywhere; None for another."""
    if each.is_number:
        return each.value
    if not each.parts or _differ(residue(each, USUAL), residue(each, None)):
        return None
    return constant(normal_form(each))


def without(each: ExactExpression, symbols: Collection[ExactExpression]) -> ExactExpression | None:
    """An expression that does not depend on some symbols, written without them; None for another."""
    these = frozenset(symbols)
    if _differ(residue(each, USUAL), residue(each, these)):
        return None
    if these.isdisjoint(in_order([each])):
        return each
    found = free_of(normal_form(each), these)
    return None if found is None else written(found)


def has_symbols(each: ExactExpression) -> bool:
    """Whether an expression contains a symbol, as sqrt(2) does not."""
    return _differ(residue(each, USUAL), residue(each, None)) or any(part.kind == "symbol" for part in in_order([each]))


def simplified(each: ExactExpression) -> ExactExpression:
    """An expression as a number where it is one, and by its normal form where that is no longer."""
    if (value := number_of(each)) is not None:
        return exact_number(value)
    if each.size > LONGEST_SIMPLIFIED:
        return each
    form = normal_form(each)
    return written(form) if form.operations <= sum(bool(part.parts) for part in in_order([each])) else each


def _differ(a: int | None, b: int | None) -> bool:
    """Whether two residues are known and are different."""
    return a is not None and b is not None and a != b


def residue(of: ExactExpression, place: Place) -> int | None:
    """An expression modulo the prime; None where it has no value there."""
    return noted(of, place, lambda each: _residue_of(each, place))


def _residue_of(each: ExactExpression, place: Place) -> int | None:
    """The residue of an expression whose parts have theirs stored."""
    if each.kind == "symbol":
        return _mixed("symbol", each.value, int(place is None or each in place))
    if each.kind == "number":
        return _quotient(each.value.numerator, each.value.denominator)
    parts = [part.notes[place] for part in each.parts]
    known = [part for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    match each.kind:
        case "+":
            return (known[0] + known[1]) % PRIME
        case "*":
            return known[0] * known[1] % PRIME
        case "/":
            return _quotient(*known)
        case "**":
            power = pow(known[0], abs(each.value), PRIME)
            return power if each.value > 0 else _quotient(1, power)
        case "sqrt":
            root = pow(known[0], (PRIME + 1) // 4, PRIME)
            return root if root * root % PRIME == known[0] else None
        case kind if kind in _TURNING:
            return _turned(kind, known[0])
    parity = parity_of(each)
    opposite = bool(parity) and known[0] > PRIME // 2
    value = _mixed(each.kind, each.value, *([PRIME - known[0]] if opposite else known))
    return -value % PRIME if opposite and parity < 0 else value


def _turned(kind: str, angle: int) -> int | None:
    """The residue of a function of an angle, by the rational parametrisation of the circle."""
    opposite = angle > PRIME // 2
    t = _mixed("angle", PRIME - angle if opposite else angle) if angle else 0
    t = -t if opposite else t
    circle = {"sin": (2 * t, 1 + t * t), "cos": (1 - t * t, 1 + t * t), "tan": (2 * t, 1 - t * t)}
    return _quotient(*circle[kind])


def _quotient(a: int, b: int) -> int | None:
    return a * pow(b, -1, PRIME) % PRIME if b % PRIME else None


def _mixed(*of: object) -> int:
    """A residue that is fixed by some values, in every process the same."""
    return int.from_bytes(blake2b(repr(of).encode(), digest_size=7).digest()) % PRIME
