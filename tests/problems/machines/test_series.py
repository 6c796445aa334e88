"""Hoppers with two springs in series and an unsprung mass between: chains with a law for each spring."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import find
from problems import Chain, Hopper

X0 = find(Hopper()).alpha  # tan x0 = x0
TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12}


def start_of(rise, pull, times) -> dict[str, float]:
    """A start from the body's place and speed at lift-off, those of the mass between, and the half times."""
    return dict(
        zip(("y1", "y1'", "liftoff", "alpha", "duration", "contact_duration"), (*rise, *pull, *times), strict=True)
    )


@pytest.mark.parametrize("stiffnesses", [(2.0, 2.0), (1.5, 3.0)])
def test_two_linear_springs_are_one(stiffnesses):
    """With a small mass e between body m1 and foot m2 it is the hopper on the sum of their compliances. To first order
    e moves with them by shares s1 and s2: then body and foot have the masses m1 + s1 e and m2 + s2 e, and there is a
    negative inertance -s1 s2 e between them, so that half the flight takes x0 sqrt((mu - s1 s2 e)/k) with their reduced
    mass mu. What is left is the vibration of the small mass, of order e^(3/2)."""
    (upper, lower), m1, m2 = stiffnesses, 1.0, 0.8
    k, s1, s2 = upper * lower / (upper + lower), upper / (upper + lower), lower / (upper + lower)
    clock = np.sqrt(m1 * m2 / (m1 + m2) / k)
    half_contact = find(Hopper(mass_ratio=m2 / m1)).contact_time / 2 * clock
    for e in (0.03, 0.01, 0.003, 0.0003):
        chain = Chain((m1, e, m2), ["a*r", "b*r"], parameters={"a": upper, "b": lower})
        rise, speed = m2 / k, X0 * clock * (m1 + m2) / m1
        start = start_of((rise, speed), (m2 / lower, speed * s1), (X0 * clock, half_contact))
        orbit, (body, foot) = find(chain, start=start), (m1 + s1 * e, m2 + s2 * e)
        half_flight = X0 * np.sqrt((body * foot / (body + foot) - s1 * s2 * e) / k)
        assert orbit.admissible
        assert orbit.flight_time / 2 == pytest.approx(half_flight, rel=0.5 * e**1.5)
        assert orbit(0.0)[1] == pytest.approx(half_flight * (body + foot) / body, rel=3 * e**1.5)


class TestNonlinear:
    """Springs of forces sinh(r)/2 and r + r^3/5, whose one law in series is implicit."""

    LAWS, PARAMETERS, MASSES = ("sinh(r)/2", "r + c*r**3"), {"c": 0.2}, (1.2, 1.0)

    @staticmethod
    def upper(r):
        return np.sinh(r) / 2

    @staticmethod
    def lower(r):
        return r + 0.2 * r**3

    def law(self, extension):
        """The force of both springs at the sum of their extensions."""
        own = brentq(lambda r: self.upper(extension - r) - self.lower(r), -20, 20, xtol=1e-15, rtol=1e-14)
        return self.lower(own)

    def limit(self, m1, m2):
        """The hopper with that one law: alpha, half the flight, half the contact, and lift-off's extension."""
        liftoff = np.arcsinh(2 * m2) + brentq(lambda r: self.lower(r) - m2, 0, 10, xtol=1e-15)

        def in_relative(t, x):
            return [x[1], -self.law(x[0]) * (1 / m1 + 1 / m2)]

        def speed(half_flight):
            start = [liftoff, half_flight * (m1 + m2) / m1]
            return solve_ivp(in_relative, (0, half_flight), start, **TIGHT).y[1, -1]

        times = np.linspace(0.5, 8.0, 16)
        speeds = [speed(time) for time in times]
        i = next(i for i in range(15) if speeds[i] < 0 <= speeds[i + 1])
        half_flight = brentq(speed, times[i], times[i + 1], xtol=1e-13)
        alpha = half_flight * (m1 + m2) / m1
        turns = lambda t, x: x[1]  # noqa: E731
        turns.terminal, turns.direction = True, 1
        fall = solve_ivp(
            lambda t, x: [x[1], -self.law(x[0]) / m1 - 1], (0, 20), [liftoff, -alpha], events=turns, **TIGHT
        )
        return alpha, half_flight, fall.t[-1], liftoff

    def near_limit(self, e):
        """The hop with a small mass e that is found from the limit, and alpha and half the flight of that."""
        alpha, half_flight, half_contact, rise = self.limit(*self.MASSES)
        low = brentq(lambda r: self.lower(r) - self.MASSES[1], 0, 10, xtol=1e-15)
        slopes = np.array([np.cosh(rise - low) / 2, 1 + 0.6 * low**2])
        share = slopes[0] / slopes.sum()
        start = start_of((rise, alpha), (low, share * alpha), (half_flight, half_contact))
        return find(self.chain(e), start=start), alpha, half_flight

    def chain(self, e):
        return Chain((self.MASSES[0], e, self.MASSES[1]), self.LAWS, parameters=self.PARAMETERS)

    @pytest.mark.slow
    def test_two_springs_are_one(self):
        off, masses = [], np.array([1e-2, 1e-3, 1e-4])
        for e in masses:
            orbit, alpha, half_flight = self.near_limit(e)
            assert orbit.admissible
            off.append(np.array([orbit(0.0)[1] / alpha, orbit.flight_time / 2 / half_flight]) - 1)
        rates = np.array(off) / masses[:, None]
        assert np.abs(rates).max() < 2.0  # of the first order, with a vibration of order 3/2
        assert rates[1] == pytest.approx(rates[2], rel=0.2)

    @pytest.mark.slow
    def test_a_cycle_by_another_integrator(self):
        orbit, *_ = self.near_limit(0.01)
        m1, m2, m3 = self.MASSES[0], 0.01, self.MASSES[1]

        def flight(t, x):
            top, low = self.upper(x[0] - x[2]), self.lower(x[2] - x[4])
            return [x[1], -1 - top / m1, x[3], -1 + (top - low) / m2, x[5], -1 + low / m3]

        x = orbit(0.0)
        landed = solve_ivp(flight, (0, orbit.flight_time), x, **TIGHT).y[:, -1]
        np.testing.assert_allclose(landed, x * [1, -1, 1, -1, 1, -1], atol=1e-8)
        standing = lambda t, x: flight(t, [*x, 0, 0])[:4]  # noqa: E731
        back = solve_ivp(standing, (0, orbit.contact_time), landed[:4], **TIGHT).y[:, -1]
        np.testing.assert_allclose(back, x[:4], atol=1e-8)
