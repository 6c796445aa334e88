"""Optimal control of a machine with an actuator: to keep it hopping although it is damped, to bring it onto its
lossless orbit or onto the hop at which it is kept, or to start it from rest.

The control is the rate of the actuator's state, constant on each interval. Effort is the integral of w**2 for the end
of a spring that moves, and that of f**2 for a force. A landing is lossless, where the speed and the acceleration of the
gap vanish with it, or plastic: then the speed is free, its energy is lost, and the contact force must press from there
on. With a restitution above 0 the machine would bounce instead, and is refused unless the landing is lossless. The
actuator's state is 0 at lift-off. Source: direct multiple shooting, see `orbits.steer`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial, wraps
from typing import Any, cast

import numpy as np
from scipy.optimize import root

from orbits import Control, InputError, NoOrbit, Orbit, Simulation, find, simulate, steer
from orbits.control import Guess, Stage
from orbits.control.control import control_in_units
from orbits.errors import finite_number, whole_number
from orbits.flow.flow import flow_of
from orbits.laws.law import Algebraic, Parameters, Scalars
from orbits.model.model import Model
from orbits.model.phase import Affine
from orbits.numerics.polynomial_roots import derivative, piecewise_roots
from orbits.numerics.roots import bracketed_root
from orbits.periodic.find import Progress
from orbits.running.exclusive import exclusive
from orbits.simulation.simulated import run_in_units
from orbits.units import ENERGY, LIFTOFF_SPEED, Dimension, Message, Quantity, Units, in_own_units

from .actuated import Actuated, Actuator, Drive, undamped
from .actuated_launch import launch_argument, launched_at
from .actuator_bounds import Limits, actuator_limits, dimensions_of_limits, dimensions_of_rows, product
from .driven import Driven, flight_states, work_done

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
# Multiples of a rate at which least work is sought where it is not found at that rate, each from the result before.
WIDER_RATES = (4.0, 2.0, 1.4, 1.0)


def _costs(driven: Actuated) -> dict[str, Dimension]:
    """The dimensions of the costs: effort is the integral of the square of the rate or of the force."""
    own = driven.dimensions
    driving = own[driven.actuator.state if driven.actuator.is_force else driven.actuator.rate]
    effort = tuple(2 * power for power in driving)
    return {"effort": (effort[0], effort[1] + 1, *effort[2:]), "work": ENERGY, "peak": driving}


def _dimension_of_added(name: str, driven: Actuated) -> Dimension | str:
    """The dimension of a parameter that a hop or a start adds: a peak, or a state at lift-off or at rest."""
    kind, _, state = name.partition(" ")
    if kind == "peak":
        return _costs(driven)["peak"]
    if state:
        return state
    return LIFTOFF_SPEED if kind in ("launch", "aim") else driven.model.launched[0]


def in_units_of_the_machine(function: Callable[..., Control]) -> Callable[..., Driven]:
    """Extend a function of this module to machines in SI, with bounds and speeds in SI; the result has its machine."""

    @exclusive
    @wraps(function)
    def steered(machine: Any, *arguments: object, **options: Any) -> Driven:
        driven = Actuated(machine, options.pop("actuator", None) or Actuator())

        def in_si(control: Control, machine: Any) -> Control:
            units, cost = cast(Units, driven.units), _costs(driven)[options.get("cost", "effort")]
            added = {name: value for name, value in control.parameters.items() if name not in driven.still}
            known = {name: x * units.of(_dimension_of_added(name, driven)) for name, x in added.items()}
            named = {**machine.values, **{name: x for name, x in known.items() if name != "round"}}
            return control_in_units(control, units, cost, named, dimensions_of_rows(driven))

        bounds = dimensions_of_limits(driven)
        with_units = in_own_units(in_si, **bounds, short=LIFTOFF_SPEED, start=(), guess=(), aim=())(function)
        return Driven.of(machine, with_units(machine, *arguments, actuator=driven.actuator, **options), driven.actuator)

    return steered


@in_units_of_the_machine
def keep_hopping(
    machine: Any, *, actuator: Actuator | None = None, family: int = 1, cost: str = "effort", lossless: bool = True,
    intervals: int = 40, rate: float = np.inf, stroke: float = np.inf, force: float = np.inf, power: float = np.inf,
    start: Orbit | None = None, guess: Control | None = None, progress: Progress = None,
) -> Control:  # fmt: skip
    """Keep a damped machine hopping periodically at locally least cost, near its lossless orbit without the damping.

    machine : a `Hopper`, a `Juggler`, or any `Mechanism`, whose springs have smooth laws; dimensionless or in SI
    actuator : an `Actuator`; by default it moves the end of the only spring
    family : number of the family, from 1
    cost : "effort"; "work", the actuator's positive work; or "peak", the largest rate, or for a force its largest
        value. The last two are minimised with a small multiple of the effort added (`EFFORT_WEIGHTS`), and work is
        smoothed (`ROUNDINGS`); the `cost` of the result is without either
    lossless : whether the landing has to be lossless; else it is plastic, see the module
    intervals : of flight and contact together, on each of which the actuator's rate is constant; with few, about 12,
        the contact force after a lossless landing may be too small for a solution to be found
    rate : bound of the rate of the actuator's state, of the end of a spring or of a force; no least work exists without
    stroke : bound of its displacement, in both directions: from the one at lift-off, or for a force, of the distance
        along which it acts, from where the machine rests with its springs unloaded
    force, power : bounds of its force, which is that in the spring for a spring's end, and of its power
    start : the lossless orbit without damping near which the machine is kept; by default it is found. A machine whose
        launch is more than a speed needs it
    guess : the result for a machine nearby
    progress : called with the share of the solves that are done

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
    bounds = {"rate": rate, "stroke": stroke, "force": force, "power": power}
    hop = _hop(Actuated(machine, actuator or Actuator()), family, start, lossless, intervals, bounds)
    if not hop.driven.damped and not (lossless and cost == "effort"):
        return _least_effort(replace(hop, lossless=True), None)
    if cost == "effort":
        return _least_effort(hop, guess)
    if guess is None:  # the other costs have corners: their search starts from a result that is near
        # With a plastic landing, least effort may be far from least work.
        guess = _least_effort(replace(hop, lossless=lossless or cost == "work"), None)
    done = progress or (lambda share: None)
    done(0.3)
    return _least_peak(hop, guess) if cost == "peak" else _least_work(hop, guess, done)


