"""Steering an actuated machine: kept hopping though it is damped, brought back onto its lossless orbit, or onto it from
rest.

What is steered is the rate w of the spring's end, constant on each interval of control; effort is the integral of
w**2. A landing is lossless, the gap's speed and acceleration vanishing with it, or plastic: then the speed is free, its
energy lost, and the contact must press from there on. With a restitution above 0 the machine would bounce instead: it
is refused unless the landing is lossless.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from orbits import Control, Guess, Input, InputError, NoOrbit, Orbit, Simulation, Stage, find, simulate, steer
from orbits.errors import finite_number, whole_number
from orbits.flow.flow import flow_of
from orbits.model.model import Model
from orbits.model.phase import Affine
from orbits.numerics.bernstein import derivative, piecewise_roots
from orbits.numerics.roots import bracketed_root

from .actuated import RATE, Actuated, along
from .machine import DAMPERS, TwoMassMachine

# Positive work is rounded: power P counts as (P + sqrt(P^2 + round^2))/2, with this share of the mean power as `round`.
ROUND = 0.1
# It is found from where it is rounded more; and to this tolerance, since quadrature is slow near corners, while the
# motion itself stays smooth.
ROUNDER, CORNERS = (1.0, 0.3, ROUND), 1e-7
# What effort counts beside positive work or peak rate, so that it is settled how they are done.
OFFSETS = {"work": 1e-3, "peak": 1e-6}
# The contact presses by as much, in units of what the actuator's spring pulls, wherever it is to press: open loop it
# would else be lost where it touches zero.
SEPARATION_MARGIN = 1e-7
# Bounds of durations, in those of the lossless orbit.
SHORTEST_SHARE, LONGEST_SHARE = 0.1, 4.0
# Points of a control interval at which the actuator's power is taken.
SAMPLES_PER_LEG = 40


def keep_hopping(
    machine: TwoMassMachine, *, family: int = 1, cost: str = "effort", lossless: bool = True, intervals: int = 40,
    rate: float = np.inf, stroke: float = np.inf, orbit: Orbit | None = None, guess: Control | None = None,
) -> Control:  # fmt: skip
    """Keep a damped machine hopping periodically at locally least cost, near its lossless orbit without the damping.

    cost : "effort"; "work", the actuator's positive work; or "peak", the largest rate. These two are found with a
        little of the effort beside them, see `OFFSETS`, and work rounded, see `ROUND`; the answer's `cost` is without
    lossless : whether it has to land so; else the impact takes what it takes, see the module
    intervals : of flight and contact together, on each of which the actuator's rate is held; with few, about 12,
        contact presses too little after a lossless landing for an answer to be found
    rate, stroke : bounds of the actuator's rate, without which no least work exists, and displacement
    orbit : the lossless orbit, found if it is not given
    guess : the answer for a machine nearby

    The stages are a flight from lift-off and the contact after it. A machine that loses nothing needs nothing: its
    answer is the lossless orbit, whatever is asked. Raises as `steer` and `find` do.
    """
    if cost not in ("effort", "work", "peak"):
        raise InputError(f"cost = {cost!r}; it is 'effort', 'work' or 'peak'")
    if cost == "work" and rate == np.inf:
        raise InputError("least positive work is done by jerks: give the largest rate")
    limits = {"lossless": lossless, "intervals": intervals, "rate": rate, "stroke": stroke}
    driven, orbit = Actuated(machine), _lossless(machine, family, orbit)
    hop, values = _hop(driven, orbit, cost=cost, periodic=True, **limits), driven.still
    if _loses_nothing(machine) and not (lossless and cost == "effort"):
        return keep_hopping(machine, orbit=orbit, **{**limits, "lossless": True})
    if cost != "effort" and guess is None:  # they have corners: from an answer that is near
        # Landing as it likes, least effort may be far from least work.
        near = {**limits, "lossless": lossless or cost == "work"}
        guess = keep_hopping(machine, orbit=orbit, **near)
    if cost == "peak":
        most = max(float(np.abs(leg.inputs.row(RATE)).max()) for leg in guess.legs)
        guess = replace(guess, parameters={**guess.parameters, "peak": most})
    if cost == "work":
        mean = abs(work(machine, guess)[0]) / guess.end
        for share in ROUNDER:
            given = {**values, "round": share * mean}
            guess = _of_family(steer(hop, given, guess=guess, tolerance=CORNERS), driven, orbit, lossless)
        return replace(guess, cost=work(machine, guess)[1])
    starts = [guess] if guess else _starts(driven, orbit, orbit.alpha, lossless)
    found = _cheapest(hop, values, starts, driven, orbit, lossless, {"peak": (0.0, np.inf)} if cost == "peak" else None)
    return replace(found, cost=found.parameters["peak"]) if cost == "peak" else found


def recover(
    machine: TwoMassMachine, short: float, *, family: int = 1, lossless: bool = True, intervals: int = 40,
    rate: float = np.inf, stroke: float = np.inf, orbit: Orbit | None = None, guess: Control | None = None,
) -> Control:  # fmt: skip
    """Bring a machine from a lift-off `short` of the lossless launch speed back to that in one hop, with locally least
    effort; below 0 the launch is too fast.

    The spring's end is at rest at both. Arguments and errors as in `keep_hopping`.
    """
    driven, orbit = Actuated(machine), _lossless(machine, family, orbit)
    launch = orbit.alpha - finite_number("short", short)
    if not launch > 0:
        raise InputError(
            f"short = {short:g}: the lossless launch speed is {orbit.alpha:.6g}, and some of it is to be left"
        )
    lossless = lossless or (short == 0 and _loses_nothing(machine))
    hop = _hop(driven, orbit, intervals, rate, stroke, "effort", lossless, False)
    aims = {"launch": launch, "aim": orbit.alpha, "liftoff": float(machine.model.release(launch, machine.values))}
    starts = [guess] if guess else _starts(driven, orbit, launch, lossless)
    return _cheapest(hop, {**driven.still, **aims}, starts, driven, orbit, lossless)


def start_up(
    machine: TwoMassMachine, pumps: int, *, family: int = 1, intervals: int = 20, rate: float = np.inf,
    stroke: float = np.inf, orbit: Orbit | None = None,
) -> Control:  # fmt: skip
    """Bring a machine from rest in contact onto its lossless orbit with locally least effort.

    pumps : how often the upper mass swings down and up again, turning at the ends of each; it lifts off out of the last
    intervals : of each swing
    rate, stroke : bounds of the actuator's rate and displacement

    The spring's end is at rest at both ends. Raises `InputError` for a number of pumps that cannot be, else as `steer`
    and `find` do.
    """
    pumps, intervals = whole_number("pumps", pumps, "pumps"), whole_number("intervals", intervals, "intervals")
    driven, orbit = Actuated(machine), _lossless(machine, family, orbit)
    stages = _swings(driven.model, pumps, intervals, _actuator_limits(driven, rate, stroke), float(orbit.contact_time))
    values = {**driven.still, "aim": orbit.alpha, "rest": _rest(driven, orbit)}
    return steer(stages, values, guess=_pumped(orbit, values["rest"], pumps))


def _lossless(machine: TwoMassMachine, family: int, orbit: Orbit | None) -> Orbit:
    """The orbit without the damping, found if it is not given."""
    return orbit or find(machine.with_values(**dict.fromkeys(DAMPERS, 0.0)), family=family)


def _loses_nothing(machine: TwoMassMachine) -> bool:
    return not any(getattr(machine, name) for name in DAMPERS)


def _starts(driven: Actuated, orbit: Orbit, launch: float, lossless: bool) -> list:
    """Guesses of a hop, or functions that give one; from the lossless orbit a plastic landing may not be found."""
    return [_lossless_guess(driven, orbit)] + ([] if lossless else [lambda: _undriven_guess(driven, launch)])


def _cheapest(hop, values, starts, driven: Actuated, orbit: Orbit, lossless: bool, free=None) -> Control:
    """The cheapest answer from several starts; raises what is in the way from the first if there is none."""
    found, reasons = [], []
    for start in starts:
        try:
            guess = start() if callable(start) else start
            found.append(_of_family(steer(hop, values, guess=guess, free=free), driven, orbit, lossless))
        except NoOrbit as reason:
            reasons.append(reason)
    if not found:
        raise reasons[0]
    return min(found, key=lambda one: one.cost)


def rerun(machine: TwoMassMachine, control: Control, hops: int = 0) -> Simulation:
    """The machine driven open loop by the schedule of an answer, every event found as in any simulation; and then so
    many hops more, the spring's end at rest."""
    driven, schedule = Actuated(machine), control.schedule(RATE)
    x = _flight_states(driven, control.legs[0], 0.0)
    if not hops:
        return simulate(driven, state=x, schedule=schedule, time=schedule[0][-1])
    return simulate(driven, state=x, schedule=schedule, hops=1 + hops)


