"""A run along curves: batches of points, what happens between them, and the ends; it may pause after every batch.

In a batch each curve takes several steps, all curves together. Then the points between the ends of the steps are solved
and certified together. Where one is rejected, the curve continues from the point before it with shorter steps.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import InputError, OrbitsError, finite_number
from ..running import heed
from .bordered_newton import Border
from .curve_batch import Group, Limits, Progress, points_of, steps_of
from .curve_events import OUTSIDE, Found, Segments, changes, located, solved_at, values_of
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
        raise InputError(
            f"the first places of curves have the shape {np.shape(xs)}; they must be finite numbers (m, n + 1)"
        )
    m, n = xs.shape
    border = Border.of_component(n - 1, xs[:, -1], n)
    onward = np.tile(np.copysign(np.eye(1, n, n - 1), way), (m, 1))
    return solved_at(problem, np.arange(m), xs, border, onward, options)


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


class Part:
    """The points of a lane (own,) among those of a batch: the indices of the first one and of the end, of the first one
    that is not yet among the items, and of those before which something may happen; the items; and what happens that
    cannot be located, in words."""

    def __init__(self, points: Points, own: Array, busy: Array):
        self.points, self.first, self.end = points, int(own[0]), int(own[-1]) + 1
        self.begun, self.busy, self.items, self.unlocated = self.first, own[busy[own]].tolist(), list[Item](), ""


class Run:
    """A run along the curves of first points (m), one in each lane, towards bounds of the parameter.

    stop, behind : the bound ahead of each lane (m,) and the bound behind it, or one for all lanes; the first value
        of each curve is the bound behind it by default
    at : values of the parameter; each time a curve passes one, it gets a point with exactly this value
    earlier : points of the same curves before the first ones, where a run is resumed
    lengths : lengths (m,) of the first steps; those of the options by default
    certified : whether the first points are certified already; else they are together with those of the first batch,
        before they are yielded

    It yields `Points`, in order along each lane; each `Event` after the points before it; and an `End` for each lane.
    After each `advance` it can be pickled or copied, and continues where it was. An error in `advance`, as an
    interrupt, leaves the run as it was before. Raises `InputError` for lanes out of order, for requested values that
    are not finite, and for bounds that are not two different numbers.
    """

    def __init__(
        self, problem: Problem, first: Points, stop: Array | float, *, behind: Array | float | None = None,
        at: Sequence[float] = (), earlier: Sequence[Points] = (), lengths: Array | float | None = None,
        certified: bool = True, options: Steps = DEFAULT_STEPS,
    ):  # fmt: skip
        if (np.diff(first.lanes, prepend=-1) <= 0).any():
            raise InputError(
                f"lanes {first.lanes.tolist()} of first points: there is one point for each, in their order"
            )
        m = int(first.lanes.max(initial=-1)) + 1
        self.options, self.blocks = options, [*earlier, first]
        options = self._steps(problem)
        homes = [self.passed(lane)[0][:1] for lane in first.lanes.tolist()]
        sizes = problem.size(first.lanes, first.xs)[:, problem.shared]
        self.home, self.home_rows = np.full((2, m, sizes.shape[1]), np.nan)
        for home, size in zip(homes, sizes, strict=True):
            # Points before the first ones may have the shared components alone.
            shared = problem.shared if home.xs.shape[1] == first.xs.shape[1] else slice(None)
            if (x := home.xs[:, shared]).shape[1] == len(size):
                self.home[home.lanes], self.home_rows[home.lanes] = x, home.tangents[:, shared] / size**2
        starts = np.full(m, np.nan)
        starts[first.lanes] = [home.values[0] for home in homes]
        ends = np.column_stack([np.broadcast_to(each, m) for each in (stop, starts if behind is None else behind)])
        if (wrong := ~(abs(ends[first.lanes, 0] - ends[first.lanes, 1]) > 0)).any():
            ahead, back = ends[first.lanes][wrong][0]
            raise InputError(f"a curve goes from {back:g} to {ahead:g}: its bounds must differ")
        requested = np.array(sorted({finite_number("at", value) for value in at}))
        self.limits = Limits(np.sort(ends, axis=1), starts, requested)
        length = np.clip(options.first if lengths is None else lengths, options.shortest, options.longest)
        count = np.sum([np.bincount(each.lanes, minlength=m) for each in self.blocks], axis=0)
        length, batch = np.array(np.broadcast_to(length, m), float), np.full(m, options.batch)
        self.progress = Progress(length, batch, np.zeros(m), count, np.zeros(m, int), np.zeros(m, bool))
        self.groups = [Group.of(problem, self.blocks, options.memory, certified)] if len(first) else []
        self._to_yield: list[Item] = [first] if len(first) else []

    def __getstate__(self) -> dict[str, object]:
        """The pickled state, with the equations at the last points of each curve alone."""
        last = {lane: i for i, each in enumerate(self.blocks) for lane in each.lanes.tolist()}
        blocks = [each if i in last.values() else each.having(evaluation=None) for i, each in enumerate(self.blocks)]
        return vars(self) | {"blocks": blocks}

    def __iter__(self) -> Iterator[Item]:
        items = list[Item]()
        while self.groups and not self.groups[-1].certified:
            items += self.advance()
        first, self._to_yield = self._to_yield, []
        yield from [*first, *items]
        while self.groups:
            yield from self.advance()

    def passed(self, lane: int) -> "Passed":
        """The points of a lane, in order."""
        return Passed(self.blocks, lane)

    def _steps(self, problem: Problem) -> Steps:
        """The steps along the curves of a problem."""
        return problem.steps or self.options

    def _last(self, lane: int) -> Points:
        """The last point (1) of a lane."""
        block = next(each for each in reversed(self.blocks) if (each.lanes == lane).any())
        return block[np.flatnonzero(block.lanes == lane)[-1:]]

    def advance(self) -> list[Item]:
        """Take a batch of steps along the curves of one problem; returns the items. Raises what the problem raises."""
        heed()
        group = self.groups[-1]
        before, blocks = (self.progress.copy(), [group.copy() for group in self.groups]), len(self.blocks)
        try:
            if group.is_new and (ends := self._ends(group, {})):  # as at a first point on a bound
                if not group.certified:
                    self._certify(group, self.blocks[-1][:0])
                return ends
            progress, limits, group.is_new = self.progress, self.limits, False
            batch, tails = steps_of(group, progress, limits, options := self._steps(group.problem)), group.tails
            points, refused = points_of(group, batch, self._certify, self._last, progress, limits, options)
            items = self._items(group, points, tails, refused) if len(points) else []
            return items + self._ends(group, refused)
        except BaseException:
            self.progress, self.groups = before
            del self.blocks[blocks:]
            raise

    def _certify(self, group: Group, points: Points) -> tuple[Points, Mapping[int, object]]:
        """The certified points of a batch, with the errors of others; the first points too, if they are not yet."""
        if group.certified:
            return group.problem.certify(points) if len(points) else (points, {})
        first, points, errors = group.problem.certify_first(self.blocks[-1], points)
        self.blocks[-1], self._to_yield = first, [first] if self._to_yield else []
        left = np.isin(first.lanes, group.lanes)  # others have ended at their bounds
        group.values, group.certified = values_of(group.problem, first)[1][left], True
        return points, errors

    def _items(self, group: Group, points: Points, tails: Tails, refused: dict[int, object]) -> list[Item]:
        """The items of the next points of lanes behind tails: the points of all lanes on which nothing happens
        together, then those of each other lane in turn, up to where something happens that cannot be located."""
        lanes, k = points.lanes, group.lanes.searchsorted(points.lanes)
        first, (columns, values) = is_first(lanes), values_of(group.problem, points)
        behind = points.xs, points.tangents, values
        last = tails.xs[:, -1], tails.tangents[:, -1], group.values
        xs, tangents, before = (np.concatenate([each[:1], each[:-1]]) for each in behind)
        begun = k[first]
        for array, of_lane in zip((xs, tangents, before), last, strict=True):
            array[first] = of_lane[begun]
        segments = Segments(lanes, xs, points.xs, tangents, points.tangents)
        group.values = group.values.copy()
        group.values[k] = values  # the last one of each lane stays
        busy = self._may_happen(group.problem, segments, changes([test for test, _ in columns], before, values))
        if not busy.any():
            return self._block(points)
        # At the first point of a curve that goes on, the change of its problem is an event again, up to rounding.
        begins = first & (tails.known[k].sum(1) == 1) & (self.progress.count[lanes] > 1)
        items = self._block(points[~np.isin(lanes, lanes[busy])])
        # Of each lane the first segment on which something may happen, of all lanes together; then the next one.
        parts = {
            lane: Part(points, np.flatnonzero(lanes == lane), busy) for lane in dict.fromkeys(lanes[busy].tolist())
        }
        options = self._steps(group.problem)
        while parts:
            which = np.array([part.busy[0] for part in parts.values()])
            found: dict[int, list[Found]] = {i: [] for i in which.tolist()}
            own = segments.only(which)
            for each in located(group.problem, columns, own, before[which], values[which], options):
                i = int(which[each.segment])
                if not (begins[i] and each.share * points.lengths[i] <= options.same):
                    found[i].append(each)
            for lane, part in [*parts.items()]:
                i = part.busy.pop(0)
                ended = self._on_segment(group, part, i, segments.only([i]), found[i])
                if part.unlocated:
                    refused[lane] = OrbitsError(f"the next event cannot be located ({part.unlocated})")
                    self._take_back(group, lane, part, i, tails, before[i])
                    ended = True
                elif ended:  # a later point of its batch may have been refused
                    refused.pop(lane, None)
                if ended or not part.busy:
                    items += part.items if ended else [*part.items, *self._block(part.points[part.begun : part.end])]
                    del parts[lane]
        return items

    def _take_back(self, group: Group, lane: int, part: Part, i: int, tails: Tails, values: Array) -> None:
        """Go on with a lane of a group from the point before point `i`, by shorter steps."""
        k, options = np.searchsorted(group.lanes, [lane]), self._steps(group.problem)
        mine = tails.of_lanes(k)
        if i > part.first:
            mine = mine.with_next(np.zeros(1, int), part.points.xs[i - 1 : i], part.points.tangents[i - 1 : i])
        group.tails = Tails(*(each.copy() for each in group.tails))
        for whole, own in zip(group.tails, mine, strict=True):
            whole[k] = own
        group.values[k] = values
        length = options.shorter * float(part.points.lengths[i])
        self.progress.shorten(lane, length, i - part.first, True, options)

    def _may_happen(self, problem: Problem, segments: Segments, changing: Array) -> Array:
        """On which segments (q,) something may happen, as where tests change (q, c)."""
        value, (low, high) = segments.b[:, -1], self.limits.bounds[segments.lanes].T
        busy = (value < low) | (value > high)
        busy |= changing.any(1)
        busy |= segments.tangents[:, -1] * segments.tangents_b[:, -1] < 0
        if len(at := self.limits.at):
            lowest, highest = np.minimum(segments.a[:, -1], value), np.maximum(segments.a[:, -1], value)
            busy |= np.isin(value, at) | (np.searchsorted(at, lowest, "right") < np.searchsorted(at, highest))
        return busy | self._comes_home(problem, segments)

    def _comes_home(self, problem: Problem, segments: Segments) -> Array:
        """Which segments (q,) pass the first point of their curve, by the rows there."""
        shared, home, rows = problem.shared, self.home[segments.lanes], self.home_rows[segments.lanes]
        a, b = segments.a[:, shared], segments.b[:, shared]
        if a.shape != home.shape:
            return np.zeros(len(home), bool)
        passes = ((a - home) * rows).sum(1) < 0
        if passes.any():
            passes &= ((b - home) * rows).sum(1) >= 0
            sizes = problem.size(segments.lanes, segments.a)[:, shared]
            away, chord = (home - a) / sizes, (b - a) / sizes
            passes &= (away * away).sum(1) <= FARTHEST**2 * (chord * chord).sum(1)
        return passes

    def _on_segment(self, group: Group, part: Part, i: int, segment: Segments, found: list[Found]) -> bool:
        """Add the items on a segment (1) that ends at point `i` to those of its lane, up to where this ends or
        continues as the curve of another problem; whether it does."""
        lane, here, value = int(segment.lanes[0]), part.points[i : i + 1], float(part.points.values[i])
        low, high = self.limits.bounds[lane]
        own_places, missing = self._of_run(group.problem, segment, here)
        found = sorted([*found, *own_places], key=lambda each: each.share)
        own = [(each.kind, each.point.values[0]) for each in found if each.test is None and each.point is not None]
        if not low <= value <= high and not any(kind == CLOSED or at in (low, high) for kind, at in own):
            part.unlocated = f"the bound {low if value < low else high:g}"
        lost = (each.kind for each in found if each.point is None and each.test and each.test.does != ASKS)
        part.unlocated = next(lost, part.unlocated or missing)
        if part.unlocated:
            part.items += self._block(part.points[part.begun : i])
            return False
        slack = OUTSIDE * abs(float(segment.b[0, -1] - segment.a[0, -1]))
        for each in found:
            point, does = each.point or here, each.test.does if each.test else CHANGES
            if not low - slack <= point.values[0] <= high + slack:  # it lies behind a bound, where the curve ends
                continue
            part.items += self._block(part.points[part.begun : i + (point is here)])
            part.begun = i + (point is here)
            part.items += self._block(point) if point is not here and does == CHANGES else []
            event = Event(each.kind, int(self.progress.count[lane]) - 1, point, which=each.which)
            onward = self._after(group.problem, event, does if each.test else "")
            requested = each.kind == VALUE and point.values[0] in self.limits.at and onward is None
            if does != ASKS if each.test else requested:
                part.items.append(event)
            if onward:
                part.items += self._leads_on(group, onward, lane)
                return True
        return False

    def _of_run(self, problem: Problem, segment: Segments, point: Points) -> tuple[list[Found], str]:
        """The requested values and the bounds of the parameter on a segment (1) up to a point (1), and the first point
        of its curve; and a value that is passed and not found, in words."""
        lane, options = int(segment.lanes[0]), self._steps(problem)
        own = [Found(0, 1.0, VALUE, None)] if point.values[0] in self.limits.at else []
        values = {*self.limits.at.tolist(), *self.limits.bounds[lane].tolist()}
        hits, missing = landings(problem, segment, values, float(point.lengths[0]), options)
        own += [Found(0, share, VALUE, place) for share, place in hits]
        near = self._comes_home(problem, segment)[0]
        if near and (home := closing(problem, segment, self.home[lane], self.home_rows[lane], options)):
            # A requested value there is that of the first point, on whichever side of it rounding puts the hit.
            own = [each for each in own if abs(each.share - home[0]) > OUTSIDE]
            own.append(Found(0, home[0], CLOSED, home[1]))
        return own, "" if missing is None else f"the value {missing:g}"

    def _after(self, problem: Problem, event: Event, does: str) -> Start | End | None:
        """What follows an event of a test with this purpose, or of the run itself."""
        lane, value = int(event.point.lanes[0]), float(event.point.values[0])
        if does:
            return problem.changed(event, self.passed(lane)) if does != HAPPENS else None
        if event.kind == CLOSED:
            return End(CLOSED, "the curve comes back to its first point")
        return End("reached", f"{value:g}") if value in self.limits.bounds[lane] else None

    def _ends(self, group: Group, refused: dict[int, object]) -> list[Item]:
        """The ends of curves at a bound or after the largest number of points, and what follows lost curves."""
        lanes, progress, options = group.lanes, self.progress, self._steps(group.problem)
        value, rate = group.tails.xs[:, -1, -1], group.tails.tangents[:, -1, -1]
        low, high = self.limits.bounds[lanes].T
        arrived = (value >= high) & (rate > 0) | (value <= low) & (rate < 0)
        many = progress.count[lanes] >= options.most
        ends, items = arrived | many, list[Item]()
        if refused:
            hard = (progress.length[lanes] <= options.shortest) | (progress.rejections[lanes] > options.rejections)
            ends |= hard & np.isin(lanes, [*refused])
        for k in ends.nonzero()[0].tolist():
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
        if onward.passed:
            kind, point = onward.passed
            event = Event(kind, int(self.progress.count[lane]) - 1, point.having(lanes=np.array([lane])))
            return [event, *self._leads_on(group, onward._replace(passed=None), lane, is_new)]
        first, options = self._first_of(onward, lane), self._steps(onward.problem)
        again = onward.problem is group.problem and self.progress.count[lane] == self.progress.begun[lane]
        if not len(first) or (is_new and again):
            return [End("stuck", "the curve does not continue where its problem changes or beyond its corner", lane)]
        self.progress.begin(lane, options, is_new)
        begun = Group.of(onward.problem, [first], options.memory)
        if same := next((each for each in self.groups if each.problem is onward.problem), None):
            same.take(same.joined(begun))
        else:
            self.groups.append(begun)
        if is_new:
            return self._block(first)
        self.blocks.append(first)  # the point where the problem changes, as one of the other problem
        return []

    def _first_of(self, start: Start, lane: int) -> Points:
        """The first point (1) of a curve that continues; none where there is no such point."""
        if start.point is not None:
            return start.point.having(lanes=np.array([lane]), lengths=np.zeros(1))
        lanes, x, tangent, problem = np.array([lane]), start.x[None], start.tangent[None], start.problem
        row = tangent / problem.size(lanes, x) ** 2
        return solved_at(problem, lanes, x, Border(row, (row * x).sum(1)), tangent, self._steps(problem))

    def _block(self, points: Points) -> list[Item]:
        """Points as an item, where there are any; they are the next ones of their lanes."""
        if not len(points):
            return []
        self.blocks.append(points)
        self.progress.count += np.bincount(points.lanes, minlength=len(self.progress.count))
        return [points]
