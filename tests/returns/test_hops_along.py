"""Machines along a parameter: the unknowns of hops."""

import numpy as np
import pytest

from orbits import ReturnMap
from orbits.returns.launch_cycles import MapsAlong
from problems import Hopper


def test_the_word_and_the_launches_of_hops_are_those_of_the_map():
    maps, step = MapsAlong(Hopper(), "inject", 0.05, 0.1, 0.0, 1000), ReturnMap(Hopper(), inject=0.08)
    word, us = maps.along.flown(np.array([[4.47]]), 0.08, 2)
    first = step(4.47)
    assert word == (int(first.impacts), int(step(float(first.next)).impacts))
    assert us[[1, 1 + 3 + word[0]]] == pytest.approx([4.47, float(first.next)], abs=1e-12)
    assert maps.along.flown(np.array([[0.1]]), -0.5, 1) is None


def test_what_an_injection_stops_rests():
    """Along the injection too, where less than nothing would be left of the next launch speed."""
    alpha, inject = np.array([2.0, 3.0, 4.4]), np.array([-0.3, -2.9, -5.0])
    hops = MapsAlong(Hopper(), "inject", -6.0, 0.0, 0.0, 1000).hops(alpha, inject)
    for i, each in enumerate(inject):
        alone = ReturnMap(Hopper(), inject=each)(alpha[i : i + 1])
        assert hops.status[i] == alone.status[0]
        assert hops.next[i] == pytest.approx(alone.next[0], nan_ok=True)
    assert hops.status.tolist()[-1] == "rests"
    assert np.isnan(hops.next[-1])
