"""A run along a curve of orbits: batches of points, their certificates, the events between them, and the end.

In one batch `stepper` takes several steps. For each, `predictor` extrapolates the last points, `corrector` solves the
equations of `curve` by `newton_batch`, and the step is accepted or rejected with the constants of `step_control`; then
the points between the ends of the steps are solved. `curve` certifies all of them. From each point to the next,
`events` locates what happens, and `endings` tests whether the curve ends there, with the value that the parameter tends
to from `limits`. The points go to `checkpoint`, which builds the `family`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from ..errors import NoOrbit, OrbitsError
from .arguments import Options
from .corrector import MEMORY
from .curve import Curve, CurvePoint
from .endings import Endings
from .events import Segment
from .family import End, Event, Point
from .stepper import Stepper

# A batch is split at a change of family only where its points lie farther apart than this many shortest steps.
RESOLVED = 10


@dataclass(frozen=True, eq=False)
class TracerState:
    """What is known of a run before its next batch.

    last : the last point of the curve
    ends : the ends of the last steps, the last of them `last`
    length : of the next step
    batch_size : number of points to solve and certify at a time
    index : number of points before `last`
    rejections : of points, less those that accepted points have offset
    """

    last: CurvePoint
    ends: tuple[CurvePoint, ...]
    length: float
    batch_size: int
    index: int = 0
    rejections: float = 0.0


class Rejection(NamedTuple):
    """Why a point is rejected, and the length of the curve from the point before it."""

    error: OrbitsError
    length: float


@dataclass(frozen=True, eq=False)
class Batch:
    """The next points of a run.

    certified : the points up to the first that is rejected
    rejection : of that point; None where all are certified
    failure : the error that allows no further step; None where there is none
    length : of the next step
    whole : whether the curve was solved on all of the steps, not only on the first of them
    """

    certified: Sequence[CurvePoint]
    rejection: Rejection | None
    failure: OrbitsError | None
    length: float
    whole: bool

    @property
    def reason(self) -> str:
        """Why not all of the points were certified, or why there are no more."""
        return str(self.rejection.error if self.rejection else self.failure)


class Tracer:
    """A run along a curve from its point `first` towards `stop`, with another bound `behind`.

    Iterating gives the points of the curve in order, each `Event` before the point that follows it, and the `End`.
    Where a point cannot be certified, or is of another family, the steps are taken again from before it, shorter and
    one at a time. `earlier` are the points before the first, in a family that is resumed.
    """

    def __init__(
        self,
        curve: Curve,
        first: CurvePoint,
        behind: float,
        stop: float,
        options: Options,
        earlier: Sequence[Point] = (),
    ):
        self.curve, self.options, self.control = curve, options, options.step_control
        self.behind, self.stop, self.bounds = behind, stop, (min(behind, stop), max(behind, stop))
        self.start = earlier[0].value if earlier else first.value
        self.earlier = earlier
        self.stepper = Stepper(curve, self.bounds, self.start, options)
        length = min(self.control.first_step, options.longest)
        self._state = TracerState(first, (first,), length, min(self.control.largest_batch, options.most))
        self._batch: Batch | None = None
        if first.certified is None:
            # The first point is certified in one call with those that follow it.
            batch = self._next_batch(self._state)
            if batch.rejection and not batch.certified:
                raise batch.rejection.error
            first, *certified = batch.certified
            self._batch = replace(batch, certified=certified)
            self._state = replace(self._state, last=first, ends=(first,))
        self.first = first
        origin = earlier[0] if earlier else first.point
        self.endings = Endings(curve, origin, self.start, self.bounds, options)

    def share(self, value: float) -> float:
        """How much of the parameter's way lies before a value."""
        return (value - self.start) / (self.stop - self.start)

    def __iter__(self) -> Iterator[CurvePoint | Event | End]:
        """The points of the curve, first to last, each event before the point that follows it, and the end."""
        state, batch = self._state, self._batch
        history = [(point.alpha, point.value) for point in (*self.earlier, self.first.point)]
        yield self.first
        if self.options.stop_inadmissible and not self.first.point.admissible:
            yield End("stopped", "no motion to begin with: " + self.first.point.violations[0])
            return
        while True:
            state = replace(state, batch_size=min(state.batch_size, self.options.most - state.index))
            batch = batch or self._next_batch(state)
            last, index, ends = state.last, state.index, [*state.ends]
            for point in batch.certified:
                try:
                    segment, end = self.endings.cut(Segment(self.curve, last, point))
                    located = segment.events(self.options.at, self.options.watch)
                except OrbitsError as error:
                    reason = NoOrbit(f"what happens next cannot be located ({error})")
                    batch = replace(batch, rejection=Rejection(reason, point.length))
                    break
                items, added = self._items(located, segment.b, index, goes_on=end is None)
                if index + added >= self.options.most:
                    most = self.options.most
                    yield End("stopped", f"after {index + 1} points: no more than {most} were asked for")
                    return
                yield from items
                last, index = segment.b, index + added
                history.append((last.point.alpha, last.value))
                if end := end or self.endings.far(last, history):
                    yield end
                    return
                if point.parts:
                    ends.append(point)
            state = self._after(replace(state, last=last, index=index), batch, ends)
            if batch.failure or (batch.rejection and self._gives_up(state)):
                yield self.endings.lost(batch.reason, last, history)
                return
            batch = None

    def _gives_up(self, state: TracerState) -> bool:
        """Whether the steps are too short, or too many points have been rejected, to go on."""
        return state.length <= self.control.shortest_step or state.rejections > self.control.most_rejections

    def _next_batch(self, state: TracerState) -> Batch:
        """The next points, certified, after the state's last point if that is not certified yet."""
        ends, length, failure = self.stepper.steps(state.ends, state.length, state.batch_size)
        points, kept = self._solvable(state, ends)
        if left := ends[kept:]:
            failure, length = None, left[0].length * left[0].parts * (1.0 if kept else 0.5)
        if state.last.certified is None:
            points = [state.last, *points]
        certified, error = self._certified(state, points)
        rejection = Rejection(error, points[len(certified)].length) if error else None
        return Batch(certified, rejection, failure, length, whole=not left)

    def _solvable(self, state: TracerState, ends: Sequence[CurvePoint]) -> tuple[list[CurvePoint], int]:
        """The points of the first steps and the number of these, which is halved until the curve can be solved."""
        count = len(ends)
        while count:
            try:
                return self.stepper.points_between(state.ends, ends[:count], state.batch_size), count
            except OrbitsError:
                count //= 2
        return [], 0

    def _certified(self, state: TracerState, points: list[CurvePoint]) -> tuple[list[CurvePoint], OrbitsError | None]:
        """The points that are certified, up to the first that is not or is of another family; and its error."""
        certified, error = self.curve.certify_all(points)
        family = (state.last.certified or certified[0].point).family if certified else None
        for i, point in enumerate(certified):
            if point.point.family != family and point.length > RESOLVED * self.control.shortest_step:
                return certified[:i], NoOrbit(f"the orbit changes from family {family} to another one")
            family = point.point.family
        return certified, error

    def _items(self, located, point: CurvePoint, index: int, goes_on: bool) -> tuple[list[CurvePoint | Event], int]:
        """The items from the point `index` on to the next one, with the events located between; and how many of these
        are points."""
        items: list[CurvePoint | Event] = []
        start = index
        for kind, event in located:
            if kind == "asked":
                index += 1
                items.append(event)
            items.append(Event(kind, index, event.point))
        items.append(point)
        if goes_on and point.value in self.options.at:
            items.append(Event("asked", index + 1, point.point))
        return items, index + 1 - start

    def _after(self, state: TracerState, batch: Batch, ends: list[CurvePoint]) -> TracerState:
        """The state after a batch and the ends of its accepted steps: longer batches if nothing was rejected, else
        shorter steps one at a time."""
        control = self.control
        if batch.rejection is None:
            size = min(control.batch_growth * state.batch_size, control.largest_batch) if batch.whole else 1
            return replace(state, ends=tuple(ends[-MEMORY:]), length=batch.length, batch_size=size)
        if ends[-1] is not state.last:
            ends = [*ends, state.last]
        rejections = max(state.rejections - len(batch.certified) / control.recovery, 0.0) + 1
        length = 0.5 * batch.rejection.length
        return replace(state, ends=tuple(ends[-MEMORY:]), length=length, batch_size=1, rejections=rejections)
