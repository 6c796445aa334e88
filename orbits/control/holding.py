"""Feedback that holds an orbit: a force between two parts of the machine that is constant in parts of each cycle.

An unstable lossless orbit is one that a machine leaves, by the multipliers outside the unit circle. A force between two
of its parts, as the torque of a motor at the hip, brings it back. Flight and contact each have some intervals, away
from lift-off and landing, in which the force u is constant and decided where the interval begins: u = -K (x - x*), with
x* the state of the orbit as long after lift-off. The change of the state is carried from one interval to the next by a
matrix A, and the force adds B u. The gains K minimise the sum of |y|^2 of the launches y, counted from that of the
orbit, of r u^2 of the forces, and of the square of the gap where the foot should land, over all cycles to come: the
linear quadratic regulator of a periodic system, by its Riccati recursion backwards in time. All are counted in units of
the orbit: the highest gap, the period over 2 pi, and the mean contact force, which is the weight. At a fixed time after
lift-off the state depends smoothly on the launch, although the time of a tangential landing does not. On the orbit
itself u = 0: the feedback costs nothing there.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np

from ..errors import InputError, NoOrbit, finite_number, whole_number
from ..flow import Flow
from ..hops import Impacts, LaunchSection, tangential_landing, through_contact
from ..io import one_line
from ..laws import Algebraic, Parameters
from ..mechanics import Force, Mechanism
from ..periodic import Orbit
from ..running import exclusive, interrupts
from ..tables import wrapped
from ..units import LENGTH, Units

INPUT = "hold"  # the parameter of the force that holds an orbit


class HoldOptions(NamedTuple):
    """The intervals and the recursion of a feedback."""

    # The shares of each phase between which its intervals lie, so that lift-off and landing are without the force.
    begins: float = 0.1
    ends: float = 0.9
    most_parts: int = 1000  # intervals of a phase
    settled: float = 1e-13  # the recursion has settled once the cost of a launch changes by this share in a cycle
    cycles: int = 2000  # at most; a cost that grows on and on is that of a direction that the force does not reach
    largest_cost: float = 1e14
    instants: int = 201  # of an orbit by which its sizes are measured


HOLDING = HoldOptions()


class _Stage(NamedTuple):
    """A part of the cycle.

    carry, effect : the matrix A, and B (a,) of the force in its unit, None where there is none
    gap : the derivatives (a,) of the gap at a landing in it, None where there is none
    """

    carry: np.ndarray
    effect: np.ndarray | None
    gap: np.ndarray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Hold:
    """A feedback that holds an orbit, to be passed to `simulate(held.machine, launch, feedback=held)`.

    machine : that of the orbit with the force `name` along the extension, which is 0 unless the feedback sets it
    along, name : the extension along which the force acts, and the parameter that it is
    names : of the numbers of a launch (d,)
    times : (k + 1,), since lift-off, between which the force is constant
    states, gains : (k, n), the orbit's flight states at the first k of these times, and the force per change of them
        with the opposite sign; 0 between flight and contact
    multipliers, held_multipliers : (d,) without and with the feedback, by falling modulus
    """

    machine: Mechanism
    along: str
    names: tuple[str, ...]
    times: np.ndarray
    states: np.ndarray
    gains: np.ndarray
    multipliers: np.ndarray
    held_multipliers: np.ndarray
    name: str = INPUT

    def input(self, index: int, state: np.ndarray) -> float:
        """The force between two times, by the flight state (n,) at the first of them."""
        return float(-self.gains[index] @ (state - self.states[index]))

    def __str__(self) -> str:
        """The moduli of the multipliers without and with the feedback."""
        pairs = zip(np.abs(self.multipliers), np.abs(self.held_multipliers), strict=True)
        moduli = [f"  modulus {own:.6g}, with the feedback {held:.6g}" for own, held in pairs]
        title = f"feedback along {self.along} that holds an orbit of a {self.machine.name}"
        after = "on the orbit itself the force is 0, and the feedback costs nothing"
        return "\n".join([*wrapped(title, onward="    "), *moduli, *wrapped(after, indent="  ")])

    def __repr__(self) -> str:
        return one_line(self, {"machine": self.machine.name, "along": self.along})


@exclusive
def hold(orbit: Orbit, along: str, *, effort: float = 0.05, landing: float = 20.0, parts: int = 3) -> Hold:
    """A feedback that holds a lossless orbit by a force along an extension.

    orbit : of a machine whose launch is more than a speed, such as a runner or a `Chain`
    along : a formula of the coordinates, as "phi - theta" of a hip, whose rate times the force is its power
    effort : the weight r of the force's square against that of the launch's change, both in units of the orbit: its
        highest gap, its period over 2 pi and its mean contact force
    landing : the weight of the square of the gap where the foot should land, whose power 4/3 a landing loses
    parts : the number of intervals in each phase

    Raises `NoOrbit` where the force does not reach what grows, and `InputError` for other machines.

    >>> from orbits import find, simulate
    >>> from orbits.control import hold
    >>> from problems import runner
    >>> run = find(runner(), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})
    >>> held = hold(run, "phi - theta")
    >>> round(float(abs(held.multipliers[0])), 4), bool(abs(held.held_multipliers[0]) < 1)
    (14.2953, True)
    """
    parts = whole_number("parts", parts, "intervals", most=HOLDING.most_parts)
    if not (finite_number("effort", effort) > 0 and finite_number("landing", landing) >= 0):
        raise InputError(
            f"effort = {effort:g}, landing = {landing:g}; weights lie above 0, that of the landing may be 0"
        )
    orbit = _stated_orbit(orbit)
    machine = _driven(orbit, along)
    impacts = Impacts(machine)
    units = _own_units(orbit, machine)
    section, x = LaunchSection(impacts, units), orbit(0.0)
    y, stated = impacts.onto_contact @ x, cast(Mechanism, orbit.source)
    landed = np.array(stated.model.contact_reversal.image(y.tolist(), stated.values), dtype=float)
    flight, contact = orbit.flight_time, float(orbit.contact_time or 0.0)
    marks = np.linspace(HOLDING.begins, HOLDING.ends, parts + 1)
    force = units.of(machine.dimension_of_force(along))
    flying, flown = _intervals(impacts, impacts.flight, x, np.append(marks * flight, flight), force)
    standing, stood = _intervals(impacts, impacts.contact, landed, marks * contact, force)
    embed, tangent = impacts.model.embed, impacts.model.embed @ section.tangent(y) * section.unit
    # The last part of the flight leads to the landing, and on to the first interval in contact.
    lasts = (1 - HOLDING.ends) * flight
    touched = np.array(orbit(flight * (1 - 1e-16)))
    _, change = tangential_landing(impacts, (flown[-2], np.eye(len(x))), lasts, touched, impacts.feet[0])
    gap = np.array(impacts.gap.weights) @ flying[-1].carry / units.of("gap")
    _, rest = through_contact(impacts, stood[-1], np.eye(len(y)), grazes=False)
    stages = [
        _Stage(flying[0].carry @ tangent, None), *flying[1:-1],
        _Stage(standing[0].carry @ change, None, gap), *standing[1:],
        _Stage(section.free(rest.T).T / section.unit[:, None], None),
    ]  # fmt: skip
    gains, held = _regulator(stages, effort, landing)
    none = np.zeros((1, len(x)))
    rows = force * np.concatenate([gains[:parts], none, np.array(gains[parts:]) @ impacts.onto_contact])
    states = np.concatenate([flown[:parts], none, np.array(stood[:parts]) @ embed.T])
    times = np.concatenate([marks * flight, flight + marks * contact])
    free = np.linalg.multi_dot([stage.carry for stage in reversed(stages)])
    return Hold(machine, along, section.names, times, states, rows, _by_modulus(free), _by_modulus(held))


def _stated_orbit(orbit: Orbit) -> Orbit:
    """The orbit as that of a mechanism, where its machine is stated as one."""
    if not isinstance(orbit, Orbit):
        raise InputError(f"orbit = {orbit!r}; hold takes a lossless orbit, as find(machine) returns")
    machine: Any = orbit.source
    several = machine is not None and not machine.model.one_speed
    return replace(orbit, source=machine.stated()) if several and hasattr(machine, "stated") else orbit


def _driven(orbit: Orbit, along: str) -> Mechanism:
    """The machine of an orbit with the force along an extension; raises `InputError` for those that are not held."""
    machine = orbit.source
    if not isinstance(machine, Mechanism) or machine.model.one_speed or machine.model.changes_contact:
        stated = "stands on one foot, and whose launch is more than a speed"
        raise InputError(f"hold takes a machine that {stated}, not a {orbit.machine['machine']}")
    if not isinstance(along, str):
        raise InputError(f"along = {along!r}; it is a formula of the coordinates, as 'phi - theta'")
    if INPUT in machine.names:
        raise InputError(f"'{INPUT}' is the name of the force, and a parameter of the machine: rename it")
    if not orbit.contact_time or machine.restitution or machine.model.reversor is None:
        raise InputError("hold takes lossless orbits with a contact, of machines that are turned back in time")
    parameters, elements = {**machine.parameters, INPUT: 0.0}, [*machine.elements, Force(along, _force)]
    return replace(machine, elements=elements, parameters=parameters, reversor=None)


def _own_units(orbit: Orbit, machine: Mechanism) -> Units:
    """The units of an orbit: its highest gap, or where that is an angle the largest place that is a length; its period
    over 2 pi; and its mean contact force, which is the weight."""
    bare, flown = machine.si_units, orbit(np.linspace(0.0, orbit.flight_time, HOLDING.instants))
    names = machine.model.flight.states
    angular, length = "gap" in bare.angles, float(machine.model.gap(machine.values)(flown).max())
    if angular:
        own = [
            np.abs(flown[:, i]).max() for i, name in enumerate(names) if bare.resolved(name) == bare.resolved(LENGTH)
        ]
        length = float(max(own, default=1.0))
    weight = float(orbit.contact_force(np.linspace(0.0, orbit.period, HOLDING.instants, endpoint=False)).mean())
    weight = weight / length if angular else weight
    return Units(length, orbit.period / (2 * np.pi), weight, weight * length, bare.angles)


def _force(y: Parameters, v: Parameters, p: Parameters) -> Algebraic:
    return p[INPUT]


def _intervals(
    impacts: Impacts, flow: Flow, x: np.ndarray, times: np.ndarray, force: float
) -> tuple[list[_Stage], list[np.ndarray]]:
    """The stages of a phase from a state to the first time, and between times, and the states at these times; the force
    is counted in this unit."""
    seeds, stages, states, before = np.zeros((len(impacts.p), flow.size + 1)), list[_Stage](), list[np.ndarray](), 0.0
    seeds[list(impacts.values).index(INPUT), -1] = force
    start = np.eye(flow.size, flow.size + 1)
    for time in times.tolist():
        interrupts.heed()
        path, change = flow.run(x, impacts.p, time - before, seeds=start, parameter_seeds=seeds)
        x, before = path.end[: flow.size], time
        stages.append(_Stage(change[:, :-1], change[:, -1]))
        states.append(x)
    return stages, states


def _regulator(stages: list[_Stage], effort: float, landing: float) -> tuple[list[np.ndarray], np.ndarray]:
    """The gains of the stages with a force, and the matrix (d, d) of a cycle with them; raises `NoOrbit` where the
    force does not reach what grows."""
    size = stages[0].carry.shape[1]
    cost, last = np.eye(size), np.inf
    for _ in range(HOLDING.cycles):
        interrupts.heed()
        gains, matrix = list[np.ndarray](), np.eye(size)
        weights = np.eye(size) + cost
        for carry, effect, gap in reversed(stages):
            if effect is not None:
                gain = effect @ weights @ carry / (effort + effect @ weights @ effect)
                gains.insert(0, gain)
                weights = carry.T @ weights @ (carry - np.outer(effect, gain))
                matrix = matrix @ (carry - np.outer(effect, gain))
            else:
                weights, matrix = carry.T @ weights @ carry, matrix @ carry
            if gap is not None:
                weights += landing * np.outer(gap, gap)
        cost = 0.5 * (weights + weights.T)
        if abs((largest := np.abs(cost).max()) - last) <= HOLDING.settled * largest:
            return gains, matrix
        if largest > HOLDING.largest_cost:
            break
        last = largest
    raise NoOrbit("the force does not reach all that grows, and no feedback along this extension holds the orbit")


def _by_modulus(matrix: np.ndarray) -> Any:
    values = np.linalg.eigvals(matrix)
    return values[np.lexsort((-values.imag, -np.abs(values).round(12)))]
