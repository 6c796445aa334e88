"""A return map on a grid that resolves it: preimages of intervals, and basins.

The map has no slope at lossless launches and humps between them, so that a grid is refined there.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..numerics.roots import enclosed_sign_changes, resolved
from ..result import Progress
from .map_pieces import Intervals

SETTLED = 1e-5  # a basin, maybe of infinitely many intervals, is complete when a hop adds a smaller share of the range


class ResolvedMap:
    """A return map on a grid of launch speeds that resolves it; `following` are the next ones, 0 where there are none.

    The grid, from `low` to `high`, is refined toward the lossless launch speeds, where the map has no slope, and toward
    its extrema. Meanwhile `progress` is 0.
    """

    def __init__(
        self, return_map: Callable, lossless: list, low: float, high: float, samples: int, progress: Progress = None
    ):  # fmt: skip
        def following(alpha: np.ndarray) -> np.ndarray:
            if progress:
                progress(0.0)
            return return_map(alpha).next

        distances = np.geomspace(1e-12, high - low, 200)
        beside = [alpha + side * distances for alpha in lossless for side in (-1, 1)]
        grid = np.concatenate([np.linspace(low, high, samples), *beside])
        grid = np.unique(grid[(grid >= low) & (grid <= high)])
        self.grid, values = resolved(following, grid, False)
        self.following = np.nan_to_num(values)
        self.next = lambda alpha: np.nan_to_num(return_map(alpha).next)
        self._passages = dict[float, np.ndarray]()  # where the map passes a level: the levels of a basin recur

    def preimages(self, edges: Intervals) -> Intervals:
        """The intervals of launch speeds whose next one lies in one of `edges`."""
        levels, grid = np.unique(edges), self.grid
        new = levels[[level not in self._passages for level in levels.tolist()]]
        excess = self.following[:, None] - new
        i, k = np.nonzero((excess[1:] >= 0) != (excess[:-1] >= 0))
        above = grid[i], grid[i + 1], excess[i, k], excess[i + 1, k]
        ends, *_ = enclosed_sign_changes(lambda alpha, which: self.next(alpha) - new[k[which]], *above)
        self._passages |= {level: ends[k == j] for j, level in enumerate(new.tolist())}
        ends = np.concatenate([grid[[0, -1]], *(self._passages[level] for level in levels.tolist())])
        ends = np.unique(ends)
        ends = ends[np.append(True, np.diff(ends) > 1e-15 * ends[1:])]
        inside = within(self.next(0.5 * (ends[1:] + ends[:-1])), edges)
        switches = np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]])))
        return list(zip(ends[switches[::2]].tolist(), ends[switches[1::2]].tolist(), strict=True))

    def basin(
        self, lossless: list[float], hops: int, width: float, progress: Callable | None = None, only: int | None = None
    ) -> Intervals:
        """The intervals of launch speeds that come to one of the `lossless` ones within `hops` hops, in a range of this
        width; with `only` to the one with this index. The grid begins at the lowest lossless one."""
        pairs = zip(lossless, [*lossless[1:], float(self.grid[-1])], strict=True)
        intervals, total = [(star, self._end_of_basin(star, end)) for star, end in pairs], 0.0
        intervals = intervals if only is None else intervals[only : only + 1]
        for _ in range(hops):
            intervals = self.preimages(intervals)
            total, last = float(np.diff(intervals).sum()), total
            if progress:
                progress(min(total / width, 1.0))
            if total - last <= SETTLED * width:
                break
        return intervals

    def _end_of_basin(self, star: float, end: float) -> float:
        """The launch speed from which on the map falls below the lossless one, `star`; `end` if not before."""
        grid, excess = self.grid, self.following - star
        i = np.flatnonzero((grid > star) & (grid < end) & (excess < 0))[:1]
        ends = grid[i - 1], grid[i], excess[i - 1], excess[i]
        return float(enclosed_sign_changes(lambda a, _: self.next(a) - star, *ends)[0][0]) if len(i) else end


def within(values: np.ndarray, edges: ArrayLike) -> np.ndarray:
    """Whether values (m,) lie in one of several ascending, disjoint intervals."""
    pairs = np.reshape(edges, (-1, 2))
    i = np.searchsorted(pairs[:, 0], values, side="right") - 1
    return (i >= 0) & (values <= pairs[i, 1]) if len(pairs) else np.zeros(len(values), bool)
