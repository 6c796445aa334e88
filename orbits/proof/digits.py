"""The digits of a proof: the requested number, and more where it is too small to decide a condition."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

from ..errors import InputError
from ..exact import Unproved, check_proof_time


class DigitOptions(NamedTuple):
    """The precision of enclosures."""

    bits_per_digit: float = 3.33  # a little more than log2(10)
    default_bits: int = 60  # of an enclosure whose digits are not stated
    most: int = 300  # digits of an enclosure
    raises: int = 2  # how often digits are doubled where enclosures are too wide to decide something
    fewest_raised: int = 30  # digits after the first doubling


DIGITS = DigitOptions()

T = TypeVar("T")


def checked_digits(digits: int | None) -> int | None:
    """A valid number of digits; raises `InputError` for another."""
    if digits is not None and (
        isinstance(digits, bool) or not (isinstance(digits, int) and 1 <= digits <= DIGITS.most)
    ):
        raise InputError(f"digits = {digits!r}; it must be a whole number from 1 to {DIGITS.most}")
    return digits


def bits_of_digits(digits: int | None) -> int:
    """The number of bits that enclose a number of decimal digits; the default for None."""
    return DIGITS.default_bits if digits is None else int(DIGITS.bits_per_digit * (digits + 2))


def with_enough_digits(
    attempt: Callable[[int | None, T | None], T], undecided: Callable[[T], bool], digits: int | None
) -> tuple[T, int | None, tuple[str, ...]]:
    """What is proved with a number of digits or, where more may decide what it leaves open, with more; the digits that
    it has; and the reason where there is no result with more, as the time limit.

    attempt : (digits, what was proved with fewer digits or None) -> what is proved
    undecided : whether more digits may decide more of that
    """
    found = attempt(digits, None)
    for _ in range(DIGITS.raises):
        more = min(max(2 * (digits or 0), DIGITS.fewest_raised), DIGITS.most)
        if more == digits or not undecided(found):
            break
        try:
            again = attempt(more, found)
            check_proof_time()  # an attempt may state the limit as the reason why something is not proved
        except Unproved as error:
            return found, digits, (f"with {more} digits: {error}",)
        found, digits = again, more
    return found, digits, ()
