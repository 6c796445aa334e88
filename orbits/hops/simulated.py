"""A simulated motion: its legs, flights and contacts, and the events between them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, as_array_or_nan
from ..flow import Trajectory, spring_forces, units_of_springs
from ..io import Document, fields_in_line
from ..model import CONTACT_FORCE, Affine, Knee, Machine, StateFormula, dimensionless, machine_in_words
from ..numerics import lowest
from ..periodic import relabelled_back
from ..result import TABLE_ROWS, Axes, Progress, Result, Row, known, shown
from ..units import ENERGY, FORCE, LENGTH, LIFTOFF_SPEED, SPEED, TIME, Units, in_units
from .hysteresis import Branches
from .sticking_contact import FALLS

# The dimensions of a simulation's numbers by name; those of states are lengths and speeds.
DIMENSIONS_OF_SIMULATIONS = {
    "launches": LIFTOFF_SPEED,
    "mean_speed": SPEED,
    **dict.fromkeys(("end", "time"), TIME),
    **dict.fromkeys(("smallest_separation", "distance", "footholds"), LENGTH),
    **dict.fromkeys(("energy", "loss"), ENERGY),
}


@dataclass(frozen=True)
class ContactEvent:
    """The event at the end of a leg.

    kind : "impact", after which the machine flies on; "landing", after which it stays in contact; "lift-off";
        "reversal" of a spring with hysteresis, whose loss is that of the energies between the events; or "lifts" and
        "slides", from which on the foot that stands in flight would have to pull, or needs more than the stated
        friction, and the simulation is of a foot that is held; or "slips", of a foot that sticks, and "falls", of a
        height of such a machine, or of a block that rocks, that reaches the ground, which end it
    time : time since the start; for a landing by infinitely many bounces, the time when they have ended
    before, after : flight states (n,)
    energy : energy before the event, relative to the machine at rest in contact with its spring unloaded; by the mean
        law of a spring with hysteresis
    loss : energy lost in the event, below 0 where an injection adds energy, and less by what gravity adds where a
        machine on a slope counts from the next foot
    foot : the name of the foot that touches or opens, "" where it has none; or "standing foot"; or of the height that
        falls
    """

    kind: str
    time: float
    before: np.ndarray
    after: np.ndarray
    energy: float
    loss: float
    foot: str = ""

    def __repr__(self) -> str:
        return fields_in_line(self, "kind", "time", "energy", "loss")


@dataclass(frozen=True)
class Leg:
    """A flight or a contact: its phase's name, when it starts, and its motion from there.

    branch : of a spring with hysteresis, as `Branches.branch` has it; None without such a spring
    stance : the number of steps so far, those back counted as -1
    foothold : the place along the ground from which that of what sticks is counted
    """

    phase: str
    start: float
    path: Trajectory
    branch: int | None = field(default=None, kw_only=True)
    stance: int = field(default=0, kw_only=True)
    foothold: float = field(default=0.0, kw_only=True)


@dataclass(frozen=True, repr=False)
class Simulation(Result, what="simulation", in_line=("status", "end", "source")):
    """A motion from a state; called with times (...), it gives flight states (..., n).

    legs, events : the motions of the phases, and the impacts, landings and lift-offs, in order
    status : "done", or why it ended early: a name of `orbits.hops.impacts.STATUSES`
    launches : launch speeds: first that of the start if it was a launch, then one for each lift-off; NaN for a lift-off
        that is not a launch
    end : time of the end
    source : the machine simulated
    reason : why the motion could not be followed further, in words; "" where it could
    schedule : of the parameters that changed in time, as `simulate` takes it; None if there were none
    """

    legs: tuple[Leg, ...]
    events: tuple[ContactEvent, ...]
    status: str
    launches: np.ndarray
    end: float
    source: Machine
    reason: str = ""
    schedule: tuple[np.ndarray, Mapping[str, np.ndarray]] | None = None

    @cached_property
    def smallest_separation(self) -> float | None:
        """The smallest separation of the masses, of a machine with two gaps also that of its image under the reversor;
        None without a rest length. Where it is not above 0 the masses pass through each other, which the simulation
        ignores although no real machine can do so."""
        model, smallest = self.source.model, []
        embed = model.embed
        if (separation := self._length(model.separation(self.source.values))) is None:
            return None
        for leg in self.legs:
            rows = leg.path.coefficients
            states = rows[:, : len(embed)] if leg.phase == "flight" else embed @ rows[:, : embed.shape[1]]
            smallest.append(lowest(separation.series(states), leg.path.steps)[0])
            if model.landing_gap and model.reversor:  # the same distance at the other foot
                images = model.reversal.rows(states, self.source.values)
                smallest.append(lowest(separation.series(images), leg.path.steps)[0])
        return min(smallest, default=None)

    @property
    def heights(self) -> dict[str, Affine | StateFormula]:
        """The heights of the machine's model, as functions of the flight state."""
        return {name: self._length(height) for name, height in self.source.model.heights(self.source.values).items()}

    @property
    def springs(self) -> tuple[tuple[str | None, str], ...]:
        """Names of the heights, lower and upper, that each spring joins; None for the ground."""
        return self.source.model.springs

    @property
    def knees(self) -> tuple[Knee, ...]:
        """The knees of the machine's model, as its `heights`."""
        model, unit = self.source.model, self.source.units.length if self.source.units else 1.0
        found = model.knees(self.source.values) if model.knees else ()
        return tuple((lower, upper, length * unit) for lower, upper, length in found)

    @property
    def gap(self) -> Affine | StateFormula:
        """The gap as a function of the flight state."""
        return self._length(self.source.model.height_of(self.source.values))

    def _length(self, height: object) -> Any:
        """A length of the model as a function of the flight state: in SI where the machine is stated so."""
        units, states = self.source.units, self.source.model.flight.states
        return units.convert_height(height, states) if units else height

    @property
    def impacts(self) -> int:
        """The number of impacts, landings included."""
        return sum(event.kind in ("impact", "landing") for event in self.events)

    machine = property(lambda self: machine_in_words(self.source))

    @cached_property
    def units(self) -> dict[str, str]:
        """The units of the states and of the numbers of events by name; empty for a dimensionless machine."""
        if (units := self.source.units) is None:
            return {}
        forces = {CONTACT_FORCE: units.text(FORCE), **units_of_springs(self.source)}
        states = {name: units.text(name) for name in self._states}
        return {**states, **forces, **units.texts(DIMENSIONS_OF_SIMULATIONS)}

    @property
    def _states(self) -> tuple[str, ...]:
        return self.source.model.flight.states

    def document(self) -> Document:
        units = self.source.units and self.source.units.texts(DIMENSIONS_OF_SIMULATIONS)
        return {
            **({"units": units} if units else {}), "launches": known(self.launches),
            "status": self.status, "reason": self.reason, "end": self.end,
            "smallest_separation": self.smallest_separation, **self._way_in_numbers,
            "events": [{**vars(e), "before": e.before.tolist(), "after": e.after.tolist()} for e in self.events],
        }  # fmt: skip

    def table(self, t: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """Columns (k,) by name at times (k,), evenly spaced by default: "time", "phase", the flight states, the
        `spring_forces` and the "contact force"."""
        t = self._times(np.linspace(0.0, self.end, TABLE_ROWS) if t is None else t).ravel()
        columns = {"time": t, "phase": np.where(self.in_contact(t), "contact", "flight")}
        return columns | dict(zip(self._states, self(t).T, strict=True)) | self.forces(t)

    def title(self) -> str:
        return f"motion of {self.source!r}"

    def heads(self) -> list[str]:
        return ["event", *map(self.heading, ("time", "energy", "loss"))]

    def _rows(self) -> Iterator[Row]:
        """The events, with their times, energies and losses."""
        for i, each in enumerate(self.events):
            values = {f"{name} of event {i}": getattr(each, name) for name in ("time", "energy", "loss")}
            yield Row(each.kind, values, ("{:.9g}", "{:.9g}", "{:.6g}"))

    def summary(self) -> dict[str, Any]:
        """The status, the launch speeds, and the numbers of the events."""
        ended = {"status": self.status, "reason": self.reason, "end": self.end}
        launches = {f"launch {i}": speed for i, speed in enumerate(known(self.launches))}
        own = {"smallest_separation": self.smallest_separation, **self._way_in_numbers}
        return {**ended, **own, **launches, **super().summary()}

    def _notes(self) -> list[str]:
        """The notes on the whole motion."""
        speed, second, metre = (f" {self.unit_of(n)}".rstrip() for n in ("launches", "end", "smallest_separation"))
        why = f": {self.reason}" if self.reason else ""
        speeds = ", ".join("none" if alpha is None else f"{alpha:.10g}" for alpha in known(self.launches))
        notes = [
            f"launch speeds {speeds}{speed}",
            *self._way_in_words(),
            f"{self.status} at time {self.end:.9g}{second}{why}",
        ]
        if (least := self.smallest_separation) is not None and least <= 0:
            what = self.source.model.violations["separation"]
            notes.append(f"{what}: the smallest separation is {least:.6g}{metre}")
        return notes

    @property
    def _way_in_numbers(self) -> dict[str, float | None]:
        """The distance and the mean speed of a machine that sticks."""
        return {"distance": self.distance, "mean_speed": self.mean_speed} if self.source.model.sticks else {}

    def _way_in_words(self) -> list[str]:
        if self.distance is None or self.mean_speed is None:
            return []
        metre, speed = (f" {self.unit_of(name)}".rstrip() for name in ("distance", "mean_speed"))
        steps = len(self.footholds) - 1
        return [
            f"{steps} steps, {self.distance:.10g}{metre} along the ground at the mean speed "
            f"{self.mean_speed:.10g}{speed}"
        ]

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot heights against time; returns the axes. See `orbits.show.plot.plot_simulation`."""
        return shown("plot").plot_simulation(self, axes)

    def animate(self, path: str | Path, frames: int = 200, *, progress: Progress = None) -> Path:
        """Write an animation of the whole motion (.gif or .mp4); returns its path. See `animate_simulation`."""
        return shown("animation").animate_simulation(self, path, frames, progress)

    def export(self, folder: str | Path, t: ArrayLike | None = None) -> Path:
        """Write the motion at times `t`, by default over its whole duration, to a folder for robot simulators; returns
        its path. See `Orbit.export`."""
        return shown("simulators").export_simulation(self, folder, t)

    def _times(self, t: ArrayLike) -> np.ndarray:
        """Times (...) that lie in the motion; raises `InputError` for any others."""
        return times_within(t, self.end, self._second)

    def in_contact(self, t: ArrayLike) -> np.ndarray:
        """Whether the machine is in contact at times (...)."""
        index = index_of_legs(self.legs, self._times(t))
        return np.array([leg.phase == "contact" for leg in self.legs])[index]

    def spring_forces(self, t: ArrayLike) -> dict[str, np.ndarray]:
        """The force (...) of each spring at times (...), tension positive, by name, as in `Orbit.spring_forces`."""
        if self.source.model.hysteretic:
            return self._forces_on_branches(t)
        return spring_forces(self.source, self(t), self._changes(self._times(t)))

    def _forces_on_branches(self, t: ArrayLike) -> dict[str, np.ndarray]:
        """The `spring_forces` where a spring has hysteresis: those of the branch of each leg."""
        model, units = self.source.model, self.source.units
        dimensions = [model.spring_dimensions.get(name, FORCE) for name in model.spring_forces]
        sizes = np.array([1.0 if units is None else units.of(each) for each in dimensions])
        bare = 1.0 if units is None else units.of_states(model.flight.states)
        branches = Branches(dimensionless(self.source))

        def forces(leg: Leg, since: np.ndarray) -> np.ndarray:
            first, contact = self._flight_states(leg, np.zeros(1))[0] / bare, leg.phase == "contact"
            impacts = branches.on(leg.branch or 0, branches.of[1].onto_contact @ first if contact else first, contact)
            found = spring_forces(impacts.machine, self._flight_states(leg, since) / bare)
            return np.stack([*found.values()], axis=-1) * sizes

        found = rows_of_legs(self.legs, self.end, t, forces, self._second)
        return {name: found[..., i] for i, name in enumerate(model.spring_forces)}

    def _changes(self, t: np.ndarray) -> dict[str, np.ndarray]:
        """The values (...) of the scheduled parameters at times (...): outside of the schedule those of the machine."""
        if self.schedule is None or not len(self.schedule[0]):
            return {}
        times, inputs = self.schedule
        units = self.source.units and cast(Any, self.source).scheduled
        place = np.searchsorted(times, t, side="right")
        own = {name: self.source.values[name] * (units[name] if units else 1.0) for name in inputs}
        return {name: np.concatenate([[own[name]], x, [own[name]]])[place] for name, x in inputs.items()}

    def contact_force(self, t: ArrayLike) -> np.ndarray:
        """The contact force (...) at times (...), positive where it presses; 0 in flight."""

        def force(leg: Leg, since: np.ndarray) -> np.ndarray:
            names = leg.path.names
            return (
                leg.path(since)[:, [names.index(CONTACT_FORCE)]]
                if leg.phase == "contact"
                else np.zeros((len(since), 1))
            )

        return rows_of_legs(self.legs, self.end, t, force, self._second)[..., 0]

    def forces(self, t: ArrayLike) -> dict[str, np.ndarray]:
        """The `spring_forces` and the "contact force" (...) at times (...), by name."""
        return {**self.spring_forces(t), CONTACT_FORCE: self.contact_force(t)}

    @property
    def _second(self) -> str:
        """The unit of time after a number."""
        return " s" if getattr(self.source, "units", None) else ""

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Flight states (..., n) at times (...)."""
        return rows_of_legs(self.legs, self.end, t, self._flight_states, self._second)

    def unrolled(self, t: ArrayLike) -> np.ndarray:
        """Flight states (..., n) at times (...) in the labels of the first flight: for a machine that steps, places
        continue from step to step, while the states of a call jump at a landing."""
        states, units, label = self(t), self.source.units, self.source.model.relabelling
        stances = np.array([leg.stance for leg in self.legs])[index_of_legs(self.legs, self._times(t))]
        shifts = np.array(label.shifts(self.source.values)) * (units.of_states(self._states) if units else 1.0)
        own = [self._states.index(name) for name in self.source.model.sticks if self.source.model.runs]
        shifts[own] = 0.0  # its steps are those of the motion
        found = relabelled_back(states, stances, label.signs, shifts)
        found[..., own] += self.footholds_at(t)[..., None]
        return found

    def footholds_at(self, t: ArrayLike) -> np.ndarray:
        """The places (...) from which those of what sticks are counted at times (...)."""
        return np.array([leg.foothold for leg in self.legs])[index_of_legs(self.legs, self._times(t))]

    @property
    def footholds(self) -> np.ndarray:
        """The places (k,) along the ground at which a foot that sticks stood, in order; empty for other machines."""
        if not self.source.model.sticks:
            return np.zeros(0)
        stands = cast(Any, self.source.model.planar).stands  # on another point in flight
        first = [self.legs[0].foothold] * (len(self.launches) > sum(e.kind == "lift-off" for e in self.events))
        found = [*first, *(leg.foothold for leg in self.legs if stands or leg.phase == "contact")]
        return np.array([place for i, place in enumerate(found) if i == 0 or place != found[i - 1]])

    @property
    def distance(self) -> float | None:
        """The distance along the ground that a foot that sticks moved from the start to the end, or, of a machine that
        stands on two, the centre of mass; None for other machines."""
        model, units, ends = self.source.model, self.source.units, np.array([0.0, self.end])
        if not model.sticks or not self.legs:
            return None
        if model.runs:
            places = self.unrolled(ends)[:, self._states.index(model.sticks[0])]
        else:
            across, p = cast(Any, model.planar).across, dimensionless(self.source).values
            states = self(ends) / (units.of_states(self._states) if units else 1.0)
            places = self.footholds_at(ends) + [across(x.tolist(), p) * (units.length if units else 1) for x in states]
        return float(np.diff(places)[0])

    @property
    def falls(self) -> tuple[str, float] | None:
        """The name of a height that reaches the ground, and when; None if none does. It is a height other than the gap,
        of a machine that sticks or a rocking block. The simulation ends there."""
        return next(((event.foot, event.time) for event in self.events if event.kind == FALLS), None)

    @property
    def mean_speed(self) -> float | None:
        """The distance over the time; None for machines that do not stick."""
        return None if self.distance is None or not self.end else self.distance / self.end

    def _flight_states(self, leg: Leg, since: np.ndarray) -> np.ndarray:
        """Flight states (k, n) at times (k,) since the start of a leg."""
        rows, embed = leg.path(since), self.source.model.embed
        return rows[..., : len(embed)] if leg.phase == "flight" else rows[..., : embed.shape[1]] @ embed.T


def index_of_legs(legs: Sequence[Leg], t: np.ndarray) -> np.ndarray:
    """The indices (...) of the legs of a motion at times (...); where two meet, that of the later one."""
    return np.clip(np.searchsorted([leg.start for leg in legs], t, side="right") - 1, 0, None)


def times_within(t: ArrayLike, end: float, second: str = "") -> np.ndarray:
    """Times (...) that lie between 0 and the end of a motion; raises `InputError` for any others.

    second : the unit of time in the message
    """
    times = as_array_or_nan(t)
    if not ((times >= 0) & (times <= end * (1 + 1e-12))).all():
        raise InputError(f"times lie between 0 and {end:.6g}{second}")
    return times


def rows_of_legs(
    legs: Sequence[Leg], end: float, t: ArrayLike, rows: Callable[[Any, np.ndarray], np.ndarray], second: str = ""
) -> np.ndarray:
    """Rows (..., n) of a motion in legs at times (...), which lie between 0 and its end.

    rows : (a leg, times (k,) since its start) -> rows (k, n)

    Raises as `times_within` does.
    """
    t = times_within(t, end, second)
    flat = t.ravel()
    index, found = index_of_legs(legs, flat), rows(legs[0], flat[:0])
    found = np.empty((len(flat), found.shape[1]))
    for i in {*index.tolist()}:
        leg, inside = legs[i], index == i
        found[inside] = rows(leg, np.minimum(flat[inside] - leg.start, leg.path.times[-1]))
    return found.reshape(*t.shape, found.shape[1])


def run_in_units(run: Simulation, machine: Any) -> Simulation:
    """A dimensionless simulation in the units of the machine."""
    units: Units = machine.units
    size = units.of_states(machine.model.flight.states)
    time, length = units.time, units.length
    legs = tuple(
        replace(leg, start=leg.start * time, path=units.convert_motion(leg.path), foothold=leg.foothold * length)
        for leg in run.legs
    )
    energies = {"time": TIME, "energy": ENERGY, "loss": ENERGY}
    states = [{"before": event.before * size, "after": event.after * size} for event in run.events]
    pairs = zip(run.events, states, strict=True)
    events = tuple(replace(units.convert(event, **energies), **changed) for event, changed in pairs)
    launches, end = run.launches * units.of(LIFTOFF_SPEED), run.end * units.time
    reason = in_units(run.reason, units)
    times, inputs = run.schedule or (None, {})
    schedule = None if times is None else (times * units.time, {n: x * machine.scheduled[n] for n, x in inputs.items()})
    own = {"legs": legs, "events": events, "launches": launches, "end": end, "reason": reason, "schedule": schedule}
    return replace(run, source=machine, **own)
