"""Optimal control of motions through several phases with free durations, by direct multiple shooting and Ipopt.

A stage is a phase travelled once. Its inputs, further names in the mapping `p` of the field, are polynomials on each
of its equal intervals. Unknown are the durations, the states at all interval ends, the inputs' coefficients, and
parameters left free; equations join the intervals by Taylor steps, with exact first and second derivatives. The answer
is integrated again from each stage's start by the accurate flow. Steps are halved until both agree. What has to stay
positive is looked up on the dense polynomials: where it does not, it is asked for at that place too, and the problem is
solved again (an exchange method: Hettich and Kortanek, "Semi-infinite programming", SIAM Review 35, 1993).
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real

import numpy as np

from ..errors import InputError, NoOrbit, finite_number, whole_number
from ..flow.trajectory import Trajectory
from ..hybrid.simulation import Leg
from ..symbolic import interrupts
from ..symbolic.ipopt import Minimum
from .transcription import Stage, StageRollout, Transcription, at_bound, polynomials, rollout, transcription

# Rounds of asking again between interval ends, of halving steps, and of counting the cost in what it turned out to be,
# after which it is given up; and the most steps of an interval.
EXCHANGE_ROUNDS, SUBSTEPS = 30, 64
# Halvings of all intervals after which the cost is to stay.
HALVINGS = 8
# What an answer is solved for to; below this rounding decides whether it is.
FINEST_TOLERANCE = 1e-13
# A cost is counted in units in which it is between this and one over this; what is smaller than the other is nothing.
COST_RANGE, NOTHING = 0.1, 1e-20
# A duration without an upper bound that grows by this factor has no end.
RUNAWAY_DURATION = 1e3


@dataclass(frozen=True)
class Guess:
    """Where to start a stage: its duration, its states as a function of the time in it, its inputs by name, each a
    number or a function of that time."""

    duration: float
    states: Callable
    inputs: Mapping[str, float | Callable] = field(default_factory=dict)


@dataclass(frozen=True)
class ControlledLeg(Leg):
    """A stage as it is travelled: its phase's name, its start, its motion from there, and its inputs, polynomials of
    the time since then as well. Rows of the motion are the states, then what stays positive."""

    inputs: Trajectory

    @property
    def duration(self) -> float:
        """Of the stage."""
        return float(self.path.times[-1])


@dataclass(frozen=True)
class Control:
    """A motion of locally least cost: another guess may lead to one that costs less.

    legs : the stages in order
    cost : on the accurate motion
    parameters : all of them, those left free as they came out
    violation : the most by which the accurate motion misses a condition, leaves a bound, or has below zero what is to
        stay above
    error : the most by which its states, beside their size, or its cost differ from those that were solved for
    coarseness : the share of the cost by which the last halving of the intervals changed it, NaN if they were kept:
        violation and error are of this motion, and say nothing of what finer inputs would save
    iterations, rounds : Ipopt's iterations, and the solves in which they were taken
    seconds : taken in all
    status : "optimal"; anything else is raised as an error
    """

    legs: tuple[ControlledLeg, ...]
    cost: float
    parameters: Mapping[str, float]
    violation: float
    error: float
    iterations: int
    rounds: int
    seconds: float
    status: str = "optimal"
    coarseness: float = np.nan
    answer: "Answer | None" = field(default=None, repr=False)

    @property
    def durations(self) -> np.ndarray:
        """Of the stages."""
        return np.array([leg.duration for leg in self.legs])

    def schedule(self, *names: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """When piecewise constant inputs change, (k + 1,), and their values in between, (k,) each, 0 where a stage does
        not have them: what `simulate` takes."""
        if strange := set(names).difference(*(leg.inputs.names for leg in self.legs)):
            raise InputError(f"there is no input '{min(strange)}'")
        rows = {name: [_column(leg.inputs, name) for leg in self.legs] for name in names}
        if varying := [name for name, columns in rows.items() if any(c[:, 1:].any() for c in columns)]:
            raise InputError(f"input '{varying[0]}' varies within an interval: it is no schedule; give it degree 0")
        times = np.concatenate([leg.start + leg.inputs.times[:-1] for leg in self.legs] + [[self.end]])
        return times, {name: np.concatenate([c[:, 0] for c in columns]) for name, columns in rows.items()}

    @property
    def end(self) -> float:
        """The time at which the last stage ends."""
        return self.legs[-1].start + self.legs[-1].duration

    def __str__(self) -> str:
        rows = [f"  {leg.phase:<12}from {leg.start:<12.8g}for {leg.duration:.10g}" for leg in self.legs]
        found = f"  cost {self.cost:.12g}, violation {self.violation:.1e}, error {self.error:.1e}"
        return "\n".join([*rows, found, f"  {self.iterations} iterations, {self.rounds} rounds, {self.seconds:.2f} s"])


@dataclass(frozen=True)
class Answer:
    """What the next solve may start from: the problem, its unknowns, its multipliers, where paths are asked, and the
    unit of its cost: tolerances are absolute, and the effort of a tiny correction is tinier yet."""

    problem: Transcription
    x: np.ndarray
    multipliers: tuple[np.ndarray, np.ndarray] | None
    shares: np.ndarray
    unit: float = 1.0

    def recounted(self, unit: float) -> "Answer":
        """The same with its cost in another unit."""
        times = self.unit / unit
        bound, held = self.multipliers
        return replace(self, unit=unit, multipliers=(times * bound, times * held))


def steer(
    stages: Sequence[Stage], parameters: Mapping[str, float] | None = None, *, guess,
    free: Mapping[str, tuple[float, float]] | None = None, tolerance: float = 1e-9, refine: float | None = None,
) -> Control:  # fmt: skip
    """Find a motion through `stages`, one after the other, of locally least cost: none near it costs less.

    parameters : values of the names in `p`
    guess : a `Guess` for each stage, or a `Control` nearby, whose multipliers are kept if the stages are the same
    free : bounds of further parameters, which are found too; the guess is the middle, or the bound if one is infinite,
        or what the guess's own `parameters` say
    tolerance : of the answer's violation and error
    refine : all intervals are halved until the cost changes by no more than this share of it; None keeps them as they
        are, and how much finer ones would save is not known

    Raises `InputError` for bounds that conflict, and `NoOrbit`, saying which condition or bound is in the way, where
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


