"""A batch: the steps of the curves of one problem, and the certified points on these steps."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .bordered_newton import some
from .curve_events import values_of
from .curve_steps import Chain, Division, Tails, between, is_first, step, up_to_the_first
from .protocol import Array, Points, Problem
from .step_options import Steps

# Why points of a batch are rejected, which does not mean that the curve is hard to follow: those between the ends of
# long steps are not solved, or they are not neighbours, which is approached by many shorter steps.
UNSOLVED, ANOTHER = "the corrector does not converge", "the next point lies on another curve"


@dataclass(eq=False)
class Group:
    """The curves of one problem that are followed.

    lanes : (k,), in order
    tails : the points from which their next ones are predicted
    values : the values (k, c) of the tests at their last points, if these are certified already
    is_new : whether some have begun, perhaps at their bounds, since the last batch
    """

    problem: Problem
    lanes: Array
    tails: Tails
    values: Array
    certified: bool = True
    is_new: bool = True

    @classmethod
    def of(cls, problem: Problem, blocks: Sequence[Points], memory: int, certified: bool = True) -> "Group":
        """The curves that continue from the points (k) of the last block; in earlier blocks are points before these."""
        last = blocks[-1]
        values = values_of(problem, last)[1] if certified else np.empty((len(last), 0))
        return cls(problem, last.lanes, Tails.of(blocks, last.lanes, memory), values, certified)

    def only(self, which: Array) -> "Group":
        """The curves with some indices."""
        return replace(self, lanes=self.lanes[which], tails=self.tails.of_lanes(which), values=self.values[which])

    def copy(self) -> "Group":
        """A copy of these curves, to continue with apart from them."""
        return Group(**vars(self))

    def take(self, other: "Group") -> None:
        """Go on with the curves of another group of the same problem."""
        vars(self).update(vars(other))

    def joined(self, other: "Group") -> "Group":
        """With other curves of the same problem."""
        lanes, values = (
            np.concatenate([getattr(each, name) for each in (self, other)]) for name in ("lanes", "values")
        )
        tails = Tails(*(np.concatenate(pair) for pair in zip(self.tails, other.tails, strict=True)))
        return Group(self.problem, lanes, tails, values).only(np.argsort(lanes))


@dataclass(eq=False)
class Progress:
    """What changes in each lane (m,).

    length : of its next step
    batch : largest number of points of its next batch
    rejections : number of its rejected batches, less what accepted points offset
    count : number of its points
    begun : that number where it last began behind a corner
    passes : whether its next step passes the bound ahead
    """

    length: Array
    batch: Array
    rejections: Array
    count: Array
    begun: Array
    passes: Array

    def copy(self) -> "Progress":
        """A copy of all arrays."""
        return Progress(*(each.copy() for each in vars(self).values()))

    def shorten(self, lane: int, length: float, accepted: int, counts: bool, options: Steps) -> None:
        """Go on with steps of this length, one in each batch, after a batch that is rejected behind some points, which
        counts among the rejections or not."""
        self.rejections[lane] = max(self.rejections[lane] - accepted / options.recovery, 0.0) + counts
        self.length[lane], self.batch[lane] = length, 1

    def begin(self, lane: int, options: Steps, anew: bool) -> None:
        """Go on with a short step, where the problem changes or again behind a corner."""
        self.length[lane] = min(options.first, np.inf if anew else self.length[lane])
        self.batch[lane], self.passes[lane] = 1, False
        if anew:
            self.rejections[lane], self.begun[lane] = 0, self.count[lane] + 1


class Limits(NamedTuple):
    """The bounds (m, 2) of the parameter in each lane, its first value (m,) there, and the requested values in
    order."""

    bounds: Array
    first: Array
    at: Array

    def ahead(self, lanes: Array, values: Array, options: Steps) -> Array:
        """The bounds (k, 2) up to which steps of lanes (k,) go from values (k,): without points between the ends of
        steps, requested values too."""
        if not len(self.at) or options.divided:
            return self.bounds[lanes]
        ends = np.concatenate([[-np.inf], self.at, [np.inf]])
        below, above = ends[np.searchsorted(ends, values) - 1], ends[np.searchsorted(ends, values, side="right")]
        low, high = self.bounds[lanes].T
        return np.column_stack([np.maximum(low, below), np.minimum(high, above)])

    def inside(self, lanes: Array, a: Array, b: Array) -> list[Array]:
        """The requested values that are passed on each of some steps between values a and b (g,)."""
        low, high = np.minimum(a, b)[:, None], np.maximum(a, b)[:, None]
        inside = (self.at > low) & (self.at < high) & (self.at != self.first[lanes][:, None])
        return [self.at[each] for each in inside]


class Batch(NamedTuple):
    """The steps of a batch in rounds; each round is one step of some curves.

    ends, borders, parts : the ends of the steps, the rows and levels at which they were found, and the numbers of parts
    tails : those of the group with these ends
    refused : the lanes without a step, with the reason
    """

    ends: list[Points]
    borders: list[tuple[Array, Array]]
    parts: list[Array]
    tails: Tails
    refused: dict[int, object]


def steps_of(group: Group, progress: Progress, limits: Limits, options: Steps) -> Batch:
    """The steps of a batch. A curve takes several where points lie between their ends, until a step turns round,
    arrives at a bound, or is rejected behind others."""
    batch = Batch([], [], [], group.tails, {})
    going, filled = np.arange(len(group.lanes)), np.zeros(len(group.lanes), int)
    while len(going):
        own = some(going, len(group.lanes))
        lanes, tails = group.lanes[own], batch.tails.of_lanes(own)
        bounds = limits.ahead(lanes, tails.xs[:, -1, -1], options)
        if (over := progress.passes[lanes]).any():
            bounds = np.where(over[:, None], [-np.inf, np.inf], bounds)
        before = progress.length[lanes]
        ends = (taken := step(group.problem, lanes, tails, before, bounds, options)).ends
        progress.length[lanes], progress.passes[lanes], again = taken.lengths, False, going[:0]
        accepted, parts = going[taken.which], np.ones(len(taken.which), int)
        if options.divided:
            parts = np.maximum(np.ceil(ends.lengths / options.apart).astype(int), 2)
        filled[accepted] += parts
        batch.ends.append(ends)
        batch.borders.append((taken.rows, taken.levels))
        batch.parts.append(parts)
        batch = batch._replace(tails=batch.tails.with_next(accepted, ends.xs, ends.tangents))
        if taken.reasons:
            # The curve may turn round before a bound, or its equations be singular there: then a step goes beyond it.
            passes = np.isfinite(taken.missed)
            progress.passes[lanes] = passes
            progress.length[lanes[passes]] = np.minimum(before[passes], taken.missed[passes] + options.apart)
            again = going[filled[going] == 0]
            is_late = (progress.length[group.lanes[again]] <= options.shortest) | (not options.divided)
            late, again = again[is_late], again[~is_late]
            for k in late.tolist():
                batch.refused[int(group.lanes[k])] = taken.reasons[int(np.searchsorted(going, k))]
            batch = _rescued(group, batch, progress, late, options) if options.divided else batch
        if not options.divided:
            break
        (low, high), value, rate = limits.bounds[ends.lanes].T, ends.values, ends.tangents[:, -1]
        onward = (tails.tangents[taken.which, -1, -1] * rate > 0) & (low < value) & (value < high) & ~taken.arrives
        onward &= (filled[accepted] < progress.batch[ends.lanes]) & (ends.growths <= options.grown)
        going = accepted[onward]
        if len(again):
            going = np.sort(np.concatenate([again, going]))
    return batch


def _rescued(group: Group, batch: Batch, progress: Progress, late: Array, options: Steps) -> Batch:
    """The batch with a step of each of some curves (j,) that no step reaches, where their problem knows one."""
    for k in late.tolist():
        lane, tails = group.lanes[k : k + 1], batch.tails.of_lanes(np.array([k]))
        if found := group.problem.rescued(lane, tails.xs[:, -1], tails.tangents[:, -1], options.first):
            end, border = found
            batch.ends.append(end.having(lengths=np.array([options.first])))
            batch.borders.append((border.rows, border.levels))
            batch.parts.append(np.ones(1, int))
            batch = batch._replace(tails=batch.tails.with_next(np.array([k]), end.xs, end.tangents))
            batch.tails.known[k, :-1] = False  # points before it may lie too close to each other to predict the next
            progress.length[lane] = options.first
            del batch.refused[int(lane[0])]
    return batch


Certify = Callable[[Group, Points], tuple[Points, Mapping[int, object]]]


def points_of(
    group: Group, batch: Batch, certify: Certify, last: Callable[[int], Points], progress: Progress, limits: Limits,
    options: Steps,
) -> tuple[Points, dict[int, object]]:  # fmt: skip
    """The certified points of a batch, of each lane up to the first that is rejected, and the reasons for these by
    lane. The group continues from the last points; `last` tells the last point (1) of a lane before the batch."""
    points, is_end, failed = _solved(group, batch, limits, options)
    why: dict[int, object] = dict.fromkeys(failed.tolist(), UNSOLVED)
    for judged in (certify, lambda group, points: (points, _others(group.problem, points, last))):
        points, errors = judged(group, points)
        if errors:
            bad = np.isin(np.arange(len(points)), [*errors])
            why |= {int(points.lanes[i]): error for i, error in sorted(errors.items(), reverse=True)}
            sound = up_to_the_first(points.lanes, bad)
            points, is_end = points[sound], is_end[sound]
    cut = set[int]()
    if progress.count.max() + len(points) > options.most:
        first = np.maximum.accumulate(np.where(is_first(points.lanes), np.arange(len(points)), 0))
        within = np.arange(len(points)) - first < options.most - progress.count[points.lanes]
        cut, points, is_end = {*points.lanes[~within].tolist()}, points[within], is_end[within]
    tails = batch.tails
    if shortened := cut | why.keys():
        tails = Tails(*(each.copy() for each in tails))
        for lane in shortened:
            k, own = int(np.searchsorted(group.lanes, lane)), np.flatnonzero(points.lanes == lane)
            for whole, before in zip(tails, group.tails, strict=True):
                whole[k] = before[k]
            # The accepted ends of steps, and the last accepted point.
            for i in own[is_end[own] | (own == own[-1:])][-options.memory :].tolist():
                tails = tails.with_next(np.array([k]), points.xs[[i]], points.tangents[[i]])
            if lane in why:
                gap = _gap(batch, lane, len(own), divided=bool(len(own)) or why[lane] != UNSOLVED)
                progress.shorten(lane, options.shorter * gap, len(own), why[lane] not in (UNSOLVED, ANOTHER), options)
    group.tails, fine = tails, group.lanes[~np.isin(group.lanes, [*why])] if why else group.lanes
    progress.batch[fine] = np.minimum(options.growth * progress.batch[fine], options.batch)
    return points, batch.refused | why


def _others(problem: Problem, points: Points, last: Callable[[int], Points]) -> dict[int, str]:
    """The certified points that are not neighbours of the points before them, by index, with the reason."""
    if type(problem).accepts is Problem.accepts or not len(points):
        return {}
    first = is_first(points.lanes)
    begins, goes_on = np.flatnonzero(first), np.flatnonzero(~first)
    good = np.ones(len(points), bool)
    good[goes_on] = problem.accepts(points[goes_on - 1], points[goes_on])
    for i in begins.tolist():
        good[i] = problem.accepts(last(int(points.lanes[i])), points[i : i + 1])[0]
    return dict.fromkeys(np.flatnonzero(~good).tolist(), ANOTHER)


def _solved(group: Group, batch: Batch, limits: Limits, options: Steps) -> tuple[Points, Array, Array]:
    """The points of a batch in order of their lanes, whether each is the end of a step, and the lanes in which one is
    not found."""
    if not options.divided:
        return batch.ends[0], np.ones(len(batch.ends[0]), bool), np.empty(0, int)
    chain, places, order = Chain.of(group.lanes, group.tails, batch.ends)
    if not len(places):
        return batch.ends[0], np.empty(0, bool), np.empty(0, int)
    rows, levels = (np.concatenate(each)[order] for each in zip(*batch.borders, strict=True))
    a, b, lanes = places - 1, places, chain.lanes[places]
    values = limits.inside(lanes, chain.xs[a, -1], chain.xs[b, -1])
    straight = chain.tangents[a, -1] * chain.tangents[b, -1] > 0  # else the parameter may pass a value twice
    values = [own if one else own[:0] for own, one in zip(values, straight.tolist(), strict=True)]
    parts = np.concatenate(batch.parts)[order]
    points, is_end, whole = between(group.problem, Division(chain, places, rows, levels, parts, values), options)
    return points, is_end, lanes[~whole]


def _gap(batch: Batch, lane: int, accepted: int, divided: bool) -> float:
    """The distance of points behind the last accepted one of a lane in a batch, or the length of the step there, if it
    is not to be divided."""
    own = [each.lanes == lane for each in batch.ends]
    parts = np.concatenate([each[mine] for each, mine in zip(batch.parts, own, strict=True)])
    lengths = np.concatenate([each.lengths[mine] for each, mine in zip(batch.ends, own, strict=True)])
    i = min(int(np.searchsorted(np.cumsum(parts), accepted, side="right")), len(parts) - 1)
    return float(lengths[i] / (parts[i] if divided else 1))
