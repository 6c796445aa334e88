"""Sobol's sequence against SciPy's, and against what it is for."""

import numpy as np
import pytest
from scipy.stats import qmc

from orbits.numerics import sobol_points
from orbits.numerics.sobol import DIRECTIONS

# One more dimension than there are direction numbers is SciPy's own.
MOST = len(DIRECTIONS) + 2


@pytest.mark.parametrize("dimensions", [1, 2, 5, MOST - 1, MOST])
@pytest.mark.parametrize("seed", [0, 7])
def test_the_points_are_those_of_scipy(dimensions, seed):
    expected = qmc.Sobol(dimensions, seed=seed).random(256)
    np.testing.assert_array_equal(sobol_points(256, dimensions, seed), expected)
    np.testing.assert_array_equal(sobol_points(100, dimensions, seed), expected[:100])
    np.testing.assert_array_equal(sobol_points(64, dimensions, seed, 128), expected[128:192])


def test_each_part_of_a_square_has_as_many_points():
    """256 scrambled points are a (0, 8, 2)-net: one in each elementary rectangle of area 1/256."""
    points = sobol_points(256, 2, 3)
    for bits in range(9):
        cells = np.floor(points * [2**bits, 2 ** (8 - bits)]).astype(int)
        assert len(np.unique(cells, axis=0)) == 256
