"""Optimal control of motions through several phases with free durations, by direct multiple shooting and Ipopt.

The inputs of a stage are polynomials on each of its equal intervals, which are joined by Taylor steps with exact first
and second derivatives. The solution is integrated from each stage's start by the accurate flow, and steps are halved
until both agree. Where path expressions fall below zero on the dense polynomials they are constrained at that point
too: an exchange method, see Hettich and Kortanek, "Semi-infinite programming", SIAM Review 35, 1993.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import FlowError, InputError, NoOrbit, finite_number, is_list, whole_number
from ..result import Progress
from ..running import exclusive, interrupts
from ..symbolic import Minimum
from ..units import TIME, Message, Quantity
from .control import Control, ControlledLeg, WarmStart
from .rollout import MotionRollout, roll_out
from .stage import Stage, check_range, check_stage
from .transcription import StageUnknowns, Transcription, transcription


class SteerOptions(NamedTuple):
    """The limits of the search for a controlled motion."""

    rounds: int = 30  # solves, each after an exchange, a halving of steps, or a new unit of the cost
    work: int = 300_000  # steps in all intervals, summed over the iterations of all solves, after which none begins
    substeps: int = 64  # most steps in an interval
    halvings: int = 8  # halvings of all intervals after which the cost has to settle
    finest_tolerance: float = 1e-13  # below this rounding decides whether a tolerance is met
    smallest_scaled_cost: float = 0.1  # in its unit the cost lies between this and one over this
    negligible_cost: float = 1e-20  # a cost below this is zero, and has no unit
    inset: float = 1e-9  # inputs of a guess, which may jump, are sampled this share of an interval away from its ends
    at_bound: float = 1e-4  # a value this close to a bound is at it, relative to it or to one
    # A violation that falls by no more than `stalled` from round to round is one of the steps, unless their error is a
    # smaller share of it than `of_the_steps`: then the search goes on exchanging points.
    stalled: float = 0.5
    of_the_steps: float = 1e-4
    runaway: float = 1e3  # a duration without an upper bound that grows by this factor has no minimum

    def needs_unit(self, cost: float, unit: float = 1.0) -> bool:
        """Whether a cost has a size that is not of order one in a unit."""
        of_order_one = self.smallest_scaled_cost < cost / unit < 1 / self.smallest_scaled_cost
        return self.negligible_cost < cost < np.inf and not of_order_one


STEER_OPTIONS = SteerOptions()


@dataclass(frozen=True)
class Guess:
    """An initial guess for a stage.

    duration : of the stage
    states : time since the start of the stage -> states (n,)
    inputs : inputs by name, each a number or a function of that time
    """

    duration: float
    states: Callable[[float], ArrayLike]
    inputs: Mapping[str, float | Callable[[float], float]] = field(default_factory=dict)


class CollapsedStage(NoOrbit):
    """Least cost is where a stage is as short as it may be."""


@exclusive
def steer(
    stages: Sequence[Stage], parameters: Mapping[str, float] | None = None, *, guess: Sequence[Guess] | Control,
    free: Mapping[str, tuple[float, float]] | None = None, tolerance: float = 1e-9, refine: float | None = None,
    rounds: int = STEER_OPTIONS.rounds, progress: Progress = None,
) -> Control:  # fmt: skip
    """Find a motion of locally least cost through `stages`, one after the other: no motion near it costs less.

    stages : in order, each a `Stage`
    parameters : values by name of the parameters `p` of the stages that are neither inputs nor free
    guess : a `Guess` for each stage, or a nearby `Control`, whose multipliers are used too if the stages are the same
    free : bounds (low, high) of further parameters, which are optimised too. They start in the middle, or at the bound
        if the other bound is infinite, or at the values in the guess's `parameters`
    tolerance : the largest violation and error allowed
    refine : all intervals are halved until the relative change of the cost is at most this. With None they are not
        halved, so it is not known how much finer intervals would save
    rounds : most solves of the nonlinear program, each after the conditions or the steps have been made finer
    progress : called after each solve of the nonlinear program with the share done: 1/2 after the first, 3/4 after the
        second, and 1 at the end, since the number of solves is not known before

    Ipopt solves the nonlinear program of direct multiple shooting, and the accurate flow integrates its solution again.
    Raises `InputError` for invalid arguments and for bounds that conflict, and `NoOrbit`, with the reason, where there
    is no such motion, where a stage collapses or runs away, where the cost has no lower bound, or where the guess leads
    to no motion.

    >>> from orbits import steer
    >>> from orbits.control import Guess, Input, Stage
    >>> from orbits.model import Phase
    >>> cart = Phase("cart", ("x", "v"), lambda x, p, q: [x[1], p["f"]])
    >>> ends = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - 1, x[1]]}
    >>> stage = Stage(cart, 4, (1, 1), {"f": Input(degree=1)}, **ends, running=lambda x, p, q: p["f"] ** 2)
    >>> round(steer([stage], guess=[Guess(1.0, lambda t: [t, 1.0])]).cost, 9)
    12.0
    """
    began = time.perf_counter()
    if not is_list(stages) or not all(isinstance(stage, Stage) for stage in stages):
        raise InputError(f"stages = {stages!r}; they must be a list, each a Stage")
    for name, value in (("parameters", parameters), ("free", free)):
        if not isinstance(value, Mapping | None):
            raise InputError(f"{name} = {value!r}; it must be a mapping of names")
    stages, parameters, free = tuple(stages), dict(parameters or {}), dict(free or {})
    _check(stages, parameters, free, tolerance)
    if refine is not None and not finite_number("refine", refine) > tolerance:
        raise InputError(f"refine = {refine:g}; it must be a share of the cost above the tolerance, {tolerance:g}")
    rounds, solves, report = whole_number("rounds", rounds, "solves"), count(1), progress or (lambda share: None)
    solved = lambda: report(1 - 0.5 ** next(solves))  # noqa: E731
    with interrupts.deferred():
        found = steered_on_intervals(stages, parameters, free, guess, tolerance, rounds, solved)
        if refine is not None:
            found = _halved(found, stages, parameters, free, tolerance, refine, rounds, solved)
    report(1.0)
    return replace(found, seconds=time.perf_counter() - began)


def _check(stages, parameters: Mapping, free: Mapping, tolerance: float) -> None:
    """Raise `InputError` for invalid arguments."""
    finest = STEER_OPTIONS.finest_tolerance
    if not finite_number("tolerance", tolerance) >= finest:
        raise InputError(f"tolerance = {tolerance:g}; because of rounding it must be at least {finest:g}")
    if not stages:
        raise InputError("there are no stages: give at least one")
    for number, stage in enumerate(stages, start=1):
        check_stage(number, stage, {*parameters, *free})
    for name, bounds in free.items():
        if name in parameters:
            raise InputError(f"parameter '{name}' has a value and is also free: choose one")
        check_range(f"parameter '{name}'", bounds)
    for name, value in parameters.items():
        finite_number(f"parameter '{name}'", value)


def _halved(
    found: Control, stages, parameters, free, tolerance: float, refine: float, rounds: int, solved: Callable
) -> Control:
    """The motion on intervals that are halved until its cost converges."""
    for _ in range(STEER_OPTIONS.halvings):
        stages = tuple(replace(stage, intervals=2 * stage.intervals) for stage in stages)
        finer = steered_on_intervals(stages, parameters, free, found, tolerance, rounds, solved)
        coarseness = abs(finer.cost - found.cost) / max(abs(finer.cost), STEER_OPTIONS.negligible_cost)
        iterations, solves = found.iterations + finer.iterations, found.rounds + finer.rounds
        found = replace(finer, coarseness=coarseness, iterations=iterations, rounds=solves)
        if coarseness <= refine:
            return found
    raise NoOrbit(
        f"the cost still changes by the share {coarseness:.1e} with {stages[0].intervals} intervals in the first "
        "stage; start with more, raise the degree of the inputs, or take a larger `refine`"
    )


def steered_on_intervals(
    stages: tuple[Stage, ...], parameters: Mapping[str, float], free: Mapping[str, tuple[float, float]],
    guess: Sequence[Guess] | Control | WarmStart, tolerance: float, most_rounds: int = STEER_OPTIONS.rounds,
    solved: Callable[[], None] = lambda: None,
) -> Control:  # fmt: skip
    """The motion on the stated intervals, as `steer` finds it; `solved` is called after each solve."""
    try:
        problem = transcription(stages, tuple(parameters), tuple(free), (1,) * len(stages), ())
    except KeyError as error:
        raise InputError(f"a stage uses {error}, which is neither one of its inputs nor a parameter") from None
    bounds, fixed = problem.bounds(free), np.array(list(parameters.values()), dtype=float)
    current = _warm_or_cold_start(problem, guess, free, bounds, fixed)
    first, iterations, work = current.problem.unpack(current.x), 0, 0
    motion: MotionRollout | None = None
    for rounds in range(1, most_rounds + 1):
        interrupts.heed()
        found = _minimum(current, fixed, bounds)
        iterations += found.iterations
        work += found.iterations * current.problem.steps
        solved()
        if found.kind != "minimum":
            raise NoOrbit(_reason_of_failure(current.problem, found))
        current = replace(current, x=found.x, multipliers=found.multipliers)
        _check_not_away(stages, first, problem.unpack(current.x))
        if STEER_OPTIONS.needs_unit(size := abs(found.cost), current.unit):
            factor, (bound, held) = current.unit / size, found.multipliers
            current = replace(current, unit=size, multipliers=(factor * bound, factor * held))
            continue
        before = motion
        try:
            motion = roll_out(current, found.cost, fixed)
        except FlowError as reason:
            text = (
                "the search reached a motion that cannot be followed: {reason}; begin nearer to a motion, with guess="
            )
            raise NoOrbit(Message(text, reason=reason)) from reason
        _check_not_collapsed(stages, [of.unknowns for of in motion.stages])
        if motion.error <= tolerance and motion.violation <= tolerance:
            return motion.control(replace(current, tolerance=tolerance), iterations, rounds)
        stalled = before is not None and motion.violation > STEER_OPTIONS.stalled * before.violation
        stalled = stalled and motion.error > STEER_OPTIONS.of_the_steps * motion.violation
        finer = _refined(current, motion, tolerance, stalled)
        if max(finer.problem.substeps) > STEER_OPTIONS.substeps or work > STEER_OPTIONS.work:
            break
        current = finer
    if motion is None:
        raise NoOrbit("the cost does not converge even roughly; bound the inputs, or smooth the cost")
    minima = [item for of in motion.stages for item in of.minima.items()]
    names = [name for name, (values, _) in minima if values.min() < -tolerance][:1]
    low = "".join(f": {name} still falls below zero between interval ends" for name in names)
    raise NoOrbit(
        f"the motion does not converge to {tolerance:.0e}; it is off by {max(motion.error, motion.violation):.1e} "
        f"after {rounds} rounds{low}; take more intervals or a larger tolerance"
    )


def _warm_or_cold_start(problem: Transcription, guess, free: Mapping, bounds, fixed) -> WarmStart:
    """The start of the first solve: the solution of a `Control` of the same problem, or a cold start from a guess."""
    known = guess.warm_start if isinstance(guess, Control) else guess if isinstance(guess, WarmStart) else None
    if known is not None and known.problem.stages == problem.stages and known.problem.names == problem.names:
        return replace(known, free=free)
    x = _unknowns_of_guess(problem, guess, free, bounds)
    size = abs(problem.cost(x, np.concatenate([fixed, [1.0]])))
    return WarmStart(problem, x, None, np.zeros(0), size if STEER_OPTIONS.needs_unit(size) else 1.0, free)


def _minimum(start: WarmStart, fixed, bounds) -> Minimum:
    """The minimum near a start, from its multipliers if these help; its cost is in the user's unit."""
    x, p = np.clip(start.x, *bounds), np.concatenate([fixed, start.shares, [start.unit]])
    found = start.problem.minimise(x, p, bounds, start.multipliers)
    if found.kind != "minimum" and start.multipliers is not None:
        found = start.problem.minimise(x, p, bounds, None)
    return replace(found, cost=found.cost * start.unit)


