"""Newton's method with a border, beside closed forms."""

import numpy as np
import pytest
from plane_curves import Formula, circle, fold_curve

from orbits.curves import Border, Steps, correct

LANES = np.arange(3)


def test_lanes_that_lead_nowhere_are_left_out():
    """The circle has no point at p = 2, and none within the reach of the first step at 0.9."""
    border = Border.of_component(1, np.array([0.1, 2.0, 0.9]), 2)
    guesses, onward = np.column_stack([np.ones(3), np.zeros(3)]), np.tile([0.0, 1.0], (3, 1))
    which, points = correct(
        Formula(circle), LANES, guesses, border, onward, Steps(), reach=np.array([np.inf, np.inf, 0.1])
    )
    assert (which.tolist(), points.lanes.tolist()) == ([0], [0])
    none, points = correct(
        Formula(circle), LANES[:0], guesses[:0], Border(onward[:0], onward[:0, 0]), onward[:0], Steps()
    )
    assert (len(none), len(points)) == (0, 0)


def test_a_border_that_bends_locates_an_event_at_once():
    """The point of the curve of folds with x = 2 a + 1, that is x = -1/2 or 1/3 on it."""

    def event(which, xs, evaluation):
        rows = np.array([[1.0, -4.0 * xs[0, 1], 0.0]])
        return rows, (rows * xs).sum(1) - (xs[:, 0] - 2 * xs[:, 1] ** 2 - 0.1)

    border = Border(np.zeros((1, 3)), np.zeros(1), event)
    _, points = correct(Formula(fold_curve), LANES[:1], np.array([[0.1, 0.0, 0.0]]), border, np.eye(3)[:1], Steps())
    x, a, b = points.xs[0]
    assert x == pytest.approx(2 * a**2 + 0.1, abs=1e-15)
    assert (a, b) == (pytest.approx(-3 * x**2, abs=1e-15), pytest.approx(2 * x**3, abs=1e-15))


def test_recorded_points_take_a_step_behind_a_rough_one():
    """Newton's step for the square root of 1 - p**2 squares the error and halves it."""
    guess, border, onward = (
        np.array([[1.0 + 1e-4, 0.0]]),
        Border.of_component(1, np.zeros(1), 2),
        np.array([[0.0, 1.0]]),
    )
    for rough, calls, error in ((1e-2, 2, 1.25e-17), (np.inf, 1, 5e-9)):
        problem = Formula(circle)
        _, points = correct(problem, LANES[:1], guess, border, onward, Steps(), rough=np.full(1, rough))
        assert problem.calls == calls
        assert points.xs[0, 0] - 1.0 == pytest.approx(error, abs=1e-12)
