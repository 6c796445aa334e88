"""Hops along a parameter by their equations: against hops of the map one by one, and differences of these."""

import numpy as np
import pytest

from orbits import ReturnMap
from orbits.returns.cycles import MapsAlong
from orbits.returns.cycles_along import CyclesAlong, SolvedHops
from problems import Hopper, hopper_in_si


def maps_along(machine, name, low, high, inject):
    return MapsAlong(machine, name, low, high, inject, 1000)


@pytest.mark.parametrize(
    ("machine", "name", "value", "alpha", "inject"),
    [
        (Hopper(), "mass_ratio", 1.0, 4.6, 0.12),
        (Hopper(damping=0.003), "damping", 0.003, 4.49, 0.2),  # one of the hops has two impacts
    ],
)
def test_hops_and_their_derivatives(machine, name, value, alpha, inject):
    maps = maps_along(machine, name, 0.9 * value, 1.1 * value, inject)
    alphas, values = alpha + np.array([0.0, 1e-3, 1e-3]), value * np.array([1.0, 1.0, 1.01])
    for _ in range(2):  # from hops of the map, and from hops solved before
        found = maps.smooth_cycles(alphas, values, 3)
        launches, impacts = maps.cycles(alphas, values, 3)
        assert found.launches == pytest.approx(launches, rel=1e-11)
        assert (found.impacts == impacts).all()
    step = 1e-5
    by_speed = [maps.cycles(alphas[:1] + h, value, 3)[0][0] for h in (-step, step)]
    by_value = [maps.cycles(alphas[:1], value * (1 + h), 3)[0][0] for h in (-step, step)]
    differences = np.array([np.subtract(*by_speed[::-1]), np.subtract(*by_value[::-1]) / value]).T / (2 * step)
    assert found.changes[0] == pytest.approx(differences, rel=1e-5, abs=1e-5)
    multiplier = maps.multiplier(tuple(launches[0, :-1].tolist()), value)
    assert found.slopes[0].prod() == pytest.approx(multiplier, rel=1e-9)


def test_derivatives_do_not_depend_on_the_hops_before():
    """From hops this far away the last step would be short enough for the launches, not for the slopes."""
    maps = maps_along(Hopper(), "mass_ratio", 0.9, 1.1, 0.1)
    for alpha in (4.9, 4.9004, 4.9005):
        found = maps.smooth_cycles(np.array([alpha]), np.ones(1), 1)
        assert found.slopes[0, 0] == pytest.approx(maps.multiplier((alpha,), 1.0), rel=1e-10)


def test_guesses_are_the_nearest_hops_first():
    along = CyclesAlong(Hopper(), "damping", 0.1, 1.0, lambda _: pytest.fail("no simulation is needed"))
    known = [SolvedHops(alpha, 0.0, impacts, (), ()) for alpha, impacts in ((4.5, (1,)), (4.7, (1,)), (4.8, (2,)))]
    near, far = along._nearest_first(known, np.array([4.51, 4.79]), np.zeros(2))
    guesses = along._guesses(near, 4.51, 0.0, 1)
    assert [next(guesses).alpha for _ in range(2)] == [4.5, 4.8]
    guesses = along._guesses(far, 4.79, 0.0, 1)
    assert [next(guesses).alpha for _ in range(2)] == [4.8, 4.7]


def test_in_si():
    """The units of a machine in SI vary with the parameter."""
    machine = hopper_in_si(2.0, 2.0, stiffness=100.0, rest_length=2.0)
    name = next(each for each in machine.values if "stiffness" in each)
    unit = machine.units.of("alpha")
    maps = maps_along(machine, name, 90.0, 110.0, 0.1 * unit)
    alphas, values = 4.6 * unit * np.ones(1), 100.0 * np.ones(1)
    found = maps.smooth_cycles(alphas, values, 2)
    assert found.launches == pytest.approx(maps.cycles(alphas, 100.0, 2)[0], rel=1e-11)
    low, high = (maps.cycles(alphas, each, 2)[0][0] for each in (99.9999, 100.0001))
    assert found.changes[0, :, 1] == pytest.approx((high - low) / 2e-4, rel=1e-5, abs=1e-9)


def test_where_the_map_is_used():
    """At a lossless hop, along a restitution, and for machines with one."""
    alpha = 4.493409457909064  # tan(alpha) = alpha
    assert maps_along(Hopper(), "mass_ratio", 0.9, 1.1, 0.1).smooth_cycles(np.array([alpha]), np.ones(1), 1) is None
    for machine, name in ((Hopper(restitution=0.2), "mass_ratio"), (Hopper(), "restitution")):
        assert maps_along(machine, name, 0.1, 0.9, 0.1).smooth_cycles(np.array([4.6]), np.array([0.5]), 1) is None


def test_all_hops_of_a_period_in_the_units_of_each_value():
    """In SI the unit of speed depends on the stiffness; the hops are those of the dimensionless machine in it."""
    machine = hopper_in_si(2.0, 2.0, stiffness=100.0, rest_length=2.0)
    own, there = (each.units.of("alpha") for each in (machine, machine.with_values(stiffness=105.0)))
    inject = 0.1 * own
    assert there < 0.98 * own
    maps = maps_along(machine, "stiffness", 80.0, 120.0, inject)
    found = maps.all_cycles(105.0, (4.3 * own, 4.8 * own), 2)
    same = ReturnMap(Hopper(), inject=inject / there).periodic_hops(2, 4.3 * own / there, 4.8 * own / there)
    assert np.array(found) == pytest.approx(there * np.array([hops.alphas for hops in same]), rel=1e-10)
    assert len(found) == 1
    (launches,), _ = maps.cycles(found[0][:1], 105.0, 2)
    assert launches[2] == pytest.approx(launches[0], rel=1e-10)
