"""Branches of periodic launches: curves in the launch speed and a parameter of the return map.

`LaunchCurve` states their equation to the tracer of `orbits.continuation`, in shares of the two ranges. The map is
smooth only in pieces. Where the number of impacts changes, the map may jump, which ends a branch. Where its slope
jumps, the curve has a corner: the tracer loses it, and restarts where a small circle round its last point cuts it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, NamedTuple, cast

import numpy as np

from ..continuation.corrector import correct
from ..continuation.curve import CurvePoint, Watch
from ..continuation.events import Segment
from ..continuation.limits import Endings
from ..continuation.point import End, Event
from ..continuation.step_control import Options, StepControl
from ..continuation.tracer import Tracer, TracerState
from ..errors import NoOrbit, OrbitsError
from ..numerics.roots import bracketed_root, solve
from ..running import interrupts
from ..simulation.impacts import STATUSES
from .bifurcation import name_of_hops
from .cycle_statement import Border
from .cycles import INJECT, MapsAlong, excess_of
from .followed_events import located_border
from .map_pieces import CONTINUOUS, MapBorder

Vector = np.ndarray
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
OTHER_SHEET = 0.25  # launches are on another sheet where their change differs from that of the rates by this share
ON_BOTH_SIDES = (
    0.5  # where the two launches beside a flip do not lie on both sides of it up to this share, they are others
)
SLOWLY = 1.0  # the multiplier of the doubled hops begins at 1, and differs from it by less at the first of them
FIRST_OF_TWO = (
    1e-3,
    1e-4,
    1e-5,
    1e-6,
    1e-7,
    1e-2,
)  # from a flip to the first hops of twice the period, as shares of the range
FARTHEST_OF_TWO = 20  # the first hops of twice the period have a parameter at most this many such shares away
# Differences for slopes across: over this share of the launch speed, as small as rounding allows, as beside lossless
# hops slopes change with the cube root of the distance. If those of both sides differ by more, a jump is between.
STEP_ACROSS, JUMP_OF_SLOPES = 1e-9, 1e5
# The slope along the parameter, which needs other machines, is not computed anew within this share of the ranges: it
# decides how fast Newton's method converges, not to which point.
SAME_RATE, INEXACT = 1e-4, 100.0
# Hops with larger errors do not end Newton's method across the curve. Where those without errors do not come back up to
# the last number, they are others.
LARGEST_ERROR_OF_HOPS, UNSETTLED, OTHER_HOPS = 1e-7, 1e300, 1e-6
GROWTH_OF_HOPS = 1e6  # of a small change over many hops, up to which they are followed
HALVINGS = 12  # of a step in which the number of impacts changes and the map may jump
# The radius of the circle round a corner, its angles, and the angle at which both sides of the curve are checked.
AROUND, ANGLES, BESIDE = 1e-6, np.radians(np.linspace(-150, 150, 21)), 1e-5
COLLISION, NON_SMOOTH_FOLD = COLLISIONS = "border collision", "non-smooth fold"
# Where a launch passes a border: the steps of the secant method, which ends at this share of the range of the parameter
# and is trusted up to this many times the distance of the points; and multipliers that agree up to this share.
SECANTS, BORDER_FOUND, BORDER_BEYOND, SAME_SIDES = 30, 1e-14, 2.0, 1e-6
# Multipliers at events; the multiplier passes one of these smoothly where it comes this close to it, as a share of its
# change.
MULTIPLIERS, SMOOTH = {"fold": 1.0, "flip": -1.0}, 1e-3


@dataclass(frozen=True, eq=False)
class PeriodicLaunch:
    """A point of a branch: the parameter's value, the launch speeds and the multiplier of the hops, the numbers of
    impacts, the place and tangent (2,) in (launch speed, parameter), as shares of the ranges, and the rates (period,)
    of the launch speeds along the tangent where these are known."""

    value: float
    alphas: tuple[float, ...]
    multiplier: float
    impacts: tuple[int, ...]
    place: Vector
    tangent: Vector
    rates: Vector | None = None

    @property
    def alpha(self) -> float:
        """The first of the launch speeds."""
        return self.alphas[0]

    @property
    def u(self) -> tuple[float]:
        """The unknown of the curve's equation."""
        return (self.alpha,)