def missed(machine: TwoMassMachine, control: Control) -> float:
    """The most by which the machine, driven open loop by the answer's schedule, ends its last contact elsewhere."""
    last, run = control.legs[-1], rerun(machine, control)
    aim = _flight_states(Actuated(machine), last, last.duration)
    return float(np.abs(run(run.end) - aim).max()) if run.end >= control.end * (1 - 1e-9) else np.inf


def work(machine: TwoMassMachine, control: Control) -> tuple[float, float]:
    """The actuator's work on the machine, in the units of its energy: all of it, and its positive part alone."""
    driven, done, positive = Actuated(machine), 0.0, 0.0
    places, weights = np.polynomial.legendre.leggauss(SAMPLES_PER_LEG)
    for leg in control.legs:
        extension = driven.model.extension
        length = leg.inputs.steps[0]
        t = leg.inputs.times[:-1, None] + length * (0.5 + 0.5 * places)
        states = _flight_states(driven, leg, t.ravel())
        tension = machine.spring(extension(states) - states[:, -1]).reshape(t.shape)
        power = -driven.values["mass_ratio"] * tension * leg.inputs.row(RATE)[:, :1]
        done += float((power @ weights).sum() * length / 2)
        positive += float((np.maximum(power, 0.0) @ weights).sum() * length / 2)
    return done, positive


