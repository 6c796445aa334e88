"""The boundaries between neighbours on a grid: where curves of events pass, beside orbits that are continued, and by
bisection."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..design.designs_at_once import CONTINUED_STATUSES
from ..running import interrupts
from ..running.time_limit import TimeOver
from .boundary_curves import BoundaryCurve, Box
from .continued_edges import Settled, continued_edges
from .designs import Axis
from .progress import SweepProgress

# Boundaries are located to this share of the range of a parameter.
LOCATED_TO = 1e-6
# Statuses of members that have an orbit, the first of them a motion.
WITH_ORBIT = ("certified", "inadmissible")
# A side of a cell: the indices of the node before it along and across, and whether it lies in a row.
Side: TypeAlias = tuple[int, int, bool]
# The shares (m,) of the ranges along and (n,) across at which the nodes lie.
Shares: TypeAlias = tuple[np.ndarray, np.ndarray]


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


class Passing(NamedTuple):
    """A boundary on a side of a cell: its share of the range, the statuses before and behind it, and whether it lies on
    a curve of events."""

    share: float
    before: str
    behind: str
    exact: bool


class _SidesLeft(NamedTuple):
    """Sides of cells whose ends have different statuses: the nodes before (k, 2), whether they lie in rows (k,), the
    points at both ends (k, 2), in shares, and the statuses there (k, 2)."""

    nodes: np.ndarray
    in_row: np.ndarray
    low: np.ndarray
    high: np.ndarray
    statuses: np.ndarray


def _sides_between(statuses: np.ndarray, shares: Shares, known: Mapping[Side, Any]) -> _SidesLeft:
    """The sides between nodes of different statuses (m, n) whose boundaries are not known."""
    nodes = np.concatenate(differing := [np.argwhere(np.diff(codes_of(statuses), axis=axis)) for axis in (0, 1)])
    in_row = np.repeat([True, False], list(map(len, differing)))
    each = zip(nodes.tolist(), in_row.tolist(), strict=True)
    left = np.array([(*node, along) not in known for node, along in each], bool)
    nodes, in_row = nodes[left], in_row[left]
    steps = np.where(in_row[:, None], [1, 0], [0, 1])
    low, high = (np.column_stack([share[k] for share, k in zip(shares, at.T, strict=True)])
                 for at in (nodes, nodes + steps))  # fmt: skip
    return _SidesLeft(
        nodes, in_row, low, high, np.column_stack([statuses[tuple(at.T)] for at in (nodes, nodes + steps)])
    )


def passed_sides(
    box: Box, curves: Sequence[BoundaryCurve], shares: Shares, scales: Sequence[Axis], both_ways: bool
) -> dict[Side, list[float]]:
    """The shares, ascending, at which curves pass the sides of the grid's cells: those in rows, and with `both_ways`
    those between rows."""
    found = dict[Side, list[float]]()
    for across, lines in ((1, box.rows), (0, box.places))[: 1 + both_ways]:
        each, own = [curve.passings(across, lines) for curve in curves], shares[1 - across]
        for k in range(len(lines)):
            for share in sorted({scales[1 - across].share(place) for places in each for place in places[k]}):
                before = int(np.searchsorted(own, share, side="right")) - 1
                if 0 <= before < len(own) - 1:
                    found.setdefault((before, k, True) if across else (k, before, False), []).append(share)
    return found


def on_curves(
    statuses: np.ndarray, shares: Shares, passed: Mapping[Side, Sequence[float]],
    statuses_at: Callable[[np.ndarray], np.ndarray],
) -> dict[Side, list[Passing]]:  # fmt: skip
    """The boundaries that lie on curves, which pass sides at shares (`passed`), ascending.

    The statuses on both sides of each are those of orbits that are found there. Where they do not lead from the status
    of one node to that of the next, there is another boundary between, and nothing is returned for this side.
    """
    beside, found = list[tuple[float, float]](), dict[Side, list[Passing]]()
    for (i, j, in_row), places in passed.items():
        own, k = (shares[0], i) if in_row else (shares[1], j)
        ends = [own[k], *places, own[k + 1]]
        for low, share, high in zip(ends, places, ends[2:], strict=False):
            two = max(share - LOCATED_TO, 0.5 * (low + share)), min(share + LOCATED_TO, 0.5 * (high + share))
            beside += [(x, shares[1][j]) if in_row else (shares[0][i], x) for x in two]
    pairs = iter(statuses_at(np.array(beside)).reshape(-1, 2).tolist() if beside else [])
    for (i, j, in_row), places in passed.items():
        changes = [
            Passing(share, pair[0], pair[1], True)
            for share, pair in zip(places, pairs, strict=False)
            if pair[0] != pair[1]
        ]
        chain = [statuses[i, j], *(status for each in changes for status in each[1:3])]
        chain.append(statuses[i + in_row, j + (not in_row)])
        if all(a == b for a, b in zip(chain[::2], chain[1::2], strict=True)):
            found[i, j, in_row] = changes
    return found


def by_continuation(
    statuses: np.ndarray, shares: Shares, both_ways: bool, settled: Settled, known: Mapping[Side, Any]
) -> dict[Side, list[Passing]]:
    """The boundaries that are not known and are found beside orbits which are continued."""
    sides = _sides_between(statuses, shares, known)
    orbits = np.isin(sides.statuses.astype(str), WITH_ORBIT)
    which = np.flatnonzero((sides.in_row | both_ways) & orbits.any(1))
    if not len(which):
        return {}
    turned, pairs = ~orbits[which, :1], sides.statuses[which]
    low, high = sides.low[which], sides.high[which]
    way = np.where(turned, high, low), np.where(turned, low, high), np.where(turned, pairs[:, ::-1], pairs)
    each = zip(which.tolist(), continued_edges(settled, *way, LOCATED_TO).tolist(), strict=True)
    found = dict[Side, list[Passing]]()
    for k, edge in each:
        along, (before, behind) = bool(sides.in_row[k]), sides.statuses[k].tolist()
        if np.isfinite(edge[0]):
            i, j = sides.nodes[k].tolist()
            found[i, j, along] = [Passing(edge[not along], before, behind, False)]
    return found


def bisected(
    statuses: np.ndarray, shares: Shares, both_ways: bool, statuses_at: Callable[[np.ndarray], np.ndarray],
    show: Callable[[SweepProgress], None], known: Mapping[Side, Sequence[Passing]],
) -> tuple[Boundaries, str]:  # fmt: skip
    """The boundaries of a grid with statuses (m, n), their points in shares: those that are known, and others by
    bisection; and why that was stopped before its end, or "". Where a third status is met between two neighbours, there
    are two boundaries."""
    nodes, in_row, low, high, parts = _sides_between(statuses, shares, known)
    began, done, counts, stopped = perf_counter(), 0, Counter[str](), ""
    while len(wide := np.flatnonzero(((high - low).max(axis=1, initial=0) > LOCATED_TO) & (in_row | both_ways))):
        middle = 0.5 * (low[wide] + high[wide])
        try:
            interrupts.heed()
            found = statuses_at(middle)
        except TimeOver as over:
            stopped = str(over)
            break
        before, behind = (found == parts[wide, side] for side in (0, 1))
        other = ~(before | behind)
        # A third status divides the pair into two; the second one, which begins with that status, is appended.
        nodes, in_row = (np.concatenate([each, each[wide[other]]]) for each in (nodes, in_row))
        added = np.column_stack([found[other], parts[wide[other], 1]])
        tops = high[wide[other]]
        low[wide[before]], high[wide[~before]] = middle[before], middle[~before]
        parts[wide[other], 1] = found[other]
        low, high = np.concatenate([low, middle[other]]), np.concatenate([high, tops])
        parts = np.concatenate([parts, added])
        done, counts = done + len(wide), counts + Counter(found.tolist())
        rounds = np.log2(np.maximum((high - low)[in_row | both_ways].max(axis=1) / LOCATED_TO, 1.0))
        left, seconds = int(np.ceil(rounds).sum()), perf_counter() - began
        show(SweepProgress(done, done + left, dict(counts), seconds, left * seconds / done))
    each = [(side, passing) for side, passings in known.items() for passing in passings]
    whether = (in_row | both_ways) & ((high - low).max(axis=1, initial=0) <= LOCATED_TO)
    points = [(x, shares[1][j]) if along else (shares[0][i], x) for (i, j, along), (x, *_) in each]
    boundaries = Boundaries(
        np.concatenate([in_row, np.array([side[2] for side, _ in each], bool)]),
        np.concatenate([whether, np.ones(len(each), bool)]),
        np.concatenate([np.zeros(len(nodes), bool), np.array([passing.exact for _, passing in each], bool)]),
        np.concatenate([nodes, np.reshape([side[:2] for side, _ in each], (-1, 2)).astype(int)]),
        np.concatenate([0.5 * (low + high), np.reshape(points, (-1, 2))]),
        np.concatenate([parts, np.reshape([passing[1:3] for _, passing in each], (-1, 2)).astype(object)]),
    )
    return boundaries, stopped


def codes_of(statuses: np.ndarray) -> np.ndarray:
    """Statuses as whole numbers of the same shape."""
    return np.searchsorted(np.sort(CONTINUED_STATUSES), statuses.astype(str))
