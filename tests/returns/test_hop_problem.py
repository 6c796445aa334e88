"""The equations of hops that return, and one more row, in two parameters: against differences."""

import numpy as np
import pytest
from conftest import slow_after

from orbits import Bifurcation
from orbits.returns.followed_events import _event_curve
from problems import Hopper

FLIP_OF_TWO = Bifurcation("flip", 0.113429246523, (4.60719455761, 4.49391741249))
FOLD = Bifurcation("fold", 0.00573688777873, (4.4962210425,))
LOSSLESS = Bifurcation("border collision", 0.115057432704, (4.60846689061, 4.49340945791))


@pytest.mark.parametrize(
    ("machine", "along", "event", "inject"),
    slow_after(1, [
        (Hopper(), "inject", FLIP_OF_TWO, 0.0), (Hopper(damping=0.001), "damping", FOLD, 0.1),
        (Hopper(), "inject", LOSSLESS, 0.0),
    ]),
)  # fmt: skip
def test_the_equations_of_bifurcations_and_their_derivatives(machine, along, event, inject):
    _, curve, x, _ = _event_curve(machine, along, event, "mass_ratio", inject)
    lanes = np.zeros(1, int)
    assert np.abs(curve.evaluate(lanes, x[None])[1].residual).max() < 2e-3
    x = x + 1e-4 * np.random.default_rng(3).uniform(-1, 1, len(x)) * x
    steps = 1e-6 * (np.abs(x) + 0.1)
    found = curve.evaluate(lanes, x[None])[1]
    low, high = (curve.evaluate(np.zeros(len(x), int), x + side * np.diag(steps))[1] for side in (-1, 1))
    change = ((high.residual - low.residual) / (2 * steps[:, None])).T
    assert found.jacobian[0] == pytest.approx(change, rel=1e-5, abs=1e-4)
    assert found.jacobian.shape == (1, len(x) - 1, len(x))