def _flight_states(driven: Actuated, leg, t) -> np.ndarray:
    """Flight states (..., n) of a leg of an answer at times (...) since its start."""
    embed, rows = driven.model.embed, leg.path(t)
    return rows[..., : len(embed)] if leg.phase == "flight" else rows[..., : embed.shape[1]] @ embed.T


def _matrix_times(matrix: np.ndarray, x) -> list:
    """The product of a matrix of numbers with a state's expressions."""
    return [along(Affine(tuple(row)), x) for row in matrix.tolist()]


def _less(a, b) -> list:
    return [one - other for one, other in zip(a, b, strict=True)]


@dataclass(frozen=True)
class Limits:
    """Bounds of the actuator's rate and displacement, and the distance that is to stay positive, if it is known."""

    rate: float
    stroke: float
    separation: Affine | None

    def inputs(self, cost: str) -> dict[str, Input]:
        """The rate as the stages' input; with least peak, that bounds it too."""
        if cost == "peak":
            return {RATE: Input(lambda p: -p["peak"], lambda p: p["peak"])}
        return {RATE: Input(-self.rate, self.rate)}

    def path(self, embed: np.ndarray) -> dict[str, Callable]:
        """What else stays positive, of states that `embed` makes flight states of."""
        held = {}
        if np.isfinite(self.stroke):
            held["room to pull"] = lambda x, p, q: self.stroke - x[-1]
            held["room to push"] = lambda x, p, q: self.stroke + x[-1]
        if self.separation:
            held["separation"] = lambda x, p, q: along(self.separation, _matrix_times(embed, x))
        return held


def _actuator_limits(driven: Actuated, rate: float, stroke: float) -> Limits:
    for name, bound in (("rate", rate), ("stroke", stroke)):
        if not (bound == np.inf or finite_number(name, bound) > 0):
            raise InputError(f"{name} = {bound:g}: the actuator's bound is above 0")
    return Limits(float(rate), float(stroke), driven.model.separation(driven.values))


