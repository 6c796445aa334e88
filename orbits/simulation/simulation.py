"""Simulation of a machine from any state: flights, impacts and contacts, one after the other, with every event found.

Events are zeros of the motion's Taylor polynomials, found by Bernstein exclusion, which misses no grazing pair of them.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..consistency.accepted import check_machine
from ..errors import FlowError, InputError, finite_number, whole_number
from ..flow.trajectory import Trajectory
from ..flow.zero_crossing import first_zero
from ..model.machine import Machine
from ..model.model import refuse_steps
from ..model.phase import Affine
from ..periodic.find import StartLike, unknowns_of_start
from ..periodic.orbit import Orbit, start_in_file
from ..running import interrupts
from ..running.exclusive import exclusive
from ..units import LENGTH, LIFTOFF_SPEED, TIME, Message, Quantity, described, in_own_units
from .feet import LIFTS_OFF, STEPS_BACK, Exit, unheld
from .footing import FALLS, SLIPS, FallTest
from .hand_over import landed, standing
from .hysteresis import Branches, FirstOf, first_reversal
from .impacts import (
    CAP,
    FASTEST_LAUNCH,
    LIFTOFF_ORDER,
    MANY_BOUNCES,
    STATUSES,
    TURNS,
    ContactEnd,
    Impacts,
    decided_from,
    decided_impacts,
    injected,
    no_launch,
    status_of_failure,
)
from .launch_section import LaunchSection
from .schedule import Decisions, Feedback, Inputs, Schedule, check_scheduled, parsed_schedule
from .simulated import ContactEvent, Leg, Simulation, run_in_units

SLIPPED = 1e-9  # a spring that sticks moves slower, relative to the state, where its constant force keeps it
TOUCHING = 1e-9  # a gap, gap speed or contact force below this, relative to the state, is zero: rounding is smaller


@exclusive
def simulate(
    machine: Machine, alpha: float | StartLike | None = None, *, state: ArrayLike | None = None,
    hops: int | None = None, time: float = np.inf, inject: float = 0.0, cap: int = CAP,
    schedule: tuple[ArrayLike, Mapping[str, ArrayLike]] | None = None, feedback: Feedback | None = None,
) -> Simulation:  # fmt: skip
    """Simulate a machine from a launch or from a state, with every impact, landing and lift-off located.

    machine : as in `find`, with its restitution
    alpha : launch speed at a lift-off after sustained contact, the numbers of a launch by name, or an orbit or the file
        of one, which begins with a launch: with its speed, or its numbers where a launch has several; or
    state : (n,), a flight state with an open gap, or with a gap that is closed and at rest; then the machine stays in
        contact if the contact force presses, and lifts off if it does not
    hops, time : the simulation ends after this many lift-offs or after this time, whichever is first; one is needed
    inject : added to the launch speed at every lift-off that is a launch, an impulse on the coordinate that is
        launched; with a damper the extension at lift-off depends on the speed, and the injection moves the machine to
        the extension of the new speed
    cap : number of impacts in one hop after which the simulation ends
    schedule : (times (k + 1,), values (k,) of parameters by name): the piecewise constant inputs of an actuator; before
        and after these times the machine's own values hold
    feedback : what decides in each cycle on a parameter, by the state at some times after the lift-off, such as a
        `Hold` that `orbits.control.hold` finds

    All numbers are in the machine's units. A hop from a launch that is "undecided" in the `ReturnMap` ends the
    simulation with that status, at the landing after its many bounces. Raises `InputError` for invalid arguments, such
    as a launch at which the contact would not open.

    >>> from orbits import simulate
    >>> from problems import Hopper
    >>> run = simulate(Hopper(), 4.6, hops=2)
    >>> [event.kind for event in run.events]
    ['landing', 'lift-off', 'impact', 'landing', 'lift-off']
    >>> run.launches.round(4).tolist()
    [4.6, 4.3923, 3.7382]
    """
    check_machine(machine)
    units = getattr(machine, "units", None)
    inject, cap = injected(inject, units.of(LIFTOFF_SPEED) if units else 1.0), whole_number("cap", cap, "impacts")
    hops = None if hops is None else whole_number("hops", hops, "lift-offs")
    if not (isinstance(time, Real) and time > 0):
        raise InputError(f"time = {time!r}; it is a number above 0")
    time = np.inf if time == np.inf else finite_number("time", time)
    if hops is None and time == np.inf:
        raise InputError("a simulation needs hops or a time at which to end")
    alpha = start_in_file(alpha) if isinstance(alpha, str | Path) else alpha
    if not (alpha is None or isinstance(alpha, Mapping | Orbit) or finite_number("alpha", alpha) > 0):
        raise InputError(f"alpha = {alpha:g}; a launch speed is above 0")
    inputs = None if schedule is None else parsed_schedule(schedule)
    if feedback is not None and (inputs is not None or machine.model.one_speed):
        wrong = (
            "a launch that is a speed has none" if inputs is None else "a schedule and a feedback exclude each other"
        )
        raise InputError(f"feedback: {wrong}")
    state = None if state is None else _checked_state(machine, state)
    return _simulated(machine, alpha, state, hops, time, inject, cap, inputs, feedback)


def _checked_state(machine: Machine, state: ArrayLike) -> np.ndarray:
    """A flight state (n,); raises `InputError` for an invalid one."""
    names = machine.model.flight.states
    if isinstance(state, Orbit):
        raise InputError("state is an orbit, and a state is numbers: simulate(machine, orbit) begins with its launch")
    with suppress(TypeError, ValueError, OverflowError):
        x = np.array(state, dtype=float)
        if x.shape == (len(names),) and np.isfinite(x).all():
            return x
    raise InputError(f"state = {state!r}; it is {len(names)} numbers, {', '.join(names)}")


def _bare_state(state: np.ndarray | None, machine: Any) -> np.ndarray | None:
    """A flight state (n,) of a machine with units, made dimensionless."""
    return None if state is None else state / machine.units.of_states(machine.model.flight.states)


def _bare_inputs(inputs: Inputs | None, machine: Any) -> Inputs | None:
    """A schedule's inputs for a machine with units, made dimensionless."""
    if inputs is None:
        return None
    check_scheduled(inputs, [*machine.scheduled])
    return inputs[0] / machine.units.time, {name: x / machine.scheduled[name] for name, x in inputs[1].items()}


