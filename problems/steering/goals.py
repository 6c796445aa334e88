"""Optimal control of an actuated machine: to keep it hopping although it is damped, to bring it onto its lossless
orbit, or to start it from rest.

The control is the rate w of the spring's end, constant on each interval; effort is the integral of w**2. A landing is
lossless, where the speed and the acceleration of the gap vanish with it, or plastic: then the speed is free, its energy
is lost, and the contact force must press from there on. With a restitution above 0 the machine would bounce instead,
and is refused unless the landing is lossless. Source: direct multiple shooting, see `orbits.steer`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial, wraps
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from orbits import Control, InputError, NoOrbit, Orbit, Simulation, find, simulate, steer
from orbits.control import Guess, Stage
from orbits.control.control import ControlledLeg, control_in_units
from orbits.errors import finite_number, whole_number
from orbits.flow.flow import flow_of
from orbits.model.phase import Affine
from orbits.numerics.polynomial_roots import derivative, piecewise_roots
from orbits.numerics.roots import bracketed_root
from orbits.running.exclusive import exclusive
from orbits.simulation.simulated import run_in_units
from orbits.units import ENERGY, LENGTH, SPEED, Dimension, Message, Quantity, in_own_units

from ..machines.two_masses import DAMPERS, TwoMassMachine
from .actuated import RATE, Actuated, Limits, actuator_limits, product
from .driven import Driven

# Positive work is rounded: power P counts as (P + sqrt(P^2 + round^2))/2, with a share of the mean power as `round`.
# The last of these shares is that of the result; the earlier ones lead there.
ROUNDINGS = (1.0, 0.3, 0.1)
# Tolerance of least work: quadrature is slow near corners of the power, while the motion itself stays smooth.
WORK_TOLERANCE = 1e-7
# A little effort is added to positive work and to the peak rate, so that their minima are unique.
EFFORT_WEIGHTS = {"work": 1e-3, "peak": 1e-6}
# In a start from rest the contact force keeps this distance from 0, in units of the actuator's spring force, wherever
# contact is to last: driven open loop, the machine would lift off where the force touches zero.
CONTACT_FORCE_MARGIN = 1e-7
# Bounds of the durations, as shares of those of the lossless orbit.
SHORTEST_SHARE, LONGEST_SHARE = 0.1, 4.0
# Gauss points of a control interval at which the actuator's power is taken.
POWER_SAMPLES = 40


# Dimensions of the costs, of the parameters that a hop or a start adds, and of the rows of legs that are no lengths.
COSTS: dict[str, Dimension] = {"effort": (2, -1, 0), "work": ENERGY, "peak": SPEED}
ADDED: dict[str, Dimension] = {"launch": SPEED, "aim": SPEED, "peak": SPEED, "liftoff": LENGTH, "rest": LENGTH}
ROWS: dict[str, Dimension] = {RATE: SPEED, "rise": SPEED, "fall": SPEED}


def in_units_of_the_machine(function: Callable[..., Control]) -> Callable[..., Driven]:
    """Extend a function of this module to machines in SI, with rate, stroke and speeds in SI; the result has its
    machine."""

    @exclusive
    @wraps(function)
    def steered(machine: Any, *arguments: object, **options: Any) -> Driven:
        def in_si(control: Control, machine: Any) -> Control:
            units, cost = machine.units, COSTS[options.get("cost", "effort")]
            added = {name: x * units.of(ADDED[name]) for name, x in control.parameters.items() if name in ADDED}
            return control_in_units(control, units, cost, {**machine.values, **added}, ROWS)

        with_units = in_own_units(in_si, rate=SPEED, short=SPEED, stroke=LENGTH, orbit=(), guess=())(function)
        return Driven.of(machine, with_units(machine, *arguments, **options))

    return steered


@in_units_of_the_machine
def keep_hopping(
    machine: TwoMassMachine, *, family: int = 1, cost: str = "effort", lossless: bool = True, intervals: int = 40,
    rate: float = np.inf, stroke: float = np.inf, orbit: Orbit | None = None, guess: Control | None = None,
) -> Control:  # fmt: skip
    """Keep a damped machine hopping periodically at locally least cost, near its lossless orbit without the damping.

    machine : a `Hopper` or `Juggler` with a smooth spring law, or one in SI
    family : number of the family, from 1
    cost : "effort"; "work", the actuator's positive work; or "peak", the largest rate. The last two are minimised with
        a small multiple of the effort added (`EFFORT_WEIGHTS`), and work is smoothed (`ROUNDINGS`); the `cost` of the
        result is without either
    lossless : whether the landing has to be lossless; else it is plastic, see the module
    intervals : of flight and contact together, on each of which the actuator's rate is constant; with few, about 12,
        the contact force after a lossless landing may be too small for a solution to be found
    rate, stroke : bounds of the actuator's rate, without which no least work exists, and of its displacement from the
        one at lift-off, in both directions
    orbit : the lossless orbit without damping; by default it is found
    guess : the result for a machine nearby

    The stages are a flight from lift-off and the contact after it. A machine without losses needs no control: the
    result is its lossless orbit, whatever the arguments. Numbers are in the machine's units. Raises the errors of
    `steer` and `find`.

    >>> from problems import Hopper, steering
    >>> round(steering.keep_hopping(Hopper(damping=0.01)).cost / 0.01**2, 1)
    125.8
    """
    if cost not in ("effort", "work", "peak"):
        raise InputError(f"cost = {cost!r}; it is 'effort', 'work' or 'peak'")
    if cost == "work" and rate == np.inf:
        raise InputError("least positive work is done by jerks: give the largest rate")
    hop = _hop(machine, family, orbit, lossless, intervals, rate, stroke)
    if not machine.damped and not (lossless and cost == "effort"):
        return _least_effort(replace(hop, lossless=True), None)
    if cost == "effort":
        return _least_effort(hop, guess)
    if guess is None:  # the other costs have corners: their search starts from a result that is near
        # With a plastic landing, least effort may be far from least work.
        guess = _least_effort(replace(hop, lossless=lossless or cost == "work"), None)
    return _least_peak(hop, guess) if cost == "peak" else _least_work(hop, guess)


@in_units_of_the_machine
def recover(
    machine: TwoMassMachine, short: float, *, family: int = 1, lossless: bool = True, intervals: int = 40,
    rate: float = np.inf, stroke: float = np.inf, orbit: Orbit | None = None, guess: Control | None = None,
) -> Control:  # fmt: skip
    """Bring a machine back to its lossless launch speed in one hop, with locally least effort.

    short : the lossless launch speed minus that of the first lift-off; below 0 the launch is too fast

    The spring's end is at rest at both lift-offs. Further arguments and errors are as in `keep_hopping`.

    >>> from problems import Hopper, steering
    >>> back = steering.recover(Hopper(), short=0.1)
    >>> steering.missed(Hopper(), back) < 1e-9
    True
    """
    hop = _hop(machine, family, orbit, lossless or (short == 0 and not machine.damped), intervals, rate, stroke)
    launch = hop.orbit.alpha - finite_number("short", short)
    if not launch > 0:
        text = "short = {short:g}: the lossless launch speed is {whole:.6g}, and some of it is to be left"
        raise InputError(Message(text, short=Quantity(short, SPEED), whole=Quantity(hop.orbit.alpha, SPEED)))
    liftoff = float(machine.model.release(launch, machine.values))
    values = {**hop.driven.still, "launch": launch, "aim": hop.orbit.alpha, "liftoff": liftoff}
    return _cheapest(hop, hop.stages("effort", periodic=False), values, [guess] if guess else hop.starts(launch))


@in_units_of_the_machine
def start_up(
    machine: TwoMassMachine, pumps: int, *, family: int = 1, intervals: int = 20, rate: float = np.inf,
    stroke: float = np.inf, orbit: Orbit | None = None,
) -> Control:  # fmt: skip
    """Bring a machine from rest in contact onto its lossless orbit with locally least effort.

    pumps : number of swings of the upper mass, each down and up again, with zero speed in between; the machine lifts
        off in the last one
    intervals : of each half swing
    rate, stroke : bounds of the actuator's rate and displacement
    family, orbit : as in `keep_hopping`

    The spring's end is at rest at both ends. Raises `InputError` for an invalid number of pumps, and the errors of
    `steer` and `find`.

    >>> from problems import Hopper, steering
    >>> steering.start_up(Hopper(), pumps=2, stroke=2.0).status
    'optimal'
    """
    pumps, intervals = whole_number("pumps", pumps, "pumps"), whole_number("intervals", intervals, "intervals")
    driven, orbit = Actuated(machine), _lossless(machine, family, orbit)
    stages = _swing_stages(driven.model, pumps, intervals, actuator_limits(driven, rate, stroke), _contact_time(orbit))
    values = {**driven.still, "aim": orbit.alpha, "rest": _rest(driven, orbit)}
    return steer(stages, values, guess=_growing_swings(orbit, values["rest"], pumps))


@in_own_units(lambda run, machine: run_in_units(run, Actuated(machine)), control=())
def rerun(machine: TwoMassMachine, control: Control, hops: int = 0) -> Simulation:
    """Simulate the machine open loop with the inputs of a control, with every event located as in any simulation.

    hops : number of further hops after the control, with the spring's end at rest
    """
    driven, schedule = Actuated(machine), control.schedule(RATE)
    until: dict[str, Any] = {"hops": 1 + hops} if hops else {"time": schedule[0][-1]}
    return simulate(driven, state=_flight_states(driven, control.legs[0], 0.0), schedule=schedule, **until)


@in_own_units((), control=())
def missed(machine: TwoMassMachine, control: Control) -> float:
    """The largest difference, without units, between the final state of a control and that of the open-loop simulation
    at the end of the last contact; infinity where the simulation ends before."""
    last, run = control.legs[-1], rerun(machine, control)
    aim = _flight_states(Actuated(machine), last, last.duration)
    return float(np.abs(run(run.end) - aim).max()) if run.end >= control.end * (1 - 1e-9) else np.inf


@in_own_units(ENERGY, control=())
def work(machine: TwoMassMachine, control: Control) -> tuple[float, float]:
    """The actuator's work on the machine, in the units of its energy: the total, and the positive part only."""
    driven, all_work, positive = Actuated(machine), 0.0, 0.0
    places, weights = np.polynomial.legendre.leggauss(POWER_SAMPLES)
    for leg in control.legs:
        extension, length = driven.model.extension, leg.inputs.steps[0]
        t = leg.inputs.times[:-1, None] + length * (0.5 + 0.5 * places)
        states = _flight_states(driven, leg, t.ravel())
        tension = machine.spring(extension(states) - states[:, -1]).reshape(t.shape)
        power = -driven.values["mass_ratio"] * tension * leg.inputs.row(RATE)[:, :1]
        all_work += float((power @ weights).sum() * length / 2)
        positive += float((np.maximum(power, 0.0) @ weights).sum() * length / 2)
    return all_work, positive


