"""An actuated machine driven open loop by the inputs of a motion, from a disturbed start or with other parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from orbits import InputError, Simulation, simulate
from orbits.errors import finite_number, whole_number
from orbits.hops import Inputs
from orbits.result import Axes, Result
from orbits.units import LIFTOFF_SPEED

from .actuated import Actuated, Actuator
from .actuated_launch import launch_argument

# A push comes later by such a share of its time that it follows a landing at that time: the first of these is
# enough but for a landing at no speed, whose time is known less well.
JUST_AFTER = (1e-13, 1e-10, 1e-8, 1e-6)


@dataclass(frozen=True, repr=False)
class Disturbed(Result, what="disturbed motion", in_line=("launch_errors", "run.status"), printed_digits=10):
    """An open-loop simulation with a disturbance, and the same without it; in SI for a machine in SI.

    nominal : the simulation without the disturbance
    run : the simulation with it; its `status` says why it ended, and `run(t)` its states
    """

    nominal: Simulation
    run: Simulation

    @property
    def compared(self) -> int:
        """The number of launches that both simulations have, that of the start included if it was one."""
        return min(len(self.nominal.launches), len(self.run.launches))

    @property
    def launch_errors(self) -> np.ndarray:
        """The disturbed launch speeds (k,) minus the nominal ones, launch by launch."""
        return self.run.launches[: self.compared] - self.nominal.launches[: self.compared]

    @property
    def delays(self) -> np.ndarray:
        """The times of the disturbed launches (k,) minus those of the nominal ones."""
        return self.launch_times[: self.compared] - _launch_times(self.nominal)[: self.compared]

    @property
    def launch_times(self) -> np.ndarray:
        """The times (k,) of the launches of `run`, 0 for that of its start."""
        return _launch_times(self.run)

    machine = property(lambda self: self.run.machine)

    @cached_property
    def units(self) -> dict[str, str]:
        """The units of the table by name; empty for a dimensionless machine."""
        if (units := self.run.source.units) is None:
            return {}
        speeds = dict.fromkeys(("launch speed", "off by"), units.text(LIFTOFF_SPEED))
        return {**self.run.units, **speeds, "time": "s", "late by": "s"}

    def title(self) -> str:
        return "driven open loop under a disturbance"

    def table(self) -> dict[str, np.ndarray]:
        """The launches that are compared as columns: their speeds and times, and by how much these are off."""
        speeds, times = self.run.launches[: self.compared], self.launch_times[: self.compared]
        hops = np.arange(self.compared) + 1 - len(self._start)
        columns = {"hop": hops, "launch speed": speeds, "off by": self.launch_errors, "time": times}
        return {**columns, "late by": self.delays}

    def _notes(self) -> list[str]:
        return [f"{self.run.status}{f': {self.run.reason}' if self.run.reason else ''}"]

    @classmethod
    def of_saved(cls, document: object, machine: Any = None) -> "Disturbed":
        """The result of a document, of the machine of its `Driven`; see `Result`."""
        words = cls._conform(document, Mapping[str, Any])["run"]["fields"]["source"]["words"]
        return super().of_saved(document, machine and Actuated(machine, Actuator(**words.get("actuator", {}))))

    @property
    def _start(self) -> np.ndarray:
        """The launch with which the nominal motion begins, (1,) or (0,)."""
        return self.nominal.launches[: len(self.nominal.launches) - len(_liftoffs(self.nominal))]

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot both motions against time, and below the error of each launch speed; returns the axes of the
        motions. See `problems.steering.steering_figures.plot_disturbed`."""
        from .steering_figures import plot_disturbed

        return plot_disturbed(self, axes)


def _liftoffs(run: Simulation) -> list[float]:
    """The times of the lift-offs."""
    return [event.time for event in run.events if event.kind == "lift-off"]


def _launch_times(run: Simulation) -> np.ndarray:
    """The times (k,) of a simulation's `launches`, 0 for that of its start."""
    found = _liftoffs(run)
    return np.array([0.0] * (len(run.launches) - len(found)) + found)


