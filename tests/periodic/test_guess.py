"""Guesses of launch speeds: found below the limit of a spring, and given up soon where there are none."""

from importlib import import_module

import numpy as np
import pytest

from orbits import NoOrbit, find
from orbits.periodic.guess import crossable_barriers
from problems import Hopper


@pytest.mark.parametrize(("b", "family"), [(0.2, 1), (0.32, 1), (0.15, 2)])
def test_saturating_spring_has_a_family_below_its_limit(b, family):
    assert b < 1 / (2 * family + 1)
    assert find(Hopper("tanh", parameters={"b": b}), family).family == family


@pytest.mark.slow
def test_saturating_spring_has_none_above_its_limit():
    with pytest.raises(NoOrbit, match="none up to launch speed"):
        find(Hopper("tanh", parameters={"b": 0.34}))


def test_a_fold_is_searched_once(monkeypatch):
    """Beyond the fold of cubic springs the lateness has a minimum above zero before the barrier."""
    launch = import_module("orbits.periodic.guess")
    runs, count = launch.half_oscillations, []
    monkeypatch.setattr(launch, "half_oscillations", lambda *a: (count.append(1), runs(*a))[1])
    with pytest.raises(NoOrbit, match="does not come back"):
        find(Hopper("r + beta*r**3 + delta*r**5", parameters={"beta": -0.0126, "delta": -1e-5}))
    assert len(count) < 30


@pytest.mark.parametrize("spring", ["r**2", "exp(r)/2"])
def test_a_spring_that_never_pushes_is_soon_refused(spring, monkeypatch):
    launch = import_module("orbits.periodic.guess")
    runs, count = launch.half_oscillations, []
    monkeypatch.setattr(launch, "half_oscillations", lambda *a: (count.append(1), runs(*a))[1])
    with pytest.raises(NoOrbit, match=r"does not come back|none up to"):
        find(Hopper(spring))
    assert len(count) < 200


def test_barriers_that_a_hop_can_cross():
    """The force falls and rises again, further out on either side; slopes are listed outward on both."""
    slopes = np.ones((6, 8))
    slopes[1, 1] = -1.0  # on the first side
    slopes[2, 6] = -1.0  # on the second
    slopes[3, 3] = slopes[4, 7] = -1.0  # at the far end it only falls
    slopes[5, 2:4] = slopes[5, 5:] = -1.0
    assert crossable_barriers(slopes).tolist() == [False, True, True, False, False, False]
