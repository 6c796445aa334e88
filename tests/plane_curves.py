"""Curves in closed form as problems of the room of curves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from orbits.curves import CHANGES, End, Event, Points, Problem, Run, Start, Steps, Test, started

Array = np.ndarray
# Points at the ends of steps alone.
UNDIVIDED = Steps(apart=np.inf)
BOTH = pytest.mark.parametrize("options", [Steps(), UNDIVIDED], ids=["divided", "undivided"])


@dataclass
class Values:
    """Residuals (m, n) and Jacobians (m, n, n + 1) of a formula."""

    residual: Array
    jacobian: Array

    @property
    def amplification(self) -> Array:
        return np.ones(len(self.residual))

    def __getitem__(self, which: Any) -> "Values":
        return Values(self.residual[which], self.jacobian[which])


@dataclass(eq=False)
class Formula(Problem):
    """F(X) = 0 for a function of lanes (m,) and the components of X, each (m,), that returns the residuals and all
    derivatives as rows of n and n times n + 1 arrays; it counts its points."""

    function: Callable[..., tuple[list, list]]
    tests: Sequence[Test] = ()
    lost_at: Callable[..., Start | End] | None = None
    points: int = field(default=0)
    calls: int = field(default=0)

    def evaluate(self, lanes: Array, xs: Array, known: Any = None, moved: Array | None = None):
        self.points, self.calls = self.points + len(xs), self.calls + 1
        residual, jacobian = self.function(lanes, *xs.T)
        rows = [np.stack([each + np.zeros(len(xs)) for each in row], -1) for row in (residual, *jacobian)]
        return np.arange(len(xs)), Values(rows[0], np.stack(rows[1:], axis=1))

    def size(self, lanes: Array, xs: Array) -> Array:
        return np.ones(xs.shape)

    def changed(self, event: Event, passed: Sequence[Points]) -> End:
        return End(event.kind, "", float(event.point.values[0]))

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> Start | End:
        return self.lost_at(self, lane, passed, error) if self.lost_at else super().lost(lane, passed, error)


def circle(lanes, x, p):
    """The circle x**2 + p**2 = 1."""
    return [x * x + p * p - 1], [[2 * x, 2 * p]]


def lemniscate(lanes, x, p):
    """Bernoulli's lemniscate (x**2 + p**2)**2 = p**2 - x**2, with a node at 0."""
    square = x * x + p * p
    return [square**2 - p * p + x * x], [[4 * x * square + 2 * x, 4 * p * square - 2 * p]]


def transcritical(lanes, x, p):
    """The lines x = 0 and x = p."""
    return [p * x - x * x], [[p - 2 * x, x]]


def pitchfork(lanes, x, p):
    """The line x = 0 and the parabola p = x**2."""
    return [p * x - x**3], [[p - 3 * x * x, x]]


def line(lanes, x, p):
    """The line x = p."""
    return [x - p], [[np.ones_like(x), -np.ones_like(x)]]


def corner(lanes, x, p):
    """The curve x = |p - 0.3|."""
    side = np.where(p >= 0.3, 1.0, -1.0)
    return [x - side * (p - 0.3)], [[np.ones_like(x), -side]]


def fold_curve(lanes, x, a, b):
    """The folds (x, -3 x**2, 2 x**3) of the zeros of x**3 + a x + b, with a cusp at 0."""
    return [x**3 + a * x + b, 3 * x * x + a], [[3 * x * x + a, x, 1.0], [6 * x, 1.0, 0.0]]


def fixed_point(lanes, x, r):
    """The fixed points of the logistic map."""
    return [r * x * (1 - x) - x], [[r * (1 - 2 * x) - 1, x * (1 - x)]]


def two_cycle(lanes, x, y, r):
    """The cycles of period two of the logistic map."""
    return (
        [r * x * (1 - x) - y, r * y * (1 - y) - x],
        [[r * (1 - 2 * x), -1.0, x * (1 - x)], [-1.0, r * (1 - 2 * y), y * (1 - y)]],
    )


def parabolas(lanes, x, p):
    """The parabolas x**2 = c - p, whose constant grows with the lane."""
    return [x * x + p - parabola_constants(lanes)], [[2 * x, 1.0]]


def parabola_constants(lanes: Array) -> Array:
    return 0.2 + 0.01 * lanes


HESSIAN = np.array([[2.0, 1.0], [1.0, 2.0]])


class Bounded(Problem):
    """The minimum of (x - a) H (x - a) / 2 for a = (2 sin p, p) below the bound x_0 <= 1, which is `active` or not.

    Unknowns x, and the multiplier of the active bound. The bound is active where 2 sin p > 1: between pi/6 and 5 pi/6.
    """

    def __init__(self, active: bool):
        self.active = active
        self.tests = [Test("limit", slack, CHANGES, gradient=slack_gradient)]

    def evaluate(self, lanes: Array, xs: Array, known: Any = None, moved: Array | None = None):
        p, m, zero = xs[:, -1], len(xs), np.zeros(len(xs))
        away = xs[:, :2] - np.column_stack([2 * np.sin(p), p])
        along = -np.column_stack([2 * np.cos(p), np.ones(m)]) @ HESSIAN
        residual, jacobian = away @ HESSIAN, np.concatenate([np.tile(HESSIAN, (m, 1, 1)), along[:, :, None]], axis=2)
        if self.active:
            jacobian = np.insert(jacobian, 2, np.array([1.0, 0.0]), axis=2)
            residual = np.column_stack([residual + xs[:, 2:3] * np.array([1.0, 0.0]), xs[:, 0] - 1])
            bound = np.stack([zero + 1, zero, zero, zero], axis=1)
            jacobian = np.concatenate([jacobian, bound[:, None]], axis=1)
        return np.arange(m), Values(residual, jacobian)

    def size(self, lanes: Array, xs: Array) -> Array:
        return np.ones(xs.shape)

    def changed(self, event: Event, passed: Sequence[Points]) -> Start:
        x = event.point.xs[0]
        x = np.delete(x, 2) if self.active else np.insert(x, 2, 0.0)
        return Start(Bounded(not self.active), x, np.eye(len(x))[-1])


def slack(problem: Bounded, points: Points) -> Array:
    """The multiplier of an active bound, or the distance from the bound."""
    return points.xs[:, 2] if problem.active else 1 - points.xs[:, 0]


def slack_gradient(problem: Bounded, xs: Array, evaluation: Any, number: int) -> tuple[Array, Array]:
    column = np.zeros(xs.shape)
    column[:, 2 if problem.active else 0] = 1.0 if problem.active else -1.0
    return (xs[:, 2] if problem.active else 1 - xs[:, 0]), column


def run_of(problem: Problem, *starts: Sequence[float], stop: Any, way: float = 1.0, **options: Any) -> Run:
    """The run of a problem from some places."""
    first = started(problem, np.array(starts, float), options.get("options", Steps()), way)
    return Run(problem, first, stop, **options)


def found_by(run: Run) -> tuple[list[Array], list[Event], list[End]]:
    """The points X of a run in order, its events and its ends."""
    items = [*run]
    xs = [item.xs for item in items if isinstance(item, Points)]
    return (
        [x for block in xs for x in block],
        [e for e in items if isinstance(e, Event)],
        [e for e in items if isinstance(e, End)],
    )


def kinds(events):
    return [event.kind for event in events]


def places(events, kind):
    return np.array([event.point.xs[0] for event in events if event.kind == kind])
