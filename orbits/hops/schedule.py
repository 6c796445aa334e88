"""Schedules: an actuator's inputs, which a simulation takes as parameters that are piecewise constant in time."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from ..errors import InputError
from ..model import Machine, free_parameters

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
    """What decides in each cycle, at some times after its lift-off, on the value of a parameter up to the next of them.

    name : of the parameter, which is 0 otherwise
    times : (k + 1,), since the lift-off
    """

    @property
    def name(self) -> str: ...

    @property
    def times(self) -> np.ndarray: ...

    def measured(self, state: np.ndarray) -> np.ndarray:
        """What is measured of a flight state (n,)."""
        ...

    def input(self, index: int, states: Mapping[int, np.ndarray]) -> float:
        """The value from one of these times to the next, by what was measured at the times of the cycle so far."""
        ...


class Decisions:
    """The decisions of a feedback while a simulation continues."""

    def __init__(self, feedback: Feedback):
        self.feedback, self.begun = feedback, np.inf
        self.now_in: int | None = None  # the interval whose input is in force; None before the first of a cycle is
        self.values = np.zeros(len(feedback.times) - 1)
        self.measured = dict[int, np.ndarray]()
        self.changes = list[tuple[float, float]]()

    def lift_off(self, now: float) -> None:
        """Begin a cycle without any input in force."""
        self.begun, self.now_in, self.values = now, None, np.zeros(len(self.values))
        self.measured = {}
        self._change(now, 0.0)

    def at(self, now: float, state: np.ndarray) -> Inputs | None:
        """The inputs of this cycle, as far as they are decided; None where nothing is decided now."""
        since = now - self.begun
        if not np.isfinite(since):
            return None
        inside = int(np.searchsorted(self.feedback.times, since + SIMULTANEOUS * (1.0 + now), side="right")) - 1
        if inside == self.now_in:
            return None
        known, self.now_in = -1 if self.now_in is None else self.now_in, inside
        if inside > known:
            self.measured |= dict.fromkeys(range(known + 1, inside + 1), self.feedback.measured(state))
        if 0 <= inside < len(self.values):
            self.values[inside] = self.feedback.input(inside, self.measured)
        self._change(now, self.values[inside] if 0 <= inside < len(self.values) else 0.0)
        return self.begun + self.feedback.times, {self.feedback.name: self.values.copy()}

    def _change(self, now: float, value: float) -> None:
        if self.changes and self.changes[-1][0] == now:
            self.changes.pop()
        self.changes.append((now, value))

    def applied(self, end: float) -> Inputs:
        """All that was decided up to the end of the motion, as a schedule."""
        times, values = zip(*[change for change in self.changes if change[0] < end] or [(0.0, 0.0)], strict=True)
        return np.array([*times, end]), {self.feedback.name: np.array(values)}


def parsed_schedule(schedule: Any) -> Inputs:
    """A schedule as arrays; raises `InputError` for an invalid schedule."""
    try:
        instants, changes = schedule
        times = np.asarray(instants, dtype=float)
        inputs = {name: np.asarray(values, dtype=float) for name, values in changes.items()}
    except (TypeError, ValueError, AttributeError):
        times, inputs = np.zeros(()), {}
    if times.ndim != 1:
        raise InputError(f"schedule = {schedule!r}; it must be a list of times, and lists of parameter values by name")
    if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
        raise InputError("schedule: its times must be finite and increase")
    for name, values in inputs.items():
        if values.shape != (max(len(times) - 1, 0),) or not np.isfinite(values).all():
            raise InputError(
                f"schedule: '{name}' has {values.size} values for {len(times)} times; it must have one value "
                "between each two times"
            )
    return times, inputs


def check_scheduled(inputs: Inputs, names: Sequence[str]) -> None:
    """Raise `InputError` where a schedule changes anything but the parameters that may be scheduled."""
    if unknown := [name for name in inputs[1] if name not in names]:
        there = f"it may change {', '.join(names)}" if names else "no parameter of this machine may change in time"
        raise InputError(f"schedule: the machine has no parameter '{unknown[0]}', or it sets the units; {there}")
