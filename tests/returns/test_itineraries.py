"""All periodic launches by itineraries, against maps whose periodic points are known."""

import numpy as np
import pytest

from orbits.errors import InputError
from orbits.returns import itineraries
from orbits.returns.itineraries import MonotoneBranches, intervals_of, periodic_launches
from orbits.returns.resolution import map_pieces
from tests.returns.test_map_pieces import hops_of


def logistic(r):
    """The branches of the logistic map x -> r x (1 - x), shifted by 1."""
    step = hops_of(lambda x: 1 + r * (x - 1) * (2 - x), lambda x: np.ones(len(x)))
    return MonotoneBranches.of(map_pieces(step, 1.0, 2.0, 20), 0.0)


def launches(branches, period):
    return np.unique(periodic_launches(branches, intervals_of(branches, period))[0].round(11))


@pytest.mark.parametrize("period", [1, 2, 3, 6])
def test_the_logistic_map_of_full_height_has_all_points(period):
    branches = logistic(4.0)
    k = np.arange(2**period)
    known = np.concatenate([np.sin(np.pi * k / (2**period - 1)) ** 2, np.sin(np.pi * k / (2**period + 1)) ** 2])
    found, words = periodic_launches(branches, intervals_of(branches, period))
    inside = np.unique((1 + known).round(9))[1:]  # but the end of the range
    assert np.unique(found.round(9)) == pytest.approx(inside, abs=1e-9)
    _, slopes = branches.cycle(found, words)
    assert np.abs(slopes) == pytest.approx(2.0**period, rel=1e-6)


def test_cycles_are_born_at_a_fold():
    """Period three of the logistic map begins at r = 1 + sqrt(8)."""
    fold = 1 + np.sqrt(8)
    assert len(launches(logistic(fold - 1e-9), 3)) == 1
    assert len(launches(logistic(fold + 1e-9), 3)) == 7


def test_too_many_itineraries_are_refused(monkeypatch):
    monkeypatch.setattr(itineraries, "ITINERARIES", itineraries.ITINERARIES._replace(most=10))
    with pytest.raises(InputError, match="more than 10 itineraries: shorten"):
        intervals_of(logistic(4.0), 5)
