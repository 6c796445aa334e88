"""The equations of a statement, evaluated at one point or at several, with their derivatives and motions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np

from ..flow.trajectory import Trajectories, Trajectory


@dataclass(frozen=True, eq=False)
class PointEvaluation:
    """The equations at one point.

    residual : (n,)
    jacobian : (n, n + k), with respect to the unknowns and to the k varied parameters
    trajectories : one per arc, with its sensitivities to its start and to the varied parameters
    transitions : derivatives (states, states + k) of each arc's end at fixed duration, by the same
    starts : derivatives (states + k, n + k) of the same, by the unknowns and the varied parameters
    durations : derivatives (n + k,) of each arc's duration
    residual_by_end : derivatives (rows, states) of the residuals that belong to each arc by its end
    """

    residual: np.ndarray
    jacobian: np.ndarray
    trajectories: tuple[Trajectory, ...]
    transitions: tuple[np.ndarray, ...]
    starts: tuple[np.ndarray, ...]
    durations: tuple[np.ndarray, ...]
    residual_by_end: tuple[np.ndarray, ...]

    @cached_property
    def amplification(self) -> float:
        """The largest growth of a small change of the state over the motion."""
        return _amplification(self.transitions)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The equations at m points: the arrays of `PointEvaluation` with an axis of length m in front, and `Trajectories`
    for each arc."""

    residual: np.ndarray
    jacobian: np.ndarray
    trajectories: tuple[Trajectories, ...]
    transitions: tuple[np.ndarray, ...]
    starts: tuple[np.ndarray, ...]
    durations: tuple[np.ndarray, ...]
    residual_by_end: tuple[np.ndarray, ...]

    @overload
    def __getitem__(self, i: int) -> PointEvaluation: ...

    @overload
    def __getitem__(self, i: np.ndarray) -> "Evaluation": ...

    def __getitem__(self, i: int | np.ndarray) -> "PointEvaluation | Evaluation":
        """The evaluation at one of the points, or at several in an order (k,)."""
        per_arc = self.trajectories, self.transitions, self.starts, self.durations, self.residual_by_end
        parts: list[Any] = [tuple(part[i] for part in each) for each in per_arc]
        form = Evaluation if isinstance(i, np.ndarray) else PointEvaluation
        return form(self.residual[i], self.jacobian[i], *parts)

    def replaced(self, i: np.ndarray, others: "Evaluation") -> "Evaluation":
        """The evaluation with the points i (k,), ascending, replaced by others."""
        order = np.arange(len(self.residual))
        order[i] = len(order) + np.arange(len(i))
        return _combined(
            [self, others], lambda parts: np.concatenate(parts)[order], lambda parts: parts[0].replaced(i, parts[1])
        )

    @cached_property
    def amplification(self) -> np.ndarray:
        """The largest growth (m,) of a small change of the state over each motion."""
        return _amplification(self.transitions)


def stacked(evaluations: Sequence[PointEvaluation]) -> Evaluation:
    """The equations at several points, all evaluated with sensitivities or all without."""
    return _combined(evaluations, np.array, Trajectories.of)


def joined(evaluations: Sequence[Evaluation]) -> Evaluation:
    """One evaluation at the points of several."""
    return evaluations[0] if len(evaluations) == 1 else _combined(evaluations, np.concatenate, Trajectories.joined)


def _combined(evaluations: Sequence, combine_arrays: Callable, combine_motions: Callable) -> Evaluation:
    def per_arc(name: str, combine: Callable) -> tuple:
        return tuple(map(combine, zip(*(getattr(evaluation, name) for evaluation in evaluations), strict=True)))

    return Evaluation(
        combine_arrays([evaluation.residual for evaluation in evaluations]),
        combine_arrays([evaluation.jacobian for evaluation in evaluations]),
        per_arc("trajectories", combine_motions),
        *(per_arc(name, combine_arrays) for name in ("transitions", "starts", "durations", "residual_by_end")),
    )


def _amplification(transitions: tuple[np.ndarray, ...]) -> Any:
    squares = (transition[..., : transition.shape[-2]] for transition in transitions)
    return np.max([np.abs(square).max((-2, -1)) for square in squares], axis=0)
