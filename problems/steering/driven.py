"""Motions of an actuated machine that optimal control has found, with the machine: drawn, saved and disturbed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, TypedDict, cast

import numpy as np
from numpy.typing import ArrayLike

from orbits import Control, Simulation
from orbits.flow.forces import units_of_springs
from orbits.io import Document, conform
from orbits.model.machine import Machine, machine_in_words
from orbits.model.model import CONTACT_FORCE
from orbits.model.phase import Affine
from orbits.result import Axes, Report, is_of
from orbits.show.animation import SPRING_END, animate_simulation
from orbits.simulation.simulated import times_within
from orbits.units import LIFTOFF_SPEED, TIME, in_own_units

from ..machines.files import machine_stated, statement_for_file
from ..machines.in_si import AnyMachine
from .actuated import RATE, Actuated
from .disturbed import Disturbed, disturbed

POWER = (0, -1, 0, 1)
PERIODIC = 1e-6  # states that differ by less, relative to their size, are the same: the tolerance of a solve is finer


@dataclass(frozen=True, repr=False)
class Driven(Control, what="motion of a driven machine"):
    """A `Control` of a machine whose spring's end is moved, as `problems.steering` finds it.

    Called with times (...) it returns flight states (..., n), as `Simulation` and `Orbit` do; the last one is the
    displacement of the spring's end.

    source : the machine without its actuator; in SI the numbers are in SI
    """

    source: AnyMachine = field(kw_only=True)

    machine = property(lambda self: machine_in_words(self.source))

    @classmethod
    def of(cls, machine: AnyMachine, control: Control) -> "Driven":
        """A control of a machine, with the machine."""
        own = {each.name: getattr(control, each.name) for each in fields(Control)}
        own["bare"] = control.bare and cls.of(cast(Any, machine).dimensionless(), control.bare)
        forces = {**units_of_springs(Actuated(machine)), CONTACT_FORCE: "N"}  # type: ignore[arg-type]
        own["units"] = {**control.units, **({"power": "W", **forces} if control.units else {})}
        return cls(**own, source=machine)

    @property
    def actuated(self) -> Actuated:
        """The machine with its actuator, as `simulate` takes it."""
        return Actuated(self.source)  # type: ignore[arg-type]

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
        times, inputs = self.schedule(RATE)
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
            those of any other the spring's end stays at rest
        launch_error : added to the launch speed, for a motion that begins with a lift-off
        state : (n,), a flight state to start from instead, as in `simulate`
        push : (time, changes of flight states by name), as (3.0, {"y1'": 0.1}): an impulse at that time
        values : of parameters of the machine, as damping=0.011; a launch is then one of that machine, at the same speed

        Raises `InputError` for an invalid disturbance.
        """
        return disturbed(self, hops, launch_error, state, push, values)

    def power(self, t: ArrayLike) -> np.ndarray:
        """The actuator's power (...) on the machine at times (...); raises as a call does."""
        second = "" if self.source.units is None else " s"
        return _actuator_power(self.source, self, times_within(t, self.end, second))

    def table(self, t: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """The columns of `Control.table`, with flight states, the actuator's "power", and the forces of spring and
        contact."""
        columns = super().table(t)
        return columns | {"power": self.power(columns["time"]), **self.motion.forces(columns["time"])}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot heights against time, contact shaded, and below the spring's end and its rate; returns the axes of the
        heights. See `problems.steering.steering_figures.plot_driven`."""
        from .steering_figures import plot_driven

        return plot_driven(self, axes)

    def animate(self, path: str | Path, frames: int = 200, *, progress: Report = None) -> Path:
        """Write an animation (.gif or .mp4), for a machine with a rest length also of the spring's end; returns its
        path. See `orbits.show.animation.animate_simulation`."""
        motion = self.motion
        if self.source.rest_length is not None:
            motion = WithMovedEnd(**{each.name: getattr(motion, each.name) for each in fields(motion)})
        return animate_simulation(motion, path, frames, progress)

    def document(self) -> Document:
        """The motion as JSON-ready data, with the machine in words and, where a file can state it, its statement."""
        return {**super().document(), "machine": self.machine, "statement": statement_for_file(self.source)}

    @classmethod
    def of_saved(cls, document: object, machine: Machine | None = None) -> "Driven":
        """The motion of a document by `saved`, of the machine that it states or of this one; raises `ValueError` where
        parts of it do not fit each other."""
        data, control = conform(document, _SavedDriven), Control.of_saved(document)
        if machine is None and data["statement"] is not None:
            machine = machine_stated(dict(data["statement"]))
        machine = cast(AnyMachine, is_of(cast(Any, machine), data["machine"]))
        if (machine.units is None) != (control.bare is None):
            raise ValueError("its units do not fit its machine")
        model = Actuated(machine).model  # type: ignore[arg-type]
        for leg in control.legs:
            states = model.flight.states if leg.phase == "flight" else model.contact.states
            if leg.states != states or leg.inputs.names != (RATE,):
                raise ValueError(f"its stage '{leg.phase}' is none of its machine's")
        return cls.of(machine, control)


@in_own_units(POWER, control=(), t=TIME)
def _actuator_power(machine: Any, control: Driven, t: np.ndarray) -> np.ndarray:
    """The actuator's power (...) on the machine at times (...)."""
    states = control(t)
    tension = machine.spring(control.actuated.model.extension(states) - states[..., -1])
    return -machine.mass_ratio * tension * control.inputs_at(t)[..., control.inputs.index(RATE)]


class DrivenMotion(Simulation):
    """A motion of an actuated machine, whose spring joins the same as without the actuator."""

    @property
    def springs(self) -> tuple[tuple[str | None, str], ...]:
        """As in `Simulation`."""
        return cast(Actuated, self.source).machine.model.springs


class WithMovedEnd(DrivenMotion):
    """The same with the spring's end among its heights."""

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
    """The entries of a file of a `Driven` beside its `Control`."""

    machine: Mapping[str, Any]
    statement: Mapping[str, Any] | None