@dataclass(frozen=True)
class _Hop:
    """A hop of a driven machine near a lossless orbit, with flight and contact in `intervals` together."""

    driven: Actuated
    orbit: Orbit
    lossless: bool
    intervals: int
    limits: Limits

    def stages(self, cost: str, periodic: bool):
        """Flight and contact, their intervals shared by duration."""
        times = float(self.orbit.flight_time), _contact_time(self.orbit)
        first = int(np.clip(round(self.intervals * times[0] / sum(times)), 1, self.intervals - 1))
        model, values = self.driven.model, self.driven.values
        counts = first, self.intervals - first
        return _hop_stages(model, model.gap(values), counts, times, self.limits, cost, self.lossless, periodic)

    def starts(self, launch: float) -> list[Any]:
        """Guesses of a hop, or functions that return one; the lossless orbit may not lead to a plastic landing."""
        start = [_lossless_guess(self.driven, self.orbit)]
        return start if self.lossless else [*start, lambda: _undriven_guess(self.driven, launch)]

    def checked(self, result: Control) -> Control:
        """The result, if it turns in flight as often as the orbit; one turn fewer or more if the landing is plastic."""
        flight = result.legs[0].path
        coefficients = flight.coefficients[:, : len(self.driven.model.flight.states)]
        series = self.driven.model.extension.series(coefficients)
        turns, expected = len(piecewise_roots(derivative(series), flight.steps)), 2 * self.orbit.family + 1
        if abs(turns - expected) > (0 if self.lossless else 1):
            raise NoOrbit(
                f"the answer's extension turns {turns} times in flight, that of family {self.orbit.family} {expected} "
                "times: it is another kind of hop; start from the answer for a machine, or a launch, nearer to the "
                "lossless orbit's"
            )
        return result


