"""Zeros and stationary points of functions on motions."""

import numpy as np
import pytest

from orbits.flow import Trajectories
from orbits.model import Affine
from orbits.periodic.extrema_and_zeros import Sought, turns_and_zeros


@pytest.mark.parametrize("by_rate", [False, True])
@pytest.mark.parametrize("count", [40, 600])
def test_zeros_at_joints_of_steps(count, by_rate):
    """A sum of three rows falls, and cancels to its rounding where the two steps of each motion join: it has one zero,
    whichever sign the rounding gives it, among few steps and among many."""
    rng, slope, place = np.random.default_rng(0), -0.3, int(by_rate)
    weights = rng.uniform(0.5, 2.0, 3)
    joint = rng.uniform(0.5, 2.0, (count, 3))
    joint[:, 2] = -(weights[0] * joint[:, 0] + weights[1] * joint[:, 1]) / weights[2]
    joint[::2, 2] = np.nextafter(joint[::2, 2], -9.0)
    c = np.zeros((2 * count, 3, 29))
    c[::2, :, place] = c[1::2, :, place] = joint
    c[::2, 0, place] -= slope
    c[:, 0, place + 1] = slope / (place + 1)
    motions = Trajectories(np.tile([0.0, 1.0], count), np.full(count, 2.0), c, np.full(count, 2), ("a", "b", "c"))
    found = turns_and_zeros({"sum": Sought(motions, Affine(tuple(weights)), by_rate)})["sum"]
    assert np.array_equal(found.owner, np.arange(count))
    assert found.times == pytest.approx(np.ones(count), rel=1e-14)
    assert not found.rising.any()
