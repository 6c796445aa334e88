"""Curves of minima against closed forms."""

import numpy as np
import pytest
import scipy.sparse as sp

from orbits.curves import CriticalPoint, End, Event, FirstDerivatives, MinimumCurve, SecondDerivatives
from orbits.errors import NoOrbit


class Written:
    """A program written out: functions of (x, p) for f, g and all their derivatives, and limits."""

    def __init__(self, f, g, lower, upper, sparse=False):
        self.f, self.g, self.limits, self.sparse = f, g, (np.array(lower, float), np.array(upper, float)), sparse

    def first(self, x, p, y):
        f, fx, fp = self.f(x, p)[:3]
        g, gx, gp = self.g(x, p)[:3]
        return FirstDerivatives(f, fx + gx.T @ y, g, fp + y @ gp)

    def second(self, x, p, y):
        fxx, fxp = self.f(x, p)[3:]
        _, gx, gp, gxx, gxp = self.g(x, p)
        hessian = fxx + np.einsum("i,ijk", y, gxx) if len(y) else fxx
        matrices = gx, hessian
        if self.sparse:
            matrices = sp.csc_matrix(gx), sp.csc_matrix(hessian)
        return SecondDerivatives(*matrices, fxp + gxp.T @ y, gp)


def nothing(n):
    return lambda x, p: (np.zeros(0), np.zeros((0, n)), np.zeros(0), np.zeros((0, n, n)), np.zeros((0, n)))


def run(curve, at=()):
    items = list(curve.run(at))
    points = [each for each in items if isinstance(each, CriticalPoint)]
    events = [each for each in items if isinstance(each, Event)]
    assert all(points[each.after] is each.point for each in events)
    return points, events, items[-1]


def circle(x, p):
    """x0^2 + x1^2 - p."""
    return np.array([x @ x - p]), 2 * x[None], np.array([-1.0]), 2 * np.eye(2)[None], np.zeros((1, 2))


def plane(x, p):
    """x0 + 2 x1, with no dependence on p."""
    return x[0] + 2 * x[1], np.array([1.0, 2.0]), 0.0, np.zeros((2, 2)), np.zeros(2)


@pytest.mark.parametrize("sparse", [False, True])
def test_a_linear_cost_on_a_disc_and_its_price(sparse):
    """V = -sqrt(5 p), x = -(1, 2) sqrt(p / 5), and the multiplier of the radius squared is sqrt(5 / p) / 2."""
    program = Written(plane, circle, [-np.inf] * 2 + [-np.inf], [np.inf] * 2 + [0.0], sparse)
    curve = MinimumCurve(program, np.array([-0.4, -0.9]), np.array([0, 0, 1.1]), 1.0, 4.0)
    points, events, end = run(curve, at=[2.0])
    assert (events, end) == ([], End("reached"))
    assert 2.0 in [each.value for each in points]
    assert points[-1].value == 4.0
    for each in points:
        p = each.value
        assert each.cost == pytest.approx(-np.sqrt(5 * p), rel=1e-13)
        assert each.slope == pytest.approx(-0.5 * np.sqrt(5 / p), rel=1e-12)
        assert each.x == pytest.approx(-np.array([1, 2]) * np.sqrt(p / 5), rel=1e-12)
        assert each.multipliers[2] == pytest.approx(np.sqrt(5 / p) / 2, rel=1e-12)
        assert (each.negative, each.active) == (0, (2,))
    exact = curve.at(3.0, points[2])
    assert exact.rates[0] == pytest.approx(exact.x / 6, rel=1e-12)
    assert exact.rates[1][2] == pytest.approx(-exact.multipliers[2] / 6, rel=1e-12)


def tracking(x, p):
    """(x0 - p)^2 + (x1 - p^2)^2 + x0 x1 / 2."""
    gap = x - np.array([p, p**2])
    slope = np.array([2 * gap[0] + x[1] / 2, 2 * gap[1] + x[0] / 2])
    return (
        gap @ gap + x[0] * x[1] / 2, slope, -2 * gap[0] - 4 * p * gap[1], np.array([[2, 0.5], [0.5, 2]]),
        np.array([-2.0, -4 * p]),
    )  # fmt: skip


def test_bounds_enter_and_leave_where_the_closed_form_says():
    """With x within [0, 1]^2: x1 is 0 until 4 p^2 = p, and x0 is 1 once it gets there."""
    program = Written(tracking, nothing(2), [0, 0], [1, 1])
    points, events, end = run(MinimumCurve(program, np.array([0.1, 0.0]), np.array([0, -0.1]), 0.1, 2.0))
    assert end.kind == "reached"
    assert [(each.kind, each.which) for each in events] == [("leaves", 1), ("enters", 1), ("enters", 0)]
    assert events[0].point.value == pytest.approx(0.25, abs=1e-12)
    for each in points:
        best = least_in_box(each.value)
        assert each.cost == pytest.approx(best, abs=1e-12)
        either_side = (least_in_box(each.value + 1e-5) - least_in_box(each.value - 1e-5)) / 2e-5
        assert each.slope == pytest.approx(either_side, abs=2e-4)


def least_in_box(p):
    """By trying all sets of active bounds."""
    hessian, linear = np.array([[2, 0.5], [0.5, 2]]), np.array([-2 * p, -2 * p**2])
    best = np.inf
    for a in (None, 0.0, 1.0):
        for b in (None, 0.0, 1.0):
            x = np.array([a or 0.0, b or 0.0])
            free = [i for i, each in enumerate((a, b)) if each is None]
            if free:
                x[free] = np.linalg.solve(hessian[np.ix_(free, free)], -(linear + hessian @ x)[free])
            if ((x >= -1e-15) & (x <= 1 + 1e-15)).all():
                best = min(best, tracking(x, p)[0])
    return best