@in_units_of_the_machine
def recover(
    machine: Any, short: float, *, actuator: Actuator | None = None, family: int = 1, lossless: bool = True,
    intervals: int = 40, rate: float = np.inf, stroke: float = np.inf, force: float = np.inf, power: float = np.inf,
    start: Orbit | None = None, aim: Driven | None = None, guess: Control | None = None,
) -> Control:  # fmt: skip
    """Bring a machine back to its lossless launch speed in one hop, with locally least effort.

    short : the lossless launch speed, or that of the aim, minus that of the first lift-off; below 0 the launch is too
        fast. Of a launch that is more than a speed, the other unknowns are those of the aim
    aim : the result of `keep_hopping` for the machine, whose lift-off is then reached in place of the lossless one

    The actuator's state is 0 at both lift-offs. Further arguments and errors are as in `keep_hopping`.

    >>> from problems import Hopper, steering
    >>> back = steering.recover(Hopper(), short=0.1)
    >>> steering.missed(Hopper(), back) < 1e-9
    True
    """
    driven = Actuated(machine, actuator or Actuator())
    bounds = {"rate": rate, "stroke": stroke, "force": force, "power": power}
    hop = _hop(driven, family, start, lossless or (short == 0 and not driven.damped), intervals, bounds)
    reached = _aim(driven, hop.orbit, aim)
    launch = reached["alpha"] - finite_number("short", short)
    if not launch > 0:
        text = "short = {short:g}: the lossless launch speed is {whole:.6g}, and some of it is to be left"
        whole = Quantity(reached["alpha"], LIFTOFF_SPEED)
        raise InputError(Message(text, short=Quantity(short, LIFTOFF_SPEED), whole=whole))
    first = launched_at(driven, reached, launch)
    values = {
        **driven.still, "launch": launch, "aim": reached["alpha"], "liftoff": first["liftoff"],
        **_named("launch", first), **_named("aim", reached),
    }  # fmt: skip
    return _cheapest(hop, hop.stages("effort", periodic=False), values, [guess] if guess else hop.starts(first))


