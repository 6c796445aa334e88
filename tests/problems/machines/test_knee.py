"""A machine whose inertia depends on its configuration: `problems.knee_hopper`, against equations written by hand.

Coordinates are the foot's height h and the knee's angle theta. Two links of length l join the foot to the hip, which
stays above it, at the height h + L with L(theta) = 2 l sin(theta / 2); a torsional spring of torque tau(theta) bends
the knee. With the kinetic energy (m1 (h' + L' theta')^2 + m2 h'^2) / 2 of body and foot, Lagrange's equations are

    (m1 + m2) h'' + m1 L' theta'' = -m1 L'' theta'^2 - (m1 + m2) g + lambda
    m1 L' h'' + m1 L'^2 theta''   = -m1 L' L'' theta'^2 - tau - m1 g L'

with the ground force lambda, 0 in flight and m2 g - tau / L' in contact, where h = 0. The determinant of the inertia
matrix is m1 m2 L'^2, and its inverse times the gradient (1, 0) of the gap h is (1, -1 / L') / m2: an impact changes
(h', theta') along (1, -1 / L'), which leaves the body's speed as it is, and its mass is m2.

The machine is stated in SI, and its launch speed is theta' at lift-off, in rad/s. SciPy solves Lagrange's equations.
"""

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import InputError, NoOrbit, ReturnMap, find, find_all, simulate
from problems import hopper_in_si, knee_hopper


def tension(theta, p):
    """The force with which the knee pulls body and foot together."""
    return p["stiffness"] * (theta - p["rest_angle"]) / (p["link"] * np.cos(theta / 2))


def release(p):
    """The knee's angle where the tension is the foot's weight."""
    weight = p["foot_mass"] * p["surface_gravity"]
    return brentq(lambda a: tension(a, p) - weight, p["rest_angle"], 3.1, xtol=1e-300, rtol=1e-15)


MACHINE = knee_hopper(body_mass=6.0, foot_mass=1.0, link=0.25, stiffness=20.0, rest_angle=1.8)
OTHER = knee_hopper(body_mass=4.0, foot_mass=2.0, link=0.4, stiffness=70.0, rest_angle=2.0)
LINK = MACHINE.values["link"]


def lagrange_in_flight(t, x, p):
    """Lagrange's equations of the flight, solved for the accelerations."""
    m1, m2, g = p["body_mass"], p["foot_mass"], p["surface_gravity"]
    _, dh, theta, rate = x
    along, bend = p["link"] * np.cos(theta / 2), -p["link"] / 2 * np.sin(theta / 2)
    moment = p["stiffness"] * (theta - p["rest_angle"])
    inertia = np.array([[m1 + m2, m1 * along], [m1 * along, m1 * along**2]])
    forces = [-m1 * bend * rate**2 - (m1 + m2) * g, -m1 * along * bend * rate**2 - moment - m1 * g * along]
    foot, knee = np.linalg.solve(inertia, forces)
    return [dh, foot, rate, knee]


def lagrange_in_contact(t, x, p):
    """The second of Lagrange's equations with the foot at rest on the ground."""
    m1, g = p["body_mass"], p["surface_gravity"]
    theta, rate = x
    along, bend = p["link"] * np.cos(theta / 2), -p["link"] / 2 * np.sin(theta / 2)
    moment = p["stiffness"] * (theta - p["rest_angle"])
    return [rate, (-m1 * along * bend * rate**2 - moment - m1 * g * along) / (m1 * along**2)]


def energy(x, p):
    """Relative to rest on the ground with the knee at its rest angle."""
    m1, m2, g = p["body_mass"], p["foot_mass"], p["surface_gravity"]
    h, dh, theta, rate = np.moveaxis(x, -1, 0)
    leg, along = 2 * p["link"] * np.sin(theta / 2), p["link"] * np.cos(theta / 2)
    rest = 2 * p["link"] * np.sin(p["rest_angle"] / 2)
    kinetic = 0.5 * m1 * (dh + along * rate) ** 2 + 0.5 * m2 * dh**2
    return kinetic + 0.5 * p["stiffness"] * (theta - p["rest_angle"]) ** 2 + m1 * g * (h + leg - rest) + m2 * g * h


def travelled(rates, start, duration, p, **options):
    """The motion by SciPy."""
    return solve_ivp(
        rates, (0.0, duration), start, "DOP853", args=(p,), rtol=1e-13, atol=1e-15, dense_output=True, **options
    )


@pytest.fixture(scope="module")
def orbit():
    return find(MACHINE)


