"""The predictor on chains of points whose curve is a polynomial."""

import numpy as np
import pytest

from orbits.numerics import slopes, through


def test_what_rests_on_a_chain_of_points():
    """Points on either side are used while the chain keeps its direction: a cubic through two, a line through one."""
    t = np.array([0.0, 0.1, 0.3, 0.35, 0.2])
    xs, tangents = np.stack([t**3, t], axis=1), np.stack([3 * t**2, np.ones(5)], axis=1)
    tangents[4] *= -1  # turned round
    rows, levels = np.array([[0.0, 1.0]] * 4), np.array([0.2, 0.2, 0.2, 0.1])
    places = np.array([1, 2, 4, 5])[:, None] + np.arange(-3, 2)  # three points before each place, two from there on
    use, places = (places >= 0) & (places < 5), places.clip(0, 4)
    points, counts = through(xs[places], tangents[places], use, 2, rows, levels)
    assert counts.tolist() == [3, 4, 4, 1]
    assert points[:3] == pytest.approx(np.array([[0.008, 0.2]] * 3), abs=1e-15)
    assert points[3] == pytest.approx(np.array([0.008 - 0.1 * 0.12, 0.1]), abs=1e-15)


def test_slopes_of_a_polynomial_through_points():
    """Of a cubic and of a line through four points in any order; of the chord through two."""
    t = np.array([0.2, -0.1, 0.35, 0.3])
    values = np.stack([t**3 - t, 2.0 * t], axis=1)
    assert slopes(t, values) == pytest.approx([3 * 0.2**2 - 1, 2.0], rel=1e-13)
    assert slopes(t[:2], values[:2]) == pytest.approx((values[0] - values[1]) / 0.3, rel=1e-13)
