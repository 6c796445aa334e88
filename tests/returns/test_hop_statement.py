"""The statement of a hop: hops of the map solve it, and lossless hops are regular solutions."""

import numpy as np
import pytest

from orbits import ReturnMap, find
from orbits.hops import Impacts
from orbits.returns.flown_hops import flown_hops
from orbits.returns.hop_statement import hop_equations
from problems import HeavyHand, Hopper, Juggler


@pytest.mark.parametrize("machine", [Hopper(), Hopper("cubic", mass_ratio=2.0), Juggler(damping=0.01), HeavyHand()])
def test_hops_of_the_map_solve_the_equations(machine):
    alpha, impacts = 4.7, Impacts(machine)
    hop = hop_equations(machine.model, int(ReturnMap(machine)(alpha).impacts), tuple(machine.values))
    us = flown_hops(impacts, np.array([alpha])).unknowns(impacts, np.zeros(1, int))
    residual = hop.equations.evaluate_lanes(us, impacts.p[None])[1].residual[0]
    assert np.abs(residual[hop.inner]).max() < 1e-12
    assert residual[hop.next] == pytest.approx(float(ReturnMap(machine)(alpha).next), abs=1e-12)


@pytest.mark.parametrize("distance", [0.0, 1e-2, 1e-5, 1e-8])
def test_a_lossless_hop_is_a_regular_solution(distance):
    """The least singular value beside it does not tend to 0, on the side of the bounce either."""
    machine = Hopper("r+0.3*r**3")
    impacts, orbit = Impacts(machine), find(machine)
    alpha = orbit.alpha + orbit.error - distance  # not below the lossless launch itself, by the error bound
    hops = flown_hops(impacts, np.array([alpha]))
    count = int(hops.counts[0])
    assert count == (2 if distance else 1)
    hop = hop_equations(machine.model, count, tuple(machine.values))
    us = hops.unknowns(impacts, np.zeros(1, int))
    found = hop.equations.evaluate_lanes(us, impacts.p[None], fewest=True)[1]
    rows = found.jacobian[0][[*hop.inner, *hop.next]]
    rows[-1, 1] -= 1.0
    injected = np.eye(1, len(rows), len(rows) - 1)
    assert np.abs(found.residual[0][hop.inner]).max() < 1e-12
    assert np.linalg.svd(np.column_stack([rows, injected[0]]))[1][-1] > 5e-3
