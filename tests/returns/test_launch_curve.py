"""The curve of periodic launches, against differences and a map in closed form."""

import numpy as np
import pytest
from return_maps import LOGISTIC

from orbits.returns.cycles import MapsAlong
from orbits.returns.cycles_along import STEPS_OF_HOPS
from orbits.returns.launch_curve import LaunchCurve
from problems import Hopper


def test_the_equation_vanishes_at_periodic_launches():
    """Fixed points 1 - 1/r of the logistic map, with its slopes 1 - (2 - r) across and a (1 - a) along."""
    curve, r = LaunchCurve(LOGISTIC, (0.1, 0.9), 1), 2.8
    found = curve.equation(np.array([[1 - 1 / r, r]]))
    assert found.residual[0, 0] == pytest.approx(0.0, abs=1e-15)
    assert found.jacobian[0, 0] == pytest.approx([1 - r, (1 - 1 / r) / r], rel=1e-5)


def test_hops_with_errors_differ_from_those_without_by_about_these():
    """Of hops of period two along the mass ratio: the first calls take few steps of Newton's method. The launches are
    known better than stated; the derivatives are of hops before the last step, and of two in a row."""
    curve = LaunchCurve(MapsAlong(Hopper(), "mass_ratio", 0.9, 1.1, 0.09, 1000), (4.4, 4.7), 2)
    curve.equation(np.array([[4.58, 1.0]]), exact=True)
    rough, exact = (curve.equation(np.array([[4.581, 1.001]]), exact=exact) for exact in (False, True))
    assert 0 < rough.errors[0] <= STEPS_OF_HOPS.rough
    assert exact.errors[0] == 0
    assert rough.launches == pytest.approx(exact.launches, rel=rough.errors[0])
    assert rough.residual == pytest.approx(exact.residual, abs=rough.errors[0])
    for name in ("residual", "jacobian", "launches", "multipliers"):
        assert getattr(rough, name) == pytest.approx(getattr(exact, name), rel=10 * rough.errors[0], abs=1e-7)
    step = 1e-5 * curve.scale
    sides = [[curve.equation(np.array([[4.581, 1.001] + side * step * axis]), exact=True).residual[0, 0]
              for side in (-1, 1)] for axis in np.eye(2)]  # fmt: skip
    assert exact.jacobian[0, 0] == pytest.approx(np.diff(sides)[:, 0] / (2 * step), rel=1e-6, abs=1e-6)
