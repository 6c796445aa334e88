"""Fixed points of the return map, preimages of intervals under it, and the basin of its lossless hops."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import ArrayLike

from ..errors import FlowError, NoOrbit, whole_number
from ..flow.flow import flow_of
from ..flow.trajectory import Trajectory
from ..model.model import Reduction
from ..numerics.bernstein import piecewise_roots
from ..numerics.roots import enclosed_sign_changes, resolved
from ..periodic.find import certified_orbit, find
from ..periodic.formulations import equations_of
from ..periodic.orbit import Orbit
from .impacts import Impacts

# Where the map changes by less than this share between neighbouring numbers, it is continuous there.
JUMP = 1e-6
# The search for lossless orbits ends after this many families in a row without one in the range.
FURTHER = 3
# Launches in the grid on which lossless orbits are searched: per half oscillation, and at most.
PER_TURN, MOST_SAMPLES = 8, 2000
# A basin, which may have infinitely many intervals, is complete when a hop adds less than this share of the range.
SETTLED = 1e-5

# (lowest, highest) of each interval, ascending.
Intervals = list[tuple[float, float]]


@dataclass(frozen=True)
class FixedPoint:
    """A launch speed that comes back; kind "lossless" or "crossing", where the map crosses the identity line."""

    alpha: float
    kind: str


class ResolvedMap:
    """A return map on a grid of launch speeds that resolves it; `following` are the next ones, 0 where there are none.

    The grid, from `low` to `high`, is refined toward the lossless launch speeds, where the map has no slope, and toward
    its extrema: all of them, or with `identity` those that may touch the identity line.
    """

    def __init__(self, return_map: Callable, lossless: list, low: float, high: float, samples: int, identity: bool):
        distances, slope = np.geomspace(1e-12, high - low, 200), float(identity)
        beside = [alpha + side * distances for alpha in lossless for side in (-1, 1)]
        grid = np.concatenate([np.linspace(low, high, whole_number("samples", samples, "launches", 2)), *beside])
        grid = np.unique(grid[(grid >= low) & (grid <= high)])
        self.grid, values = resolved(lambda alpha: return_map(alpha).next - slope * alpha, grid, identity)
        self.following = or_zero(values + slope * self.grid)
        self.next = lambda alpha: or_zero(return_map(alpha).next)

    def crossings(self) -> np.ndarray:
        """Launch speeds (k,) at which the map crosses the identity line."""
        a, b, fa, fb = _sign_changes(lambda alpha, _: self.next(alpha) - alpha, self.grid, self.following - self.grid)
        continuous = np.maximum(np.abs(fa), np.abs(fb)) <= JUMP * a
        return np.where(np.abs(fa) <= np.abs(fb), a, b)[continuous]

    def preimages(self, edges: Intervals) -> Intervals:
        """The intervals of launch speeds whose next one lies in one of `edges`."""
        levels, grid = np.unique(edges), self.grid
        excess = self.following[:, None] - levels
        i, k = np.nonzero((excess[1:] >= 0) != (excess[:-1] >= 0))
        above = grid[i], grid[i + 1], excess[i, k], excess[i + 1, k]
        ends, *_ = enclosed_sign_changes(lambda alpha, which: self.next(alpha) - levels[k[which]], *above)
        ends = np.unique([grid[0], *ends, grid[-1]])
        ends = ends[np.append(True, np.diff(ends) > 1e-15 * ends[1:])]
        inside = within(self.next(0.5 * (ends[1:] + ends[:-1])), edges)
        switches = np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]])))
        return list(zip(ends[switches[::2]].tolist(), ends[switches[1::2]].tolist(), strict=True))

    def basin(self, lossless: list[float], hops: int, width: float) -> Intervals:
        """The intervals of launch speeds that come to one of the `lossless` ones, of which the lowest begins the grid,
        within `hops` hops, in a range of this width."""
        pairs = zip(lossless, [*lossless[1:], float(self.grid[-1])], strict=True)
        intervals, total = [(star, self._end_of_descent(star, end)) for star, end in pairs], 0.0
        for _ in range(hops):
            intervals = self.preimages(intervals)
            total, last = float(np.diff(intervals).sum()), total
            if total - last <= SETTLED * width:
                break
        return intervals

    def _end_of_descent(self, star: float, end: float) -> float:
        """The launch speed from which on the map falls below the lossless one, `star`; `end` if not before."""
        grid, excess = self.grid, self.following - star
        i = np.flatnonzero((grid > star) & (grid < end) & (excess < 0))[:1]
        ends = grid[i - 1], grid[i], excess[i - 1], excess[i]
        return float(enclosed_sign_changes(lambda a, _: self.next(a) - star, *ends)[0][0]) if len(i) else end


def _sign_changes(function: Callable, grid: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, ...]:
    """`enclosed_sign_changes` of one function between neighbours of a grid, from its values there."""
    i = np.flatnonzero((values[1:] >= 0) != (values[:-1] >= 0))
    return enclosed_sign_changes(function, grid[i], grid[i + 1], values[i], values[i + 1])


def or_zero(speeds: np.ndarray) -> np.ndarray:
    """Launch speeds with 0 in place of NaN."""
    return np.nan_to_num(speeds, nan=0.0)


def lossless_speeds(impacts: Impacts, low: float, high: float) -> list[float]:
    """Launch speeds from `low` to `high` of the lossless orbits that are motions, ascending."""
    if not impacts.model.conservative:
        return []
    if (reduction := impacts.model.reduction) and not reduction.exact:
        orbits = _all_orbits(impacts, reduction, low, high)
    else:
        orbits = _orbits_of_families(impacts, high)
    return sorted({orbit.alpha for orbit in orbits if low <= orbit.alpha <= high and orbit.admissible})


def _orbits_of_families(impacts: Impacts, high: float) -> Iterator[Orbit]:
    """The orbit that `find` gives of each family, until several in a row lie beyond `high` or do not exist."""
    beyond = 0
    for family in count(1):
        try:
            orbit = find(impacts.machine, family)
        except NoOrbit:
            orbit = None
        beyond = 0 if orbit and orbit.alpha <= high else beyond + 1
        if beyond > FURTHER:
            return
        if orbit and not beyond:
            yield orbit


def _all_orbits(impacts: Impacts, reduction: Reduction, low: float, high: float) -> Iterator[Orbit]:
    """All orbits under constant gravity: half a flight lasts the time alpha, until the reduced motion turns."""
    model, p, names = impacts.model, impacts.p, tuple(impacts.values)
    flow = flow_of(reduction.statement.arcs[0].phase, names)
    (liftoff,) = model.release(np.array([low]), impacts.values)

    def half_flight(alpha: float) -> Trajectory | None:
        try:
            return flow.run([liftoff, alpha], p, alpha)[0]
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
    equations = equations_of(model, "relative", names)
    for alpha in _sign_changes(end_speed, grid, values)[0]:
        began = time.perf_counter()
        try:
            u, evaluation = equations.newton([liftoff, alpha], p)
            yield certified_orbit(impacts.machine, "relative", u, evaluation, began=began)
        except NoOrbit:
            continue


def within(values: np.ndarray, edges: ArrayLike) -> np.ndarray:
    """Whether values (m,) lie in one of several intervals that ascend and do not overlap."""
    pairs = np.reshape(edges, (-1, 2))
    i = np.searchsorted(pairs[:, 0], values, side="right") - 1
    return (i >= 0) & (values <= pairs[i, 1]) if len(pairs) else np.zeros(len(values), bool)
