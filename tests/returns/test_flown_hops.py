"""Hops impact by impact against the map and simulations, and the slopes of many against `multiplier` of each."""

import numpy as np
import pytest

from orbits import NoOrbit, ReturnMap, find, multiplier, simulate
from orbits.hops.impacts import Impacts
from orbits.returns.flown_hops import flown_hops, slopes_of_hops
from problems import Hopper, Juggler

SPEEDS = np.array([2.0, 2.6, 4.3, 4.55, 5.2, 6.9])


WITHOUT_SERIES = Hopper("r + 0.1*sign(r)*abs(r)**1.5")


@pytest.mark.parametrize(
    "machine", [Hopper(), Juggler("cubic", mass_ratio=3.0), Hopper(damping=0.01), WITHOUT_SERIES], ids=repr
)
def test_slopes_are_those_of_each_hop(machine):
    """Also where a hop has several impacts, and none where it has no next launch."""
    found = slopes_of_hops(Impacts(machine), SPEEDS)
    for alpha, slope in zip(SPEEDS.tolist(), found.tolist(), strict=True):
        try:
            assert slope == pytest.approx(multiplier(machine, alpha), rel=1e-10)
        except NoOrbit:
            assert np.isnan(slope)
    assert np.isfinite(found).any()


def test_impacts_and_times_are_those_of_a_simulation():
    machine = Hopper(mass_ratio=3.0)
    hops, known = flown_hops(Impacts(machine), SPEEDS), ReturnMap(machine)(SPEEDS)
    followed = known.status == "lifts_off"
    assert (hops.counts == np.where(followed, known.impacts, 0)).all()
    i = int(np.argmax(hops.counts))
    assert hops.counts[i] > 1
    run = simulate(machine, float(SPEEDS[i]), hops=1)
    times = [event.time for event in run.events if event.kind in ("impact", "landing")]
    assert np.cumsum(hops.times[i, : hops.counts[i]]) == pytest.approx(times, rel=1e-12)


def test_a_lossless_landing_has_no_slope():
    alpha = find(Hopper()).alpha
    assert np.isnan(slopes_of_hops(Impacts(Hopper()), np.array([alpha]))).all()
    assert len(slopes_of_hops(Impacts(Hopper()), np.zeros(0))) == 0
