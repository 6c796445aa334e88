"""What happens to branches at borders of the map, against maps in closed form."""

import numpy as np
import pytest
from return_maps import LOGISTIC, KnownMaps, traced


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
    assert (event.kind, event.point.border) == ("border collision", "bounce")
    assert event.point.value == pytest.approx(1 / 0.3, abs=1e-12)
    assert event.point.sides == pytest.approx((2 - 1 / 0.3, 2 - 1 / 0.3), abs=1e-9)


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
    (event,) = (each for each in events if each.point.border)
    assert (event.kind, event.point.border) == (kind, "graze")
    assert (event.point.value, event.point.alpha) == pytest.approx((0.0, 1.0), abs=1e-12)
    assert event.point.sides == (pytest.approx(slope, abs=1e-6), -np.inf)
    assert points[-1].alpha > 1


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
