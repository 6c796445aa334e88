"""The curve of hops that return in all of their unknowns: against hops of the map and differences."""

import numpy as np
import pytest

from orbits.returns.hop_borders import beyond
from orbits.returns.hop_curve import HopCurve
from orbits.returns.launch_cycles import MapsAlong
from problems import Hopper, hopper_in_si

SI = hopper_in_si(2.0, 2.0, stiffness=100.0, rest_length=2.0)
UNIT = SI.units.of("alpha")


@pytest.mark.parametrize(
    ("machine", "name", "span", "value", "alpha", "inject", "period"),
    [
        (Hopper(), "mass_ratio", (0.9, 1.1), 1.0, 4.5, 0.1, 2),
        (Hopper(), "inject", (0.08, 0.13), 0.1, 4.5, 0.0, 2),
        (Hopper(damping=0.001), "damping", (0.0, 0.007), 0.001, 4.479, 0.1, 1),  # with two impacts
        (SI, next(n for n in SI.values if "stiffness" in n), (90.0, 110.0), 100.0, 4.5 * UNIT, 0.1 * UNIT, 2),
    ],
)
def test_the_equations_and_their_derivatives(machine, name, span, value, alpha, inject, period):
    maps = MapsAlong(machine, name, *span, inject, 1000)
    word, us = maps.along.flown(np.array([[alpha]]) / maps.along.units(np.array([value]))[0], value, period)
    curve, x = HopCurve(maps.along, word, (0.9 * alpha, 1.1 * alpha), beyond), np.append(us, value)
    row = np.eye(1, len(x), len(x) - 1)[0]
    point = curve.solved(x, row, row)
    launches, impacts = maps.cycles(np.array(point.own[0].alphas[:1]), value, period)
    assert point.own[0].alphas == pytest.approx(launches[0, :-1], rel=1e-11)
    assert launches[0, -1] == pytest.approx(launches[0, 0], rel=1e-11)
    assert curve.word == (*impacts[0].tolist(),)
    assert point.own[0].multiplier == pytest.approx(maps.multiplier(point.own[0].alphas, value), rel=1e-8)
    x = point.xs[0] + 1e-3 * np.random.default_rng(3).uniform(-1, 1, len(x)) * point.xs[0]
    steps = 1e-6 * np.abs(x)
    found = curve.evaluate(np.zeros(1, int), x[None])[1]
    low, high = (curve.evaluate(np.zeros(len(x), int), x + side * np.diag(steps))[1] for side in (-1, 1))
    for values, derivatives in (("residual", found.jacobian), ("slacks", found.steps)):
        change = (getattr(high, values) - getattr(low, values)) / (2 * steps[:, None])
        assert derivatives[0] == pytest.approx(change.T, rel=1e-5, abs=1e-5)
