"""Motions beside the vertical hop, against the equations of half a run."""

import numpy as np
import pytest

from orbits import find
from orbits.model import STEP_LENGTH
from orbits.periodic import Lateral, unknowns_of_hop
from orbits.shooting import half_orbit, shooting_equations, vector
from problems import runner


@pytest.mark.slow
def test_lateral_conditions_are_the_derivatives_of_half_a_run():
    machine = runner(foot_mass=0.2, rest_length=5.0, inertia=3.0, hip_stiffness=4.0)
    lateral, hop = Lateral(machine, (), 1), unknowns_of_hop(find(machine.upright()))
    whole = shooting_equations(half_orbit(machine.model), tuple(machine.values))
    names = whole.statement.unknowns
    there = whole.evaluate([hop.get(name, 0.0) for name in names], vector(machine.values), (STEP_LENGTH,))
    across = there.jacobian[:, [names.index(name) for name in lateral.beside.unknowns]]
    us, ps = np.array([[hop[name] for name in lateral.unknowns]]), vector(machine.values)[None]
    launches = lateral.launches(us, ps)[0]
    mine = lateral.conditions(us, ps, launches[None])[0]
    rows = across @ launches
    # The forces, which vanish, and the place of the foot, half the step, are further rows of half a run.
    of_step = np.abs(there.jacobian[:, -1]) > 0
    others = rows[(np.abs(rows).max(1) > 1e-12) & ~of_step]
    np.testing.assert_allclose(others, mine, rtol=1e-11, atol=1e-12)