def _refined(current: WarmStart, motion: MotionRollout, tolerance: float, stalled: bool) -> WarmStart:
    """The start of the next round: steps are halved where they are inaccurate, and exchange points added at dips; all
    steps are halved where the exchange has `stalled`."""
    problem = current.problem
    inaccurate = [stage.distance > tolerance for stage in motion.stages]
    dips = [(i, *dip) for i, stage in enumerate(motion.stages) for dip in stage.dips(tolerance)]
    dips = [(i, interval, share) for i, interval, dip in dips for share in _points_at(current, i, interval, dip)]
    if stalled or not (any(inaccurate) or dips):  # else the cost or a condition at an end is off
        inaccurate = [True] * len(inaccurate)
    substeps = tuple(2 * n if bad else n for n, bad in zip(problem.substeps, inaccurate, strict=True))
    exchanged = problem.exchange_points + tuple((i, interval) for i, interval, _ in dips)
    finer = transcription(problem.stages, problem.fixed, problem.free, substeps, exchanged)
    shares = np.append(current.shares, [share for *_, share in dips])
    assert current.multipliers is not None  # of the minimum that was rolled out
    bound, held = current.multipliers
    held = np.append(held, np.zeros(len(finer.labels) - len(held)))  # 0 at the new exchange points
    return replace(current, problem=finer, multipliers=(bound, held), shares=shares)


