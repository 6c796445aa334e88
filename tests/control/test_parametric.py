"""Derivatives of the program along a parameter, against CasADi's own of the whole and against differences."""

import casadi as ca
import numpy as np
import pytest
from carts import cart

from orbits.control import Input, Stage
from orbits.control.parametric import ExchangePoint, ParametricTranscription
from orbits.control.transcription import transcription
from orbits.model import Phase

PATH = {"slower": lambda x, p, q: 2.0 - x[1] + x[0] * p["f"], "behind": lambda x, p, q: p["d"] - x[0] ** 2}
WAVE = Phase("wave", ("x", "v"), lambda x, p, q: [x[1], p["f"] - ca.sin(p["d"] * x[0])])


def program(moving: bool) -> tuple[ParametricTranscription, np.ndarray, np.ndarray]:
    """Two stages with path expressions, an exchange point, a free parameter and a fixed one that varies, at a seeded
    place."""
    first = cart(3, (0.5, 2.0), path=PATH, end=lambda x, p: [x[0] - p["d"] * p["a"]], final=lambda x, p: p["a"] ** 4)
    second = Stage(
        WAVE, 2, (0.5, 2.0), {"f": Input(lambda p: -p["a"], degree=0)}, lambda x, before, p: [x[0] - before[0] ** 2],
        running=lambda x, p, q: x[0] ** 2 + p["f"] ** 2 * p["d"],
    )  # fmt: skip
    problem = transcription((first, second), ("c", "d"), ("a",), (1, 2), ((0, 1),))
    values = lambda value: (np.array([0.3, value**2]), np.array([0.0, 2 * value]))  # noqa: E731
    point = ExchangePoint(0, 1, 1, 0.4, moving)
    found, rng = ParametricTranscription(problem, [point], values, {"a": (0.1, 2.0)}), np.random.default_rng(3)
    x = np.append(rng.uniform(0.5, 1.5, found.count), [0.4] * moving)
    return found, x, rng.standard_normal(len(problem.labels) + moving)


@pytest.mark.parametrize("moving", [False, True])
def test_derivatives_are_the_limits_of_differences(moving):
    found, x, y = program(moving)
    second, h = found.second(x, 0.8, y), 1e-6
    for i in range(len(x)):
        step = h * np.eye(1, len(x), i)[0]
        ahead, behind = (found.first(x + sign * step, 0.8, y) for sign in (1, -1))
        assert second.hessian.toarray()[:, i] == pytest.approx((ahead.gradient - behind.gradient) / (2 * h), abs=2e-7)
        assert second.jacobian.toarray()[:, i] == pytest.approx((ahead.values - behind.values) / (2 * h), abs=2e-8)
    ahead, behind = (found.first(x, 0.8 + sign * h, y) for sign in (1, -1))
    assert second.gradient_slope == pytest.approx((ahead.gradient - behind.gradient) / (2 * h), abs=2e-7)
    assert second.values_slope == pytest.approx((ahead.values - behind.values) / (2 * h), abs=2e-8)
    lagrangians = [each.cost + y @ each.values for each in (ahead, behind)]
    assert found.first(x, 0.8, y).slope == pytest.approx((lagrangians[0] - lagrangians[1]) / (2 * h), abs=1e-8)
