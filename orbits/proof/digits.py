"""The digits of a proof: those that are requested, and more where these are too few to decide a condition."""

from collections.abc import Callable
from typing import TypeVar

from ..errors import InputError
from ..exact.refusal import Unproved, check_proof_time

BITS_PER_DIGIT = 3.33
# The bits of an enclosure by default.
DEFAULT_BITS = 60
MOST_DIGITS = 300
# Where enclosures are too wide to decide something, their digits are doubled at most this many times, and are at least
# the second number.
MOST_RAISES, FEWEST_RAISED = 2, 30

T = TypeVar("T")


def checked_digits(digits: int | None) -> int | None:
    """A valid number of digits; raises `InputError` for another."""
    if digits is not None and (
        isinstance(digits, bool) or not (isinstance(digits, int) and 1 <= digits <= MOST_DIGITS)
    ):
        raise InputError(f"digits = {digits!r}; it is a whole number from 1 to {MOST_DIGITS}")
    return digits


def bits_of_digits(digits: int | None) -> int:
    """The number of bits that enclose a number of decimal digits; the default for None."""
    return DEFAULT_BITS if digits is None else int(BITS_PER_DIGIT * (digits + 2))


def with_enough_digits(
    attempt: Callable[[int | None, T | None], T], undecided: Callable[[T], bool], digits: int | None
) -> tuple[T, int | None, tuple[str, ...]]:
    """What is proved with a number of digits or, where more may decide what it leaves open, with more; the digits that
    it has; and the reason where there is no result with more, as the time limit.

    attempt : (digits, what was proved with fewer digits or None) -> what is proved
    undecided : whether more digits may decide more of that
    """
    found = attempt(digits, None)
    for _ in range(MOST_RAISES):
        more = min(max(2 * (digits or 0), FEWEST_RAISED), MOST_DIGITS)
        if more == digits or not undecided(found):
            break
        try:
            again = attempt(more, found)
            check_proof_time()  # an attempt may state the limit as the reason why something is not proved
        except Unproved as error:
            return found, digits, (f"with {more} digits: {error}",)
        found, digits = again, more
    return found, digits, ()
