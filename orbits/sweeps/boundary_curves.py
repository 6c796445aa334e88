"""The boundaries of a diagram as curves of events, each followed from where it passes between two neighbours."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..continuation import (
    COLLAPSE,
    LIMITS,
    End,
    Event,
    EventCurve,
    Family,
    Point,
    StepControl,
    begin_run,
    begun,
    checked_options,
    collected,
    passings,
    run_along_event,
)
from ..errors import OrbitsError
from ..model import Machine
from ..periodic import Orbit
from ..running import interrupts
from .diagram_grid import Grid

# The events that are boundaries, of families that are followed from one neighbour towards the other.
FOLLOWED = ("fold", COLLAPSE, *(kind for kind, _ in LIMITS.values() if kind))


class BoundaryOptions(NamedTuple):
    """From where curves of events are followed as boundaries, and which of them are one."""

    pairs: int = 24  # of neighbours from which curves are followed, at most
    without: int = 6  # pairs in succession that lead to no curve, then others are not tried
    same: float = 1e-7  # share of the range of an event: a curve of its kind that passes a row within this is its curve
    # Width of events on the way, which are located only as precisely as curves that begin there need it, since their
    # first points solve the equations of the events. A quantity that changes its sign by a jump is distinguished from
    # one that vanishes by its value there.
    width_on_way: float = 1e-8


BOUNDARIES = BoundaryOptions()
# Few points are solved at a time, since most curves end soon, and long steps are taken, since rows and columns are hit
# exactly afterwards. Curves are not followed far to where rounding decides, which takes many steps.
CONTROL = StepControl(largest_batch=32, target_correction=1e-4, largest_amplification=1e6, escape_ratio=20.0)
ALONG_FOLDS = replace(CONTROL, largest_amplification=100.0)  # second derivatives grow as powers of first ones
ON_CURVE = checked_options(longest=0.05, most=400, step_control=CONTROL)
ON_WAY = checked_options(longest=0.5, most=60)  # of a family between two neighbours


@dataclass(frozen=True)
class BoundaryCurve:
    """A curve of an event that was followed: the event, the values of the two parameters at its points, which are exact
    wherever it passes rows or columns of the grid, its end, and the curve's directions at the points, which are changes
    (along, across) of any length."""

    event: str
    along: tuple[float, ...]
    across: tuple[float, ...]
    end: str
    directions: tuple[tuple[float, float], ...] = ()

    @property
    def is_fold(self) -> bool:
        """Whether orbits end on it."""
        return self.event.startswith("fold")

    def passings(self, axis: int, lines: np.ndarray) -> list[list[float]]:
        """The places, ascending, at which it passes each column of the grid (axis 0), or each row (axis 1)."""
        found, index = [set[float]() for _ in lines], {float(value): k for k, value in enumerate(lines)}
        ways = (self.along, self.across) if axis == 0 else (self.across, self.along)
        for value, place in zip(*ways, strict=True):
            if value in index:
                found[index[value]].add(place)
        return [sorted(each) for each in found]


def boundary_curves(grid: Grid, orbit_at: Callable[[Machine], Orbit], machine: Machine) -> list[BoundaryCurve]:
    """The curves of events that pass between neighbours in rows where one has an orbit, from the rows in the middle on,
    until all such neighbours are passed or no more are found.

    orbit_at : machine -> its orbit, from which the family between two neighbours is followed
    """
    sides = grid.brackets()
    sides = sides.take(sides.in_row & sides.orbits.any(1))
    order = np.argsort(np.abs(2 * sides.nodes[:, 1] - len(grid.values[1])), kind="stable")
    curves, tried, without = list[BoundaryCurve](), 0, 0
    for (i, j), orbits in zip(sides.nodes[order].tolist(), sides.orbits[order].tolist(), strict=True):
        low, high = grid.values[0][[i, i + 1]].tolist()
        places = _places_in_row(grid, curves, j, not all(orbits))
        if any(low <= place <= high for place in places):
            continue
        if tried == BOUNDARIES.pairs or without == BOUNDARIES.without:
            break
        interrupts.heed()
        way = (low, high) if orbits[0] else (high, low)
        found = list(_curves_between(grid, j, way, not all(orbits), orbit_at, machine, curves))
        tried, without = tried + 1, 0 if found else without + 1
    return curves


def _places_in_row(grid: Grid, curves: Sequence[BoundaryCurve], j: int, folds: bool) -> list[float]:
    """The places at which curves pass a row, those on which orbits end or the others."""
    lines = grid.values[1][[j]]
    return [place for curve in curves if curve.is_fold == folds for place in curve.passings(1, lines)[0]]


def _curves_between(
    grid: Grid, j: int, way: tuple[float, float], ends: bool, orbit_at: Callable[[Machine], Orbit], machine: Machine,
    curves: list[BoundaryCurve],
) -> Iterator[BoundaryCurve]:  # fmt: skip
    """The curves of events on the way from a place in a row to its neighbour, which are added to the known `curves`;
    `ends`: whether the neighbour has no orbit, so that a fold is between."""
    (along, across), width = grid.names, float(np.ptp(grid.values[0]))
    here = machine.with_values(**{along: way[0], across: float(grid.values[1][j])})
    with suppress(OrbitsError):
        family = _up_to_fold(here, along, way[1], orbit_at(here))
        for event in family.events:
            known = np.array(_places_in_row(grid, curves, j, event.kind == "fold"))
            near = (np.abs(known - event.point.value) < BOUNDARIES.same * width).any()
            if not near and _is_boundary(family, event, ends):
                with suppress(OrbitsError):
                    for curve in _both_ways(grid, family, event):
                        curves.append(curve)
                        yield curve


def _up_to_fold(machine: Machine, along: str, stop: float, start: Orbit) -> Family:
    """The family of an orbit up to a value, or up to its first fold."""
    run = begin_run(machine, along, start, stop, 1, None, ON_WAY, located=(FOLLOWED, BOUNDARIES.width_on_way))
    points, events = list[Point](), list[Event]()
    with interrupts.deferred():
        for item in run:
            if isinstance(item, End):
                break
            if isinstance(item, Event):
                events.append(replace(item, point=run.curve.in_units(item.point)))
                if item.kind == "fold":
                    break
            else:
                points += run.curve.all_in_units(item.own)
    return replace(begun(run), points=tuple(points), events=tuple(events))


def _is_boundary(family: Family, event: Event, ends: bool) -> bool:
    """Whether an event of a family is a fold, for orbits that end, or orbits are motions on one side of it alone."""
    if event.kind == "fold" or event.kind not in FOLLOWED:
        return event.kind == "fold" and ends
    sides = [point.admissible for point in family.points[event.after : event.after + 2]]
    return len(sides) < 2 or sides[0] != sides[1]


def _both_ways(grid: Grid, family: Family, event: Event) -> Iterator[BoundaryCurve]:
    """The curve of an event in both directions, up to the ends of the grid."""
    bounds, (low, high) = (tuple(values[[0, -1]].tolist()) for values in grid.values)
    assert family.source is not None
    start, is_fold = family.source.values[grid.names[1]], event.kind == "fold"
    control = ALONG_FOLDS if is_fold else CONTROL
    options = replace(ON_CURVE, stop_inadmissible=not is_fold, step_control=control)
    for ends in ((high, low), (low, high)):
        if start != ends[1]:
            run = run_along_event(family, event, grid.names[1], ends, 0, bounds, False, options)
            assert isinstance(run.curve, EventCurve)
            yield _with_passings(grid, run.curve, collected(run))


def _with_passings(grid: Grid, curve: EventCurve, found: Family) -> BoundaryCurve:
    """A curve that was followed with its points on rows and columns of the grid."""
    xs = np.array([[*point.u, point.value] for point in found.points])
    tangents = np.array([point.tangent for point in found.points])
    parts = [(np.arange(len(xs)), xs, tangents)]
    parts += [passings(curve, xs, tangents, *line) for line in ((-1, grid.values[1]), (-2, grid.values[0]))]
    where, xs, tangents = map(np.concatenate, zip(*parts, strict=True))
    order = np.argsort(where, kind="stable")
    order = order[np.append(True, (np.diff(xs[order][:, -2:], axis=0) != 0).any(1))]
    (x, y), directions = xs[order, -2:].T.tolist(), tuple(map(tuple, tangents[order, -2:].tolist()))
    return BoundaryCurve(curve.condition.name, tuple(x), tuple(y), found.end.reason, directions)