@pytest.mark.slow
def test_the_orbit_solves_lagranges_equations(orbit):
    p, t = MACHINE.values, np.linspace(0.0, 1.0, 41)
    flight = travelled(lagrange_in_flight, [0.0, 0.0, orbit.liftoff_extension, orbit.alpha], orbit.flight_time, p)
    assert np.abs(orbit(orbit.flight_time * t) - flight.sol(orbit.flight_time * t).T).max() < 1e-10
    contact = travelled(lagrange_in_contact, [orbit.liftoff_extension, -orbit.alpha], orbit.contact_time, p)
    standing = orbit(orbit.flight_time + orbit.contact_time * t[1:-1])
    assert np.abs(standing[:, 2:] - contact.sol(orbit.contact_time * t[1:-1]).T).max() < 1e-10
    assert not standing[:, :2].any()
    assert contact.y[:, -1] == pytest.approx([orbit.liftoff_extension, orbit.alpha], abs=1e-10)
    leg = 2 * p["link"] * np.sin(contact.sol(orbit.contact_time * t)[0] / 2)
    assert orbit.certificate.smallest_separation == pytest.approx(leg.min(), abs=1e-3)
    assert orbit.certificate.smallest_separation <= leg.min() + 1e-12


def test_a_hop_with_an_impact_solves_lagranges_equations():
    """The foot is stopped and the body keeps its speed, so that the knee bends faster; then it stands to lift-off."""
    p, alpha = MACHINE.values, 11.3
    run = simulate(MACHINE, alpha, hops=1)
    landing, liftoff = run.events
    closes = lambda t, x, p: x[0]  # noqa: E731
    closes.terminal, closes.direction = True, -1
    liftoff_angle = release(p)
    flight = travelled(lagrange_in_flight, [0.0, 0.0, liftoff_angle, alpha], 1.0, p, events=closes, first_step=1e-2)
    assert landing.time == pytest.approx(flight.t[-1], abs=1e-10)
    assert landing.before == pytest.approx(flight.y[:, -1], abs=1e-10)
    _, fall, theta, rate = flight.y[:, -1]
    along = p["link"] * np.cos(theta / 2)
    after = np.array([0.0, 0.0, theta, (fall + along * rate) / along])
    assert landing.after == pytest.approx(after, abs=1e-10)
    assert landing.loss == pytest.approx(0.5 * p["foot_mass"] * fall**2, rel=1e-10)
    assert energy(landing.before, p) - energy(landing.after, p) == pytest.approx(landing.loss, rel=1e-10)
    assert landing.energy == pytest.approx(energy(landing.before, p), rel=1e-12)
    opens = lambda t, x, p: p["foot_mass"] * p["surface_gravity"] - tension(x[0], p)  # noqa: E731
    opens.terminal, opens.direction = True, -1
    contact = travelled(lagrange_in_contact, after[2:], 2.0, p, events=opens)
    assert liftoff.time == pytest.approx(flight.t[-1] + contact.t[-1], abs=1e-10)
    assert run.launches[-1] == pytest.approx(contact.y[1, -1], abs=1e-10)
    assert float(ReturnMap(MACHINE)(alpha).next) == pytest.approx(contact.y[1, -1], abs=1e-10)


def hopper_with_the_same_leg(machine):
    """The plain hopper whose spring is phi(r) = tau(theta) dtheta/dr, with the leg's length L + r."""
    angle, slope = "2*asin((leg + r)/(2*link))", "sqrt(link**2 - (leg + r)**2/4)"
    p = machine.values
    leg = 2 * p["link"] * np.sin(p["rest_angle"] / 2)
    return hopper_in_si(
        body_mass=p["body_mass"],
        foot_mass=p["foot_mass"],
        surface_gravity=p["surface_gravity"],
        rest_length=leg,
        force=f"torque*({angle} - rest_angle)/{slope}",
        parameters={
            "torque": p["stiffness"],
            "rest_angle": p["rest_angle"],
            "leg": leg,
            "link": p["link"],
        },
    )


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "family"), [(MACHINE, 1), (MACHINE, 2), (OTHER, 1)])
def test_it_is_a_hopper_with_a_nonlinear_spring(machine, family):
    knee, plain = find(machine, family), find(hopper_with_the_same_leg(machine), family)
    along = machine.values["link"] * np.cos(knee.liftoff_extension / 2)
    assert knee.alpha * along == pytest.approx(plain.alpha, rel=1e-12)
    assert knee.flight_time == pytest.approx(plain.flight_time, rel=1e-12)
    assert knee.contact_time == pytest.approx(plain.contact_time, rel=1e-12)
    for name in ("body", "foot"):
        assert knee.rises[name] == pytest.approx(plain.rises[name], rel=1e-11)
    c, other = knee.certificate, plain.certificate
    assert c.loss_coefficient * along ** (-1 / 3) == pytest.approx(other.loss_coefficient, rel=1e-6)
    assert c.landing_jerk == pytest.approx(other.landing_jerk, rel=1e-11)
    assert c.smallest_separation == pytest.approx(other.smallest_separation, abs=1e-11)
    assert c.largest_contact_force == pytest.approx(other.largest_contact_force, rel=1e-11)
    assert len(knee.violations) == len(plain.violations)


