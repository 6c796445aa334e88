"""Optimal control of a machine with an actuator: to keep it hopping although it is damped, to bring it onto its
lossless orbit or onto the hop at which it is kept, or to start it from rest.

The control is the rate of the actuator's state, constant on each interval. Effort is the integral of w**2 for the end
of a spring that moves, and that of f**2 for a force. A landing is lossless, where the speed and the acceleration of the
gap vanish with it, or plastic: then the speed is free, its energy is lost, and the contact force must press from there
on. With a restitution above 0 the machine would bounce instead, and is refused unless the landing is lossless. The
actuator's state is 0 at lift-off. Source: direct multiple shooting, see `orbits.steer`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, cast

import numpy as np

from orbits import Control, InputError, Machine, NoOrbit, Orbit, Simulation, find, simulate, steer
from orbits.control import CollapsedStage, HeldLimits, control_in_units
from orbits.errors import finite_number, whole_number
from orbits.hops import run_in_units
from orbits.periodic import StartLike
from orbits.result import Progress
from orbits.running import exclusive
from orbits.units import ENERGY, LIFTOFF_SPEED, Dimension, Message, Quantity, Units, in_own_units

from .actuated import Actuated, Actuator, undamped
from .actuated_launch import launched_at
from .actuator_bounds import (
    Limits,
    SpeedForce,
    actuator_limits,
    bare_speed_force,
    dimensions_of_limits,
    dimensions_of_rows,
)
from .corners import steer_across
from .damping_limit import too_much_damping
from .driven import Driven, flight_states, is_driven_motion_of, work_done
from .first_guesses import contact_time_of, growing_swings, lossless_guess, rest_in_contact, undriven_guess
from .prescribed import LAUNCH_CONDITIONS, OF_THE_ORBIT, of_lossless, prescribed_hop
from .steered_stages import hop_stages, parameter_of_rest, swing_stages
from .turns import turns_of_leg, turns_of_orbit

# Positive work is rounded: power P counts as (P + sqrt(P^2 + round^2))/2, with a share of the mean power as `round`.
# The last of these shares is that of the result; the earlier ones lead there.
ROUNDINGS = (1.0, 0.3, 0.1)
# Tolerance of least work: quadrature is slow near corners of the power, while the motion itself stays smooth.
WORK_TOLERANCE = 1e-7
MOST_INTERVALS, MOST_PUMPS = 10_000, 200  # of a motion, far more than one needs
# Multiples of a rate at which least work is sought where it is not found at that rate, each from the result before.
WIDER_RATES = (4.0, 2.0, 1.4, 1.0)


def dimensions_of_costs(driven: Actuated) -> dict[str, Dimension]:
    """The dimensions of the costs: effort is the integral of the square of the rate or of the force."""
    own = driven.dimensions
    driving = own[driven.actuator.state if driven.actuator.is_force else driven.actuator.rate]
    effort = tuple(2 * power for power in driving)
    return {"effort": (effort[0], effort[1] + 1, *effort[2:]), "work": ENERGY, "peak": driving}


_P = ParamSpec("_P")


def _dimension_of_added(name: str, driven: Actuated) -> Dimension | str:
    """The dimension of a parameter that a hop or a start adds: a peak, what is prescribed, or a state at lift-off or at
    rest."""
    if name in LAUNCH_CONDITIONS:
        return LAUNCH_CONDITIONS[name]
    kind, _, state = name.partition(" ")
    if kind == "peak":
        return dimensions_of_costs(driven)["peak"]
    if state:
        return state
    return LIFTOFF_SPEED if kind in ("launch", "aim") else driven.model.launched[0]


def motion_in_si(driven: Actuated, machine: Any, control: Control, cost: str) -> Control:
    """A dimensionless motion of a machine in SI that is driven, in its units."""
    units = cast(Units, driven.units)
    added = {name: value for name, value in control.parameters.items() if name not in driven.still}
    known = {name: x * units.of(_dimension_of_added(name, driven)) for name, x in added.items()}
    named = {**machine.values, **{name: x for name, x in known.items() if name != "round"}}
    return control_in_units(control, units, dimensions_of_costs(driven)[cost], named, dimensions_of_rows(driven))


def _actuated(machine: Any, actuator: Actuator | None) -> Actuated:
    """The machine with its actuator, by default the one that moves the end of the only spring."""
    return Actuated(machine, Actuator() if actuator is None else actuator)


def in_units_of_the_machine(function: Callable[_P, Control]) -> Callable[_P, Driven]:
    """Extend a function of this module to machines in SI, with bounds and speeds in SI; the result has its machine."""

    def once(machine: Any, *arguments: object, **options: Any) -> Driven:
        driven = _actuated(machine, options.pop("actuator", None))
        if not isinstance(guess := options.get("guess"), Control | None):
            raise InputError(f"guess = {guess!r}; it must be the result for a similar machine")

        def in_si(control: Control, machine: Any) -> Control:
            return motion_in_si(driven, machine, control, options.get("cost", "effort"))

        bounds: dict[str, Any] = {
            **dimensions_of_limits(driven),
            **LAUNCH_CONDITIONS,
            "speed_force": bare_speed_force(driven),
        }
        own: Callable[..., Control] = function
        with_units = in_own_units(in_si, **bounds, short=LIFTOFF_SPEED, start=(), guess=(), aim=())(own)
        options["speed_force"] = HeldLimits(speed_force=options.get("speed_force")).speed_force
        control = with_units(machine, *arguments, actuator=driven.actuator, **options)
        return Driven.of(machine, control, driven.actuator)

    @exclusive
    @wraps(function)
    def steered(machine: Any, *arguments: object, **options: Any) -> Driven:
        try:
            return once(machine, *arguments, **options)
        except CollapsedStage as reason:
            another = lambda machine: once(machine, *arguments, **options)  # noqa: E731
            raise NoOrbit(too_much_damping(another, machine, reason)) from None

    return cast(Callable[_P, Driven], steered)


@in_units_of_the_machine
def keep_hopping(
    machine: Machine, *, actuator: Actuator | None = None, family: int = 1, cost: str = "effort", lossless: bool = True,
    speed: float | None = None, height: float | None = None, period: float | None = None, intervals: int = 40,
    rate: float = np.inf, stroke: float = np.inf, force: float = np.inf, power: float = np.inf,
    speed_force: SpeedForce = None, start: StartLike | None = None, guess: Control | None = None,
    progress: Progress = None,
) -> Control:  # fmt: skip
    """Keep a damped machine hopping periodically at locally least cost, near its lossless orbit without the damping.

    machine : a `Hopper`, a `Juggler`, or any `Mechanism`, dimensionless or in SI, without hysteresis
    actuator : an `Actuator`; by default it moves the end of the only spring
    family : number of the family, from 1
    cost : "effort"; "work", the actuator's positive work; or "peak", the largest rate, or for a force its largest
        value. The last two are minimised with a small multiple of the effort added, and work is
        smoothed (`ROUNDINGS`); the `cost` of the result is without either
    lossless : whether the landing has to be lossless; otherwise it is plastic, see the module
    speed, height : prescribe the launch, by its speed or by the rise of the centre of mass in flight above its place at
        lift-off; both are left free by default
    period : prescribe the duration of flight and contact together; free by default
    intervals : number of intervals of flight and contact together; the actuator's rate is constant on each. With
        few, about 12, the contact force after a lossless landing may be too small for a solution to be found
    rate : bound of the rate of the actuator's state, of the end of a spring or of a force; least work needs this bound
    stroke : bound of its displacement, in both directions, measured from lift-off; for a force, bound of the distance
        along which it acts, measured from the place where the machine rests with its springs unloaded
    force, power : bounds of its force, which for a spring's end is the spring's force, and of its power
    speed_force : (v0, F0) of a motor at a bounded voltage: with v the speed at which it moves along its way, its force
        F lies between -F0 (1 + v/v0) and F0 (1 - v/v0). So it drives with F0 (1 - |v|/v0) at most, and above v0 it can
        only brake
    start : the lossless orbit without damping near which the machine is kept, or a start of `find` that leads there,
        such as its file; by default it is found. A machine whose launch has several numbers needs it
    guess : the result for a machine nearby
    progress : called with the fraction that is done, as in `steer`

    The stages are a flight from lift-off and the contact after it. A machine without losses needs no control if its
    launch is not prescribed, or is that of its lossless orbit: the result is then this orbit for all arguments. Reach a
    hop far from that orbit by `follow` in its speed. Numbers are in the machine's units. Raises the errors of `steer`
    and `find`, and `InputError` for a height that the launch does not fix (`prescribed`).

    >>> from problems import Hopper, steering
    >>> round(steering.keep_hopping(Hopper(damping=0.01)).cost / 0.01**2, 1)
    125.8
    """
    if cost not in ("effort", "work", "peak"):
        raise InputError(f"cost = {cost!r}; it must be 'effort', 'work' or 'peak'")
    if cost == "work" and rate == np.inf:
        raise InputError("without a bound on its rate the positive work has no minimum: give the largest rate")
    bounds = {"rate": rate, "stroke": stroke, "force": force, "power": power, "speed_force": speed_force}
    hop = _hop(_actuated(machine, actuator), family, start, lossless, intervals, bounds)
    hop = replace(hop, prescribed=prescribed_hop(hop.driven, hop.orbit, speed=speed, height=height, period=period))
    if hop.needs_no_control and not (lossless and cost == "effort"):
        return _least_effort(replace(hop, lossless=True), None, progress)
    if cost == "effort":
        return _least_effort(hop, guess, progress)
    if guess is None:  # the other costs have corners: their search starts from a result that is near
        # With a plastic landing, least effort may be far from least work.
        guess = _least_effort(replace(hop, lossless=lossless or cost == "work"), None, _share_of(progress, 0.0, 0.25))
    last = _share_of(progress, 0.25, 1.0)
    return _least_peak(hop, guess, last) if cost == "peak" else _least_work(hop, guess, last)


@in_units_of_the_machine
def recover(
    machine: Machine, short: float, *, actuator: Actuator | None = None, family: int = 1, lossless: bool = True,
    intervals: int = 40, rate: float = np.inf, stroke: float = np.inf, force: float = np.inf, power: float = np.inf,
    speed_force: SpeedForce = None, start: StartLike | None = None, aim: Driven | None = None,
    guess: Control | None = None, progress: Progress = None,
) -> Control:  # fmt: skip
    """Bring a machine back to its lossless launch speed in one hop, with locally least effort.

    short : the lossless launch speed, or the speed of the aim, minus the speed of the first lift-off; below 0 the
        launch is too fast. If a launch has several numbers, its other unknowns are those of the aim
    aim : the result of `keep_hopping` for the machine; the motion then ends at its lift-off, not at the lossless one

    The actuator's state is 0 at both lift-offs. Further arguments and errors are as in `keep_hopping`.

    >>> from problems import Hopper, steering
    >>> back = steering.recover(Hopper(), short=0.1)
    >>> steering.missed(Hopper(), back) < 1e-9
    True
    """
    driven = _actuated(machine, actuator)
    bounds = {"rate": rate, "stroke": stroke, "force": force, "power": power, "speed_force": speed_force}
    hop = _hop(driven, family, start, lossless or (short == 0 and not driven.damped), intervals, bounds)
    reached = _aim(driven, hop.orbit, aim)
    launch = reached["alpha"] - finite_number("short", short)
    if not launch > 0:
        text = "short = {short:g} leaves no launch speed: it lies below the lossless one, {whole:.6g}"
        whole = Quantity(reached["alpha"], LIFTOFF_SPEED)
        raise InputError(Message(text, short=Quantity(short, LIFTOFF_SPEED), whole=whole))
    first = launched_at(driven, reached, launch)
    values = {
        **driven.still, "launch": launch, "aim": reached["alpha"], "liftoff": first["liftoff"],
        **_named("launch", first), **_named("aim", reached),
    }  # fmt: skip
    stages, starts = hop.stages("effort", periodic=False), [guess] if guess is not None else hop.starts(first)
    return _cheapest(hop.steered, stages, values, starts, progress)


@in_units_of_the_machine
def start_up(
    machine: Machine, pumps: int, *, actuator: Actuator | None = None, family: int = 1, intervals: int = 20,
    rate: float = np.inf, stroke: float = np.inf, force: float = np.inf, power: float = np.inf,
    speed_force: SpeedForce = None, start: StartLike | None = None, aim: Driven | None = None,
    progress: Progress = None,
) -> Control:  # fmt: skip
    """Bring a machine from rest in contact onto its lossless orbit with locally least effort.

    pumps : number of swings of the upper mass, each down and up again, with zero speed in between; the machine lifts
        off in the last one
    intervals : of each half swing
    aim : the result of `keep_hopping` for the machine: the start then ends in the state in which that hop begins, so
        that its inputs keep the machine hopping; by default it ends in the launch of the lossless orbit
    actuator, rate, stroke, force, power, speed_force, family, start, progress : as in `keep_hopping`

    The actuator's state is 0 at both ends. Raises `InputError` for an invalid number of pumps, and the errors of
    `steer` and `find`.

    >>> from problems import Hopper, steering
    >>> steering.start_up(Hopper(), pumps=2, stroke=2.0).status
    'optimal'
    """
    pumps, intervals = (
        whole_number("pumps", pumps, "pumps", most=MOST_PUMPS),
        whole_number("intervals", intervals, "intervals", most=MOST_INTERVALS),
    )
    driven = _actuated(machine, actuator)
    orbit = _lossless(driven, family, start)
    limits = actuator_limits(driven, speed_force, rate=rate, stroke=stroke, force=force, power=power)
    rest, reached = rest_in_contact(driven, orbit), _aim(driven, orbit, aim)
    stages = swing_stages(driven.drive, pumps, intervals, limits, contact_time_of(orbit))
    values = {**driven.still, "aim": reached["alpha"], **_named("aim", reached)}
    values |= {parameter_of_rest(driven.model, name): place for name, place in rest.items()}
    # Where a law has corners, the swings decide in which order its pieces are passed.
    guesses = [growing_swings(driven, orbit, rest, pumps, to_liftoff) for to_liftoff in (False, True)]
    return _cheapest(_steered(driven), stages, values, guesses[: 1 + driven.has_corners], progress)


def _steered(driven: Actuated) -> Callable[..., Control]:
    """What steers a machine: `steer`, or that in parts where its law has corners."""
    return steer_across if driven.has_corners else steer


@in_own_units(lambda run, driven: run_in_units(run, driven), control=())
def _rerun(driven: Actuated, control: Control, until: Mapping[str, Any]) -> Simulation:
    """Simulate a machine open loop with the inputs of a control."""
    schedule = control.schedule(driven.actuator.rate)
    options = until or {"time": schedule[0][-1]}
    return simulate(driven, state=flight_states(driven, control.legs[0], 0.0), schedule=schedule, **options)


def rerun(machine: Machine, control: Control, hops: int = 0) -> Simulation:
    """Simulate the machine open loop with the inputs of a control, with every event located as in any simulation.

    hops : number of further hops after the control, with the actuator at rest
    """
    return _rerun(_of(machine, control), control, {"hops": 1 + hops} if hops else {})


def missed(machine: Machine, control: Control) -> float:
    """The largest difference, without units, between the final state of a control and that of the open-loop simulation
    at the end of the last contact; infinity where the simulation ends before."""
    driven, control = _of(machine, control).dimensionless(), control.dimensionless()
    last, run = control.legs[-1], rerun(driven, control)
    aim = flight_states(driven, last, last.duration)
    return float(np.abs(run(run.end) - aim).max()) if run.end >= control.end * (1 - 1e-9) else np.inf


def work(machine: Machine, control: Control) -> tuple[float, float]:
    """The actuator's work on the machine, in the units of its energy: the total, and the positive part only."""
    driven = _of(machine, control)
    done, positive = work_done(driven.dimensionless(), control.dimensionless())
    unit = driven.units.of(ENERGY) if driven.units else 1.0
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
    prescribed: Mapping[str, float] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        """The parameters of the program of a periodic hop."""
        return {**self.driven.still, **self.prescribed}

    @property
    def needs_no_control(self) -> bool:
        """Whether the lossless orbit is the hop."""
        off = (x / of_lossless(self.driven, self.orbit, name) - 1 for name, x in self.prescribed.items())
        return not self.driven.damped and all(abs(each) <= OF_THE_ORBIT for each in off)

    def stages(self, cost: str, periodic: bool):
        """Flight and contact, their intervals shared by duration."""
        times = float(self.orbit.flight_time), contact_time_of(self.orbit)
        first = int(np.clip(round(self.intervals * times[0] / sum(times)), 1, self.intervals - 1))
        gap, counts = self.driven.model.gap(self.driven.values), (first, self.intervals - first)
        own = times, self.limits, cost, self.lossless, periodic, tuple(self.prescribed)
        return hop_stages(self.driven.drive, gap, counts, *own)

    def starts(self, launch: Mapping[str, float]) -> list[Any]:
        """Guesses of a hop from a launch, or functions that return one; the lossless orbit may not lead to a plastic
        landing."""
        start = [lossless_guess(self.driven, self.orbit)]
        return start if self.lossless else [*start, lambda: undriven_guess(self.driven, launch)]

    def steered(self, stages, values: Mapping[str, float], **options: Any) -> Control:
        """A motion through the stages, as `steer` finds it, that is a hop of the same kind as the orbit."""
        return self._checked(_steered(self.driven)(stages, values, **options))

    def _checked(self, result: Control) -> Control:
        """The result, if it turns in flight as often as the orbit, whatever its shallow turns; once more or less if the
        landing is plastic."""
        extension, slack = self.driven.model.extension, 0 if self.lossless else 1
        fewest, most = turns_of_orbit(self.orbit, extension)
        deep, turns = turns_of_leg(result.legs[0], extension)
        if deep > most + slack or turns < fewest - slack:
            raise NoOrbit(
                f"the extension turns {turns} times in the flight found, but {most} times in family "
                f"{self.orbit.family}: this is another kind of hop; pass guess=, the result for less damping or for a "
                "launch nearer to the lossless one, or another number of intervals"
            )
        return result


