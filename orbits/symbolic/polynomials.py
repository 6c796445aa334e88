"""Polynomials over the rational numbers, as mappings from monomials to coefficients that are not 0.

A monomial is a tuple of pairs (generator, exponent); exponents may be negative.
"""

from collections.abc import Collection, Iterable
from fractions import Fraction
from typing import TypeAlias

Number: TypeAlias = int | Fraction
# In the order of the generators, without exponents of 0.
Monomial: TypeAlias = tuple[tuple[int, int], ...]
Polynomial: TypeAlias = dict[Monomial, Number]

UNIT_POLYNOMIAL: Polynomial = {(): 1}
# The most terms up to which quotients of polynomials are worked out.
MOST_TERMS = 120


def number_of(value: float | Fraction) -> Number:
    """A number as it is worked with, whole ones as integers."""
    exact = Fraction(value)
    return exact.numerator if exact.denominator == 1 else exact


def share_of(a: Number, b: Number) -> Number:
    if isinstance(a, int) and isinstance(b, int) and not a % b:
        return a // b
    return number_of(Fraction(a) / b)


def total_of(a: Polynomial, b: Polynomial) -> Polynomial:
    result = dict(a)
    for monomial, value in b.items():
        if total := result.get(monomial, 0) + value:
            result[monomial] = total
        else:
            del result[monomial]
    return result


def times(a: Monomial, b: Monomial) -> Monomial:
    powers = dict(a)
    for generator, exponent in b:
        powers[generator] = powers.get(generator, 0) + exponent
    return tuple(sorted((i, e) for i, e in powers.items() if e))


def to_power(a: Monomial, exponent: int) -> Monomial:
    return tuple((i, e * exponent) for i, e in a)


def divided(a: Polynomial, b: Polynomial) -> Polynomial | None:
    """The quotient of polynomials, b without a common monomial; None where a remainder is left."""
    names = sorted({i for term in (*a, *b) for i, _ in term})
    if not {i for term in b for i, _ in term} <= {i for term in a for i, _ in term}:
        return None
    low = [min(dict(term).get(i, 0) for term in a) for i in names]
    rest = {tuple(e - o for e, o in zip(_dense(term, names), low, strict=True)): value for term, value in a.items()}
    divisor = {_dense(term, names): value for term, value in b.items()}
    lead, quotient = max(divisor), dict[tuple, Number]()
    while rest:
        first = max(rest)
        step = tuple(e - o for e, o in zip(first, lead, strict=True))
        if min(step) < 0 or len(quotient) >= MOST_TERMS:
            return None
        quotient[step] = share = share_of(rest[first], divisor[lead])
        for term, value in divisor.items():
            place = tuple(e + o for e, o in zip(term, step, strict=True))
            if not (left := rest.pop(place, 0) - share * value):
                continue
            rest[place] = left
    back = lambda term: tuple((i, e + o) for i, e, o in zip(names, term, low, strict=True) if e + o)  # noqa: E731
    return {back(term): value for term, value in quotient.items()}


def _dense(term: Monomial, names: Iterable[int]) -> tuple[int, ...]:
    known = dict(term)
    return tuple(known.get(i, 0) for i in names)


def primitive(a: Polynomial) -> tuple[Number, Monomial, Polynomial]:
    """A polynomial as coefficient, monomial and rest, equal for polynomials that differ in these two alone."""
    names = sorted({i for term in a for i, _ in term})
    low = tuple((i, e) for i in names if (e := min(dict(term).get(i, 0) for term in a)))
    rest = {times(term, to_power(low, -1)): value for term, value in a.items()}
    lead = rest[max(rest)]
    return lead, low, {term: share_of(value, lead) for term, value in rest.items()}


def parts_in(a: Polynomial, generators: Collection[int]) -> dict[Monomial, Polynomial]:
    """A polynomial in these generators, with coefficients that are polynomials in the others."""
    parts: dict[Monomial, Polynomial] = {}
    for term, value in a.items():
        own = tuple(pair for pair in term if pair[0] in generators)
        parts.setdefault(own, {})[tuple(pair for pair in term if pair[0] not in generators)] = value
    return parts