@in_own_units(
    run_in_units, alpha=LIFTOFF_SPEED, state=_bare_state, time=TIME, inject=LIFTOFF_SPEED, inputs=_bare_inputs
)
def _simulated(
    machine: Machine, alpha: Any, state: np.ndarray | None, hops: int | None, time: float, inject: float, cap: int,
    inputs: Inputs | None, feedback: Feedback | None,
) -> Simulation:  # fmt: skip
    """The simulation of a machine, from checked arguments."""
    branches = Branches(machine) if machine.model.hysteretic else None
    if branches and inputs is not None:
        remedy = "its spring has hysteresis, which no schedule takes; give it the law's `.mean`"
        raise InputError(f"a schedule for a {machine.model.name}: {remedy}")
    if inputs is not None and not machine.model.sticks:
        refuse_steps(machine.model, "a schedule")
    impacts = branches.first(state) if branches else Impacts(machine)
    if branches and inject != 0 and not impacts.model.one_speed:
        name = impacts.model.name
        raise InputError(f"inject = {inject:g}: a launch of a {name} is more than the speed that it adds to")
    known = Schedule(machine, inputs)
    x, launch_speed, order, foot = _initial_state(impacts, known(0.0)[0], alpha, state)
    impacts.footing.refuse_fallen(x)
    with interrupts.deferred():
        if branches:
            return _HystereticRun(branches, inject, hops, time, cap, known).simulate(x, order, launch_speed)
        start = sum(state[impacts.footing.sticks].tolist()) if state is not None and order != 0 else 0.0
        run = _Run(impacts, inject, hops, time, cap, known, feedback)
        found = run.simulate(x, order, launch_speed, foot, start)
    return replace(found, schedule=run.decisions.applied(found.end) if run.decisions else inputs)


