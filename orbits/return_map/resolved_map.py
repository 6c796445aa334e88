"""A return map on a grid that resolves it: its crossings of the identity line, preimages of intervals, and basins.

The map has no slope at lossless launches and humps between them, so that a grid is refined there. The lossless launches
are found first: all that a search of launch speeds shows, and of machines that step those of `find`.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count

import numpy as np
from numpy.typing import ArrayLike

from ..errors import FlowError, NoOrbit
from ..flow.flow import flow_of
from ..numerics.polynomial_roots import piecewise_roots
from ..numerics.roots import enclosed_sign_changes, resolved
from ..periodic.certified import certified_orbit, solve_from
from ..periodic.find import find, find_all
from ..periodic.orbit import Orbit
from ..result import Progress
from ..running import interrupts
from ..simulation.impacts import Impacts

SLOWEST_LOSSLESS = 1e-3  # below this, in the units of the machine, no lossless launch is searched
JUMP = 1e-6  # where the map changes by less than this share between neighbouring numbers, it is continuous there
ROUNDED = 1e-13  # a smaller change of the launch speed by a hop, as a share of it, may be rounding
MOST_FAMILIES = 12  # of machines that step: their launch speeds converge
FURTHER = 3  # the search for lossless orbits ends after this many families in a row without one in the range
PER_TURN, MOST_SAMPLES = 8, 2000  # launches in the grid searched for lossless orbits: per half oscillation, and at most
SETTLED = 1e-5  # a basin, maybe of infinitely many intervals, is complete when a hop adds a smaller share of the range
# (lowest, highest) of each interval, ascending.
Intervals = list[tuple[float, float]]


class ResolvedMap:
    """A return map on a grid of launch speeds that resolves it; `following` are the next ones, 0 where there are none.

    The grid, from `low` to `high`, is refined toward the lossless launch speeds, where the map has no slope, and toward
    its extrema: all of them, or with `identity` only those that may touch the identity line. Meanwhile `progress` is 0.
    """

    def __init__(
        self, return_map: Callable, lossless: list, low: float, high: float, samples: int, identity: bool,
        progress: Progress = None,
    ):  # fmt: skip
        def above(alpha: np.ndarray) -> np.ndarray:
            if progress:
                progress(0.0)
            return return_map(alpha).next - slope * alpha

        distances, slope = np.geomspace(1e-12, high - low, 200), float(identity)
        beside = [alpha + side * distances for alpha in lossless for side in (-1, 1)]
        grid = np.concatenate([np.linspace(low, high, samples), *beside])
        grid = np.unique(grid[(grid >= low) & (grid <= high)])
        self.grid, values = resolved(above, grid, identity)
        self.following = np.nan_to_num(values + slope * self.grid)
        self.next = lambda alpha: np.nan_to_num(return_map(alpha).next)
        self._passages = dict[float, np.ndarray]()  # where the map passes a level: the levels of a basin recur

    def crossings(self) -> np.ndarray:
        """Launch speeds (k,) at which the map crosses the identity line."""
        excess = self.following - self.grid
        # Where rounding decides the sign at a point of the grid, the map may cross the line on either side.
        excess = np.where(np.abs(excess) <= ROUNDED * self.grid, np.abs(excess), excess)
        a, b, fa, fb = _sign_changes(lambda alpha, _: self.next(alpha) - alpha, self.grid, excess)
        continuous = np.maximum(np.abs(fa), np.abs(fb)) <= JUMP * a
        return np.where(np.abs(fa) <= np.abs(fb), a, b)[continuous]

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


def _sign_changes(function: Callable, grid: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, ...]:
    """`enclosed_sign_changes` of one function between neighbours of a grid, from its values there."""
    i = np.flatnonzero((values[1:] >= 0) != (values[:-1] >= 0))
    return enclosed_sign_changes(function, grid[i], grid[i + 1], values[i], values[i + 1])


def lossless_speeds(impacts: Impacts, low: float, high: float) -> list[float]:
    """Launch speeds from `low` to `high` of the lossless orbits that are motions, ascending."""
    if not impacts.model.conservative or impacts.descends:
        return []
    model = impacts.model
    with interrupts.deferred():
        if model.reduction and not model.reduction.exact:
            orbits: Iterator[Orbit] = _all_orbits(impacts, low, high)
        elif model.plain and model.search is not None:
            orbits = _searched_orbits(impacts, high)
        else:
            orbits = _orbits_of_families(impacts, low, high)
        return sorted({orbit.alpha for orbit in orbits if low <= orbit.alpha <= high and orbit.admissible})


def _searched_orbits(impacts: Impacts, high: float) -> Iterator[Orbit]:
    """All orbits of each family up to `high`, until several families in a row have none there."""
    beyond, family = 0, 0
    while beyond <= FURTHER:
        interrupts.heed()
        beyond, family = beyond + 1, family + 1
        with suppress(NoOrbit):
            yield from find_all(impacts.machine, family=family, fastest=high)
            beyond = 0


def _orbits_of_families(impacts: Impacts, low: float, high: float) -> Iterator[Orbit]:
    """The orbit that `find` returns for each family, until several in a row lie beyond `high` or do not exist. Of a
    machine that steps the launch speeds may fall with the family, and they converge: there until several lie beyond
    `low` or `high`, of so many families at most."""
    beyond, steps, last = 0, not impacts.model.plain, low
    for family in range(1, MOST_FAMILIES + 1) if steps else count(1):
        interrupts.heed()
        try:
            orbit = find(impacts.machine, family)
        except NoOrbit:
            orbit = None
        falls = steps and orbit is not None and low > orbit.alpha < last
        beyond = 0 if orbit and orbit.alpha <= high and not falls else beyond + 1
        last = orbit.alpha if orbit else last
        if beyond > FURTHER:
            return
        if orbit and not beyond:
            yield orbit


def _all_orbits(impacts, low, high):
    """All orbits under constant gravity: half a flight lasts a known time, until the reduced motion turns."""
    model, p, names, arc = impacts.model, impacts.p, tuple(impacts.values), impacts.model.reduction.statement.arcs[0]
    flow, (liftoff,) = flow_of(arc.phase, names), model.release(np.array([low]), impacts.values)

    def half_flight(alpha):
        u = {"liftoff": liftoff, "alpha": alpha}
        try:
            return flow.run(arc.start(u, [], impacts.values), p, float(arc.duration(u, impacts.values)))[0]
        except FlowError:
            return None

    def end_speed(alphas, which=None):
        return np.array([0.0 if (path := half_flight(alpha)) is None else path.end[1] for alpha in alphas])

    half_oscillations = [
        np.diff([path.times[i] + t for i, t in piecewise_roots(path.coefficients[:, 1], path.steps)])
        for alpha in np.geomspace(low, high, 5)
        if (path := half_flight(alpha)) is not None
    ]
    shortest = max(np.concatenate([[high - low], *half_oscillations]).min(), (high - low) / MOST_SAMPLES)
    grid, values = resolved(end_speed, np.linspace(low, high, 2 + int(PER_TURN * (high - low) / shortest)), True)
    for alpha in _sign_changes(end_speed, grid, values)[0]:
        began = time.perf_counter()
        try:
            solved = solve_from(impacts.machine, "relative", np.array([liftoff, alpha]))
            yield certified_orbit(impacts.machine, solved, began=began)
        except NoOrbit:
            continue


def within(values: np.ndarray, edges: ArrayLike) -> np.ndarray:
    """Whether values (m,) lie in one of several ascending, disjoint intervals."""
    pairs = np.reshape(edges, (-1, 2))
    i = np.searchsorted(pairs[:, 0], values, side="right") - 1
    return (i >= 0) & (values <= pairs[i, 1]) if len(pairs) else np.zeros(len(values), bool)
