"""The boundaries between neighbours on a grid, bracketed ever more closely: by curves of events that pass, from
continued orbits, and by bisection."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from ..running import TimeOver, interrupts
from .boundary_curves import BoundaryCurve
from .continued_edges import Settled, continued_edges
from .diagram_grid import Brackets, Grid
from .progress import SweepProgress

# Boundaries are located to this share of the range of a parameter.
LOCATED_TO = 1e-6
StatusesAt = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Boundaries:
    """The boundaries between neighbours on the grid: the nodes (k, 2) before each boundary by their indices along and
    across, whether it lies in a row (k,), else between two, the points (k, 2), the statuses (k, 2) before and behind,
    whether the point is located (k,), else it is the midpoint of the neighbours, and whether it lies on a curve of
    events (k,), so that it is exact."""

    in_row: np.ndarray
    located: np.ndarray
    exact: np.ndarray
    nodes: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), int))
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    statuses: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), str))

    @classmethod
    def of(cls, grid: Grid, found: Brackets, both_ways: bool) -> "Boundaries":
        """The boundaries in brackets, at their middles."""
        located = (found.in_row | both_ways) & (found.high - found.low <= LOCATED_TO)
        points = grid.points(found.nodes, found.in_row, 0.5 * (found.low + found.high))
        return cls(found.in_row, located, found.exact, found.nodes, points, found.statuses)


def cut_by_curves(
    grid: Grid, curves: Sequence[BoundaryCurve], both_ways: bool, statuses_at: StatusesAt
) -> tuple[Brackets, int]:
    """The brackets of the grid's boundaries, those on curves of events exact; and the number of places at which curves
    pass the grid's sides.

    A side is divided at both sides of each place where a curve passes it, by the statuses of the orbits there.
    """
    cuts = _passed_sides(grid, curves, both_ways)
    whole = grid.brackets()
    each = zip(whole.nodes.tolist(), whole.in_row.tolist(), strict=True)
    whole = whole.take(np.array([(*node, in_row) not in cuts for node, in_row in each], bool))
    if not cuts:
        return whole, 0
    sides = grid.sides(np.array([cut[:2] for cut in cuts]), np.array([cut[2] for cut in cuts]))
    stations = list[tuple[int, float, float]]()  # side, share, and the place of the curve next to it
    for k, places in enumerate(cuts.values()):
        ends = [sides.low[k], *places, sides.high[k]]
        stations.append((k, ends[0], np.nan))
        for below, place, above in zip(ends, places, ends[2:], strict=False):
            two = max(place - LOCATED_TO, 0.5 * (below + place)), min(place + LOCATED_TO, 0.5 * (place + above))
            stations += [(k, share, place) for share in two]
        stations.append((k, ends[-1], np.nan))
    which, shares, curve = (np.array(column) for column in zip(*stations, strict=True))
    statuses, beside = np.empty(len(which), object), np.isfinite(curve)
    nodes, in_row = sides.nodes[which], sides.in_row[which]
    statuses[~beside] = sides.statuses.ravel()
    statuses[beside] = statuses_at(grid.points(nodes[beside], in_row[beside], shares[beside]))
    first = np.flatnonzero((which[:-1] == which[1:]) & (statuses[:-1] != statuses[1:]))
    exact, pairs = np.equal(curve[first], curve[first + 1]), np.column_stack([statuses[first], statuses[first + 1]])
    low, high = (np.where(exact, curve[first], shares[at]) for at in (first, first + 1))
    return whole.and_also(Brackets(nodes[first], in_row[first], low, high, pairs, exact)), int(beside.sum()) // 2


def _passed_sides(
    grid: Grid, curves: Sequence[BoundaryCurve], both_ways: bool
) -> dict[tuple[int, int, bool], list[float]]:
    """The shares, ascending, at which curves pass the sides of cells, by the node before a side and whether it lies in
    a row: of those in rows, and with `both_ways` of those between rows."""
    found = dict[tuple[int, int, bool], list[float]]()
    for across, along in ((1, 0), (0, 1))[: 1 + both_ways]:
        each, own = [curve.passings(across, grid.values[across]) for curve in curves], grid.shares[along]
        for k in range(len(grid.values[across])):
            for share in sorted({grid.axes[along].share(place) for places in each for place in places[k]}):
                before = int(np.searchsorted(own, share, side="right")) - 1
                if 0 <= before < len(own) - 1:
                    found.setdefault((before, k, True) if across else (k, before, False), []).append(share)
    return found


def by_continuation(grid: Grid, found: Brackets, both_ways: bool, settled: Settled) -> Brackets:
    """The brackets, closed where the boundary is found from continued orbits."""
    which = np.flatnonzero(~found.exact & (found.in_row | both_ways) & found.orbits.any(1))
    if len(which):
        some = found.take(which)
        turned = ~some.orbits[:, 0]
        ways = np.where(turned, some.high, some.low), np.where(turned, some.low, some.high)
        pairs = np.where(turned[:, None], some.statuses[:, ::-1], some.statuses)
        points_at = lambda rows, shares: grid.points(some.nodes[rows], some.in_row[rows], shares)  # noqa: E731
        edges = continued_edges(settled, points_at, *ways, pairs, LOCATED_TO)
        low, high = (np.copy(each) for each in (found.low, found.high))
        low[which], high[which] = (np.where(np.isfinite(edges), edges, each[which]) for each in (low, high))
        return found._replace(low=low, high=high)
    return found


def bisected(
    grid: Grid, found: Brackets, both_ways: bool, statuses_at: StatusesAt, show: Callable[[SweepProgress], None]
) -> tuple[Brackets, str]:
    """The brackets, bisected by the statuses of orbits; and why that was stopped before its end, or "". Where a third
    status is met, there are two boundaries."""
    began, done, counts, found = perf_counter(), 0, Counter[str](), Brackets(*map(np.copy, found))
    while len(wide := np.flatnonzero((found.high - found.low > LOCATED_TO) & (found.in_row | both_ways))):
        nodes, in_row, low, high, pairs, exact = found
        middle = 0.5 * (low + high)[wide]
        try:
            interrupts.heed()
            here = statuses_at(grid.points(nodes[wide], in_row[wide], middle))
        except TimeOver as over:
            return found, str(over)
        before, behind = here == pairs[wide, 0], here == pairs[wide, 1]
        # A third status divides a bracket into two; the second one, which begins with that status, is appended.
        other = wide[third := ~(before | behind)]
        ends = middle[third], high[other], np.column_stack([here[third], pairs[other, 1]])
        added = Brackets(nodes[other], in_row[other], *ends, exact[other])
        low[wide[before]], high[wide[~before]], pairs[other, 1] = middle[before], middle[~before], here[third]
        found = found.and_also(added)
        done, counts = done + len(wide), counts + Counter(here.tolist())
        rounds = np.log2(np.maximum((found.high - found.low)[found.in_row | both_ways] / LOCATED_TO, 1.0))
        left, seconds = int(np.ceil(rounds).sum()), perf_counter() - began
        show(SweepProgress(done, done + left, dict(counts), seconds, left * seconds / done))
    return found, ""