def _points_at(current: WarmStart, stage: int, interval: int, dip: float) -> list[float]:
    """The shares of an interval at which a dip is constrained: itself and, where it lies between exchange points, the
    middles between it and its neighbours, so that these close in on a touch by quarters and not by halves."""
    pairs = zip(current.problem.exchange_points, current.shares, strict=True)
    known = [share for point, share in pairs if point == (stage, interval)]
    below, above = max((s for s in known if s < dip), default=0.0), min((s for s in known if s > dip), default=1.0)
    return [dip, (below + dip) / 2, (dip + above) / 2] if known and below < dip < above else [dip]


def _unknowns_of_guess(problem: Transcription, guess, free: Mapping, bounds) -> np.ndarray:
    """The unknowns (n,) of a problem for a guess, a `Guess` for each stage or a `Control`; `free` names the free
    parameters, and `bounds` are the bounds of all unknowns."""
    guesses = guess.legs if isinstance(guess, Control) else guess
    if not isinstance(guesses, tuple | list) or not all(isinstance(one, Guess | ControlledLeg) for one in guesses):
        raise InputError(f"guess = {guess!r}; it must be a Guess for each stage, or a Control")
    if len(guesses) != len(problem.stages):
        raise InputError(f"the guess has {len(guesses)} stages, but the problem has {len(problem.stages)}")
    parts = [_sampled(stage, as_guess(stage, one)) for stage, one in zip(problem.stages, guesses, strict=True)]
    low, high = (bound[len(bound) - len(free) :] for bound in bounds)
    middle = np.where(np.isfinite(low + high), 0.5 * (low + high), np.where(np.isfinite(low), low, high))
    middle = np.where(np.isfinite(middle), middle, 0.0)
    parameters = guess.parameters if isinstance(guess, Control) else {}
    x = problem.pack(parts, [parameters.get(name, value) for name, value in zip(free, middle, strict=True)])
    if not np.isfinite(x).all():
        raise InputError("the guess must have finite numbers")
    return x


