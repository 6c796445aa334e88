"""The cells of a diagram of existence: the parts of each, and the edges between them, along the curves of events where
these were followed, else straight."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

# Pieces between two points of a curve.
PIECES_BETWEEN = 8
# Ends of a curve's parts within a cell are boundaries of the cell that lie within this share of the diagram, to which
# these are located.
SAME_BOUNDARY = 1e-5
_Side = tuple[int, int, bool]  # a node, and whether the side of a cell that begins there lies in a row
_Sides = dict[_Side, list[Any]]
_Arcs = dict[tuple[int, int], list[np.ndarray]]


def cells_of_diagram(diagram: Any) -> Iterator[tuple[list[Any], list[Any]]]:
    """For each cell of a diagram's grid its polygons, each with the status in it, and its pieces of edges, each with
    the name of its edge.

    The boundaries on the sides of a cell are joined by the curves that pass it. Where curves end in the cell or none
    passes it, two boundaries between the same statuses are joined, along the curves as far as these go, and the others
    at the place where their curves meet, or at their middle.
    """
    statuses = diagram.statuses.T
    x, y = diagram.grid[diagram.along].reshape(statuses.shape)[:, 0], np.array(diagram.values)
    size = np.array([np.ptp(x), np.ptp(y) or 1.0])
    arcs, sides = _arcs(diagram, x, y, size), _sides(diagram, x, y)
    for i, j in np.ndindex(len(x) - 1, len(y) - 1):
        ways = ((i, j, True), 1), ((i + 1, j, False), 1), ((i, j + 1, True), -1), ((i, j, False), -1)
        corners = [(x[i], y[j]), (x[i + 1], y[j]), (x[i + 1], y[j + 1]), (x[i], y[j + 1])]
        around: list[Any] = []  # corners, without a status, and boundaries, with those before and behind
        for corner, (place, way) in zip(corners, ways, strict=True):
            around.append((corner, None))
            around.extend((point, pair[::way]) for point, pair in sides.get(place, [])[::way])
        if not any(pair for _, pair in around):
            yield [(statuses[i, j], corners)], []
            continue
        yield _divided(around, arcs.get((i, j), []), size) or _divided(around, [], size, together=True) or ([], [])


def smooth(curve: Any, size: np.ndarray) -> np.ndarray:
    """The points (k, 2) of a followed curve and more between them: cubics with the curve's own directions, in units of
    the diagram's `size` (2,)."""
    points = np.column_stack([curve.along, curve.across]) / size
    if len(points) < 2 or len(curve.directions) < len(points):
        return points * size
    directions = np.array(curve.directions) / size
    directions /= np.maximum(np.linalg.norm(directions, axis=1), 1e-300)[:, None]
    t, a, b = np.arange(PIECES_BETWEEN)[:, None] / PIECES_BETWEEN, points[:-1, None], points[1:, None]
    chords = np.linalg.norm(b - a, axis=2, keepdims=True)
    ahead, behind = directions[:-1, None] * chords, directions[1:, None] * chords
    inner = a + (b - a) * t**2 * (3 - 2 * t) + t * (1 - t) * (ahead * (1 - t) - behind * t)
    # At a cusp of the curve, which is between two points, the direction turns round.
    turned = ((ahead * behind).sum(2) <= 0) | ((ahead * (b - a)).sum(2) <= 0) | ((behind * (b - a)).sum(2) <= 0)
    inner[turned[:, 0]] = (a + (b - a) * t)[turned[:, 0]]
    return np.vstack([inner.reshape(-1, 2), points[-1:]]) * size


def _arcs(diagram: Any, x: np.ndarray, y: np.ndarray, size: np.ndarray) -> _Arcs:
    """The parts of the diagram's curves within each cell of a grid with places x (m,) and y (n,), each (k, 2). Curves
    have points wherever they pass the sides of cells."""
    found = _Arcs()
    for curve in diagram.curves:
        points, line = np.column_stack([curve.along, curve.across]), smooth(curve, size)
        pieces, middles = (len(line) - 1) // max(len(points) - 1, 1), 0.5 * (points[1:] + points[:-1])
        cells = np.column_stack([np.searchsorted(each, middles[:, k]) - 1 for k, each in enumerate((x, y))])
        changes = np.flatnonzero((cells[1:] != cells[:-1]).any(1)) + 1
        for first, last in pairwise([0, *changes.tolist(), len(cells)]):
            if first < last:
                cell = tuple(cells[first].tolist())
                found.setdefault(cell, []).append(line[first * pieces : last * pieces + 1])
    return found


def _sides(diagram: Any, x: np.ndarray, y: np.ndarray) -> _Sides:
    """The boundaries on the sides of cells, in order. Those between rows that are not located lie where curves pass the
    side, if as many do."""
    found, sides, loose = diagram.boundaries, _Sides(), set[_Side]()
    parts = (part.tolist() for part in (found.nodes, found.in_row, found.points, found.statuses, found.located))
    for (i, j), along, point, pair, located in zip(*parts, strict=True):
        sides.setdefault((i, j, along), []).append((point, tuple(pair)))
        loose |= set() if along or located else {(i, j, along)}
    passings = [curve.passings(0, x) for curve in diagram.curves]
    for place, side in sides.items():
        side.sort()
        if place in loose:
            i, j, _ = place
            passed = sorted({up for each in passings for up in each[i] if y[j] <= up <= y[j + 1]})
            if len(passed) == len(side):
                side[:] = [([point[0], up], pair) for (point, pair), up in zip(side, passed, strict=True)]
    return sides