@dataclass(frozen=True, eq=False)
class FoundEvent:
    """An event on a branch, with its kind; where a launch passes a border of the map, the kind of the border, and the
    multipliers on both sides of it, that before it first."""

    kind: str
    point: PeriodicLaunch
    border: str = ""
    sides: tuple[float, ...] = ()


class MapEquations(NamedTuple):
    """The equation at points of the curve: residual (m, 1), Jacobian (m, 1, 2), the hops' launch speeds and numbers of
    impacts (m, period), and their multipliers (m,) where these are known together with the slopes, with their errors
    (m,)."""

    residual: np.ndarray
    jacobian: np.ndarray
    launches: np.ndarray
    impacts: np.ndarray
    multipliers: np.ndarray | None = None
    changes: np.ndarray | None = None
    errors: np.ndarray | None = None
    trajectories: tuple[()] = ()

    @property
    def amplification(self) -> np.ndarray:
        """The factors (m,) by which the last Newton step is to be smaller, where the slopes are not exact; no step is
        small enough for the last one where the hops are not known well enough."""
        if self.errors is None:
            return np.full(len(self.residual), INEXACT)
        return np.where(self.errors > LARGEST_ERROR_OF_HOPS, UNSETTLED, 1.0)


class LaunchCurve:
    """The curve of periodic launches as the tracer follows it; its points X are (launch speed, parameter).

    maps : the maps along the parameter
    between : range of launch speeds
    """

    kernel = None

    def __init__(self, maps: MapsAlong, between: tuple[float, float], period: int):
        self.maps, self.between, self.period = maps, between, period
        self.along, self.span = maps.name, maps.high - maps.low
        self.scale = np.array([between[1] - between[0], self.span])
        self._rates = np.empty((0, 2)), np.empty(0)  # the points of the latest slopes along the parameter, and these

    def size(self, x: np.ndarray) -> np.ndarray:
        """The ranges, for points (..., 2)."""
        return np.broadcast_to(self.scale, np.shape(x))

    def bare(self, xs: np.ndarray) -> np.ndarray:
        """The points (..., 2), which have no states at nodes."""
        return xs

    def possible(self, values: Any) -> Any:
        """Values of the parameter inside of its range, beyond which there may be no machine; any injection is one."""
        return values if self.along == INJECT else np.clip(values, self.maps.low, self.maps.high)

    def evaluate(self, xs: np.ndarray, exact: bool = False) -> MapEquations:
        """The equation at points (m, 2); unless it is to be `exact`, the hops may have errors."""
        alpha, values, (before, along) = xs[:, 0], self.possible(xs[:, 1]), self._rates
        if smooth := self.maps.smooth_cycles(alpha, values, self.period, exact):
            excess, slopes = smooth.excess
            numbers = smooth.launches[:, :-1], smooth.impacts, smooth.slopes.prod(axis=1), smooth.changes[:, :-1]
            return MapEquations(excess[:, None], slopes[:, None], *numbers, smooth.errors)
        step, m = STEP_ACROSS * np.abs(alpha), len(alpha)
        alphas = np.concatenate([alpha, alpha - step, alpha + step])
        launches, impacts = self.maps.cycles(alphas, np.tile(values, 3), self.period)
        residual, low, high = excess_of(launches).reshape(3, -1)
        across = np.where(np.abs(low + high - 2 * residual) > JUMP_OF_SLOPES * step, np.nan, (high - low) / (2 * step))
        near = before.shape == xs.shape and np.abs((xs - before) / self.scale).max() <= SAME_RATE
        if not (near and np.isfinite(along).all()):
            along = self.maps.slopes_along(alpha, values, self.period, residual)
            self._rates = xs.copy(), along
        jacobian = np.stack([across, along], axis=-1)[:, None]
        return MapEquations(residual[:, None], jacobian, launches[:m, :-1], impacts[:m])

    def rescued(self, x: np.ndarray) -> np.ndarray:
        """Raise `NoOrbit`: there is no other method where Newton's fails."""
        raise NoOrbit(f"the map is not smooth near {self.along} = {x[-1]:g}")

    def at(self, x: np.ndarray, before: np.ndarray) -> CurvePoint:
        """The certified point at a position (2,) on the curve, with the tangent pointing onward from `before` (2,)."""
        evaluation = self.evaluate(x[None], exact=True)
        across, along = evaluation.jacobian[0, 0]
        tangent = np.array([-along, across])
        size = float(np.linalg.norm(tangent / self.scale))
        tangent = tangent / size if size > 0 and np.isfinite(size) else before / np.linalg.norm(before / self.scale)
        tangent *= 1.0 if (tangent / self.scale**2) @ before >= 0 else -1.0
        return self.certify(CurvePoint(x, tangent, 0.0, cast(Any, evaluation), 0))

    def certify(self, point: CurvePoint) -> CurvePoint:
        """The point with its `PeriodicLaunch`, from hops without errors; raises `NoOrbit` where these are others."""
        if point.certified is not None:
            return point
        found: Any = point.evaluation
        if found.errors is not None and found.errors[point.place]:
            found = self.evaluate(point.x[None], exact=True)
            if not abs(found.residual[0, 0]) <= OTHER_HOPS:
                raise NoOrbit("the hops have other impacts there")
            point = point._replace(evaluation=found, place=0)
        launches, impacts = (tuple(each[point.place].tolist()) for each in (found.launches, found.impacts))
        if found.multipliers is None:
            slope = self.maps.multiplier(launches, float(self.possible(point.value)))
        else:
            slope = float(found.multipliers[point.place])
        shares = point.x / self.scale, point.tangent / self.scale
        rates = None if found.changes is None else found.changes[point.place] @ point.tangent
        launch = PeriodicLaunch(point.value, launches, slope, impacts, *shares, rates)
        return point._replace(certified=[cast(Any, launch)])

    def certify_all(self, points: Sequence[CurvePoint]) -> tuple[list[CurvePoint], None]:
        """The points with their launches, and no error."""
        return [self.certify(point) for point in points], None

    def certify_at(self, point: CurvePoint, value: float) -> CurvePoint:
        """A point whose parameter is `value` up to rounding, with exactly that value."""
        return self.certify(point._replace(x=np.append(point.x[:-1], value), certified=None))