@in_units_of_the_machine
def start_up(
    machine: Any, pumps: int, *, actuator: Actuator | None = None, family: int = 1, intervals: int = 20,
    rate: float = np.inf, stroke: float = np.inf, force: float = np.inf, power: float = np.inf,
    start: Orbit | None = None, aim: Driven | None = None,
) -> Control:  # fmt: skip
    """Bring a machine from rest in contact onto its lossless orbit with locally least effort.

    pumps : number of swings of the upper mass, each down and up again, with zero speed in between; the machine lifts
        off in the last one
    intervals : of each half swing
    aim : the result of `keep_hopping` for the machine: the start then ends in the state in which that hop begins, so
        that its inputs keep the machine hopping; without it, in the launch of the lossless orbit
    actuator, rate, stroke, force, power, family, start : as in `keep_hopping`

    The actuator's state is 0 at both ends. Raises `InputError` for an invalid number of pumps, and the errors of
    `steer` and `find`.

    >>> from problems import Hopper, steering
    >>> steering.start_up(Hopper(), pumps=2, stroke=2.0).status
    'optimal'
    """
    pumps, intervals = whole_number("pumps", pumps, "pumps"), whole_number("intervals", intervals, "intervals")
    driven = Actuated(machine, actuator or Actuator())
    orbit = _lossless(driven, family, start)
    limits = actuator_limits(driven, rate=rate, stroke=stroke, force=force, power=power)
    rest, reached = _rest(driven, orbit), _aim(driven, orbit, aim)
    stages = _swing_stages(driven.drive, pumps, intervals, limits, _contact_time(orbit))
    values = {**driven.still, "aim": reached["alpha"], **_named("aim", reached)}
    values |= {_rest_name(driven, name): place for name, place in rest.items()}
    return steer(stages, values, guess=_growing_swings(driven, orbit, rest, pumps))


@in_own_units(lambda run, driven: run_in_units(run, driven), control=())
def _rerun(driven: Actuated, control: Control, until: Mapping[str, Any]) -> Simulation:
    """Simulate a machine open loop with the inputs of a control."""
    schedule = control.schedule(driven.actuator.rate)
    options = until or {"time": schedule[0][-1]}
    return simulate(driven, state=flight_states(driven, control.legs[0], 0.0), schedule=schedule, **options)


def rerun(machine: Any, control: Control, hops: int = 0) -> Simulation:
    """Simulate the machine open loop with the inputs of a control, with every event located as in any simulation.

    hops : number of further hops after the control, with the actuator at rest
    """
    return _rerun(_of(machine, control), control, {"hops": 1 + hops} if hops else {})


def missed(machine: Any, control: Control) -> float:
    """The largest difference, without units, between the final state of a control and that of the open-loop simulation
    at the end of the last contact; infinity where the simulation ends before."""
    driven, control = _of(machine, control).dimensionless(), control.dimensionless()
    last, run = control.legs[-1], rerun(driven, control)
    aim = flight_states(driven, last, last.duration)
    return float(np.abs(run(run.end) - aim).max()) if run.end >= control.end * (1 - 1e-9) else np.inf


def work(machine: Any, control: Control) -> tuple[float, float]:
    """The actuator's work on the machine, in the units of its energy: the total, and the positive part only."""
    driven = _of(machine, control)
    unit = 1.0 if driven.units is None else driven.units.of(ENERGY)
    done, positive = work_done(driven.dimensionless(), control.dimensionless())
    return done * unit, positive * unit


