"""Branches of periodic launches, against maps in closed form."""

import numpy as np
import pytest
from return_maps import LOGISTIC, KnownMaps, traced

from orbits.curves import Event
from orbits.returns.launch_branches import BranchTracer
from orbits.returns.periodic_launch import PeriodicLaunch


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
    (second,) = (item for item in items if isinstance(item, Event))
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


def test_a_branch_ends_where_hops_have_no_next():
    maps = KnownMaps(2.6, 3.6, lambda a, r: np.where(a > 0.7, np.nan, r * a * (1 - a)), LOGISTIC.slope)
    points, _, end = traced(maps, (0.1, 0.99), 1 - 1 / 3.1, 3.1)
    assert end.kind == "no launch"
    assert "the contact never ends" in end.reason
    assert points[-1].value == pytest.approx(1 / 0.3, abs=1e-5)
