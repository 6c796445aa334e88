"""Guesses of launch speeds: found below the limit of a spring, and given up soon where there are none."""

import pytest

from orbits import NoOrbit, find
from problems import Hopper


@pytest.mark.parametrize(("b", "family"), [(0.2, 1), (0.32, 1), (0.15, 2)])
def test_saturating_spring_has_a_family_below_its_limit(b, family):
    assert b < 1 / (2 * family + 1)
    assert find(Hopper("tanh", parameters={"b": b}), family).family == family


@pytest.mark.slow
def test_saturating_spring_has_none_above_its_limit():
    with pytest.raises(NoOrbit, match="none up to launch speed"):
        find(Hopper("tanh", parameters={"b": 0.34}))
