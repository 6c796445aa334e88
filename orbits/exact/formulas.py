"""Stated formulas as exact expressions, with the conditions under which their operations are defined.

A numeral is the decimal that is written. A divisor, the argument of a root or a logarithm, and the base of a power that
is not a whole number are collected as a `Domain`: the expression may be simplified, as r (r - 1)/(r - 1) to r, and
still has no value at r = 1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

from flint import arb

from ..errors import InputError
from ..symbolic import BLANKS, PI, SMOOTH_FUNCTIONS, ExactExpression, call, expression_of_nodes, parse
from .decimals import exact_fraction
from .refusal import Unproved


@dataclass(frozen=True)
class Domain:
    """The condition of an operation of a formula: its `place` is positive if `positive`, else not zero.

    what : the operation and the formula, for messages
    """

    what: str
    place: ExactExpression
    positive: bool

    def holds(self, value: arb) -> bool:
        """Whether all values of a ball are allowed."""
        return bool(value > 0) or (not self.positive and bool(value < 0))


class Domains(list[Domain]):
    """The domains of the operations of some formulas."""

    def need(self, what: str, place: ExactExpression, positive: bool) -> None:
        """Add a condition that is not evident; raises `Unproved` for a number that violates it."""
        if place.is_number:
            if not (place.value > 0 or (not positive and place.value)):
                raise Unproved(f"{what} has no value")
            return
        domain = Domain(what, place, positive)
        if domain not in self:
            self.append(domain)


_parsed_formula = lru_cache(maxsize=1024)(parse)


def expression_of(text: str, names: Mapping[str, ExactExpression], domains: Domains) -> ExactExpression:
    """The exact expression of a formula whose names stand for expressions; its domains are added to `domains`.

    Raises `InputError` for an unknown name, and `Unproved` for abs and sign, which have no Taylor series everywhere,
    and for a formula that has no value anywhere.
    """
    formula = _parsed_formula(text)
    if missing := sorted(formula.names - names.keys()):
        raise InputError(f"'{text}' needs a value for {', '.join(missing)}")
    shown = f"'{text.strip(BLANKS)[:60]}'"

    def note(kind: str, operands: Sequence[ExactExpression]) -> None:
        """Collect the domain of an operation."""
        if kind == "/":
            domains.need(f"a quotient in {shown}", operands[1], positive=False)
        elif kind == "**":
            base, exponent = operands
            whole = exponent.is_number and exponent.value.denominator == 1
            if not whole or exponent.value < 0:
                domains.need(f"a power in {shown}", base, positive=not whole)
        elif kind not in ("+", "-", "*"):
            if kind not in SMOOTH_FUNCTIONS:
                raise Unproved(f"{shown} has {kind}, which has no Taylor series everywhere")
            for place in _PLACES.get(kind, lambda x: ())(operands[0]):
                domains.need(f"{kind} in {shown}", place, positive=kind != "tan")

    return expression_of_nodes(formula.nodes, {"pi": PI, **names}, partial(exact_fraction, "a numeral"), note)


# The expressions of each function's argument x that have to be positive; for the tangent, not zero.
_PLACES = {
    "sqrt": lambda x: (x,),
    "log": lambda x: (x,),
    "log1p": lambda x: (1 + x,),
    "tan": lambda x: (call("cos", x),),
    **dict.fromkeys(("asin", "acos", "atanh"), lambda x: (1 + x, 1 - x)),
    "acosh": lambda x: (x - 1,),
}
