"""What a published case is: numbers with their source, and the same numbers computed with the toolkit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property

import numpy as np

DIGITS = 10  # significant digits of numbers that no source prints


@dataclass(frozen=True)
class Case:
    """A published case.

    name : of the machine or the problem
    quantity : the numbers, with the values of the parameters
    source : authors, title, journal and year
    place : where it is in the source, and the closed form
    published : the numbers: as text where the source prints them, as floats where it states a closed form
    compute : computes the same numbers with the toolkit
    within : the largest difference, absolute; None for half a unit of the last printed digit
    slow : whether the quick mode leaves it out
    """

    name: str
    quantity: str
    source: str
    place: str
    published: Sequence[str | float]
    compute: Callable[[], Sequence[float] | np.ndarray]
    within: float | None = None
    slow: bool = False

    def __post_init__(self) -> None:
        if self.within is None and not all(isinstance(each, str) for each in self.published):
            raise ValueError(f"{self.name}, {self.quantity}: a closed form needs within=, no last digit is printed")

    @property
    def expected(self) -> np.ndarray:
        """The published numbers (n,)."""
        return np.array([float(each) for each in self.published])

    @property
    def allowed(self) -> np.ndarray:
        """The largest differences (n,)."""
        if self.within is not None:
            return np.full(len(self.published), self.within)
        return np.array([half_a_unit(str(each)) for each in self.published])


@dataclass(frozen=True)
class Computed:
    """A case with the numbers of the toolkit.

    ours : (n,)
    """

    case: Case
    ours: np.ndarray

    @cached_property
    def differences(self) -> np.ndarray:
        """The distances (n,) from the published numbers."""
        return np.abs(self.ours - self.case.expected)

    @property
    def worst(self) -> int:
        """The index of the number that is farthest off, as a share of what is allowed."""
        return int(np.argmax(np.nan_to_num(self.differences / self.case.allowed, nan=np.inf)))

    @property
    def right(self) -> bool:
        """Whether all numbers agree; a NaN does not."""
        return bool((self.differences <= self.case.allowed).all())


@dataclass(frozen=True)
class Missing:
    """A published case that the toolkit cannot state.

    idea : what is missing, in one line
    """

    name: str
    source: str
    idea: str


def computed(case: Case) -> Computed:
    """A case with its numbers; raises `ValueError` where these are not as many as the published ones."""
    ours = np.array([float(each) for each in case.compute()])
    if ours.shape != case.expected.shape:
        raise ValueError(f"{case.name}: {len(ours)} numbers are computed, {len(case.published)} are published")
    return Computed(case, ours)


def half_a_unit(printed: str) -> float:
    """Half a unit of the last digit of a number as it is printed, as 0.005 of "1.52"; 1e-15 where that is more."""
    exponent = Decimal(printed).as_tuple().exponent
    return max(0.5 * 10.0 ** float(exponent), 1e-15)


def published_text(each: str | float) -> str:
    """A published number as it is printed, one of a closed form with ten digits."""
    return each if isinstance(each, str) else f"{each:.{DIGITS}g}"


def our_text(value: float, published: str | float) -> str:
    """Our number with one digit more than the source prints, and with ten digits if it states a closed form."""
    if not isinstance(published, str):
        return f"{value:.{DIGITS}g}"
    exponent = int(Decimal(published).as_tuple().exponent)
    return f"{value:.{max(0, min(1 - exponent, 15))}f}"