def _hop(machine, family, orbit, lossless, intervals, rate, stroke) -> _Hop:
    """The hop of checked arguments."""
    driven, orbit = Actuated(machine), _lossless(machine, family, orbit)
    if driven.restitution > 0 and not lossless:
        raise InputError(f"restitution = {driven.restitution:g}: it bounces where it lands plastically; set 0 for that")
    intervals = whole_number("intervals", intervals, "intervals of flight and contact together", 2)
    return _Hop(driven, orbit, bool(lossless), intervals, actuator_limits(driven, rate, stroke))


def _least_effort(hop: _Hop, guess: Control | None) -> Control:
    """A periodic hop of locally least effort."""
    starts = [guess] if guess else hop.starts(hop.orbit.alpha)
    return _cheapest(hop, hop.stages("effort", periodic=True), hop.driven.still, starts)


def _least_peak(hop: _Hop, guess: Control) -> Control:
    """A periodic hop of locally least peak rate, from a result nearby."""
    peak = max(float(np.abs(leg.inputs.row(RATE)).max()) for leg in guess.legs)
    guess = replace(guess, parameters={**guess.parameters, "peak": peak})
    stages, free = hop.stages("peak", periodic=True), {"peak": (0.0, np.inf)}
    result = hop.checked(steer(stages, hop.driven.still, guess=guess, free=free))
    return replace(result, cost=result.parameters["peak"])


