"""What Ipopt could not do is said."""

import casadi as ca
import numpy as np
import pytest

from orbits import NoOrbit
from orbits.symbolic import EquationSolver


def test_ipopt_reports_what_it_could_not_do():
    z = ca.MX.sym("z", 2)
    p, free = ca.MX.sym("p"), np.full(2, -np.inf)
    solve = EquationSolver(z, p, ca.vertcat(z[0] ** 2 + p, z[1]))
    with pytest.raises(NoOrbit, match="equations off by"):
        solve(np.ones(2), free, np.ones(2), np.array([1.0]))
    assert solve(np.ones(2), free, np.ones(2), np.array([-4.0])) == pytest.approx([2.0, 0.0], rel=1e-14, abs=1e-14)
    assert solve(np.ones(2), free, np.full(2, 3.0), np.array([-2.0])) == pytest.approx(
        [np.sqrt(2.0), 0.0], rel=1e-14, abs=1e-14
    )
