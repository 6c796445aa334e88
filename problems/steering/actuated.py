"""A machine with an actuator, which moves the end of a spring, as on the paper's air track (section 10), or is a force.

An actuator has one state more than the machine, whose rate is the input. The spring acts by phi(r - u), u the
displacement of its end, r the extension, with the rate w = u'; the damper parallel to the spring works on r' alone. A
force f, with the rate f_rate, acts along a distance d: it pushes apart where it is above 0. The actuator's power on the
machine is its force times the speed at which it moves: -phi(r - u) w or f d', in the units of the machine's energy.
Lift-off is where the contact force vanishes, landing where the gap does.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from operator import attrgetter
from typing import Any, cast

import casadi as ca
import numpy as np

from orbits.errors import InputError
from orbits.laws import Algebraic, Parameters, Scalars, from_key
from orbits.mechanics import Damper, Element, Force, Mechanism, Scalar, Spring, length_or_angle, names_in, value_of
from orbits.model import Model, Stated
from orbits.running import exclusive, exclusive_property
from orbits.symbolic import suggest
from orbits.units import ANGLE, ANGULAR_SPEED, FORCE, LENGTH, SPEED, TORQUE, Dimension, Units

from ..machines import DAMPERS, TwoMassMachine, refuse_taken

SIZES = ("length", "time", "force")
# The state and the input of each kind of actuator.
STATES_OF_ACTUATORS = {"displacement": ("u", "w"), "force": ("f", "f_rate")}


@dataclass(frozen=True)
class Actuator:
    """The only actuator of a machine.

    along : the extension of the spring whose end is moved, as the machine states it, or the distance along which a
        force acts: a formula of the coordinates, "body - foot". None is the extension of the only spring
    kind : "displacement", of the spring's end, whose rate is the input; or "force", which pushes along the distance
        where it is above 0, and whose rate is the input, so that it never jumps

    >>> from problems import Actuator, Hopper, steering
    >>> pushed = steering.keep_hopping(Hopper(damping=0.01), actuator=Actuator("y1 - y2", kind="force"))
    >>> pushed.inputs
    ('f_rate',)
    """

    along: str | None = None
    kind: str = "displacement"

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in STATES_OF_ACTUATORS:
            raise InputError(f"kind = {self.kind!r}; it must be 'displacement' or 'force'")
        if not (self.along is None or isinstance(self.along, str)):
            raise InputError(f"along = {self.along!r}; it must be a formula of the coordinates, such as 'body - foot'")

    @property
    def state(self) -> str:
        """The name of its state."""
        return STATES_OF_ACTUATORS[self.kind][0]

    @property
    def rate(self) -> str:
        """The name of the rate of its state, the input."""
        return STATES_OF_ACTUATORS[self.kind][1]

    @property
    def is_force(self) -> bool:
        """Whether it is a force."""
        return self.kind == "force"


@dataclass(frozen=True)
class Actuated(Stated):
    """A machine with an actuator, as `simulate` takes it; the last state is the displacement of a spring's end, or the
    force.

    machine : a `Hopper`, a `Juggler`, a `Mechanism`, or any other machine that a mechanism states, such as a `Chain`; a
        machine in SI is stored without units
    actuator : by default it moves the end of the only spring
    units : of the machine in SI, None for a dimensionless one

    Raises `InputError` for a machine without a mechanism, for laws with hysteresis, and for an actuator that does
    not fit the machine.
    """

    machine: Any
    actuator: Actuator = Actuator()
    units: Units | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.actuator, Actuator):
            raise InputError(f"actuator = {self.actuator!r}; it must be an Actuator(along, kind), or None")
        if not hasattr(self.machine, "stated"):
            kind = type(self.machine).__name__
            raise InputError(f"a {kind} has no spring whose end can be moved: state it as an orbits.Mechanism(...)")
        stated = self.machine.stated()  # raises for a machine that is no mechanism
        if stated.actuators:
            names = ", ".join(stated.actuators)
            raise InputError(
                f"the {stated.name} has actuators of its own ({names}): state it without, and give actuator="
            )
        refuse_springs_with_loops(stated)
        object.__setattr__(self, "actuator", _resolved(self.actuator, stated))
        own = (self.actuator.state, self.actuator.rate)
        refuse_taken((*own, *LAUNCH_PARAMETERS), [*stated.coordinates, *stated.parameters], "the actuator's own name")
        if self.machine.units is not None:
            dimension = self.dimensions[self.actuator.state]
            object.__setattr__(self, "units", replace(self.machine.units, own=((self.actuator.state, dimension),)))
            object.__setattr__(self, "machine", self.machine.dimensionless())

    @property
    def _is_default(self) -> bool:
        """Whether the actuator is the default one of the machine."""
        springs = springs_of_mechanism(self.machine.stated())
        return len(springs) == 1 and self.actuator == Actuator(cast(str, springs[0].extension))

    @exclusive_property
    def mechanism(self) -> Mechanism:
        """The machine with its actuator; of machines of two masses without values, as these are in the machine."""
        m = self.machine
        if isinstance(m, TwoMassMachine):
            return _with_actuator(m.mechanism(*m.keys, m.rest_length is not None, True, *m.ground_keys), self.actuator)
        return _with_actuator(m.stated(), self.actuator)

    def stated(self) -> Mechanism:
        """The machine with its actuator as a mechanism, with the values of its parameters and without units."""
        values = {name: value for name, value in self.values.items() if name != self.model.homotopy}
        return replace(self.mechanism, parameters=values)

    @property
    def model(self) -> Model:
        """The machine's model with the actuator's state; machines that differ only in numbers share it."""
        if self.units is None:
            return self.mechanism.model
        stated = self.machine.stated()
        kinds = (
            length_or_angle(each.extension, stated.places, {*stated.angles}) for each in springs_of_mechanism(stated)
        )
        return _with_forces(
            self.mechanism.model, tuple(() if k is None else FORCE if k is LENGTH else TORQUE for k in kinds)
        )

    @property
    def dimensions(self) -> dict[str, Dimension]:
        """The dimensions of the actuator's state and of its rate by name, of its "actuator force", its "way" and its
        "speed"."""
        stated, actuator = self.machine.stated(), self.actuator
        places = {*stated.coordinates}
        turned = length_or_angle(actuator.along, places, {*stated.angles}) is ANGLE
        way, speed, force = (ANGLE, ANGULAR_SPEED, TORQUE) if turned else (LENGTH, SPEED, FORCE)
        own = (force, (force[0], force[1] - 1, *force[2:])) if actuator.is_force else (way, speed)
        return {actuator.state: own[0], actuator.rate: own[1], "actuator force": force, "way": way, "speed": speed}

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name, the actuator at rest."""
        return {**self.still, self.actuator.rate: 0.0}

    @property
    def still(self) -> dict[str, float]:
        """Every parameter but the actuator's rate, which is an input."""
        dampers = DAMPERS if isinstance(self.machine, TwoMassMachine) else ()
        return {**self.machine.values, **{name: float(getattr(self.machine, name)) for name in dampers}}

    @property
    def damped(self) -> bool:
        """Whether the machine loses energy otherwise than by impacts."""
        if isinstance(self.machine, TwoMassMachine):
            return self.machine.damped
        stated = self.machine.stated()
        dampers = [each for each in stated.elements if isinstance(each, Damper)]
        own = any(callable(each.coefficient) or value_of(each.coefficient, {}, stated.values) > 0 for each in dampers)
        return own or any(isinstance(each, Force) for each in stated.elements)

    @property
    def has_corners(self) -> bool:
        """Whether the law of a spring has corners."""
        stated = self.machine.stated()
        laws = [each.force for each in springs_of_mechanism(stated) if each.force.pieces]
        return any(from_key(law, stated.parameters).corners() for law in laws)

    restitution = property(attrgetter("machine.restitution"), doc="That of the machine.")
    rest_length = property(attrgetter("machine.rest_length"), doc="That of the machine, None if it has none.")

    @property
    def scheduled(self) -> dict[str, float]:
        """The unit of the actuator's rate, which a simulation may vary in time."""
        rate = self.actuator.rate
        return {rate: 1.0 if self.units is None else self.units.of(self.dimensions[rate])}

    def dimensionless(self) -> "Actuated":
        """The machine and its actuator without units."""
        return replace(self, units=None)

    def describe(self) -> dict[str, Any]:
        """The machine as JSON-ready data; of one in SI with the sizes of its units, which its numbers do not say."""
        sizes = {} if self.units is None else {f"unit_{name}": getattr(self.units, name) for name in SIZES}
        own = {} if self._is_default else {"actuator": {"along": self.actuator.along, "kind": self.actuator.kind}}
        return {**self.machine.describe(), "actuated": True, **own, **sizes}

    def with_values(self, **values: float) -> "Actuated":
        """The actuator on the machine with other values of its parameters."""
        return replace(self, machine=self.machine.with_values(**values))

    @exclusive_property
    def drive(self) -> "Drive":
        """The actuator on the model; machines that differ only in numbers have equal ones."""
        return Drive(self.model, self.actuator, tuple(self.mechanism.coordinates), self.mechanism.energy_unit)

    @exclusive
    def effects(self, states: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The actuator's forces and powers (k,) in flight states (k, n) at rates (k,) of its state."""
        found = self._effects(states.T, np.atleast_2d(rates))
        force, power, _ = (np.array(each, dtype=float).ravel() for each in found)
        return force, power

    @exclusive
    def moved(self, states: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The actuator's forces and speeds (k,) in flight states (k, n) at rates (k,) of its state."""
        force, _, speed = (np.array(each, dtype=float).ravel() for each in self._effects(states.T, rates[None]))
        return force, np.broadcast_to(speed, force.shape)

    @exclusive_property
    def _effects(self) -> ca.Function:
        """(flight state, rate) -> the actuator's force, power and speed."""
        x, rate = ca.SX.sym("x", len(self.model.flight.states)), ca.SX.sym("rate")
        states, p = ca.vertsplit(x), {**self.still, self.actuator.rate: rate}
        q = self.model.flight.data(states, p)
        drive = self.drive
        found = [drive.force(states, p, q), drive.power(states, p, q), drive.speed(states, p)]
        return ca.Function("effects", [x, rate], [*map(ca.densify, map(ca.SX, found))])


@dataclass(frozen=True)
class Drive:
    """An actuator on a model.

    coordinates : names of the machine's coordinates
    energy_unit : as in `Mechanism`
    """

    model: Model
    actuator: Actuator
    coordinates: tuple[str, ...]
    energy_unit: Scalar

    def force(self, x: Scalars, p: Parameters, q: Scalars) -> Algebraic:
        """The actuator's force along its way, in a flight state: f, or that on the spring's end, -phi."""
        if self.actuator.is_force:
            return x[-1]
        return self.model.flight_gradient(x, p, q)[-1] * value_of(self.energy_unit, {}, p)

    def power(self, x: Scalars, p: Parameters, q: Scalars) -> Algebraic:
        """The actuator's power on the machine in a flight state, in the machine's unit of energy over that of time."""
        if self.actuator.is_force:
            return x[-1] * self.speed(x, p) / value_of(self.energy_unit, {}, p)
        return self.model.flight_gradient(x, p, q)[-1] * p[self.actuator.rate]

    def speed(self, x: Scalars, p: Parameters) -> Algebraic:
        """The speed at which the actuator moves, in a flight state: that of the spring's end, or the rate of the
        distance along which the force acts."""
        if not self.actuator.is_force:
            return p[self.actuator.rate]
        way = self._way
        values = [p[name] for name in way.names]
        return way.slope(ca.vertcat(*x[:-1:2]), ca.vertcat(*x[1:-1:2]), ca.vertcat(*values))

    def travel(self, x: Scalars, p: Parameters) -> Algebraic:
        """How far the actuator is displaced in a flight state: u, or by how much the distance along which the force
        acts differs from that where the machine rests with its springs unloaded."""
        if not self.actuator.is_force:
            return x[-1]
        rest, way = self.model.rest(p) if self.model.rest else [0.0] * len(x), self._way
        here, there = (way.value(ca.vertcat(*y[:-1:2]), ca.vertcat(*(p[n] for n in way.names))) for y in (x, rest))
        return here - there

    @property
    def _way(self) -> "_Distance":
        return _way(str(self.actuator.along), self.coordinates)


# The parameters that a steered hop has beside those of the machine.
LAUNCH_PARAMETERS = ("peak", "round", "launch", "aim", "liftoff", "rest")


def springs_of_mechanism(stated: Mechanism) -> list[Spring]:
    """The springs of a mechanism."""
    return [each for each in stated.elements if isinstance(each, Spring)]


def refuse_springs_with_loops(stated: Mechanism) -> None:
    """Raise `InputError` where the law of a spring has hysteresis."""
    for spring in springs_of_mechanism(stated):
        if spring.force.branches:
            remedy = "its spring has hysteresis, which schedules do not support; give it the law's `.mean`"
            raise InputError(f"the {stated.name} cannot be steered: {remedy}")


def undamped(machine: Any) -> Any:
    """The machine without its dampers and driving forces, which may have lossless orbits."""
    if isinstance(machine, TwoMassMachine):
        return machine.with_values(**dict.fromkeys(DAMPERS, 0.0))
    if not any(isinstance(each, Damper | Force) for each in machine.stated().elements):
        return machine
    stated = machine.stated()
    left = [each for each in stated.elements if not isinstance(each, Damper | Force)]
    bare = replace(stated, elements=left, parameters={})
    used = stated.parameters if bare.has_functions else bare.names
    return replace(bare, parameters={name: stated.parameters[name] for name in stated.parameters if name in used})


def _resolved(actuator: Any, stated: Mechanism) -> Actuator:
    """The actuator with its formula, where the machine has what it names; raises `InputError` for another."""
    if not isinstance(actuator, Actuator):
        raise InputError(f"actuator = {actuator!r}; it must be an Actuator, such as problems.Actuator('body - foot')")
    extensions = [each.extension for each in springs_of_mechanism(stated)]
    named = [each for each in dict.fromkeys(extensions) if isinstance(each, str)]
    choice = ", ".join(f"Actuator({each!r})" for each in named)
    if actuator.along is None:
        if len({*extensions}) != 1 or not named:
            raise InputError(
                f"the {stated.name} has {len(extensions)} springs: name the extension of the spring whose end moves, "
                f"actuator={choice.replace(', ', ' or ') or 'Actuator(...), with the extension as a formula'}, or "
                "--actuator in the command"
            )
        return replace(actuator, along=named[0])
    if actuator.is_force:
        if unknown := sorted(names_in(actuator.along) - {*stated.coordinates, *stated.parameters}):
            hint = suggest(unknown[0], stated.coordinates)
            raise InputError(f"along '{actuator.along}': there is no coordinate '{unknown[0]}'{hint}")
        if not names_in(actuator.along) & {*stated.coordinates}:
            raise InputError(f"along '{actuator.along}' has no coordinate; there are {', '.join(stated.coordinates)}")
        return actuator
    alike = [each for each in named if each.replace(" ", "") == actuator.along.replace(" ", "")]
    if not alike:
        raise InputError(f"no spring has the extension '{actuator.along}': there are {choice or 'functions alone'}")
    return replace(actuator, along=alike[0])


def _push(y: Parameters, v: Parameters, p: Parameters) -> Algebraic:
    """The force of an actuator, which is its state."""
    return y[STATES_OF_ACTUATORS["force"][0]]


@lru_cache(maxsize=64)
def _with_actuator(mechanism: Mechanism, actuator: Actuator) -> Mechanism:
    """A mechanism with an actuator."""
    first = springs_of_mechanism(mechanism)[:1]
    counts = first[0].extension if mechanism.counts is None and first else mechanism.counts
    elements: list[Element] = list(mechanism.elements)
    if actuator.is_force:
        elements.append(Force(str(actuator.along), _push))
    else:
        moved = f"{actuator.along} - {actuator.state}"
        elements = [
            replace(each, extension=moved) if isinstance(each, Spring) and each.extension == actuator.along else each
            for each in elements
        ]
    return replace(mechanism, elements=elements, counts=counts, actuators={actuator.state: actuator.rate})


@lru_cache(maxsize=64)
def _with_forces(model: Model, dimensions: tuple[Dimension, ...]) -> Model:
    """A model with the dimensions of the forces of its springs."""
    return replace(model, spring_dimensions=dict(zip(model.spring_forces, dimensions, strict=True)))


@dataclass(frozen=True, eq=False)
class _Distance:
    """The distance along which a force acts.

    names : of the parameters
    value, slope : (coordinates, parameters) -> it, and (coordinates, rates, parameters) -> its rate
    """

    names: tuple[str, ...]
    value: ca.Function
    slope: ca.Function


@lru_cache(maxsize=64)
def _way(along: str, coordinates: tuple[str, ...]) -> _Distance:
    names = tuple(sorted(names_in(along) - {*coordinates}))
    y, v, p = (ca.SX.sym(name, len(each)) for name, each in (("y", coordinates), ("v", coordinates), ("p", names)))
    named = [dict(zip(each, ca.vertsplit(symbols), strict=True)) for each, symbols in ((coordinates, y), (names, p))]
    value = ca.SX(value_of(along, *named))
    rate = ca.jtimes(value, y, v)
    return _Distance(names, ca.Function("way", [y, p], [value]), ca.Function("rate", [y, v, p], [rate]))
