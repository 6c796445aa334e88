"""Feedback that holds an orbit: inputs that are constant in parts of each cycle, decided at lift-off by the launch.

An unstable lossless orbit is one that a machine leaves, by the multipliers outside the unit circle. A force between two
of its parts, as the torque of a motor at the hip, brings it back: with the launch y at lift-off, counted from that of
the orbit, a cycle leads to A y + B u, where the columns of B are the effects of the inputs u of the cycle. The gain K of
u = -K y minimises the sum of |y|^2 + r |u|^2 over all cycles to come (the linear quadratic regulator of the map of
launches). On the orbit itself u = 0: the feedback costs nothing there.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_are

from ..errors import InputError, NoOrbit, finite_number
from ..io import Document
from ..laws.law import Algebraic, Parameters
from ..mechanics.elements import Force
from ..mechanics.mechanism import Mechanism
from ..periodic.orbit import Orbit
from ..result import Result, Row, stored
from ..running.exclusive import exclusive
from ..simulation.impacts import Impacts
from ..simulation.launch_section import LaunchSection
from ..simulation.multiplier import hop_derivative, through_contact
from ..simulation.multipliers import derivative_of_hops

INPUT = "hold"  # the parameter of the force that holds an orbit
# Each input acts in the middle of its phase, so that take-off and landing are those of the machine without it.
BEGINS, ENDS = 0.25, 0.75
# A direction of a multiplier that the inputs change by less than this, relative to the others, is out of their reach.
OUT_OF_REACH = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Hold(Result, what="feedback", in_line=("along",), document_is_whole=True):
    """A feedback that holds an orbit, to be passed to `simulate(held.machine, launch, feedback=held)`.

    machine : that of the orbit with the force "hold" along the extension
    along : the extension along which the inputs act
    names : of the numbers of a launch (d,)
    launch : (d,), that of the orbit
    times : (4,), since lift-off, between which the inputs of the flight, none, and those of the contact act
    gain : (2, d), inputs per change of the launch, with the opposite sign
    matrix, effects : (d, d) and (d, 2), the derivatives of the next launch by the launch and by the inputs
    """

    machine: Mechanism
    along: str
    names: tuple[str, ...]
    launch: np.ndarray
    times: np.ndarray
    gain: np.ndarray
    matrix: np.ndarray
    effects: np.ndarray

    @property
    def multipliers(self) -> np.ndarray:
        """The multipliers (d,) of the orbit without the feedback, by falling modulus."""
        return _by_modulus(self.matrix)

    @property
    def held_multipliers(self) -> np.ndarray:
        """The multipliers (d,) with the feedback, by falling modulus."""
        return _by_modulus(self.matrix - self.effects @ self.gain)

    def inputs(self, launch: np.ndarray) -> dict[str, np.ndarray]:
        """The values (3,) of the force between the `times` of the cycle that begins with a launch (d,)."""
        flight, contact = -self.gain @ (launch - self.launch)
        return {INPUT: np.array([flight, 0.0, contact])}

    def title(self) -> str:
        return f"feedback along {self.along} that holds an orbit of {self.machine!r}"

    def heads(self) -> list[str]:
        return ["multiplier", "modulus", "with the feedback", "modulus with the feedback"]

    def _rows(self) -> Iterator[Row]:
        for i, (own, held) in enumerate(zip(self.multipliers, self.held_multipliers, strict=True)):
            values = {f"modulus {i}": abs(own), f"held {i}": f"{held:.6g}", f"held modulus {i}": abs(held)}
            yield Row(f"{own:.6g}", values, ("{:.6g}", "{}", "{:.6g}"))

    def document(self) -> Document:
        return {**stored(self), "machine": self.machine.describe()}


@exclusive
def hold(orbit: Orbit, along: str, *, effort: float = 1.0) -> Hold:
    """A feedback that holds an orbit by a force along an extension, constant in the middle half of each phase.

    orbit : of a `Mechanism` whose launch is more than a speed, such as a runner
    along : a formula of the coordinates, as "phi - theta" of a hip, whose rate times the force is its power
    effort : the weight r of the inputs' squares against those of the launch's changes

    Raises `NoOrbit` where the force does not reach what grows, and `InputError` for other machines.
    """
    machine, weight = orbit.source, finite_number("effort", effort)
    if not isinstance(machine, Mechanism) or machine.model.one_speed or machine.model.changes_contact:
        raise InputError(f"hold takes orbits of mechanisms whose launch is more than a speed, not of a {machine!r}")
    if not weight > 0:
        raise InputError(f"effort = {weight:g}; it lies above 0")
    if INPUT in machine.names:
        raise InputError(f"'{INPUT}' is the name of the input, and a parameter of the machine: rename it")
    driven = replace(
        machine,
        elements=[*machine.elements, Force(along, _input)],
        reversor=None,
        parameters={**machine.parameters, INPUT: 0.0},
    )
    impacts = Impacts(driven)
    section = LaunchSection(impacts)
    y = section.launch(orbit)
    cycle = derivative_of_hops(section, y, 1, 0.0)
    if orbit.contact_time is None or not all(hop.tangential for hop in cycle.hops):
        raise InputError("hold takes lossless orbits")
    flight, contact = orbit.flight_time, orbit.contact_time
    times = np.array([BEGINS * flight, ENDS * flight, flight + BEGINS * contact, flight + ENDS * contact])
    landed = np.array(machine.model.contact_reversal.image(y.tolist(), machine.values), dtype=float)
    effects = section.free(np.stack(_effects(impacts, y, landed, flight, contact)))
    gain = _regulator(cycle.matrix, effects.T, weight)
    return Hold(driven, along, section.names, section.free(y), times, gain, cycle.matrix, effects.T)


def _input(y: Parameters, v: Parameters, p: Parameters) -> Algebraic:
    return p[INPUT]


def _effects(
    impacts: Impacts, y: np.ndarray, landed: np.ndarray, flight: float, contact: float
) -> tuple[np.ndarray, np.ndarray]:
    """The derivatives (k,) of the next launch, a contact state, by the inputs in flight from a launch and in
    contact from a landing, (k,) both."""
    x = impacts.model.embed @ y
    of_flight = hop_derivative(impacts, x, _as_change(impacts.flight, x, impacts, flight)).derivative[:, 0]
    change = _as_change(impacts.contact, landed, impacts, contact)
    return of_flight, through_contact(impacts, landed, change, grazes=True)[1][:, 0]


def _as_change(flow: Any, start: np.ndarray, impacts: Impacts, lasts: float) -> np.ndarray:
    """The change (n, 1) of the state at the start of a phase that has the effect of an input in its middle."""
    p, seeds = impacts.p, np.zeros((len(impacts.p), 1))
    seeds[list(impacts.values).index(INPUT)] = 1.0
    before, first = flow.run(start, p, BEGINS * lasts, seeds=np.eye(flow.size))
    still = np.zeros((flow.size, 1))
    _, moved = flow.run(before.end[: flow.size], p, (ENDS - BEGINS) * lasts, seeds=still, parameter_seeds=seeds)
    _, later = flow.run(before.end[: flow.size], p, (ENDS - BEGINS) * lasts, seeds=first)
    return np.linalg.solve(later, moved)


def _regulator(matrix: np.ndarray, effects: np.ndarray, effort: float) -> np.ndarray:
    """The gain (k, d) of the linear quadratic regulator; raises `NoOrbit` where there is none."""
    values, vectors = np.linalg.eig(matrix.T)
    reach = np.abs(vectors.T @ effects).max(1) / np.abs(effects).max()
    if (lost := (np.abs(values) > 1 - OUT_OF_REACH) & (reach < OUT_OF_REACH)).any():
        raise NoOrbit(f"the force does not change what grows with the multiplier {values[lost][0]:.6g}: no gain holds it")
    cost = solve_discrete_are(matrix, effects, np.eye(len(matrix)), effort * np.eye(effects.shape[1]))
    return np.linalg.solve(effort * np.eye(effects.shape[1]) + effects.T @ cost @ effects, effects.T @ cost @ matrix)


def _by_modulus(matrix: np.ndarray) -> np.ndarray:
    values = np.linalg.eigvals(matrix)
    return values[np.lexsort((-values.imag, -np.abs(values).round(12)))]
