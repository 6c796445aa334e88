"""Boundaries on a grid of statuses that are known in closed form: inside a circle there are motions."""

import numpy as np
import pytest

from orbits.sweeps.boundaries import bisected, on_curves

RADIUS = 0.4
SHARES = np.linspace(0, 1, 6), np.linspace(0, 1, 5)


def statuses_at(points: np.ndarray) -> np.ndarray:
    inside = np.hypot(points[:, 0] - 0.5, points[:, 1] - 0.5) < RADIUS
    return np.where(inside, "certified", "no orbit").astype(object)


STATUSES = statuses_at(np.stack(np.meshgrid(*SHARES, indexing="ij"), axis=-1).reshape(-1, 2)).reshape(6, 5)


def right_of(y: float) -> float:
    """Where the circle passes a row on the right."""
    return 0.5 + float(np.sqrt(RADIUS**2 - (y - 0.5) ** 2))


def test_passings_of_a_curve_are_confirmed_on_both_sides():
    """The circle itself is a boundary; a curve that is none, and one where the statuses do not change, are not."""
    passed = {(4, 2, True): [right_of(0.5)], (4, 1, True): [0.95], (2, 3, True): [0.5]}
    found = on_curves(STATUSES, SHARES, passed, statuses_at)
    assert found[4, 2, True] == [(right_of(0.5), "certified", "no orbit", True)]
    assert found[2, 3, True] == []
    assert (4, 1, True) not in found


def test_all_other_boundaries_are_bisected():
    known = on_curves(STATUSES, SHARES, {(4, 2, True): [right_of(0.5)]}, statuses_at)
    found, stopped = bisected(STATUSES, SHARES, True, statuses_at, lambda state: None, known)
    assert stopped == ""
    assert np.hypot(*(found.points - 0.5).T) == pytest.approx(RADIUS, abs=1e-6)
    assert np.count_nonzero(found.exact) == 1
    assert found.located.all()
    rows, _ = bisected(STATUSES, SHARES, False, statuses_at, lambda state: None, known)
    assert (rows.located == rows.in_row).all()