def _of(machine: Any, control: Control) -> Actuated:
    """The machine with the actuator of a control."""
    return machine if isinstance(machine, Actuated) else Actuated(machine, getattr(control, "actuator", Actuator()))


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
        gap, counts = self.driven.model.gap(self.driven.values), (first, self.intervals - first)
        return _hop_stages(self.driven.drive, gap, counts, times, self.limits, cost, self.lossless, periodic)

    def starts(self, launch: Mapping[str, float]) -> list[Any]:
        """Guesses of a hop from a launch, or functions that return one; the lossless orbit may not lead to a plastic
        landing."""
        start = [_lossless_guess(self.driven, self.orbit)]
        return start if self.lossless else [*start, lambda: _undriven_guess(self.driven, launch)]

    def checked(self, result: Control) -> Control:
        """The result, if it turns in flight as often as the orbit; one turn fewer or more if the landing is plastic."""
        flight, size, extension = result.legs[0].path, len(self.driven.model.flight.states), self.driven.model.extension
        series = extension.series(flight.coefficients[:, :size])
        turns, expected = len(piecewise_roots(derivative(series), flight.steps)), 2 * self.orbit.family + 1
        if abs(turns - expected) > (0 if self.lossless else 1):
            raise NoOrbit(
                f"the answer's extension turns {turns} times in flight, that of family {self.orbit.family} {expected} "
                "times: it is another kind of hop; start from the answer for a machine, or a launch, nearer to the "
                "lossless orbit's"
            )
        return result


def _hop(
    driven: Actuated, family: int, start: Any, lossless: bool, intervals: int, bounds: Mapping[str, float]
) -> _Hop:
    """The hop of checked arguments."""
    orbit = _lossless(driven, family, start)
    if driven.restitution > 0 and not lossless:
        raise InputError(f"restitution = {driven.restitution:g}: it bounces where it lands plastically; set 0 for that")
    intervals = whole_number("intervals", intervals, "intervals of flight and contact together", 2)
    return _Hop(driven, orbit, bool(lossless), intervals, actuator_limits(driven, **bounds))


def _least_effort(hop: _Hop, guess: Control | None) -> Control:
    """A periodic hop of locally least effort."""
    starts = [guess] if guess else hop.starts(_aim(hop.driven, hop.orbit, None))
    return _cheapest(hop, hop.stages("effort", periodic=True), hop.driven.still, starts)


def _least_peak(hop: _Hop, guess: Control) -> Control:
    """A periodic hop of locally least peak, from a result nearby."""
    actuator = hop.driven.actuator
    if actuator.is_force:
        peaks = [np.abs(leg.path.row(actuator.state)[:, 0]).max() for leg in guess.legs]
    else:
        peaks = [np.abs(leg.inputs.row(actuator.rate)).max() for leg in guess.legs]
    guess = replace(guess, parameters={**guess.parameters, "peak": float(max(peaks))})
    stages, free = hop.stages("peak", periodic=True), {"peak": (0.0, np.inf)}
    result = hop.checked(steer(stages, hop.driven.still, guess=guess, free=free))
    return replace(result, cost=result.parameters["peak"])


def _least_work(hop: _Hop, guess: Control, done: Callable[[float], None]) -> Control:
    """A periodic hop of locally least positive work, from a result nearby; where it is not found from there, from that
    at a larger rate."""
    rate, wider = hop.limits.rate, None
    try:
        return _least_work_at(hop, guess, ROUNDINGS, done)
    except NoOrbit as reason:
        first = reason
    for factor in WIDER_RATES:
        limits = replace(hop.limits, rate=factor * rate)
        try:
            wider = _least_work_at(replace(hop, limits=limits), wider or guess, ROUNDINGS, done)
        except NoOrbit:
            if wider is not None:
                break
        else:
            reached = limits.rate
    if wider is not None and reached == rate:
        return wider
    dimension = dimensions_of_limits(hop.driven)["rate"]
    text = "least work at rate = {rate:g} is not found: {reason}; " + (
        "it is found at rate = {reached:g}: take that, or its result as guess= of a rate between"
        if wider is not None
        else "take a larger rate or more intervals, or the result for less damping as guess="
    )
    parts = {"rate": Quantity(rate, dimension), "reason": _without_remedy(first)}
    if wider is not None:
        parts["reached"] = Quantity(reached, dimension)
    raise NoOrbit(Message(text, **parts))


