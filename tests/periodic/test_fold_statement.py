"""The equations of a fold against a stored value and against differences of their residual."""

import numpy as np
import pytest

from orbits.model import Arc, Statement
from orbits.periodic import fold_statement
from orbits.shooting import Shooting
from problems import Hopper


def test_the_fold_of_a_scaled_landing_condition():
    """Thrown at m times the half flight: the value at m = 1.5 was computed elsewhere, to 16 digits."""
    spring = Hopper("cubic").model.reduction.statement.arcs[0]
    arc = Arc(
        spring.phase,
        start=lambda u, before, p: [u["liftoff"], p["m"] * u["alpha"]],
        duration=lambda u, p: u["alpha"],
        conditions=lambda u, x, p: [x[1]],
        guard=spring.guard,
    )
    statement = fold_statement(Statement("scaled", ("liftoff", "alpha"), (arc,), ("alpha",)), "beta")
    equations = Shooting(statement, ("mass_ratio", "beta", "m"))
    u = np.array([1.01105, 5.83222, 0.0, -0.0106952])
    for m in np.linspace(1.0, 1.5, 6):
        u, _ = equations.newton(u, np.array([1.0, 0.0, m]))
    assert u[-1] == pytest.approx(-0.004737752512088, abs=1e-14)


@pytest.mark.parametrize("method", ["relative", "half orbit"])
def test_second_derivatives_are_exact(method):
    """The Jacobian of the fold's equations against differences of its residual."""
    machine = Hopper("cubic", rest_length=20.0, parameters={"beta": -0.01})
    from orbits.shooting import equations_of

    names = tuple(machine.values)
    statement = fold_statement(equations_of(machine.model, method, names).statement, "beta")
    equations = Shooting(statement, names)
    known = {"liftoff": 1.01, "alpha": 5.8, "duration": 5.7, "dliftoff": 0.1, "dduration": 0.9, "beta": -0.0106}
    u = np.array([known[name] for name in statement.unknowns])
    p = np.array(list(machine.values.values()))
    jacobian = equations.evaluate(u, p).jacobian
    for j in range(len(u)):
        step = 1e-6 * np.eye(len(u))[j]
        difference = equations.evaluate(u + step, p).residual - equations.evaluate(u - step, p).residual
        assert jacobian[:, j] == pytest.approx(difference / 2e-6, rel=1e-5, abs=1e-5)
