"""Curves of hops across the borders of the map."""

import numpy as np
import pytest

from orbits import ReturnMap, find
from orbits.curves import Points, Run
from orbits.returns.hop_borders import beyond
from orbits.returns.hop_curve import HopCurve
from orbits.returns.launch_cycles import MapsAlong
from problems import Hopper


def test_a_curve_goes_through_a_lossless_hop():
    """On both sides an injection of what the map loses."""
    machine, plain = Hopper("r+0.3*r**3"), ReturnMap(Hopper("r+0.3*r**3"))
    star = find(machine).alpha
    maps, alpha = MapsAlong(machine, "inject", 0.0, 0.05, 0.0, 1000), star + 0.02
    loss = alpha - float(plain(alpha).next)
    word, us = maps.along.flown(np.array([[alpha]]), loss, 1)
    curve, x = HopCurve(maps.along, word, (2.8, 3.1), beyond), np.append(us, loss)
    row = np.eye(1, len(x), 1)[0]
    items = list(Run(curve, curve.solved(x, row, -row), -0.01, behind=0.05))
    points = [launch for item in items if isinstance(item, Points) for launch in item.own]
    values, alphas = np.array([(each.value, each.alpha) for each in points]).T
    assert (np.diff(alphas) < 0).all()
    assert values == pytest.approx(alphas - plain(alphas).next, abs=1e-12)
    assert {each.impacts for each in points} == {(1,), (2,)}
    assert (alphas[-1] < star < alphas[0], items[-1].kind) == (True, "reached")