def _least_work_at(hop: _Hop, guess: Control, roundings: Sequence[float], done: Callable[[float], None]) -> Control:
    """A periodic hop of locally least positive work within its rate, from a result nearby, rounded less and less."""
    mean = abs(work_done(hop.driven, guess)[0]) / guess.end
    for number, share in enumerate(roundings):
        values = {**hop.driven.still, "round": share * mean}
        stages = hop.stages("work", periodic=True)
        guess = hop.checked(steer(stages, values, guess=guess, tolerance=WORK_TOLERANCE))
        done((3 + 7 * (number + 1) / len(roundings)) / 10)
    return replace(guess, cost=work_done(hop.driven, guess)[1])


def _without_remedy(reason: NoOrbit) -> str:
    """What an error says without its last clause, which is for those who state stages of their own."""
    text = reason.args[0]
    if isinstance(text, Message):
        return Message(text.pattern.rpartition("; ")[0] or text.pattern, **text.parts)
    return str(text).rpartition("; ")[0] or str(text)


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


def _lossless(driven: Actuated, family: int, start: Any) -> Orbit:
    """The orbit without the damping, found if it is None."""
    states = driven.model.flight.states[:-1]
    if start is None:
        lossless = undamped(driven.machine)
        if not lossless.model.one_speed:
            raise InputError(
                f"a launch of a {driven.model.name} is more than a speed: give start=, the lossless orbit of the "
                "machine without its dampers near which to keep it, as find(machine, start=...)"
            )
        return find(lossless, family=family)
    if not isinstance(start, Orbit):
        raise InputError(f"start = {start!r}; it is an orbit, as find returns it")
    if len(start(0.0)) != len(states):
        raise InputError(f"start has {len(start(0.0))} states, but those of the machine are {', '.join(states)}")
    return start


def _aim(driven: Actuated, orbit: Orbit, aim: Driven | None) -> dict[str, float]:
    """The unknowns of the launch that is reached: that of a hop at which the machine is kept, or of the orbit."""
    if aim is None:
        unknowns = driven.model.launch_at(np.append(orbit(0.0), 0.0))
        return {**{name: float(x) for name, x in unknowns.items()}, "alpha": float(orbit.alpha)}
    if not isinstance(aim, Driven) or not aim.periodic or aim.launch is None:
        raise InputError(f"aim = {aim!r}; it is a hop that repeats itself, as keep_hopping returns it")
    if aim.actuated.describe() != driven.describe():
        raise InputError(
            "aim is a hop of another machine or actuator: keep this one hopping first, keep_hopping(machine)"
        )
    return {name: float(x) for name, x in driven.model.launch_at(aim.legs[0].path(0.0)).items()}


def _named(kind: str, unknowns: Mapping[str, float]) -> dict[str, float]:
    """The unknowns of a launch beside its speed and its "liftoff", as parameters of a kind of launch."""
    return {f"{kind} {name}": x for name, x in unknowns.items() if name not in ("alpha", "liftoff")}


def _contact_time(orbit: Orbit) -> float:
    """The time of the orbit's contact, which an admissible one has."""
    if orbit.contact_time is None:
        raise NoOrbit("the contact of the lossless orbit does not end, so that no hop is near it")
    return float(orbit.contact_time)


def _lossless_guess(driven: Actuated, orbit: Orbit) -> list[Guess]:
    """The lossless orbit, the spring's end at rest."""
    onto = np.linalg.pinv(driven.model.embed)
    flight = Guess(float(orbit.flight_time), lambda t: np.append(orbit(t), 0.0))
    return [flight, Guess(_contact_time(orbit), lambda t: onto @ np.append(orbit(orbit.flight_time + t), 0.0))]


def _undriven_guess(driven: Actuated, launch: Mapping[str, float]) -> list[Guess]:
    """The motion without control: the flight from a launch, and the next contact, which need not join."""
    run = simulate(driven, launch_argument(driven, launch, launch["alpha"]), hops=1)
    contacts = [leg for leg in run.legs if leg.phase == "contact"]
    if run.status != "done" or not contacts:
        text = "from a launch at {launch:.6g} the machine does not hop on by itself: {why}"
        speed = Quantity(launch["alpha"], LIFTOFF_SPEED)
        raise NoOrbit(Message(text, launch=speed, why=run.reason or run.status))
    first, last, (n, m) = run.legs[0].path, contacts[0].path, driven.model.embed.shape
    flown = Guess(float(first.times[-1]), lambda t: first(t)[:n])
    return [flown, Guess(float(last.times[-1]), lambda t: last(t)[:m])]


