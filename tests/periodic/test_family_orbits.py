"""Families are counted on orbits, and hold the lowest of them."""

from dataclasses import replace

import numpy as np
import pytest
from two_feet import FEET

from orbits import InputError, NoOrbit, find, find_all, starts
from orbits.mechanics import Potential
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


def test_a_linear_machine_of_two_gaps_is_searched_by_its_modes():
    """For the feet's mass 4 the orbit is that of `studies/exact_orbits/cases/alternating_hopper.json`."""
    heavy = FEET.with_values(m=4.0)
    orbit = find(heavy)
    assert (orbit.family, orbit.admissible) == (1, True)
    assert orbit.alpha == pytest.approx(42.380943053086255996, rel=1e-13)
    assert orbit.contact_time == pytest.approx(2.1121249064823066302, rel=1e-13)
    family = find_all(heavy, 1)
    assert [each.admissible for each in family] == [False, False, True]
    assert family[-1].alpha == pytest.approx(orbit.alpha, rel=1e-14)
    assert len(starts(heavy)) == 20
    assert [each.alpha for each in find_all(heavy, 1, fastest=30.0)] == [each.alpha for each in family[:-1]]
    light = find(FEET.with_values(m=1.0))
    assert light.violations[0].startswith("the right touches in contact at t = 3.41243")
    pushed = replace(FEET, coordinates=("h", "s", "d", "q"), inertia={"q": 1.0}, name="tall machine",
                     elements=[*FEET.elements, Potential("q*d/10 - q**2/2")], heights=None,
                     reversor={"d": "-d", "q": "-q"}, symmetry={"d": "-d", "q": "-q"})  # fmt: skip
    with pytest.raises(NoOrbit, match="no guess of the families of a tall machine is known: give `find` a start"):
        find(pushed)
    with pytest.raises(NoOrbit, match=r"none of 20 hops with half .* up to 12\.57 is of family 9"):
        find(heavy, 9)
    with pytest.raises(NoOrbit, match=r"none of 0 hops .* and launch speeds up to 2 is of family 1"):
        find_all(heavy, 1, fastest=2.0)