def _cost(kind: str, model: Model, embed: np.ndarray) -> Callable:
    """The running cost; see `keep_hopping`."""
    effort = lambda x, p, q: OFFSETS.get(kind, 1.0) * p[RATE] ** 2  # noqa: E731

    def worked(x, p, q):
        power = model.flight_gradient(_matrix_times(embed, x), p, q)[-1] * p[RATE]
        return 0.5 * (power + (power**2 + p["round"] ** 2) ** 0.5) + effort(x, p, q)

    return worked if kind == "work" else effort


def _hop(driven: Actuated, orbit: Orbit, intervals: int, rate, stroke, cost: str, lossless: bool, periodic: bool):
    """Flight and contact, their intervals shared by duration."""
    if driven.restitution > 0 and not lossless:
        raise InputError(f"restitution = {driven.restitution:g}: it bounces where it lands plastically; set 0 for that")
    intervals = whole_number("intervals", intervals, "intervals of flight and contact together", 2)
    times = float(orbit.flight_time), float(orbit.contact_time)
    first = int(np.clip(round(intervals * times[0] / sum(times)), 1, intervals - 1))
    limits, model, values = _actuator_limits(driven, rate, stroke), driven.model, driven.values
    gap, impact = model.gap(values), tuple(model.impact(values).tolist())
    counts = first, intervals - first
    return _hop_stages(model, gap, impact, counts, times, limits, cost, bool(lossless), periodic)


@lru_cache(maxsize=32)
def _hop_stages(model: Model, gap: Affine, impact, counts, times, limits: Limits, cost, lossless, periodic):
    embed = model.embed
    onto, identity = np.linalg.pinv(embed), np.eye(len(embed))
    force = model.contact.watch["contact force"]

    def gap_speed(x, p):
        return along(Affine(gap.weights), model.flight.field(x, {**p, RATE: 0.0}, []))

    def lifted(x, before, p):
        start = (
            _matrix_times(embed, before)
            if periodic
            else [*model.launch({"liftoff": p["liftoff"], "alpha": p["launch"]}, p)]
        )
        return _less(x, start)

    def landed(x, p):
        loss_free = [gap_speed(x, p), force(_matrix_times(onto, x), p, [])] if lossless else []
        return [along(gap, x), *loss_free]

    def stuck(x, before, p):
        speed = gap_speed(before, p)
        return _less(x, _matrix_times(onto, [part - speed * blow for part, blow in zip(before, impact, strict=True)]))

    def launched(x, p):
        return [force(x, p, [])] + ([] if periodic else [along(model.contact_speed, x) - p["aim"], x[-1]])

    spans = [(SHORTEST_SHARE * time, LONGEST_SHARE * time) for time in times]
    flight = Stage(
        model.flight, counts[0], spans[0], limits.inputs(cost), lifted, landed,
        {"gap": lambda x, p, q: along(gap, x), **limits.path(identity)}, _cost(cost, model, identity),
        (lambda x, p: p["peak"]) if cost == "peak" else (lambda x, p: 0.0),
        lambda x, p: [] if lossless else [-gap_speed(x, p)],
    )  # fmt: skip
    contact = Stage(
        model.contact, counts[1], spans[1], limits.inputs(cost), stuck, launched,
        {"contact force": force, **limits.path(embed)}, _cost(cost, model, embed),
    )  # fmt: skip
    return flight, contact


def _of_family(answer: Control, driven: Actuated, orbit: Orbit, lossless: bool) -> Control:
    """The answer, if its flight has as many turns of the extension as the orbit's, or, where it may land as it likes
    and thus earlier or later, one fewer or more."""
    flight = answer.legs[0].path
    series = driven.model.extension.series(flight.coefficients[:, : len(driven.model.flight.states)])
    turns, wanted = len(piecewise_roots(derivative(series), flight.steps)), 2 * orbit.family + 1
    if abs(turns - wanted) > (0 if lossless else 1):
        raise NoOrbit(
            f"the answer's extension turns {turns} times in flight, that of family {orbit.family} {wanted} times: it "
            "is another kind of hop; start from the answer for a machine, or a launch, nearer to the lossless orbit's"
        )
    return answer


