"""Feedback that holds a cycle: inputs that are constant in parts of each cycle, decided from measured states.

A machine leaves its cycle: an unstable one by its multipliers outside the unit circle, and a lossless hop because
launches with less energy lose more and more. A force between two parts of the machine, or another actuator, brings it
back. Flight and contact each have some intervals in which the input changes by a constant u. It is decided from the
state x at an earlier instant: u = -K (x - x*), where x* is the state of the cycle at the same time after lift-off. The
gains K are those of the linear quadratic regulator of the cycle (`regulator`). All quantities are measured in sizes of
the cycle: the highest gap, the period over 2 pi, and the mean contact force, which is the weight.

A faster launch takes longer, so at the end of a hop x - x* is mostly a shift of time. A shifted cycle is a cycle too
and needs no further input. So x is compared with the nearest state x*(t + s) of the cycle, and K x*' s is added, which
vanishes in this case. To first order the result is the same; beyond it, the nearest state leaves out the square of the
shift.

A landing loses the power 4/3 of the remaining gap, which for a large gap is more than a linear feedback gives back. So
inputs that are decided once for a whole flight make the flight end in a tangential landing, unless the launch is too
far off: Newton's method on the flight finds them from the inputs of the regulator (`landing_softly`). What the launch
lacks is then added in contact.

Inputs are cut to the limits of the actuator. On the cycle itself u = 0, so the feedback costs nothing there.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, cast

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, finite_number, whole_number
from ..io import one_line
from ..laws import Algebraic, Parameters
from ..mechanics import Force, Mechanism, names_in, value_of
from ..periodic import Orbit
from ..result import Progress
from ..running import exclusive
from ..symbolic import suggest
from ..units import LENGTH, TIME, Units
from .held_cycle import DECISIONS, Cycle, Effects, Linearised, Plan, Runs, linearised, planned
from .held_launches import HeldLaunches, by_modulus, held_launches, simulated_multipliers
from .held_limits import HeldLimits, Room, refuse_what_the_cycle_exceeds, room_of
from .regulator import cycle_with, landing_softly, regulator

INPUT = "hold"  # the parameter of the force that holds an orbit


class HoldOptions(NamedTuple):
    """The intervals of a feedback, and the search for the nearest state of its cycle."""

    # The shares of each phase between which its intervals lie, so that lift-off and landing are without the input.
    begins: float = 0.1
    ends: float = 0.9
    most_parts: int = 1000  # intervals of a phase
    instants: int = 201  # of a cycle by which its sizes are measured
    landing: float = 200.0  # the weight of the gap at landing, and that where a launch is more than its speed
    landing_of_several: float = 20.0
    margin: float = 1.2  # by which disturbed motions may be faster, and springs harder, than the cycle
    longest: float = 2.0  # of a cycle, as a multiple of that which is held
    landings: int = 12  # Newton's steps to the inputs of a whole flight that lands softly
    softly: float = 1e-8  # the gap and its speed at such a landing, in sizes of the cycle
    newton: int = 12  # steps to the nearest state
    reach: float = 4.0  # of the nearest state in time, in steps of the flow


HOLDING = HoldOptions()


@dataclass(frozen=True, eq=False, repr=False)
class Hold:
    """A feedback that holds a cycle, to be passed to `simulate(held.machine, launch, feedback=held)`.

    machine : the machine to simulate, with an actuator or with the force `name` along an extension; without feedback
        its input is that of the cycle
    along, name : the extension along which it acts, and the parameter that is its input
    when, delay : of the decisions, as in `hold`
    names : of the numbers of a launch (d,), and of the actuator
    plan : the instants of a cycle
    cycle : what is held
    states : (k + 1, n), the flight states of the cycle at these instants
    series, steps : their Taylor coefficients (k, n, K + 1), and the times up to which these are accurate
    gains, mixed : (N, n) and (N, N), the change of an input per change of the measured state, and per change of the
        inputs decided before, with the opposite sign
    sizes : (n,), the units in which a state is compared with the nearest one of the cycle
    limits, bare_limits, room : the limits of the actuator in the machine's units and without dimensions, and the bounds
        of its input
    multipliers, held_multipliers : (d,) without and with the feedback, by falling modulus
    slopes : (2, N') of the gap and its speed at landing by the inputs in flight, where these are decided at once

    Instants, states and gains are without units.
    """

    machine: Any
    along: str
    when: str
    delay: float
    names: tuple[str, ...]
    plan: Plan
    cycle: Cycle
    states: np.ndarray
    series: tuple[np.ndarray, ...]
    steps: np.ndarray
    gains: np.ndarray
    mixed: np.ndarray
    sizes: np.ndarray
    limits: HeldLimits
    bare_limits: HeldLimits
    room: Room
    multipliers: np.ndarray
    held_multipliers: np.ndarray
    slopes: np.ndarray | None = None

    @property
    def name(self) -> str:
        """The parameter that is the input."""
        return self.cycle.name

    @cached_property
    def _needed(self) -> list[int]:
        return self.plan.needed(self.cycle)

    @property
    def times(self) -> np.ndarray:
        """The instants since lift-off at which something is measured or changes. The last input acts up to the next
        lift-off, which on the cycle is at the last instant: rounding would decide the end of a contact that is cut
        there."""
        times = self.plan.times[self._needed]
        return np.append(times[:-1], HOLDING.longest * times[-1])

    def measured(self, state: np.ndarray) -> np.ndarray:
        """The flight state (n,) as it is measured, without noise."""
        return state

    def input(self, index: int, states: Mapping[int, np.ndarray]) -> float:
        """The input from one instant to the next, from the flight states (n,) measured so far."""
        place = self._needed[index]
        here, acts = self.cycle.input_after(float(self.plan.times[place])), self.plan.acts(place)
        if acts < 0:
            return here
        return here + float(self.decided(acts, {self._needed[i]: state for i, state in states.items()})[acts])

    def decided(self, last: int, states: Mapping[int, np.ndarray]) -> np.ndarray:
        """The changes (N,) of inputs up to the last of these numbers, from the measured states.

        Inputs of a flight that are decided at once are found together.
        """
        found, together = np.zeros(len(self.gains)), 0 if self.slopes is None else self.slopes.shape[1]
        for i in range(max(last + 1, together)):
            off, shift, rate = self.off(int(self.plan.measured[i]), states)
            change = -self.gains[i] @ (off + shift * rate) - self.mixed[i] @ found
            found[i] = self._cut(i, float(change), states) if i <= last else float(change)
        if self.slopes is None:
            return found
        found = _landed_softly(self, found.tobytes(), states[int(self.plan.measured[0])].tobytes()).copy()
        found[last] = self._cut(last, float(found[last]), states)
        return found

    def _cut(self, i: int, change: float, states: Mapping[int, np.ndarray]) -> float:
        """A change of an input within the limits, by the state measured as it begins."""
        begin = int(self.plan.begins[i])
        off = float(states[begin][-1] - self.states[begin, -1]) if self.cycle.kind != "force" else 0.0
        return self.room.cut(i, change, self.plan, self.states[:, -1], off)

    def off(self, instant: int, states: Mapping[int, np.ndarray]) -> tuple[np.ndarray, float, np.ndarray]:
        """The difference (n,) of a state from the nearest one of the cycle, how much later that one is than the
        instant, and the rates (n,) there."""
        state, series, squares = states[instant], self.series[instant], self.sizes**2
        most = HOLDING.reach * float(self.steps[instant])
        orders, shift = np.arange(series.shape[1]), 0.0
        for _ in range(HOLDING.newton):
            powers = shift**orders
            rate = series[:, 1:] @ (orders[1:] * powers[:-1])
            step = float(squares * rate @ (state - series @ powers)) / float(squares * rate @ rate)
            shift, before = float(np.clip(shift + step, -most, most)), shift
            if abs(shift - before) <= 1e-12 * most:
                break
        return state - series @ shift**orders, shift, series[:, 1]

    def launches(
        self, errors: ArrayLike = (-0.05, -0.01, 0.01, 0.05), *, hops: int = 10, noise: float = 0.0, seed: int = 0,
        within: float = 1e-3, progress: Progress = None,
    ) -> HeldLaunches:  # fmt: skip
        """Simulate launches that are off the cycle, with the limits and the delay: which come back, and at what cost.

        errors : (m,), relative errors of the launch speed
        hops : the number of lift-offs of each
        noise : the standard deviation of the measurement of each state, as a share of its range in the cycle
        seed : of the noise
        within : the relative error of the launch speed below which a launch has come back
        progress : called with the completed share

        >>> from orbits import find
        >>> from orbits.control import hold
        >>> from problems import Hopper
        >>> hold(find(Hopper()), "y1 - y2", force=1.0).launches([-0.02, 0.02], hops=5).share
        1.0
        """
        return held_launches(self, errors, hops, noise, seed, within, progress)

    def simulated_multipliers(self, step: float = 1e-7) -> np.ndarray:
        """The multipliers (d,) of the simulated cycle, by differences of launches, extrapolated to a difference of 0.

        step : the largest change of a number of the launch, in sizes of the cycle. A change h loses h**(4/3) at a
            tangential landing, so that differences have errors in h**(1/3) and h**(2/3), which the extrapolation
            removes
        """
        return simulated_multipliers(self, step)

    def __str__(self) -> str:
        """The moduli of the multipliers without and with the feedback, and the limits."""
        pairs = zip(np.abs(self.multipliers), np.abs(self.held_multipliers), strict=True)
        moduli = [f"  modulus {own:.6g}, with the feedback {held:.6g}" for own, held in pairs]
        title = f"feedback along {self.along} that holds a cycle of a {self.machine.model.name}"
        units = self.machine.units
        second, unit = (1.0, "") if units is None else (units.of(TIME), " s")
        late = f", {self.delay * second:g}{unit} after the measurement" if self.delay else ""
        decided = {"continuous": "as each interval begins"}.get(self.when, f"at {self.when}")
        limits = ", ".join(f"{name} {bound}" for name, bound in self.limits.stated().items())
        notes = [f"  decided {decided}{late}", *([f"  limits: {limits}"] if limits else [])]
        if not self.cycle.inputs.any():
            notes.append("  on the cycle itself the input is 0, and the feedback costs nothing")
        return "\n".join([title, *moduli, *notes])

    def __repr__(self) -> str:
        return one_line(self, {"machine": self.machine.model.name, "along": self.along, "when": self.when})


@lru_cache(maxsize=64)
def _landed_softly(held: Hold, changes: bytes, measured: bytes) -> np.ndarray:
    """Changes (N,) of inputs, those in flight such that it ends in a tangential landing beyond what is linear, by
    Newton's method with the slopes of the cycle; where that fails, the best that is found."""
    m, n = int(held.plan.measured[0]), held.plan.landing
    state, slopes = np.frombuffer(measured), cast(np.ndarray, held.slopes)
    runs, acts, inverse = Runs(held.cycle), [held.plan.acts(j) for j in range(m, n)], np.linalg.pinv(slopes)
    u = np.frombuffer(changes).copy()
    best, least = u, np.inf
    for _ in range(HOLDING.landings):
        own = np.array([u[i] if i >= 0 else 0.0 for i in acts])
        missed = runs.closing(runs.flight(state, held.plan.times[m : n + 1], own))
        if not (size := float(np.abs(missed).max())) < least:
            break
        best, least, u = u, size, u.copy()
        if size <= HOLDING.softly:
            break
        u[: slopes.shape[1]] -= inverse @ missed
        u = np.clip(u, held.room.low, held.room.high)
    return best


@exclusive
def hold(
    orbit: Orbit, along: str, *, when: str = "continuous", parts: int = 3, effort: float = 0.05,
    landing: float | None = None, delay: float = 0.0, force: float = np.inf, power: float = np.inf,
    speed_force: tuple[float, float] | None = None,
) -> Hold:  # fmt: skip
    """A feedback that holds a lossless orbit by a force along an extension.

    orbit : of a machine with a reversor that stands on one foot, such as a hopper, a `Chain` or a runner, or whose feet
        stick, such as a walker
    along : a formula of the coordinates, such as "phi - theta" of a hip; its rate times the force is the power. The
        labels of legs change as a foot lands: "lean + angle" is the leg of a walker that has landed last
    when : when the force is decided: "continuous", at the beginning of each interval; at "lift-off"; or at the "apex",
        in the middle of the flight, for the rest of the cycle
    parts : the number of intervals in each phase; the force is constant in each interval
    effort : the weight r of the squared force, relative to that of the squared change of the launch, both in units of
        the orbit: its highest gap, its period over 2 pi and its mean contact force
    landing : the weight of the squares of the gap and its speed where the foot should land, since a landing loses the
        power 4/3 of that gap. By default 200, or 20 where a launch has several numbers
    delay : the time from a measurement to the force that it decides; the multipliers do not depend on it
    force, power, speed_force : limits of the force, its power, and its force by its speed, see `HeldLimits`

    Raises `NoOrbit` where the force does not affect every growing change, and `InputError` for other machines.

    >>> from orbits import find, simulate
    >>> from orbits.control import hold
    >>> from problems import Hopper, runner
    >>> run = find(runner(), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})
    >>> held = hold(run, "phi - theta")
    >>> round(float(abs(held.multipliers[0])), 4), bool(abs(held.held_multipliers[0]) < 1)
    (14.2953, True)
    >>> held = hold(find(Hopper()), "y1 - y2", when="lift-off", force=1.0)
    >>> back = simulate(held.machine, {"alpha": 4.6, "liftoff": 1.0}, hops=6, feedback=held)
    >>> bool(abs(back.launches[-1] - 4.493409) < 1e-6)
    True
    """
    limits = HeldLimits(force=force, power=power, speed_force=speed_force)
    orbit = _stated_orbit(orbit)
    machine = _driven(orbit, along)
    units = _own_units(orbit, machine)
    flight, contact = float(orbit.flight_time), float(orbit.contact_time or 0.0)
    cycle = Cycle(
        machine, INPUT, orbit(0.0), flight, contact, np.array([0.0, flight + contact]), np.zeros(1), "force", units,
        units.of(machine.dimension_of_force(along)), _effects_along(machine, along),
    )  # fmt: skip
    return hold_cycle(cycle, machine, along, limits, limits, when=when, parts=parts, effort=effort, landing=landing,
                      delay=delay)  # fmt: skip


@exclusive
def hold_cycle(
    cycle: Cycle, machine: Any, along: str, limits: HeldLimits, bare: HeldLimits, *, when: str = "continuous",
    parts: int = 3, effort: float = 0.05, landing: float | None = None, delay: float = 0.0,
) -> Hold:  # fmt: skip
    """The feedback that holds a cycle of a machine, with limits in its units and without; otherwise as `hold`."""
    parts, delay = whole_number("parts", parts, "intervals", most=HOLDING.most_parts), finite_number("delay", delay)
    if landing is None:
        landing = HOLDING.landing if cycle.machine.model.one_speed else HOLDING.landing_of_several
    if not (finite_number("effort", effort) > 0 and finite_number("landing", landing) >= 0):
        raise InputError(f"effort = {effort:g}, landing = {landing:g}; effort must be above 0, landing at least 0")
    if when not in DECISIONS:
        raise InputError(f"when = {when!r}; it must be one of {', '.join(map(repr, DECISIONS))}")
    plan = planned(cycle, when, parts, delay, (HOLDING.begins, HOLDING.ends))
    found, count = linearised(cycle, plan), len(plan.begins)
    refuse_what_the_cycle_exceeds(cycle, found, limits, bare)
    gains, held = regulator(found.pieces, count, effort, landing)
    slopes = None
    if when != "continuous":
        if not cast(np.ndarray, found.pieces[plan.landing].gap).size:
            raise InputError(
                f"when = {when!r}: inputs decided once in a hop make it land without loss, but this hop lands with "
                "an impact; pass when='continuous'"
            )
        by_state, slopes = _effects_on_landing(plan, found)
        gains = landing_softly(gains, by_state, slopes)
        held = cycle_with(found.pieces, gains)
    free = np.linalg.multi_dot([piece.carry for piece in reversed(found.pieces)])
    own, mixed = cycle.unit * gains[:, : len(cycle.start)], gains[:, -count:]
    onto = np.linalg.pinv(cycle.machine.model.embed)
    own = np.array([
        row[: len(onto)] @ onto if at >= plan.landing else row
        for row, at in zip(own, plan.measured.tolist(), strict=True)
    ])  # fmt: skip
    room = room_of(cycle, plan, found, bare, HOLDING.margin)
    return Hold(
        machine, along, when, delay, found.names, plan, cycle, found.states, tuple(found.series), found.steps, own,
        mixed, _sizes(cycle, found), limits, bare, room, by_modulus(free), by_modulus(held),
        None if slopes is None else slopes / cycle.unit,
    )  # fmt: skip


def _sizes(cycle: Cycle, found: Linearised) -> np.ndarray:
    """What states (n,) are multiplied by to find the nearest one: of the coordinate that is launched and those of the
    gap one over their range, with their speeds; of the others, as of a leg that swings, 0."""
    model = cycle.machine.model
    inside = [n for n, w in zip(model.flight.states, model.gap(cycle.machine.values).weights, strict=True) if w]
    names = {*model.launched, *inside, *(f"{name}'" for name in inside)}
    ranges = np.ptp(found.states, axis=0)
    return np.array([1 / r if n in names and r > 0 else 0.0 for n, r in zip(model.flight.states, ranges, strict=True)])


def _effects_on_landing(plan: Plan, found: Linearised) -> tuple[np.ndarray, np.ndarray]:
    """The derivatives of what vanishes at the landing by the state (2, n) by which the inputs in flight are decided at
    once, and by these (2, k)."""
    m, n = int(plan.measured[0]), plan.landing
    carry, effects = np.eye(len(found.states[0])), np.zeros((len(found.states[0]), int((plan.ends <= n).sum())))
    for j in range(m, n - 1):
        step = found.flown[j]
        carry, effects = step[:, :-1] @ carry, step[:, :-1] @ effects
        if (acts := plan.acts(j)) >= 0:
            effects[:, acts] += step[:, -1]
    gap = cast(np.ndarray, found.pieces[n].gap)
    return gap @ carry, gap @ effects


def _stated_orbit(orbit: Orbit) -> Orbit:
    """The orbit as that of a mechanism, where its machine is stated as one."""
    if not isinstance(orbit, Orbit):
        raise InputError(f"orbit = {orbit!r}; it must be a lossless orbit, such as find(machine) returns")
    machine: Any = orbit.source
    if machine is None or isinstance(machine, Mechanism) or not hasattr(machine, "stated"):
        return orbit
    if machine.units is not None:
        raise InputError(
            f"a {machine.model.name} in SI needs its actuator: use keep_hopping(machine, actuator=...).hold(...)"
        )
    return replace(orbit, source=machine.stated())


def _driven(orbit: Orbit, along: str) -> Mechanism:
    """The machine of an orbit with the force along an extension; raises `InputError` for a machine that cannot be
    held."""
    machine = orbit.source
    if not isinstance(machine, Mechanism) or (machine.model.changes_contact and not machine.model.sticks):
        stated = "is a Mechanism that stands on one foot, or whose feet stick"
        raise InputError(f"hold takes a machine that {stated}, not a {orbit.machine['machine']}")
    if not isinstance(along, str):
        raise InputError(f"along = {along!r}; it must be a formula of the coordinates, such as 'phi - theta'")
    if INPUT in machine.names:
        raise InputError(f"'{INPUT}' is the name of the force and of a parameter of the machine: rename the parameter")
    if unknown := sorted(names_in(along) - {*machine.coordinates, *machine.parameters}):
        hint = suggest(unknown[0], machine.coordinates)
        raise InputError(f"along '{along}': there is no coordinate '{unknown[0]}'{hint}")
    if not orbit.contact_time or machine.restitution or machine.model.reversor is None:
        raise InputError("hold takes a lossless orbit with a contact, of a machine with a reversor")
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


def _effects_along(machine: Mechanism, along: str) -> Effects:
    """The force and the speed of the force along an extension."""
    names = machine.model.flight.states
    x = ca.SX.sym("x", len(names))
    state = dict(zip(names, ca.vertsplit(x), strict=True))
    places = ca.vertcat(*(state[name] for name in machine.coordinates))
    rates = ca.vertcat(*(state[f"{name}'"] for name in machine.coordinates))
    way = ca.SX(value_of(along, {name: state[name] for name in machine.coordinates}, machine.values))
    speed = ca.Function("speed", [x], [ca.jtimes(way, places, rates)])

    def effects(states: np.ndarray, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return inputs, np.array(speed(states.T), dtype=float).ravel()

    return effects
