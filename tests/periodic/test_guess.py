"""Guesses of launch speeds: found below the limit of a spring, and given up soon where there are none."""

from importlib import import_module

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


@pytest.mark.parametrize("spring", ["r**2", "exp(r)/2"])
def test_a_spring_that_never_pushes_is_soon_refused(spring, monkeypatch):
    launch = import_module("orbits.periodic.guess")
    runs, count = launch.half_oscillations, []
    monkeypatch.setattr(launch, "half_oscillations", lambda *a: (count.append(1), runs(*a))[1])
    with pytest.raises(NoOrbit, match=r"does not come back|none up to"):
        find(Hopper(spring))
    assert len(count) < 200
