"""Curves in closed form, followed together: those that arrive, at the right place, and why others end."""

import numpy as np
import pytest

from orbits.continuation.many_curves import follow_together
from orbits.errors import FlowError
from orbits.shooting import Evaluation


class Curves:
    """The curves value = g(u) of one unknown 1 + u, whose motions end beyond a bound of |u|."""

    def __init__(self, g, slope, bound=np.inf):
        self.g, self.slope, self.bound = g, slope, bound

    def size(self, xs):
        return np.maximum(np.abs(xs), 1.0)

    def evaluate(self, xs):
        u, ones = xs[:, 0] - 1, np.ones((len(xs), 1, 1))
        if (np.abs(u) > self.bound).any():
            raise FlowError("it breaks off")
        jacobian = np.concatenate([self.slope(u)[:, None, None], -ones], axis=2)
        return Evaluation((self.g(u) - xs[:, 1])[:, None], jacobian, (), (ones,), (), ())

    def evaluate_lanes(self, xs):
        which = np.flatnonzero(np.abs(xs[:, 0] - 1) <= self.bound)
        return which, self.evaluate(xs[which]) if len(which) else None


def followed(curves, *us):
    *_, way = follow_together(curves, 1 + np.array(us)[:, None], np.arange(len(us)), most=2)
    return way


def test_a_curve_that_folds_twice_arrives():
    """value = 3 u (u - 1)^2 has folds at u = 1/3, where it is 4/9, and at u = 1, where it is 0.25 here."""
    curves = Curves(lambda u: 3 * u * (u - 1) ** 2 + 0.25 * u, lambda u: 3 * (u - 1) * (3 * u - 1) + 0.25)
    way = followed(curves, 0.0)
    assert way.arrived.all()
    assert way.share == 1
    assert curves.g(way.xs[:, 0] - 1) == pytest.approx([1.0], abs=1e-13)
    assert way.xs[0, 0] > 2


def reasons(way):
    return {i: (end.kind, end.reason) for i, end in way.ended.items()}


@pytest.mark.parametrize("radius", [1e-2, 1e-3, 1e-4])
def test_sharp_folds_are_passed(radius):
    """The slopes are about 1, then -1/2, then 1; the value is 1 where u is 1.45."""

    def bend(u):
        return 0.75 * (np.hypot(u - 0.6, radius) - np.hypot(u - 0.3, radius))

    def slope(u):
        return 1 + 0.75 * ((u - 0.6) / np.hypot(u - 0.6, radius) - (u - 0.3) / np.hypot(u - 0.3, radius))

    way = followed(Curves(lambda u: u + bend(u) - bend(0.0), slope), 0.0)
    assert way.arrived.all()
    assert way.xs[0] == pytest.approx([2.45, 1.0], abs=radius)
    assert way.xs[0, 0] - 1 + bend(way.xs[0, 0] - 1) - bend(0.0) == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize("slope", [5.0, 0.2])
def test_a_corner_is_passed(slope):
    """The value is u up to 1/2, and grows with another slope from there on."""
    corner = Curves(lambda u: np.where(u < 0.5, u, 0.5 + slope * (u - 0.5)), lambda u: np.where(u < 0.5, 1.0, slope))
    way = followed(corner, 0.0, 0.0)
    assert way.arrived.all()
    assert way.xs == pytest.approx(np.array([[1.5 + 0.5 / slope, 1.0]] * 2), rel=1e-13)


def test_why_curves_end():
    returns = Curves(lambda u: u * (1 - u), lambda u: 1 - 2 * u)
    way = followed(returns, 0.0, 1.0)
    fold = "fold", "its family folds and returns to straight springs"
    assert reasons(way) == {0: fold, 1: fold}
    assert not way.arrived.any()
    assert way.share == 1
    assert way.furthest == pytest.approx([0.25, 0.25], abs=0.02)
    grows = Curves(lambda u: 0.5 - 0.5 / (1 + u), lambda u: 0.5 / (1 + u) ** 2)
    assert reasons(followed(grows, 0.0)) == {0: ("escaped", "its launch speed grows without bound")}
    none = Curves(lambda u: 1.0 + u**2, lambda u: 2.0 * u)
    assert reasons(followed(none, 0.0)) == {0: ("stuck", "Newton's method does not find its first point")}
    turns = Curves(lambda u: np.where(u < 0.3, u, 1.8 - 5 * u), lambda u: np.where(u < 0.3, 1.0, -5.0))
    way = followed(turns, 0.0)
    assert reasons(way) == {0: ("stuck", "its steps become too short")}
    assert way.furthest == pytest.approx([0.3], abs=1e-3)
    waves = Curves(lambda u: u / 200 + 0.02 * np.sin(10 * u) ** 2, lambda u: 1 / 200 + 0.2 * np.sin(20 * u))
    assert reasons(followed(waves, 0.0)) == {0: ("stopped", "it takes more than 500 steps")}


def test_one_that_breaks_off_leaves_the_others():
    curves = Curves(lambda u: np.where(u < 0, -u / 9, u), lambda u: np.where(u < 0, -1 / 9, 1.0), bound=5.0)
    way = followed(curves, -1e-15, 0.0, 0.0)
    assert reasons(way) == {0: ("stuck", "it breaks off")}
    assert way.xs[1:] == pytest.approx(np.array([[2.0, 1.0]] * 2), abs=1e-14)
