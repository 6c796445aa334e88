"""The equations of a statement evaluated at points, and Newton's method for them, to rounding."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import FlowError, NoOrbit
from ..flow.trajectory import Trajectories
from ..numerics.roots import solve

# A relative Newton step is the last one when it changes the end of the motion by less than this: the next one, its
# square, would be below rounding.
LAST_STEP = 1e-8
# A relative step below the first number that shrinks by no more than the second is rounding. Newton steps towards a
# distant solution, in a motion that amplifies small changes, shrink by a half each, which is why the ratio is larger.
SMALL_STEP, STALLED_RATIO = 1e-9, 0.7
# Unknowns smaller than this are measured in units of it, since a relative step means nothing at 0.
SMALLEST_UNIT = 1e-3
# A step leaves at least this share of a duration, so that no arc collapses.
DURATION_LEFT = 0.2
# An accepted step reduces the residual to this share, but for residuals below the second number, beside the unknowns:
# there the full steps converge. A step is halved at most so often.
REDUCTION, SMALL_RESIDUAL, MOST_STEP_HALVINGS = 0.9, 1e-6, 12


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The equations at one point, or at m points: every array then has an axis of that length in front.

    residual : (n,)
    jacobian : (n, n + k), with respect to the unknowns and to the k varied parameters
    trajectories : one `Trajectory`, of m points one `Trajectories`, per arc, with its sensitivities to its start and to
        the varied parameters
    transitions : derivatives (states, states + k) of each arc's end at fixed duration, by the same
    starts : derivatives (states + k, n + k) of the same, by the unknowns and the varied parameters
    durations : derivatives (n + k,) of each arc's duration
    residual_by_end : derivatives (rows, states) of the residuals that belong to each arc by its end
    """

    residual: np.ndarray
    jacobian: np.ndarray
    trajectories: tuple[Any, ...]
    transitions: tuple[np.ndarray, ...]
    starts: tuple[np.ndarray, ...]
    durations: tuple[np.ndarray, ...]
    residual_by_end: tuple[np.ndarray, ...]

    def __getitem__(self, i: int | np.ndarray) -> "Evaluation":
        """The evaluation at one of the points, or at several in an order (k,)."""
        per_arc = self.trajectories, self.transitions, self.starts, self.durations, self.residual_by_end
        return Evaluation(self.residual[i], self.jacobian[i], *(tuple(part[i] for part in each) for each in per_arc))

    def replaced(self, i: np.ndarray, others: "Evaluation") -> "Evaluation":
        """The evaluation with the points i (k,), ascending, replaced by others."""
        order = np.arange(len(self.residual))
        order[i] = len(order) + np.arange(len(i))
        both = [self, others]
        return _combined(both, lambda parts: np.concatenate(parts)[order], lambda parts: parts[0].replaced(i, parts[1]))

    @cached_property
    def amplification(self) -> Any:
        """The largest growth of a small change of the state over the motion, or (m,) of each."""
        squares = (transition[..., : transition.shape[-2]] for transition in self.transitions)
        return np.max([np.abs(square).max((-2, -1)) for square in squares], axis=0)


def stacked(evaluations: Sequence[Evaluation]) -> Evaluation:
    """The equations at several points, all evaluated with sensitivities or all without."""
    return _combined(evaluations, np.array, Trajectories.of)


def joined(evaluations: Sequence[Evaluation]) -> Evaluation:
    """One evaluation at the points of several."""
    return evaluations[0] if len(evaluations) == 1 else _combined(evaluations, np.concatenate, Trajectories.joined)


def _combined(evaluations: Sequence[Evaluation], combine_arrays: Callable, combine_motions: Callable) -> Evaluation:
    combined: dict[str, Any] = {}
    for name in Evaluation.__dataclass_fields__:
        parts: list[Any] = [getattr(evaluation, name) for evaluation in evaluations]
        combine = combine_motions if name == "trajectories" else combine_arrays
        per_arc = isinstance(parts[0], tuple)
        combined[name] = tuple(map(combine, zip(*parts, strict=True))) if per_arc else combine(parts)
    return Evaluation(**combined)


def settles(size: Any, last: Any, growth: Any) -> Any:
    """Whether a relative Newton step of this size is the last one worth taking; numbers, or (m,) of several steps.

    `last` is the size of the step before, `growth` that of a small change of the state over the motion.
    """
    return (size * np.maximum(growth, 1.0) < LAST_STEP) | ((size < SMALL_STEP) & (size > STALLED_RATIO * last))


def newton(
    evaluate: Callable[[np.ndarray], Evaluation], u: ArrayLike, durations: list[int], name: str, attempts: int = 30
) -> tuple[np.ndarray, Evaluation, np.ndarray]:
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


def _damped(evaluate: Callable, u, step, evaluation: Evaluation, durations, name) -> tuple[np.ndarray, Evaluation]:
    """The point that a step leads to, halved until the residual shrinks there, and the equations there."""
    size = np.linalg.norm(evaluation.residual)
    accepted = max(REDUCTION * size, SMALL_RESIDUAL * (1 + np.abs(u).max()))
    for _ in range(MOST_STEP_HALVINGS):
        new = u + step
        if (new[durations] > DURATION_LEFT * u[durations]).all():
            try:
                found = evaluate(new)
                if np.linalg.norm(found.residual) <= accepted:
                    return new, found
            except FlowError:
                pass
        step = step / 2
    raise NoOrbit(f"the {name} equations did not converge: no step reduces the residual {size:.1e}")
