"""Roots, extrema and sign changes of functions of one variable, found in few evaluations; and linear systems."""

import numpy as np
import pytest

from orbits.numerics import bracketed_root, enclosed_ends, enclosed_sign_changes, newton_root, resolved, solve


@pytest.mark.parametrize("share", [0.05, 0.3, -0.05, -0.45])
@pytest.mark.parametrize("grain", [1e-14, 1e-13, 3e-13])
def test_a_root_that_rounding_hides(grain, share):
    """Plateaus beside the root cost few evaluations: longer steps close the bracket, not bisection from afar."""
    asked = []

    def function(x):
        asked.append(x)
        return float((np.round((np.sin(x) - 0.5) / grain) + share) * grain)

    root = bracketed_root(function, 0.0, 1.0, -0.5, 0.34, width=1e-13)
    assert abs(root - np.pi / 6) < 1e-13 + grain
    assert len(asked) < 15


def test_newtons_method_ends_at_the_rounding_of_the_function():
    """Of simple and double roots, at 0, far away and under noise; without a root there is none."""
    assert newton_root(lambda x: -(x - 3e9), 0.0) == 3e9
    assert newton_root(lambda x: -0.5 * (x - 1.0), 0.0) == pytest.approx(1.0, abs=1e-7)
    assert newton_root(lambda x: -np.sin(x) / np.cos(x), 0.5) == pytest.approx(0.0, abs=1e-16)
    noisy = newton_root(lambda x: -((1e8 + x) - (1e8 + 0.3)), 0.7)
    assert noisy == pytest.approx(0.3, abs=3e-8)
    assert newton_root(lambda x: -(x * x + 1) / (2 * x), 0.7) is None
    assert newton_root(lambda x: np.nan, 0.7) is None


@pytest.mark.parametrize("place", [4.7, 5.3])
def test_an_extremum_is_resolved_on_both_sides_of_a_grid_point(place):
    """A parabola dips below zero between points of a grid, left of the lowest one or right of it."""
    dip = lambda x: (x - place) ** 2 - 1e-4  # noqa: E731
    grid, values = resolved(dip, np.arange(11.0), True)
    assert values.min() < 0 < dip(np.arange(11.0)).min()
    assert np.array_equal(values, dip(grid))
    assert (np.diff(grid) > 0).all()


def test_sign_changes_are_closed_to_neighbouring_numbers():
    """Of a root, of a jump, of an infinite slope and of a flat root, together."""
    functions = [
        lambda x: x**3 - 2, lambda x: np.where(x < 1.3, -1.0, 2.0), lambda x: np.cbrt(x - 1.234),
        lambda x: 1e-9 * (1.7 - x),
    ]  # fmt: skip
    calls = []

    def values(x, which):
        calls.append(len(x))
        return np.array([functions[k](place) for place, k in zip(x, which, strict=True)])

    a, b, which = np.ones(4), np.full(4, 2.0), np.arange(4)
    x1, x2, _, _ = enclosed_sign_changes(values, a, b, values(a, which), values(b, which))
    assert sum(calls) < 150  # a bisection alone takes 208
    assert x1 == pytest.approx([2 ** (1 / 3), 1.3, 1.234, 1.7], rel=1e-15)
    assert (np.abs(x2 - x1) <= 4.5e-16 * x1).all()


def test_ends_of_conditions_are_enclosed_in_few_calls():
    """The first of several ends, and one next to the beginning."""
    ends, calls = [np.array([1.3, 1.9]), np.array([1.0 + 1e-12])], []

    def holds(x, which):
        calls.append(len(x))
        return np.array([np.sum(place > ends[k]) % 2 == 0 for place, k in zip(x, which, strict=True)])

    a, b = enclosed_ends(holds, np.ones(2), np.array([1.95, 2.0]))
    assert len(calls) <= 14  # four times as many halvings close an interval
    assert a == pytest.approx([1.3, 1.0 + 1e-12], rel=1e-15)
    assert ((b - a > 0) & (b - a <= 4.5e-16 * a)).all()


def test_a_singular_system_of_a_stack_has_no_solution_and_the_others_have():
    regular, singular, right = np.diag([2.0, 4.0]), np.ones((2, 2)), np.array([[2.0], [4.0]])
    found = solve(np.array([regular, singular]), right[None])
    assert found[0] == pytest.approx(np.ones((2, 1)))
    assert np.isnan(found[1]).all()
    assert np.isnan(solve(singular, right[:, 0])).all()


def test_one_singular_system_of_several():
    square = np.array([np.eye(2), [[1.0, 2.0], [2.0, 4.0]], 2 * np.eye(2)])
    found = solve(square, np.array([[[1.0], [3.0]]]))
    assert found[[0, 2], :, 0] == pytest.approx(np.array([[1.0, 3.0], [0.5, 1.5]]))
    assert np.isnan(found[1]).all()
