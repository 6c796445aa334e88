"""A run along a curve of orbits: batches of points, their certificates, the events between them, and the end.

In one batch `step_control` takes several steps, which `predictor` and `corrector` compute. Then `curve` certifies the
points, `events` locates the events between them, `limits` tests for the end, and `checkpoint` collects the results.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from ..errors import NoOrbit, OrbitsError
from ..running.time_limit import TimeOver, time_to_finish
from ..shooting.division import DIVIDED_GROWTH, LARGEST_ARC_GROWTH
from ..units import Message
from .corrector import MEMORY, correct
from .curve import Curve, CurvePoint, CurvePoints, StepEnd
from .curve_corners import AWAY_FROM_CORNER, CurveCorner
from .events import CrossingSegment, Segment
from .limits import Endings
from .point import End, Event
from .step_control import Options, Stepper

# A batch is split at a change of family only where its points lie farther apart than this many shortest steps.
RESOLVED = 10
# Integration steps of all motions in one batch, whose arrays then fit into the cache; and the points of a small batch.
STEPS_OF_BATCH, SMALL_BATCH = 12_000, 8


class AnotherFamily(NoOrbit):
    """The next point is of another family, and too far from the last point to locate where that family begins."""


class TracerState(NamedTuple):
    """The state of a run before its next batch."""

    last: CurvePoint
    ends: Sequence[CurvePoint]  # of the last steps, the last of them `last`
    length: float  # of the next step
    batch_size: int  # number of points to solve and certify at a time
    before: int = 0  # number of points before `last`
    rejections: float = 0.0  # number of rejected points, less the number that accepted points have offset


class Batch(NamedTuple):
    """The next points of a run, up to the first that is rejected."""

    certified: Sequence[CurvePoint]
    rejection: OrbitsError | None  # why the next point is rejected
    failure: OrbitsError | None  # why no further step is possible
    length: float  # of the next step, half the distance to the rejected point where there is one
    whole: bool  # whether the curve was solved on all of the steps, not only on the first of them


class Tracer:
    """A run along a curve from its point `first` towards the bound `stop`, with another bound `behind`.

    Where a point cannot be certified, or is of another family, the steps are repeated from the point before it, shorter
    and one at a time. `earlier` are the points before the first, in a family that is resumed.
    """

    segments: type[Segment] = Segment
    tests_for_the_end: type[Endings] = Endings

    def __init__(self, curve: Curve, first: CurvePoint, behind, stop, options: Options, earlier: Sequence = ()):
        self.curve, self.options, self.control, self.earlier = curve, options, options.step_control, earlier
        if options.multipliers:
            self.segments = CrossingSegment
        self.behind, self.stop, bounds = behind, stop, (min(behind, stop), max(behind, stop))
        self.start = earlier[0].value if earlier else first.value
        self.stepper = Stepper(curve, bounds, self.start, options)
        length = min(self.control.first_step, options.longest)
        self._state = TracerState(first, (first,), length, min(self._largest_batch(first), options.most))
        self._batch: Batch | None = None
        self._first_events: Sequence[Event] = ()
        if passed := self._beyond_first(first):
            located, beyond = passed
            first = curve.certify(first)
            self._state = self._state._replace(last=beyond, ends=(beyond,))
            # A family that begins at a corner does not pass it. One that is resumed before it does.
            self._first_events = [Event("corner", 0, located.point)] if earlier else []
        if first.certified is None:  # the first point is certified in one call with the points that follow it
            try:
                batch = self._next_batch(self._state)
            except TimeOver:  # the run ends with its first point
                with time_to_finish():
                    batch = Batch([curve.certify(first)], None, None, length, whole=True)
            if batch.rejection and not len(batch.certified):
                raise batch.rejection
            first = batch.certified[0]
            self._batch = batch._replace(certified=batch.certified[1:])
            self._state = self._state._replace(last=first, ends=(first,))
        self.first = first
        origin = earlier[0] if earlier else first.point
        self.endings = self.tests_for_the_end(curve, origin, self.start, bounds, options)

    def __iter__(self) -> Iterator[CurvePoint | Event | End]:
        """The points of the curve, first to last, each event before the point that follows it, and the end."""
        return chain.from_iterable(item if isinstance(item, CurvePoints) else [item] for item in self.parts())

    def parts(self) -> Iterator[CurvePoints | CurvePoint | Event | End]:
        """The items of a run, where points between which nothing happens are together."""
        state, batch, options, control = self._state, self._batch, self.options, self.control
        history = [(point.alpha, point.value) for point in (*self.earlier, self.first.point)]
        way = [(point.u, point.tangent) for point in (*self.earlier, self.first.point)]
        yield self.first
        yield from self._first_events
        if options.stop_inadmissible and not self.first.point.admissible:
            yield End("stopped", f"no motion to begin with: {self.curve.in_units(self.first.point).violations[0]}")
            return
        while True:
            state = state._replace(batch_size=min(state.batch_size, options.most - state.before))
            batch = batch or self._next_batch(state)
            last, index, ends = state.last, state.before, [*state.ends]
            for points in self._stretches(last, batch.certified):
                point, room = points[-1], options.most - 1 - index
                if isinstance(points, CurvePoints):
                    if some := points[:room]:
                        yield some
                    last, index, added = point, index + len(some), len(points)
                    history += zip(points.orbits.column("alpha").tolist(), points.values.tolist(), strict=True)
                    way += zip(points.orbits.column("u"), points.orbits.column("tangent"), strict=True)
                    ends += [points[i] for i in points.parts[:-1].nonzero()[0][-MEMORY:].tolist()]
                else:
                    try:
                        items, reached, added, end = self._onward(last, point, index)
                    except OrbitsError as error:
                        reason = NoOrbit(Message("what happens next cannot be located ({error})", error=error))
                        batch = batch._replace(rejection=reason, length=0.5 * point.length)
                        break
                if room < added:
                    yield End("stopped", f"after {index + 1} points: no more than {options.most} were asked for")
                    return
                if not isinstance(points, CurvePoints):
                    yield from items
                    last, index = reached, index + added
                    history.append((last.point.alpha, last.value))
                    way.append((last.point.u, last.point.tangent))
                    if end := end or self.endings.far(last, history, way):
                        yield end
                        return
                    if last.largest_growth > DIVIDED_GROWTH and self.curve.asks_for_nodes([last])[0]:
                        try:
                            divided = self._divided(last)
                        except OrbitsError as error:
                            yield self.endings.lost(error, last, history)
                            return
                        if divided:
                            last = divided
                            batch, ends = self._batch_from_here, [last]
                            break
                ends += [point] if point.parts else []
            located, last, batch = self._passed_corner(last, batch)
            if located:
                yield Event("corner", index, located.point)
                ends = [last]
            state = self._after(state._replace(last=last, before=index), batch, ends)
            gives_up = state.length <= control.shortest_step or state.rejections > control.most_rejections
            if (why := batch.rejection or batch.failure) and (batch.failure or gives_up):
                yield self.endings.lost(why, last, history)
                return
            batch = None

    def _passed_corner(self, last: CurvePoint, batch: Batch) -> tuple[CurvePoint | None, CurvePoint, Batch]:
        """The corner of the curve at which a batch ends with its last point, None without one; the point from which the
        run goes on, just beyond the corner; and the batch, which has no further rejections then."""
        corner = self._corner(last) if len(batch.certified) else None
        if corner is None:
            return None, last, batch
        try:
            located, beyond = self._beyond(last, corner)
        except OrbitsError as error:
            return None, last, batch._replace(failure=error)
        return located, beyond, self._batch_from_here

    @property
    def _batch_from_here(self) -> Batch:
        """No points yet, where a run begins anew."""
        return Batch((), None, None, min(self.control.first_step, self.options.longest), whole=False)

    def _corner(self, point: CurvePoint) -> CurveCorner | None:
        """The corner of the curve just ahead of a point."""
        corners = self.curve.corners
        return corners.ahead(point.x, point.tangent, 2 * AWAY_FROM_CORNER) if corners else None

    def _beyond(self, last: CurvePoint, corner: CurveCorner) -> tuple[CurvePoint, CurvePoint]:
        """The corner just ahead of a point, and the curve just beyond it, certified."""
        curve = self.curve
        at = correct(curve, last.x, *corner.border(last.x, 0.0), last.tangent)
        row, level = corner.border(at.x, AWAY_FROM_CORNER)
        outward = curve.size(at.x) ** 2 * row * np.sign(corner.rate)
        beyond = correct(curve, at.x + outward * (level - row @ at.x) / (row @ outward), row, level, outward)
        return curve.certify(at), curve.certify(beyond)

    def _beyond_first(self, first: CurvePoint) -> tuple[CurvePoint, CurvePoint] | None:
        """The corner at the first point and the curve just beyond it, where the run goes; None without one."""
        back = first._replace(x=first.x - AWAY_FROM_CORNER * first.tangent)
        if corner := self._corner(back):
            for each in (corner, replace(corner, rate=-corner.rate)):
                located, beyond = self._beyond(back, each)
                # The parameter may turn at a corner that a resumed run passes.
                if self.earlier or beyond.tangent[-1] * first.tangent[-1] > 0:
                    return located, beyond
        return None

    def _divided(self, last: CurvePoint) -> CurvePoint | None:
        """The last point on the same curve, whose motions are divided at nodes from now on; None where they can do
        without, and nodes do not make the error smaller, as where small changes grow within a short time."""
        try:
            curve, x, tangent = self.curve.divided(last.x, last.tangent, CurvePoints.of([last]).own_evaluation)
            row = tangent / curve.size(x) ** 2
            first = curve.certify_at(correct(curve, x, row, float(row @ x), tangent), last.value)
            is_of_use = last.largest_growth > LARGEST_ARC_GROWTH or first.point.error < last.point.error
        except OrbitsError:
            if last.largest_growth > LARGEST_ARC_GROWTH:
                raise
            is_of_use = False
        if not is_of_use:
            self.curve.takes_nodes_early = False
            return None
        bounds, origin = self.stepper.bounds, self.endings.origin
        self.curve, self.stepper = curve, Stepper(curve, bounds, self.start, self.options)
        self.endings = self.tests_for_the_end(curve, origin, self.start, bounds, self.options)
        return first

    def _stretches(self, last: CurvePoint, points: Sequence[CurvePoint]) -> Iterator[Sequence[CurvePoint]]:
        """The points in order: together those between which neither an event nor the end can lie, as usual, and each
        other one alone in a list."""
        if not len(points):
            return
        busy = self.endings.may_end(last, points)
        busy |= self.segments.may_happen(self.curve, last, points, self.options.at, self.options.watch)
        first = 0
        for i in (*busy.nonzero()[0].tolist(), len(points)):
            if first < i:
                yield points[first:i]
            if i < len(points):
                yield [points[i]]
            first = i + 1

    def _next_batch(self, state: TracerState) -> Batch:
        """The next points, certified; the state's last point comes first if it is not certified yet."""
        ends, length, failure = self.stepper.steps(state.ends, state.length, state.batch_size)
        points, solved = self._solvable(state, ends)
        if left := ends[solved:]:
            failure, length = None, left[0].length * left[0].parts * (1.0 if solved else 0.5)
        if state.last.certified is None:
            points = CurvePoints.joined([CurvePoints.of(some) for some in ([state.last], points) if len(some)])
        certified, rejection = self._certified(state, points)
        if rejection:  # a later failure may not recur once the steps to the rejected point are shorter
            failure, length = None, 0.5 * points[len(certified)].length
        return Batch(certified, rejection, failure, length, whole=not left)

    def _solvable(self, state: TracerState, ends: Sequence[StepEnd]) -> tuple[Sequence[CurvePoint], int]:
        """The points of the first steps and the number of these steps, which is halved until the points are solved."""
        count = len(ends)
        while count:
            try:
                return self.stepper.points_between(state.ends, ends[:count], state.batch_size), count
            except OrbitsError:
                count //= 2
        return [], 0

    def _certified(
        self, state: TracerState, points: Sequence[CurvePoint]
    ) -> tuple[Sequence[CurvePoint], OrbitsError | None]:
        """The certified points, up to the first that cannot be certified or is of another family; and its error."""
        certified, error = self.curve.certify_all(points)
        if not isinstance(certified, CurvePoints):
            return certified, error
        families = certified.orbits.column("family")
        before = families[0] if state.last.certified is None else state.last.point.family
        changes = np.append(before, families[:-1]) != families
        # Where the extension moves alone, turns neither begin nor end along a curve: another number is another curve.
        resolved = 0.0 if self.curve.machine.model.reduction else RESOLVED * self.control.shortest_step
        for i in (changes & (certified.lengths > resolved)).nonzero()[0][:1].tolist():
            family = families[i - 1] if i else before
            return certified[:i], AnotherFamily(f"the orbit changes from family {family} to another one")
        return certified, error

    def _onward(self, last: CurvePoint, point: CurvePoint, before: int) -> tuple[list, CurvePoint, int, End | None]:
        """The points and events after the point `last`, number `before`, up to the next point or to the end of the
        curve; the last point among them; how many are points; and the end, if any."""
        values, items, index = self.options.at, list[CurvePoint | Event](), before
        segment, end = self.endings.cut(self.segments(self.curve, last, point))
        for kind, event in segment.events(values, self.options.watch):
            if kind == "value":
                index += 1
                items.append(event)
            items.append(Event(kind, index, event.point))
        items.append(segment.b)
        if not end and segment.b.value in values:
            items.append(Event("value", index + 1, segment.b.point))
        return items, segment.b, index + 1 - before, end

    def _after(self, state: TracerState, batch: Batch, ends: list[CurvePoint]) -> TracerState:
        """The state after a batch: longer batches if no point was rejected, else shorter steps one at a time."""
        control, size, rejections = self.control, 1, state.rejections
        if batch.rejection:
            # A change of family is approached by halving the step some twenty times, which does not mean that the curve
            # is hard to follow.
            worse = 0 if isinstance(batch.rejection, AnotherFamily) else 1
            rejections = max(rejections - len(batch.certified) / control.recovery, 0.0) + worse
            ends = ends if ends[-1] is state.last else [*ends, state.last]
        elif batch.whole:
            size = min(control.batch_growth * state.batch_size, self._largest_batch(state.last))
        return TracerState(state.last, ends[-MEMORY:], batch.length, size, state.before, rejections)

    def _largest_batch(self, point: CurvePoint) -> int:
        """The largest number of points in a batch whose motions are about as long as that of a point."""
        steps = sum(int(motions.counts[point.place]) for motions in point.evaluation.trajectories)
        return min(self.control.largest_batch, max(SMALL_BATCH, STEPS_OF_BATCH // max(steps, 1)))