def _hop(driven: Actuated, family: int, start: Any, lossless: bool, intervals: int, bounds: Mapping[str, Any]) -> _Hop:
    """The hop of checked arguments."""
    orbit = _lossless(driven, family, start)
    if driven.restitution > 0 and not lossless:
        raise InputError(
            f"restitution = {driven.restitution:g}: a free landing must be plastic: set the restitution to 0"
        )
    intervals = whole_number("intervals", intervals, "intervals of flight and contact together", 2, MOST_INTERVALS)
    return _Hop(driven, orbit, bool(lossless), intervals, actuator_limits(driven, **bounds))


def _least_effort(hop: _Hop, guess: Control | None, progress: Progress) -> Control:
    """A periodic hop of locally least effort."""
    starts = [guess] if guess is not None else hop.starts(_aim(hop.driven, hop.orbit, None))
    return _cheapest(hop.steered, hop.stages("effort", periodic=True), hop.values, starts, progress)


def _least_peak(hop: _Hop, guess: Control, progress: Progress) -> Control:
    """A periodic hop of locally least peak, from a result nearby."""
    actuator = hop.driven.actuator
    if actuator.is_force:
        peaks = [np.abs(leg.path.row(actuator.state)[:, 0]).max() for leg in guess.legs]
    else:
        peaks = [np.abs(leg.inputs.row(actuator.rate)).max() for leg in guess.legs]
    guess = replace(guess, parameters={**guess.parameters, "peak": float(max(peaks))})
    stages, free = hop.stages("peak", periodic=True), {"peak": (0.0, np.inf)}
    result = hop.steered(stages, hop.values, guess=guess, free=free, progress=progress)
    return replace(result, cost=result.parameters["peak"])