def _least_work(hop: _Hop, guess: Control) -> Control:
    """A periodic hop of locally least positive work, from a result nearby."""
    mean = abs(work(hop.driven.machine, guess)[0]) / guess.end
    for share in ROUNDINGS:
        values = {**hop.driven.still, "round": share * mean}
        stages = hop.stages("work", periodic=True)
        guess = hop.checked(steer(stages, values, guess=guess, tolerance=WORK_TOLERANCE))
    return replace(guess, cost=work(hop.driven.machine, guess)[1])


def _cheapest(hop: _Hop, stages, values: dict[str, float], starts: Sequence[Any]) -> Control:
    """The cheapest result from several starts; raises the first one's `NoOrbit` if there is none."""
    results, reasons = [], []
    for start in starts:
        try:
            guess = start if isinstance(start, Control | list) else start()
            results.append(hop.checked(steer(stages, values, guess=guess)))
        except NoOrbit as reason:
            reasons.append(reason)
    if not results:
        raise reasons[0]
    return min(results, key=lambda result: result.cost)


def _lossless(machine: TwoMassMachine, family: int, orbit: Orbit | None) -> Orbit:
    """The orbit without the damping, found if it is None."""
    return orbit or find(machine.with_values(**dict.fromkeys(DAMPERS, 0.0)), family=family)


def _contact_time(orbit: Orbit) -> float:
    """The time of the orbit's contact, which an admissible one has."""
    if orbit.contact_time is None:
        raise NoOrbit("the contact of the lossless orbit does not end, so that no hop is near it")
    return float(orbit.contact_time)


def _flight_states(driven: Actuated, leg: ControlledLeg, t: ArrayLike) -> np.ndarray:
    """Flight states (..., n) of a leg of a result at times (...) since its start."""
    embed, rows = driven.model.embed, leg.path(t)
    return rows[..., : len(embed)] if leg.phase == "flight" else rows[..., : embed.shape[1]] @ embed.T


def _lossless_guess(driven: Actuated, orbit: Orbit) -> list[Guess]:
    """The lossless orbit, the spring's end at rest."""
    onto = np.linalg.pinv(driven.model.embed)
    flight = Guess(float(orbit.flight_time), lambda t: np.append(orbit(t), 0.0))
    return [flight, Guess(_contact_time(orbit), lambda t: onto @ np.append(orbit(orbit.flight_time + t), 0.0))]


def _undriven_guess(driven: Actuated, launch: float) -> list[Guess]:
    """The motion without control: the flight from a launch, and the next contact, which need not join."""
    run = simulate(driven, launch, hops=1)
    contacts = [leg for leg in run.legs if leg.phase == "contact"]
    if run.status != "done" or not contacts:
        text = "from a launch at {launch:.6g} the machine does not hop on by itself: {why}"
        raise NoOrbit(Message(text, launch=Quantity(launch, SPEED), why=run.reason or run.status))
    first, last, (n, m) = run.legs[0].path, contacts[0].path, driven.model.embed.shape
    flown = Guess(float(first.times[-1]), lambda t: first(t)[:n])
    return [flown, Guess(float(last.times[-1]), lambda t: last(t)[:m])]


def _lowest(orbit: Orbit) -> np.ndarray:
    return orbit(float(orbit.flight_time) + _contact_time(orbit) / 2)


def _rest(driven: Actuated, orbit: Orbit) -> float:
    """Where the upper mass rests in contact, between its lowest position on the orbit and lift-off."""
    contact = flow_of(driven.model.contact, tuple(driven.values))
    p, onto = np.array(list(driven.values.values())), np.linalg.pinv(driven.model.embed)
    low, high = (float((onto @ np.append(x, 0.0))[0]) for x in (_lowest(orbit), orbit(0.0)))

    def acceleration(y):
        return float(contact.field(np.array([[y, 0.0, 0.0]]), p)[0][0, 1])

    return bracketed_root(acceleration, low, high, acceleration(low), acceleration(high))