def _halved(found: Control, stages, parameters, free, tolerance: float, refine: float) -> Control:
    """The answer on intervals halved until its cost stays."""
    for _ in range(HALVINGS):
        stages = tuple(replace(stage, intervals=2 * stage.intervals) for stage in stages)
        finer = _steer(stages, parameters, free, found, tolerance)
        coarseness = abs(finer.cost - found.cost) / max(abs(finer.cost), NOTHING)
        taken = found.iterations + finer.iterations, found.rounds + finer.rounds
        found = replace(finer, coarseness=coarseness, iterations=taken[0], rounds=taken[1])
        if coarseness <= refine:
            return found
    raise NoOrbit(
        f"the cost still changes by {coarseness:.1e} of it with {stages[0].intervals} intervals in the first stage; "
        "start with more, let inputs be of a higher degree, or take a larger `refine`"
    )


def _steer(stages, parameters, free, guess, tolerance: float) -> Control:
    """The answer on the intervals as they are."""
    try:
        problem = transcription(stages, tuple(parameters), tuple(free))
    except KeyError as error:
        raise InputError(f"a stage asks for {error}, which is neither an input of it nor a parameter") from None
    bounds, fixed = problem.bounds(free), np.array(list(parameters.values()), dtype=float)
    known = guess.answer if isinstance(guess, Control) else None
    if known is None or known.problem.stages != stages or known.problem.names != problem.names:
        x = _unknowns_of_guess(problem, guess, free, bounds)
        size = abs(problem.cost(x, np.concatenate([fixed, [1.0]])))
        known = Answer(
            problem,
            x,
            None,
            np.zeros(0),
            1.0 if COST_RANGE < size < 1 / COST_RANGE or not NOTHING < size < np.inf else size,
        )
    first, iterations = known.problem.unpack(known.x), 0
    for rounds in range(1, EXCHANGE_ROUNDS + 1):
        interrupts.check()
        found = _minimum(known, fixed, bounds)
        iterations += found.iterations
        if found.kind != "minimum":
            raise NoOrbit(_reason(known.problem, found))
        known = replace(known, x=found.x, multipliers=found.multipliers)
        _not_away(stages, first, problem.unpack(known.x))
        size = abs(found.cost)
        if size > NOTHING and not COST_RANGE < size / known.unit < 1 / COST_RANGE:
            known = known.recounted(size)
            continue
        here = _rolled_out(known, found.cost, fixed)
        _not_collapsed(stages, here.parts)
        if here.error <= tolerance and here.violation <= tolerance:
            named = dict(zip(problem.names, here.values.tolist(), strict=True))
            found = here.cost, named, here.violation, here.error
            return Control(here.legs(stages), *found, iterations, rounds, 0.0, answer=known)
        finer = _refined(known, here, tolerance)
        if max(finer.problem.substeps) > SUBSTEPS:
            break
        known = finer
    where = [name for drive in here.driven for name in drive.low(tolerance)]
    raise NoOrbit(
        f"the motion does not settle to {tolerance:.0e}, it is off by {max(here.error, here.violation):.1e} after "
        f"{rounds} rounds"
        + (f": {where[0]} still falls below zero between interval ends" if where else "")
        + "; take more intervals or a larger tolerance"
    )


