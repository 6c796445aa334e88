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


def test_the_middles_of_the_steps_of_a_coarse_rounding_lie_on_the_law():
    """2,000 rows rounded to 0.1, ten of them on a step; those of a level part stay as they are."""
    r = np.linspace(-10.0, 10.0, 2000)
    rows = rows_at(r, np.round(np.minimum(r, 5.0), 1), "bench")
    level = rows.extensions > 4.94
    assert np.count_nonzero(level) == pytest.approx(506, abs=2)
    off = (rows.forces - rows.extensions)[~level]
    assert np.count_nonzero(~level) == 150  # from -10.0 to 4.9
    assert np.abs(off[1:]).max() < 0.0051  # half the distance of two rows


def test_forces_that_are_not_stairs_stay():
    r = np.linspace(-1.0, 1.0, 60)
    for force in (np.round(r, 2), np.repeat([0.0, 1.0], 30), r + 0.0):
        assert len(rows_at(r, force, "bench").extensions) == 60
    assert len(rows_at(np.repeat(r, 2), np.repeat(r, 2), "bench").extensions) == 60