def cubic(x, p):
    """x^3/3 - p x has a minimum at sqrt(p), which meets a maximum at p = 0."""
    return x[0] ** 3 / 3 - p * x[0], np.array([x[0] ** 2 - p]), -x[0], np.array([[2 * x[0]]]), np.array([-1.0])


def test_a_fold_ends_the_minima():
    program = Written(cubic, nothing(1), [-np.inf], [np.inf])
    points, events, end = run(MinimumCurve(program, np.array([1.0]), np.zeros(1), 1.0, -1.0))
    assert [each.kind for each in events] == ["fold"]
    assert end.kind == "fold"
    assert "meets a saddle" in end.reason
    assert events[0].point.value == pytest.approx(0, abs=1e-12)
    assert all(each.x[0] == pytest.approx(np.sqrt(each.value), abs=1e-10) for each in points[:-1])


def pitchfork(x, p):
    """x^4/4 - p x^2/2: the minimum 0 loses its second-order condition at p = 0."""
    return (
        x[0] ** 4 / 4 - p * x[0] ** 2 / 2, np.array([x[0] ** 3 - p * x[0]]), -(x[0] ** 2) / 2,
        np.array([[3 * x[0] ** 2 - p]]), np.array([-x[0]]),
    )  # fmt: skip


def test_a_bifurcation_ends_the_minima():
    program = Written(pitchfork, nothing(1), [-np.inf], [np.inf])
    _points, events, end = run(MinimumCurve(program, np.zeros(1), np.zeros(1), -1.0, 1.0))
    assert [each.kind for each in events] == ["bifurcation"]
    assert end.kind == "bifurcation"
    assert events[0].point.value == pytest.approx(0, abs=1e-6)
    with pytest.raises(NoOrbit, match="second-order"):
        MinimumCurve(program, np.zeros(1), np.zeros(1), 1.0, 2.0)


def test_limits_that_exclude_each_other_end_the_minima():
    program = Written(plane_of_one, between, [-np.inf, 0, -np.inf], [np.inf, np.inf, 1.0])
    points, _events, end = run(MinimumCurve(program, np.array([0.0]), np.array([0, -1.0, 0]), 0.0, 2.0))
    assert end.kind == "infeasible"
    assert "exclude each other" in end.reason
    assert points[-1].value == pytest.approx(1.0, abs=1e-12)


def plane_of_one(x, p):
    return x[0], np.array([1.0]), 0.0, np.zeros((1, 1)), np.zeros(1)


def between(x, p):
    """x - p >= 0 and x <= 1."""
    return np.array([x[0] - p, x[0]]), np.ones((2, 1)), np.array([-1.0, 0]), np.zeros((2, 1, 1)), np.zeros((2, 1))


def exchange(x, p):
    """x >= p and x >= 1 - p."""
    return (
        np.array([x[0] - p, x[0] - 1 + p]),
        np.ones((2, 1)),
        np.array([-1.0, 1]),
        np.zeros((2, 1, 1)),
        np.zeros((2, 1)),
    )


def test_dependent_limits_exchange_at_a_vertex():
    program = Written(plane_of_one, exchange, [-np.inf, 0, 0], [np.inf] * 3)
    points, events, end = run(MinimumCurve(program, np.array([1.0]), np.array([0, 0, -1.0]), 0.0, 2.0))
    assert end.kind == "reached"
    assert [each.kind for each in events] == ["enters"]
    assert events[0].point.value == pytest.approx(0.5, abs=1e-12)
    assert all(each.cost == pytest.approx(max(each.value, 1 - each.value), abs=1e-12) for each in points)


def energy(x, p):
    """The elastic energy of a chain between walls, loaded by p evenly."""
    h = 1 / (len(x) + 1)
    matrix = chain_matrix(len(x))
    return x @ (matrix @ x) / 2 - p * h * x.sum(), matrix @ x - p * h, -h * x.sum(), matrix, np.full(len(x), -h)


def chain_matrix(n):
    return sp.diags([np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)], [-1, 0, 1], format="csc") * (n + 1)


class Obstacle:
    """A string over a floor at -1: the contact zone grows with the load (300 unknowns)."""

    n = 300
    limits = np.full(n, -1.0), np.full(n, np.inf)

    def first(self, x, p, y):
        cost, gradient, slope, *_ = energy(x, p)
        return FirstDerivatives(cost, gradient, np.zeros(0), slope)

    def second(self, x, p, y):
        *_, matrix, slope = energy(x, p)
        return SecondDerivatives(sp.csc_matrix((0, self.n)), matrix, slope, np.zeros(0))


def test_a_string_that_is_pressed_on_a_floor():
    """Free it is -p s (1 - s)/2 deep, so that the middle touches at p = 8 (here with the nodes next to the middle)."""
    n, program = Obstacle.n, Obstacle()
    curve = MinimumCurve(program, np.zeros(n), np.zeros(n), 0.0, -9.0)
    points, events, end = run(curve)
    assert end.kind == "reached"
    assert len(events) > 6
    s = np.arange(1, n + 1) / (n + 1)
    assert events[0].point.value == pytest.approx(-1 / (s * (1 - s) / 2).max(), rel=1e-12)
    assert points[2].x == pytest.approx(points[2].value * s * (1 - s) / 2, abs=1e-12)
    touching = points[-1].x <= -1 + 1e-12
    assert 1 - touching.mean() == pytest.approx(2 * np.sqrt(2 / 9), abs=0.01)  # p l^2 / 2 = 1 on each free side
