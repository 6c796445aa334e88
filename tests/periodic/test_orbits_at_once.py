"""The lowest orbits of many machines, together and alone, against scans."""

import numpy as np
import pytest

from orbits import find, find_all
from orbits.design.design_point import unknowns_of
from orbits.periodic import lowest_orbits, orbits_near
from problems import Hopper, Juggler
from studies.search import Case


def quintic_case(beta, delta):
    """A juggler whose hand crosses a barrier on either side, each from a launch speed of its own."""
    machine = Juggler("r + beta*r**3 + delta*r**5", rest_length=50, parameters={"beta": beta, "delta": delta})
    return Case(machine, 1, lambda r: r + beta * r**3 + delta * r**5, np.ones_like, 1.0)


def test_the_lowest_is_found_between_two_barriers():
    case = quintic_case(-0.01030150753768844, 3.015075376884419e-06)
    orbit, orbits = find(case.machine), find_all(case.machine)
    assert [one.alpha for one in orbits] == pytest.approx([7.100276, 8.275324, 9.545378], abs=1e-6)
    assert orbit.alpha == pytest.approx(orbits[0].alpha, rel=1e-12)
    assert case.holds(orbit.alpha, orbit.flight_time / 2)
    assert case.scanned(9.0) == pytest.approx([one.alpha for one in orbits[:2]], rel=1e-3)


@pytest.mark.slow
def test_the_lowest_of_many_is_found_beyond_barriers():
    """Alone and together, of springs that have one orbit or three."""
    rng = np.random.default_rng(12)
    cases = [quintic_case(*p) for p in zip(rng.uniform(-0.013, -0.01, 6), rng.uniform(0, 7e-5, 6), strict=True)]
    alphas = np.array([find(case.machine).alpha for case in cases])
    scanned = np.array([case.scanned(alpha)[0] for case, alpha in zip(cases, alphas, strict=True)])
    assert alphas == pytest.approx(scanned, rel=1e-3)
    ps = np.array([list(case.machine.values.values()) for case in cases])
    (together,), none = lowest_orbits(cases[0].machine.model, tuple(cases[0].machine.values), ps, 1)
    assert sorted(together.which) == list(range(6))
    assert not none
    assert together.alphas == pytest.approx(alphas[together.which], rel=1e-9)  # a few are close to a barrier


def test_long_hops_are_found_together():
    machine, betas = Hopper("cubic"), (0.1, 0.2)
    ps = np.array([[*machine.with_values(beta=beta).values.values()] for beta in betas])
    (together,), _ = lowest_orbits(machine.model, tuple(machine.values), ps, 150)
    assert together.which.tolist() == [0, 1]
    alone = [find(machine.with_values(beta=beta), 150).alpha for beta in betas]
    assert together.alphas == pytest.approx(alone, rel=1e-11)


def test_one_machine_is_left_to_find():
    machine = Hopper("cubic", parameters={"beta": 0.1})
    assert lowest_orbits(machine.model, tuple(machine.values), np.array([[*machine.values.values()]]), 1) == ([], {})


def test_each_orbit_near_is_of_its_own_family():
    machine = Hopper("r + b*r**3", parameters={"b": 0.1}, rest_length=20.0)
    orbits = [find(machine, family) for family in (1, 2)]
    us = [1.001 * unknowns_of(machine, orbit) for orbit in orbits]
    found = orbits_near([machine] * 3, [*us, us[0]], [1, 2, 2])
    assert [orbit and orbit.family for orbit in found] == [1, 2, None]
    assert [orbit.alpha for orbit in found[:2]] == pytest.approx([orbit.alpha for orbit in orbits], rel=1e-12)
