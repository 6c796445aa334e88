"""A walk along a curve of orbits: long steps with control, the points in between, and how it all ends.

A step of length s along the unit tangent t from X0 is the solution of F(X) = 0, t . (X - X0) = s. Its prediction is the
Hermite interpolant of the last points and tangents; a corrector that has to go far may have found another curve, and
the step is refused. Then the curve is solved again between the ends of several steps, at one place of each at least and
as closely as asked: the interpolant through the ends must lead there too.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, groupby, pairwise
from operator import ge
from typing import NamedTuple

import numpy as np

from ..errors import NoOrbit, OrbitsError
from ..periodic.orbit import Orbit
from .corrector import MEMORY, Curve, CurvePoint, interpolated
from .events import Segment
from .family import End, Event
from .limits import limit
from .predictor import around

# In shares of the curve's own size: the first step, the shortest, the longest where points are asked for more closely,
# and what a corrector may move of a step's length.
FIRST_ARC, SHORTEST_ARC, LONGEST_ARC, LARGEST_CORRECTION = 5e-3, 1e-5, 0.2, 1e-2
# What the step control aims at for the corrector's first step, times the root of the motion's growth: then its second
# is mostly its last.
AIM = 1e-5
# The largest angle between two tangents, in radians.
LARGEST_TURN = 0.25
# An orbit this many times faster, longer or smaller than the first is on its way to infinity or to nothing, if it is
# clear what the parameter tends to.
ESCAPE_RATIO = 1e2
# A curve that is lost within this share of the parameter's way has not begun.
DECADES = 1e-3
# A motion that makes more of a small change, as it hangs at an unstable equilibrium, is beyond shooting in one piece.
LARGEST_GROWTH = 3e7
# A curve that is lost after the launch speed has grown this much was running off.
RUNNING_RATIO = 2.0
# Ipopt is asked at a value of the parameter, which must move by this share of a step.
STEEP = 0.1
# Points that differ by less are the same.
SAME_POINT = 1e-9
# Refusals that end the walk, where so many good points make up for one: what rounding blurs is not crawled along.
PATIENCE, REST = 16, 20
# Points that are solved between steps and certified together; and once something has been refused, how many times as
# many every time that all goes well, from one on.
LARGEST_BATCH, CAREFULLY = 160, 4
# Points are solved together by up to this many times as many steps as they need.
ALIKE = 1.1
# Points on either side that those between two rest on.
SIDE = 3
# Of a step's points, none but those asked for lie this near to another, as a share of their distance.
APART = 0.1


@dataclass(frozen=True)
class Options:
    """What a walk is to do, as in `follow`."""

    at: tuple[float, ...] = ()
    watch: Mapping[str, Callable[[Orbit], float]] | None = None
    longest: float = 0.02
    most: int = 10_000
    stop_inadmissible: bool = False


class Batch(NamedTuple):
    """The next points of a walk.

    good : certified, up to the first that is refused
    refused, refusal : that one, and why; None where there is none
    knots : the ends of the steps
    failure : the error that allows no more steps, None where there is none
    whole : whether the curve could be solved on all of the steps, not just on the first of them
    """

    good: Sequence[CurvePoint]
    refused: CurvePoint | None
    refusal: OrbitsError | None
    knots: list[CurvePoint]
    failure: OrbitsError | None
    whole: bool


class Tracer:
    """Steps along a curve from a point of it, with what happens in each.

    Points are solved between the ends of steps and certified several at a time; where one cannot be, or is of another
    family, the steps are taken again from before it, shorter and one by one.
    """

    def __init__(self, curve: Curve, first: CurvePoint, behind: float, stop: float, options: Options, earlier=()):
        self.curve, self.first, self.options = curve, first, options
        self.behind, self.stop, self.bounds = behind, stop, (min(behind, stop), max(behind, stop))
        self.start = earlier[0].value if earlier else first.value
        self.last, self.knots = first, [first]  # the last point, and the ends of the last steps
        self.length = min(FIRST_ARC, options.longest)
        self.count = min(LARGEST_BATCH, options.most)  # points to certify at a time
        self.trouble = 0.0  # refusals of late
        self.ahead = None if first.point else self.further([first])
        every = [*earlier, first.point]
        self.origin = every[0]
        self.seen = [(point.alpha, point.value) for point in every]

    def __iter__(self) -> Iterator[CurvePoint | Event | End]:
        """The points of the curve, first to last, each event before the point that follows it, and the end."""
        yield self.first
        index = 0
        if self.options.stop_inadmissible and not self.first.point.admissible:
            yield End("stopped", "no motion to begin with: " + self.first.point.violations[0])
            return
        while True:
            self.count = min(self.count, self.options.most - index)
            batch, self.ahead = self.ahead or self.further(), None
            good, refused, refusal, knots, failure, whole = batch
            for there in good:
                try:
                    stretch, end = self.ended(Segment(self.curve, self.last, there))
                    happening = stretch.events(self.options.at, self.options.watch)
                except OrbitsError as error:
                    refusal, refused = NoOrbit(f"what happens next cannot be located ({error})"), there
                    break
                there = stretch.b
                passed = sum(kind == "asked" for kind, _ in happening)
                if index + passed + 1 >= self.options.most:
                    yield End("stopped", f"after {index + 1} points: no more than {self.options.most} were asked for")
                    return
                for kind, at in happening:
                    if kind == "asked":
                        index += 1
                        yield at
                    yield Event(kind, index, at.point)
                index += 1
                yield there
                if end is None and there.value in self.options.at:
                    yield Event("asked", index, there.point)
                self.seen.append((there.point.alpha, there.value))
                self.last = there
                if end := end or self.far(there):
                    yield end
                    return
            if refusal is None and failure is None:
                self.knots = [*self.knots, *knots][-MEMORY:]
                self.count = min(CAREFULLY * self.count, LARGEST_BATCH) if whole else 1
                continue
            done = good[: good.index(refused)] if refused in good else good
            self.knots = [*self.knots, *(at for at in knots if at in done)]
            if self.knots[-1] is not self.last:
                self.knots.append(self.last)
            self.knots, self.count = self.knots[-MEMORY:], 1
            if refused is not None:
                self.length = 0.5 * refused.length
                self.trouble = max(self.trouble - len(good) / REST, 0.0) + 1
            if failure is not None or self.length <= SHORTEST_ARC or self.trouble > PATIENCE:
                yield self.lost(str(refusal or failure))
                return

    def further(self, before: Sequence[CurvePoint] = ()) -> Batch:
        """The next points; those `before` are certified with them, and where they cannot be that error is raised."""
        knots, failure = self.steps()
        ahead, rest = self.believable(knots)
        if rest:
            knots, failure = knots[: -len(rest)], None
            self.length = rest[0].length * rest[0].parts * (1.0 if knots else 0.5)
        good, refusal = self.certified([*before, *ahead])
        if len(good) < len(before):
            raise refusal
        good = good[len(before) :]
        return Batch(good, ahead[len(good)] if refusal else None, refusal, knots, failure, not rest)

    def steps(self) -> tuple[list[CurvePoint], OrbitsError | None]:
        """The ends of the next few steps, not certified yet; and the error that allows no more."""
        knots: list[CurvePoint] = []
        while sum(at.parts for at in knots) < self.count:
            try:
                at = self.step([*self.knots, *knots][-MEMORY:])
            except OrbitsError as error:
                return knots, error
            knots.append(at)
            if not self.within(at) or at.amplification > LARGEST_GROWTH:
                break
        return knots, None

    def believable(self, knots: list[CurvePoint]) -> tuple[list[CurvePoint], list[CurvePoint]]:
        """The points of the first of the steps that end with `knots`, as far as the curve can be solved between them;
        and the ends of the others."""
        count = len(knots)
        while count:
            try:
                return self.filled(knots[:count]), knots[count:]
            except OrbitsError:
                count //= 2
        return [], knots

    def filled(self, knots: list[CurvePoint]) -> list[CurvePoint]:
        """The points of steps that end with `knots`: these, and those between, solved all together. Raises `NoOrbit`
        when one of them may lie on another curve."""
        chain = [*self.knots[-SIDE:], *knots]
        before = len(chain) - len(knots) - 1
        legs, guesses, rows, levels, asked = self._between(chain, before)
        tangents = np.array([at.tangent for at in chain[before:-1]])[legs]
        stops = np.searchsorted(legs, np.arange(len(knots)), side="right")
        solved: list[CurvePoint] = []
        needed = [_most(a.counts, b.counts) for a, b in pairwise(chain[before:])]
        counts = list(accumulate(reversed(needed), _either))[::-1]
        for _, same in groupby(range(len(knots)), key=counts.__getitem__):
            *_, last = same
            some = slice(len(solved), int(stops[last]))
            if some.start < some.stop:
                self.curve.counts = counts[last]
                solved += self.curve.correct_all(guesses[some], rows[some], levels[some], tangents[some])
        for i in np.flatnonzero(asked):
            solved[i].x[-1] = levels[i]
        starts, points = [0, *stops], []
        for start, stop, knot in zip(starts, stops, knots, strict=False):
            points += [*solved[start:stop], knot]
        guesses = np.insert(guesses, stops, [at.x for at in knots], axis=0)
        lengths = np.repeat([at.length for at in knots], np.diff(starts) + 1)
        self.trusted(self.knots[-1], points, guesses, lengths)
        return points

    def _between(self, chain: list[CurvePoint], before: int) -> tuple[np.ndarray, ...]:
        """Where the curve is solved on the legs of a chain from its point `before` on, in order: the leg (q,), the
        guess, row and level as in `Curve.correct_all`, and whether the parameter's value was asked for. Such values are
        among them unless it turns round on the leg."""
        xs, tangents = (np.array(part) for part in ([at.x for at in chain], [at.tangent for at in chain]))
        chords, ends = np.diff(xs[before:], axis=0), np.arange(before + 1, len(chain))
        rows = chords / self.curve.size(xs[before:-1]) ** 2
        rows /= np.einsum("gi,gi->g", rows, chords)[:, None]
        starts, parts = np.einsum("gi,gi->g", rows, xs[before:-1]), np.array([at.parts for at in chain[before + 1 :]])
        legs = np.repeat(np.arange(len(parts)), parts - 1)
        shares = np.concatenate([np.arange(1, count) / count for count in parts])
        passed, values = self._asked(xs[before:, -1], tangents[before:, -1])
        if len(passed):
            ahead = np.tile(np.eye(xs.shape[1])[-1], (len(passed), 1))
            asked, _ = around(xs, tangents, ends[passed], SIDE, SIDE, ahead, values)
            taken = np.einsum("qi,qi->q", rows[passed], asked) - starts[passed]
            crowded = np.abs(shares[:, None] - taken) * parts[legs][:, None] <= APART
            free = ~(crowded & (legs[:, None] == passed)).any(1)
            legs, shares = legs[free], shares[free]
        levels = starts[legs] + shares
        guesses, _ = around(xs, tangents, ends[legs], SIDE, SIDE, rows[legs], levels)
        places = legs, guesses, rows[legs], levels, np.zeros(len(legs), bool)
        if not len(passed):
            return places
        order = np.lexsort((np.append(shares, taken), np.append(legs, passed)))
        others = passed, asked, ahead, values, np.ones(len(passed), bool)
        return tuple(np.concatenate(each)[order] for each in zip(places, others, strict=True))

    def _asked(self, values, rates) -> tuple[np.ndarray, np.ndarray]:
        """The legs (h,) between points with these values of the parameter on which it passes one asked for, and that
        (h,); `rates` tell where it turns round."""
        asked = np.array([value for value in self.options.at if value != self.start])
        if self.count == 1 or not len(asked):
            return np.zeros(0, int), asked[:0]
        low, high = np.minimum(values[:-1], values[1:])[:, None], np.maximum(values[:-1], values[1:])[:, None]
        legs, which = np.nonzero((low < asked) & (asked < high) & (rates[:-1] * rates[1:] > 0)[:, None])
        return legs, asked[which]

    def certified(self, ahead: list[CurvePoint]) -> tuple[list[CurvePoint], OrbitsError | None]:
        """The points that are certified, up to the first that is not, and its error."""
        good, refusal = self.curve.checked(ahead)
        family = (self.last.point or good[0].point).family if good else None
        for i, there in enumerate(good):
            if there.point.family != family and there.length > 10 * SHORTEST_ARC:
                there.point = None
                return good[:i], NoOrbit(f"the orbit changes from family {family} to another one")
            family = there.point.family
        return good, refusal

    def within(self, at: CurvePoint) -> bool:
        """Whether a point lies between the bounds."""
        return self.bounds[0] < at.value < self.bounds[1]

    def ended(self, stretch: Segment) -> tuple[Segment, End | None]:
        """A stretch from the last point to the next, or to where the curve ends before that."""
        curve, here, there = self.curve, stretch.a, stretch.b
        if again := self.closed(here, there):
            return Segment(curve, here, again), End("closed", "the curve comes back to its first orbit")
        if self.within(there) and stretch.fold is not None:  # a fold between may lie beyond a bound
            fold = stretch(stretch.fold)
            there = there if self.within(fold) else fold
        if not self.within(there):
            bound = self.bounds[0] if there.value <= self.bounds[0] else self.bounds[1]
            back = " again, on another sheet" if bound == self.start else ""
            sheets = stretch.sheets()[-1 if here.value == bound else 0 :]  # not the sheet that starts there
            sheet = next((part for part in sheets if part.reaches(bound)), sheets[-1])
            return Segment(curve, here, sheet.landed(bound)), End("reached", f"{curve.along} = {bound:g}{back}")
        if self.options.stop_inadmissible and not there.point.admissible:
            return stretch, End("stopped", "no motion from here: " + there.point.violations[0])
        return stretch, None

    def share(self, value: float) -> float:
        """How much of the parameter's way lies behind a value."""
        return (value - self.start) / (self.stop - self.start)

    def step(self, knots: list[CurvePoint]) -> CurvePoint:
        """The end of a step, with control of its length; raises the reason when none is short enough."""
        failure, rate = NoOrbit("no step is short enough"), knots[-1].tangent[-1]
        bound = self.bounds[int(rate > 0)]
        while self.length > SHORTEST_ARC:
            left = (bound - knots[-1].value) / rate if rate else np.inf
            try:
                if 0 < left <= self.length:
                    try:
                        return self._stepped(knots, left, bound)
                    except OrbitsError:  # it turns before the bound, or passes it elsewhere
                        return self._stepped(knots, min(self.length, left + self.options.longest))
                return self._stepped(knots, self.length)
            except OrbitsError as error:
                failure, self.length = error, 0.5 * self.length
        try:
            return self._rescued(knots)
        except OrbitsError:
            raise failure from None

    def _rescued(self, knots: list[CurvePoint]) -> CurvePoint:
        """The next point by Ipopt's multiple shooting where Newton's method finds none, a first step further in the
        parameter; raises the reason when that fails too."""
        last, curve = knots[-1], self.curve
        row = last.tangent / curve.size(last.x) ** 2
        if abs(last.tangent[-1]) < STEEP * curve.span:
            raise NoOrbit("the parameter's value does not fix the orbit here")
        guess = interpolated([last], row, np.array([row @ last.x + FIRST_ARC]))  # the others may lie too close
        u, _ = curve.equations.multiple_shooting(guess[0, :-1], curve.p(guess)[0])
        point = curve.correct(np.append(u, guess[0, -1]), np.eye(len(last.x))[-1], guess[0, -1], last.tangent)
        self.trusted(last, [point], guess, np.array([FIRST_ARC]))
        self.length = FIRST_ARC
        return point

    def _stepped(self, knots: list[CurvePoint], length: float, value: float | None = None) -> CurvePoint:
        """The end of a step of given length, or of about that where the parameter has a value; raises `NoOrbit` when it
        may lie on another curve."""
        end, guess, rests = self.curve.step(knots, length, value)
        if value is not None:
            end.x[-1] = value
        moved = self.trusted(knots[-1], [end], guess[None], np.array([length]))
        end.parts = max(2, int(np.ceil(length / self.options.longest)))
        end.length = length / end.parts
        if self.count == 1:
            self.filled([end])
        longer = (AIM / max(moved * np.sqrt(end.amplification), 1e-300)) ** (1 / (2 * rests))
        longest = max(LONGEST_ARC, self.options.longest)
        self.length = min(max(self.length, length) * min(max(0.9 * longer, 0.3), 2.0), longest)
        return end

    def trusted(self, last: CurvePoint, points: list[CurvePoint], guesses, lengths) -> float:
        """How far the corrector went from guesses (m, n + 1) to points `lengths` (m,) apart; raises `NoOrbit` when one
        of them may lie on another curve."""
        sizes = self.curve.size(guesses)
        moved = np.linalg.norm((np.array([at.x for at in points]) - guesses) / sizes, axis=1)
        tangents = np.array([at.tangent for at in (last, *points)])
        a, b = tangents[:-1] / sizes, tangents[1:] / sizes
        cosines = np.einsum("mi,mi->m", a, b) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
        turned = float(np.arccos(np.clip(cosines.min(), -1.0, 1.0)))
        if (moved > LARGEST_CORRECTION * lengths).any() or turned > LARGEST_TURN:
            raise NoOrbit(
                f"the corrector moves {moved.max():.1e} in a step of {lengths.min():.1e}, "
                f"the tangent turns by {turned:.2g}"
            )
        for at, length in zip(points, lengths.tolist(), strict=True):
            at.length = length
        return float(moved.max())

    def closed(self, a: CurvePoint, b: CurvePoint) -> CurvePoint | None:
        """The first point of all, if the curve passes it again between two."""
        if abs(self.start - a.value) > 3 * b.length * self.curve.span:  # the chord's length, about
            return None
        size, origin = self.curve.size(a.x), np.array([*self.origin.u, self.start])
        chord, away = (b.x - a.x) / size, (origin - a.x) / size
        share = float(away @ chord / (chord @ chord))
        if (
            a.point is self.origin
            or not 0 < share <= 1 + SAME_POINT
            or np.linalg.norm(away) > 2 * np.linalg.norm(chord)
        ):
            return None
        at = Segment(self.curve, a, b)(share)
        again = np.max(np.abs(at.x - origin) / size) < SAME_POINT and at.tangent @ np.array(self.origin.tangent) > 0
        return self.curve.onto(at, self.start) if again else None

    def far(self, there: CurvePoint) -> End | None:
        """The end of a curve that goes to infinity or to nothing before the parameter gets to a bound."""
        orbit, first = there.point, self.origin
        name, value = self.curve.along, there.value
        if there.amplification > LARGEST_GROWTH:
            return self.lost(f"small changes grow {there.amplification:.0e}-fold over the flight, and rounding decides")
        if orbit.alpha > ESCAPE_RATIO * first.alpha or orbit.flight_time > ESCAPE_RATIO * first.flight_time:
            if (found := limit(self.seen, self.bounds, -1)) is None:
                return None
            if orbit.flight_time / orbit.alpha > ESCAPE_RATIO * first.flight_time / first.alpha:
                return End("degenerate", f"gravity no longer returns the machine near {name} = {value:.6g}", *found)
            if abs(orbit.liftoff_extension) > ESCAPE_RATIO * (1 + abs(first.liftoff_extension)):
                return End("degenerate", f"the spring no longer lifts the foot near {name} = {value:.6g}", *found)
            return End("escaped", "the launch speed grows without bound", *found)
        if orbit.alpha < first.alpha / ESCAPE_RATIO and (found := limit(self.seen, self.bounds, 1)) is not None:
            return End("degenerate", f"the flight shrinks to nothing near {name} = {value:.6g}", *found)
        return None

    def lost(self, reason: str) -> End:
        """The end of a curve that cannot be followed further."""
        alpha, value = self.last.point.alpha, self.last.value
        where = f"{reason}, at {self.curve.along} = {value:.10g}, alpha = {alpha:.10g}"
        if alpha > RUNNING_RATIO * self.origin.alpha and (found := limit(self.seen, self.bounds, -1)) is not None:
            return End("escaped", f"the launch speed grows, and the curve is lost: {where}", *found)
        if abs(value - self.start) < DECADES * self.curve.span:
            where += "; a parameter over decades is followed by its inverse or its logarithm"
        return End("stuck", where)


def _most(a: tuple | None, b: tuple | None) -> tuple | None:
    """As many steps for each arc as at either of two points."""
    return tuple(map(max, a, b)) if a and b else None


def _either(later: tuple | None, counts: tuple | None) -> tuple | None:
    """The numbers of steps further on, where they are enough and not too many for a place before; or those of that."""
    enough = later and counts and all(map(ge, later, counts))
    return later if enough and sum(later) <= ALIKE * sum(counts) else counts