def bounce_between(curve: LaunchCurve, before: PeriodicLaunch, behind: PeriodicLaunch, hop: int) -> FoundEvent | None:
    """The event between two points at which the contact force vanishes after a landing of a hop and then grows, so that
    the map and its slope are continuous, by Newton's method on its equations; None where it is not found there."""
    maps, fewer = curve.maps, min(before, behind, key=lambda each: each.impacts[hop])
    hops = None if maps.pieces is not None or maps.along is None else maps.along.nearest(fewer)
    if hops is None or abs(before.impacts[hop] - behind.impacts[hop]) != 1:
        return None
    value = float(curve.possible(0.5 * (before.value + behind.value)))
    inject, border = value if maps.name == INJECT else maps.inject, Border(hop, fewer.impacts[hop] - 1)
    try:
        found, slope = located_border(maps.machine_at(value), maps.name, value, inject, border, hops.unknowns)
    except (OrbitsError, np.linalg.LinAlgError):
        return None
    place = np.array([found.alpha, found.first]) / curve.scale
    apart = np.linalg.norm(0.5 * (before.place + behind.place) - place)
    if apart > BORDER_BEYOND * max(float(np.linalg.norm(behind.place - before.place)), AROUND):
        return None
    point = PeriodicLaunch(found.first, found.alphas, slope, fewer.impacts, place, behind.tangent)
    return FoundEvent(_kind_of((slope, slope)), point, "bounce", (slope, slope))


