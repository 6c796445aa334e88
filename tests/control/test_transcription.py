"""The nonlinear program of a sequence of stages: inputs by intervals, costs at the end, and free parameters."""

import casadi as ca
import numpy as np
import pytest
from carts import CART, EFFORT, STRAIGHT, cart

from orbits import steer
from orbits.control import Guess, Input, Stage
from orbits.model import Phase


@pytest.mark.parametrize("intervals", [2, 5, 16])
def test_constant_inputs_cost_their_closed_form(intervals):
    """The middles of N intervals have the variance (1 - 1/N^2)/12."""
    found = steer([cart(intervals, degree=0)], guess=STRAIGHT)
    assert found.cost == pytest.approx(12 / (1 - intervals**-2), abs=1e-9)


def test_a_law_without_a_series():
    moving = {"start": lambda x, before, p: [x[0], x[1] - 0.2], "end": lambda x, p: [x[0] - 1, x[1] - 0.2]}
    drag = Phase("drag", ("x", "v"), lambda x, p, q: [x[1], p["f"] - ca.fabs(x[1]) * x[1]])
    stage = Stage(drag, 10, (2.0, 2.0), {"f": Input(degree=1)}, **moving, **EFFORT)
    found = steer([stage], guess=[Guess(2.0, lambda t: [t / 2, 0.5])])
    smooth = Phase("drag", ("x", "v"), lambda x, p, q: [x[1], p["f"] - x[1] ** 2])
    other = steer([Stage(smooth, 10, (2.0, 2.0), {"f": Input(degree=1)}, **moving, **EFFORT)], guess=found)
    assert found.cost == pytest.approx(other.cost, rel=1e-9)


def test_a_cost_at_the_end():
    """Far and gently: f = 1 - t, for a cost of -1/6."""
    far = {"end": lambda x, p: [], "final": lambda x, p: -x[0], "running": lambda x, p, q: p["f"] ** 2 / 2}
    found = steer([cart(**far)], guess=STRAIGHT)
    assert found.cost == pytest.approx(-1 / 6, abs=1e-10)
    assert found.legs[0].inputs(0.3)[0] == pytest.approx(0.7, abs=1e-8)


def test_free_parameters_and_final_costs():
    """Least largest force: full ahead and full back, 4 = largest force times time squared."""
    stage = cart(
        8, degree=0, running=lambda x, p, q: 0.0, final=lambda x, p: p["most"],
    )  # fmt: skip
    bounded = Stage(
        CART, 8, (1.0, 1.0), {"f": Input(lambda p: -p["most"], lambda p: p["most"])}, stage.start, stage.end,
        final=stage.final,
    )  # fmt: skip
    found = steer([bounded], guess=STRAIGHT, free={"most": (0.0, np.inf)})
    assert found.parameters["most"] == pytest.approx(4, abs=1e-8)
