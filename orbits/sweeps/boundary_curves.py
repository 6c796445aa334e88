"""The boundaries of a diagram as curves of events, each followed from where it passes between two neighbours."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..continuation.checkpoint import begun
from ..continuation.event_curve import COLLAPSE, LIMITS, EventCurve
from ..continuation.family import Family
from ..continuation.follow import begin_run
from ..continuation.follow_event import collected, run_along_event
from ..continuation.passings import passings
from ..continuation.point import End, Event, Point
from ..continuation.step_control import StepControl, checked_options
from ..errors import OrbitsError
from ..model.machine import Machine
from ..periodic.orbit import Orbit
from ..running import interrupts

# The events that are boundaries, of families that are followed from one neighbour towards the other.
FOLLOWED = ("fold", COLLAPSE, *(kind for kind, _ in LIMITS.values() if kind))


class BoundaryOptions(NamedTuple):
    """From where curves of events are followed as boundaries, and which of them are one."""

    pairs: int = 24  # of neighbours from which curves are followed, at most
    without: int = 6  # pairs in succession that lead to no curve, after which no others are tried
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


class Box(NamedTuple):
    """The box of a diagram: the names of the parameters, the values (m,) along the rows, and those (n,) of the rows."""

    along: str
    across: str
    places: np.ndarray
    rows: np.ndarray

    @property
    def width(self) -> float:
        """The length of a row."""
        return float(self.places[-1] - self.places[0])


class Neighbours(NamedTuple):
    """Two neighbours in a row: the index of the first along the row, the row, which of the two, 0 or 1, has an orbit
    from which a family is followed to the other, and whether the other has none, so that a fold is between."""

    i: int
    j: int
    side: int
    ends: bool


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


def boundary_curves(
    box: Box, pairs: Sequence[Neighbours], orbit_at: Callable[[Machine], Orbit], machine: Machine
) -> list[BoundaryCurve]:
    """The curves of events that pass between pairs of neighbours, until each pair is passed or no more are found.

    orbit_at : machine -> its orbit, from which the family between two neighbours is followed
    """
    curves, passed, without = list[BoundaryCurve](), [list[tuple[float, bool]]() for _ in box.rows], 0
    tried = 0
    for pair in pairs:
        low, high = box.places[pair.i], box.places[pair.i + 1]
        if any(low <= place <= high and fold == pair.ends for place, fold in passed[pair.j]):
            continue
        if tried == BOUNDARIES.pairs or without == BOUNDARIES.without:
            break
        interrupts.heed()
        found = _curves_between(box, pair, orbit_at, machine, passed)
        tried, without = tried + 1, 0 if found else without + 1
        curves += found
    return curves


def _curves_between(
    box: Box,
    pair: Neighbours,
    orbit_at: Callable[[Machine], Orbit],
    machine: Machine,
    passed: list[list[tuple[float, bool]]],
) -> list[BoundaryCurve]:
    """The curves of events between a pair of neighbours, whose places on the rows are added to `passed`."""
    ends, curves = (pair.i, pair.i + 1), list[BoundaryCurve]()
    begin, end = (float(box.places[ends[k]]) for k in (pair.side, 1 - pair.side))
    here = machine.with_values(**{box.along: begin, box.across: float(box.rows[pair.j])})
    with suppress(OrbitsError):
        family = _up_to_fold(here, box.along, end, orbit_at(here))
        for event in family.events:
            known = np.array([place for place, fold in passed[pair.j] if fold == (event.kind == "fold")])
            if (np.abs(known - event.point.value) < BOUNDARIES.same * box.width).any() or not _is_boundary(
                family, event, pair.ends
            ):
                continue
            with suppress(OrbitsError):
                for curve in _both_ways(box, family, event):
                    curves.append(curve)
                    for j, places in enumerate(curve.passings(1, box.rows)):
                        passed[j] += [(place, curve.is_fold) for place in places]
    return curves


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


def _both_ways(box: Box, family: Family, event: Event) -> Iterator[BoundaryCurve]:
    """The curve of an event in both directions, up to the sides of the box."""
    low, high = float(box.rows[0]), float(box.rows[-1])
    bounds = float(box.places[0]), float(box.places[-1])
    assert family.source is not None
    start, is_fold = family.source.values[box.across], event.kind == "fold"
    control = ALONG_FOLDS if is_fold else CONTROL
    options = replace(ON_CURVE, stop_inadmissible=not is_fold, step_control=control)
    for ends in ((high, low), (low, high)):
        if start != ends[1]:
            run = run_along_event(family, event, box.across, ends, 0, bounds, False, options)
            assert isinstance(run.curve, EventCurve)
            yield _with_passings(box, run.curve, collected(run))


def _with_passings(box: Box, curve: EventCurve, found: Family) -> BoundaryCurve:
    """A curve that was followed with its points on rows and columns of the grid."""
    xs = np.array([[*point.u, point.value] for point in found.points])
    tangents = np.array([point.tangent for point in found.points])
    parts = [(np.arange(len(xs)), xs, tangents)]
    parts += [passings(curve, xs, tangents, *line) for line in ((-1, box.rows), (-2, box.places))]
    where, xs, tangents = map(np.concatenate, zip(*parts, strict=True))
    order = np.argsort(where, kind="stable")
    order = order[np.append(True, (np.diff(xs[order][:, -2:], axis=0) != 0).any(1))]
    (x, y), directions = xs[order, -2:].T.tolist(), tuple(map(tuple, tangents[order, -2:].tolist()))
    return BoundaryCurve(curve.condition.name, tuple(x), tuple(y), found.end.reason, directions)
