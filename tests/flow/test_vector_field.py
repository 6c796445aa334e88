"""The step of a vector field as an expression has its order."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits.flow import Flow, runge_kutta_step
from orbits.flow.vector_field import VectorField
from orbits.model import Phase


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


def test_what_drifts_is_what_nothing_else_depends_on():
    """A place with its speed, which a pendulum drives, against sensitivities that are all integrated."""
    states = ("x", "x'", "a", "a'")
    flow = Flow(Phase("flight", states, lambda x, p, q: [x[1], ca.sin(x[2]) * p["k"], x[3], -ca.sin(x[2])]), ("k",))
    drifting, matrix = flow.vector_field.drift
    assert drifting.tolist() == [True, True, False, False]
    assert matrix.tolist() == [[0, 1, 0, 0], [0] * 4, [0] * 4, [0] * 4]
    seeds, along = np.hstack([np.eye(4), np.zeros((4, 1))]), np.array([[0.0, 0.0, 0.0, 0.0, 1.0]])
    starts, ps = np.array([[0.0, 1.0, 0.4, 0.1], [1.0, 2.0, 0.1, 0.3]]), np.array([[1.5], [0.7]])
    motions, ends = flow.run_all(starts, ps, np.array([3.0, 5.0]), seeds, along)
    which, lanes, same = flow.run_lanes(starts, ps, np.array([3.0, 5.0]), seeds, along)
    assert {columns for columns, _ in flow.steppers} == {3}
    assert which.tolist() == [0, 1]
    assert np.array_equal(same, ends)
    assert np.array_equal(lanes.variations, motions.variations)
    for i, time in enumerate((3.0, 5.0)):
        assert ends[i] == pytest.approx(flow.run(starts[i], ps[i], time, seeds, along)[1], rel=1e-12, abs=1e-12)
        assert np.array_equal(motions[i].variations[:, 0, 1], motions[i].times[:-1])
    circle = Phase("circle", ("x", "y"), lambda x, p, q: [x[1], -x[0]])
    assert Flow(circle, ()).vector_field.drift is None