def _initial_state(impacts: Impacts, p, alpha, state) -> tuple[np.ndarray, float | None, int | None, int]:
    """The first flight state, the launch speed if it is a launch, the order of the gap's zero, None in contact, and the
    number of the foot that opens."""
    if (alpha is None) == (state is None):
        raise InputError("a simulation starts from a launch speed alpha or from a state: give one of them")
    if alpha is not None:
        x, alpha = _launch_state(impacts, alpha)
        if not impacts.opens(x)[0]:
            raise InputError(no_launch(alpha))
        return x[0], alpha, LIFTOFF_ORDER, 0
    x = np.array(state)
    tolerance = TOUCHING * (1 + np.abs(x).max())
    for foot, each in enumerate(impacts.feet):
        gap, speed = each.gap(x), float(x @ each.speed)
        if abs(gap) <= tolerance and abs(speed) <= tolerance:
            impacts.footing.refuse_sliding(x, tolerance)
            several = len(impacts.feet) > 1
            stands = standing(impacts, x[None], np.array([foot]))[0][0] if several else impacts.footing.placed(x)
            ends = [_force_at_start(impacts, e, impacts.onto_contact @ stands, p, tolerance) for e in impacts.exits]
            opens = min(range(len(ends)), key=lambda i: (not ends[i][1], ends[i][0]))
            force, lifts_off = ends[opens]
            if not lifts_off and force >= 0:
                return stands, None, None, 0
            way = impacts.exits[opens]
            return way.opened(stands, impacts.values), None, LIFTOFF_ORDER if lifts_off else 2, way.foot
        if not gap > 0:
            text, names = "state = {place}: its gap is {gap:.6g} and must be open", impacts.flight.phase.states
            raise InputError(Message(text, place=described(names, x), gap=Quantity(gap, LENGTH)))
    return x, None, 0, 0


def _force_at_start(impacts: Impacts, way: Exit, y: np.ndarray, p: np.ndarray, tolerance: float) -> tuple[float, bool]:
    """The force of an exit in a contact state, and whether it is 0 up to a tolerance and falls, so that it opens."""
    path, _ = impacts.contact.run(y, p, tolerance)
    force, rise = way.force.series(path.coefficients)[0, :2]
    return float(force), bool(abs(force) <= tolerance and rise < 0)


def _launch_state(impacts: Impacts, launch) -> tuple[np.ndarray, float]:
    """The flight state (1, n) of a launch, which is stated by its speed, its unknowns or an orbit; and its speed."""
    names = impacts.model.launch_unknowns
    if isinstance(launch, Orbit):
        known = unknowns_of_start(impacts.machine, launch)
        if impacts.model.one_speed:
            launch = known["alpha"]
        else:  # on another machine than that of the orbit, one of the unknowns follows from the others
            section = LaunchSection(impacts)
            launch = section.unknowns_of(section.launch(known))
    if isinstance(launch, Mapping):
        if not impacts.model.one_speed and (section := LaunchSection(impacts)).dependent not in launch:
            # The unknown that follows from the others may be left out.
            launch = section.unknowns_of(section.launch(launch))
        if unknown := sorted(set(names) ^ launch.keys(), key=str):
            wrong = f"has no '{unknown[0]}'" if unknown[0] in launch else f"needs '{unknown[0]}'"
            raise InputError(f"alpha: a launch of this machine has the numbers {', '.join(names)}: it {wrong}")
        named = {name: finite_number(name, launch[name]) for name in names}
        return np.array([impacts.model.launch(named, impacts.values)], dtype=float), named["alpha"]
    if not 0 < (alpha := finite_number("alpha", launch)) <= FASTEST_LAUNCH:
        text = "alpha = {alpha:g}; a launch speed is above 0 and at most {most:g}"
        speed, most = (Quantity(number, LIFTOFF_SPEED) for number in (alpha, FASTEST_LAUNCH))
        raise InputError(Message(text, alpha=speed, most=most))
    return impacts.launch(np.array([alpha])), alpha


