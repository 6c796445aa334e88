"""Hops impact by impact against the map and simulations."""

import numpy as np
import pytest

from orbits import ReturnMap, simulate
from orbits.hops import Impacts
from orbits.returns.flown_hops import flown_hops
from problems import Hopper

SPEEDS = np.array([2.0, 2.6, 4.3, 4.55, 5.2, 6.9])


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