def as_guess(stage: Stage, guess: Guess | ControlledLeg) -> Guess:
    """A guess for a stage, which may be a leg of a motion."""
    if isinstance(guess, Guess):
        return guess
    size, shared = len(stage.phase.states), [name for name in stage.inputs if name in guess.inputs.names]
    return Guess(guess.duration, lambda t: guess.path(t)[:size], {name: guess.input_of(name) for name in shared})


def _sampled(stage: Stage, guess: Guess) -> StageUnknowns:
    """The unknowns of a stage, sampled from a guess for it."""
    where, size, n = f"the guess of the {stage.phase.name}", len(stage.phase.states), stage.intervals
    duration = finite_number(f"{where}: duration", guess.duration)
    if strange := guess.inputs.keys() - stage.inputs.keys():
        raise InputError(f"{where} has an input '{min(strange)}', which the stage does not have")
    nodes = np.array([np.asarray(guess.states(t), dtype=float) for t in np.linspace(0, duration, n + 1)])
    if nodes.shape != (n + 1, size):
        raise InputError(f"{where} must have {size} numbers, {', '.join(stage.phase.states)}")
    rows = []
    for name, control in stage.inputs.items():
        value = guess.inputs.get(name, 0.0)
        inset = STEER_OPTIONS.inset if control.degree else 0.5
        for share in np.linspace(inset, 1 - inset, control.degree + 1):
            times = (np.arange(n) + share) * duration / n
            rows.append([float(value(t)) if callable(value) else float(value) for t in times])
    return StageUnknowns(duration, nodes.T, np.array(rows).reshape(-1, n))


