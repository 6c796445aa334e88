"""Motions of an actuated machine that optimal control has found, with the machine: drawn, saved and disturbed."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NotRequired, TypedDict, cast

import numpy as np
from numpy.typing import ArrayLike

from orbits import Control, InputError, Simulation, simulate
from orbits.control import ControlledLeg, HeldLimits, Hold
from orbits.errors import whole_number
from orbits.flow import is_motion_of, units_of_springs
from orbits.hops import times_within
from orbits.io import Document, conform
from orbits.model import CONTACT_FORCE, Affine, Machine, machine_in_words
from orbits.result import Axes, Progress, Row, is_of
from orbits.show import SPRING_END, animate_simulation
from orbits.units import ENERGY, LIFTOFF_SPEED, unit_text

from ..machines import TwoMasses, machine_stated, statement_for_file
from .actuated import Actuated, Actuator
from .actuator_bounds import POWER
from .disturbed import Disturbed, disturbed

if TYPE_CHECKING:
    from .driven_family import DrivenFamily

OF_OTHER_EQUATIONS = "its motion does not satisfy the equations of this machine, as after a change of a table"
# Gauss points of a control interval at which the actuator's power is taken; a peak between two of as many samples is
# higher than both by less than this share, and is found to that share of the time between them, whose square is left.
POWER_SAMPLES, BETWEEN_SAMPLES, SAME_PEAK = 40, 0.1, 1e-8
# And those between two rows of a table, which are near each other.
PART_SAMPLES = 8
PERIODIC = 1e-6  # states that differ by less, relative to their size, are the same: the tolerance of a solve is finer


@dataclass(frozen=True, repr=False)
class Driven(Control, what="motion of a driven machine"):
    """A `Control` of a machine with an actuator, from `problems.steering`.

    Called with times (...) it returns flight states (..., n), as `Simulation` and `Orbit` do; the last one is the
    displacement of a spring's end, or the force.

    source : the machine without its actuator; in SI the numbers are in SI
    actuator : the `Actuator`
    """

    source: Machine = field(kw_only=True)
    actuator: Actuator = field(default=Actuator(), kw_only=True)

    machine = property(lambda self: machine_in_words(self.source))

    @classmethod
    def of(cls, machine: Any, control: Control, actuator: Actuator | None = None) -> "Driven":
        """A control of a machine, with the machine and its actuator."""
        own = {each.name: getattr(control, each.name) for each in fields(Control)}
        actuator = Actuated(machine, actuator or Actuator()).actuator
        own["bare"] = control.bare and cls.of(machine.dimensionless(), control.bare, actuator)
        driven = cls(**own, source=machine, actuator=actuator)
        texts = dict.fromkeys(("work", "positive work"), "J") | {"power": "W", CONTACT_FORCE: "N"}
        texts |= units_of_springs(driven.actuated)
        texts["actuator force"] = unit_text(driven.actuated.dimensions["actuator force"])
        return replace(driven, units={**control.units, **texts}) if control.units else driven

    @cached_property
    def actuated(self) -> Actuated:
        """The machine with its actuator, as `simulate` takes it."""
        return Actuated(self.source, self.actuator)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the flight states, which a call returns."""
        return self.actuated.model.flight.states

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Flight states (..., n) at times (...), from 0 to `end`; raises `InputError` for others."""
        return self.motion(t)

    @cached_property
    def motion(self) -> Simulation:
        """The motion as a `Simulation`, which has heights, separation and contact; it has no events."""
        launches = np.array([] if self.launch is None else [self.launch])
        return DrivenMotion(self.legs, (), "done", launches, self.end, self.actuated)

    @property
    def launch(self) -> float | None:
        """The launch speed with which the motion begins; None for one that begins in contact."""
        if self.legs[0].phase != "flight":
            return None
        bare = self.dimensionless()
        model, x = bare.actuated.model, bare.legs[0].path(0.0)
        unit = 1.0 if self.source.units is None else self.source.units.of(LIFTOFF_SPEED)
        return model.launch_at(x)["alpha"] * unit

    @property
    def periodic(self) -> bool:
        """Whether the motion ends in the state in which it begins, so that its inputs may be repeated."""
        bare = self.dimensionless()
        first, last = bare(0.0), bare(bare.end)
        return bool(np.abs(last - first).max() <= PERIODIC * (1 + np.abs(first).max()))

    def schedule_of(self, hops: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The inputs of `hops` hops as `simulate` takes them: those of a periodic motion repeated, any others once."""
        times, inputs = self.schedule(self.actuator.rate)
        count = hops if self.periodic else 1
        starts = self.end * np.arange(count)
        repeated = np.append((starts[:, None] + times[:-1]).ravel(), count * self.end)
        return repeated, {name: np.tile(values, count) for name, values in inputs.items()}

    def simulate(
        self, hops: int = 1, *, launch_error: float = 0.0, state: ArrayLike | None = None,
        push: tuple[float, Mapping[str, float]] | None = None, **values: float,
    ) -> Disturbed:  # fmt: skip
        """Simulate the machine open loop with these inputs, from a disturbed start or with other parameters, and again
        without the disturbance.

        hops : number of lift-offs after which the simulation ends. The inputs of a periodic motion are repeated; after
            those of any other the actuator stays at rest
        launch_error : added to the launch speed, for a motion that begins with a lift-off
        state : (n,), a flight state to start from instead, as in `simulate`
        push : (time, changes of flight states by name), as (3.0, {"y1'": 0.1}): an impulse at that time
        values : of parameters of the machine, as damping=0.011; a launch is then one of that machine, at the same speed

        Raises `InputError` for an invalid disturbance.
        """
        return disturbed(self, hops, launch_error, state, push, values)

    def followed_by(self, hop: "Driven", hops: int = 1) -> Simulation:
        """Simulate this motion and then hops of another one, open loop: a start, say, and the hop at which it aims.

        hop : the result of `keep_hopping` for the same machine and actuator
        hops : number of its hops
        """
        if self.actuated.describe() != hop.actuated.describe() or not is_driven_motion_of(hop, self.actuated):
            raise InputError("what follows is a motion of another machine or actuator")
        (own, first), (later, then) = self.schedule_of(1), hop.schedule_of(whole_number("hops", hops, "hops"))
        schedule = np.append(own, own[-1] + later[1:]), {n: np.append(first[n], then[n]) for n in first}
        liftoffs = hops + sum(leg.phase == "contact" for leg in self.legs[-1:])
        return simulate(self.actuated, state=self(0.0), hops=liftoffs, schedule=schedule)

    def follow(self, name: str, to: float, **options: Any) -> "DrivenFamily":
        """Follow a motion of least cost in a number of its machine, as "damping", or of its launch: the "speed" or
        "height" that is prescribed, or what it is "short" of; the result is a `DrivenFamily`. See
        `problems.steering.driven_family.follow_driven`, which takes the options.

        >>> from problems import Hopper, steering
        >>> family = steering.keep_hopping(Hopper()).follow("damping", 0.02, at=[0.01])  # from the lossless orbit
        >>> round(family.at(0.01).cost / 0.01**2, 4)
        125.7925
        """
        from .driven_family import follow_driven

        return follow_driven(self, name, to, **options)

    def hold(
        self, *, when: str = "continuous", parts: int = 3, effort: float = 0.05, landing: float | None = None,
        delay: float = 0.0, rate: float = np.inf, stroke: float = np.inf, force: float = np.inf, power: float = np.inf,
        speed_force: tuple[float, float] | None = None,
    ) -> Hold:  # fmt: skip
        """A feedback that holds this hop, a result of `keep_hopping`, by changes of the rate of the actuator's state.

        when, parts, effort, landing, delay : as in `orbits.control.hold`; the effort is of the rate
        rate, stroke : bounds of the rate of the actuator's state, and of a displacement
        force, power, speed_force : as in `orbits.control.hold`; the force in a spring whose end moves is that of the
            hop, and only its power is limited

        >>> from problems import Hopper, steering
        >>> held = steering.keep_hopping(Hopper(damping=0.01), intervals=20).hold(rate=0.5, stroke=0.5)
        >>> bool(abs(held.held_multipliers[0]) < abs(held.multipliers[0]))
        True
        """
        from .feedback import held_hop

        limits = HeldLimits(rate, stroke, force, power, speed_force)
        return held_hop(self, when=when, parts=parts, effort=effort, landing=landing, delay=delay, limits=limits)

    def power(self, t: ArrayLike) -> np.ndarray:
        """The actuator's power (...) on the machine at times (...); raises as a call does."""
        return self._effects(t)[1]

    def force(self, t: ArrayLike) -> np.ndarray:
        """The actuator's force (...) on the machine at times (...), above 0 where it pushes; raises as a call does."""
        return self._effects(t)[0]

    def _effects(self, t: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """The actuator's force and its power at times (...)."""
        t = times_within(t, self.end, self._second)
        units, bare = self.actuated.units, self.dimensionless()
        since = t if units is None else np.minimum(t / units.time, bare.end)
        states, rates = bare(since), bare.inputs_at(since)[..., 0]
        found = bare.actuated.effects(states.reshape(-1, states.shape[-1]), rates.ravel())
        force, power = (size * each.reshape(t.shape) for size, each in zip(self._units_of_effects, found, strict=True))
        return force, power

    @property
    def _units_of_effects(self) -> tuple[float, float]:
        """The units of the actuator's force and of its power."""
        if (units := self.actuated.units) is None:
            return 1.0, 1.0
        return units.of(self.actuated.dimensions["actuator force"]), units.of(POWER)

    @cached_property
    def work(self) -> tuple[float, float]:
        """The actuator's work on the machine, in the unit of its energy: the total, and the positive part only."""
        done, positive = work_done(self.actuated.dimensionless(), self.dimensionless())
        unit = self._unit_of_energy
        return done * unit, positive * unit

    @property
    def _unit_of_energy(self) -> float:
        return 1.0 if self.actuated.units is None else self.actuated.units.of(ENERGY)

    @cached_property
    def largest(self) -> tuple[float, float]:
        """The largest size of the actuator's force and of its power, which may jump between two control intervals."""
        force, power = largest_effects(self.actuated.dimensionless(), self.dimensionless())
        of_force, of_power = self._units_of_effects
        return force * of_force, power * of_power

    def table(self, t: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """The columns of `Control.table`, with flight states, the actuator's "power" and "actuator force", its "work"
        and its "positive work" so far, and the forces of springs and contact."""
        columns = super().table(t)
        force, power = self._effects(columns["time"])
        units = self.actuated.units
        since = columns["time"] if units is None else columns["time"] / units.time
        done, positive = self._unit_of_energy * work_until(self.actuated.dimensionless(), self.dimensionless(), since)
        columns |= {"power": power, "actuator force": force, "work": done, "positive work": positive}
        return columns | self.motion.forces(columns["time"])

    def _rows(self) -> Iterator[Row]:
        """The rows of `Control`, with the work, the largest force and the largest power of the actuator."""
        *rows, last = super()._rows()
        yield from rows
        joule, newton, watt = (
            f" {unit}" if (unit := self.unit_of(n)) else "" for n in ("work", "actuator force", "power")
        )
        done = dict(zip(("work", "positive work"), self.work, strict=True))
        heading = "work per hop" if self.periodic else "work"
        yield Row(heading, done, (f"{{:.10g}}{joule}, its positive part {{:.10g}}{joule}",))
        most = dict(zip(("largest force", "largest power"), self.largest, strict=True))
        yield Row("actuator", most, (f"force up to {{:.6g}}{newton}, power up to {{:.6g}}{watt}",))
        yield last

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot heights against time, contact shaded, and below the spring's end and its rate; returns the axes of the
        heights. See `problems.steering.steering_figures.plot_driven`."""
        from .steering_figures import plot_driven

        return plot_driven(self, axes)

    def animate(self, path: str | Path, frames: int = 200, *, progress: Progress = None) -> Path:
        """Write an animation (.gif or .mp4), for a machine with a rest length also of the spring's end; returns its
        path. See `orbits.show.animation.animate_simulation`."""
        motion, plain = self.motion, isinstance(self.source, TwoMasses) and not self.actuator.is_force
        if plain and self.source.rest_length is not None:
            motion = WithMovedEnd(**{each.name: getattr(motion, each.name) for each in fields(motion)})
        return animate_simulation(motion, path, frames, progress)

    def document(self) -> Document:
        """The motion as JSON-ready data, with the machine in words and, where a file can state it, its statement."""
        statement = statement_for_file(cast(Any, self.source)) if isinstance(self.source, TwoMasses) else None
        own = {} if "actuator" not in self.actuated.describe() else {"actuator": asdict(self.actuator)}
        return {**super().document(), "machine": self.machine, "statement": statement, **own}

    @classmethod
    def of_saved(cls, document: object, machine: Machine | None = None) -> "Driven":
        """The motion of a document by `saved`, of the machine that it states or of this one; raises `ValueError` where
        parts of it do not fit each other."""
        data, control = conform(document, _SavedDriven), Control.of_saved(document)
        if machine is None and data["statement"] is not None:
            machine = machine_stated(dict(data["statement"]))
        machine = cast(Any, is_of(cast(Any, machine), data["machine"]))
        if (machine.units is None) != (control.bare is None):
            raise ValueError("its units do not fit its machine")
        actuated = Actuated(machine, Actuator(**data.get("actuator", {})))
        model = actuated.model
        for leg in control.legs:
            states = model.flight.states if leg.phase == "flight" else model.contact.states
            if leg.states != states or leg.inputs.names != (actuated.actuator.rate,):
                raise ValueError(f"its stage '{leg.phase}' is not a stage of its machine")
        if not is_driven_motion_of(control, actuated):
            raise ValueError(OF_OTHER_EQUATIONS)
        return cls.of(machine, control, actuated.actuator)


def is_driven_motion_of(control: Control, actuated: Actuated) -> bool:
    """Whether a motion with its inputs is one of an actuated machine: a table, say, may have changed under the same
    name."""
    own = actuated.dimensionless()
    for leg in control.dimensionless().legs:
        phase = own.model.flight if leg.phase == "flight" else own.model.contact
        inputs = leg.inputs(leg.path.times[:-1] + leg.path.steps / 2).T
        if not is_motion_of(leg.path, phase, {**own.values, **dict(zip(leg.inputs.names, inputs, strict=True))}):
            return False
    return True


def largest_effects(driven: Actuated, control: Control) -> tuple[float, float]:
    """The largest size of an actuator's force and of its power, both without units: over each control interval with
    both of its ends, by Brent's method near the samples that may be the largest."""
    from scipy.optimize import minimize_scalar  # takes long to import

    largest, shares = [0.0, 0.0], 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, POWER_SAMPLES + 1))
    for leg in control.legs:
        marks = leg.inputs.times
        t = np.minimum(marks[:-1, None] + np.diff(marks)[:, None] * shares, marks[1:, None])
        rates = leg.inputs(marks[:-1] + np.diff(marks) / 2)[:, :1]
        samples = driven.effects(flight_states(driven, leg, t.ravel()), np.broadcast_to(rates, t.shape).ravel())
        for kind, each in enumerate(samples):
            sizes = np.abs(each).reshape(t.shape)
            largest[kind] = max(largest[kind], float(sizes.max()))
            inside, beside = sizes[:, 1:-1], np.maximum(sizes[:, :-2], sizes[:, 2:])
            likely = inside >= np.maximum(beside, (1 - BETWEEN_SAMPLES) * largest[kind])
            for i, k in np.argwhere(likely).tolist():
                bounds, of = t[i, [k, k + 2]], (driven, leg, rates[i], kind)
                options = {"xatol": SAME_PEAK * (bounds[1] - bounds[0])}
                peak = minimize_scalar(_size_below_0, args=of, bounds=bounds, method="bounded", options=options)
                largest[kind] = max(largest[kind], -float(peak.fun))
    return largest[0], largest[1]


