"""Hoppers with two springs in series and an unsprung mass between: chains with a law for each spring."""

import numpy as np
import pytest

from orbits import find
from problems import Chain, Hopper

X0 = find(Hopper()).alpha  # tan x0 = x0


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