def _minimum(known: Answer, fixed, bounds) -> Minimum:
    """The minimum near what is known, by its multipliers if they help."""
    x, p = np.clip(known.x, *bounds), np.concatenate([fixed, known.shares, [known.unit]])
    found = known.problem.minimise(x, p, bounds, known.multipliers)
    if found.kind != "minimum" and known.multipliers is not None:
        found = known.problem.minimise(x, p, bounds, None)
    return replace(found, cost=found.cost * known.unit)


@dataclass(frozen=True)
class Rollout:
    """All stages of an answer travelled accurately; `parts` are the durations, states and coefficients it consists of,
    `values` all parameters, the rest as in `Control`."""

    parts: list[tuple[float, np.ndarray, np.ndarray]]
    values: np.ndarray
    driven: list[StageRollout]
    cost: float
    error: float
    violation: float

    def legs(self, stages) -> tuple[ControlledLeg, ...]:
        """What the answer shows of them."""
        starts = np.cumsum([0.0, *(duration for duration, *_ in self.parts)]).tolist()
        return tuple(
            ControlledLeg(stage.phase.name, start, drive.path, polynomials(stage, part[0], part[2]))
            for stage, drive, part, start in zip(stages, self.driven, self.parts, starts, strict=False)
        )


def _rolled_out(known: Answer, cost: float, fixed) -> Rollout:
    """Travel an answer, whose cost as it was solved for is given."""
    problem = known.problem
    parts, values = problem.unpack(known.x), np.concatenate([fixed, problem.freed(known.x)])
    driven = [rollout(stage, problem.names, values, *part) for stage, part in zip(problem.stages, parts, strict=True)]
    accurate = problem.costs(values, driven)
    apart = max(drive.apart(nodes) for drive, (_, nodes, _) in zip(driven, parts, strict=True))
    missed = problem.missed(values, [(drive.first, drive.last) for drive in driven])
    violation = max(missed, *(drive.violation for drive in driven))
    return Rollout(
        parts, values, driven, accurate, max(apart, abs(accurate - cost) / max(known.unit, abs(cost))), violation
    )


