"""Branches of periodic launches: curves in the launch speed and a parameter of the return map.

The tracer of `orbits.continuation` follows a `LaunchCurve` along its smooth pieces. Where it is lost at a border of the
map it restarts behind the border, as `BordersOfCurve` finds it there.
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, cast

import numpy as np

from ..continuation.corrector import correct
from ..continuation.curve import Curve, CurvePoint, Watch, interpolated
from ..continuation.events import SearchedSegment, Segment
from ..continuation.limits import Endings
from ..continuation.point import End, Event
from ..continuation.step_control import Options, StepControl
from ..continuation.tracer import Batch, Tracer, TracerState
from ..errors import NoOrbit
from ..running import interrupts
from ..simulation.impacts import STATUSES
from .bifurcation import name_of_hops
from .border_events import AROUND, COLLISION, BordersOfCurve, FoundEvent
from .cycle_curve import CycleCurve, OtherImpacts
from .cycle_statement import MULTIPLIER_AT
from .cycles import INJECT, MapsAlong
from .launch_curve import LaunchCurve, PeriodicLaunch, place_in_words

# Fixed points beside a lossless hop are searched for at this distance, as a share of the range.
BESIDE_LOSSLESS = 1e-8
SAME_PLACE = 1e-6  # launches that differ by a smaller share of the range are the same
LONGEST_BRANCH = 20_000
# Beside lossless hops the curvature has no bound, so that the first steps there are as short as the distance to them.
STEPS_OF_BRANCHES = StepControl(
    first_step=1e-2, shortest_step=1e-9, largest_correction=1.0, largest_turn=0.6, target_correction=0.1,
    largest_lengthening=4.0, neighbours=2, largest_batch=16, most_rejections=100, same_point=SAME_PLACE,
)  # fmt: skip
# Hops of longer periods have as many sheets, which lie close to each other: a correction may not lead to another one.
STEPS_OF_SHEETS = replace(
    STEPS_OF_BRANCHES, largest_correction=0.2, target_correction=2e-2, largest_turn=0.3, largest_batch=4
)
# In all unknowns of the hops the curve bends little. What cannot be followed by steps of the least length, as beside
# lossless hops, is followed in the launch speed.
STEPS_OF_CYCLES = StepControl(
    first_step=1e-2, shortest_step=1e-4, largest_correction=0.2, largest_turn=0.6, target_correction=1e-4,
    largest_lengthening=4.0, neighbours=3, largest_batch=64, most_rejections=100, same_point=SAME_PLACE,
)  # fmt: skip
FAR_FROM_LOST = 1e-2  # and at such a distance the curve in all unknowns is tried again
OTHER_SHEET = 0.25  # launches are on another sheet where their change differs from that of the rates by this share
ON_BOTH_SIDES = 0.5  # the two launches beside a flip lie on both sides of it up to this share, or they are others
SLOWLY = 1.0  # the multiplier of the doubled hops begins at 1, and differs from it by less at the first of them
# From a flip to the first hops of twice the period, as shares of the range.
FIRST_OF_TWO = 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-2
FARTHEST_OF_TWO = 20  # the first hops of twice the period have a parameter at most this many such shares away
GROWTH_OF_HOPS = 1e6  # of a small change over many hops, up to which they are followed
SHORT_CHORD = 1e-3  # of the distance of two points, between which others are guessed from the nearest one alone
SMOOTH = 1e-3  # the multiplier passes a level smoothly where it comes this close to it, as a share of its change


class BranchCurve(LaunchCurve):
    """The curve of a branch, with the borders of the map along it."""

    @cached_property
    def borders(self) -> BordersOfCurve:
        """What happens at them."""
        return BordersOfCurve(self)


class LaunchSegment(SearchedSegment):
    """The branch between two neighbouring points. Its points are solved once, and others are guessed from them."""

    def __init__(self, curve: Curve, a: CurvePoint, b: CurvePoint):
        super().__init__(curve, a, b)
        self._solved = {0.0: a, 1.0: b}

    def __call__(self, share: float) -> CurvePoint:
        if share not in self._solved:
            low, high = max(s for s in self._solved if s < share), min(s for s in self._solved if s > share)
            nearest = low if share - low < high - share else high
            beside = [self._solved[s] for s in ((low, high) if high - low > SHORT_CHORD else (nearest,))]
            level = float(self.row @ self.a.x) + share
            self._solved[share] = self._correct(interpolated(beside, self.row, np.array([level]))[0], self.row, level)
        return self._solved[share]

    def _excess(self, level: float, point: CurvePoint) -> float | None:
        """The multiplier above a level, None where there is none."""
        excess = self.curve.certify(point).point.multiplier - level
        return float(excess) if np.isfinite(excess) else None

    def _crossing(self, level: float) -> float | None:
        """The share of the chord at which the multiplier passes a level; None where it does not or has it at an end."""
        if 0.0 in (self._excess(level, self.a), self._excess(level, self.b)):
            return None
        return self.zero(partial(self._excess, level))

    @cached_property
    def fold(self) -> float | None:
        return self._crossing(MULTIPLIER_AT["fold"])

    def _sign_changes(self, watch: Watch) -> Iterator[tuple[str, float, CurvePoint]]:
        for kind, level in MULTIPLIER_AT.items():
            if (share := self.fold if kind == "fold" else self._crossing(level)) is None:
                continue
            point = self.curve.certify(self(share))
            left, change = self._excess(level, point), self.a.point.multiplier - self.b.point.multiplier
            if left is None or abs(left) > SMOOTH * abs(change):
                kind = COLLISION
            elif kind == "fold" and (self.a.value - point.value) * (self.b.value - point.value) < 0:
                kind = "branch point"
            yield kind, share, point


class LaunchEndings(Endings):
    """The tests for the end of a branch."""

    curve: Any

    def may_end(self, before: CurvePoint, points: Sequence[CurvePoint]) -> np.ndarray:
        return np.ones(len(points), bool)

    @cached_property
    def _first(self) -> np.ndarray:
        return np.array([self.origin.alpha, self.start])

    def cut(self, segment: Segment) -> tuple[Segment, End | None]:
        ends: Any = segment.a.point, segment.b.point
        if ends[0].impacts != ends[1].impacts and (jump := self.curve.borders.jump(segment.a, segment.b, segment)):
            return LaunchSegment(self.curve, segment.a, jump[0]), End("jump", jump[1])
        segment, end = super().cut(segment)
        half = self.curve.period // 2 * (1 - self.curve.period % 2)
        (first, second), (before, last) = (
            (each.alphas[0], each.alphas[half]) for each in (segment.a.point, segment.b.point)
        )
        if (second - first) * (last - before) < 0:
            reason = f"its launches become those of half the period, at another flip of the {name_of_hops(half)}"
            return LaunchSegment(self.curve, segment.a, segment.a), End("flip", reason)
        bound = min(max(before, self.curve.between[0]), self.curve.between[1])
        if bound != before:
            share = (bound - first) / (before - first)
            guess = segment.a.x + share * (segment.b.x - segment.a.x)
            last = self.curve.certify(correct(self.curve, guess, self.curve.row_of_speed, bound, segment.a.tangent))
            reason = f"it leaves the launch speeds asked for at {self.curve.maps.in_words('alpha', bound)}"
            return LaunchSegment(self.curve, segment.a, last), End("left", reason)
        if not end and self.curve.period > 2 and abs(segment.b.point.multiplier) > GROWTH_OF_HOPS:
            reason = f"small changes grow {segment.b.point.multiplier:.0e}-fold over the hops, and rounding decides"
            return segment, End("stuck", reason)
        return segment, end

    def far(self, last: CurvePoint, history: object, way: object = ()) -> None:
        """Nothing: a branch ends at the bounds of its ranges."""

    def lost(self, error: object, last: CurvePoint, history: object) -> End:
        return End("stuck", str(error))


class LaunchTracer(Tracer):
    """A run along a smooth piece of a branch."""

    segments, tests_for_the_end = LaunchSegment, LaunchEndings

    def _certified(
        self, state: TracerState, points: Sequence[CurvePoint]
    ) -> tuple[Sequence[CurvePoint], NoOrbit | None]:
        interrupts.heed()
        certified, error = list[CurvePoint](), None
        try:
            certified.extend(map(self.curve.certify, points))
        except NoOrbit as failure:
            error = failure
        for i, (before, behind) in enumerate(pairwise([state.last, *certified])):
            if before.certified and self._changes_sheet(before, behind):
                return certified[:i], NoOrbit("the launches of the hops change their places: another sheet")
        return certified, error

    def _changes_sheet(self, before: CurvePoint, behind: CurvePoint) -> bool:
        """Whether the curve between two points, or a launch along it, changes otherwise than the tangents say, as on
        another sheet of the curve, where each launch is another one of the same hops, or on another curve."""
        a, b = cast(Any, before.point), cast(Any, behind.point)
        length = float(np.linalg.norm(b.place - a.place))
        if length <= AROUND and cast(Any, self.curve).maps.pieces is None:  # differences reach as far
            return False
        away = b.place - a.place - 0.5 * length * (a.tangent + b.tangent)
        if float(np.linalg.norm(away)) > OTHER_SHEET * length:
            return True
        # A fixed point along the injection never turns round in the launch speed, as along other parameters.
        if (len(a.alphas) == 1 and self.curve.along != INJECT) or a.rates is None or b.rates is None:
            return False
        change, expected = np.subtract(b.alphas, a.alphas), 0.5 * length * (a.rates + b.rates)
        return bool((np.abs(change - expected) > OTHER_SHEET * (np.abs(change) + np.abs(expected))).any())


class CycleTracer(LaunchTracer):
    """A run along a smooth piece of a branch in all unknowns of its hops, up to where these have other impacts."""

    def _after(self, state: TracerState, batch: Batch, ends: list[CurvePoint]) -> TracerState:
        state = super()._after(state, batch, ends)
        return state._replace(length=0.0) if isinstance(batch.rejection, OtherImpacts) else state


class BranchTracer:
    """Follows the branches of one period.

    maps, between, period : as of a `LaunchCurve`
    values : of the parameter that get an exact point
    longest : the longest distance of two points, as a share of the ranges
    """

    def __init__(
        self, maps: MapsAlong, between: tuple[float, float], period: int, values: tuple[float, ...], longest: float
    ):
        self.maps = maps
        self.curve: Any = BranchCurve(maps, between, period)
        self.borders: BordersOfCurve = self.curve.borders
        self.scale: np.ndarray = self.curve.scale
        control, longest = (STEPS_OF_BRANCHES, longest) if period <= 2 else (STEPS_OF_SHEETS, 2.0 * longest / period)
        self.options = Options(at=values, longest=longest, most=LONGEST_BRANCH, step_control=control)

    def start(self, alpha: float, value: float) -> PeriodicLaunch:
        """The point of a periodic launch found at a value of the parameter."""
        return self.curve.at(np.array([alpha, value]), np.array([0.0, 1.0])).point

    def _at_speed(self, x: np.ndarray, before: np.ndarray) -> PeriodicLaunch:
        """The launch of the branch at the launch speed of a place (2,) near it; raises `NoOrbit`."""
        return self.curve.certify(correct(self.curve, x, np.array([1.0, 0.0]), float(x[0]), before)).point

    def start_lossless(self, alpha: float) -> tuple[PeriodicLaunch, list[PeriodicLaunch]]:
        """A lossless hop, which is a fixed point without injection, and the fixed points just below and above it, each
        with the tangent that leads away. Two branches of fixed points begin there, both tangent to the launch speed's
        axis and with unbounded curvature."""
        hop, away = np.array([alpha, 0.0]), np.array([BESIDE_LOSSLESS, 0.0]) * self.scale
        beside = [self._at_speed(hop + side * away, side * away) for side in (-1.0, 1.0)]
        return PeriodicLaunch(0.0, (alpha,), 1.0, beside[1].impacts, hop / self.scale, np.array([1.0, 0.0])), beside

    def start_beside_flip(self, flip: PeriodicLaunch) -> PeriodicLaunch:
        """Hops of twice the period beside those whose multiplier is -1; raises `NoOrbit` where none are found."""
        # The fixed point moves with the parameter too, possibly faster, so that there are hops on one side only.
        for step in (side * length for length in FIRST_OF_TWO for side in (1, -1)):
            away = np.array([step, 0.0])
            try:
                first = self._at_speed((flip.place + away) * self.scale, away * self.scale)
            except NoOrbit:
                continue
            mirrored = 2.0 * flip.alpha - first.alpha  # near the flip the launch after half of the hops
            beside = abs(first.alphas[len(flip.alphas)] - mirrored) <= ON_BOTH_SIDES * abs(first.alpha - flip.alpha)
            beside &= abs(first.multiplier - 1.0) <= SLOWLY  # else a flip or a fold may lie between
            if beside and abs(first.place[1] - flip.place[1]) <= FARTHEST_OF_TWO * abs(step):
                onward = first.tangent @ (first.place - flip.place) >= 0
                return first if onward else replace(first, tangent=-first.tangent)
        raise NoOrbit("no hops of twice the period are found beside the flip")

    def trace(
        self, start: PeriodicLaunch, side: int, first_step: float = STEPS_OF_BRANCHES.first_step
    ) -> Iterator[PeriodicLaunch | FoundEvent | End]:
        """The points and events from one, in order along its tangent (`side` 1) or against it (-1); an end is last."""
        earlier, count = list[object](), 0
        here: Any = self.curve.of_launch(start, side)
        lost: PeriodicLaunch | None = None  # where the curve in all unknowns was lost
        if start.value == (self.maps.high if here.tangent[1] > 0 else self.maps.low):
            yield self._reached(start.value)
            return
        while count < LONGEST_BRANCH:
            able = first_step >= STEPS_OF_CYCLES.shortest_step and self._is_beyond(here.point, lost)
            in_all = self._in_all_unknowns(here, earlier) if able else None
            run = in_all or self._in_launch(here, earlier, first_step)
            reached = yield from self._followed(run, here, lost or here.point)
            if not reached:
                return
            before, last, beyond, more = reached
            earlier, count, first_step = [start], count + more, STEPS_OF_BRANCHES.first_step
            if in_all:
                if last is not here:
                    cast(Any, in_all.curve).leave(last)
                lost, here = last.point, self.curve.of_launch(last.point)
                continue
            if beyond:
                here = last
                continue
            if (behind := self.borders.round_corner(before, last) or self.borders.beyond(before, last)) is None:
                yield self._why_stuck(last)
                return
            yield from self.borders.in_order(last.point, cast(Any, behind.point), self.borders.corner(last, behind))
            here = behind
            yield here.point
        yield End("stuck", f"it has {LONGEST_BRANCH} points")

    def _followed(
        self, run: LaunchTracer, here: Any, lost: Any
    ) -> Generator[PeriodicLaunch | FoundEvent | End, None, tuple[Any, Any, bool, int] | None]:
        """The points and events of a run from a point. Returns a point before the last one, at a distance if there is
        such a one, the last one, whether the curve in all unknowns may be followed from there, after it was `lost`, and
        the number of points; None at the end of the branch."""
        before, passed, count = here, list[FoundEvent](), 0
        last: Any = here
        for item in run:
            if isinstance(item, CurvePoint) and item.point is not last.point:
                yield from self.borders.in_order(last.point, cast(Any, item.point), passed)
                before, passed = last if self.borders.distance(last, item) >= AROUND else before, []
                last, count = item, count + 1
                yield last.point
                if not isinstance(run, CycleTracer) and self._is_beyond(last.point, lost):
                    return before, last, True, count
            elif isinstance(item, Event) and item.kind != "value":
                passed.append(FoundEvent(item.kind, cast(Any, item.point)))
            elif isinstance(item, End) and (item.kind not in ("stuck", "stopped") or self._grown(last)):
                yield from passed
                yield self._reached(last.value) if item.kind == "reached" else item
                return None
        yield from passed
        return before, last, False, count

    def _is_beyond(self, launch: Any, lost: PeriodicLaunch | None) -> bool:
        """Whether the curve in all unknowns, which was lost at another point, may be followed from this one."""
        if self.maps.pieces is not None or self.maps.along is None:
            return False
        apart = np.inf if lost is None else float(np.linalg.norm(launch.place - lost.place))
        return apart > FAR_FROM_LOST or launch.impacts != cast(Any, lost).impacts

    def _in_all_unknowns(self, here: CurvePoint, earlier: Sequence) -> CycleTracer | None:
        """The run in all unknowns of the hops from a point, None where these are not known."""
        curve: Any = CycleCurve(self.curve, cast(Any, here.point).impacts)
        if (first := curve.begin(here)) is None:
            return None
        options = replace(self.options, step_control=STEPS_OF_CYCLES)
        return CycleTracer(curve, first, self.maps.low, self.maps.high, options, earlier)

    def _in_launch(self, here: CurvePoint, earlier: Sequence, first_step: float) -> LaunchTracer:
        """The run in the launch speed from a point."""
        options = replace(self.options, step_control=replace(self.options.step_control, first_step=first_step))
        return LaunchTracer(self.curve, here, self.maps.low, self.maps.high, options, earlier)

    def _grown(self, last: CurvePoint) -> bool:
        return self.curve.period > 2 and abs(last.point.multiplier) > GROWTH_OF_HOPS

    def _reached(self, bound: float) -> End:
        return End("reached", f"{self.maps.in_words(self.maps.name, bound)} is reached")

    def _why_stuck(self, last: CurvePoint) -> End:
        """Why the curve cannot be followed further."""
        place, launch = f"near {place_in_words(self.maps, last.point)}", last.point
        speed, beyond = last.x + AROUND * last.tangent
        value, reach = float(self.curve.possible(beyond)), AROUND * float(self.scale[0])
        for alpha in (float(speed), *launch.alphas[1:]):
            if (status := self.maps.status(alpha, value)) != "lifts_off":
                return End("no launch", f"{place} a hop has no next launch any more: {STATUSES[status]}")
        for alpha in launch.alphas:
            if self.maps.jumps_between((alpha - reach, alpha + reach), value):
                return End("jump", f"the map jumps {place}")
        return End("stuck", f"{place} the map is not smooth, and the curve is lost")