def _lowest(orbit: Orbit) -> np.ndarray:
    return orbit(float(orbit.flight_time) + _contact_time(orbit) / 2)


def _rest(driven: Actuated, orbit: Orbit) -> dict[str, float]:
    """Where the machine rests in contact: its coordinates there, by name, near their mean over the orbit's contact."""
    model, values = driven.model, driven.values
    contact, p, onto = (
        flow_of(model.contact, tuple(values)),
        np.array(list(values.values())),
        np.linalg.pinv(model.embed),
    )
    names = [name for name in model.contact.states if f"{name}'" in model.contact.states]
    low, high = (onto @ np.append(x, 0.0) for x in (_lowest(orbit), orbit(0.0)))
    size = len(model.contact.states)

    def acceleration(y):
        x = np.zeros((1, size))
        x[0, : 2 * len(names) : 2] = y
        return contact.field(x, p)[0][0, 1 : 2 * len(names) : 2]

    if len(names) == 1:
        ends = float(low[0]), float(high[0])
        return {
            names[0]: bracketed_root(
                lambda y: float(acceleration(y)[0]), *ends, *(float(acceleration(y)[0]) for y in ends)
            )
        }
    found = root(acceleration, (low + high)[: 2 * len(names) : 2] / 2, tol=1e-14)
    if not found.success:
        raise NoOrbit("the machine has no rest in contact near the hop from which it could be started")
    return dict(zip(names, found.x.tolist(), strict=True))


def _rest_name(driven: Actuated, name: str) -> str:
    """The parameter that is the place of rest of a coordinate."""
    return "rest" if name == driven.model.launched[0] else f"rest {name}"


def _growing_swings(driven: Actuated, orbit: Orbit, rest: Mapping[str, float], pumps: int) -> list[Guess]:
    """Swings about rest that grow evenly to the orbit's lowest position."""
    states, onto = driven.model.contact.states, np.linalg.pinv(driven.model.embed)
    lowest = (onto @ np.append(_lowest(orbit), 0.0))[: 2 * len(rest) : 2]
    still = np.array([*rest.values()])
    count, time = 2 * pumps, 0.85 * _contact_time(orbit)  # a contact is more than one half swing, part of a whole one

    def at(i, t):
        share, side = t / time, 1.0 if i % 2 == 0 else -1.0
        grown, angle = (still - lowest) * (i + share) / (count - 1), np.pi * share
        x = np.zeros(len(states))
        x[: 2 * len(rest) : 2] = still + side * grown * np.cos(angle)
        x[1 : 2 * len(rest) : 2] = -side * grown * np.pi / time * np.sin(angle)
        return x

    return [Guess(time, partial(at, i)) for i in range(count)]


