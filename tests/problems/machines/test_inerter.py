"""The hopper with an inerter against closed forms, and against another integrator of its equations written by hand."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import ReturnMap, find, multiplier, simulate
from orbits.model import half_angle
from problems import inerter_hopper

M1, M2, G, K, C = 2.0, 0.5, 9.81, 300.0, 4e3
LINEAR = {"body_mass": M1, "foot_mass": M2, "surface_gravity": G, "in_si": True}
INERTANCES = [0.0, 1e-3, 0.4, 2.0, 50.0]


def linear(b):
    return inerter_hopper("k*r", inertance=b, parameters={"k": K}, **LINEAR)


def hardening(b):
    return inerter_hopper("k*r + c*r**3", inertance=b, parameters={"k": K, "c": C}, **LINEAR)


def force(r):
    return K * r + C * r**3


def flight(t, x, b):
    """The two equations of the flight, solved for the accelerations; the inerter's force appears in both."""
    pull = force(x[0] - x[2])
    body, foot = np.linalg.solve([[M1 + b, -b], [-b, M2 + b]], [-pull - M1 * G, pull - M2 * G])
    return [x[1], body, x[3], foot]


def contact(t, x, b):
    return [x[1], (-force(x[0]) - M1 * G) / (M1 + b)]


def ground_force(t, x, b):
    return M2 * G - force(x[0]) - b * contact(t, x, b)[1]


def travelled(rates, start, duration, b, **options):
    return solve_ivp(
        rates, (0.0, duration), start, "DOP853", args=(b,), rtol=1e-13, atol=1e-15, dense_output=True, **options
    )


def liftoff_of(b):
    """Where the ground force vanishes."""
    return brentq(lambda r: ground_force(0.0, [r, 0.0], b), 0.0, 10.0, xtol=1e-16, rtol=1e-15)


@pytest.mark.parametrize("family", [1, 2, 5])
@pytest.mark.parametrize("b", INERTANCES)
def test_linear_springs(b, family):
    """tan x = x in the frequency of reduced mass and inerter together; the contact swings about its own rest."""
    orbit = find(linear(b), family)
    swung = M1 * M2 / (M1 + M2) + b
    alpha = half_angle(family) * (1 + M2 / M1) * G * np.sqrt(swung / K)
    rho = (M2 + b * (1 + M2 / M1)) * G / K
    pace, above = np.sqrt(K / (M1 + b)), rho + M1 * G / K
    assert orbit.alpha == pytest.approx(alpha, rel=1e-13)
    assert orbit.liftoff_extension == pytest.approx(rho, rel=1e-13)
    assert orbit.flight_time == pytest.approx(2 * half_angle(family) * np.sqrt(swung / K), rel=1e-13)
    assert orbit.contact_time == pytest.approx(2 * (np.pi - np.arctan(alpha / pace / above)) / pace, rel=1e-13)
    depth = np.hypot(above, alpha / pace) + M1 * G / K  # the largest compression
    largest = M2 * G + K * depth + b * (M1 * G - K * depth) / (M1 + b)
    assert orbit.certificate.largest_contact_force == pytest.approx(largest, rel=1e-12)
    assert orbit.rises["centre of mass"] == pytest.approx((M1 * alpha / (M1 + M2)) ** 2 / (2 * G), rel=1e-12)
    assert orbit.admissible


@pytest.mark.parametrize("b", [0.4, 2.0])
def test_a_hop_with_an_impact(b):
    """The ground stops the foot; what the body keeps is the momentum of its own coordinate, (m1 + b) y1' - b y2'."""
    machine = hardening(b)
    alpha = 1.02 * find(machine).alpha
    closes = lambda t, x, b: x[2]  # noqa: E731
    closes.terminal, closes.direction = True, -1
    up = travelled(flight, [liftoff_of(b), alpha, 0.0, 0.0], 10.0, b, events=closes, first_step=1e-2)
    body, rate, _, fall = up.y[:, -1]
    opens = lambda t, x, b: ground_force(t, x, b)  # noqa: E731
    opens.terminal, opens.direction = True, -1
    down = travelled(contact, [body, rate - b * fall / (M1 + b)], 10.0, b, events=opens)
    run = simulate(machine, alpha, hops=1)
    landing, liftoff = run.events
    assert landing.time == pytest.approx(up.t[-1], abs=1e-10)
    assert landing.after[:2] == pytest.approx([body, rate - b * fall / (M1 + b)], abs=1e-10)
    assert landing.loss == pytest.approx((M2 + b * M1 / (M1 + b)) * fall**2 / 2, rel=1e-8)
    assert liftoff.time == pytest.approx(up.t[-1] + down.t[-1], abs=1e-10)
    assert run.launches[-1] == pytest.approx(down.y[1, -1], abs=1e-10)
    step, change = ReturnMap(machine), 1e-5 * alpha
    assert float(step(alpha).next) == pytest.approx(down.y[1, -1], abs=1e-10)
    slope = float(step(alpha + change).next - step(alpha - change).next) / (2 * change)
    assert multiplier(machine, alpha) == pytest.approx(slope, rel=1e-5)
