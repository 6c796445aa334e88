"""Families are counted on orbits, and hold the lowest of them."""

import numpy as np
import pytest

from orbits import InputError, NoOrbit, find
from problems import Hopper


@pytest.mark.parametrize(("beta", "family"), [(0.3, 1), (0.3, 2), (0.3, 5), (-0.005, 1)])
def test_families_count_stationary_points(beta, family):
    orbit = find(Hopper("cubic", parameters={"beta": beta}), family)
    t = np.linspace(0, orbit.flight_time / 2, 20001)[1:]
    speed = orbit(t)[:, 1] - orbit(t)[:, 3]
    turns = np.count_nonzero(np.sign(speed[1:-1]) != np.sign(speed[:-2]))
    assert turns + 1 == family + 1


def test_large_families():
    linear = find(Hopper(), 60)
    assert linear.alpha == pytest.approx(190.06109412465196, rel=1e-14)
    cubic = find(Hopper("cubic", parameters={"beta": 0.1}), 60)
    shot = find(Hopper("cubic", parameters={"beta": 0.1}), 60, method="shooting")
    assert (cubic.family, shot.family) == (60, 60)
    assert shot.alpha == pytest.approx(cubic.alpha, rel=1e-12)


@pytest.mark.parametrize("family", [0, -1, 1.5, "one", True, 10**7])
def test_bad_families(family):
    with pytest.raises(InputError, match="a family must be a whole number"):
        find(Hopper(), family)


def test_a_solve_that_lands_on_another_family_has_failed(monkeypatch):
    second = find(Hopper(), 2)
    monkeypatch.setattr("orbits.periodic.family_orbits.certified_orbit", lambda *_, **__: second)
    with pytest.raises(NoOrbit, match="ended on an orbit of family 2"):
        find(Hopper())
