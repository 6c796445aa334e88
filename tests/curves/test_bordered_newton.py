"""Newton's method with a border, beside closed forms."""

import numpy as np
import pytest
from plane_curves import Formula, Values, circle, fold_curve

from orbits.curves import Border, Steps, correct

LANES = np.arange(3)


def test_a_component_gets_exactly_its_value():
    p = np.array([0.1, 0.2, 0.3])
    guesses = np.column_stack([np.ones(3), np.zeros(3)])
    which, points = correct(
        Formula(circle), LANES, guesses, Border.of_component(1, p, 2), np.tile([0.0, 1.0], (3, 1)), Steps()
    )
    assert which.tolist() == [0, 1, 2]
    assert points.values.tolist() == p.tolist()
    assert points.xs[:, 0] == pytest.approx(np.sqrt(1 - p**2), rel=1e-15)
    assert points.tangents == pytest.approx(np.column_stack([-p, np.sqrt(1 - p**2)]), abs=1e-10)


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


def test_least_and_rough_bound_the_number_of_steps():
    guess, border, onward = np.array([[0.999, 0.0]]), Border.of_component(1, np.zeros(1), 2), np.array([[0.0, 1.0]])
    counts = []
    for options in ({"rough": 1e-2}, {}, {"least": 6}):
        problem = Formula(circle)
        correct(problem, LANES[:1], guess, border, onward, Steps(), record=False, **options)
        counts.append(problem.calls)
    assert counts == [1, 3, 6]


def test_equations_that_are_not_exact_end_no_correction():
    """Of the first two evaluations the residuals have errors, and the steps with these grow from 1e-7 to 2e-7."""

    class Inexact(Formula):
        def evaluate(self, *args):
            which, found = super().evaluate(*args)
            error = {1: 2e-7, 2: -2e-7}.get(self.calls, 0.0)
            return which, Rough(found.residual + error, found.jacobian, np.inf if error else 1.0)

    class Rough(Values):
        def __init__(self, residual, jacobian, factor):
            super().__init__(residual, jacobian)
            self.factor = factor

        amplification = property(lambda self: np.full(1, self.factor))

    guess, border, onward = np.array([[1.0, 0.0]]), Border.of_component(1, np.zeros(1), 2), np.array([[0.0, 1.0]])
    _, points = correct(Inexact(circle), LANES[:1], guess, border, onward, Steps())
    assert points.xs.tolist() == [[pytest.approx(1.0, abs=1e-15), 0.0]]


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


def test_one_compiled_call_may_do_the_whole_correction():
    def solver(lanes, xs, rows, levels, least, record):
        x = np.sqrt(1 - levels**2)
        return np.arange(len(x)), np.column_stack([x, levels]), np.column_stack([-levels, x]), np.ones(len(x)), None

    problem = Formula(circle)
    problem.solver = solver
    border, onward = Border.of_component(1, np.array([0.6]), 2), np.array([[0.0, -1.0]])
    _, points = correct(problem, LANES[:1], np.array([[1.0, 0.0]]), border, onward, Steps())
    assert problem.calls == 0
    assert points.xs[0] == pytest.approx([0.8, 0.6], abs=1e-15)
    assert points.tangents[0] == pytest.approx([0.6, -0.8], abs=1e-15)


def test_rounding_that_a_problem_expects_ends_newtons_method():
    class Noisy(Formula):
        rounded = 0.0

        def rounding(self, evaluation, rows):
            return np.full(rows.shape, self.rounded)

    def noisy(lanes, x, p):
        return [x - p + 3e-8 * np.sin(1e12 * x)], [[np.ones_like(x), -1.0]]

    lanes, places_, border = (
        np.zeros(5, int),
        np.linspace(0.1, 0.9, 5),
        Border.of_component(1, np.linspace(0.1, 0.9, 5), 2),
    )
    guesses = np.column_stack([places_ + 1e-3, places_])
    exact, expected = Noisy(noisy), Noisy(noisy)
    expected.rounded = 1e-8
    assert len(correct(exact, lanes, guesses, border, border.rows, Steps())[0]) < 5
    which, points = correct(expected, lanes, guesses, border, border.rows, Steps())
    assert which.tolist() == [0, 1, 2, 3, 4]
    assert points.xs[:, 0] == pytest.approx(places_, abs=1e-7)


def test_what_is_known_of_other_points_does_not_serve():
    """Lane 0 settles at once, lane 1 later, and lane 2 never: the equations known last are those of lanes 1 and 2."""

    class Chords(Formula):
        chords = True

        def evaluate(self, lanes, xs, known=None, moved=None):
            assert known is None or len(known.residual) == len(xs)
            if known is not None and (moved == 0).all():
                assert known.residual[:, 0] == pytest.approx(self.function(lanes, *xs.T)[0][0], abs=1e-6)
            return super().evaluate(lanes, xs)

    def lanes_of(lanes, x, p):
        power = np.where(lanes == 2, 0.3, 1.0) + np.where(lanes == 1, 1.0, 0.0)
        return [np.abs(x) ** power - p**power + 0 * lanes], [
            [power * np.abs(x) ** (power - 1), -power * p ** (power - 1)]
        ]

    p = np.array([0.5, 0.5, 0.5])
    guesses = np.column_stack([[0.5, 0.52, 30.0], p])
    border = Border.of_component(1, p, 2)
    which, points = correct(Chords(lanes_of), np.arange(3), guesses, border, border.rows, Steps())
    assert points.xs[:, 0] == pytest.approx(np.full(len(which), 0.5), abs=1e-12)
    assert {0, 1} <= {*which.tolist()}
