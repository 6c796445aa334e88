"""Multipliers of hops that return."""

import numpy as np
import pytest

from orbits.returns.periodic_launch import crossings, dominant, spectrum_of


def test_a_rotation_has_a_pair_on_the_unit_circle():
    angle = 0.7
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert spectrum_of(2.0 * rotation) == pytest.approx(2.0 * np.exp([1j * angle, -1j * angle]))
    assert dominant(2.0 * rotation) == pytest.approx(2.0)
    assert [crossings(size * rotation)[2] > 0 for size in (0.9, 1.1)] == [False, True]
    assert crossings(rotation)[2] == pytest.approx(0.0, abs=1e-14)
    assert crossings(np.diag([-1.0, 0.3]))[0] == crossings(np.diag([1.0, 0.3]))[1] == 0.0
    assert dominant(np.array([[-3.0]])) == -3.0
    assert np.isnan(dominant(np.full((2, 2), np.nan)))