def _refined(known: Answer, here: Rollout, tolerance: float) -> Answer:
    """The answer as a start for the problem with steps halved where they are rough, and paths asked where they dip."""
    problem = known.problem
    rough = [drive.apart(nodes) > tolerance for drive, (_, nodes, _) in zip(here.driven, here.parts, strict=True)]
    dips = [(i, *dip) for i, drive in enumerate(here.driven) for dip in drive.dips(tolerance)]
    if not any(rough) and not dips:  # the cost is off, or an end
        rough = [True] * len(rough)
    substeps = tuple(2 * n if bad else n for n, bad in zip(problem.substeps, rough, strict=True))
    places = problem.places + tuple((i, interval) for i, interval, _ in dips)
    finer = transcription(problem.stages, problem.fixed, problem.free, substeps, places)
    shares = np.append(known.shares, [share for *_, share in dips])
    return replace(known, problem=finer, multipliers=finer.padded(known.multipliers), shares=shares)


def _check(stages, parameters, free, tolerance):
    """Raise for what cannot be meant."""
    if not finite_number("tolerance", tolerance) >= FINEST_TOLERANCE:
        raise InputError(f"tolerance = {tolerance:g}; rounding allows for {FINEST_TOLERANCE:g} or more")
    if not stages:
        raise InputError("there are no stages: give at least one")
    for number, stage in enumerate(stages, start=1):
        where = f"stage {number} ({stage.phase.name})"
        if _range(f"{where}: duration", stage.duration)[0] <= 0:
            raise InputError(f"{where}: duration from {stage.duration[0]:g}; it is above 0")
        whole_number(f"{where}: intervals", stage.intervals, "intervals")
        if stage.phase.pieces:
            raise InputError(f"{where}: its law is piecewise; control needs a law that is smooth, as a formula")
        for name, given in stage.inputs.items():
            if name in parameters or name in free:
                raise InputError(f"{where}: '{name}' is both an input and a parameter; rename one")
            sides = zip((given.low, given.high), (-np.inf, np.inf), strict=True)
            _range(f"{where}: input '{name}'", [none if callable(side) else side for side, none in sides])
            whole_number(f"{where}: degree of input '{name}'", given.degree, "powers", 0)
    for name, bounds in free.items():
        if name in parameters:
            raise InputError(f"parameter '{name}' has a value and is left free: choose one")
        _range(f"parameter '{name}'", bounds)
    for name, value in parameters.items():
        finite_number(f"parameter '{name}'", value)


def _range(what: str, bounds) -> tuple[float, float]:
    """The two bounds, in order; raises `InputError`."""
    if not isinstance(bounds, tuple | list) or len(bounds) != 2 or not all(isinstance(one, Real) for one in bounds):
        raise InputError(f"{what}: bounds are a lowest and a highest number, not {bounds!r}")
    low, high = bounds
    if not low <= high:
        raise InputError(f"{what} lies between {low:g} and {high:g}: bounds conflict")
    return low, high


def _unknowns_of_guess(problem: Transcription, guess, free, bounds) -> np.ndarray:
    """The unknowns (n,) that a guess means."""
    given = guess.legs if isinstance(guess, Control) else guess
    if not isinstance(given, tuple | list) or not all(isinstance(one, Guess | ControlledLeg) for one in given):
        raise InputError(f"guess = {guess!r}; it is a Guess for each stage, or a Control")
    known = guess.parameters if isinstance(guess, Control) else {}
    if len(given) != len(problem.stages):
        raise InputError(f"the guess has {len(given)} stages where there are {len(problem.stages)}")
    parts = []
    for stage, one in zip(problem.stages, given, strict=True):
        size, n = len(stage.phase.states), stage.intervals
        if isinstance(one, ControlledLeg):
            states, inputs = (lambda t, of=one.path, size=size: of(t)[:size]), _functions(one.inputs)
        else:
            states, inputs = one.states, one.inputs
            finite_number(f"the guess of the {stage.phase.name}: duration", one.duration)
            if strange := inputs.keys() - stage.inputs.keys():
                raise InputError(
                    f"the guess of the {stage.phase.name} is of an input '{min(strange)}': it has none such"
                )
        nodes = np.array([np.asarray(states(t), dtype=float) for t in np.linspace(0, one.duration, n + 1)])
        if nodes.shape != (n + 1, size):
            raise InputError(
                f"the guess of the {stage.phase.name} is not {size} numbers, {', '.join(stage.phase.states)}"
            )
        rows = []
        for name, shape in stage.inputs.items():
            of = inputs.get(name, 0.0)
            for place in np.linspace(1e-9, 1 - 1e-9, shape.degree + 1) if shape.degree else (0.5,):
                times = (np.arange(n) + place) * one.duration / n
                rows.append([float(of(t)) if callable(of) else float(of) for t in times])
        parts.append((one.duration, nodes.T, np.array(rows).reshape(-1, n)))
    low, high = (bound[len(bound) - len(free) :] for bound in bounds)
    middle = np.where(np.isfinite(low + high), 0.5 * (low + high), np.where(np.isfinite(low), low, high))
    middle = np.where(np.isfinite(middle), middle, 0.0)
    x = problem.pack(parts, [known.get(name, value) for name, value in zip(free, middle, strict=True)])
    if not np.isfinite(x).all():
        raise InputError("the guess is not finite everywhere")
    return x


