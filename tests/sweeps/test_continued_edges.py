"""Edges beside continued orbits whose unknowns are closed forms."""

import numpy as np
import pytest

from orbits.sweeps.continued_edges import continued_edges

EDGE = 0.3137


def settled(points, near, further=False):
    """Orbits that end at a fold with the unknown 1 + sqrt(x - edge), which Newton's method finds from half to twice of
    it, motions beyond 0.7; with `further`, there are other orbits before the fold."""
    x = points[:, 0]
    with np.errstate(all="ignore"):
        us = np.where(x > EDGE, 1 + np.sqrt(x - EDGE), np.nan)
        reached = us > 0 if near is None else np.abs(np.log2(near[:, 0] / us)) < 1
    statuses = np.where(x > 0.7, "certified", "inadmissible").astype(object)
    statuses[~reached] = "inadmissible" if near is None and further else ""
    return statuses, np.where(reached, us, np.nan)[:, None], np.full(len(x), 1e-12)


def points_at(which: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The points of a row."""
    return np.column_stack([places, 2.0 + 0 * places])


@pytest.mark.parametrize(("start", "pair", "edge"), [
    (0.6, ("inadmissible", "no orbit"), EDGE), (0.9, ("certified", "inadmissible"), 0.7),
])  # fmt: skip
def test_an_edge_is_where_orbits_end_or_change(start, pair, edge):
    end = 0.0 if edge == EDGE else 0.5
    found = continued_edges(settled, points_at, np.array([start]), np.array([end]), np.array([pair], object), 1e-7)
    assert found == pytest.approx([edge], abs=1e-7)


def test_an_edge_that_a_search_does_not_confirm_is_none():
    """Beyond the edge there are other orbits, or the orbit at the start is another one."""
    starts, ends = np.array([0.6]), np.zeros(1)
    pair = np.array([("inadmissible", "no orbit")], object)
    assert np.isnan(continued_edges(lambda x, near: settled(x, near, True), points_at, starts, ends, pair, 1e-7)).all()
    other = np.array([("certified", "no orbit")], object)
    assert np.isnan(continued_edges(settled, points_at, starts, ends, other, 1e-7)).all()
