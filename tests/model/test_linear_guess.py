"""Guesses from straight lines: exact where the forces are straight lines, and near to the orbit elsewhere."""

import math

import numpy as np
import pytest
from conftest import slow_after
from steps import SINES, TABLE, closed_form, rates, stepping

from orbits import InputError, NoOrbit, find, find_all
from orbits.model import linear_guess
from problems import rocking_block


@pytest.mark.parametrize("kind", TABLE)
def test_straight_lines_are_their_own_guess(kind):
    rng = np.random.default_rng(3)
    for _ in range(6):
        mu, kappa = np.exp(rng.uniform(np.log([0.05, 0.05]), np.log([20.0, 5.0]))).tolist()
        machine, (_, q) = stepping(kind, mu, kappa), rates(mu, kappa)
        for family in (1, 2, 3):
            half, speed, _ = closed_form(kind, mu, kappa, family)
            found = linear_guess(machine.model, family, machine.values)
            assert (found["alpha"], found["duration"]) == pytest.approx((speed, half), rel=1e-9)
            turns = q * half / math.pi
            assert family - 0.5 < turns < family + 0.5
            assert (turns > family) == (kind == "rocker")


@pytest.mark.parametrize(("kind", "law", "family"), slow_after(2, SINES))
def test_other_forces_have_an_orbit_nearby(kind, law, family):
    machine = stepping(kind, 1.0, 0.5, 0.3, law)
    guessed, (speed, half, _) = linear_guess(machine.model, family, machine.values), SINES[kind, law, family]
    assert guessed["alpha"] == pytest.approx(speed, rel=0.02)
    assert half is None or guessed["duration"] == pytest.approx(half, rel=0.1)
    assert find(machine, family=family).alpha == pytest.approx(speed, rel=0, abs=1e-12)


def test_without_gravity_the_body_is_free_between_walls():
    """kappa -> 0: q S = n pi, v = (1 + mu) a/(mu S), with a mode that is thrown."""
    machine = stepping("shuttle", 0.8, 0.0)
    for family in (1, 2):
        found = linear_guess(machine.model, family, machine.values)
        half = family * math.pi / math.sqrt(1.8)
        assert (found["duration"], found["alpha"]) == pytest.approx((half, 1.8 / (0.8 * half)), rel=1e-9)
        assert find(machine, family=family).flight_time == pytest.approx(2 * half, rel=1e-13)


def test_no_mode_swings():
    machine = stepping("wheel", 1.0, 0.5, 0.3, "r**3 - 3*r")
    with pytest.raises(NoOrbit, match="no mode of a wheel oscillates in flight"):
        linear_guess(machine.model, 1, machine.values)


def test_a_force_without_a_value_in_the_middle_has_no_tangent():
    machine = rocking_block(inertia_ratio=1.0, gravity_ratio=0.5, spring="r**-1")
    with pytest.raises(
        NoOrbit, match="or their slopes, are not finite at the place from which its motions are guessed"
    ):
        linear_guess(machine.model, 1, machine.values)
    with pytest.raises(InputError, match="no force at rest"):
        find(machine)


def test_with_gravity_that_bends_the_lowest_orbit_is_searched_for():
    assert find(stepping("wheel", 1.0, 0.5)).known_in_family is None
    machine = stepping("rocker", 1.0, 0.5, 0.3)
    assert not machine.model.search(machine.values).single
    assert [orbit.alpha for orbit in find_all(machine)] == pytest.approx([find(machine).alpha], rel=1e-14)


def test_a_launch_speed_below_0_is_no_guess():
    """With opposite signs of all places the launch would press the contact."""
    with pytest.raises(NoOrbit, match="family 1 has the launch speed -"):
        find(stepping("wheel", 1.0, 0.5, -0.3))
