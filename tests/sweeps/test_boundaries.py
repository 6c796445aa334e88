"""Boundaries on a grid of statuses that are known in closed form: inside a circle there are motions."""

import numpy as np
import pytest

from orbits.sweeps.boundaries import Boundaries, bisected, cut_by_curves
from orbits.sweeps.boundary_curves import BoundaryCurve
from orbits.sweeps.designs import Axis
from orbits.sweeps.diagram_grid import Grid

RADIUS = 0.4
SHARES = np.linspace(0, 1, 6), np.linspace(0, 1, 5)


def statuses_at(points: np.ndarray) -> np.ndarray:
    inside = np.hypot(points[:, 0] - 0.5, points[:, 1] - 0.5) < RADIUS
    return np.where(inside, "certified", "no orbit").astype(object)


STATUSES = statuses_at(np.stack(np.meshgrid(*SHARES, indexing="ij"), axis=-1).reshape(-1, 2)).reshape(6, 5)
GRID = Grid(("x", "y"), (Axis(), Axis()), SHARES, SHARES, STATUSES)


def right_of(y: float) -> float:
    """Where the circle passes a row on the right."""
    return 0.5 + float(np.sqrt(RADIUS**2 - (y - 0.5) ** 2))


def passing(*points: tuple[float, float]) -> BoundaryCurve:
    """A curve that passes these places on rows."""
    return BoundaryCurve("fold", *map(tuple, zip(*points, strict=True)), "")


def test_curves_are_boundaries_where_the_statuses_beside_them_differ():
    """The circle itself is a boundary; a curve beside it, and one where the statuses do not change, are none."""
    curves = [passing((right_of(0.5), 0.5), (0.95, 0.25), (0.5, 0.75))]
    found, passed = cut_by_curves(GRID, curves, False, statuses_at)
    assert passed == 3
    assert found.exact.sum() == 1
    (share,), (pair,) = found.low[found.exact], found.statuses[found.exact].tolist()
    assert (share, pair) == (right_of(0.5), ["certified", "no orbit"])
    assert found.high[found.exact] == share
    each = zip(found.nodes.tolist(), found.in_row, found.low, found.high, strict=True)
    sides = {(i, j): (low, high) for (i, j), in_row, low, high in each if in_row}
    assert sides[4, 1] == (0.8, 0.95 - 1e-6)  # before a curve that is none
    assert (2, 3) not in sides
    assert len(found.nodes) == len(GRID.brackets().nodes)


def test_all_other_boundaries_are_bisected():
    cut, _ = cut_by_curves(GRID, [passing((right_of(0.5), 0.5))], True, statuses_at)
    found, stopped = bisected(GRID, cut, True, statuses_at, lambda state: None)
    boundaries = Boundaries.of(GRID, found, True)
    assert stopped == ""
    assert np.hypot(*(boundaries.points - 0.5).T) == pytest.approx(RADIUS, abs=1e-6)
    assert np.count_nonzero(boundaries.exact) == 1
    assert boundaries.located.all()
    cut, _ = cut_by_curves(GRID, [passing((right_of(0.5), 0.5))], False, statuses_at)
    rows = Boundaries.of(GRID, bisected(GRID, cut, False, statuses_at, lambda state: None)[0], False)
    assert (rows.located == rows.in_row).all()
