"""Terms of the equations of motion: gravity that varies, springs to the ground, and inertia that turns."""

import pytest
from mechanisms import VALUES, leg
from scipy.integrate import solve_ivp

from orbits import find, find_all
from orbits.mechanics import Spring


class TestAnotherMachine:
    def test_a_body_that_is_also_held_by_the_ground(self):
        """A second spring, from the body to the ground: no extension moves alone. The hop is a mirror image in time."""
        machine = leg(Spring("body - foot", "k*r"), Spring("body", "h*r"), parameters={**VALUES, "h": 0.2}, gravity=1.0)
        orbit = find(machine)
        assert orbit.method == "half orbit"
        assert find_all(machine, family=1)[0].alpha == pytest.approx(orbit.alpha, rel=1e-12)

        def rates(t, x):
            pull = 3 * (x[0] - x[2])
            return [x[1], (-pull - 0.2 * x[0]) / 2.0 - 1, x[3], pull / 0.5 - 1]

        start = [0.5 / 3, orbit.alpha, 0.0, 0.0]
        run = solve_ivp(rates, (0, orbit.flight_time), start, "DOP853", rtol=1e-13, atol=1e-13)
        assert run.y[:, -1] == pytest.approx([0.5 / 3, -orbit.alpha, 0.0, 0.0], abs=1e-10)
