"""Diagnosis of failed solves: the reason why there is no motion, in the words of the problem."""

from collections.abc import Sequence

import numpy as np

from ..errors import NoOrbit
from ..symbolic.ipopt import Minimum
from .rollout import MotionRollout
from .stage import Stage
from .transcription import StageUnknowns, Transcription

# A value within this distance of a bound, relative to the bound or to one, is at it: an iteration that fails ends no
# closer.
AT_BOUND = 1e-4
# A duration without an upper bound that grows by this factor has no minimum.
RUNAWAY_DURATION = 1e3


def check_not_away(stages: Sequence[Stage], first: list[StageUnknowns], last: list[StageUnknowns]) -> None:
    """Raise `NoOrbit` where the duration of a stage, from its first value to its last, grows without end."""
    for number, (stage, guessed, found) in enumerate(zip(stages, first, last, strict=True), start=1):
        if np.isinf(stage.duration[1]) and found.duration > RUNAWAY_DURATION * guessed.duration:
            raise NoOrbit(
                f"stage {number} ({stage.phase.name}) runs away: it lasts {found.duration:.2g} already, and the longer "
                "it lasts the less it costs; bound its duration"
            )


def check_not_collapsed(stages: Sequence[Stage], unknowns: list[StageUnknowns]) -> None:
    """Raise `NoOrbit` where a stage has shrunk to its lower bound, though it may last longer."""
    for number, (stage, part) in enumerate(zip(stages, unknowns, strict=True), start=1):
        if _shortest(stage, part):
            raise NoOrbit(
                f"stage {number} ({stage.phase.name}) collapses: least cost is at its shortest duration "
                f"{stage.duration[0]:g}; state it without that stage, or fix its duration"
            )


def reason_of_failure(problem: Transcription, found: Minimum) -> str:
    """The reason why an iteration found no minimum, in the words of the problem."""
    if found.kind == "bottomless":
        return f"the cost has no lower bound: it fell to {found.cost:.1e}; bound the inputs, or let them cost something"
    if found.kind == "undefined":
        return "the equations stop being numbers on the way; start from a nearer motion"
    if found.kind == "overdetermined":
        return "there are more conditions than inputs can meet: take more intervals, or drop a condition"
    worst = int(np.argmax(np.nan_to_num(found.off, nan=np.inf)))
    name, off = problem.labels[worst], float(found.off[worst])
    active = "".join(_bounds_in_the_way(problem, found))
    if found.kind == "infeasible":
        return f"no motion meets the conditions: {name} is missed by {off:.2g}{active}; widen a bound"
    if found.feasible:
        return (
            f"no convergence from this guess: the conditions hold to {off:.1g}, but the cost's slope is "
            f"{found.slope:.1g}{active}; start from a nearer motion, take more intervals, or round the cost"
        )
    return f"no convergence from this guess ({name} off by {off:.1g}){active}; start from a nearer motion"


def reason_of_unsettled(motion: MotionRollout, rounds: int, tolerance: float) -> str:
    """The reason why a motion is still off after so many rounds of exchange."""
    low = [name for stage in motion.stages for name in stage.low(tolerance)]
    return (
        f"the motion does not settle to {tolerance:.0e}, it is off by {max(motion.error, motion.violation):.1e} after "
        f"{rounds} rounds"
        + (f": {low[0]} still falls below zero between interval ends" if low else "")
        + "; take more intervals or a larger tolerance"
    )


def _bounds_in_the_way(problem: Transcription, found: Minimum) -> list[str]:
    """The bounds that an iteration ended at, in words: of durations, of inputs on most of their intervals if they are
    numbers, and of path expressions somewhere within their stage."""
    short, inputs = [], []
    for i, (stage, part) in enumerate(zip(problem.stages, problem.unpack(found.x), strict=True), start=1):
        if _shortest(stage, part):
            short.append(f"; stage {i} ({stage.phase.name}) is at its shortest duration {stage.duration[0]:g}")
        for name, rows in stage.input_rows().items():
            given, values = stage.inputs[name], part.coefficients[rows]
            bounds = [bound for bound in (given.low, given.high) if not callable(bound) and np.isfinite(bound)]
            if np.mean([np.any([_at_bound(values, bound) for bound in bounds], axis=0)]) > 0.5:
                inputs.append(f"input '{name}' of stage {i}")
    paths = dict.fromkeys(problem.labels[row] for row in problem.inner_paths if found.values[row] < AT_BOUND)
    return short + [f"; {name} is at its bounds" for name in [*inputs, *paths]]


def _shortest(stage: Stage, unknowns: StageUnknowns) -> bool:
    """Whether a stage that may last longer is at its shortest duration."""
    low, high = stage.duration
    return low < high and bool(_at_bound(unknowns.duration / low, 1.0))


def _at_bound(values, bound: float):
    """Whether values (...) are at a bound."""
    return np.abs(values - bound) <= AT_BOUND * (1.0 + np.abs(bound))
