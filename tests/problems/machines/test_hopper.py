"""The hopper: hops on a linear spring in closed form, light feet, and masses that do not matter."""

import mpmath
import numpy as np
import pytest

from orbits import find
from problems import Hopper


@pytest.mark.parametrize("mass_ratio", [0.01, 1.0, 50.0])
@pytest.mark.parametrize("family", [1, 2, 7])
def test_linear_orbit_is_the_closed_form(mass_ratio, family):
    """Eqs. (7), (8) and (12) of the paper."""
    orbit = find(Hopper(mass_ratio=mass_ratio), family)
    alpha = float(mpmath.findroot(lambda a: mpmath.sin(a) - a * mpmath.cos(a), (family + 0.5) * np.pi - 0.01))
    assert orbit.alpha == pytest.approx(alpha, rel=1e-15)
    t, M = np.linspace(0, orbit.flight_time, 200), mass_ratio
    y2 = (1 + alpha * t - t**2 / 2 - alpha * np.sin(t) - np.cos(t)) / (1 + M)
    y1 = (1 + alpha * t - t**2 / 2 + M * (alpha * np.sin(t) + np.cos(t))) / (1 + M)
    assert orbit(t)[:, [0, 2]] == pytest.approx(np.stack([y1, y2], axis=1), abs=1e-13 * alpha**2)


def test_alpha_does_not_depend_on_the_masses_under_constant_gravity():
    alphas = [find(Hopper("cubic", mass_ratio=M)).alpha for M in (1e-3, 1.0, 1e3)]
    assert alphas == pytest.approx([alphas[0]] * 3, rel=1e-14)


@pytest.mark.parametrize("mass_ratio", [1e-4, 1e-8, 1e-11])
def test_a_light_foot_stays_long_on_the_ground(mass_ratio):
    """Contact is an oscillation at the frequency sqrt(M/(1+M)) about -1/M."""
    orbit = find(Hopper("r", mass_ratio=mass_ratio))
    w = np.sqrt(mass_ratio / (1 + mass_ratio))
    half = (np.pi - np.arctan2(orbit.alpha / w, 1 + 1 / mass_ratio)) / w
    assert orbit.contact_time == pytest.approx(2 * half, rel=1e-9)
