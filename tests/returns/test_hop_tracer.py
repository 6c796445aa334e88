"""Branches of hops that have a statement, across grazes of the foot."""

import numpy as np
import pytest
from conftest import slow_after

from orbits import ReturnMap
from orbits.curves import Event
from orbits.returns.hop_tracer import HopTracer
from orbits.returns.launch_cycles import MapsAlong
from orbits.returns.periodic_launch import PeriodicLaunch
from problems import Hopper


@pytest.mark.parametrize(("low", "high"), slow_after(1, [(6.93, 6.9315), (7.0761, 7.07615)]))
def test_a_curve_goes_through_a_graze(low, high):
    """Located as by bisection of the number of impacts; all points come back on both sides."""
    plain, between = ReturnMap(Hopper(mass_ratio=10.0)), (low - 0.01, high + 0.01)
    a, b = low, high
    for _ in range(50):
        middle = 0.5 * (a + b)
        a, b = (middle, b) if plain(middle).impacts == plain(low).impacts else (a, middle)
    start = low - 2e-3
    values = [float(x - plain(x).next) for x in (start, b)]
    maps = MapsAlong(Hopper(mass_ratio=10.0), "inject", min(values) - 0.1, max(values) + 0.1, 0.0, 1000)
    tracer = HopTracer(maps, between, 1, ())
    first = tracer.start(np.array([[start]]), values[0])
    items = list(tracer.trace(first, 1 if first.tangent[0] > 0 else -1))
    grazes = [item.point for item in items if isinstance(item, Event) and item.point.border == "graze"]
    assert min(abs(graze.alpha - a) for graze in grazes) < 1e-10
    points = [item for item in items if isinstance(item, PeriodicLaunch)]
    assert len({point.impacts for point in points}) > 1
    values, alphas = np.array([(point.value, point.alpha) for point in points]).T
    # The slope of the map has no bound beside a graze, so that its rounding grows there.
    assert values == pytest.approx(alphas - plain(alphas).next, abs=1e-7)
