"""Branches of periodic launches, against maps in closed form."""

import numpy as np
import pytest
from return_maps import KnownMaps

from orbits.return_map.branches import BranchTracer, FoundEvent, PeriodicLaunch


def traced(maps, between, alpha, value, side=1, period=1):
    """The points, events and the end of a branch from a periodic launch; the side is that of growing parameters."""
    tracer = BranchTracer(maps, between, period, (), 0.02)
    start = tracer.start(alpha, value)
    items = list(tracer.trace(start, side * (1 if start.tangent[1] > 0 else -1)))
    points = [item for item in items if isinstance(item, PeriodicLaunch)]
    return points, [item for item in items if isinstance(item, FoundEvent)], items[-1]


LOGISTIC = KnownMaps(2.5, 3.6, lambda a, r: r * a * (1 - a), lambda a, r: r * (1 - 2 * a))


def test_the_logistic_map_doubles_its_period():
    """Fixed points 1 - 1/r up to the flip at r = 3; hops of period two up to r = 1 + sqrt(6), with 4 + 2 r - r^2."""
    points, (flip,), end = traced(LOGISTIC, (0.1, 0.99), 0.6, 2.5)
    assert end.kind == "reached"
    assert points[-1].value == 3.6
    for point in points:
        assert point.alphas[0] == pytest.approx(1 - 1 / point.value, abs=1e-12)
    assert (flip.kind, flip.point.value) == ("flip", pytest.approx(3.0, abs=1e-11))
    tracer = BranchTracer(LOGISTIC, (0.1, 0.99), 2, (), 0.02)
    items = list(tracer.trace(tracer.start_beside_flip(flip.point), 1))
    for point in (item for item in items if isinstance(item, PeriodicLaunch)):
        r, root = point.value, np.sqrt((point.value - 3) * (point.value + 1))
        assert sorted(point.alphas) == pytest.approx([(r + 1 - root) / (2 * r), (r + 1 + root) / (2 * r)], abs=1e-10)
        assert point.multiplier == pytest.approx(4 + 2 * r - r**2, abs=1e-8)
    (second,) = (item for item in items if isinstance(item, FoundEvent))
    assert (second.kind, second.point.value) == ("flip", pytest.approx(1 + np.sqrt(6), abs=1e-10))


def test_a_fold_and_what_lies_on_both_sides_of_it():
    """a + v - (a - 1)^2 has the fixed points 1 +- sqrt(v), a fold at 0 and a flip at (2, 1)."""
    maps = KnownMaps(-0.5, 1.44, lambda a, v: a + v - (a - 1) ** 2, lambda a, v: 1 - 2 * (a - 1))
    points, events, end = traced(maps, (0.1, 3.0), 2.1, 1.21, side=-1)
    assert [event.kind for event in events] == ["flip", "fold"]
    assert (events[0].point.value, events[0].point.alphas[0]) == pytest.approx((1.0, 2.0), abs=1e-10)
    assert (events[1].point.value, events[1].point.alphas[0]) == pytest.approx((0.0, 1.0), abs=1e-10)
    assert (points[-1].alphas[0] - 1) ** 2 == pytest.approx(points[-1].value, abs=1e-11)
    assert end.kind == "left"
    assert points[-1].alphas[0] == pytest.approx(0.1, abs=1e-15)


@pytest.mark.parametrize("side", [1, -1])
def test_a_closed_curve_of_fixed_points_ends_where_it_began(side):
    """The fixed points of a + 0.3 ((a - 1)^2 + v^2 - 0.04) are the circle of radius 0.2 round (1, 0)."""
    maps = KnownMaps(-0.5, 0.5, lambda a, v: a + 0.3 * ((a - 1) ** 2 + v**2 - 0.04), lambda a, v: 1 + 0.6 * (a - 1))
    points, events, end = traced(maps, (0.1, 3.0), 1.2, 0.0, side=side)
    assert end.kind == "closed"
    assert [(event.kind, event.point.value) for event in events] == [
        ("fold", pytest.approx(side * 0.2, abs=1e-12)), ("fold", pytest.approx(-side * 0.2, abs=1e-12)),
    ]  # fmt: skip
    assert max(abs((point.alpha - 1) ** 2 + point.value**2 - 0.04) for point in points) < 1e-14