@pytest.mark.parametrize(("rest_angle", "family"), [(1.2, 2), (2.0, 1)])
def test_stiff_knees_are_linear_springs(rest_angle, family):
    """Their launch speed in rad/s, x (1 + M) g (mu/kappa)^(1/2) with tan x = x, depends neither on the links nor on
    the angle; it is approached with the square of the compliance."""
    x = float(mp.findroot(lambda x: mp.sin(x) - x * mp.cos(x), (family + 0.5) * np.pi - 0.1))
    off = []
    for stiffness in (4e3, 16e3, 64e3):
        leg = knee_hopper(stiffness=stiffness, rest_angle=rest_angle)
        m1, m2, g = (leg.values[name] for name in ("body_mass", "foot_mass", "surface_gravity"))
        off.append(find(leg, family).alpha / (x * (1 + m2 / m1) * g * np.sqrt(m1 * m2 / (m1 + m2) / stiffness)) - 1)
    assert np.divide(off[:-1], off[1:]) == pytest.approx([16, 16], rel=0.02)
    assert abs(off[-1]) < 2e-7


def test_an_angle_of_rest_that_is_none():
    with pytest.raises(InputError, match=r"rest_angle = 3\.2 rad: a knee rests between folded \(0\) and straight"):
        knee_hopper(rest_angle=3.2)


@pytest.mark.parametrize("stiffness", [1.0, 10.0])
def test_a_knee_that_does_not_carry_the_body_says_so(stiffness):
    """60 kg at 9.80665 m/s^2 on links of 0.45 m that rest at 2.6 rad need 102 N m/rad at least."""
    with pytest.raises(
        NoOrbit, match=r"finds none.*a knee carries its body where its torque, folded, is above body_mass"
    ):
        find(knee_hopper(stiffness=stiffness))


def test_results_have_their_units(orbit):
    units = orbit.document()["units"]
    assert (units["link"], units["stiffness"], units["surface_gravity"]) == ("m", "N m/rad", "m/s^2")
    assert MACHINE.rest_length == pytest.approx(2 * LINK * np.sin(0.9), rel=1e-15)
    assert "rest_length = 0.391663 m, body_mass = 6 kg" in dict(orbit.rows())["machine"]
    assert {units[name] for name in ("alpha", "error")} == {"rad/s"}
    assert units["liftoff_extension"] == "rad"
    assert units["loss_coefficient"] == "s^(1/3)/rad^(1/3)"
    assert units["landing_jerk"] == "m/s^3"
    assert units["state_mid_flight"] == "m, rad"
    assert orbit.si()["alpha_rad_per_s"] == orbit.alpha
    assert orbit.si()["liftoff_extension_rad"] == orbit.liftoff_extension
    assert "rad/s" in str(orbit)
    run = simulate(MACHINE, 11.3, hops=1)
    assert run.document()["units"]["launches"] == "rad/s"
    assert " rad/s\n" in str(run)
    with pytest.raises(InputError, match=r"knee = 1\.8 rad, knee' = 0 rad/s"):
        simulate(MACHINE, state=[-1.0, 0.0, 1.8, 0.0], time=1.0)
    with pytest.raises(InputError, match=r"most 1e\+15 rad/s"):
        simulate(MACHINE, 1e16, hops=1)


def test_all_orbits_and_those_that_are_not(orbit):
    (only,) = find_all(MACHINE)
    assert only.alpha == orbit.alpha
    with pytest.raises(NoOrbit, match="to 5 rad/s finds none"):
        find_all(MACHINE, fastest=5.0)
    near = find(MACHINE, start=orbit)
    assert near.alpha == pytest.approx(orbit.alpha, rel=1e-13)
