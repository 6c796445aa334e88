"""Proved launch speeds of random springs against quadratures of the energy integral in 40 digits."""

import mpmath as mp
import numpy as np
import pytest

from orbits import find, prove
from problems import Hopper
from studies.stress import random_laws

# The potential and the force of each kind of random spring.
LAWS = {
    "r + a*r**2 + b*r**3 + c*r**5": (
        lambda r, a, b, c: r**2 / 2 + a * r**3 / 3 + b * r**4 / 4 + c * r**6 / 6,
        lambda r, a, b, c: r + a * r**2 + b * r**3 + c * r**5,
    ),
    "tanh(b*r)/b + c*r**3": (
        lambda r, b, c: mp.log(mp.cosh(b * r)) / b**2 + c * r**4 / 4,
        lambda r, b, c: mp.tanh(b * r) / b + c * r**3,
    ),
    "(exp(b*r) - 1)/b": (
        lambda r, b: (mp.exp(b * r) / b - r) / b,
        lambda r, b: (mp.exp(b * r) - 1) / b,
    ),
    "s*r + (1 - s)*sinh(b*r)/b": (
        lambda r, s, b: s * r**2 / 2 + (1 - s) * mp.cosh(b * r) / b**2,
        lambda r, s, b: s * r + (1 - s) * mp.sinh(b * r) / b,
    ),
}


def lateness(orbit, text, exact, alpha):
    """How much longer than alpha the flight of family 1 takes from lift-off over the top to the bottom."""
    potential, force = LAWS[text]
    rho = mp.findroot(lambda r: force(r, **exact) - 1, mp.mpf(orbit.liftoff_extension))
    energy = alpha**2 / 2 + potential(rho, **exact)
    states = orbit(np.linspace(0, orbit.flight_time / 2, 400))
    extensions = states[:, 0] - states[:, 2]
    top, bottom = (
        mp.findroot(lambda r: potential(r, **exact) - energy, mp.mpf(float(end)))
        for end in (extensions.max(), extensions.min())
    )

    def time(low, high):
        """From one extension to a higher one; the roots at turning points are what tanh-sinh quadrature is for."""
        speed = lambda r: mp.sqrt(abs(2 * (energy - potential(r, **exact))))  # noqa: E731
        return mp.quad(lambda r: 1 / speed(r), [low, (low + high) / 2, high])

    return time(rho, top) + time(bottom, top) - alpha


@pytest.mark.slow
@pytest.mark.parametrize("law", {law[0]: law for law in random_laws(6, 7)}.values(), ids=lambda law: law[0])
def test_random_laws(law):
    """The lateness changes its sign between the bounds of the enclosure, so that the true value is inside."""
    text, parameters = law
    orbit = find(Hopper(text, rest_length=30.0, parameters=parameters))
    proof = prove(orbit, motion=False)
    assert proof.proved, proof.reasons
    with mp.workdps(60):
        exact = {name: mp.mpf(repr(float(value))) for name, value in parameters.items()}
        low, high = (lateness(orbit, text, exact, mp.mpf(bound)) for bound in (proof.alpha.low, proof.alpha.high))
        assert low * high < 0
        assert abs(low) > 1e-27  # what the quadratures may be off by, near the turning points, where digits cancel
