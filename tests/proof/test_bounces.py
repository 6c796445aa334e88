"""Losses of launches that land with a bounce, against simulated hops."""

import numpy as np
import pytest
from proofs import within

from orbits import ReturnMap, find_all, prove
from orbits.running import default_limit
from problems import Hopper

SLOW = pytest.mark.slow


@pytest.mark.parametrize("distance", [pytest.param(each, marks=SLOW) for each in ("1e-6", "1e-4")])
def test_simulated_hops_with_a_bounce(distance, monkeypatch):
    """Past the fold of a family the landing bounces above the orbit; ten times as much is lost, to leading order."""
    machine = Hopper("cubic", mass_ratio=20.0, parameters={"beta": -0.0105})
    orbit = find_all(machine, family=1)[1]
    within(monkeypatch, distance)
    with default_limit(120):  # of processor time
        proof = prove(orbit, attraction=True)
    reached, losses = float(proof.attraction_radius), proof.enclosures["attraction_loss"]
    assert reached == float(distance)
    assert "bounces once" in proof.statement
    hop = ReturnMap(machine)
    for d in reached * 0.999 / 8.0 ** np.arange(4):
        after = hop(orbit.alpha + d)
        assert after.impacts == 2
        assert float((orbit.alpha + d - after.next) / d ** (4 / 3)) in losses
    assert 10 * orbit.certificate.loss_coefficient in losses
    assert losses.width < (0.1 if distance == "1e-6" else 1.0) * float(losses.high)