def _check_not_away(stages, first: list[StageUnknowns], last: list[StageUnknowns]) -> None:
    """Raise `NoOrbit` where the duration of a stage, from its first value to its last, grows without end."""
    for number, (stage, guessed, found) in enumerate(zip(stages, first, last, strict=True), start=1):
        if np.isinf(stage.duration[1]) and found.duration > STEER_OPTIONS.runaway * guessed.duration:
            text = (
                "stage {number} ({name}) runs away: it lasts {time:.2g}, and it costs less the longer it lasts; "
                "bound its duration"
            )
            raise NoOrbit(Message(text, number=number, name=stage.phase.name, time=Quantity(found.duration, TIME)))


def _check_not_collapsed(stages, unknowns: list[StageUnknowns]) -> None:
    """Raise `NoOrbit` where a stage has shrunk to its lower bound, though it may last longer."""
    for number, (stage, part) in enumerate(zip(stages, unknowns, strict=True), start=1):
        if _shortest(stage, part):
            text = (
                "stage {number} ({name}) collapses: its cost is least at its shortest duration {time:g}; leave this "
                "stage out or, in stages of your own, fix its duration"
            )
            time = Quantity(stage.duration[0], TIME)
            raise CollapsedStage(Message(text, number=number, name=stage.phase.name, time=time))


def _reason_of_failure(problem: Transcription, found: Minimum) -> str | Message:
    """The reason why an iteration found no minimum, in the words of the problem."""
    if found.kind == "bottomless":
        return "the cost has no lower bound: bound the inputs, or let them cost something"
    if found.kind == "undefined":
        return "the equations become infinite or undefined on the way; start nearer to a motion"
    if found.kind == "overdetermined":
        return "there are more conditions than inputs can meet: take more intervals, or drop a condition"
    worst = int(np.argmax(np.nan_to_num(found.off, nan=np.inf)))
    name = problem.labels[worst]
    active = Message.joined("", _bounds_in_the_way(problem, found))
    if found.kind == "infeasible":
        text = "no motion meets the conditions: {name} is missed{active}; widen a bound"
    elif found.feasible:
        text = (
            "no convergence from this guess: the conditions hold, but the cost keeps falling{active}; start "
            "nearer to a motion, take more intervals, or smooth the cost"
        )
    else:
        text = "no convergence from this guess ({name} is missed){active}; start nearer to a motion"
    return Message(text, name=name, active=active)


def _bounds_in_the_way(problem: Transcription, found: Minimum) -> list[str]:
    """The active bounds at the end of an iteration, in words; of inputs, those active on most of their intervals."""
    short, inputs = [], []
    for i, (stage, part) in enumerate(zip(problem.stages, problem.unpack(found.x), strict=True), start=1):
        if _shortest(stage, part):
            text, time = "; stage {i} ({name}) is at its shortest duration {time:g}", Quantity(stage.duration[0], TIME)
            short.append(Message(text, i=i, name=stage.phase.name, time=time))
        for name, rows in stage.input_rows().items():
            bounds = [bound for bound in stage.inputs[name].numbers if np.isfinite(bound)]
            if np.mean([np.any([_at_bound(part.coefficients[rows], bound) for bound in bounds], axis=0)]) > 0.5:
                inputs.append(f"input '{name}' of stage {i}")
    paths = dict.fromkeys(
        problem.labels[row] for row in problem.inner_paths if found.values[row] < STEER_OPTIONS.at_bound
    )
    return short + [f"; {name} is at its bounds" for name in [*inputs, *paths]]


def _shortest(stage: Stage, unknowns: StageUnknowns) -> bool:
    """Whether a stage that may last longer is at its shortest duration."""
    low, high = stage.duration
    return low < high and bool(_at_bound(unknowns.duration / low, 1.0))


def _at_bound(values, bound: float):
    """Whether values (...) are at a bound."""
    return np.abs(values - bound) <= STEER_OPTIONS.at_bound * (1.0 + np.abs(bound))
