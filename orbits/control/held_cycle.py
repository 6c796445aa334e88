"""The cycle that a feedback holds, in pieces between instants, with the growth of small changes along it.

At a fixed time after lift-off the state depends smoothly on the launch, although the time of a tangential landing does
not: such a landing is a projection (`tangential_landing`). At a landing with a speed the state at a fixed time has the
derivative of the impact and of the shift of its time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..errors import InputError
from ..flow import Flow, Trajectory
from ..hops import Impacts, LaunchSection, tangential_landing, through_contact
from ..running import interrupts
from ..units import TIME, Message, Quantity, Units
from .regulator import Piece

# (flight states (k, n), inputs (k,)) -> the force and the speed (k,) of the actuator, whose product is its power.
Effects: TypeAlias = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class CycleOptions(NamedTuple):
    """The tolerances of a cycle, and the samples along it."""

    together: float = 1e-9  # instants closer than this share of the period are one, as in a simulation
    samples: int = 33  # of a piece, at which its force and speed are taken
    tangential: float = 1e-6  # a landing slower than this share of the fastest state is tangential
    ahead: float = 0.1  # of a period, for which motions are expanded in time
    newton: int = 8  # steps to where the gap does not accelerate


CYCLE = CycleOptions()


@dataclass(frozen=True)
class Cycle:
    """A cycle to be held, from lift-off to lift-off; all numbers are without units.

    machine : with the input among its parameters
    name : of the input
    start : flight state (n,) at lift-off
    flight, contact : durations
    times, inputs : (k + 1,) since lift-off and (k,), the input along the cycle
    kind : "force", that is the input; or "force's rate" or "displacement's rate", of the last state of an actuator
    units, unit : sizes of the cycle, and that of the input
    effects : (states (k, n), inputs (k,)) -> the force and the speed (k,) of the actuator
    """

    machine: Any
    name: str
    start: np.ndarray
    flight: float
    contact: float
    times: np.ndarray
    inputs: np.ndarray
    kind: str
    units: Units
    unit: float
    effects: Effects

    @property
    def period(self) -> float:
        """Flight and contact together."""
        return self.flight + self.contact

    def input_after(self, time: float) -> float:
        """The input from a time on."""
        i = int(np.searchsorted(self.times, time + CYCLE.together * self.period, side="right")) - 1
        return float(self.inputs[i]) if 0 <= i < len(self.inputs) else 0.0


class Plan(NamedTuple):
    """The instants of a feedback.

    times : (k + 1,), since lift-off: of the measurements and the changes of inputs, of lift-off and of landing
    landing : the place among these of the landing
    measured, begins, ends : (N,), the places of each input's measurement, its begin and its end
    """

    times: np.ndarray
    landing: int
    measured: np.ndarray
    begins: np.ndarray
    ends: np.ndarray

    def acts(self, piece: int) -> int:
        """The number of the input that acts in a piece, -1 for none."""
        found = np.flatnonzero((self.begins <= piece) & (piece < self.ends))
        return int(found[0]) if len(found) else -1

    def needed(self, cycle: Cycle) -> list[int]:
        """The places of the instants at which something is measured or changes: a flight that is cut where it lands on
        the cycle itself would begin again with a gap that is rounding."""
        inputs = [cycle.input_after(time) for time in self.times.tolist()]
        own = {0, len(self.times) - 1, *self.measured.tolist(), *self.begins.tolist(), *self.ends.tolist()}
        return [j for j in range(len(self.times)) if j in own or inputs[j] != inputs[j - 1]]


DECISIONS = ("continuous", "lift-off", "apex")


def planned(cycle: Cycle, when: str, parts: int, delay: float, share: tuple[float, float]) -> Plan:
    """The plan of a feedback in `parts` intervals of each phase, between shares of it; raises `InputError` where a
    delay is too long."""
    flight, contact = cycle.flight, cycle.contact
    first, last = share
    opening = max(first * flight, 0.5 * flight + delay) if when == "apex" else first * flight
    ends = [np.linspace(opening, last * flight, parts + 1), flight + contact * np.linspace(first, last, parts + 1)]
    begins, closes = np.concatenate([e[:-1] for e in ends]), np.concatenate([e[1:] for e in ends])
    measured = {"continuous": begins - delay, "lift-off": 0.0 * begins, "apex": 0.0 * begins + 0.5 * flight}[when]
    longest = {"continuous": begins[0], "lift-off": begins[0], "apex": (last - 0.5) * flight}[when]
    if delay < 0:
        raise InputError(Message("delay = {delay:g}; it must be at least 0", delay=Quantity(delay, TIME)))
    if delay > longest * (1 - CYCLE.together) and delay > 0:
        text = "delay = {delay:g}; it must be at most {longest:g}, the time from a measurement to its first input"
        raise InputError(Message(text, delay=Quantity(delay, TIME), longest=Quantity(float(longest), TIME)))
    wanted = np.sort(np.concatenate([[0.0, flight, cycle.period], cycle.times, begins, closes, measured]))
    apart, least = [0.0, flight, cycle.period], CYCLE.together * cycle.period
    for time in wanted.tolist():
        if 0 <= time <= cycle.period and min(abs(time - each) for each in apart) > least:
            apart.append(time)
    times = np.array(sorted(apart))
    places = (np.abs(times - each[:, None]).argmin(1) for each in (np.array([flight]), measured, begins, closes))
    landing, *own = places
    return Plan(times, int(landing[0]), *own)


class Linearised(NamedTuple):
    """A cycle with what becomes of small changes.

    names : of the numbers of a launch, with those of the actuator
    pieces : as `regulator` takes them
    states : (k + 1, n), flight states at the instants of the plan
    series : (k, n, K + 1), their Taylor coefficients from each of these on
    steps : (k,), the times up to which these are accurate
    force, speed : (k, m), those of the actuator at m samples between each two instants
    flown : arrays (n, n + 1), of each piece of the flight, the derivatives of its end by the state and by the input
    """

    names: tuple[str, ...]
    pieces: list[Piece]
    states: np.ndarray
    series: list[np.ndarray]
    steps: np.ndarray
    force: np.ndarray
    speed: np.ndarray
    flown: list[np.ndarray]


class Launches(NamedTuple):
    """The launches of a cycle with an actuator: the places of their numbers among the contact states, and of the one
    that follows from these; their names and units."""

    free: list[int]
    bound: int
    names: tuple[str, ...]
    unit: np.ndarray

    @classmethod
    def of(cls, impacts: Impacts, units: Units) -> "Launches":
        section, states = LaunchSection(impacts, units), impacts.contact.phase.states
        ends = [i for i, name in enumerate(states) if f"{name}'" not in states and not name.endswith("'")]
        places = [section.places[name] for name in section.names]
        own = [i for i in ends if i not in (*places, section.places[section.dependent])]
        unit = np.append(section.unit, units.of_states([states[i] for i in own]))
        return cls(
            [*places, *own], section.places[section.dependent], (*section.names, *(states[i] for i in own)), unit
        )

    def moved(self, impacts: Impacts, y: np.ndarray, change: np.ndarray) -> np.ndarray:
        """The contact state (k,) of a launch that differs from one (k,) by this change (d,) of its numbers in their
        units."""
        found = y + self.tangent(impacts.force_gradient(y)) @ change
        for _ in range(CYCLE.newton):
            gradient, force = impacts.force_slope(found, impacts.contact.data(found[None], impacts.p)[0])
            found[self.bound] -= float(force) / float(gradient[self.bound])
        return found

    def tangent(self, gradient: np.ndarray) -> np.ndarray:
        """The derivative (k, d) of the contact state by these numbers, where the contact force has this gradient."""
        tangent = np.zeros((len(gradient), len(self.free)))
        tangent[self.free, range(len(self.free))] = 1.0
        tangent[self.bound] = -gradient[self.free] / gradient[self.bound]
        return tangent * self.unit


def linearised(cycle: Cycle, plan: Plan) -> Linearised:
    """The pieces of a cycle; raises the errors of the flow, and of landings."""
    runs = Runs(cycle)
    first = runs.impacts(0)
    launches = Launches.of(first, cycle.units)
    model, x = first.model, cycle.start
    y = first.onto_contact @ x
    tangent = launches.tangent(first.force_gradient(y))
    pieces, states = [Piece(model.embed @ tangent)], [x]
    series, steps, sampled, flown = list[np.ndarray](), list[float](), list[np.ndarray](), list[np.ndarray]()
    decided = [tuple(np.flatnonzero(plan.measured == j).tolist()) for j in range(len(plan.times))]
    for j in range(len(plan.times) - 1):
        interrupts.heed()
        a, b, acts, gap = plan.times[j], plan.times[j + 1], plan.acts(j), None
        impacts, down, last = runs.impacts(a), j >= plan.landing, j + 2 == len(plan.times)
        flow = impacts.contact if down else impacts.flight
        here = y if down else x
        begun, size = runs.series(flow, impacts, here)
        series.append(model.embed @ begun if down else begun)
        steps.append(size)
        path, found, effect = runs.through(flow, impacts, here, b - a)
        sampled.append(runs.effects(model.embed if down else np.eye(len(x)), path, b - a, cycle.input_after(a)))
        end = path.end[: flow.size]
        if not down:
            flown.append(np.column_stack([found, effect]))
        if last:
            y, change = through_contact(impacts, here, np.eye(len(here)), grazes=False)
            pieces.append(Piece(change[launches.free] / launches.unit[:, None], decides=decided[j]))
            break
        if j + 1 == plan.landing:
            y, step, gap = runs.landed(impacts, here, b - a, end, found)
        else:
            step, (x, y) = found, (x, end) if down else (end, y)
        states.append(model.embed @ y if down or j + 1 == plan.landing else x)
        pieces.append(Piece(step, effect if acts >= 0 else None, acts, decided[j], gap))
    states.append(model.embed @ y)
    force, speed = np.swapaxes(np.array(sampled), 0, 1)
    return Linearised(launches.names, pieces, np.array(states), series, np.array(steps), force, speed, flown)


class Runs:
    """Motions along a cycle, by the input in force."""

    def __init__(self, cycle: Cycle):
        self.cycle = cycle

    def impacts(self, time: float, change: float = 0.0) -> Impacts:
        """The impacts from a time on, with a change of the input."""
        machine, value = self.cycle.machine, self.cycle.input_after(time) + change
        return Impacts(machine, {**machine.values, self.cycle.name: value})

    def series(self, flow: Flow, impacts: Impacts, x: np.ndarray) -> tuple[np.ndarray, float]:
        """The Taylor coefficients (n, K + 1) of the motion from a state, and the time up to which they are accurate."""
        path, _ = flow.run(x, impacts.p, CYCLE.ahead * self.cycle.period)
        return path.coefficients[0, : flow.size], float(path.steps[0])

    def through(
        self, flow: Flow, impacts: Impacts, x: np.ndarray, time: float
    ) -> tuple[Trajectory, np.ndarray, np.ndarray]:
        """The motion from a state for a time, and the derivatives of its end by the state and the input in its unit."""
        seeds = np.zeros((len(impacts.p), flow.size + 1))
        seeds[list(impacts.values).index(self.cycle.name), -1] = self.cycle.unit
        start = np.eye(flow.size, flow.size + 1)
        path, change = flow.run(x, impacts.p, time, seeds=start, parameter_seeds=seeds)
        return path, change[:, :-1], change[:, -1]

    def flight(self, x: np.ndarray, times: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """The state (n,) after a flight between times (k + 1,) with these changes (k,) of the input."""
        for a, b, change in zip(times, times[1:], changes, strict=False):
            impacts = self.impacts(a, change)
            x = impacts.flight.run(x, impacts.p, b - a)[0].end[: impacts.flight.size]
        return x

    def closing(self, x: np.ndarray) -> np.ndarray:
        """The gap and its speed (2,) where its acceleration vanishes, in the units of the cycle: from a flight state
        near a tangential landing, where both are 0."""
        impacts, units = self.impacts(self.cycle.flight), self.cycle.units
        path, _ = impacts.flight.run(x, impacts.p, CYCLE.ahead * self.cycle.period)
        gap = impacts.feet[-1].gap.series(path.coefficients)[0]
        orders, time = np.arange(len(gap)), 0.0
        for _ in range(CYCLE.newton):
            second, third = (
                np.prod([orders - i for i in range(n)], axis=0) @ (gap * time ** np.maximum(orders - n, 0))
                for n in (2, 3)
            )
            time -= second / third
        first = (orders * gap) @ time ** np.maximum(orders - 1, 0)
        return np.array([gap @ time**orders, first * units.time]) / units.of("gap")

    def effects(self, embed: np.ndarray, path: Trajectory, time: float, value: float) -> np.ndarray:
        """Samples of the force and the speed (2, m) of the actuator along a motion with an input."""
        rows = path(np.linspace(0.0, time, CYCLE.samples))[:, : embed.shape[1]] @ embed.T
        return np.array(self.cycle.effects(rows, np.full(CYCLE.samples, value)))

    def landed(
        self, impacts: Impacts, x: np.ndarray, time: float, end: np.ndarray, change: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The contact state after the landing that ends a flight from a state, its derivative at that fixed time, and
        those of the gap and its speed there, where the landing is tangential."""
        foot = impacts.feet[-1]
        gap, speed, units = np.array(foot.gap.weights) @ change, float(foot.speed @ end), self.cycle.units
        if abs(speed) <= CYCLE.tangential * np.abs(end).max():
            closing = np.array([gap / units.of("gap"), foot.speed @ change * (units.time / units.of("gap"))])
            return *tangential_landing(impacts, (x, np.eye(len(x))), time, end, foot), closing
        (held,), (after,), *_ = impacts.landing(end[None])
        if not held:
            raise InputError("the cycle bounces as it lands, but a feedback can hold only cycles of one landing")
        y = impacts.onto_contact @ after
        before, later = (
            impacts.flight.rates(end, impacts.flight.data(end[None], impacts.p)[0]),
            impacts.contact.rates(y, impacts.contact.data(y[None], impacts.p)[0]),
        )
        at_landing = change - np.outer(before, gap) / speed
        moved = np.stack([impacts.change_after(end, each, 1.0).full().ravel() for each in at_landing.T], axis=1)
        return y, impacts.onto_contact @ moved + np.outer(later, gap) / speed, np.zeros((0, len(x)))
