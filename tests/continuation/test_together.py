"""Curves in closed form, followed together."""

from types import SimpleNamespace

import numpy as np
import pytest

from orbits.continuation.together import GROWS, RETURNS, follow_together
from orbits.errors import FlowError
from orbits.shooting.single_shooting import Evaluation


class Curves:
    """The curves value = g(u) of one unknown 1 + u, whose motions end beyond a bound of |u|."""

    equations = SimpleNamespace(durations=[])

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


def test_a_curve_that_folds_near_its_beginning_goes_on():
    """The curve above, 1e-4 times as high where it folds: it does not go back to where it began."""
    curves = Curves(
        lambda u: 1e-4 * (3 * u * (u - 1) ** 2 + 0.25 * u), lambda u: 1e-4 * (3 * (u - 1) * (3 * u - 1) + 0.25)
    )
    way = followed(curves, 0.0)
    assert way.arrived.all()
    assert curves.g(way.xs[:, 0] - 1) == pytest.approx([1.0], abs=1e-13)


def test_why_curves_end():
    returns = Curves(lambda u: u * (1 - u), lambda u: 1 - 2 * u)
    way = followed(returns, 0.0, 1.0)
    assert way.ended == {0: RETURNS, 1: RETURNS}
    assert not way.arrived.any()
    assert way.furthest == pytest.approx([0.25, 0.25], abs=0.02)
    grows = Curves(lambda u: 0.5 - 0.5 / (1 + u), lambda u: 0.5 / (1 + u) ** 2)
    assert followed(grows, 0.0).ended == {0: GROWS}


def test_one_that_breaks_off_leaves_the_others():
    curves = Curves(lambda u: np.where(u < 0, -u / 9, u), lambda u: np.where(u < 0, -1 / 9, 1.0), bound=5.0)
    way = followed(curves, -1e-15, 0.0, 0.0)
    assert way.ended == {0: "it breaks off"}
    assert way.xs[1:] == pytest.approx(np.array([[2.0, 1.0]] * 2), abs=1e-14)
