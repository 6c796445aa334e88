"""A run along the curve of a family: its certified points, the events between them, and its end, as users read them."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import fields, replace

import numpy as np

from ..curves import End, Event, Points, Run
from ..records import Records
from ..running import TimeOver, time_to_finish
from .curve import Curve
from .curve_corners import AWAY_FROM_CORNER
from .curve_ends import Endings
from .family_problem import FamilyProblem, largest_batch
from .family_tests import tests_of_family
from .point import Point
from .step_control import Options


class FamilyRun:
    """A run along a curve from its first point (1) towards the bound `stop`, with another bound `behind`.

    earlier : the points before the first, in a family that is resumed
    kind : of the tests for the end
    located : the kinds of events that are located, and to which share of the distance of two points; by default all, as
        precisely as possible
    curve : that of the points that come next, which may be divided at nodes on the way

    The first point is certified together with those of the first batch. Raises the error where it cannot be. The items
    are iterated over once.
    """

    def __init__(
        self, problem: FamilyProblem, first: Points, behind: float, stop: float, options: Options,
        earlier: Sequence[Point] = (), kind: type[Endings] = Endings,
        located: tuple[Sequence[str], float] | None = None,
    ):  # fmt: skip
        self.behind, self.stop, self.options = behind, stop, options
        self.curve = curve = problem.curve
        self.earlier = [_as_points(curve, earlier)] if earlier else []
        self.start = earlier[0].value if earlier else float(first.values[0])
        bounds = min(behind, stop), max(behind, stop)
        endings = kind(curve, earlier[0] if earlier else None, self.start, bounds, options)
        tests, steps = tests_of_family(curve, options), options.steps(largest_batch(first))
        steps = replace(steps, most=options.most + len(earlier))
        if located:
            tests, steps = [test for test in tests if test.kind in located[0]], replace(steps, width=located[1])
        self.problem = FamilyProblem(curve, options, tests, endings, steps)
        begin, self._corner = self._behind_corner(first)
        if known := begin.own is not None:  # as in a family that is resumed or begins at a corner
            first = first if first.own is not None else problem.certified(first)
            endings.origin = endings.origin or first.own[0]
        self._run = Run(self.problem, begin, stop, behind=behind, at=options.at, earlier=self.earlier, certified=known)
        self._items = list[Points | Event | End]()
        if not known:
            with suppress(TimeOver):  # the run then ends with its first point
                self._items = self._run.advance()
            first = self._run.blocks[0]
        with time_to_finish():
            self.first = first if first.own is not None else problem.certified(first)

    @property
    def point(self) -> Point:
        """The first point."""
        return self.first.own[0]

    def __iter__(self) -> Iterator[Points | Event | End]:
        """The points in blocks, first to last, each event before the points that follow it, and the end."""
        yield self.first
        if self.options.stop_inadmissible and not self.point.admissible:
            yield End("stopped", f"no motion to begin with: {self.curve.in_units(self.point).violations[0]}")
            return
        if self._corner is not None and self.earlier:  # a family that begins at a corner does not pass it
            yield Event("corner", 0, self._corner.own[0])
        count, most, before = 1, self.options.most, sum(map(len, self.earlier))
        while self._items or self._run.groups:
            items, self._items = self._items or self._advanced(), []
            for item in items:
                if isinstance(item, Points):
                    if len(item) > most - count:  # points at requested values come on top of those of the run
                        yield item[: most - count]
                        yield self._in_words(End("stopped"), most)
                        return
                    count += len(item)
                    yield item
                elif isinstance(item, End):
                    yield self._in_words(item, count)
                elif item.kind not in self.problem.endings.kinds:
                    yield Event(item.kind, item.after - before, item.point.own[0])

    def _advanced(self) -> list[Points | Event | End]:
        """The items of the next batch."""
        problem = self._run.groups[-1].problem
        assert isinstance(problem, FamilyProblem)
        self.curve = problem.curve
        return self._run.advance()

    def _in_words(self, end: End, count: int) -> End:
        """The end of the curve in the words of a family."""
        if end.kind == "closed":
            return replace(end, reason="the curve comes back to its first orbit")
        if end.kind == "stopped" and not end.reason.startswith("no motion"):
            return replace(end, reason=f"after {count} points: raise `most` to continue")
        if end.kind == "reached" and end.reason in (f"{bound:g}" for bound in (self.behind, self.stop)):
            back = " again, on another sheet" if end.reason == f"{self.start:g}" else ""
            return replace(end, reason=f"{self.curve.along} = {end.reason}{back}")
        return end

    def _behind_corner(self, first: Points) -> tuple[Points, Points | None]:
        """The point from which the run goes, just beyond a corner at the first point, and that corner; the first point
        and None without one."""
        problem = self.problem
        (x,), (tangent,) = first.xs - AWAY_FROM_CORNER * first.tangents, first.tangents
        if (corner := problem.corner_ahead(x, tangent, 2 * AWAY_FROM_CORNER)) is None:
            return first, None
        for each in (corner, replace(corner, rate=-corner.rate)):
            start = problem.beyond(first.having(xs=x[None]), each)
            # The parameter may turn at a corner that a resumed run passes.
            if start.passed and (self.earlier or start.tangent[-1] * tangent[-1] > 0):
                assert start.point is not None
                return start.point, start.passed[1]
        return first, None


def _as_points(curve: Curve, points: Sequence[Point]) -> Points:
    """Certified points of a family as points of its curve without nodes, whose equations are not known."""
    columns = {each.name: [getattr(point, each.name) for point in points] for each in fields(Point)}
    numbers = {name: np.array(columns[name], float) for name in ("value", "alpha", "flight_time", "u", "tangent")}
    own = Records(Point, {**columns, **numbers})
    xs, m = np.column_stack([numbers["u"], numbers["value"]]), len(points)
    return Points(np.zeros(m, int), xs, numbers["tangent"], np.ones(m), None, np.arange(m), np.ones(m), own)
