"""The step of a vector field as an expression has its order."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits.flow import runge_kutta_step
from orbits.flow.vector_field import VectorField


def test_order_eight():
    x, p, h = ca.SX.sym("x", 2), ca.SX.sym("p", 0), ca.SX.sym("h")
    field = ca.Function("field", [x, p], [ca.vertcat(x[1], -ca.sin(x[0])), ca.SX(0, 1)])
    step = ca.Function("step", [x, h], [runge_kutta_step(VectorField(field, x, p), x, h)])
    exact = solve_ivp(lambda t, x: [x[1], -np.sin(x[0])], (0, 2), [1.0, 1.5], "DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
    errors = []
    for count in (8, 16, 32):
        state = ca.DM([1.0, 1.5])
        for _ in range(count):
            state = step(state, 2 / count)
        errors.append(np.abs(np.array(state).ravel() - exact).max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(8, abs=0.7)
