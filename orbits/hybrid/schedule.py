"""Inputs of a simulation that change at given times."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError

# An event this close to a change of the schedule, relative to the time, happens at it: event times are accurate to no
# more than this.
SIMULTANEOUS = 1e-9


class Schedule:
    """Parameters as piecewise constant functions of time; see `simulate`. Raises `InputError` for what is none.

    values : the machine's own parameters, which hold before the first time and after the last
    """

    def __init__(self, values: Mapping[str, float], schedule: tuple[ArrayLike, Mapping[str, ArrayLike]] | None) -> None:
        times, changes = ((), {}) if schedule is None else schedule
        self.times = np.asarray(times, dtype=float)
        unknown = [name for name in changes if name not in values]
        if unknown:
            raise InputError(f"schedule: the machine has no parameter '{unknown[0]}'; it has {', '.join(values)}")
        if schedule is not None and not (np.isfinite(self.times).all() and (np.diff(self.times) > 0).all()):
            raise InputError("schedule: its times are finite and rise")
        count, rows = max(len(self.times) - 1, 0), []
        for name, own in values.items():
            given = np.asarray(changes.get(name, np.full(count, own)), dtype=float)
            if given.shape != (count,) or not np.isfinite(given).all():
                raise InputError(f"schedule: '{name}' has {given.size} values between {len(self.times)} times")
            rows.append([own, *given, own] if len(self.times) else [own])
        self.columns = np.array(rows, dtype=float).T  # (k + 2, np)

    def __call__(self, now: float) -> tuple[np.ndarray, float]:
        """The parameters (np,) that hold from a time on, and the time until which they hold."""
        index = int(np.searchsorted(self.times, now + SIMULTANEOUS * (1.0 + now), side="right"))
        return self.columns[index], float(self.times[index]) if index < len(self.times) else np.inf
