"""What Ipopt could not do is said."""

import casadi as ca
import numpy as np
import pytest

from orbits import NoOrbit
from orbits.symbolic import solve_equations


def test_ipopt_reports_what_it_could_not_do():
    z = ca.MX.sym("z", 2)
    with pytest.raises(NoOrbit, match="equations off by"):
        solve_equations(z, ca.vertcat(z[0] ** 2 + 1, z[1]), np.ones(2), np.full(2, -np.inf), np.ones(2))