class LaunchSegment(Segment):
    """The branch between two neighbouring points."""

    @staticmethod
    def may_happen(
        curve: Any, before: CurvePoint, points: Sequence[CurvePoint], requested: tuple[float, ...], watch: Watch
    ) -> np.ndarray:
        return np.ones(len(points), bool)

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
        return self._crossing(MULTIPLIERS["fold"])

    def _sign_changes(self, watch: Watch) -> Iterator[tuple[str, float, CurvePoint]]:
        for kind, level in MULTIPLIERS.items():
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

    def cut(self, segment: Segment) -> tuple[Segment, End | None]:
        if jump := self._jump(segment):
            return jump
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
            row, share = np.array([1.0, 0.0]), (bound - first) / (before - first)
            guess = segment.a.x + share * (segment.b.x - segment.a.x)
            last = self.curve.certify(correct(self.curve, guess, row, bound, segment.a.tangent))
            reason = f"it leaves the launch speeds asked for at {self.curve.maps.in_words('alpha', bound)}"
            return LaunchSegment(self.curve, segment.a, last), End("left", reason)
        if not end and self.curve.period > 2 and abs(segment.b.point.multiplier) > GROWTH_OF_HOPS:
            reason = f"small changes grow {segment.b.point.multiplier:.0e}-fold over the hops, and rounding decides"
            return segment, End("stuck", reason)
        return segment, end

    def _jump(self, segment: Segment) -> tuple[Segment, End] | None:
        """The branch up to a jump of the map between two points on different curves, and that end; None without one."""
        before, behind, maps = segment.a, segment.b, self.curve.maps
        chord = (behind.x - before.x) / self.curve.scale
        size, impacts = float(np.linalg.norm(chord)), before.point.impacts
        if impacts == behind.point.impacts:
            return None
        if maps.pieces is not None and not self._jumps(before.point, behind.point):
            return None
        differ = [i for i, count in enumerate(impacts) if count != behind.point.impacts[i]]
        first, second = cast(Any, before.point), cast(Any, behind.point)
        if all(bounce_between(self.curve, first, second, hop) for hop in differ):
            return None
        pairs, reach = zip(before.point.alphas, behind.point.alphas, strict=True), size * float(self.curve.scale[0])
        spans = [(min(pair) - reach, max(pair) + reach) for pair in pairs]
        spans = [(max(low, 1e-3 * high), high) for low, high in spans]
        values = [float(self.curve.possible(point.value)) for point in (before, behind)]
        if not any(maps.jumps_between(span, value) for span in spans for value in values):
            return None
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            try:
                point = self.curve.certify(segment(middle))
            except NoOrbit:
                break
            if point.point.impacts == impacts:
                low, before = middle, point
            else:
                high, behind = middle, point
        else:
            apart = float(np.linalg.norm((behind.x - before.x) / self.curve.scale))
            if apart <= 4 * (high - low) * size:
                return None
        counts = " and ".join(map(str, impacts)), " and ".join(map(str, behind.point.impacts))
        place = place_in_words(maps, before.point)
        reason = f"the map jumps near {place}: {counts[0]} impacts in a hop, {counts[1]} behind"
        return LaunchSegment(self.curve, segment.a, before), End("jump", reason)

    def _jumps(self, before: Any, behind: Any) -> bool:
        """Whether a border where the map is not continuous lies between the launches of two points."""
        for pair in zip(before.alphas, behind.alphas, strict=True):
            low, high = sorted(pair)
            for border in self.curve.maps.pieces.borders:
                if low <= border.alpha <= high and border.kind not in CONTINUOUS:
                    return True
        return False

    def far(self, last: CurvePoint, history: object, way: object = ()) -> None:
        """Nothing: a branch ends at the bounds of its ranges."""

    def lost(self, error: object, last: CurvePoint, history: object) -> End:
        return End("stuck", str(error))