def _lossless_guess(driven: Actuated, orbit: Orbit) -> list[Guess]:
    """The lossless orbit, the spring's end at rest."""
    onto = np.linalg.pinv(driven.model.embed)
    flight = lambda t: np.append(orbit(t), 0.0)  # noqa: E731
    contact = lambda t: onto @ np.append(orbit(orbit.flight_time + t), 0.0)  # noqa: E731
    return [Guess(float(orbit.flight_time), flight), Guess(float(orbit.contact_time), contact)]


def _undriven_guess(driven: Actuated, launch: float) -> list[Guess]:
    """What the machine does by itself: the flight from a launch, and the next contact, which need not join."""
    run = simulate(driven, launch, hops=1)
    contacts = [leg for leg in run.legs if leg.phase == "contact"]
    if run.status != "done" or not contacts:
        raise NoOrbit(
            f"from a launch at {launch:.6g} the machine does not hop on by itself: {run.reason or run.status}"
        )
    first, last = run.legs[0].path, contacts[0].path
    ends = (float(path.times[-1]) for path in (first, last))
    sizes = len(driven.model.embed), driven.model.embed.shape[1]
    return [
        Guess(end, lambda t, path=path, size=size: path(t)[:size])
        for end, path, size in zip(ends, (first, last), sizes, strict=True)
    ]


@lru_cache(maxsize=32)
def _swings(model: Model, pumps: int, intervals: int, limits: Limits, time: float) -> tuple[Stage, ...]:
    """Contact from rest to lift-off, down and up in turn."""
    force, speed = model.contact.watch["contact force"], model.contact_speed
    begin = lambda x, before, p: [x[0] - p["rest"], x[1], x[2]]  # noqa: E731
    on = lambda x, before, p: _less(x, before)  # noqa: E731
    turn = lambda x, p: [along(speed, x)]  # noqa: E731
    leave = lambda x, p: [force(x, p, []), along(speed, x) - p["aim"], x[-1]]  # noqa: E731
    stages = []
    for i in range(2 * pumps):
        sign = 1.0 if i % 2 else -1.0
        last = i == 2 * pumps - 1
        margin = 0.0 if last else SEPARATION_MARGIN
        path = {"contact force": lambda x, p, q, margin=margin: force(x, p, q) - margin}
        path |= limits.path(model.embed)
        path["rise" if i % 2 else "fall"] = lambda x, p, q, sign=sign: sign * along(speed, x)
        stages.append(
            Stage(
                model.contact,
                intervals,
                (SHORTEST_SHARE * time, LONGEST_SHARE * time),
                limits.inputs("effort"),
                on if i else begin,
                turn if i < 2 * pumps - 1 else leave,
                path,
                _cost("effort", model, model.embed),
            )
        )
    return tuple(stages)


def _rest(driven: Actuated, orbit: Orbit) -> float:
    """Where the upper mass rests in contact, between its lowest place on the orbit and lift-off."""
    contact = flow_of(driven.model.contact, tuple(driven.values))
    p, onto = list(driven.values.values()), np.linalg.pinv(driven.model.embed)
    low, high = (float((onto @ np.append(orbit(t), 0.0))[0]) for t in (orbit.flight_time + orbit.contact_time / 2, 0.0))
    pull = lambda y: float(contact.rates([y, 0.0, 0.0], p)[1])  # noqa: E731
    return bracketed_root(pull, low, high, pull(low), pull(high))


def _pumped(orbit: Orbit, rest: float, pumps: int) -> list[Guess]:
    """Swings about rest that grow evenly to the orbit's lowest place."""
    lowest = float(orbit(orbit.flight_time + orbit.contact_time / 2)[0])
    count, time = 2 * pumps, 0.85 * float(orbit.contact_time)  # it takes part of a swing more than half of one

    def swing(i):
        def states(t):
            share = t / time
            grown, side = (rest - lowest) * (i + share) / (count - 1), 1.0 if i % 2 == 0 else -1.0
            angle = np.pi * share
            return [rest + side * grown * np.cos(angle), -side * grown * np.pi / time * np.sin(angle), 0.0]

        return states

    return [Guess(time, swing(i)) for i in range(count)]
