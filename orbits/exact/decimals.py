"""Stated decimals as exact fractions, and exact fractions as decimals."""

from decimal import Decimal
from fractions import Fraction

from ..errors import InputError

# The most places of a decimal, before or after the point.
MOST_PLACES = 1500
# More than any accepted decimal has, also after intervals were halved.
MOST_PLACES_OF_DECIMALS = 2000


def exact_fraction(name: str, value: str | float | Decimal | Fraction) -> Fraction:
    """The exact value of a decimal, stated as text, as a Decimal or whole number, or by the float that it rounds to:
    a float stands for the shortest decimal that rounds to it. Raises `InputError` for anything but a finite number."""
    if isinstance(value, Fraction):
        return value
    try:
        if isinstance(value, bool):
            raise TypeError
        decimal = Decimal(value if isinstance(value, str | Decimal | int) else repr(float(value)))
        if not abs(decimal.adjusted()) <= MOST_PLACES or abs(int(decimal.as_tuple().exponent)) > MOST_PLACES:
            raise ValueError
        float(exact := Fraction(decimal))  # an OverflowError where no floating-point number is near
        return exact
    except (ArithmeticError, ValueError, TypeError):
        raise InputError(f"{name} = {str(value)[:40]!r} is not a decimal number") from None


def is_decimal(value: Fraction) -> bool:
    """Whether a fraction is a decimal that can be written out."""
    return 10**MOST_PLACES_OF_DECIMALS % value.denominator == 0


def decimal_text(value: Fraction) -> str:
    """The decimal that equals a fraction exactly."""
    places = next(n for n in range(MOST_PLACES_OF_DECIMALS) if 10**n % value.denominator == 0)
    return scaled_decimal(int(value * 10**places), places)


def scaled_decimal(scaled: int, places: int) -> str:
    """A whole number divided by a power of ten, written out."""
    digits = str(abs(scaled)).rjust(places + 1, "0")
    sign = "-" if scaled < 0 else ""
    return f"{sign}{digits[: len(digits) - places]}.{digits[len(digits) - places :]}" if places else f"{sign}{digits}"
