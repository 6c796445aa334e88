"""The linearised optimality conditions against dense linear algebra."""

import numpy as np
import pytest
import scipy.sparse as sp

from orbits.curves import SecondDerivatives
from orbits.curves.kkt_conditions import linearised


@pytest.mark.parametrize("seed", range(6))
def test_second_order_conditions_are_those_on_the_null_space(seed):
    """Against the eigenvalues of the projected Hessian, for minima and saddles, with bounds that are active."""
    rng = np.random.default_rng(seed)
    hessian, rows = rng.standard_normal((7, 7)) + 1.5 * np.eye(7), rng.standard_normal((3, 7))
    hessian = hessian + hessian.T
    active = np.vstack([rows, np.eye(7)[2]])
    null = np.linalg.svd(active)[2][4:].T
    expected = int((np.linalg.eigvalsh(null.T @ hessian @ null) < 0).sum())
    matrices = (sp.csc_matrix(rows), sp.csc_matrix(hessian)) if seed % 2 else (rows, hessian)
    second = SecondDerivatives(*matrices, rng.standard_normal(7), np.zeros(3))
    conditions = linearised(second, np.array([2, 7, 8, 9]), {})
    assert conditions.negative == expected
    border = np.append(second.gradient_slope, np.zeros(4))
    matrix = np.block([[hessian, active.T], [active, np.zeros((4, 4))]])
    matrix = matrix[np.ix_([*range(7), 10, 7, 8, 9], [*range(7), 10, 7, 8, 9])]
    for held in (3, 8, 11):  # an unknown, a multiplier, and the parameter
        whole = np.vstack([np.hstack([matrix, border[:, None]]), np.eye(12)[held]])
        rights = rng.standard_normal((12, 2))
        assert conditions.solve(rights, held) == pytest.approx(np.linalg.solve(whole, rights), abs=1e-7)