def _least_work(hop: _Hop, guess: Control, progress: Progress) -> Control:
    """A periodic hop of locally least positive work, from a result nearby; where it is not found from there, from that
    at a larger rate."""
    rate, found, first = hop.limits.rate, None, None
    for factor in (1.0, *WIDER_RATES):
        limits = replace(hop.limits, rate=factor * rate)
        try:
            found = _least_work_at(replace(hop, limits=limits), found or guess, progress)
        except NoOrbit as reason:
            first = first or reason
            if found is not None:
                break
        else:
            reached = limits.rate
            if reached == rate:
                return found
    assert first is not None
    dimension = dimensions_of_limits(hop.driven)["rate"]
    text = "least work at rate = {rate:g} is not found: {reason}; " + (
        "it is found at rate = {reached:g}: take that, or its result as guess= of a rate between"
        if found is not None
        else "take a larger rate or more intervals, or the result for less damping as guess="
    )
    parts = {"rate": Quantity(rate, dimension), "reason": _without_remedy(first)}
    if found is not None:
        parts["reached"] = Quantity(reached, dimension)
    raise NoOrbit(Message(text, **parts))


def _least_work_at(hop: _Hop, guess: Control, progress: Progress) -> Control:
    """A periodic hop of locally least positive work within its rate, from a result nearby, rounded less and less."""
    done, positive = work_done(hop.driven, guess)  # without losses the total is 0
    mean = (abs(done) if hop.driven.damped else positive) / guess.end
    for number, share in enumerate(ROUNDINGS):
        values = {**hop.values, "round": share * mean}
        stages = hop.stages("work", periodic=True)
        part = _share_of(progress, number / len(ROUNDINGS), (number + 1) / len(ROUNDINGS))
        guess = hop.steered(stages, values, guess=guess, tolerance=WORK_TOLERANCE, progress=part)
    return replace(guess, cost=work_done(hop.driven, guess)[1])