def _divided(
    around: list[Any], arcs: list[np.ndarray], size: np.ndarray, together: bool = False
) -> tuple[list[Any], list[Any]] | None:
    """The polygons and edges of a cell between the arcs that join its boundaries in pairs, and the lines that join the
    boundaries that no arc joins; None where statuses contradict these. `together`: all are joined in one point."""
    cuts = [k for k, (_, pair) in enumerate(around) if pair]
    points, free = np.array([around[k][0] for k in cuts]), dict.fromkeys(cuts)
    partners: dict[int, tuple[int, list[Any]]] = {}
    edges, begun = dict[int, Any](), dict[int, np.ndarray]()
    for arc in arcs:
        away = np.abs((points[:, None] - arc[[0, -1]]) / size).max(2)
        a, b = (cuts[k] for k in away.argmin(0).tolist())
        met = (away.min(0) < SAME_BOUNDARY).tolist()
        if a != b and all(met) and a in free and b in free:
            inside = arc[1:-1].tolist()
            partners[a], partners[b] = (b, inside), (a, inside[::-1])
            line = [around[a][0], *inside, around[b][0]]
            edges[min(a, b)] = _edge_of(around[a][1]), line if a < b else line[::-1]
            del free[a], free[b]
        else:
            begun |= {cut: way for cut, way, at in ((a, arc, met[0]), (b, arc[::-1], met[1])) if at}
    for group in [cuts] if together else _groups(around, [*free]):
        if len(group) == 1 and not together:
            return None
        paths = _to_meeting_point(around, group, begun, size)
        edges |= {cut: (_edge_of(around[cut][1]), [around[cut][0], *path]) for cut, path in paths.items()}
        partners |= {
            cut: (before, [*paths[cut], *paths[before][-2::-1]])
            for before, cut in pairwise([group[-1], *group])
        }  # fmt: skip
    polygons = _polygons(around, cuts, partners, together)
    return (polygons, [edge for _, edge in sorted(edges.items())]) if polygons else None


def _groups(around: list[Any], cuts: list[int]) -> list[list[int]]:
    """The boundaries that are joined with each other: two between the same statuses, and all others."""
    pairs: dict[frozenset[str], list[int]] = {}
    for cut in cuts:
        pairs.setdefault(frozenset(around[cut][1]), []).append(cut)
    twos = [pair for pair in pairs.values() if len(pair) == 2]
    others = sorted(cut for pair in pairs.values() if len(pair) != 2 for cut in pair)
    return [*twos, *([others] if others else [])]


def _to_meeting_point(
    around: list[Any], group: list[int], begun: dict[int, np.ndarray], size: np.ndarray
) -> dict[int, list[Any]]:
    """The ways from boundaries to one point, along the arcs that begin at them as far as these lead to it: where the
    arcs come closest to each other, or else the middle of the boundaries."""
    ways = {cut: begun.get(cut, np.array([around[cut][0]])) for cut in group}
    arcs = [ways[cut] for cut in group if cut in begun]
    meeting = np.mean([around[cut][0] for cut in group], axis=0)
    if arcs:
        places = np.concatenate(arcs)
        apart = [np.linalg.norm((places[:, None] - arc) / size, axis=2).min(1) for arc in arcs]
        others = [np.linalg.norm((places - around[cut][0]) / size, axis=1) for cut in group if cut not in begun]
        meeting = places[np.max([*apart, *others], axis=0).argmin()]
    nearest = {cut: int(np.linalg.norm((way - meeting) / size, axis=1).argmin()) for cut, way in ways.items()}
    return {cut: [*way[1 : nearest[cut] + 1].tolist(), meeting.tolist()] for cut, way in ways.items()}


def _polygons(
    around: list[Any], cuts: list[int], partners: dict[int, tuple[int, list[Any]]], anyway: bool
) -> list[Any] | None:
    """The polygons of a cell, each with its status, from the way inside of the cell from each boundary to the next one
    of a polygon; None where a polygon would have several statuses, unless they are wanted `anyway`."""
    polygons, left, following = [], dict.fromkeys(cuts), dict(pairwise([*cuts, cuts[0]]))
    while left:
        start = cut = next(iter(left))
        status, polygon = around[start][1][1], []
        while cut in left:
            del left[cut]
            end = following[cut]
            if not anyway and {around[cut][1][1], around[end][1][0]} != {status}:
                return None
            last = end if end > cut else end + len(around)
            polygon += [around[k % len(around)][0] for k in range(cut, last + 1)]
            cut, inside = partners[end]
            polygon += inside
        polygons.append((status, polygon))
    return polygons


def _edge_of(pair: tuple[str, str]) -> str:
    """The name of the edge to which a boundary between two statuses belongs."""
    return "edge of the orbits" if {*pair} & {"no orbit", "ends"} else "edge of the motions"
