"""Optimal control of motions through several phases with free durations, by direct multiple shooting and Ipopt.

The inputs of a stage are polynomials on each of its equal intervals. The unknowns are the durations, the states at the
shooting nodes, the coefficients of the inputs, and the free parameters. The intervals are joined by Taylor steps with
exact first and second derivatives. The solution is then integrated from each stage's start by the accurate flow, and
steps are halved until both agree. Path expressions must stay positive on the dense polynomials. Where they do not,
they are constrained at that point too, and the problem is solved again. This is an exchange method: Hettich and
Kortanek, "Semi-infinite programming", SIAM Review 35, 1993.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError, NoOrbit, finite_number
from ..symbolic import interrupts
from ..symbolic.ipopt import Minimum
from .diagnosis import check_not_away, check_not_collapsed, reason_of_failure, reason_of_unsettled
from .guess import Guess, unknowns_of_guess
from .motion import Control, WarmStart
from .rollout import MotionRollout, roll_out
from .stage import Stage, check_range, check_stage
from .transcription import Transcription, transcription


@dataclass(frozen=True, kw_only=True)
class SteerOptions:
    """The limits of the search for a controlled motion.

    rounds : solves after which it is given up, each after an exchange, a halving of steps, or a new unit of the cost
    substeps : most steps in an interval
    halvings : halvings of all intervals after which the cost has to settle
    finest_tolerance : least tolerance of a solution; below it rounding decides whether it is met
    smallest_scaled_cost : the cost is solved for in a unit in which it lies between this and one over this
    negligible_cost : a cost below this is zero, and has no unit
    """

    rounds: int = 30
    substeps: int = 64
    halvings: int = 8
    finest_tolerance: float = 1e-13
    smallest_scaled_cost: float = 0.1
    negligible_cost: float = 1e-20

    def in_range(self, cost: float) -> bool:
        """Whether a cost is of order one."""
        return self.smallest_scaled_cost < cost < 1 / self.smallest_scaled_cost


STEER_OPTIONS = SteerOptions()


def steer(
    stages: Sequence[Stage], parameters: Mapping[str, float] | None = None, *, guess: Sequence[Guess] | Control,
    free: Mapping[str, tuple[float, float]] | None = None, tolerance: float = 1e-9, refine: float | None = None,
) -> Control:  # fmt: skip
    """Find a motion through `stages`, one after the other, of locally least cost: none near it costs less.

    parameters : values of the names in `p`
    guess : a `Guess` for each stage, or a `Control` nearby, whose multipliers are kept if the stages are the same
    free : bounds of further parameters, which are found too. They start in the middle, or at the bound if the other is
        infinite, or at the values in the guess's own `parameters`
    tolerance : the largest violation and error
    refine : all intervals are halved until the cost changes by no more than this share of it. None keeps them as they
        are, and it is not known how much finer ones would save

    Raises `InputError` for bounds that conflict. Raises `NoOrbit`, saying which condition or bound is in the way, where
    there is no such motion, a stage collapses or runs away, the cost has no lower bound, or nothing is found from the
    guess.
    """
    began = time.perf_counter()
    stages, parameters, free = tuple(stages), dict(parameters or {}), dict(free or {})
    _check(stages, parameters, free, tolerance)
    if refine is not None and not finite_number("refine", refine) > tolerance:
        raise InputError(f"refine = {refine:g}; a share of the cost above the tolerance, {tolerance:g}")
    with interrupts.deferred():
        found = _steer(stages, parameters, free, guess, tolerance)
        if refine is not None:
            found = _halved(found, stages, parameters, free, tolerance, refine)
    return replace(found, seconds=time.perf_counter() - began)


def _check(stages, parameters: Mapping, free: Mapping, tolerance: float) -> None:
    """Raise `InputError` for arguments without a meaning."""
    finest = STEER_OPTIONS.finest_tolerance
    if not finite_number("tolerance", tolerance) >= finest:
        raise InputError(f"tolerance = {tolerance:g}; rounding allows for {finest:g} or more")
    if not stages:
        raise InputError("there are no stages: give at least one")
    for number, stage in enumerate(stages, start=1):
        check_stage(number, stage, {*parameters, *free})
    for name, bounds in free.items():
        if name in parameters:
            raise InputError(f"parameter '{name}' has a value and is left free: choose one")
        check_range(f"parameter '{name}'", bounds)
    for name, value in parameters.items():
        finite_number(f"parameter '{name}'", value)


def _halved(found: Control, stages, parameters, free, tolerance: float, refine: float) -> Control:
    """The motion on intervals halved until its cost settles."""
    for _ in range(STEER_OPTIONS.halvings):
        stages = tuple(replace(stage, intervals=2 * stage.intervals) for stage in stages)
        finer = _steer(stages, parameters, free, found, tolerance)
        coarseness = abs(finer.cost - found.cost) / max(abs(finer.cost), STEER_OPTIONS.negligible_cost)
        iterations, rounds = found.iterations + finer.iterations, found.rounds + finer.rounds
        found = replace(finer, coarseness=coarseness, iterations=iterations, rounds=rounds)
        if coarseness <= refine:
            return found
    raise NoOrbit(
        f"the cost still changes by {coarseness:.1e} of it with {stages[0].intervals} intervals in the first stage; "
        "start with more, let inputs be of a higher degree, or take a larger `refine`"
    )


def _steer(stages, parameters: Mapping, free: Mapping, guess, tolerance: float) -> Control:
    """The motion on the intervals as they are."""
    try:
        problem = transcription(stages, tuple(parameters), tuple(free))
    except KeyError as error:
        raise InputError(f"a stage asks for {error}, which is neither an input of it nor a parameter") from None
    bounds, fixed = problem.bounds(free), np.array(list(parameters.values()), dtype=float)
    current = _warm_or_cold_start(problem, guess, free, bounds, fixed)
    first, iterations = current.problem.unpack(current.x), 0
    motion: MotionRollout | None = None
    for rounds in range(1, STEER_OPTIONS.rounds + 1):
        interrupts.check()
        found = _minimum(current, fixed, bounds)
        iterations += found.iterations
        if found.kind != "minimum":
            raise NoOrbit(reason_of_failure(current.problem, found))
        current = replace(current, x=found.x, multipliers=found.multipliers)
        check_not_away(stages, first, problem.unpack(current.x))
        size = abs(found.cost)
        if size > STEER_OPTIONS.negligible_cost and not STEER_OPTIONS.in_range(size / current.unit):
            current = current.rescaled(size)
            continue
        motion = roll_out(current, found.cost, fixed)
        check_not_collapsed(stages, motion.unknowns)
        if motion.error <= tolerance and motion.violation <= tolerance:
            named = dict(zip(problem.names, motion.values.tolist(), strict=True))
            return Control(
                motion.legs(), motion.cost, named, motion.violation, motion.error, iterations, rounds, 0.0,
                answer=current,
            )  # fmt: skip
        finer = _refined(current, motion, tolerance)
        if max(finer.problem.substeps) > STEER_OPTIONS.substeps:
            break
        current = finer
    if motion is None:
        raise NoOrbit("the cost does not settle to an order of magnitude; bound the inputs, or round the cost")
    raise NoOrbit(reason_of_unsettled(motion, rounds, tolerance))


def _warm_or_cold_start(problem: Transcription, guess, free: Mapping, bounds, fixed) -> WarmStart:
    """The start of the first solve: the answer of a `Control` of the same problem, or a cold start from a guess."""
    known = guess.answer if isinstance(guess, Control) else None
    if known is not None and known.problem.stages == problem.stages and known.problem.names == problem.names:
        return known
    x = unknowns_of_guess(problem, guess, free, bounds)
    size = abs(problem.cost(x, np.concatenate([fixed, [1.0]])))
    has_unit = STEER_OPTIONS.negligible_cost < size < np.inf and not STEER_OPTIONS.in_range(size)
    return WarmStart(problem, x, None, np.zeros(0), size if has_unit else 1.0)


def _minimum(start: WarmStart, fixed, bounds) -> Minimum:
    """The minimum near a start, from its multipliers if these help; its cost is in the user's unit."""
    x, p = np.clip(start.x, *bounds), np.concatenate([fixed, start.shares, [start.unit]])
    found = start.problem.minimise(x, p, bounds, start.multipliers)
    if found.kind != "minimum" and start.multipliers is not None:
        found = start.problem.minimise(x, p, bounds, None)
    return replace(found, cost=found.cost * start.unit)


def _refined(current: WarmStart, motion: MotionRollout, tolerance: float) -> WarmStart:
    """The start of the next round: steps are halved where they are inaccurate, and exchange points added at dips."""
    problem = current.problem
    pairs = zip(motion.stages, motion.unknowns, strict=True)
    inaccurate = [stage.distance(part.nodes) > tolerance for stage, part in pairs]
    dips = [(i, *dip) for i, stage in enumerate(motion.stages) for dip in stage.dips(tolerance)]
    if not any(inaccurate) and not dips:  # the cost or a condition at an end is off
        inaccurate = [True] * len(inaccurate)
    substeps = tuple(2 * n if bad else n for n, bad in zip(problem.substeps, inaccurate, strict=True))
    points = problem.exchange_points + tuple((i, interval) for i, interval, _ in dips)
    finer = transcription(problem.stages, problem.fixed, problem.free, substeps, points)
    shares = np.append(current.shares, [share for *_, share in dips])
    multipliers = None if current.multipliers is None else finer.padded(current.multipliers)
    return replace(current, problem=finer, multipliers=multipliers, shares=shares)