class _Run:
    """The state of a simulation while it runs."""

    def __init__(
        self, impacts: Impacts, inject: float, hops: int | None, time: float, cap: int, inputs: Schedule,
        feedback: Feedback | None = None,
    ):  # fmt: skip
        self.decisions = Decisions(feedback) if feedback is not None else None
        self.impacts, self.inject, self.hops = impacts, inject, hops
        self.time, self.cap, self.inputs = time, cap, inputs
        self.legs, self.events, self.launches = list[Leg](), list[ContactEvent](), list[float]()
        self.now, self.impact_count, self.liftoff_count, self.reason = 0.0, 0, 0, ""
        self.launch: np.ndarray | None = None  # the state in which the hop began, where it began with a lift-off
        self.foot, self.stance = 0, 0  # the number of the foot that opens, and how many steps were taken
        self.foothold = 0.0  # the place along the ground from which that of what sticks is counted

    branch: int | None = None  # that of the leg, of a spring with hysteresis

    @property
    def machine(self) -> Machine:
        """The machine that is simulated."""
        return self.impacts.machine

    def simulate(self, x, order: int | None, alpha: float | None, foot: int = 0, start: float = 0.0) -> Simulation:
        """Alternate flights, from a zero of this order of the gap of a foot, and contacts, order None, up to the end's
        status; what sticks begins at the place `start`."""
        self.launches += [] if alpha is None else [alpha]
        self.foot, status = foot, None
        self.foothold = start
        if self.decisions and order == LIFTOFF_ORDER:
            self.decisions.lift_off(self.now)
        while status is None:
            if order is None:
                status, x = self.contact(x)
                order = self.order_of_liftoff(x)
            else:
                status, x, order = self.flight(x, order)
        launches = np.array(self.launches)
        return Simulation(tuple(self.legs), tuple(self.events), status, launches, self.now, self.machine, self.reason)

    def flight(self, x, order: int) -> tuple[str | None, np.ndarray, int | None]:
        """Fly until a gap closes: the status at an end, the state after the impact, and the order of the zero of the
        gap there that opens, None where contact follows."""
        until, closed = self.update_parameters(x), False
        self.launch = x if order == LIFTOFF_ORDER else self.launch
        last = self.now + float(self.impacts.longest_flight(x))
        if order == LIFTOFF_ORDER and not self.impacts.feet[self.foot].opens(x[None], self.impacts.p)[0]:
            return "no_launch", x, order
        while not closed:
            left, feet = min(self.time, last, until) - self.now, self.impacts.feet
            tests = [first_zero(each.gap, order * (i == self.foot)) for i, each in enumerate(feet)]
            tests += [FallTest(self.impacts.footing)] if self.impacts.footing.heights else []
            touches = FirstOf(*tests)
            try:
                path, _ = self.impacts.flight.run(x, self.impacts.p, left, stop=touches if tests[1:] else tests[0])
            except FlowError as error:
                self.reason = error.args[0]
                return status_of_failure(error, "flight"), x, order
            closed = path.times[-1] < left
            cut = not closed and until < min(self.time, last)
            ended = FALLS if touches.which == len(feet) else None if closed or cut else "carried_off"
            if status := self.add_leg("flight", path, ended, until if cut else None):
                return status, x, order
            x = path.end[: len(x)]
            self.foot = touches.which or 0
            closed |= bool(feet[self.foot].gap(x) <= 0)
            until, order = self.update_parameters(x), 0
        return self.land(x)

    def land(self, x) -> tuple[str | None, np.ndarray, int | None]:
        """Land on the foot that touches, see `flight`."""
        impacts, name = self.impacts, self.impacts.feet[self.foot].name
        found = landed(impacts, x[None], np.array([self.foot]))
        (held,), (after,), (loss,), (wait,) = found.held, found.state, found.loss, found.wait
        (step,), ended, self.impact_count = found.step.tolist(), str(found.ended[0]), self.impact_count + 1
        if step and impacts.descends:  # on a slope the next foot stands lower
            label = impacts.model.relabelling
            before = (label.inverse if step > 0 else label)(after, impacts.values)
            loss += self.energy(before) - self.energy(after)
        self.add_event("landing" if held else "impact", x, after, float(loss), float(wait), name)
        self.foothold += sum(x[impacts.footing.sticks].tolist())
        if impacts.footing.slips_at_landing(x, float(self.legs[-1].path.times[-1])):
            return self.slip(after, " as it lands"), after, None
        self.stance, self.foot = self.stance + step, int(found.foot[0])
        self.reason = STATUSES[ended] if ended else self.reason
        if held:
            return ("undecided" if self.undecided() else None), after, None
        return (ended or ("cap" if self.impact_count >= self.cap else None)), after, int(found.order[0])

    def undecided(self) -> bool:
        """Whether rounding decides how the hop ends that has just landed, by the test of the map for its launch."""
        impacts, alpha = self.impacts, np.array(self.launches[-1:])
        if impacts.restitution < MANY_BOUNCES or self.launch is None:
            return False
        if not impacts.model.one_speed:
            if len(self.inputs.times) > 0 or self.branch is not None:
                return False  # such hops have no map
            return bool(decided_from(impacts, self.launch[None], self.cap)[2][0] == "undecided")
        launched = (alpha > 0).any() and np.array_equal(impacts.launch(alpha)[0], self.launch)
        return bool(launched and self.statuses(alpha)[0] == "undecided")

    def statuses(self, alpha: np.ndarray) -> np.ndarray:
        """The statuses (m,) of the impacts of hops with launch speeds (m,)."""
        return decided_impacts(self.impacts, alpha, self.cap)[2]

    def contact(self, x) -> tuple[str | None, np.ndarray]:
        """Stay in contact until lift-off: the status if the simulation ends, and the state after lift-off."""
        y, outcome = self.impacts.onto_contact @ x, None
        while outcome is None:
            until = self.update_parameters(self.impacts.model.embed @ y)
            path, outcome, self.reason = self.impacts.sustained_contact(y, min(self.time, until) - self.now)
            if path is None:
                return self.slip(self.impacts.model.embed @ y) if outcome == SLIPS else outcome, x
            cut = outcome is None and until < self.time
            ended = None if cut or outcome in (LIFTS_OFF, STEPS_BACK) else outcome
            if status := self.add_leg("contact", path, ended, until if cut else None):
                return self.slip(self.impacts.model.embed @ path.end[: len(y)]) if status == SLIPS else status, x
            y = path.end[: self.impacts.contact.size]
            self.update_parameters(self.impacts.model.embed @ y)
            if cut:  # The force may vanish by rounding, or because the new inputs make it vanish.
                tolerance = TOUCHING * (1 + np.abs(y).max())
                force, lifts_off = _force_at_start(self.impacts, self.impacts.exits[0], y, self.impacts.p, tolerance)
                outcome = "lifts_off" if lifts_off or force <= 0 else None
        return self.liftoff(y, x, self.impacts.exits[int(outcome == STEPS_BACK)])

    def slip(self, x: np.ndarray, how: str = "") -> str:
        """The status of a foot that slips now, in a flight state, with the event and the reason."""
        self.add_event(SLIPS, x, x, 0.0)
        text = "the foot slips{how} at t = {time:.6g}: slipping is not simulated"
        self.reason = Message(text, how=how, time=Quantity(self.now, TIME))
        return SLIPS

    def liftoff(self, y, x, way: Exit | None = None) -> tuple[str | None, np.ndarray]:
        """Lift off from a contact state: the status at an end, and the flight state, `x` if an injection stops it."""
        impacts, driven = self.impacts, len(self.inputs.times) > 0
        before = after = impacts.model.embed @ y
        self.foot, name = (way.foot, impacts.feet[way.foot].name) if way else (0, "")
        if way and way.labels:
            after, self.stance = way.opened(before, impacts.values), self.stance - 1
            y = impacts.onto_contact @ after
        (speed,), (is_launch,) = impacts.liftoff(y[None])
        is_launch &= self.foot == 0
        if self.inject and not impacts.model.one_speed:
            (y,) = LaunchSection(impacts).injected(y[None], self.inject)
            if not np.isfinite(y).all():
                return "rests", x
            speed, after = float(speed) + self.inject, impacts.model.embed @ y
        # A driven machine lifts off where it is; without inputs its state is moved onto the launch set.
        if is_launch and not (driven and self.inject == 0):
            speed = float(speed) + self.inject
            if speed <= 0:
                return "rests", x
            after = impacts.launch(np.array([speed]))[0]
        self.add_event("lift-off", before, after, self.energy(before) - self.energy(after), foot=name)
        has_speed = is_launch or driven or not impacts.model.one_speed
        self.launches.append(float(speed) if has_speed else np.nan)
        self.impact_count, self.liftoff_count = 0, self.liftoff_count + 1
        if self.decisions:
            self.decisions.lift_off(self.now)
        return ("done" if self.liftoff_count == self.hops else None), after

    def order_of_liftoff(self, x) -> int:
        """The order of the gap's zero at lift-off: 2 where new inputs pull immediately, else `LIFTOFF_ORDER`."""
        pulls = len(self.inputs.times) > 0 and self.impacts.pressing(x[None])[0] < -TOUCHING * (1 + np.abs(x).max())
        return 2 if pulls else LIFTOFF_ORDER

    def update_parameters(self, x: np.ndarray) -> float:
        """Use the parameters that the schedule sets now, or a feedback by the flight state; returns the time until
        which they are in force."""
        if self.decisions and (inputs := self.decisions.at(self.now, x)):
            self.inputs = Schedule(self.machine, inputs)
        p, until = self.inputs(self.now)
        if (p != self.impacts.p).any():
            self.impacts = Impacts(self.impacts.machine, dict(zip(self.impacts.values, p.tolist(), strict=True)))
        return until

    def add_leg(self, phase: str, path: Trajectory, status: str | None, until: float | None = None) -> str | None:
        """Store a leg, which ends at `until` if not None; returns "done" at the end of the time, else `status`."""
        self.legs.append(Leg(phase, self.now, path, branch=self.branch, stance=self.stance, foothold=self.foothold))
        if phase == "flight":
            for when, kind in unheld(self.impacts.model, path, self.impacts.values):
                state = path(when)[: self.impacts.flight.size]
                self.add_event(kind, state, state, 0.0, when, "standing foot")
        lasted = float(path.times[-1])
        over = until is None and (lasted >= self.time - self.now or self.now + lasted >= self.time)
        self.now = self.time if over else self.now + lasted if until is None else until
        if status == FALLS and not over:
            embed, rows = self.impacts.model.embed, path.end
            x = rows[: len(embed)] if phase == "flight" else embed @ rows[: embed.shape[1]]
            name = self.impacts.footing.fallen(x)
            self.add_event(FALLS, x, x, 0.0, foot=name)
            text = "the {name} falls to the ground at t = {time:.6g}"
            self.reason = Message(text, name=name, time=Quantity(self.now, TIME))
        return "done" if over else status

    def add_event(self, kind: str, before, after, loss: float, wait: float = 0.0, foot: str = ""):
        """Store an event that happens `wait` after the end of the last leg."""
        self.events.append(ContactEvent(kind, self.now + wait, before, after, self.energy(before), loss, foot))

    def energy(self, x) -> float:
        """The energy of a flight state."""
        return self.impacts.energy(x)