def disturbed(
    driven: Any, hops: int, launch_error: float, state: ArrayLike | None,
    push: tuple[float, Mapping[str, float]] | None, values: Mapping[str, float],
) -> Disturbed:  # fmt: skip
    """The simulations of `Driven.simulate`, see there."""
    hops, error = whole_number("hops", hops, "lift-offs"), finite_number("launch_error", launch_error)
    schedule = driven.schedule_of(hops + 1)  # a disturbed motion may take longer
    launch = driven.launch
    if launch is None and error != 0:
        raise InputError("launch_error: this motion begins in contact; disturb its state instead")
    if state is not None and error != 0:
        raise InputError("state the disturbed start by either launch_error or state")
    machine = Actuated(driven.source.with_values(**values), driven.actuator)
    nominal: dict[str, Any] = {"state": driven(0.0)}
    start: dict[str, Any] = {"state": driven(0.0) if state is None else state}
    if launch is not None:
        bare = driven.dimensionless()
        like = bare.actuated.model.launch_at(bare.legs[0].path(0.0))
        nominal = {"alpha": launch_argument(driven.actuated, like, launch)}
        start = {"alpha": launch_argument(machine, like, launch + error)} if state is None else start
    undisturbed = simulate(driven.actuated, hops=hops, schedule=schedule, **nominal)
    run = (
        _pushed(machine, start, hops, schedule, push)
        if push
        else simulate(machine, hops=hops, schedule=schedule, **start)
    )
    return Disturbed(undisturbed, run)


def _pushed(
    machine: Actuated, start: Mapping[str, Any], hops: int, schedule: Inputs, push: tuple[float, Mapping[str, float]]
) -> Simulation:
    """A simulation whose flight state jumps at the time of the push."""
    names = machine.model.flight.states
    try:
        time, changes = finite_number("the time of the push", push[0]), dict(push[1])
    except (TypeError, ValueError, IndexError, KeyError):
        raise InputError(f"push = {push!r}; it must be a time, and changes of flight states by name") from None
    if unknown := [name for name in changes if name not in names]:
        raise InputError(f"push: the machine has no flight state '{unknown[0]}'; it has {', '.join(names)}")
    if time <= 0:
        raise InputError(f"push: time = {time:g}; it must lie after the start; state= disturbs the start itself")
    jump = np.array([finite_number(f"the push of {name}", changes.get(name, 0.0)) for name in names])
    for later in JUST_AFTER:
        first = simulate(machine, hops=hops, time=time * (1 + later), schedule=schedule, **start)
        left, now = hops - len(_liftoffs(first)), first.end
        if now < time or left == 0:
            raise InputError(f"push at {time:g}: the motion ends at {now:.6g}")
        rest = simulate(machine, state=first(now) + jump, hops=left, schedule=_later(schedule, now))
        if [leg.phase for leg in (*first.legs[-1:], *rest.legs[:1])] != ["flight", "contact"]:
            return _one_after_other(first, rest)
    raise InputError(f"push at {time:g}: it coincides with a landing; push a little earlier or later")


def _later(schedule: Inputs, time: float) -> Inputs:
    """A schedule with its clock started at this time; where it is over, its inputs are 0 from there on."""
    times, inputs = schedule
    if time >= times[-1]:
        return np.array([0.0, times[-1]]), {name: np.zeros(1) for name in inputs}
    now = int(np.searchsorted(times, time, side="right")) - 1
    return np.append(0.0, times[now + 1 :] - time), {name: values[now:] for name, values in inputs.items()}


def _one_after_other(first: Simulation, rest: Simulation) -> Simulation:
    """Two simulations as one, the second beginning when the first one ends."""
    legs = tuple(replace(leg, start=first.end + leg.start) for leg in rest.legs)
    events = tuple(replace(event, time=first.end + event.time) for event in rest.events)
    launches = np.concatenate([first.launches, rest.launches])
    legs, events, end = first.legs + legs, first.events + events, first.end + rest.end
    return replace(rest, legs=legs, events=events, launches=launches, end=end, schedule=first.schedule)
