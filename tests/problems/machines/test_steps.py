"""The wheel, the rocker and the shuttle: reference values, SI against the ratios, and what is no such machine."""

import math

import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from steps import SINES, TABLE, closed_form

from orbits import InputError, NoOrbit, Orbit, ReturnMap, find, follow, multiplier, sensitivities, simulate
from problems import rimless_wheel, rocking_block, shuttle

KINDS = {"wheel": rimless_wheel, "rocker": rocking_block, "shuttle": shuttle}


@pytest.mark.parametrize(("kind", "values"), [(kind, values) for kind in TABLE for values in TABLE[kind]])
def test_small_angles_have_their_closed_form(kind, values):
    mu, kappa, family = values
    orbit = find(KINDS[kind](inertia_ratio=mu, gravity_ratio=kappa), family)
    half, speed, contact = TABLE[kind][values]
    assert (orbit.flight_time / 2, orbit.alpha) == pytest.approx((half, speed), rel=0, abs=1e-12)
    assert orbit.contact_time == pytest.approx(contact, rel=0, abs=1e-12)
    assert orbit.liftoff_extension == kappa
    assert orbit.admissible


@pytest.mark.parametrize(("kind", "law", "family"), slow_after(2, SINES))
def test_other_angles_have_the_values_of_other_integrators(kind, law, family):
    orbit = find(KINDS[kind](inertia_ratio=1.0, gravity_ratio=0.5, angle=0.3, spring=law), family)
    speed, half, contact = SINES[kind, law, family]
    assert (orbit.alpha, orbit.contact_time) == pytest.approx((speed, contact), rel=0, abs=1e-12)
    assert half is None or orbit.flight_time / 2 == pytest.approx(half, rel=0, abs=1e-12)
    assert orbit.admissible


@pytest.mark.parametrize("kind", slow_after(1, KINDS))
def test_random_machines_have_their_closed_form(kind):
    """mu from 0.05 to 20 and kappa from 0.05 to 5."""
    rng = np.random.default_rng(7)
    for _ in range(5):
        mu, kappa = np.exp(rng.uniform(np.log([0.05, 0.05]), np.log([20.0, 5.0]))).tolist()
        for family in (1, 2, 3):
            orbit = find(KINDS[kind](inertia_ratio=mu, gravity_ratio=kappa), family)
            half, speed, contact = closed_form(kind, mu, kappa, family)
            assert (orbit.flight_time / 2, orbit.alpha, orbit.contact_time) == pytest.approx(
                (half, speed, contact), rel=1e-12
            )
            assert orbit.admissible


def test_without_gravity_a_shuttle_is_a_free_pair_of_bodies():
    """It swings n half times between the walls: q S = n pi with q^2 = 1 + mu, and v S = (1 + mu)/mu."""
    for family in (1, 2):
        orbit = find(shuttle(inertia_ratio=0.6, gravity_ratio=0.0), family)
        half = family * math.pi / math.sqrt(1.6)
        assert (orbit.flight_time / 2, orbit.alpha) == pytest.approx((half, 1.6 / (0.6 * half)), rel=1e-12)
        assert orbit.contact_time == pytest.approx(math.pi, rel=1e-12)


class TestSI:
    MASS, LENGTH, INERTIA, BODY, STIFFNESS, GRAVITY = 2.0, 0.4, 0.5, 0.6, 20.0, 1.62
    TIME = math.sqrt(BODY / STIFFNESS)

    def same(self, machine, ratios):
        """Whether both have one motion."""
        si, other = find(machine), find(ratios)
        assert si.alpha * self.TIME == pytest.approx(other.alpha, rel=1e-12)
        assert si.flight_time == pytest.approx(other.flight_time * self.TIME, rel=1e-12)
        assert si.contact_time == pytest.approx(other.contact_time * self.TIME, rel=1e-12)
        assert si.units["alpha"] == "rad/s"
        assert si.units["largest_contact_force"] == "N m"
        assert si.units["landing_jerk"] == "rad/s^3"
        return si

    @property
    def numbers(self):
        return {
            "inertia": self.INERTIA, "body_inertia": self.BODY, "stiffness": self.STIFFNESS,
            "surface_gravity": self.GRAVITY,
        }  # fmt: skip

    def ratios(self, height, angle):
        kappa = self.MASS * self.GRAVITY * height / self.STIFFNESS
        return {"inertia_ratio": self.BODY / self.INERTIA, "gravity_ratio": kappa, "angle": angle}

    def test_a_shuttle(self):
        self.same(
            shuttle(**self.numbers, angle=0.4, mass=self.MASS, length=self.LENGTH),
            shuttle(**self.ratios(self.LENGTH, 0.4)),
        )

    def test_on_a_slope_no_step_is_lossless(self):
        tilted = rimless_wheel(self.MASS, self.LENGTH, 8, **self.numbers, slope=0.05)
        for options in ({}, {"start": {"liftoff": 0.1, "alpha": 1.0, "duration": 0.3}}):
            with pytest.raises(NoOrbit, match=r"gravity gains .*sin\(angle\)\*sin\(slope\) with each step on a slope"):
                find(tilted, **options)
        assert tilted.model.symmetry == (1, 1, 1, 1)


