"""Bernstein exclusion finds every root, however close to grazing; a bracket closes even where rounding hides it."""

import numpy as np
import pytest

from orbits.numerics import (
    ROOTS,
    Crossings,
    PiecewisePolynomials,
    derivative,
    evaluate,
    lowest,
    piecewise_roots,
    polynomial_roots,
    powers,
    roots_within,
    shifted,
)
from orbits.numerics.polynomial_roots import _refine, _refine_together, bernstein
from orbits.symbolic import kernels

RNG = np.random.default_rng(7)


def test_bernstein_coefficients_enclose_the_values():
    c = RNG.standard_normal((50, 9))
    h = RNG.uniform(0.1, 3, 50)
    values = np.stack([evaluate(c, s * h) for s in np.linspace(0, 1, 101)])
    b = bernstein(c, powers(h, 9))
    assert (b.min(1) <= values.min(0) + 1e-12).all()
    assert (b.max(1) >= values.max(0) - 1e-12).all()


def test_roots_are_those_of_the_companion_matrix():
    for _ in range(200):
        inside = np.sort(RNG.uniform(0.05, 1.95, RNG.integers(1, 6)))
        if len(inside) > 1 and np.diff(inside).min() < 1e-2:
            continue
        c = np.poly([*inside, -1.0, 4.0])[::-1].copy()
        assert roots_within(c, 2.0) == pytest.approx(inside, rel=1e-9)


@pytest.mark.parametrize("exponent", range(1, 9))
@pytest.mark.slow
def test_no_grazing_pair_is_missed_and_none_invented(exponent):
    """A parabola that dips below zero, or stays above it, by 10**-exponent inside a long curved piece."""
    for _ in range(100):
        place, dip = RNG.uniform(0.4, 0.6), 10.0**-exponent * RNG.uniform(0.3, 1)
        shape = np.polynomial.polynomial.polymul([place**2 - dip, -2 * place, 1.0], [1.0, RNG.uniform(-0.9, 2)])
        assert len(roots_within(shape, 1.0)) == 2
        above = np.polynomial.polynomial.polymul([place**2 + dip, -2 * place, 1.0], [1.0, RNG.uniform(-0.9, 2)])
        assert roots_within(above, 1.0) == []


def test_piecewise_roots_are_found_once_at_the_joints():
    """The sine in pieces that end exactly on its zeros."""
    starts = np.pi * np.arange(5)
    orders = np.arange(36)
    factorials = np.cumprod(np.maximum(orders, 1.0))
    c = np.array([np.sin(start + orders * np.pi / 2) / factorials for start in starts])
    c[:, 0] = np.sin(starts)  # rounding, of either sign
    times = [starts[i] + t for i, t in piecewise_roots(c, np.full(5, np.pi), start=1)]
    assert times[:4] == pytest.approx(np.pi * np.arange(1, 5), abs=1e-12)
    assert len(times) <= 5  # the last end is a zero too, and rounding decides on which side


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("rounding", [1e-17, -1e-17])
def test_the_zero_that_a_motion_begins_with_is_no_root(order, rounding):
    """t**order (1 - t), whose lower coefficients are rounding of either sign."""
    c = np.zeros((1, 8))
    c[0, : order + 2] = [*[rounding] * order, 1.0, -1.0]
    assert [t for _, t in piecewise_roots(c, np.array([1.5]), start=order)] == pytest.approx([1.0], rel=1e-14)


def test_rising_roots_only():
    c = np.array([np.poly([0.25, 0.5, 0.75])[::-1]])
    assert [t for _, t in piecewise_roots(c, np.array([1.0]), rising=True)] == pytest.approx([0.25, 0.75])


def test_lowest_value_is_inside_or_at_an_end():
    c = np.array([[1.0, -2.0, 1.5], [0.5, 1.0, 0.0]])
    value, piece, t = lowest(c, np.array([1.0, 1.0]))
    assert (value, piece) == (pytest.approx(1 / 3), 0)
    assert t == pytest.approx(2 / 3)
    assert lowest(-c, np.array([1.0, 1.0]))[0] == pytest.approx(-1.5)


def test_shift_and_derivative():
    c = RNG.standard_normal((3, 2, 8))
    h = np.array([0.3, 0.5, 0.9])
    moved = shifted(c, h)
    assert evaluate(moved, 0.2) == pytest.approx(evaluate(c, h[:, None] + 0.2))
    step = 1e-6
    slope = (evaluate(c, 0.4 + step) - evaluate(c, 0.4 - step)) / (2 * step)
    assert evaluate(derivative(c), 0.4) == pytest.approx(slope, rel=1e-8)


def test_a_root_in_a_bracket_that_rounding_has_closed():
    """A line that misses zero by a rounding at the only number left in the bracket: that is the root, found at once."""
    r = 0.21758109405527115
    c, share = np.array([[-6.0 * r, 6.0]]), np.array([r])
    c[0, 0] -= 2 * np.spacing(c[0, 0])
    (t,) = _refine_together(c, np.ones(1), share, share, np.array([True]), share)
    assert t == pytest.approx(r, abs=1e-16)
    assert _refine(c[0], 1.0, r, r, True, r) == t


def test_no_root_is_lost_at_a_joint_of_blocks_where_one_side_rounds_to_zero():
    """The first block ends a rounding below zero, the next begins with zero itself and rises."""
    crossings = Crossings()
    below = -1 - np.finfo(float).eps
    assert crossings(np.array([[below, 1.0]]), np.array([1.0])) == []
    ((piece, t),) = crossings(np.array([[0.0, 1.0]]), np.array([1.0]))
    assert piece == 0
    assert abs(t) < 1e-15


@pytest.mark.parametrize("count", [1, 20])
def test_newtons_method_needs_few_steps(count, monkeypatch):
    """Twelve bisections of the interval alone would leave the root to 2e-4; one root, and many together."""
    monkeypatch.setattr(polynomial_roots, "ROOTS", ROOTS._replace(iterations=12))
    monkeypatch.setattr(kernels, "KERNELS", kernels.KERNELS._replace(longest_run=12))
    sought = np.linspace(0.3, 0.7, count)
    series = np.array([np.poly1d([root, 1.3, -0.4], r=True).coeffs[::-1] for root in sought])
    _, _, found = PiecewisePolynomials(series, np.ones(count), np.ones(count, int)).roots()
    assert found == pytest.approx(sought, rel=1e-14)
