"""Newton's method for the equations of a statement, with damping far from a solution, to rounding near one."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import FlowError, NoOrbit
from ..numerics.roots import solve
from .evaluation import PointEvaluation

# A relative Newton step is the last one when it changes the end of the motion by less than this: the next one, its
# square, would be below rounding.
LAST_STEP = 1e-8
# A relative step below the first number that shrinks by no more than the second is rounding. Newton steps towards a
# distant solution, in a motion that amplifies small changes, shrink by a half each, which is why the ratio is larger.
SMALL_STEP, STALLED_RATIO = 1e-9, 0.7
# Unknowns smaller than this are measured in units of it, since a relative step means nothing at 0.
SMALLEST_UNIT = 1e-3


@dataclass(frozen=True, kw_only=True)
class Damping:
    """How steps far from a solution are shortened.

    shortest_duration : share of a duration that a step leaves at least, so that no arc collapses
    reduction : share to which an accepted step reduces the residual
    small_residual : residual, beside the unknowns, below which a step is accepted without a reduction: there the full
        steps converge
    most_halvings : of one step, before the method is given up
    """

    shortest_duration: float = 0.2
    reduction: float = 0.9
    small_residual: float = 1e-6
    most_halvings: int = 12


DAMPING = Damping()


def settles(size: Any, last: Any, growth: Any) -> Any:
    """Whether a relative Newton step of this size is the last one worth taking; numbers, or (m,) of several steps.

    `last` is the size of the step before, `growth` that of a small change of the state over the motion.
    """
    return (size * np.maximum(growth, 1.0) < LAST_STEP) | ((size < SMALL_STEP) & (size > STALLED_RATIO * last))


def newton(
    evaluate: Callable[[np.ndarray], PointEvaluation], u: ArrayLike, durations: list[int], name: str, attempts: int = 30
) -> tuple[np.ndarray, PointEvaluation, np.ndarray]:
    """The last iterate (n,) of Newton's method from `u` (n,), the equations there, and the step (n,) that settles them.

    durations : the indices of the unknowns that are times and stay positive
    name : of the equations, for messages

    A step that leaves the domain of the flow or makes a duration too short is halved. Raises `NoOrbit` when the method
    does not converge.
    """
    u = np.array(u, dtype=float)
    evaluation, size = evaluate(u), np.inf
    for _ in range(attempts):
        step = solve(evaluation.jacobian, -evaluation.residual)
        last, size = size, np.max(np.abs(step) / np.maximum(np.abs(u), SMALLEST_UNIT))
        if settles(size, last, evaluation.amplification):
            return u, evaluation, step
        if not np.isfinite(size):
            break
        u, evaluation = _damped(evaluate, u, step, evaluation, durations, name)
    raise NoOrbit(f"the {name} equations did not converge (last relative step {size:.1e})")


def _damped(
    evaluate: Callable, u: np.ndarray, step: np.ndarray, evaluation: PointEvaluation, durations: list[int], name: str
) -> tuple[np.ndarray, PointEvaluation]:
    """The point that a step leads to, halved until the residual shrinks there, and the equations there."""
    size = np.linalg.norm(evaluation.residual)
    accepted = max(DAMPING.reduction * size, DAMPING.small_residual * (1 + np.abs(u).max()))
    for _ in range(DAMPING.most_halvings):
        new = u + step
        if (new[durations] > DAMPING.shortest_duration * u[durations]).all():
            try:
                found = evaluate(new)
                if np.linalg.norm(found.residual) <= accepted:
                    return new, found
            except FlowError:
                pass
        step = step / 2
    raise NoOrbit(f"the {name} equations did not converge: no step reduces the residual {size:.1e}")