@pytest.mark.parametrize(
    ("build", "arguments", "telling"),
    [
        (rimless_wheel, {"inertia_ratio": -1.0}, "inertia_ratio = -1; it must lie above 0"),
        (rocking_block, {"gravity_ratio": 0.0}, "gravity_ratio = 0; it must lie above 0"),
        (shuttle, {"gravity_ratio": -0.1}, "gravity_ratio = -0.1; it must lie above 0"),
        (rimless_wheel, {"angle": 1.6}, "angle = 1.6; it must lie above 0 and below 1.5708"),
        (rimless_wheel, {"angle": 1.1}, "angle = 1.1; for a rimless wheel it must lie between 1e-09 and 1.0472"),
        (rocking_block, {"inertia_ratio": 1e-300}, "for a rocking block it must lie between 1e-12 and 1e"),
        (shuttle, {"inertia_ratio": 1e300}, r"inertia_ratio = 1e\+300; for a shuttle it must lie between 1e-12 and 1e"),
        (shuttle, {"inertia_ratio": 1.0, "surface_gravity": 1.6}, "belongs to a shuttle in SI, with its inertia"),
        (rimless_wheel, {"mass": 1.0}, "is in SI: state length, inertia, body_inertia, stiffness, spokes too"),
        (rimless_wheel, {"spokes": 2}, "it must be a whole number, at least 3"),
        (rimless_wheel, {"spokes": 6.5}, "it must be a whole number, at least 3"),
        (rimless_wheel, {"slope": 0.1}, "only a wheel in SI has a slope"),
        (shuttle, {"mass": 3.0}, "mass and length are for a shuttle in SI"),
        (
            shuttle,
            {"inertia": 1.0, "body_inertia": 1.0, "stiffness": 1.0, "angle": 2.0},
            "angle = 2; it must lie above 0",
        ),
        (rimless_wheel, {"spring": "r + b*r**3"}, "uses 'b' without a value"),
        (rimless_wheel, {"parameters": {"angle": 0.3}, "angle": 0.2}, "'angle' is an argument of its own"),
    ],
)
def test_what_is_no_such_machine(build, arguments, telling):
    with pytest.raises(InputError, match=telling):
        build(**arguments)


def test_a_family_ends_where_its_machines_do():
    family = follow(rimless_wheel(angle=1.0), "angle", stop=1.3)
    assert max(point.value for point in family.points) == pytest.approx(math.pi / 3, abs=1e-4)
    assert "for a rimless wheel it must lie" in str(family)


def test_a_launch_that_turns_a_block_over_has_no_next_one():
    """It falls when SciPy says. The spring would bring the second launch back through the ground, to the next one."""
    mass, b, h, inertia, body, k, cubic = 1.0, 0.3, 0.5, 0.5, 0.3, 9.0, 45.0
    spring = {"spring": "stiffness*r + c*r**3", "parameters": {"c": cubic}}
    block, alpha = rocking_block(mass, b, h, inertia, body, k, **spring), 4.0
    held = mass * 9.80665 * b

    def rates(t, state):
        phi, theta, phi_rate, theta_rate = state
        torque = k * (phi - theta) + cubic * (phi - theta) ** 3
        tipping = mass * 9.80665 * (h * math.sin(theta) - b * math.cos(theta))
        return [phi_rate, theta_rate, -torque / body, (tipping + torque) / inertia]

    r = float(brentq(lambda r: k * r + cubic * r**3 - held, 0.0, 1.0, xtol=1e-15))
    on_side, stands = lambda t, x: math.cos(x[1]), lambda t, x: x[1]
    on_side.terminal, stands.direction = 1, -1
    events = [on_side, stands]
    fallen = solve_ivp(rates, (0, 9), [r, 0, alpha, 0], events=events, rtol=1e-11, atol=1e-13, method="DOP853")
    assert not len(fallen.t_events[1])
    run, hops = simulate(block, alpha, hops=1), ReturnMap(block)([2.0, 3.10522351446571, alpha])
    assert run.falls == ("upper corner", pytest.approx(fallen.t[-1], rel=1e-9))
    assert run.smallest_separation == pytest.approx(0.0, abs=1e-12)
    assert [*hops.status, run.status] == ["rests", "falls", "falls", "falls"]
    assert np.isnan(hops.next[1:]).all()
    with pytest.raises(NoOrbit, match="block lies on its side"):
        multiplier(block, alpha)