def _size_below_0(t: float, driven: Actuated, leg: ControlledLeg, rate: np.ndarray, kind: int) -> float:
    """Minus the size of the force, kind 0, or the power at a time of a leg, at a rate (1,) of the actuator's state."""
    return -abs(float(driven.effects(flight_states(driven, leg, [t]), rate)[kind][0]))


def work_done(driven: Actuated, control: Control) -> tuple[float, float]:
    """The work and the positive work of an actuator on a machine, both without units."""
    done, positive = sum(_work_on(driven, leg, leg.inputs.times, POWER_SAMPLES).sum(axis=1) for leg in control.legs)
    return float(done), float(positive)


def work_until(driven: Actuated, control: Control, t: np.ndarray) -> np.ndarray:
    """The work and the positive work (2, k) of an actuator up to times (k,), all without units."""
    before, found = np.zeros((2, 1)), np.zeros((2, len(t)))
    for leg in control.legs:
        inside = (t >= leg.start) & (t <= control.end if leg is control.legs[-1] else t < leg.start + leg.duration)
        since, ends = np.clip(t[inside] - leg.start, 0.0, leg.duration), leg.inputs.times
        marks = np.unique(np.concatenate([ends, since]))
        on_parts, on_intervals = _work_on(driven, leg, marks, PART_SAMPLES), _work_on(driven, leg, ends, POWER_SAMPLES)
        fine, coarse = (np.hstack([np.zeros((2, 1)), each.cumsum(axis=1)]) for each in (on_parts, on_intervals))
        interval = np.searchsorted(ends, since, side="right") - 1
        begun = fine[:, np.searchsorted(marks, ends[interval])]
        found[:, inside] = before + coarse[:, interval] + fine[:, np.searchsorted(marks, since)] - begun
        before = before + coarse[:, -1:]
    return found


