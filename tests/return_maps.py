"""Shared by the tests of return maps: maps in closed form, and the diagram of the paper's map."""

from functools import cache
from types import SimpleNamespace

import numpy as np

from orbits import bifurcations
from orbits.curves import Event
from orbits.returns import Hops
from orbits.returns.launch_branches import BranchTracer
from orbits.returns.launch_cycles import MapsAlong
from orbits.returns.limited_hops import PlainMap
from orbits.returns.periodic_launch import PeriodicLaunch
from orbits.returns.resolution import map_pieces
from problems import Hopper


class KnownMaps(MapsAlong):
    """Maps in closed form in place of a machine's: next(a, value), slope(a, value), impacts(a), where they jump."""

    along = None

    def __init__(self, low, high, following, slope, impacts=lambda a: np.ones(len(a), int), jump=None):
        self.name, self.low, self.high, self.inject = "value", low, high, 0.0
        self.following, self.slope, self.count, self.jump = following, slope, impacts, jump

    def hops(self, alpha, value):
        return SimpleNamespace(next=self.following(np.asarray(alpha), value), impacts=self.count(np.asarray(alpha)))

    def pieces_at(self, value, low, high):
        def hops(x, cap):
            following = self.following(x, value)
            status = np.where(np.isfinite(following), "lifts_off", "rests")
            return Hops(x, following, 0 * x, self.count(x), status)

        reach = max(high - low, 1e-4)
        return map_pieces(PlainMap(hops), max(low - reach, 1e-6), high + reach, 20)

    def multiplier(self, launches, value):
        return float(np.prod([self.slope(a, value) for a in launches]))

    def jumps_between(self, alphas, value, samples=33):
        return self.jump is not None and alphas[0] < self.jump < alphas[1]

    def status(self, alpha, value):
        return "lifts_off" if np.isfinite(self.following(np.array([alpha]), value)[0]) else "rests"


LOGISTIC = KnownMaps(2.5, 3.6, lambda a, r: r * a * (1 - a), lambda a, r: r * (1 - 2 * a))


def traced(maps, between, alpha, value, side=1, period=1):
    """The points, events and the end of a branch from a periodic launch; the side is that of growing parameters."""
    tracer = BranchTracer(maps, between, period, (), 0.02)
    start = tracer.start([[alpha]], value)
    items = list(tracer.trace(start, side * (1 if start.tangent[1] > 0 else -1)))
    points = [item for item in items if isinstance(item, PeriodicLaunch)]
    return points, [item for item in items if isinstance(item, Event)], items[-1]


@cache
def of_the_paper():
    return bifurcations(Hopper(), "inject", (0.0, 0.12), (4.4, 4.7), samples=100, sections=3, attractor=6)
