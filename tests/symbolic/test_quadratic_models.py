"""The minimum of quadratic models against closed forms."""

import numpy as np
import pytest

from orbits.symbolic import QuadraticModels, Weights

# x^2 + 4 y^2 at (2, 1), a circle's (x^2 + y^2) there, and x - y.
MODELS = QuadraticModels(
    np.array([8.0, 5.0, 1.0]),
    np.array([[4.0, 8.0], [4.0, 2.0], [1.0, -1.0]]),
    np.array([np.diag([2.0, 8.0]), 2 * np.eye(2), np.zeros((2, 2))]),
)
FREE = np.array([[-9.0, -9.0], [9.0, 9.0]])


def test_the_least_of_an_ellipse_outside_of_a_circle():
    """Where x^2 + y^2 is at least 4, the ellipse is least on the x axis."""
    found = MODELS.minimum(1, FREE, np.array([[4.0, -9.0], [np.inf, 9.0]]), Weights(1.0, 0.0))
    assert found.reason == ""
    assert np.array([2.0, 1.0]) + found.x[:2] == pytest.approx([2.0, 0.0], abs=1e-7)
    assert MODELS(found.x[:2]) == pytest.approx([4.0, 4.0, 2.0], rel=1e-10)


def test_violations_have_a_price():
    """x^2 + y^2 >= 4 is worth less than it costs at a price of 0.5: the centre is better than the circle."""
    limits = np.array([[4.0, -9.0], [np.inf, 9.0]])
    for price, least in ((0.5, 0.5 * 4.0), (2.0, 4.0)):
        found = MODELS.minimum(1, FREE, limits, Weights(1.0, price))
        assert found.cost == pytest.approx(least, rel=1e-9)
