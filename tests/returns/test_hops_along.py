"""Machines along a parameter: the unknowns of hops, and the unit of speed."""

import numpy as np
import pytest

from orbits import ReturnMap
from orbits.returns.launch_cycles import MapsAlong
from problems import Hopper, hopper_in_si


def test_the_word_and_the_launches_of_hops_are_those_of_the_map():
    maps, step = MapsAlong(Hopper(), "inject", 0.05, 0.1, 0.0, 1000), ReturnMap(Hopper(), inject=0.08)
    word, us = maps.along.flown(np.array([[4.47]]), 0.08, 2)
    first = step(4.47)
    assert word == (int(first.impacts), int(step(float(first.next)).impacts))
    assert us[[1, 1 + 3 + word[0]]] == pytest.approx([4.47, float(first.next)], abs=1e-12)
    assert maps.along.flown(np.array([[0.1]]), -0.5, 1) is None


def test_the_unit_of_speed_changes_with_a_parameter():
    """That is g sqrt(m/k), whose derivative by the stiffness k is -1/2 of it over k."""
    machine = hopper_in_si(2.0, 2.0, stiffness=100.0, rest_length=2.0)
    name = next(name for name in machine.values if "stiffness" in name)
    along = MapsAlong(machine, name, 90.0, 110.0, 0.1, 1000).along
    (unit,), (growing,) = along.units(np.array([100.0]))
    assert unit == pytest.approx(machine.units.of("alpha"), rel=1e-12)
    assert growing == pytest.approx(-0.5 * unit / 100.0, rel=1e-8)