def test_a_branch_ends_where_the_map_jumps():
    """The fixed points of the logistic map come to a = 0.7 at r = 1/0.3; those behind belong to another curve."""
    for size in (0.05, 1e-3):
        maps = KnownMaps(
            2.6, 3.6,
            lambda a, r, size=size: r * a * (1 - a) + np.where(a > 0.7, size, 0.0), LOGISTIC.slope,
            lambda a: np.where(a > 0.7, 2, 1), 0.7,
        )  # fmt: skip
        points, _, end = traced(maps, (0.1, 0.99), 1 - 1 / 3.1, 3.1)
        assert end.kind == "jump"
        assert "the map jumps" in end.reason
        assert points[-1].alphas[0] <= 0.7
        assert points[-1].value <= 1 / 0.3 + 1e-9


def test_a_number_of_impacts_that_changes_without_a_jump_is_no_end():
    maps = KnownMaps(2.6, 3.6, LOGISTIC.following, LOGISTIC.slope, lambda a: np.where(a > 0.7, 2, 1), 0.7)
    _, events, end = traced(maps, (0.1, 0.99), 1 - 1 / 3.1, 3.1)
    assert end.kind == "reached"
    (event,) = events
    assert (event.kind, event.border) == ("border collision", "bounce")
    assert event.point.value == pytest.approx(1 / 0.3, abs=1e-12)
    assert event.sides == pytest.approx((2 - 1 / 0.3, 2 - 1 / 0.3), abs=1e-9)


@pytest.mark.parametrize(("slope", "kind"), [(0.5, "border collision"), (2.0, "non-smooth fold")])
def test_a_graze_is_located_and_named_by_the_slopes_on_both_sides(slope, kind):
    """1 + v + s (a - 1) with - sqrt(a - 1) above a = 1: the fixed point comes to the graze at v = 0, and either goes on
    or meets another one, as the slope beyond is minus infinity. See A. B. Nordmark, J. Sound Vib. 145 (1991)."""

    def following(a, v):
        return 1 + v + slope * (a - 1) - np.sqrt(np.maximum(a - 1, 0))

    def derivative(a, v):
        return slope - (0.5 / np.sqrt(a - 1) if a > 1 else 0.0)

    maps = KnownMaps(-0.3, 0.3, following, derivative, lambda a: np.where(a > 1, 2, 1))
    value = 0.2 if slope > 1 else -0.2
    points, events, _ = traced(maps, (0.1, 3.0), 1 + value / (1 - slope), value, side=-np.sign(value))
    (event,) = (each for each in events if each.border)
    assert (event.kind, event.border) == (kind, "graze")
    assert (event.point.value, event.point.alpha) == pytest.approx((0.0, 1.0), abs=1e-12)
    assert event.sides == (pytest.approx(slope, abs=1e-6), -np.inf)
    assert points[-1].alpha > 1


def test_period_three_of_the_logistic_map_begins_at_a_fold():
    """At r = 1 + sqrt(8), with launches of the stable and the unstable hops on one curve."""
    maps, r = KnownMaps(3.7, 3.9, LOGISTIC.following, LOGISTIC.slope), 3.84
    _, events, end = traced(maps, (0.05, 0.99), 0.1494069, r, side=-1, period=3)
    assert end.kind == "reached"
    folds = [event.point.value for event in events if event.kind == "fold"]
    assert folds == pytest.approx([1 + np.sqrt(8)], abs=1e-10)


@pytest.mark.parametrize(("below", "behind"), [(0.5, -1.5), (2.0, 0.5), (0.5, 3.0)])
def test_corners_of_the_map(below, behind):
    """Slopes that jump at a = 1, where the fixed point is at v = 0: one that goes on, and two that meet there."""

    def slope(a, v):
        return below if a < 1 else behind

    maps = KnownMaps(-0.5, 0.5, lambda a, v: 1 + v + np.where(a < 1, below, behind) * (a - 1), slope)
    value = 0.2 if below > 1 else -0.2
    points, events, _ = traced(maps, (0.1, 3.0), 1 + value / (1 - below), value, side=-np.sign(value))
    turns = (below - 1) * (behind - 1) < 0
    assert {event.kind for event in events} == {"non-smooth fold" if turns else "border collision"}
    assert events[0].point.value == pytest.approx(0.0, abs=1e-9)
    assert points[-1].alphas[0] > 1
    assert points[-1].alphas[0] - 1 == pytest.approx(points[-1].value / (1 - behind), abs=1e-9)


def test_a_branch_ends_where_hops_have_no_next():
    maps = KnownMaps(2.6, 3.6, lambda a, r: np.where(a > 0.7, np.nan, r * a * (1 - a)), LOGISTIC.slope)
    points, _, end = traced(maps, (0.1, 0.99), 1 - 1 / 3.1, 3.1)
    assert end.kind == "no launch"
    assert "the contact never ends" in end.reason
    assert points[-1].value == pytest.approx(1 / 0.3, abs=1e-5)
