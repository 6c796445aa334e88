"""Branches of returning hops along a parameter of the map: where they begin, what lies on them, and how they end.

Where the hops have a statement, a branch is followed as a `HopCurve` for each of its words; launches of several numbers
without one as a `FlownCurve`. Launches that are speeds without one are followed in `branches`.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..curves import Border, End, Event, Points, Run, Start, solved_at
from ..errors import NoOrbit
from ..hops import STATUSES
from .bifurcation import name_of_hops
from .border_events import distance
from .flown_curve import FlownCurve
from .hop_borders import COLLISIONS, beyond
from .hop_curve import STEPS_OF_HOPS, HopCurve, turned
from .hop_statement import FORCE, Slack, Word
from .launch_curve import LAUNCH_CURVE, STEPS_OF_BRANCHES, place_in_words
from .launch_cycles import INJECT, MapsAlong
from .periodic_launch import PeriodicLaunch


class Branching(NamedTuple):
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
        """Hops of twice the period near those whose multiplier is -1; raises `NoOrbit` where none are found."""
        half = len(flip.alphas)
        # The fixed point moves with the parameter too, possibly faster, so that there are hops on one side only.
        for step in (side * length for length in self.options.doubled for side in (1, -1)):
            try:
                first = self.doubled_near(flip, step)
            except NoOrbit:
                continue
            here, there, launch = (self.launches_of(each)[i] for each, i in ((first, 0), (first, half), (flip, 0)))
            # Near the flip the launch after half of the hops lies on its other side.
            away = float(np.abs(here - launch).max())
            beside = float(np.abs(there + here - 2.0 * launch).max()) <= self.options.both_sides * away
            multipliers = first.multiplier if first.matrix is None else first.spectrum
            beside &= bool(np.abs(multipliers - 1.0).min() <= self.options.doubled_change)
            if beside and abs(first.place[1] - flip.place[1]) <= self.options.doubled_within * abs(step):
                onward = first.tangent @ (first.place - flip.place) >= 0
                return first if onward else self.reversed(first)
        raise NoOrbit("no hops of twice the period are found near the flip")

    def launches_of(self, launch: PeriodicLaunch) -> np.ndarray:
        """The launches (period, d) at a point, in one unit."""
        return np.array(launch.alphas)[:, None] if launch.launches is None else launch.launches

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
            reason = f"its hops become hops of half the period, at another flip of the {name_of_hops(half)}"
            return End("flip", reason)
        return None

    def left(self, bound: float) -> End:
        """The end at a bound of the launch speeds."""
        return End("left", f"it leaves the launch speeds of the range at {self.maps.in_words('alpha', bound)}")

    def grown(self, launch: PeriodicLaunch) -> End | None:
        """The end of a branch whose hops amplify small changes too much."""
        if self.period > 2 and abs(launch.multiplier) > self.options.growth:
            growth = f"{launch.multiplier:.0e}-fold"
            return End("stuck", f"small changes grow {growth} over the hops, so rounding decides")
        return None

    def why_stuck(self, launch: PeriodicLaunch) -> End:
        """Why a curve cannot be followed further."""
        place = f"near {place_in_words(self.maps, launch)}"
        lost = End("stuck", f"{place} the map is not smooth, so the curve is lost")
        if not self.maps.one_speed:
            return lost
        away = LAUNCH_CURVE.around * launch.tangent * self.scale
        speed, value = (np.array([launch.alpha, launch.value]) + away).tolist()
        value = value if self.maps.name == INJECT else float(np.clip(value, self.maps.low, self.maps.high))
        reach = LAUNCH_CURVE.around * float(self.scale[0])
        for alpha in (speed, *launch.alphas[1:]):
            if (status := self.maps.status(alpha, value)) != "lifts_off":
                return End("no launch", f"{place} a hop has no next launch from here on: {STATUSES[status]}")
        for alpha in launch.alphas:
            if self.maps.jumps_between((alpha - reach, alpha + reach), value):
                return End("jump", f"the map jumps {place}")
        return lost

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
        assert self.maps.along is not None
        self.hops = self.maps.along
        self.family, self.steps = dict[Word, HopCurve](), replace(STEPS_OF_HOPS, apart=self.apart)
        # Without an injection every hop is lossless, so that a curve turns round there and does not pass it.
        at_zero = self.maps.name == INJECT and self.maps.lossless(0.0)
        self.bounds = [bound + side * self.options.over * self.scale[1] * (at_zero and bound == 0.0)
                       for side, bound in ((-1, self.maps.low), (1, self.maps.high))]  # fmt: skip
        self.values = tuple(value for value in self.values if not (at_zero and value == 0.0))

    def curve(self, word: Word) -> HopCurve:
        """The curve of hops with a word."""
        if word not in self.family:
            HopCurve(self.hops, word, self.between, beyond, self.steps, self.family)
        return self.family[word]

    def start(self, launches: np.ndarray, value: float) -> PeriodicLaunch:
        """The point of hops with launches (h, d), all of them or the first, at a value of the parameter; raises
        `NoOrbit`."""
        curve, x = self._flown(launches / self.units(value), value)
        row = np.eye(1, len(x), len(x) - 1)[0]
        return curve.solved(x, row, row).own[0]

    def units(self, value: float) -> np.ndarray:
        """The units (d,) of the free numbers of a launch at a value of the parameter."""
        hops = self.hops
        if hops.model.units is None:
            return np.ones(len(hops.free))
        values = dict(zip(hops.names, hops.parameters_at(np.array([value]))[0].tolist(), strict=True))
        return hops.model.units(values).of_states(hops.free)

    def _flown(self, launches: np.ndarray, value: float) -> tuple[HopCurve, np.ndarray]:
        """The curve of the word of hops with launches (h, d) without units, and X."""
        if (flown := self.hops.flown(launches, value, self.period)) is None:
            raise NoOrbit(f"a hop near {self.maps.name} = {value:g} has no next launch")
        return self.curve(flown[0]), np.append(flown[1], value)

    def doubled_near(self, flip: PeriodicLaunch, step: float) -> PeriodicLaunch:
        values, vectors = np.linalg.eig(flip.matrix)
        onward = vectors[:, np.argmin(np.abs(values + 1))].real
        sizes = HopCurve(self.hops, flip.impacts, self.between, beyond, self.steps)
        away = [onward * step * float(sizes.sizes[sizes.free[0, 0]]) / np.sqrt(sizes.period)]
        for slope in sizes.slopes(flip.x[None])[0, :-1]:
            away.append(slope @ away[-1])
        launches = np.concatenate([flip.launches + away, flip.launches - np.array(away)])
        curve, x = self._flown(launches, flip.value)
        row = np.zeros(len(x))
        row[curve.free[0]] = onward
        return curve.solved(x, row, step * row).own[0]

    def lossless(self, alpha: float) -> list[Any]:
        """The items of the branch of fixed points through a lossless hop, from one end to the other."""
        curve, x = self._flown(np.array([[alpha * (1.0 + self.options.faster)]]) / self.units(0.0), 0.0)
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
        zero, own = np.zeros(1, int), np.empty(1, object)
        own[0] = start
        first = Points(zero, start.x[None], start.direction[None], np.ones(1), None, zero, np.zeros(1), own)
        last, (low, high), held = start, self.bounds, list[PeriodicLaunch]()
        for item in Run(self.curve(start.impacts), first, high, behind=low, at=self.values):
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


class FlownTracer(HopTracer):
    """Follows the branches of launches of several numbers whose hops have no statement."""

    def __init__(self, *about: Any, **options: Any):
        Tracer.__init__(self, *about, **options)
        self.flown, self.bounds = FlownCurve(self.maps, self.between, self.period), [self.maps.low, self.maps.high]

    def curve(self, word: Word) -> Any:
        return self.flown

    def start(self, launches: np.ndarray, value: float) -> PeriodicLaunch:
        x = np.append(launches[0] / self.maps.at(value).section.unit, value)
        return self._solved(x, np.eye(1, len(x), len(x) - 1)[0])

    def _solved(self, x: np.ndarray, row: np.ndarray) -> PeriodicLaunch:
        border = Border(row[None], (row @ x)[None])
        points = solved_at(self.flown, np.zeros(1, int), x[None], border, row[None], self.flown.steps)
        if not len(points):
            raise NoOrbit(f"no hops return near {self.maps.name} = {x[-1]:g}")
        return points.own[0]

    def doubled_near(self, flip: PeriodicLaunch, step: float) -> PeriodicLaunch:
        values, vectors = np.linalg.eig(flip.matrix)
        row = np.append(vectors[:, np.argmin(np.abs(values + 1))].real, 0.0)
        return self._solved(flip.x + step * float(self.flown.sizes[0]) * row, row)
