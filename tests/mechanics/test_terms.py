"""Terms of the equations of motion: gravity that varies, springs to the ground, and inertia that turns."""

import numpy as np
import pytest
from mechanisms import VALUES, leg, same
from scipy.integrate import solve_ivp

from orbits import Mechanism, ReturnMap, find, find_all
from orbits.mechanics import Inerter, Mass, Potential, Spring
from problems import hopper_in_si


def test_with_gravity_that_varies():
    gravity = "1/(1 + z/R)**2"
    elements = [Mass("L + body", "m1"), Mass("foot", "m2"), Spring("body - foot", "r")]
    values = {"m1": 2.0, "m2": 0.5, "R": 60.0, "L": 9.0}
    far = Mechanism(("body", "foot"), elements, "foot", values, gravity=gravity)
    stated = hopper_in_si(
        2.0, 0.5, stiffness=1.0, rest_length=9.0, surface_gravity=1.0, gravity=gravity, parameters={"R": 60.0}
    )
    assert find(far).alpha == pytest.approx(find(stated).alpha, rel=1e-12)


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

    def test_a_body_that_is_held_up(self):
        """A fifth of the foot's weight lifts the body: where body and foot weigh the same, the centre of mass falls at
        nine tenths of gravity, and the hop has nine tenths of the size."""
        values = {"m1": 1.0, "m2": 1.0}
        plain = leg(Spring("body - foot", "r"), parameters=values)
        held = leg(Spring("body - foot", "r"), Potential("-0.2*m2*body"), parameters=values)
        assert find(held).alpha == pytest.approx(0.9 * find(plain).alpha, rel=1e-12)

    @pytest.mark.slow
    def test_a_knee_with_a_moment_of_inertia(self):
        """What turns with the knee is slowed by the ground's force: lift-off depends on the launch speed."""
        height = "foot + 2*l*sin(knee/2)"
        values = {"m1": 3.0, "m2": 0.4, "j": 0.02, "l": 0.5, "k": 30.0, "rest": 2.2}
        elements = [Mass(height, "m1"), Mass("foot", "m2"), Inerter("knee", "j"), Spring("knee - rest", "k*r")]
        machine = Mechanism(
            ("foot", "knee"), elements, "foot", values, gravity=9.81, rest={"knee": "rest"}, angles=("knee",),
            heights={"body": height, "foot": "foot"},
        )  # fmt: skip
        m1, m2, j, link, k, rest = values.values()

        def rates(t, x):
            """Lagrange's equations with T = m1 (h' + s t')^2/2 + m2 h'^2/2 + j t'^2/2, s = l cos(t/2)."""
            s, bend = link * np.cos(x[2] / 2), -link / 2 * np.sin(x[2] / 2)
            matrix = np.array([[m1 + m2, m1 * s], [m1 * s, m1 * s**2 + j]])
            pull = m1 * (bend * x[3] ** 2 + 9.81)
            up, turn = np.linalg.solve(matrix, [-pull - m2 * 9.81, -pull * s - k * (x[2] - rest)])
            return [x[1], up, x[3], turn]

        orbit = find(machine)
        start = [0.0, 0.0, rest + orbit.liftoff_extension, orbit.alpha]
        assert rates(0, start)[1] == pytest.approx(0.0, abs=1e-9)  # the foot is about to leave
        run = solve_ivp(rates, (0, orbit.flight_time), start, "DOP853", rtol=1e-13, atol=1e-13)
        assert run.y[:, -1] == pytest.approx([0.0, 0.0, start[2], -orbit.alpha], abs=1e-9)
        slow, fast = machine.model.release(np.array([0.1, 4.0]), machine.values)
        assert abs(fast - slow) > 1e-4
        assert find_all(machine, family=1)[0].alpha == pytest.approx(orbit.alpha, rel=1e-11)
        # What is lost beside the orbit is C d**(4/3), up to a share of d**(1/3) more.
        lost = []
        for distance in (1e-4 * orbit.alpha, 1e-5 * orbit.alpha):
            (back,) = ReturnMap(machine)([orbit.alpha + distance]).next
            lost.append((orbit.alpha + distance - back) / distance ** (4 / 3))
        limit = (lost[1] * 10 ** (1 / 3) - lost[0]) / (10 ** (1 / 3) - 1)
        assert orbit.certificate.loss_coefficient == pytest.approx(limit, rel=3e-3)


@pytest.mark.slow
def test_gravity_that_is_not_1_at_the_ground():
    """A law may have the acceleration at the ground in it, or be a share of one that is stated beside it."""
    elements = [Mass("body + 9", "2"), Mass("foot", "0.5"), Spring("body - foot", "3*r + r**3")]
    whole, share = (
        Mechanism(("body", "foot"), elements, "foot", counts="body - foot", **gravity)
        for gravity in (
            {"gravity": "1.5/(1 + z/60)**2"},
            {"gravity": "1/(1 + z/60)**2", "surface_gravity": 1.5},
        )
    )
    same(find(whole), find(share))
