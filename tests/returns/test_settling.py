"""What launches of maps in closed form settle to; see `test_periods` for those of machines."""

import numpy as np

from orbits.hops import STATUS
from orbits.returns import Hops
from orbits.returns.limited_hops import PlainMap
from orbits.returns.resolution import map_pieces
from orbits.returns.settling import CHAOTIC, HAS_PERIOD, SettlingMap, settled


def test_periods_of_the_logistic_map():
    """1 + 3 (x - 1)(2 - x) and an injection that moves it: to periods one and two, chaos, and beyond its range."""

    def hops(x, cap=0):
        following = 0.5 + 3.9 * (x - 1) * (2 - x)
        one = np.ones(x.shape, int)
        return Hops(x, following, (x - following) * (x + following), one, np.full(x.shape, "lifts_off", STATUS))

    step = SettlingMap(hops, map_pieces(PlainMap(hops), 1.0, 2.0, 41))
    inject = np.array([0.5, 0.2, 0.32])
    status, periods, last, exponents = settled(step, np.full(3, 1.3), inject, 8, 2048, 10.0)
    assert status.tolist() == [CHAOTIC, HAS_PERIOD, HAS_PERIOD]
    assert exponents[0] > 0.4
    # A fixed point of 0.5 + 3.9 (x - 1)(2 - x) + eps is a root of 3.9 x^2 - 10.7 x + 7.3 - eps.
    root = (10.7 + np.sqrt(10.7**2 - 4 * 3.9 * (7.3 - 0.2))) / 7.8
    assert periods[1] == 1
    assert abs(last[1] - root) < 1e-6
    assert periods[2] in (1, 2, 4)
