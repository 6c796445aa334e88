"""Launch speeds that resolve the turning points of an extension, against closed forms of its energy."""

import numpy as np
import pytest

from orbits.model.turning_speeds import turning_speeds


def test_turning_points_are_those_of_the_energy():
    """With the force r + b r^3, lifting off at 0, an extension r is reached with the speed sqrt(r^2 + b r^4/2)."""
    b, places = 0.3, list[np.ndarray]()

    def force(r):
        places.append(r)
        return r + b * r**3, 1 + 3 * b * r**2

    speeds, last = turning_speeds(force, 0.0, (-1e9, 1e9), 1.0, 50.0, 1000)
    r = np.abs(np.concatenate(places))
    assert last == 50.0
    assert np.abs(np.sqrt(r**2 + b * r**4 / 2)[:, None] - speeds).min(axis=0) == pytest.approx(0.0, abs=1e-9)
    turned = np.sqrt((np.sqrt(1 + 2 * b * speeds**2) - 1) / b)
    assert (np.diff(turned) < 0.25 * turned[1:] + 0.01).all()


def test_speeds_accumulate_beside_a_barrier():
    """The force sin r vanishes at pi: from rest at 0 the speed 2 leads there, and faster launches never turn."""
    speeds, _ = turning_speeds(lambda r: (np.sin(r), np.cos(r)), 0.0, (-np.inf, np.inf), 1.0, 50.0, 1000)
    assert 0 < (2 - speeds[speeds < 2]).min() < 1e-7
    assert 0 < (speeds[speeds > 2] - 2).min() < 1e-7


def test_waves_are_resolved_until_there_are_too_many():
    """Of the force r + sin(9 r)/3 each wave, 0.7 long, has turning points, as far as they suffice."""
    force = lambda r: (r + np.sin(9 * r) / 3, 1 + 3 * np.cos(9 * r))  # noqa: E731
    speeds, last = turning_speeds(force, 0.0, (-np.inf, np.inf), 1.0, 20.0, 1000)
    assert last == 20.0
    assert np.diff(speeds[speeds > 1]).max() < 0.35
    few, last = turning_speeds(force, 0.0, (-np.inf, np.inf), 1.0, 20.0, 100)
    assert few.max() <= last < 20.0
    assert np.diff(few[few > 1]).max() < 0.35
