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

from ..errors import InputError, finite_number, whole_number
from ..model import Machine, check_machine, refuse_steps
from ..periodic import Orbit, StartLike, start_in_file, unknowns_of_start
from ..running import exclusive, interrupts
from ..units import LENGTH, LIFTOFF_SPEED, TIME, Message, Quantity, described, in_own_units
from .arcs import Flown
from .flyer import Flyer
from .hand_over import standing
from .hop_inputs import Course
from .hop_statuses import undecided
from .hysteresis import Branches
from .impacts import CAP, FASTEST_LAUNCH, LIFTOFF_ORDER, Impacts, impacts_of, injected, no_launch
from .launch_section import LaunchSection
from .recorded_simulation import recorded
from .schedule import Decisions, Feedback, Inputs, Schedule, check_scheduled, parsed_schedule
from .simulated import Simulation, run_in_units


@exclusive
def simulate(
    machine: Machine, alpha: float | StartLike | None = None, *, state: ArrayLike | None = None,
    hops: int | None = None, time: float = np.inf, inject: float = 0.0, cap: int = CAP,
    schedule: tuple[ArrayLike, Mapping[str, ArrayLike]] | None = None, feedback: Feedback | None = None,
) -> Simulation:  # fmt: skip
    """Simulate a machine from a launch or from a state, with every impact, landing and lift-off located.

    machine : as in `find`, with its restitution
    alpha : the launch at which the simulation begins, a lift-off after sustained contact: its speed or, for a machine
        whose launch has several numbers, these by name; or an orbit, or the name of its file, with whose launch it
        begins
    state : (n,), instead of alpha: a flight state whose gap is open or opens, as after an impact, or is closed and at
        rest. From rest the machine stays in contact if the contact force presses, else it lifts off
    hops, time : the simulation ends after this many lift-offs or after this time, whichever is first; one is needed
    inject : added to the launch speed at every lift-off that is a launch, an impulse on the launched coordinate. With a
        damper the extension at lift-off depends on the speed, and the injection moves the machine to the extension of
        the new speed
    cap : number of impacts in one hop after which the simulation ends
    schedule : (times (k + 1,), values (k,) of parameters by name): the piecewise constant inputs of an actuator; before
        and after these times the machine's own values hold
    feedback : a rule that sets a parameter in each cycle from the states at some times after lift-off, such as a `Hold`
        from `orbits.control.hold`

    A foot that passes the ground in mid-flight, as of a walker with legs of one length, scuffs it in motions near the
    orbit: this is ignored while the feet are closer than half of their distance at lift-off. Farther behind, the foot
    lands again.

    Returns the motion, whose `status` says how it ended. All numbers are in the machine's units. If a launch is
    "undecided" in the `ReturnMap`, its simulation ends with that status, at the landing after its many bounces. Raises
    `InputError` for invalid arguments, such as a launch at which the contact would not open.

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
        raise InputError(f"time = {time!r}; it must be a number above 0")
    time = np.inf if time == np.inf else finite_number("time", time)
    if hops is None and time == np.inf:
        raise InputError("a simulation needs hops or a time at which to end")
    alpha = start_in_file(alpha) if isinstance(alpha, str | Path) else alpha
    if not (alpha is None or isinstance(alpha, Mapping | Orbit) or finite_number("alpha", alpha) > 0):
        raise InputError(f"alpha = {alpha:g}; a launch speed must be above 0")
    inputs = None if schedule is None else parsed_schedule(schedule)
    if feedback is not None and inputs is not None:
        raise InputError("feedback: leave out either the schedule or the feedback")
    if feedback is not None and not hasattr(feedback, "name"):
        raise InputError(f"feedback = {feedback!r}; it must be a feedback, such as orbits.control.hold returns")
    if feedback is not None and feedback.name not in machine.values:
        raise InputError(
            f"feedback: the machine has no parameter '{feedback.name}': simulate the machine that the feedback was "
            "designed for"
        )
    state = None if state is None else _checked_state(machine, state)
    return _simulated(machine, alpha, state, hops, time, inject, cap, inputs, feedback)


def _checked_state(machine: Machine, state: ArrayLike) -> np.ndarray:
    """A flight state (n,); raises `InputError` for an invalid one."""
    names = machine.model.flight.states
    if isinstance(state, Orbit):
        raise InputError("state must be numbers, not an orbit: simulate(machine, orbit) begins with the orbit's launch")
    with suppress(TypeError, ValueError, OverflowError):
        x = np.array(state, dtype=float)
        if x.shape == (len(names),) and np.isfinite(x).all():
            return x
    raise InputError(f"state = {state!r}; it must be {len(names)} numbers, {', '.join(names)}")


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
    if branches and (inputs is not None or feedback is not None):
        what = "schedule" if feedback is None else "feedback"
        remedy = f"its spring has hysteresis, which excludes a {what}; use the law's `.mean`"
        raise InputError(f"a {what} for a {machine.model.name}: {remedy}")
    if inputs is not None and not machine.model.sticks:
        refuse_steps(machine.model, "a schedule")
    impacts = branches.first(state) if branches else impacts_of(machine)
    if branches and inject != 0 and not impacts.model.one_speed:
        name = impacts.model.name
        raise InputError(
            f"inject = {inject:g}: it adds to a launch speed, but a launch of a {name} has several numbers"
        )
    known = Schedule(machine, inputs)
    x, launch_speed, order, foot = _initial_state(impacts, known(0.0)[0], alpha, state)
    impacts.footing.refuse_fallen(x)
    foothold = sum(state[impacts.footing.counted].tolist()) if state is not None and order != 0 else 0.0
    decisions = Decisions(feedback) if feedback is not None else None
    if decisions and order == LIFTOFF_ORDER:
        decisions.lift_off(0.0)
    course = Course(hops, time, inject, known, decisions, np.nan if launch_speed is None else launch_speed)
    rules = branches or impacts
    motion = Flown.begun(rules, x[None], record=True)
    motion.status[:], motion.order[:], motion.foot[:], motion.on_ground[:] = "", order or 0, foot, order is None
    with interrupts.deferred():
        Flyer(rules, motion, cap, thorough=True, course=course, undecided=undecided).fly()
        found = recorded(machine, rules, motion, launch_speed, foothold)
    return replace(found, schedule=decisions.applied(found.end) if decisions else inputs)


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
    tolerance, order, opening = impacts.options.touching * (1 + np.abs(x).max()), 0, 0
    for foot, each in enumerate(impacts.feet):
        gap, speed = each.gap(x), float(x @ each.speed)
        if impacts.model.grazes:
            slope = float(impacts.slopes(x[None], np.array([foot]))[0])
            if abs(gap) <= tolerance and (slope < -tolerance or (abs(slope) <= tolerance and not speed < 0)):
                continue  # the gap of the other foot is meant, and where the feet pass that of the one that falls
            if abs(gap) <= tolerance and abs(slope) <= tolerance:
                return x, None, 1, foot
            gap = gap if abs(gap) <= tolerance else float(impacts.model.height_of(impacts.values)(x))
        if abs(gap) <= tolerance and abs(speed) <= tolerance:
            impacts.footing.refuse_sliding(x, tolerance)
            several = len(impacts.feet) > 1
            stands = standing(impacts, x[None], np.array([foot]))[0][0] if several else impacts.footing.placed(x)
            ends = [impacts.force_at_start(e, impacts.onto_contact @ stands, p, tolerance) for e in impacts.exits]
            opens = min(range(len(ends)), key=lambda i: (not ends[i][1], ends[i][0]))
            force, lifts_off = ends[opens]
            if not lifts_off and force >= 0:
                return stands, None, None, 0
            way = impacts.exits[opens]
            return way.opened(stands, impacts.values), None, LIFTOFF_ORDER if lifts_off else 2, way.foot
        if -tolerance <= gap <= 0 < speed:
            order, opening = 1, foot
        elif not gap > 0:
            text, names = "state = {place}: its gap is {gap:.6g} and must be open", impacts.flight.phase.states
            text += "; give the state after the impact" if gap >= -tolerance else ""
            raise InputError(Message(text, place=described(names, x), gap=Quantity(gap, LENGTH)))
    return x, None, order, opening


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
            raise InputError(f"alpha: a launch of this machine has the numbers {', '.join(names)}, but it {wrong}")
        named = {name: finite_number(name, launch[name]) for name in names}
        return np.array([impacts.model.launch(named, impacts.values)], dtype=float), named["alpha"]
    if not 0 < (alpha := finite_number("alpha", launch)) <= FASTEST_LAUNCH:
        text = "alpha = {alpha:g}; it must be above 0 and at most {most:g}"
        speed, most = (Quantity(number, LIFTOFF_SPEED) for number in (alpha, FASTEST_LAUNCH))
        raise InputError(Message(text, alpha=speed, most=most))
    return impacts.launch(np.array([alpha])), alpha