def _without_remedy(reason: NoOrbit) -> str:
    """What an error says without its last clause, which is for those who state stages of their own."""
    text = reason.args[0]
    if isinstance(text, Message):
        return Message(text.pattern.rpartition("; ")[0] or text.pattern, **text.parts)
    return str(text).rpartition("; ")[0] or str(text)


def _share_of(progress: Progress, first: float, last: float) -> Progress:
    """Reports the progress of a part of a call, from this share of the whole to that one."""
    return progress and (lambda share: progress(first + (last - first) * share))


def _cheapest(
    solve: Callable[..., Control], stages, values: dict[str, float], starts: Sequence[Any], progress: Progress
) -> Control:
    """The cheapest result of a function like `steer` from several starts; raises the first one's `NoOrbit` if there is
    none."""
    results, reasons = [], []
    for number, start in enumerate(starts):
        part = _share_of(progress, number / len(starts), (number + 1) / len(starts))
        try:
            guess = start() if callable(start) and not isinstance(start, Control) else start
            results.append(solve(stages, values, guess=guess, progress=part))
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
                f"a launch of a {driven.model.name} has several numbers: give start=, a nearby lossless orbit of "
                "the machine without its dampers, such as find(machine, start=...)"
            )
        return find(lossless, family=family)
    if isinstance(start, Mapping | str | Path):
        return find(undamped(driven.machine), start=start)
    if not isinstance(start, Orbit):
        raise InputError(f"start = {start!r}; it must be an orbit, such as find returns")
    if len(start(0.0)) != len(states):
        raise InputError(f"start has {len(start(0.0))} states, but the machine has the states {', '.join(states)}")
    return start


def _aim(driven: Actuated, orbit: Orbit, aim: Driven | None) -> dict[str, float]:
    """The unknowns of the launch that is reached: that of a hop at which the machine is kept, or of the orbit."""
    if aim is None:
        unknowns = driven.model.launch_at(np.append(orbit(0.0), 0.0))
        return {**{name: float(x) for name, x in unknowns.items()}, "alpha": float(orbit.alpha)}
    if not isinstance(aim, Driven) or not aim.periodic or aim.launch is None:
        raise InputError(f"aim = {aim!r}; it must be a periodic hop, such as keep_hopping returns")
    if aim.actuated.describe() != driven.describe() or not is_driven_motion_of(aim, driven):
        raise InputError("aim is a hop of another machine or actuator: find a hop of this one by keep_hopping(machine)")
    return {name: float(x) for name, x in driven.model.launch_at(aim.legs[0].path(0.0)).items()}


def _named(kind: str, unknowns: Mapping[str, float]) -> dict[str, float]:
    """The unknowns of a launch without its speed and its "liftoff", as parameters of a kind of launch."""
    return {f"{kind} {name}": x for name, x in unknowns.items() if name not in ("alpha", "liftoff")}