def _kind_of(sides: tuple[float, float]) -> str:
    """The kind of a collision with a border by the multipliers on both sides: the launches go on in the parameter, or
    turn round where one multiplier is above 1 and one below."""
    return COLLISION if (sides[0] - 1) * (sides[1] - 1) > 0 else NON_SMOOTH_FOLD


def place_in_words(maps: MapsAlong, point: Any) -> str:
    """Where a point of a branch is, in words."""
    return f"{maps.in_words(maps.name, point.value, 9)}, {maps.in_words('alpha', point.alpha, 9)}"


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
        """Whether launches change otherwise between two points than their rates say, as on another sheet of the curve,
        where each is another one of the same hops."""
        a, b = cast(Any, before.point), cast(Any, behind.point)
        if len(a.alphas) == 1 or a.rates is None or b.rates is None:
            return False
        length = float(np.linalg.norm((behind.x - before.x) / self.curve.size(before.x)))
        change, expected = np.subtract(b.alphas, a.alphas), 0.5 * length * (a.rates + b.rates)
        return bool(
            (np.abs(change - expected) > OTHER_SHEET * (np.abs(change) + np.abs(expected))).any() and length > AROUND
        )


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
        self.curve: Any = LaunchCurve(maps, between, period)
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
        options = replace(self.options, step_control=replace(self.options.step_control, first_step=first_step))
        low, high, earlier, count = self.maps.low, self.maps.high, list[object](), 0
        here: Any = self.curve.at(np.array([start.alpha, start.value]), side * start.tangent * self.scale)
        if start.value == (high if here.tangent[1] > 0 else low):
            yield self._reached(start.value)
            return
        while count < LONGEST_BRANCH:
            last: Any = here
            before, passed = here, list[FoundEvent]()
            for item in LaunchTracer(self.curve, here, low, high, options, earlier):
                if isinstance(item, CurvePoint) and item.point is not last.point:
                    yield from self._in_order(last.point, cast(Any, item.point), passed)
                    before, passed = last if self._distance(last, item) >= AROUND else before, []
                    last, count = item, count + 1
                    yield last.point
                elif isinstance(item, Event) and item.kind != "value":
                    passed.append(FoundEvent(item.kind, cast(Any, item.point)))
                elif isinstance(item, End) and (item.kind not in ("stuck", "stopped") or self._grown(last)):
                    yield from passed
                    yield self._reached(last.value) if item.kind == "reached" else item
                    return
            yield from passed
            if (behind := self._round_corner(before, last) or self._beyond_border(before, last)) is None:
                yield self._why_stuck(last)
                return
            yield from self._in_order(last.point, cast(Any, behind.point), self._corner(last, behind))
            here, earlier, options = behind, [start], self.options
            yield here.point
        yield End("stuck", f"it has {LONGEST_BRANCH} points")

    def _grown(self, last: CurvePoint) -> bool:
        return self.curve.period > 2 and abs(last.point.multiplier) > GROWTH_OF_HOPS

    def _corner(self, last: CurvePoint, behind: CurvePoint) -> list[FoundEvent]:
        """The event at a corner of the curve between two points, where its tangents meet, if its multiplier passes 1 or
        -1 there."""
        sides = last.point.multiplier, behind.point.multiplier
        if not any((sides[0] - level) * (sides[1] - level) < 0 for level in MULTIPLIERS.values()):
            return []
        a, b = cast(Any, last.point), cast(Any, behind.point)
        share, _ = solve(np.column_stack([a.tangent, -b.tangent]), b.place - a.place)
        if abs(share) <= 2.0 * AROUND:  # else the tangents turn beside the corner
            place = a.place + share * a.tangent
            alpha, value = (place * self.scale).tolist()
            a = replace(a, value=value, alphas=(alpha, *a.alphas[1:]), place=place)
        return [FoundEvent(_kind_of(sides), replace(a, multiplier=float("nan")), "", sides)]

    def _in_order(
        self, before: PeriodicLaunch, behind: PeriodicLaunch, found: list[FoundEvent]
    ) -> Iterator[FoundEvent]:
        """The events between two neighbouring points in order: those that are found, and those at which a launch passes
        a border, in place of the same found less exactly."""
        borders = [] if before.impacts == behind.impacts else self._passed_borders(before, behind)
        if borders:
            found = [*(event for event in found if event.kind not in COLLISIONS), *borders]
        chord = behind.place - before.place
        yield from sorted(found, key=lambda event: float((event.point.place - before.place) @ chord))

    def _passed_borders(self, before: PeriodicLaunch, behind: PeriodicLaunch) -> list[FoundEvent]:
        """The events between two neighbouring points at which one of their launches is at a border of the map."""
        found = list[FoundEvent]()
        for hop, counts in enumerate(zip(before.impacts, behind.impacts, strict=True)):
            if counts[0] != counts[1] and (event := self._at_border(before, behind, hop)):
                found.append(event)
        return found

    def _at_border(self, before: PeriodicLaunch, behind: PeriodicLaunch, hop: int) -> FoundEvent | None:
        """The event at which a launch is at a border: the parameter for which the border's own launch comes back, by
        the secant method. None where it is not found between the points."""
        if found := bounce_between(self.curve, before, behind, hop):
            return found
        ends, values = (before.alphas[hop], behind.alphas[hop]), [before.value, behind.value]
        if values[0] == values[1]:
            values[1] += SAME_PLACE * self.curve.span
        try:
            excesses = [self._of_border(ends, value)[0] for value in values]
            for _ in range(SECANTS):
                if excesses[1] == excesses[0] or abs(values[1] - values[0]) <= BORDER_FOUND * self.curve.span:
                    break
                step = excesses[1] * (values[1] - values[0]) / (excesses[1] - excesses[0])
                values = [values[1], float(self.curve.possible(values[1] - step))]
                excesses = [excesses[1], self._of_border(ends, values[1])[0]]
            _, border, launches, impacts, sides = self._of_border(ends, values[1])
        except NoOrbit:
            return None
        reach = BORDER_BEYOND * max(abs(before.value - behind.value), AROUND * self.curve.span)
        if min(abs(values[1] - before.value), abs(values[1] - behind.value)) > reach:
            return None
        alphas = (*launches[-hop:], *launches[:-hop]) if hop else launches
        counts = (*impacts[-hop:], *impacts[:-hop]) if hop else impacts
        place = np.array([alphas[0], values[1]]) / self.scale
        multiplier = sides[0] if abs(sides[1] - sides[0]) <= SAME_SIDES * (1 + abs(sides[0])) else float("nan")
        point = PeriodicLaunch(values[1], alphas, multiplier, counts, place, behind.tangent)
        return FoundEvent(_kind_of(sides), point, border.kind, sides)

    def _of_border(
        self, ends: tuple[float, float], value: float
    ) -> tuple[float, MapBorder, tuple[float, ...], tuple[int, ...], tuple[float, float]]:
        """The hops at a value of the parameter from the border between two launch speeds: by how much the last launch
        exceeds the first, the border, the launches, the impacts and the multipliers on both sides of the border."""
        pieces = self.maps.pieces_at(value, *sorted(ends))
        middle = 0.5 * (ends[0] + ends[1])
        near = [each for each in pieces.borders if each.kind in CONTINUOUS]
        if not near:
            raise NoOrbit("no border at which the map is continuous lies between these launches")
        border = min(near, key=lambda each: abs(each.alpha - middle))
        sides = pieces.slopes_at(border)
        sides = sides if ends[0] <= ends[1] else sides[::-1]
        following = border.next[0 if ends[0] <= ends[1] else 1] + self.maps.added(value)
        launches, impacts, others = self._hops_from(following, value)
        excess = float(launches[0, -1]) - border.alpha
        alphas = border.alpha, *launches[0, :-1].tolist()
        own = pieces.impacts_at(border)
        return excess, border, alphas, (own, *impacts[0].tolist()), (others * sides[0], others * sides[1])

    def _beyond_border(self, before: CurvePoint, last: CurvePoint) -> CurvePoint | None:
        """The curve behind a border near the first launch, at a launch on the other side than `before`; None where
        there is none, or the map jumps there. Behind a graze the curve bends away at once, so that no circle cuts it as
        it should."""
        alpha, reach = last.point.alpha, 10.0 * AROUND * float(self.scale[0])
        borders = self.maps.pieces_at(float(self.curve.possible(last.value)), alpha - reach, alpha + reach).borders
        near = [each.alpha for each in borders if each.kind in CONTINUOUS and abs(each.alpha - alpha) <= reach]
        if not near:
            return None
        border = min(near, key=lambda each: abs(each - alpha))
        ahead = np.array([np.sign(border - before.point.alpha) * reach, 0.0])
        try:
            at = np.array([border + ahead[0], last.value])
            return self.curve.certify(correct(self.curve, at, np.array([1.0, 0.0]), float(at[0]), ahead))
        except NoOrbit:
            return None

    def _hops_from(self, alpha: float, value: float) -> tuple[np.ndarray, np.ndarray, float]:
        """The launches (1, period) and impacts (1, period - 1) of all hops but one from a launch, and their
        multiplier."""
        at, count = np.array([alpha]), self.curve.period - 1
        if smooth := self.maps.smooth_cycles(at, np.array([value]), count):
            return smooth.launches, smooth.impacts, float(smooth.slopes.prod())
        launches, impacts = self.maps.cycles(at, value, count)
        if not np.isfinite(launches).all():
            raise NoOrbit("a hop from the border has no next launch")
        return launches, impacts, self.maps.multiplier(tuple(launches[0, :-1].tolist()), value)

    def _reached(self, bound: float) -> End:
        return End("reached", f"{self.maps.in_words(self.maps.name, bound)} is reached")

    def _distance(self, a: CurvePoint, b: CurvePoint) -> float:
        """The distance of two points in shares of the ranges."""
        return float(np.linalg.norm((a.x - b.x) / self.scale))

    def _round_corner(self, before: CurvePoint, last: CurvePoint) -> CurvePoint | None:
        """The curve behind a corner of the map, where a small circle round the last point cuts it; None where it does
        not, or where the map jumps there. The direction at the last point is that from an earlier one, since
        differences reach round the corner."""
        distance = self._distance(before, last)
        ahead = ((last.x - before.x) / distance if distance >= AROUND else last.tangent) / self.scale
        sideways = np.array([-ahead[1], ahead[0]])

        def away(angle: float) -> Vector:
            return AROUND * (np.cos(angle) * ahead + np.sin(angle) * sideways) * self.scale

        def excess(angle: float) -> float:
            alpha, value = last.x + away(angle)
            return float(self.maps.excess(np.array([alpha]), self.curve.possible(value), self.curve.period)[0])

        reach = AROUND * self.curve.span
        if self.curve.along != INJECT and not self.maps.low < last.value - reach < last.value < self.maps.high:
            return None
        values = np.array([excess(angle) for angle in ANGLES])
        for i in np.flatnonzero((values[1:] >= 0) != (values[:-1] >= 0)):
            fa, fb = float(values[i]), float(values[i + 1])
            if not np.isfinite(fa + fb):
                continue
            angle = bracketed_root(excess, ANGLES[i], ANGLES[i + 1], fa, fb)
            # At a jump the excess is small on one side only.
            if max(abs(excess(angle + side * BESIDE)) for side in (-1, 1)) <= 1e-2 * (abs(fa) + abs(fb)):
                return self.curve.at(last.x + away(angle), away(angle))
        return None

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