def test_a_wheel_moves_on_by_the_distance_of_two_spokes():
    orbit = find(rimless_wheel(2.0, 0.4, 8, 0.4, 0.4, 20.0))
    assert orbit.step == pytest.approx(2 * 0.4 * np.sin(np.pi / 8), rel=1e-14)
    assert orbit.mean_speed == pytest.approx(orbit.step / orbit.period, rel=1e-14)
    assert orbit.speed == pytest.approx(orbit.step / orbit.flight_time, rel=1e-13)  # with two spokes down it stands
    assert find(rimless_wheel(angle=0.3)).step == pytest.approx(2 * np.sin(0.3), rel=1e-14)
    assert find(rocking_block()).step is None


@pytest.mark.slow
def test_the_speed_of_a_wheel_is_prescribed_and_designed():
    """The mean speed is that of two spokes' distance, 2 l sin(pi/8), and slopes are those of other wheels."""
    wheels = [rimless_wheel(2.0, 0.4, 8, 0.4, 0.4, k) for k in (19.999, 20.0, 20.001)]
    slow, walk, fast = map(find, wheels)
    slopes = sensitivities(wheels[1], walk, names=["stiffness", "length"])
    for name in ("speed", "mean_speed"):
        change = (getattr(fast, name) - getattr(slow, name)) / 0.002
        assert slopes[name]["stiffness"] == pytest.approx(change, rel=1e-7)
    assert slopes["step"]["length"] == pytest.approx(2 * np.sin(np.pi / 8), rel=1e-12)
    tuned = find(wheels[1], tune="stiffness", at={"mean_speed": 0.46})
    assert tuned.period == pytest.approx(0.8 * np.sin(np.pi / 8) / 0.46, rel=1e-12)
    tuned = find(wheels[1], tune="stiffness", at={"speed": 0.53})
    assert find(tuned.source).speed == pytest.approx(0.53, rel=1e-12)


def test_a_standing_foot_that_is_not_judged_is_in_the_table():
    numbers = {"inertia_ratio": 0.2, "gravity_ratio": 0.1, "angle": 0.3}
    open_, stated = find(rimless_wheel(**numbers)), find(rimless_wheel(**numbers, share=1.0))
    assert (open_.admissible, stated.admissible) == (True, False)
    assert open_.certificate.friction_needed is None
    telling = "standing foot           not judged (smallest force -0.123); state share="
    assert [each.certificate.stance_judged for each in (open_, stated)] == [False, True]
    assert telling in str(open_)
    assert telling in str(Orbit.of_saved(open_.saved()))
    assert "not judged" not in str(stated)


def test_lengths_inertias_and_angles_have_units():
    wheel = find(rimless_wheel(mass=2.0, length=0.4, spokes=8, inertia=0.5, body_inertia=0.3, stiffness=9.0))
    row = dict(wheel.rows())["machine"]
    numbers = "length = 0.4 m, inertia = 0.5 kg m^2, body_inertia = 0.3 kg m^2, angle = 0.392699 rad"
    assert row.endswith(f"stiffness = 9 N m/rad, mass = 2 kg, {numbers}, surface_gravity = 9.80665 m/s^2")
    assert str(wheel).startswith("lossless orbit of family 1: rimless wheel, spring stiffness*r\n")
    block = rocking_block(mass=5.0, half_width=0.1, half_height=0.3, inertia=1.0, body_inertia=0.5, stiffness=20.0)
    assert block.rest_length is None  # its separation is no length of the spring
    assert block.units_of_parameters()["half_height"] == "m"
