"""Schedules: an actuator's inputs, which a simulation takes as parameters that are piecewise constant in time."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from ..errors import InputError
from ..model.machine import Machine, free_parameters

# A schedule's times (k + 1,), and the values (k,) of parameters by name.
Inputs = tuple[np.ndarray, Mapping[str, np.ndarray]]
# An event this close to a change of the schedule, relative to the time, is at it: event times are no more accurate.
SIMULTANEOUS = 1e-9


class Schedule:
    """Parameters as piecewise constant functions of time, as in `simulate`, with the machine's own values outside."""

    def __init__(self, machine: Machine, inputs: Inputs | None) -> None:
        nothing: Inputs = np.zeros(0), {}
        self.times, changes = inputs or nothing
        if inputs:
            check_scheduled(inputs, free_parameters(machine))
        count, rows = max(len(self.times) - 1, 0), list[list[float]]()
        for name, own in machine.values.items():
            rows.append([own, *changes.get(name, np.full(count, own)), own] if len(self.times) else [own])
        whole = len(self.times) + 1 if len(self.times) else 1
        self.columns = np.array(rows, dtype=float).reshape(len(rows), whole).T  # (k + 2, np)

    def __call__(self, now: float) -> tuple[np.ndarray, float]:
        """The parameters (np,) in force from a time on, and the time until which they are in force."""
        index = int(np.searchsorted(self.times, now + SIMULTANEOUS * (1.0 + now), side="right"))
        return self.columns[index], float(self.times[index]) if index < len(self.times) else np.inf


class Feedback(Protocol):
    """What decides at a lift-off how parameters change in the cycle that follows.

    times : (k + 1,), since the lift-off
    """

    times: np.ndarray

    def inputs(self, launch: np.ndarray) -> Mapping[str, np.ndarray]:
        """The values (k,) of parameters between these times, by name, after a launch with the free numbers (d,)."""
        ...


def joined_inputs(before: Inputs | None, after: Inputs, now: float) -> Inputs:
    """Inputs up to the time `now`, at which others replace them; 0 is between both."""
    if before is None:
        return after
    times, inputs = before
    count = int(np.searchsorted(times, now))
    ends = [*times[:count], now] if count < len(times) else [*times]
    gap = [] if ends[-1] >= after[0][0] else [0.0]
    joined = {name: np.array([*inputs[name][: len(ends) - 1], *gap, *after[1][name]]) for name in after[1]}
    return np.array([*ends, *after[0][len(gap) == 0 :]]), joined


def parsed_schedule(schedule: Any) -> Inputs:
    """A schedule as arrays; raises `InputError` for an invalid schedule."""
    try:
        instants, changes = schedule
        times = np.asarray(instants, dtype=float)
        inputs = {name: np.asarray(values, dtype=float) for name, values in changes.items()}
    except (TypeError, ValueError, AttributeError):
        times, inputs = np.zeros(()), {}
    if times.ndim != 1:
        raise InputError(f"schedule = {schedule!r}; it is a list of times, and lists of values of parameters by name")
    if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
        raise InputError("schedule: its times are finite and rise")
    for name, values in inputs.items():
        if values.shape != (max(len(times) - 1, 0),) or not np.isfinite(values).all():
            raise InputError(f"schedule: '{name}' has {values.size} values between {len(times)} times")
    return times, inputs


def check_scheduled(inputs: Inputs, names: Sequence[str]) -> None:
    """Raise `InputError` where a schedule changes anything but the parameters that may be scheduled."""
    if unknown := [name for name in inputs[1] if name not in names]:
        there = f"there are {', '.join(names)}" if names else "this machine has none that may change in time"
        raise InputError(f"schedule: the machine has no parameter '{unknown[0]}', or it sets the units; {there}")