class _HystereticRun(_Run):
    """A simulation of a machine with hysteresis: its legs end at reversals of the spring too."""

    def __init__(self, branches: Branches, *arguments: Any):
        super().__init__(branches.first(), *arguments)
        self.branches = branches

    @property
    def machine(self) -> Machine:
        """The machine with hysteresis."""
        return self.branches.machine

    def energy(self, x) -> float:
        """The energy of a flight state, by the mean law."""
        return self.branches.mean.energy(x)

    def flight(self, x, order: int) -> tuple[str | None, np.ndarray, int | None]:
        """Fly until the gap closes, see `_Run.flight`."""
        self.launch = x if order == LIFTOFF_ORDER else self.launch
        last, held = self.now + float(self.impacts.longest_flight(x)), False
        (side, turning), turns = self.branches.branch(x), 0
        self.use(side, x)
        if order == LIFTOFF_ORDER and not self.impacts.opens(x[None])[0]:
            return "no_launch", x, order
        while not held:
            left = min(self.time, last) - self.now
            reverses = first_reversal(self.branches.rate, turning if side else None)
            stop = FirstOf(first_zero(self.impacts.gap, order), reverses, FallTest(self.impacts.footing))
            try:
                path, _ = self.impacts.flight.run(x, self.impacts.p, left, stop=stop)
            except FlowError as error:
                self.reason = error.args[0]
                return status_of_failure(error, "flight"), x, order
            self.branches.check_width(path.coefficients[:, : len(x), 0])
            if not side and self.slips(path, len(x), self.branches.rate):
                return "lost", x, order
            closed = path.times[-1] < left and stop.which == 0
            ended = FALLS if stop.which == 2 else None if path.times[-1] < left else "carried_off"
            if status := self.add_leg("flight", path, ended):
                return status, x, order
            x, order = path.end[: len(x)], 0
            if held := closed or bool(self.impacts.gap(x) <= 0):
                continue
            if (turns := turns + 1) > self.cap:
                self.reason = f"its spring turned {self.cap} times in one flight"
                return "lost", x, order
            self.add_event("reversal", x, x, 0.0)
            side, turning = self.branches.branch(x)
            self.use(side, x)
        self.impacts = self.branches.of[int(self.branches.landed(x[None])[0])]
        (held,), (after,), (loss,), (wait,) = self.impacts.landing(x[None])
        self.impact_count += 1
        self.add_event("landing" if held else "impact", x, after, float(loss), float(wait))
        if held:
            self.impacts = self.branches.first()  # whose launches are those of the machine
            return ("undecided" if self.undecided() else None), after, None
        return ("cap" if self.impact_count >= self.cap else None), after, self.impacts.bounce_order

    def statuses(self, alpha: np.ndarray) -> np.ndarray:
        """The statuses (m,) of hops with launch speeds (m,)."""
        return self.branches.hops(alpha, self.cap)[2]

    def contact(self, x) -> tuple[str | None, np.ndarray]:
        """Stay in contact until lift-off, see `_Run.contact`."""
        y, model, turns, endless = self.impacts.onto_contact @ x, self.branches.model, 0, self.time == np.inf
        while turns <= self.cap:
            side, turning = self.branches.branch(y, contact=True)
            # One coordinate that sticks is at rest, and after some turns it never lifts off, see `ContactEnd`.
            if endless and model.one_speed and (not side or turns == TURNS):
                return "rests", x
            self.use(side, y, contact=True)
            impacts = self.impacts
            if turns and impacts.pressing((model.embed @ y)[None])[0] < 0:
                return self.liftoff(y, x)  # the force jumps at a reversal
            limit = impacts.longest_contact(y) if endless else self.time - self.now
            lifts = ContactEnd(impacts, model.contact_speed if endless and model.one_speed else None)
            stop = FirstOf(lifts, first_reversal(self.branches.rate_in_contact, turning if side else None))
            try:
                path, _ = impacts.contact.run(y, impacts.p, limit, stop=stop)
            except FlowError as error:
                self.reason = error.args[0]
                return status_of_failure(error, "contact"), x
            self.branches.check_width(path.coefficients[:, : impacts.contact.size, 0], contact=True)
            if not side and self.slips(path, impacts.contact.size, self.branches.rate_in_contact):
                return "lost", x
            never = "collapses" if np.abs(path.end).max() > limit else "rests"
            outcome = lifts.outcome if stop.which == 0 else never if stop.which is None and endless else None
            if status := self.add_leg("contact", path, None if outcome == "lifts_off" else outcome):
                return status, x
            y = path.end[: impacts.contact.size]
            if outcome == "lifts_off":
                return self.liftoff(y, x)
            x, turns = model.embed @ y, turns + 1
            self.add_event("reversal", x, x, 0.0)
        self.reason = f"its spring turned {self.cap} times in one contact"
        return "lost", x

    def use(self, side: int, state: np.ndarray, contact: bool = False):
        """Go on with the impacts of a branch, or with those of the spring that sticks."""
        self.branch, self.impacts = side, self.branches.on(side, state, contact)

    def slips(self, path: Trajectory, size: int, rate: Affine) -> bool:
        """Whether a phase with a spring that sticks and a constant force is not its motion, with the reason."""
        states = path.coefficients[:, :size, 0]
        if np.abs(rate(states)).max() <= SLIPPED * (1 + np.abs(states).max()):
            return False
        self.reason = "its spring sticks while the force that keeps it changes, which is not followed"
        return True
