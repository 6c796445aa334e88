"""Preimages of intervals of launch speeds, on the pieces of a return map near the ends of the intervals.

The map is resolved only where it may pass such an end, and where that takes too long, by the launches of a grid. What
the launches between two passages and borders do follows from one of them.
"""

from collections.abc import Callable, Sequence

import numpy as np

from ..numerics import enclosed_sign_changes, resolved
from .hops import Hops
from .itineraries import MonotoneBranches
from .map_pieces import Intervals, within
from .resolution import Resolving


class Passages:
    """The places where a map with an injection passes levels of the next launch speed, and what follows from them.

    hops_from : the map
    resolving : the search for its pieces without the injection
    """

    def __init__(self, hops_from: Callable[[np.ndarray], Hops], resolving: Resolving, inject: float = 0.0):
        self.hops_from, self.resolving, self.inject = hops_from, resolving, inject
        # Humps between the launches of the grid may pass a level.
        resolving.grid, self._following = resolved(self._next, resolving.grid, False)
        self._ends = np.array([resolving.low, resolving.high])  # of the range, and borders of the map
        self._passages = dict[float, np.ndarray]()  # where the map passes a level: the levels of a basin recur

    def preimages(self, edges: Intervals) -> Intervals:
        """The intervals of launch speeds, ascending, whose next one lies in one of the intervals `edges`."""
        levels = [level for level in np.unique(edges).tolist() if np.isfinite(level)]
        self._resolve(levels)
        ends = np.unique(np.concatenate([self._ends, *(self._passages[level] for level in levels)]))
        ends = ends[np.append(True, np.diff(ends) > 1e-15 * ends[1:])]
        inside = within(self._next(0.5 * (ends[1:] + ends[:-1])), edges)
        switches = np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]])))
        return list(zip(ends[switches[::2]].tolist(), ends[switches[1::2]].tolist(), strict=True))

    def _next(self, x: np.ndarray) -> np.ndarray:
        """The next launch speeds (m,), 0 where there are none."""
        return np.nan_to_num(self.hops_from(x).next)

    def _resolve(self, which: Sequence[float]) -> None:
        """Find where the map passes levels, ascending, and its borders near these places, unless they are known."""
        levels = np.array([level for level in which if level not in self._passages])
        if not len(levels):
            return
        search = self.resolving
        search.levels = levels - self.inject
        search.resolve()
        pieces = search.result()
        branches = MonotoneBranches.of(pieces, self.inject)
        low, high = np.sort(branches.following, axis=1).T
        level, branch = np.nonzero((low <= levels[:, None]) & (levels[:, None] <= high))
        places = branches.before(levels[level], branch)
        more, others = self._between_launches(levels, level, places)
        level, places = np.append(level, more), np.append(places, others)
        self._passages |= {x: places[level == i] for i, x in enumerate(levels.tolist())}
        self._ends = np.concatenate([self._ends[:2], [*search.cuts]])

    def _between_launches(
        self, levels: np.ndarray, known: np.ndarray, places: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where neighbours in the grid show that the map passes levels (k,) in addition to the known ones (p,) at
        places (p,), as it is not resolved there: the indices of the levels, and the places."""
        x, excess = self.resolving.grid, self._following[:, None] - levels
        i, k = np.nonzero((excess[1:] >= 0) != (excess[:-1] >= 0))
        new = ~np.isin(k * len(x) + i, known * len(x) + np.searchsorted(x, places, side="right") - 1)
        i, k = i[new], k[new]
        ends = x[i], x[i + 1], excess[i, k], excess[i + 1, k]
        return k, enclosed_sign_changes(lambda at, which: self._next(at) - levels[k[which]], *ends)[0]
