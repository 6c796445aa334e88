"""The curve of periodic launches, against a map in closed form."""

import numpy as np
import pytest
from return_maps import LOGISTIC

from orbits.returns.launch_curve import LaunchCurve


def test_the_equation_vanishes_at_periodic_launches():
    """Fixed points 1 - 1/r of the logistic map, with its slopes 1 - (2 - r) across and a (1 - a) along."""
    curve, r = LaunchCurve(LOGISTIC, (0.1, 0.9), 1), 2.8
    found = curve.equation(np.array([[1 - 1 / r, r]]))
    assert found.residual[0, 0] == pytest.approx(0.0, abs=1e-15)
    assert found.jacobian[0, 0] == pytest.approx([1 - r, (1 - 1 / r) / r], rel=1e-5)