def _work_on(driven: Actuated, leg: ControlledLeg, marks: np.ndarray, samples: int) -> np.ndarray:
    """The work and the positive work (2, k) on the parts of a leg between marks (k + 1,), each within an interval."""
    places, weights = np.polynomial.legendre.leggauss(samples)
    lengths = np.diff(marks)
    t = marks[:-1, None] + lengths[:, None] * (0.5 + 0.5 * places)
    rates = np.broadcast_to(leg.inputs(marks[:-1] + lengths / 2)[:, :1], t.shape)
    _, power = driven.effects(flight_states(driven, leg, t.ravel()), rates.ravel())
    power = power.reshape(t.shape)
    return np.array([(each @ weights) * lengths / 2 for each in (power, np.maximum(power, 0.0))])


def flight_states(driven: Actuated, leg: ControlledLeg, t: ArrayLike) -> np.ndarray:
    """Flight states (..., n) of a leg of a result at times (...) since its start."""
    embed, rows = driven.model.embed, leg.path(t)
    return rows[..., : len(embed)] if leg.phase == "flight" else rows[..., : embed.shape[1]] @ embed.T


class DrivenMotion(Simulation):
    """A motion of an actuated machine, whose spring joins the same as without the actuator."""

    @property
    def springs(self) -> tuple[tuple[str | None, str], ...]:
        """What the springs join, see `Simulation`."""
        return cast(Actuated, self.source).machine.model.springs


class WithMovedEnd(DrivenMotion):
    """A motion with the spring's end among its heights."""

    @property
    def heights(self) -> dict[str, Any]:
        """The heights of the machine, and last that of the spring's end, which is the displacement above the lower one
        of what the spring joins."""
        ((below, _),) = super().springs
        heights = super().heights
        ground = Affine((0.0,) * len(self.source.model.flight.states))
        foot = ground if below is None else cast(Affine, heights[below])
        return {**heights, SPRING_END: Affine((*foot.weights[:-1], 1.0), foot.offset)}

    @property
    def springs(self) -> tuple[tuple[str | None, str], ...]:
        """The spring from its moved end."""
        ((_, above),) = super().springs
        return ((SPRING_END, above),)


class _SavedDriven(TypedDict):
    """The entries of a file of a `Driven` in addition to its `Control`."""

    machine: Mapping[str, Any]
    statement: Mapping[str, Any] | None
    actuator: NotRequired[Mapping[str, str]]
