"""What can go wrong, in the user's terms, and numbers that are asked for, checked.

Every exception of the toolkit derives from `OrbitsError`.
"""

from numbers import Real
from typing import Self

import numpy as np


class OrbitsError(Exception):
    """Base of all errors raised on purpose; the message says what, where and what to do.

    index : of several things asked for together, the one that it is about; None where it is about them all
    """

    index: int | None = None

    def about(self, index: int) -> Self:
        """The error, being about one of several things."""
        self.index = int(index)
        return self


class InputError(OrbitsError, ValueError):
    """The question is ill posed: a number, formula, file or option that cannot be meant."""


class NoOrbit(OrbitsError):
    """The machine has no such orbit, or none could be certified; the message gives the reason."""


class FlowError(NoOrbit):
    """A motion cannot be carried on: it blows up or stops being a number."""


class OutOfRange(FlowError):
    """A motion needs a law where it is not defined, as outside a measured table."""


class RunsAway(FlowError):
    """A motion goes beyond all bounds."""


class BreaksDown(FlowError):
    """A motion comes to a singularity: its steps vanish or are not numbers."""


def finite_number(name: str, value) -> float:
    """`value` as a finite float; raises `InputError` that names it."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    try:
        number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else np.nan
    except OverflowError:
        number = np.inf
    if not np.isfinite(number):
        raise InputError(f"{name} = {value!r} is not a finite number")
    return number


def whole_number(name: str, value, what: str = "", least: int = 1) -> int:
    """`value` as a whole number, of `what` where that is said, from `least`; raises `InputError` that names it."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{name} = {value!r}; it is a {f'number of {what},' if what else 'whole number'} from {least}")
    return int(value)