def _growing_swings(orbit: Orbit, rest: float, pumps: int) -> list[Guess]:
    """Swings about rest that grow evenly to the orbit's lowest position."""
    lowest = float(_lowest(orbit)[0])
    count, time = 2 * pumps, 0.85 * _contact_time(orbit)  # a contact is more than one half swing, part of a whole one

    def states(i, t):
        share, side = t / time, 1.0 if i % 2 == 0 else -1.0
        grown, angle = (rest - lowest) * (i + share) / (count - 1), np.pi * share
        return [rest + side * grown * np.cos(angle), -side * grown * np.pi / time * np.sin(angle), 0.0]

    return [Guess(time, partial(states, i)) for i in range(count)]


@lru_cache(maxsize=32)
def _hop_stages(model, gap, intervals, times, limits, cost, lossless, periodic) -> tuple[Stage, Stage]:
    """Flight and contact, as `steer` takes them; the same hop has the same stages, with their compiled functions.

    A hop that is not periodic goes from the parameter "launch" to "aim".
    """
    force, identity, onto = model.contact.watch["contact force"], np.eye(len(model.embed)), np.linalg.pinv(model.embed)
    bounds, inputs = [(SHORTEST_SHARE * time, LONGEST_SHARE * time) for time in times], limits.inputs(cost)

    def gap_speed(x, p):
        p = {**p, RATE: 0.0}
        return Affine(gap.weights).at(model.flight.field(x, p, model.flight.data(x, p)))

    def force_at(x, p):
        return force(x, p, model.contact.data(x, p))

    def lifted(x, before, p):
        if periodic:  # Spring's end and motion could be moved together: the end is at 0 where the cycle begins.
            return [*_difference(x, product(model.embed, before)), x[-1]]
        return _difference(x, model.launch({"liftoff": p["liftoff"], "alpha": p["launch"]}, p))

    def landed(x, p):
        return [gap.at(x), *([gap_speed(x, p), force_at(product(onto, x), p)] if lossless else [])]

    def stuck(x, before, p):
        speed = gap_speed(before, p)
        return _difference(x, product(onto, _difference(before, [speed * share for share in model.impact(before, p)])))

    def launched(x, p):
        return [force_at(x, p), *([] if periodic else [model.contact_speed.at(x) - p["aim"], x[-1]])]

    def approaching(x, p):
        return [] if lossless else [-gap_speed(x, p)]

    def final(x, p):
        return p["peak"] if cost == "peak" else 0.0

    path = {"gap": lambda x, p, q: gap.at(x), **limits.path(identity)}
    running = _running_cost(cost, model, identity)
    flight = Stage(model.flight, intervals[0], bounds[0], inputs, lifted, landed, path, running, final, approaching)
    path, running = {"contact force": force, **limits.path(model.embed)}, _running_cost(cost, model, model.embed)
    contact = Stage(model.contact, intervals[1], bounds[1], inputs, stuck, launched, path, running)
    return flight, contact


@lru_cache(maxsize=32)
def _swing_stages(model, pumps, intervals, limits, time) -> tuple[Stage, ...]:
    """Contact from rest to lift-off, in swings down and up in turn; `time` is that of the lossless orbit's contact."""
    force, speed = model.contact.watch["contact force"], model.contact_speed
    bounds, inputs = (SHORTEST_SHARE * time, LONGEST_SHARE * time), limits.inputs("effort")
    running = _running_cost("effort", model, model.embed)

    def stage(index: int) -> Stage:
        last, name, sign = index == 2 * pumps - 1, *(("rise", 1.0) if index % 2 else ("fall", -1.0))
        margin = 0.0 if last else CONTACT_FORCE_MARGIN

        def start(x, before, p):
            return _difference(x, before if index else [p["rest"], 0.0, 0.0])

        def end(x, p):
            pressed = force(x, p, model.contact.data(x, p))
            return [pressed, speed.at(x) - p["aim"], x[-1]] if last else [speed.at(x)]

        path = {
            "contact force": lambda x, p, q: force(x, p, q) - margin,
            **limits.path(model.embed),
            name: lambda x, p, q: sign * speed.at(x),
        }
        return Stage(model.contact, intervals, bounds, inputs, start, end, path, running)

    return tuple(stage(index) for index in range(2 * pumps))


def _running_cost(kind, model, embed):
    """The cost's rate; positive work is rounded by the parameter "round", see `ROUNDINGS`."""

    def rate(x, p, q):
        effort = EFFORT_WEIGHTS.get(kind, 1.0) * p[RATE] ** 2
        if kind != "work":
            return effort
        power = model.flight_gradient(product(embed, x), p, q)[-1] * p[RATE]
        return 0.5 * (power + (power**2 + p["round"] ** 2) ** 0.5) + effort

    return rate


def _difference(a, b):
    return [one - other for one, other in zip(a, b, strict=True)]
