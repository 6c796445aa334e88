"""Rows at ascending extensions, and the mean of several curves."""

import numpy as np
import pytest

from orbits import InputError
from problems.recordings.measured_rows import mean_of_curves, rows_at


def test_forces_at_one_extension_are_averaged_and_copies_count_once():
    rows = rows_at(np.array([1.0, 0.0, 1.0, 2.0, 3.0, 3.0]), np.array([4.0, 0.0, 6.0, 8.0, 9.0, 9.0]), "bench")
    assert rows.extensions.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert rows.forces.tolist() == [0.0, 5.0, 8.0, 9.0]
    assert (rows.weights.tolist(), rows.squares, rows.spare) == ([1.0, 2.0, 1.0, 1.0], 2.0, 1)
    with pytest.raises(InputError, match="bench: 3 different extensions"):
        rows_at(np.array([0.0, 1.0, 2.0, 2.0]), np.zeros(4), "bench")


def test_the_mean_of_three_lines():
    """At the extensions of that with the fewest rows, with three times the weight of one of their rows."""
    grids = np.linspace(0, 4, 9), np.linspace(-1, 5, 7), np.linspace(0, 4, 5)
    curves = [rows_at(r, slope * r, "bench") for r, slope in zip(grids, (1.0, 2.0, 6.0), strict=True)]
    mean = mean_of_curves(curves, "bench")
    assert mean.extensions.tolist() == grids[2].tolist()
    assert mean.forces == pytest.approx(3 * grids[2])
    assert mean.weights == pytest.approx(3.0)
    with pytest.raises(InputError, match="few extensions in common"):
        mean_of_curves([curves[2], rows_at(grids[2] + 3.0, grids[2], "bench")], "bench")
