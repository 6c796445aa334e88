"""A machine whose spring's end is moved by an actuator, as on the paper's air track (section 10).

The spring acts by phi(r - u), u the displacement of its end, r the extension; its rate w = u' is the input. The
damper beside the spring works on r' alone. The actuator does work on the machine at the rate -m phi(r - u) w, m the
mass ratio, in the units of the machine's energy; lift-off is where the contact force vanishes, landing where the gap
does.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any

import numpy as np

from orbits.control import Input
from orbits.errors import InputError, finite_number
from orbits.laws.law import Algebraic, Scalars
from orbits.model.machine import Stated
from orbits.model.model import Model
from orbits.model.phase import Affine
from orbits.running.exclusive import exclusive_property
from orbits.units import LENGTH, SPEED, Message, Quantity, Units

from ..machines.in_si import MachineInSI
from ..machines.parameters import refuse_taken
from ..machines.two_masses import DAMPERS, END, RATE, TwoMassMachine

SIZES = ("length", "time", "force")


@dataclass(frozen=True)
class Actuated(Stated):
    """A machine whose spring's end is moved, as `simulate` takes it; the last state u is the displacement of this end.

    machine : a `Hopper` or `Juggler`, or one in SI, which is stored without units
    units : of the machine in SI, None for a dimensionless one
    """

    machine: TwoMassMachine
    units: Units | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if isinstance(self.machine, MachineInSI):
            object.__setattr__(self, "units", self.machine.units)
            object.__setattr__(self, "machine", self.machine.dimensionless())
        if not isinstance(self.machine, TwoMassMachine):
            kind = type(self.machine).__name__
            raise InputError(f"a {kind} is no machine whose spring can be moved, as problems.Hopper()")
        if self.machine.ground is not None:
            raise InputError("an actuator's hops are planned on rigid ground, from a speed alone: take ground=None")
        self.machine.stated()  # raises for a machine that is no mechanism
        if corners := self.machine.spring.corners():
            text = f"spring '{self.machine.spring.text}' has a corner at r = {corners[0]:.6g}"
            raise InputError(
                f"{text}: an actuator needs a law with a continuous slope; round it, as by a table of rows"
            )
        refuse_taken((END, RATE, "peak"), self.machine.parameters, "the actuator's own name")

    @exclusive_property
    def model(self) -> Model:
        """The machine's model with u as a further state; machines that differ only in numbers share it."""
        m = self.machine
        return m.mechanism(*m.keys, m.rest_length is not None, damped=True, moved=True).model

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name, the spring's end at rest."""
        return {**self.still, RATE: 0.0}

    @property
    def still(self) -> dict[str, float]:
        """Every parameter but the actuator's rate, which is an input."""
        return {**self.machine.values, **{name: float(getattr(self.machine, name)) for name in DAMPERS}}

    restitution = property(attrgetter("machine.restitution"), doc="That of the machine.")
    rest_length = property(attrgetter("machine.rest_length"), doc="That of the machine, None if it has none.")

    @property
    def scheduled(self) -> dict[str, float]:
        """The unit of the actuator's rate, which a simulation may vary in time."""
        return {RATE: 1.0 if self.units is None else self.units.of(SPEED)}

    def dimensionless(self) -> "Actuated":
        """The same without units."""
        return replace(self, units=None)

    def describe(self) -> dict[str, Any]:
        """The machine as JSON-ready data; of one in SI with the sizes of its units, which its numbers do not say."""
        sizes = {} if self.units is None else {f"unit_{name}": getattr(self.units, name) for name in SIZES}
        return {**self.machine.describe(), "actuated": True, **sizes}

    def with_values(self, **values: float) -> "Actuated":
        """The same actuator on the machine with other values of its parameters."""
        return replace(self, machine=self.machine.with_values(**values))


@dataclass(frozen=True)
class Limits:
    """Bounds of the actuator's rate and displacement, and the distance that is to stay positive, if it is known."""

    rate: float
    stroke: float
    separation: Affine | None

    def inputs(self, cost: str) -> dict[str, Input]:
        """The rate as the stages' input; for the least peak, the free parameter "peak" bounds it."""
        if cost == "peak":
            return {RATE: Input(lambda p: -p["peak"], lambda p: p["peak"])}
        return {RATE: Input(-self.rate, self.rate)}

    def path(self, embed: np.ndarray) -> dict[str, Callable]:
        """The path constraints on states that `embed` makes flight states."""
        held: dict[str, Callable] = {}
        if np.isfinite(self.stroke):
            held["room to pull"] = lambda x, p, q: self.stroke - x[-1]
            held["room to push"] = lambda x, p, q: self.stroke + x[-1]
        if separation := self.separation:
            held["separation"] = lambda x, p, q: separation.at(product(embed, x))
        return held


def actuator_limits(driven: Actuated, rate: float, stroke: float) -> Limits:
    """The limits of a machine with these bounds; raises `InputError` for bounds that are not above 0."""
    for name, bound in (("rate", rate), ("stroke", stroke)):
        if not (bound == np.inf or finite_number(name, bound) > 0):
            quantity = Quantity(bound, SPEED if name == "rate" else LENGTH)
            raise InputError(Message("{name} = {bound:g}: the actuator's bound is above 0", name=name, bound=quantity))
    return Limits(float(rate), float(stroke), driven.model.separation(driven.values))


def product(matrix: np.ndarray, x: Scalars) -> list[Algebraic]:
    """The product of a matrix of numbers with a state's expressions."""
    return [Affine(tuple(row)).at(x) for row in matrix.tolist()]