@lru_cache(maxsize=32)
def _hop_stages(drive: Drive, gap, intervals, times, limits, cost, lossless, periodic) -> tuple[Stage, Stage]:
    """Flight and contact, as `steer` takes them; the same hop has the same stages, with their compiled functions.

    A hop that is not periodic goes from the parameter "launch" to "aim".
    """
    model = drive.model
    force, identity, onto = model.contact.watch["contact force"], np.eye(len(model.embed)), np.linalg.pinv(model.embed)
    bounds, inputs = [(SHORTEST_SHARE * time, LONGEST_SHARE * time) for time in times], limits.inputs(drive, cost)

    def gap_speed(x, p):
        p = {**p, drive.actuator.rate: 0.0}
        return Affine(gap.weights).at(model.flight.field(x, p, model.flight.data(x, p)))

    def force_at(x, p):
        p = {**p, drive.actuator.rate: 0.0}
        return force(x, p, model.contact.data(x, p))

    def lifted(x, before, p):
        if periodic:  # Spring's end and motion could be moved together: the end is at 0 where the cycle begins.
            return [*_difference(x, product(model.embed, before)), x[-1]]
        others = {name: p[f"launch {name}"] for name in model.launch_unknowns[2:]}
        return _difference(x, model.launch({"liftoff": p["liftoff"], "alpha": p["launch"], **others}, p))

    def landed(x, p):
        return [gap.at(x), *([gap_speed(x, p), force_at(product(onto, x), p)] if lossless else [])]

    def stuck(x, before, p):
        speed = gap_speed(before, p)
        return _difference(x, product(onto, _difference(before, [speed * share for share in model.impact(before, p)])))

    def launched(x, p):
        return [force_at(x, p), *([] if periodic else _reached(model, x, p))]

    def approaching(x, p):
        return [] if lossless else [-gap_speed(x, p)]

    def final(x, p):
        return p["peak"] if cost == "peak" else 0.0

    path = {"gap": lambda x, p, q: gap.at(x), **limits.path(drive, identity, cost)}
    running = _running_cost(cost, drive, identity)
    flight = Stage(model.flight, intervals[0], bounds[0], inputs, lifted, landed, path, running, final, approaching)
    path = {"contact force": force, **limits.path(drive, model.embed, cost)}
    running = _running_cost(cost, drive, model.embed)
    contact = Stage(model.contact, intervals[1], bounds[1], inputs, stuck, launched, path, running)
    return flight, contact


@lru_cache(maxsize=32)
def _swing_stages(drive: Drive, pumps, intervals, limits, time) -> tuple[Stage, ...]:
    """Contact from rest to lift-off, in swings down and up in turn; `time` is that of the lossless orbit's contact."""
    model = drive.model
    force, speed, states = model.contact.watch["contact force"], model.contact_speed, model.contact.states
    bounds, inputs = (SHORTEST_SHARE * time, LONGEST_SHARE * time), limits.inputs(drive, "effort")
    running = _running_cost("effort", drive, model.embed)
    places = {name: "rest" if name == model.launched[0] else f"rest {name}" for name in states if f"{name}'" in states}

    def stage(index: int) -> Stage:
        last, name, sign = index == 2 * pumps - 1, *(("rise", 1.0) if index % 2 else ("fall", -1.0))
        margin = 0.0 if last else CONTACT_FORCE_MARGIN

        def start(x, before, p):
            return _difference(x, before if index else [p[places[name]] if name in places else 0.0 for name in states])

        def end(x, p):
            p = {**p, drive.actuator.rate: 0.0}
            pressed = force(x, p, model.contact.data(x, p))
            return [pressed, *_reached(model, x, p)] if last else [speed.at(x)]

        path = {
            "contact force": lambda x, p, q: force(x, p, q) - margin,
            **limits.path(drive, model.embed, "effort"),
            name: lambda x, p, q: sign * speed.at(x),
        }
        return Stage(model.contact, intervals, bounds, inputs, start, end, path, running)

    return tuple(stage(index) for index in range(2 * pumps))


def _reached(model: Model, x: Scalars, p: Parameters) -> list[Algebraic]:
    """What vanishes in a contact state where the contact force does, if it is the lift-off that is aimed at."""
    others = (x[model.contact.states.index(name)] - p[f"aim {name}"] for name in model.launch_unknowns[2:])
    return [model.contact_speed.at(x) - p["aim"], *others, x[-1]]


def _running_cost(kind: str, drive: Drive, embed: np.ndarray) -> Callable:
    """The cost's rate; positive work is rounded by the parameter "round", see `ROUNDINGS`."""

    def rate(x, p, q):
        effort = EFFORT_WEIGHTS.get(kind, 1.0) * (x[-1] if drive.actuator.is_force else p[drive.actuator.rate]) ** 2
        if kind != "work":
            return effort
        power = drive.power(product(embed, x), p, q)
        return 0.5 * (power + (power**2 + p["round"] ** 2) ** 0.5) + effort

    return rate


def _difference(a, b):
    return [one - other for one, other in zip(a, b, strict=True)]