def _functions(inputs: Trajectory) -> dict[str, Callable]:
    return {name: lambda t, i=i: inputs(t)[i] for i, name in enumerate(inputs.names)}


def _column(inputs: Trajectory, name: str) -> np.ndarray:
    """Coefficients (N, K + 1) of an input on each interval, 0 where the stage does not have it."""
    return inputs.row(name) if name in inputs.names else np.zeros((len(inputs.steps), 1))


def _not_away(stages, first, parts):
    """Raise where a stage that may last forever nearly does, given its first parts."""
    for number, (stage, (guessed, *_), (duration, *_)) in enumerate(zip(stages, first, parts, strict=True), start=1):
        if np.isinf(stage.duration[1]) and duration > RUNAWAY_DURATION * guessed:
            raise NoOrbit(
                f"stage {number} ({stage.phase.name}) runs away: it lasts {duration:.2g} already, and the longer it "
                "lasts the less it costs; bound its duration"
            )


def _not_collapsed(stages, parts):
    """Raise where a stage has shrunk to its lower bound, though it may last longer."""
    for number, (stage, (duration, *_)) in enumerate(zip(stages, parts, strict=True), start=1):
        low, high = stage.duration
        if low < high and at_bound(duration / low, 1.0):
            raise NoOrbit(
                f"stage {number} ({stage.phase.name}) collapses: least cost is at its shortest duration {low:g}; state "
                "it without that stage, or fix its duration"
            )


def _reason(problem: Transcription, found: Minimum) -> str:
    """Why there is no answer, in the words of the problem."""
    if found.kind == "bottomless":
        return f"the cost has no lower bound: it fell to {found.cost:.1e}; bound the inputs, or let them cost something"
    if found.kind == "undefined":
        return "the equations stop being numbers on the way; start from a nearer motion"
    if found.kind == "overdetermined":
        return "there are more conditions than inputs can meet: take more intervals, or drop a condition"
    worst = int(np.argmax(np.nan_to_num(found.off, nan=np.inf)))
    name, off = problem.label(worst), float(found.off[worst])
    parts = problem.unpack(found.x)
    short = [
        f"; stage {i} ({stage.phase.name}) is at its shortest duration {stage.duration[0]:g}"
        for i, (stage, (duration, *_)) in enumerate(zip(problem.stages, parts, strict=True), start=1)
        if stage.duration[0] < stage.duration[1] and at_bound(duration / stage.duration[0], 1.0)
    ]
    short += [f"; {name} is at its bounds" for name in problem.saturated(parts, found.values)]
    if found.kind == "infeasible":
        return f"no motion meets the conditions: {name} is missed by {off:.2g}{''.join(short)}; widen a bound"
    if found.feasible:
        return (
            f"no convergence from this guess: the conditions hold to {off:.1g}, but the cost's slope is "
            f"{found.slope:.1g}{''.join(short)}; start from a nearer motion, take more intervals, or round the cost"
        )
    return f"no convergence from this guess ({name} off by {off:.1g}){''.join(short)}; start from a nearer motion"
