"""Oscillations found and followed along their energy, in the units of a machine."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..curves import End, Event, Points, Run, Steps, started
from ..errors import InputError, NoOrbit, finite_number
from ..flow import Trajectory
from ..model import Machine, machine_in_words
from ..records import NONE
from ..result import Progress
from ..running import TimeOver, interrupts
from ..symbolic import suggest
from ..units import ENERGY, FREQUENCY, TIME, Message, Quantity, in_units, without_units
from .oscillation_curve import (
    APART,
    DRIFT,
    ERROR,
    MARGIN,
    MULTIPLIERS,
    RESIDUAL,
    OscillationCurve,
    near_motion,
    near_rest,
)
from .oscillations import MARGINS, Oscillation, OscillationEvent, OscillationFamily
from .oscillator import DURATION, Oscillator, is_elastic, refuse_oscillator

# The quantities of oscillations that are not states, with their dimensions.
DIMENSIONS_OF_OSCILLATIONS = {
    **{"energy": ENERGY, "frequency": FREQUENCY},
    **dict.fromkeys(("period", "error", "time", DURATION), TIME),
}


def follow_energy(
    machine: Machine, stop: float | tuple[float, float],
    start: Oscillation | float | Mapping[str, float] | None = None, family: int = 1,
    at: Sequence[float] = (), steps: Steps | None = None, progress: Progress = None,
) -> OscillationFamily:  # fmt: skip
    """The family of oscillations that leads from a normal mode of this number, or from a motion, along its energy.

    stop : the last energy, or the first and the last one; the family goes past folds, and ends where it comes back to
        the first one
    start : the first energy, for the first of the range; an oscillation, or states and "duration" of a motion by name,
        at any energy, which is counted from the minimum of the potential energy below its places; or places near the
        equilibrium, for another one than that near the rest of the machine
    family : the number of the normal mode, by rising frequency
    at : energies to hit exactly
    steps : along the curve
    """
    return _Followed(machine, start).family(stop, family, at, steps or Steps(apart=np.inf), progress)


def find_oscillation(
    machine: Machine, energy: float, start: Oscillation | Mapping[str, float] | None = None, family: int = 1
) -> Oscillation:
    """The oscillation of an energy in the family of a normal mode or through a motion, as by `follow_energy`."""
    return _Followed(machine, start).oscillation(energy, family)


class _Followed:
    """A machine whose oscillations are found, in its units, from a `start` of `follow_energy`."""

    def __init__(self, machine: Machine, start: Oscillation | float | Mapping[str, float] | None):
        refuse_oscillator(machine)
        start = start.start if isinstance(start, Oscillation) else start
        self.machine, self.units, self.bounces = machine, machine.units, is_elastic(machine)
        self.states = (machine.model.flight if self.bounces else machine.model.contact).states
        if self.units and self.units.energy is None:
            raise InputError(f"the unit of energy of a {machine.model.name} is not known")
        self.first = None if isinstance(start, Mapping) else start
        self.near = {} if not isinstance(start, Mapping) else self._checked(start)

    def _checked(self, start: Mapping[str, float]) -> dict[str, float]:
        """A start without units."""
        known, found = (*self.states, DURATION), dict[str, float]()
        for name, value in start.items():
            if name not in known:
                raise InputError(f"start has no '{name}'{suggest(str(name), known)}")
            found[name] = finite_number(f"start '{name}'", value) / self._unit(TIME if name == DURATION else name)
        if not found.get(DURATION, 1.0) > 0:
            raise InputError(f"start 'duration' = {start[DURATION]:g}; it must be above 0, about a period")
        if DURATION not in found and (moving := [name for name in found if name.endswith("'")]):
            raise InputError(f"start has the speed {moving[0]} and no 'duration': state both for a motion")
        return found

    def _unit(self, dimension: Any) -> float:
        return float(self.units.of(dimension)) if self.units else 1.0

    def _texts(self) -> dict[str, str]:
        """The units of the quantities by name."""
        if self.units is None:
            return {}
        own: dict[str, Any] = {name: name for name in self.states}
        texts = {name: self.units.text(dimension) for name, dimension in (DIMENSIONS_OF_OSCILLATIONS | own).items()}
        return {name: text for name, text in self.units.texts().items() if name in MARGINS} | texts

    def _energy(self, name: str, value: object) -> float:
        """An energy without units; raises `InputError` for one that is not above 0."""
        if not (found := finite_number(name, value)) > 0:
            raise InputError(f"{name} = {found:g}: an energy is above that at the equilibrium, 0")
        return found / self._unit(ENERGY)

    def _point(self, family: int, energy: float, way: float = 1.0) -> tuple[OscillationCurve, Points]:
        """The curve of a family and its point (1) at an energy, to which it is followed from its first one, and from
        which it goes on to larger energies, or for a `way` below 0 to smaller ones; raises `NoOrbit` where it does not
        come there."""
        oscillator = Oscillator(self.machine, self.near, below=DURATION in self.near)
        curve = near_motion(oscillator, self.near) if DURATION in self.near else near_rest(oscillator, family, energy)
        first = float(curve.first[-1])
        steps = Steps(apart=np.inf)
        point = started(curve, curve.first[None], steps, np.sign(energy - first) or way)
        if not len(point):
            raise NoOrbit("the first oscillation of the family cannot be certified")
        if energy != first:
            run = Run(curve, point, energy, options=steps)
            end = next(item for item in run if isinstance(item, End))
            point = run.passed(0)[-1][-1:]
            if point.values[0] != energy:
                text = "the family does not come to the energy {energy:.6g}: {kind}, {reason}"
                energy_there = Quantity(energy, ENERGY)
                raise NoOrbit(Message(text, energy=energy_there, kind=end.kind, reason=end.reason))
            point = started(curve, point.xs, steps, way)
        return curve, point

    def oscillation(self, energy: float, family: int) -> Oscillation:
        """The oscillation of an energy."""
        wanted, unit = self._energy("energy", energy), self._unit
        with without_units(self.units), interrupts.deferred():
            _, point = self._point(family, wanted)
        x, own, motion = point.xs[0], point.own[0], point.evaluation[point.places].trajectories[1]
        path = motion.only(self.states)[0]
        path = Trajectory(path.times, path.coefficients, path.names)
        return Oscillation(
            machine_in_words(self.machine), float(x[-1] * unit(ENERGY)), float(x[-3] * unit(TIME)),
            float(own[ERROR] * unit(TIME)), float(own[DRIFT]), float(own[RESIDUAL]), float(x[-2]),
            self.units.convert_motion(path) if self.units else path, _multipliers(point.own)[0],
            **{name: float(each[0]) for name, each in self._margins(point.own).items()},
            bounces=self.bounces, units=self._texts(),
        )  # fmt: skip

    def _margins(self, own: np.ndarray) -> dict[str, np.ndarray]:
        """What may not become negative (m,), by name, where there is something."""
        columns = {"clearance" if self.bounces else "smallest_contact_force": MARGIN, "smallest_separation": APART}
        known = {name: np.where(own[:, i] == NONE, np.nan, own[:, i]) * self._unit(name) for name, i in columns.items()}
        return {name: margins for name, margins in known.items() if np.isfinite(margins).any()}

    def family(
        self, stop: Any, number: int, at: Sequence[float], steps: Steps, progress: Progress
    ) -> OscillationFamily:
        """The family between two energies."""
        begin, last = self._range(stop)
        requested = [self._energy("at", each) for each in at]
        if outside := [each for each in requested if not min(begin, last) <= each <= max(begin, last)]:
            value = at[requested.index(outside[0])]
            raise InputError(f"at = {value:g} is not reached: it must lie between the first and the last energy")
        with without_units(self.units), interrupts.deferred():
            curve, point = self._point(number, begin, 1.0 if last > begin else -1.0)
            run = Run(curve, point, last, behind=begin, at=requested, options=steps)
            points, events, end = collected(run, begin, last, progress)
        unit, n, own = self._unit, len(self.states), np.concatenate([each.own for each in points])
        sizes = np.array([*map(unit, self.states), unit(TIME), 1.0, unit(ENERGY)])
        xs = np.concatenate([each.xs for each in points]) * sizes
        if end.kind == "reached":
            end = End("reached", f"{xs[-1, -1]:g} {self._texts().get('energy', '')}".rstrip())
        return OscillationFamily(
            machine_in_words(self.machine), None if DURATION in self.near else number, self.states, xs[:, :n],
            xs[:, -1], xs[:, -3], own[:, ERROR] * unit(TIME), own[:, DRIFT],
            tuple(OscillationEvent.of(event.kind, event.after, event.point.xs[0] * sizes) for event in events),
            End(end.kind, str(in_units(end.reason, self.units))), _multipliers(own), self._margins(own), self.bounces,
            self._texts(),
        )  # fmt: skip

    def _range(self, stop: Any) -> tuple[float, float]:
        """The bounds of the energy."""
        ends = stop if isinstance(stop, tuple | list) and len(stop) == 2 else (self.first, stop)
        if (ends is stop) == (self.first is not None):
            wanted = "state the first and the last energy once (on the command line --from and --to)"
            raise InputError(f"stop = {stop!r}, start = {self.first!r}: {wanted}")
        begin, last = (self._energy("stop", each) for each in ends)
        if begin == last:
            raise InputError(f"the energy goes from {ends[0]:g} to {ends[1]:g}: there is no way between")
        return begin, last


def collected(run: Run, begin: float, last: float, progress: Progress) -> tuple[list[Points], list[Event], End]:
    """The points, the events and the end of a run between two values of its parameter."""
    points, events, end = list[Points](), list[Event](), End("stopped")
    try:
        for item in run:
            if isinstance(item, End):
                end = item
            elif isinstance(item, Event):
                events.append(item)
            else:
                points.append(item)
                if progress:
                    progress(min(max(float(item.values[-1] - begin) / (last - begin), 0.0), 1.0))
    except TimeOver as over:
        end = End("interrupted", str(over))
    return points, events, end


def _multipliers(own: np.ndarray) -> np.ndarray:
    """The real and the imaginary parts (m, 2n - 2, 2) of the multipliers."""
    return np.stack(np.split(own[:, MULTIPLIERS:], 2, axis=1), axis=2)
