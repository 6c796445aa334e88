"""Balls as decimals that are rounded outward."""

import math
from collections.abc import Callable
from fractions import Fraction

from flint import arb, ctx

from .bounds import Enclosure
from .decimals import decimal_text, scaled_decimal

# Stated digits of a radius beyond its first.
DIGITS_OF_RADIUS = 2
# The most stated decimal places of a number that is known exactly.
EXACT_PLACES = 40
# The stated decimal places of a bound.
PLACES_OF_BOUNDS = 12
# More than any ball has.
EXACT_BITS = 8192


def enclosure_of(ball: arb, digits: int | None = None) -> Enclosure:
    """The bounds of a ball as decimals rounded outward, with as many places as its radius, or with `digits` digits."""
    with ctx.workprec(EXACT_BITS):  # else the bounds would be rounded too
        low, high = _fraction(ball.lower()), _fraction(ball.upper())
    if low == high and (low * 10**EXACT_PLACES).denominator == 1:
        text = scaled_decimal(int(low * 10**EXACT_PLACES), EXACT_PLACES).rstrip("0").rstrip(".")
        return Enclosure(text, text)
    places = max(DIGITS_OF_RADIUS - _exponent(high - low), 0) if high > low else EXACT_PLACES
    if digits is not None:
        places = max(places, digits + 2 - _exponent(max(abs(low), abs(high))))
    return Enclosure(
        scaled_decimal(math.floor(low * 10**places), places), scaled_decimal(math.ceil(high * 10**places), places)
    )


def bounds_of_fractions(bounds: tuple[Fraction, Fraction]) -> Enclosure:
    """The exact bounds of a parameter."""
    return Enclosure(*map(decimal_text, bounds))


def upper_fraction(value: Fraction) -> str:
    """A decimal with at most `PLACES_OF_BOUNDS` places that is no less than a number above 0, or the number itself."""
    scaled = value * 10**PLACES_OF_BOUNDS
    return scaled_decimal(math.ceil(scaled), PLACES_OF_BOUNDS).rstrip("0").rstrip(".")


def radius_of(enclosure: Enclosure) -> str:
    """A decimal with few digits that is no less than half the width of an enclosure."""
    half = (Fraction(enclosure.high) - Fraction(enclosure.low)) / 2
    return _scientific(half, math.ceil) if half else "0"


def upper_decimal(radius: arb) -> str:
    """A decimal with few digits that is no less than a radius."""
    value = _fraction(radius.abs_upper())
    if value == 0:
        return "0"
    return _scientific(value, math.ceil)


def lower_decimal(radius: arb) -> str:
    """A decimal with few digits that is no more than a radius, 0 for one that may not be positive."""
    value = _fraction(radius.lower())
    if value <= 0:
        return "0"
    return _scientific(value, math.floor)


def _scientific(value: Fraction, rounded: Callable[[Fraction], int]) -> str:
    """A number above 0 as 1.23e-4."""
    exponent = _exponent(value)
    digits = rounded(value * Fraction(10) ** (DIGITS_OF_RADIUS - exponent))
    return f"{digits // 10**DIGITS_OF_RADIUS}.{digits % 10**DIGITS_OF_RADIUS:0{DIGITS_OF_RADIUS}d}e{exponent}"


def _fraction(exact: arb) -> Fraction:
    mantissa, exponent = exact.mid().man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def _exponent(value: Fraction) -> int:
    """The power of ten of the first digit of a number above 0."""
    if value == 0:
        return 0
    guess = len(str(value.numerator)) - len(str(value.denominator))
    return guess if value >= Fraction(10) ** guess else guess - 1
