"""Branches of hops that return along a parameter of the map.

Where the hops have a statement, a branch is followed as a `HopCurve` for each of its words; else as a `LaunchCurve`,
behind corners of the map as `BordersOfCurve` finds them there.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..curves import End, Event, Points, Run, Start
from ..errors import NoOrbit
from ..hops.impacts import STATUSES
from .bifurcation import name_of_hops
from .border_events import BordersOfCurve, distance
from .cycles import INJECT, MapsAlong
from .hop_borders import COLLISION, COLLISIONS, beyond
from .hop_curve import STEPS_OF_HOPS, HopCurve, turned
from .hop_statement import FORCE, Slack, Word
from .launch_curve import AROUND, STEPS_OF_BRANCHES, LaunchCurve, place_in_words
from .periodic_launch import MULTIPLIER_AT, PeriodicLaunch


@dataclass(frozen=True, kw_only=True)
class Branching:
    """Where branches begin, and how far they are followed; distances are shares of the ranges.

    doubled : distances in launch speed, tried in turn, from a flip to the first hops of twice the period
    doubled_within : largest distance from the flip to these hops in the parameter, as a multiple of that in speed
    both_sides : their two launches lie on both sides of the flip up to this share of the distance, or they are others
    doubled_change : their multiplier begins at 1, and differs from it by less: else a flip or a fold may lie between
    growth : of a small change over many hops, up to which they are followed
    smooth : the multiplier passes a level smoothly where it comes this close to it, as a share of its change
    over : by this share of the range the bound of an injection is moved at 0, where curves turn round
    no_injection : folds with a smaller one are lossless hops
    faster : than a lossless launch, by this share, is the launch from which it is solved
    behind : distance of the first point from a lossless hop, in the unit of length
    beside : that of hops without a statement, as a share of the range
    same : points nearer than this share of the ranges are one
    """

    doubled: tuple[float, ...] = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-2)
    doubled_within: float = 20.0
    both_sides: float = 0.5
    doubled_change: float = 1.0
    growth: float = 1e6
    smooth: float = 1e-3
    over: float = 0.05
    no_injection: float = 1e-7
    faster: float = 1e-6
    behind: float = 1e-3
    beside: float = 1e-8
    same: float = 1e-9


BRANCHING = Branching()
LOST = "the curve is lost"
Items = Iterator[PeriodicLaunch | Event | End]


class Tracer:
    """Follows the branches of one period.

    maps : the maps along the parameter
    between : range of launch speeds
    values : of the parameter that get an exact point
    longest : the longest distance of two points, as a share of the ranges
    """

    def __init__(
        self, maps: MapsAlong, between: tuple[float, float], period: int, values: tuple[float, ...],
        longest: float = STEPS_OF_BRANCHES.apart, options: Branching = BRANCHING,
    ):  # fmt: skip
        self.maps, self.between, self.period, self.values, self.options = maps, between, period, values, options
        self.apart = longest if period <= 2 else 2.0 * longest / period
        self.scale = np.array([between[1] - between[0], maps.high - maps.low])

    def start_beside_flip(self, flip: PeriodicLaunch) -> PeriodicLaunch:
        """Hops of twice the period beside those whose multiplier is -1; raises `NoOrbit` where none are found."""
        # The fixed point moves with the parameter too, possibly faster, so that there are hops on one side only.
        for step in (side * length for length in self.options.doubled for side in (1, -1)):
            try:
                first = self.doubled_near(flip, step)
            except NoOrbit:
                continue
            mirrored = 2.0 * flip.alpha - first.alpha  # near the flip the launch after half of the hops
            beside = abs(first.alphas[len(flip.alphas)] - mirrored) <= self.options.both_sides * abs(
                first.alpha - flip.alpha
            )
            beside &= abs(first.multiplier - 1.0) <= self.options.doubled_change
            if beside and abs(first.place[1] - flip.place[1]) <= self.options.doubled_within * abs(step):
                onward = first.tangent @ (first.place - flip.place) >= 0
                return first if onward else self.reversed(first)
        raise NoOrbit("no hops of twice the period are found beside the flip")

    def doubled_near(self, flip: PeriodicLaunch, step: float) -> PeriodicLaunch:
        """Hops of twice the period of a flip, whose first launch is this share of the range away from it."""
        raise NotImplementedError

    def reversed(self, launch: PeriodicLaunch) -> PeriodicLaunch:
        """A launch with its tangent the other way."""
        rates, direction = (None if each is None else -each for each in (launch.rates, launch.direction))
        return replace(launch, tangent=-launch.tangent, rates=rates, direction=direction)

    def half_way(self, last: PeriodicLaunch, launch: PeriodicLaunch) -> End | None:
        """The end of a branch whose launches become those of half the period between two points."""
        half = self.period // 2 * (1 - self.period % 2)
        if (last.alphas[half] - last.alphas[0]) * (launch.alphas[half] - launch.alphas[0]) < 0:
            reason = f"its launches become those of half the period, at another flip of the {name_of_hops(half)}"
            return End("flip", reason)
        return None

    def left(self, bound: float) -> End:
        """The end at a bound of the launch speeds."""
        return End("left", f"it leaves the launch speeds of the range at {self.maps.in_words('alpha', bound)}")

    def grown(self, launch: PeriodicLaunch) -> End | None:
        """The end of a branch whose hops amplify small changes too much."""
        if self.period > 2 and abs(launch.multiplier) > self.options.growth:
            growth = f"{launch.multiplier:.0e}-fold"
            return End("stuck", f"small changes grow {growth} over the hops, and rounding decides")
        return None

    def why_stuck(self, launch: PeriodicLaunch) -> End:
        """Why a curve cannot be followed further."""
        place = f"near {place_in_words(self.maps, launch)}"
        speed, value = (np.array([launch.alpha, launch.value]) + AROUND * launch.tangent * self.scale).tolist()
        value = value if self.maps.name == INJECT else float(np.clip(value, self.maps.low, self.maps.high))
        reach = AROUND * float(self.scale[0])
        for alpha in (speed, *launch.alphas[1:]):
            if (status := self.maps.status(alpha, value)) != "lifts_off":
                return End("no launch", f"{place} a hop has no next launch any more: {STATUSES[status]}")
        for alpha in launch.alphas:
            if self.maps.jumps_between((alpha - reach, alpha + reach), value):
                return End("jump", f"the map jumps {place}")
        return End("stuck", f"{place} the map is not smooth, and the curve is lost")

    def reached(self, bound: float) -> End:
        """The end at a bound of the parameter."""
        return End("reached", f"{self.maps.in_words(self.maps.name, bound)} is reached")

    def ended(self, end: End, last: PeriodicLaunch) -> End:
        """The end of a branch in words."""
        if end.kind == "reached":
            return self.reached(last.value)
        if end.kind == "left":
            return self.left(min(max(last.alpha, self.between[0]), self.between[1]))
        if end.kind == "stopped":
            return End("stuck", f"it has {STEPS_OF_BRANCHES.most} points")
        if end.kind in ("stuck", "jump") or not end.reason:
            found = self.why_stuck(last)
            return End("jump", f"the map jumps near {place_in_words(self.maps, last)}") if end.kind == "jump" else found
        return end


class HopTracer(Tracer):
    """Follows the branches of hops that have a statement."""

    def __init__(self, *about: Any, **options: Any):
        super().__init__(*about, **options)
        self.family, self.steps = dict[Word, HopCurve](), replace(STEPS_OF_HOPS, apart=self.apart)
        # Without an injection every hop is lossless, so that a curve turns round there and does not pass it.
        at_zero = self.maps.name == INJECT and self.maps.lossless(0.0)
        self.bounds = [bound + side * self.options.over * self.scale[1] * (at_zero and bound == 0.0)
                       for side, bound in ((-1, self.maps.low), (1, self.maps.high))]  # fmt: skip
        self.values = tuple(value for value in self.values if not (at_zero and value == 0.0))

    def curve(self, word: Word) -> HopCurve:
        """The curve of hops with a word."""
        if word not in self.family:
            assert self.maps.along is not None
            HopCurve(self.maps.along, word, self.between, beyond, self.steps, self.family)
        return self.family[word]

    def start(self, alphas: Sequence[float], value: float) -> PeriodicLaunch:
        """The point of hops with these launch speeds, all of them or the first, at a value of the parameter; raises
        `NoOrbit`."""
        curve, x = self._flown(alphas, value)
        row = np.eye(1, len(x), len(x) - 1)[0]
        return curve.solved(x, row, row).own[0]

    def _flown(self, alphas: Sequence[float], value: float) -> tuple[HopCurve, np.ndarray]:
        """The curve of the word of hops with launch speeds, and X."""
        assert self.maps.along is not None
        if (flown := self.maps.along.flown(alphas, value, self.period)) is None:
            raise NoOrbit(f"a hop near {self.maps.name} = {value:g} has no next launch")
        return self.curve(flown[0]), np.append(flown[1], value)

    def doubled_near(self, flip: PeriodicLaunch, step: float) -> PeriodicLaunch:
        assert self.maps.along is not None
        half, away = len(flip.alphas), [step * self.scale[0]]
        curve = HopCurve(self.maps.along, flip.impacts, self.between, beyond, self.steps)
        slopes = curve.slopes(flip.x[None])[0, :, 0, 0]
        for slope in slopes[:-1]:
            away.append(away[-1] * slope)
        alphas = [*(np.array(flip.alphas) + away), *(np.array(flip.alphas) - away)]
        curve, x = self._flown(alphas, flip.value)
        row = np.eye(1, len(x), int(curve.speeds[0]))[0]
        launch = curve.solved(x, row, step * row).own[0]
        assert len(launch.alphas) == 2 * half
        return launch

    def lossless(self, alpha: float) -> list[Any]:
        """The items of the branch of fixed points through a lossless hop, from one end to the other."""
        curve, x = self._flown([alpha * (1.0 + self.options.faster)], 0.0)
        slack, later = Slack(FORCE, 0, curve.word[0] - 1), np.eye(1, len(x), curve.time(0, 0))[0]
        point = curve.solved_at_border(x, slack, later)
        behind = beyond(curve, turned(point), slack)
        if not isinstance(behind, Start) or behind.passed is None or behind.point is None:
            raise NoOrbit(f"the map jumps at the lossless hop from {alpha:g}")
        (event,), (first,) = behind.passed[1].own, behind.point.own
        (x,), (tangent,) = point.xs + self.options.behind * point.tangents, point.tangents
        above = curve.solved(x, tangent / curve.sizes**2, tangent).own[0]
        below, ahead = ([each, *self.trace(each, 1)] for each in (first, above))
        return [*reversed(below), Event("fold", point=event), *ahead]

    def trace(self, start: PeriodicLaunch, side: int) -> Items:
        """The points and events from one, in order along its tangent (`side` 1) or against it (-1); an end is last."""
        start = start if side > 0 else self.reversed(start)
        curve, zero, own = self.curve(start.impacts), np.zeros(1, int), np.empty(1, object)
        own[0] = start
        first = Points(zero, start.x[None], start.direction[None], np.ones(1), None, zero, np.zeros(1), own)
        last, (low, high), held = start, self.bounds, list[PeriodicLaunch]()
        for item in Run(curve, first, high, behind=low, at=self.values):
            if isinstance(item, End):
                yield from held
                yield self.ended(item, last)
                return
            if isinstance(item, Event):
                if item.kind in EVENTS and not self._is_lossless(item):
                    launch = item.point.own[0]
                    # The point at a border is this event.
                    yield from (each for each in held if distance(each, launch) > self.options.same)
                    held.clear()
                    yield Event(item.kind, point=launch)
                continue
            for launch in item.own:
                if not distance(launch, last):
                    continue
                yield from held
                held.clear()
                if end := self.half_way(last, launch):
                    yield end
                    return
                last = launch
                held.append(launch)
                if end := self.grown(launch):
                    yield from held
                    yield end
                    return

    def _is_lossless(self, event: Event) -> bool:
        """Whether an event is the fold at a lossless hop, which is an event of its border."""
        launch = event.point.own[0]
        small = abs(launch.value) <= self.options.no_injection * self.scale[1] and self.maps.name == INJECT
        return bool(event.kind == "fold" and small and launch.value != 0.0 and self.maps.lossless(0.0))


EVENTS = "fold", "flip", "branch point", "Neimark-Sacker", *COLLISIONS


def tracer_of(maps: MapsAlong, between: tuple[float, float], period: int, values: tuple[float, ...]) -> Any:
    """The tracer of branches of a period."""
    return (HopTracer if maps.along else BranchTracer)(maps, between, period, values)


class BranchCurve(LaunchCurve):
    """The launches of a branch, which goes on behind corners of the map."""

    @cached_property
    def borders(self) -> BordersOfCurve:
        """What happens at the borders of the map."""
        return BordersOfCurve(self)

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> Start | End:
        """Behind the corner at the last point, where there is one."""
        own = [(launch, length) for each in passed for launch, length in zip(each.own, each.lengths, strict=True)]
        last, i = own[-1][0], len(own) - 1
        while i and own[i][1] and distance(own[i][0], last) < AROUND:  # a curve that goes on has a length of 0
            i -= 1
        if (behind := self.borders.behind(own[i][0], last)) is None:
            return End("stuck", LOST)
        return Start.at(self, self.of_launch(behind), ("corner", passed[-1][-1:]))


class BranchTracer(Tracer):
    """Follows the branches of launches whose hops have no statement."""

    def __init__(self, *about: Any, **options: Any):
        super().__init__(*about, **options)
        self.curve = BranchCurve(self.maps, self.between, self.period, self.apart)
        self.borders = self.curve.borders

    def start(self, alphas: Sequence[float], value: float) -> PeriodicLaunch:
        """The point of a periodic launch found at a value of the parameter."""
        return self.curve.at(np.array([alphas[0], value]), np.array([0.0, 1.0]))

    def doubled_near(self, flip: PeriodicLaunch, step: float) -> PeriodicLaunch:
        away = np.array([step, 0.0])
        return self.curve.near((flip.place + away) * self.scale, away * self.scale)

    def lossless(self, alpha: float) -> list[Any]:
        """The items of the branch of fixed points through a lossless hop, from one end to the other. Two curves begin
        there, both tangent to the launch speed's axis and with unbounded curvature."""
        hop, away = np.array([alpha, 0.0]), np.array([self.options.beside, 0.0]) * self.scale
        beside = [self.curve.near(hop + side * away, side * away) for side in (-1.0, 1.0)]
        event = PeriodicLaunch(0.0, (alpha,), 1.0, beside[1].impacts, hop / self.scale, np.array([1.0, 0.0]))
        below, above = ([side, *self.trace(side, 1, self.options.beside)] for side in beside)
        return [*reversed(below), Event("fold", point=event), *above]

    def trace(
        self, start: PeriodicLaunch, side: int, first_step: float = STEPS_OF_BRANCHES.first
    ) -> Iterator[PeriodicLaunch | Event | End]:
        """The points and events from one, in order along its tangent (`side` 1) or against it (-1); an end is last."""
        first, maps = self.curve.of_launch(start, side), self.maps
        if start.value == (maps.high if first.tangents[0, -1] > 0 else maps.low):
            yield self.reached(start.value)
            return
        last, passed, corner = first.own[0], list[Event](), False
        for item in Run(self.curve, first, maps.high, behind=maps.low, at=self.values, lengths=first_step):
            if isinstance(item, End):
                yield from passed
                yield self.ended(item, last)
            elif isinstance(item, Event):
                corner |= item.kind == "corner"
                passed += [Event(item.kind, point=item.point.own[0])] if item.kind in MULTIPLIER_AT else []
            else:
                for launch in item.own:
                    if not distance(launch, last):  # it is the same, as one of another curve
                        continue
                    launch, end = (launch, None) if corner else self._up_to_end(last, launch)
                    if end:
                        chord = launch.place - last.place
                        passed = [each for each in passed if (launch.place - each.point.place) @ chord >= 0]
                    if launch is not last:
                        found = self.borders.corner(last, launch) if corner else self._named(passed, last, launch)
                        yield from self.borders.in_order(last, launch, found)
                        yield launch
                    if end:
                        yield end
                        return
                    last, passed, corner = launch, [], False

    def _up_to_end(self, last: PeriodicLaunch, launch: PeriodicLaunch) -> tuple[PeriodicLaunch, End | None]:
        """The last launch of the branch between two, and the end there; the second one and None without an end."""
        curve = self.curve
        if last.impacts != launch.impacts and (jump := self.borders.jump(last, launch)):
            return jump[0], End("jump", jump[1])
        if end := self.half_way(last, launch):
            return last, end
        if (bound := min(max(launch.alpha, curve.between[0]), curve.between[1])) != launch.alpha:
            end = self.left(bound)
            share = (bound - last.alpha) / (launch.alpha - last.alpha)
            value = last.value + share * (launch.value - last.value)
            try:
                return curve.near(np.array([bound, value]), last.tangent * self.scale), end
            except NoOrbit:
                return last, end
        return launch, self.grown(launch)

    def _named(self, found: list[Event], a: PeriodicLaunch, b: PeriodicLaunch) -> list[Event]:
        """The events between two launches, at which the multiplier passes a level, by what they are."""
        named, change = list[Event](), abs(a.multiplier - b.multiplier)
        for kind, point in ((each.kind, each.point) for each in found):
            if not abs(point.multiplier - MULTIPLIER_AT[kind]) <= self.options.smooth * change:
                kind = COLLISION
            elif kind == "fold" and (a.value - point.value) * (b.value - point.value) < 0:
                kind = "branch point"
            named.append(Event(kind, point=point))
        return named
