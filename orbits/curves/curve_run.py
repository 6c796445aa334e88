"""A run along curves: batches of points, what happens between them, and the ends; it may pause after every batch.

In a batch each curve takes several steps, all curves together. Then the points between the ends of the steps are solved
and certified together. Where one is rejected, the curve goes on from the point before it with shorter steps.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import InputError, finite_number
from ..running.interrupts import heed
from .bordered_newton import Border, correct
from .curve_batch import Group, Limits, Progress, points_of, steps_of
from .curve_events import Found, Segments, certified, changes, located, values_of
from .curve_landings import closing, landings
from .curve_steps import Tails, is_first
from .protocol import ASKS, CHANGES, HAPPENS, Array, End, Event, Points, Problem, Start
from .step_options import Steps

Item = Points | Event | End
DEFAULT_STEPS = Steps()
# The kinds of what a run itself finds between points.
VALUE, CLOSED = "value", "closed"
# A curve may be closed where its first point is at most this many chords from a point that comes before it.
FARTHEST = 2.0


def started(problem: Problem, xs: Array, options: Steps = DEFAULT_STEPS, way: float = 1.0) -> Points:
    """The first points of lanes 0 to m - 1, certified, at the values of the parameter of places (m, n + 1) near them.

    way : the parameter grows along the tangents, or falls for a number below 0

    A lane without such a point is left out. Raises `InputError` for places that are not a matrix of finite numbers.
    """
    if np.ndim(xs) != 2 or not np.isfinite(xs).all():
        raise InputError(f"the first places of curves have shape {np.shape(xs)}: they are finite numbers (m, n + 1)")
    m, n = xs.shape
    border = Border.of_component(n - 1, xs[:, -1], n)
    onward = np.tile(np.copysign(np.eye(1, n, n - 1), way), (m, 1))
    which, points = correct(problem, np.arange(m), xs, border, onward, options)
    return certified(problem, which, points.having(lengths=np.zeros(len(points))))[1]


def follow(problem: Problem, first: Points, stop: Array | float, **options: Any) -> Iterator[Item]:
    """The items of a `Run` with these options."""
    return iter(Run(problem, first, stop, **options))


class Passed(Sequence[Points]):
    """The points of a lane among blocks of points, which are looked up where they are used."""

    def __init__(self, blocks: list[Points], lane: int):
        self.blocks, self.lane = blocks[:], lane

    @cached_property
    def own(self) -> list[Points]:
        """The points of the lane alone."""
        own = (each if (mine := each.lanes == self.lane).all() else each[mine] for each in self.blocks)
        return [each for each in own if len(each)]

    def __getitem__(self, which: Any) -> Any:
        return self.own[which]

    def __len__(self) -> int:
        return len(self.own)


class Run:
    """A run along the curves of first points (m), one in each lane, towards bounds of the parameter.

    stop, behind : the bound ahead of each lane (m,) and the bound behind it, or one for all lanes; the first value
        of each curve is the bound behind it by default
    at : values of the parameter; each time a curve passes one, it gets a point with exactly this value
    earlier : points of the same curves before the first ones, where a run is resumed
    lengths : lengths (m,) of the first steps; those of the options by default

    It yields `Points`, in order along each lane; each `Event` after the points before it; and an `End` for each lane.
    After each `advance` it can be pickled or copied, and goes on where it was. An error in `advance`, as an interrupt,
    leaves the run as it was before. Raises `InputError` for lanes out of order, for requested values that are not
    finite, and for bounds that are not two different numbers.
    """

    def __init__(
        self,
        problem: Problem,
        first: Points,
        stop: Array | float,
        *,
        behind: Array | float | None = None,
        at: Sequence[float] = (),
        earlier: Sequence[Points] = (),
        lengths: Array | float | None = None,
        options: Steps = DEFAULT_STEPS,
    ):
        if (np.diff(first.lanes, prepend=-1) <= 0).any():
            raise InputError(
                f"lanes {first.lanes.tolist()} of first points: there is one point for each, in their order"
            )
        m = int(first.lanes.max(initial=-1)) + 1
        self.options, self.blocks, self.problem = options, [*earlier, first], problem
        homes = [self.passed(lane)[0][:1] for lane in first.lanes.tolist()]
        self.home, self.home_rows = np.full((2, m, first.xs.shape[1]), np.nan)
        for home in (home for home in homes if home.xs.shape[1] == first.xs.shape[1]):
            lane, x = home.lanes, home.xs
            self.home[lane], self.home_rows[lane] = x, problem.rows(lane, x, home.tangents)
        starts = np.full(m, np.nan)
        starts[first.lanes] = [home.values[0] for home in homes]
        ends = np.column_stack([np.broadcast_to(each, m) for each in (stop, starts if behind is None else behind)])
        if (wrong := ~(abs(ends[first.lanes, 0] - ends[first.lanes, 1]) > 0)).any():
            ahead, back = ends[first.lanes][wrong][0]
            raise InputError(f"a curve goes from {back:g} to {ahead:g}: its bounds are two different numbers")
        requested = np.array(sorted({finite_number("at", value) for value in at}))
        self.limits = Limits(np.sort(ends, axis=1), starts, requested)
        length = np.clip(options.first if lengths is None else lengths, options.shortest, options.longest)
        count = np.sum([np.bincount(each.lanes, minlength=m) for each in self.blocks], axis=0)
        length, batch = np.array(np.broadcast_to(length, m), float), np.full(m, options.batch)
        self.progress = Progress(length, batch, np.zeros(m), count, np.zeros(m, int))
        self.groups = [Group.of(problem, self.blocks, options.memory)] if len(first) else []
        self._to_yield: list[Item] = [first] if len(first) else []

    def __getstate__(self) -> dict[str, object]:
        """The pickled state, with the equations at the last points of each curve alone."""
        last = {lane: i for i, each in enumerate(self.blocks) for lane in each.lanes.tolist()}
        blocks = [each if i in last.values() else each.having(evaluation=None) for i, each in enumerate(self.blocks)]
        return vars(self) | {"blocks": blocks}

    def __iter__(self) -> Iterator[Item]:
        first, self._to_yield = self._to_yield, []
        yield from first
        while self.groups:
            yield from self.advance()

    def passed(self, lane: int) -> "Passed":
        """The points of a lane, in order."""
        return Passed(self.blocks, lane)

    def advance(self) -> list[Item]:
        """Take a batch of steps along the curves of one problem; returns the items. Raises what the problem raises."""
        heed()
        before, blocks = (self.progress.copy(), [group.copy() for group in self.groups]), len(self.blocks)
        try:
            group = self.groups[-1]
            batch, tails = steps_of(group, self.progress, self.limits, self.options), group.tails
            points, refused = points_of(group, batch, self.progress, self.limits, self.options)
            items = self._items(group, points, tails) if len(points) else []
            return items + self._ends(group, refused)
        except BaseException:
            self.progress, self.groups = before
            del self.blocks[blocks:]
            raise

    def _items(self, group: Group, points: Points, tails: Tails) -> list[Item]:
        """The items of the next points of lanes behind tails: the points of all lanes on which nothing happens
        together, then those of each other lane in turn."""
        lanes, k = points.lanes, np.searchsorted(group.lanes, points.lanes)
        first, values = is_first(lanes), values_of(group.problem, points)
        behind = points.xs, points.tangents, values
        last = tails.xs[:, -1], tails.tangents[:, -1], group.values
        xs, tangents, before = (np.concatenate([each[:1], each[:-1]]) for each in behind)
        for array, of_lane in zip((xs, tangents, before), last, strict=True):
            array[first] = of_lane[k[first]]
        segments = Segments(lanes, xs, points.xs, tangents, points.tangents)
        group.values = group.values.copy()
        group.values[k] = values  # the last one of each lane stays
        busy = self._may_happen(group, segments, before, values)
        if not busy.any():
            return self._block(points)
        which = np.flatnonzero(busy)
        # At the first point of a curve that goes on, the change of its problem is an event again, up to rounding.
        begins = first & (tails.known[k].sum(1) == 1) & (self.progress.count[lanes] > 1)
        found: dict[int, list[Found]] = {i: [] for i in which.tolist()}
        own = segments.only(which)
        for each in located(group.problem, group.columns, own, before[which], values[which], self.options):
            i = int(which[each.segment])
            if not (begins[i] and each.share * points.lengths[i] <= self.options.same):
                found[i].append(each)
        quiet = ~np.isin(lanes, lanes[busy])
        items = self._block(points[quiet])
        for lane in dict.fromkeys(lanes[busy].tolist()):
            items += self._along(group, lane, points, segments, found)
        return items

    def _may_happen(self, group: Group, segments: Segments, before: Array, values: Array) -> Array:
        """On which segments (q,) something may happen; the tests have the values (q, c) at their ends."""
        value, (low, high) = segments.b[:, -1], self.limits.bounds[segments.lanes].T
        busy = (value < low) | (value > high)
        if len(group.asks):
            busy |= np.where(group.asks, values < 0, changes(before, values)).any(1)
        busy |= segments.tangents[:, -1] * segments.tangents_b[:, -1] < 0
        if len(at := self.limits.at):
            lowest, highest = np.minimum(segments.a[:, -1], value), np.maximum(segments.a[:, -1], value)
            busy |= np.isin(value, at) | (np.searchsorted(at, lowest, "right") < np.searchsorted(at, highest))
        return busy | self._comes_home(group.problem, segments)

    def _comes_home(self, problem: Problem, segments: Segments) -> Array:
        """Which segments (q,) pass the first point of their curve, by the rows there."""
        if problem is not self.problem:
            return np.zeros(len(segments.lanes), bool)
        home, rows = self.home[segments.lanes], self.home_rows[segments.lanes]
        passes = ((segments.a - home) * rows).sum(1) < 0
        passes &= ((segments.b - home) * rows).sum(1) >= 0 if passes.any() else False
        if passes.any():
            sizes = problem.size(segments.lanes, segments.a)
            away, chord = (home - segments.a) / sizes, (segments.b - segments.a) / sizes
            passes &= (away * away).sum(1) <= FARTHEST**2 * (chord * chord).sum(1)
        return passes

    def _along(
        self, group: Group, lane: int, points: Points, segments: Segments, found: dict[int, list[Found]]
    ) -> list[Item]:
        """The items of a lane, up to where it ends or goes on as the curve of another problem."""
        own, items = np.flatnonzero(points.lanes == lane), list[Item]()
        (low, high), begun = self.limits.bounds[lane], int(own[0])  # points from there on are not yet among the items
        for i in (i for i in own.tolist() if i in found):
            here, value = points[i : i + 1], float(points.values[i])
            of_run = self._of_run(group.problem, segments.only([i]), here)
            for each in sorted([*found[i], *of_run], key=lambda each: each.share):
                point, does = each.point or here, each.test.does if each.test else CHANGES
                if not low <= point.values[0] <= high:  # it lies behind a bound, where the curve ends
                    continue
                items += self._block(points[begun : i + (point is here)])
                begun = i + (point is here)
                items += self._block(point) if point is not here and does == CHANGES else []
                event = Event(each.kind, point, int(self.progress.count[lane]) - 1, each.which)
                if does != ASKS if each.test else each.kind == VALUE and point.values[0] in self.limits.at:
                    items.append(event)
                if onward := self._after(group.problem, event, does if each.test else ""):
                    return items + self._leads_on(group, onward, lane)
            if not low <= value <= high:
                bound = low if value < low else high
                return items + self._leads_on(group, End("stuck", f"no point is found at the bound {bound:g}"), lane)
        return items + self._block(points[begun : own[-1] + 1])

    def _of_run(self, problem: Problem, segment: Segments, point: Points) -> list[Found]:
        """The requested values and the bounds of the parameter on a segment (1) up to a point (1), and the first point
        of its curve."""
        lane, options = int(segment.lanes[0]), self.options
        own = [Found(0, 1.0, VALUE, None)] if point.values[0] in self.limits.at else []
        values = {*self.limits.at.tolist(), *self.limits.bounds[lane].tolist()}
        hits = landings(problem, segment, values, float(point.lengths[0]), options)
        own += [Found(0, share, VALUE, place) for share, place in hits]
        near = self._comes_home(problem, segment)[0]
        if near and (home := closing(problem, segment, self.home[lane], self.home_rows[lane], options)):
            own.append(Found(0, home[0], CLOSED, home[1]))
        return own

    def _after(self, problem: Problem, event: Event, does: str) -> Start | End | None:
        """What follows an event of a test with this purpose, or of the run itself."""
        lane, value = int(event.point.lanes[0]), float(event.point.values[0])
        if does:
            return problem.changed(event, self.passed(lane)) if does != HAPPENS else None
        if event.kind == CLOSED:
            return End(CLOSED, "the curve comes back to its first point")
        return End("reached", f"{value:g}") if value in self.limits.bounds[lane] else None

    def _ends(self, group: Group, refused: dict[int, object]) -> list[Item]:
        """The ends of curves at a bound or after the largest number of points, and what follows those that are lost."""
        lanes, progress, options = group.lanes, self.progress, self.options
        value, rate = group.tails.xs[:, -1, -1], group.tails.tangents[:, -1, -1]
        low, high = self.limits.bounds[lanes].T
        arrived = (value >= high) & (rate > 0) | (value <= low) & (rate < 0)
        many = progress.count[lanes] >= options.most
        hard = (progress.length[lanes] <= options.shortest) | (progress.rejections[lanes] > options.rejections)
        hard &= np.isin(lanes, [*refused]) if refused else False
        items = list[Item]()
        for k in np.flatnonzero(arrived | many | hard).tolist():
            lane = int(lanes[k])
            if arrived[k]:
                onward: Start | End = End("reached", f"{value[k]:g}")
            elif many[k]:
                onward = End("stopped", f"after {progress.count[lane]} points")
            else:
                onward = group.problem.lost(lane, self.passed(lane), refused[lane])
            items += self._leads_on(group, onward, lane, is_new=True)
        return items

    def _leads_on(self, group: Group, onward: Start | End, lane: int, is_new: bool = False) -> list[Item]:
        """The end of a lane of a group, or its start as the curve of a problem, where a new point is an item too."""
        group.take(group.only(np.flatnonzero(group.lanes != lane)))
        self.groups = [each for each in self.groups if len(each.lanes)]
        if isinstance(onward, End):
            return [replace(onward, lane=lane)]
        first = self._first_of(onward, lane)
        if not len(first) or (is_new and self.progress.count[lane] == self.progress.begun[lane]):
            return [End("stuck", "the curve does not go on where its problem changes or behind its corner", lane)]
        self.progress.begin(lane, self.options, is_new)
        begun = Group.of(onward.problem, [first], self.options.memory)
        if same := next((each for each in self.groups if each.problem is onward.problem), None):
            same.take(same.joined(begun))
        else:
            self.groups.append(begun)
        if is_new:
            return self._block(first)
        self.blocks.append(first)  # the point where the problem changes, as one of the other problem
        return []

    def _first_of(self, start: Start, lane: int) -> Points:
        """The first point (1) of a curve that goes on; none where there is no such point."""
        lanes, x, tangent, problem = np.array([lane]), start.x[None], start.tangent[None], start.problem
        row = problem.rows(lanes, x, tangent)
        border = start.border or Border(row, (row * x).sum(1))
        which, first = correct(problem, lanes, x, border, tangent, self.options)
        return certified(problem, which, first.having(lengths=np.zeros(len(first))))[1]

    def _block(self, points: Points) -> list[Item]:
        """Points as an item, where there are any; they are the next ones of their lanes."""
        if not len(points):
            return []
        self.blocks.append(points)
        np.add.at(self.progress.count, points.lanes, 1)
        return [points]
