"""Preimages of intervals under the return map, and the basin of its lossless hops."""

import numpy as np

from ..numerics.roots import enclosed_sign_changes
from .fixed_points import SpeedMap, or_zero

# A basin is complete when one more hop adds less than this share of the range: near mass ratio 1 a basin has
# infinitely many intervals, ever shorter.
SETTLED = 1e-5

# (lowest, highest) of each interval, ascending.
Intervals = list[tuple[float, float]]


def preimages(next_speeds: SpeedMap, edges: Intervals, grid: np.ndarray, following: np.ndarray) -> Intervals:
    """The intervals of launch speeds whose next one lies in one of the intervals `edges`, from a grid that resolves the
    map."""
    levels = np.unique(edges)
    excess = following[:, None] - levels
    i, k = np.nonzero((excess[1:] >= 0) != (excess[:-1] >= 0))
    ends, *_ = enclosed_sign_changes(
        lambda alpha, which: or_zero(next_speeds(alpha)) - levels[k[which]],
        grid[i], grid[i + 1], excess[i, k], excess[i + 1, k],
    )  # fmt: skip
    ends = np.unique([grid[0], *ends, grid[-1]])
    ends = ends[np.append(True, np.diff(ends) > 1e-15 * ends[1:])]
    inside = within(or_zero(next_speeds(0.5 * (ends[1:] + ends[:-1]))), edges)
    switches = np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]])))
    return list(zip(ends[switches[::2]].tolist(), ends[switches[1::2]].tolist(), strict=True))


def basin_of(
    next_speeds: SpeedMap, lossless: list[float], grid: np.ndarray, following: np.ndarray, hops: int, least: float
) -> Intervals:
    """The intervals of launch speeds that come to one of the `lossless` ones within `hops` hops, from a grid that
    resolves the map from the lowest of these on; the search ends once a hop adds no more than a length of `least`."""
    pairs = zip(lossless, [*lossless[1:], float(grid[-1])], strict=True)
    intervals = [(star, _end_of_descent(next_speeds, star, end, grid, following)) for star, end in pairs]
    total = 0.0
    for _ in range(hops):
        intervals = preimages(next_speeds, intervals, grid, following)
        total, last = float(np.diff(intervals).sum()), total
        if total - last <= least:
            break
    return intervals


def _end_of_descent(next_speeds: SpeedMap, star: float, end: float, grid, following) -> float:
    """The launch speed from which on the map falls below the lossless one, `star`; `end` where it does not before."""
    i, excess = np.flatnonzero((grid > star) & (grid < end) & (following < star))[:1], following - star
    if not len(i):
        return end
    above = lambda alpha, which: or_zero(next_speeds(alpha)) - star  # noqa: E731
    return float(enclosed_sign_changes(above, grid[i - 1], grid[i], excess[i - 1], excess[i])[0][0])


def within(values: np.ndarray, edges) -> np.ndarray:
    """Whether values (m,) lie in one of several intervals that ascend and do not overlap."""
    edges = np.reshape(edges, (-1, 2))
    i = np.searchsorted(edges[:, 0], values, side="right") - 1
    return (i >= 0) & (values <= edges[i, 1]) if len(edges) else np.zeros(len(values), bool)
