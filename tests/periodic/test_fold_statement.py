"""The equations of a fold against a stored value."""

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
