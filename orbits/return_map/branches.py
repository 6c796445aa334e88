"""Branches of periodic launches, followed in the plane of a parameter and the launch speed.

Both are scaled by their ranges. A step along the tangent is corrected across it by Newton's method; slopes of the map
are differences of lanes, since beside lossless hops they change with the cube root of the distance. The map is smooth
only in pieces: where the number of impacts changes, a step must not pass a jump, and round a corner, where the slope
jumps, the curve is found again on a small circle.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..errors import NoOrbit
from ..numerics.roots import bracketed_root, solve
from ..running import interrupts
from ..simulation.impacts import STATUSES
from .cycles import INJECT, MapsAlong
from .diagram import BranchEnd

Vector = np.ndarray
# Fixed points beside a lossless hop are looked for at this distance, as a share of the range.
BESIDE_LOSSLESS = 1e-8
# Steps are shares of the ranges. Beside lossless hops unstable fixed points hardly move with the parameter and stable
# ones do: seen from further away the curve has a corner there, which small steps turn round.
SMALLEST, FIRST = 1e-9, 1e-3
LONGEST_BRANCH = 20_000
MOST_CORRECTIONS = 8
CORRECTED, ROUNDING_OF_PLACES = 1e-7, 4e-16  # a correction is the last one below this share of the step, or rounding
# Corrections of at most this share of the step that hardly become smaller any more are the noise of the map.
STAGNANT, SLOWER = 1e-5, 0.3
STRAIGHT, EASY = 0.9, 0.98  # cosines of the turn in a step: a step that turns more is repeated, one less lengthens
LENGTHENED, SHORTENED = 1.7, 0.25
FIRST_OF_TWO = (1e-3, 1e-4, 1e-2)  # from a flip to the first hops of twice the period, as shares of the range
LOCATED = 1e-13  # events are located to this share of a step
HALVINGS = 12  # of a step in which the number of impacts changes and the map may jump
# The circle round a corner, and the angle at which both sides of the curve are looked at.
AROUND, ANGLES, BESIDE = 1e-6, np.radians(np.linspace(-150, 150, 21)), 1e-5
SAME_PLACE = 1e-6  # launches that differ by a smaller share of the range are the same


@dataclass(frozen=True, eq=False)
class PeriodicLaunch:
    """A point of a branch: the parameter's value, the launch speeds and the multiplier of the hops, the numbers of
    impacts, and the scaled place and unit tangent (2,) in (launch speed, parameter)."""

    value: float
    alphas: tuple[float, ...]
    multiplier: float
    impacts: tuple[int, ...]
    place: Vector
    tangent: Vector


@dataclass(frozen=True, eq=False)
class FoundEvent:
    """An event on a branch, with its kind."""

    kind: str
    point: PeriodicLaunch


class BranchTracer:
    """Follows the branches of one period.

    maps : the maps along the parameter
    between : range of launch speeds
    asked : values of the parameter that are hit exactly on the way
    longest : the longest step
    """

    def __init__(
        self, maps: MapsAlong, between: tuple[float, float], period: int, asked: tuple[float, ...], longest: float
    ):
        self.maps, self.between, self.period, self.asked, self.longest = maps, between, period, asked, longest
        self.scale = np.array([between[1] - between[0], maps.high - maps.low])
        # Injections may have any value. Others are not asked for outside of their range, where there may be no machine.
        self.free = maps.name == INJECT

    def point(self, place: Vector, ahead: Vector, value: float | None = None) -> PeriodicLaunch:
        """The point at a corrected place, with the tangent that points `ahead`."""
        alpha = float(place[0] * self.scale[0])
        value = self._value(place) if value is None else value
        launches, impacts = self.maps.cycle(alpha, value, self.period)
        slope = self.maps.multiplier(launches, value)
        step = float(np.linalg.norm(ahead)) * 0.01
        here, across = 0.0, slope - 1.0
        if self.period == 2 or not np.isfinite(across):
            here, across = self.maps.slopes(alpha, value, self.period, step * self.scale[0])
        along = self.maps.slope_along(alpha, value, self.period, here)
        tangent = np.array([-along * self.scale[1], across * self.scale[0]])
        size = float(np.linalg.norm(tangent))
        tangent = tangent / size if size > 0 and np.isfinite(size) else ahead / np.linalg.norm(ahead)
        return PeriodicLaunch(value, launches, slope, impacts, place, tangent * (1 if tangent @ ahead >= 0 else -1))

    def _value(self, place: Vector) -> float:
        value = float(place[1] * self.scale[1])
        return value if self.free else float(np.clip(value, self.maps.low, self.maps.high))

    def correct(self, place: Vector, row: Vector, level: float, step: float, value: float | None = None) -> Vector:
        """The place on the curve near another where a row (2,) has a level; with `value` the parameter has exactly
        that. Raises `NoOrbit` where Newton's method does not converge."""
        place, first = place.copy(), place
        along, last = None, np.inf
        for _ in range(MOST_CORRECTIONS):
            alpha, at = float(place[0] * self.scale[0]), self._value(place) if value is None else value
            if alpha <= 0:
                break
            excess, across = self.maps.slopes(alpha, at, self.period, 0.01 * step * self.scale[0])
            along = self.maps.slope_along(alpha, at, self.period, excess) if along is None else along
            matrix = np.array([[across * self.scale[0], along * self.scale[1]], row])
            change = solve(matrix, np.array([excess, row @ place - level]))
            if not np.isfinite(change).all():
                break
            place -= change
            if np.abs(place - first).max() > 2 * step:
                break
            size = float(np.abs(change).max())
            if size <= max(CORRECTED * step, ROUNDING_OF_PLACES * float(np.abs(place).max())):
                return place
            if SLOWER * last <= size <= STAGNANT * step:
                return place
            last = size
        raise NoOrbit("the corrector does not converge")

    def between_points(self, a: PeriodicLaunch, b: PeriodicLaunch, share: float) -> PeriodicLaunch:
        """The point at a share of the chord between two."""
        if share in (0.0, 1.0):
            return (a, b)[int(share)]
        chord = b.place - a.place
        row = chord / (chord @ chord)
        place = self.correct(a.place + share * chord, row, float(row @ a.place) + share, float(np.linalg.norm(chord)))
        return self.point(place, chord)

    def at_value(self, a: PeriodicLaunch, b: PeriodicLaunch, value: float) -> PeriodicLaunch:
        """The point between two others, between which the curve does not turn round, with a value of the parameter."""
        chord = b.place - a.place
        share = (value - a.value) / (b.value - a.value)
        level, row = value / float(self.scale[1]), np.array([0.0, 1.0])
        guess = a.place + share * chord
        place = self.correct(np.array([guess[0], level]), row, level, float(np.linalg.norm(chord)), value)
        return self.point(place, chord, value)

    def start(self, alpha: float, value: float) -> PeriodicLaunch:
        """A periodic launch that has been found at a value of the parameter."""
        return self.point(np.array([alpha, value]) / self.scale, np.array([0.0, SMALLEST]), value)

    def start_lossless(self, alpha: float) -> tuple[PeriodicLaunch, list[PeriodicLaunch]]:
        """A lossless hop, which is a fixed point without injection, and the fixed points just below and above it, each
        with the tangent that leads away. Two branches of fixed points begin there, both tangent to the launch speed's
        axis and with unbounded curvature."""
        place, beside = np.array([alpha / self.scale[0], 0.0]), []
        for side in (-1.0, 1.0):
            row = np.array([1.0, 0.0])
            guess = place + side * BESIDE_LOSSLESS * row
            beside.append(self.point(self.correct(guess, row, float(guess[0]), FIRST), side * BESIDE_LOSSLESS * row))
        hop, impacts = (alpha,), beside[1].impacts
        return PeriodicLaunch(0.0, hop, 1.0, impacts, place, np.array([1.0, 0.0])), beside

    def start_beside_flip(self, flip: PeriodicLaunch) -> PeriodicLaunch:
        """Hops of twice the period beside those whose multiplier is -1; raises `NoOrbit` where none are found."""
        row = np.array([1.0, 0.0])
        # The fixed point moves with the parameter too, and may do so faster, so that there are hops on one side only.
        for step in (side * length for length in FIRST_OF_TWO for side in (1, -1)):
            guess = flip.place + step * row
            try:
                place = self.correct(guess, row, float(guess[0]), 10 * abs(step))
                return self.point(place, place - flip.place)
            except NoOrbit:
                continue
        raise NoOrbit("no hops of twice the period are found beside the flip")

    def trace(self, start: PeriodicLaunch, side: int) -> Iterator[PeriodicLaunch | FoundEvent | BranchEnd]:
        """The points and events from one, in order along its tangent (`side` 1) or against it (-1); an end is last."""
        here, ahead, step = start, side * start.tangent, FIRST
        for _ in range(LONGEST_BRANCH):
            interrupts.heed()
            there, step, stopped = self._step(here, ahead, step)
            if there is None:
                yield stopped or self._why_stuck(here, ahead)
                return
            if end := self._jump(here, there):
                yield end
                return
            yield from (inside := list(self._inside(here, there)))
            if closed := self._closed(start, side, [here, *(x for x in inside if isinstance(x, PeriodicLaunch))]):
                yield closed
                return
            if stopped is None or stopped.kind != "flip":
                yield there
            if stopped:
                yield stopped
                return
            here, ahead = there, there.tangent
        yield BranchEnd("stuck", f"it has {LONGEST_BRANCH} points")

    def _step(
        self, here: PeriodicLaunch, ahead: Vector, step: float
    ) -> tuple[PeriodicLaunch | None, float, BranchEnd | None]:
        """The next point, the length for the step after it, and the end where the point is the last one; no point
        where none is found."""
        step = min(step, self.longest)
        while step >= SMALLEST:
            try:
                there, stopped = self._stepped(here, ahead, step)
            except NoOrbit:
                step *= SHORTENED
                continue
            turn = float(there.tangent @ ahead)
            straight = turn >= STRAIGHT or stopped is not None
            if straight:
                return there, step * (LENGTHENED if turn >= EASY else 1.0), stopped
            step *= SHORTENED
        return self._round_corner(here, ahead), FIRST, None

    def _stepped(self, here: PeriodicLaunch, ahead: Vector, step: float) -> tuple[PeriodicLaunch, BranchEnd | None]:
        """One step of a certain length, shorter where it comes to an end of a range."""
        low, high = self.maps.low, self.maps.high
        guess = here.place + step * ahead
        value = float(guess[1] * self.scale[1])
        if not self.free and not low <= value <= high:
            bound = low if value < low else high
            return self._last(here, ahead, (bound - here.value) / float(ahead[1] * self.scale[1]), bound)
        there = self.point(self.correct(guess, ahead, float(ahead @ guess), step), step * ahead)
        slack = SMALLEST * self.scale[1]
        if there.value < low - slack or there.value > high + slack:
            bound = low if there.value < low else high
            if here.value == bound:
                raise NoOrbit("the curve turns back at the end of the range")
            return self._last(here, there.place - here.place, (bound - here.value) / (there.value - here.value), bound)
        slow, fast = self.between
        if not slow <= there.alphas[0] <= fast:
            bound = slow if there.alphas[0] < slow else fast
            row, level = np.array([1.0, 0.0]), bound / float(self.scale[0])
            last = self.point(self.correct(there.place, row, level, 2 * step), ahead * step)
            return last, BranchEnd("left", f"it leaves the launch speeds asked for at {self.maps.told('alpha', bound)}")
        if self.period == 2 and (there.alphas[1] - there.alphas[0]) * (here.alphas[1] - here.alphas[0]) < 0:
            return there, BranchEnd("flip", "its two launches become one, at another flip of the fixed points")
        return there, None

    def _last(
        self, here: PeriodicLaunch, ahead: Vector, share: float, bound: float
    ) -> tuple[PeriodicLaunch, BranchEnd]:
        """The point where the curve comes to an end of the parameter's range."""
        level, row = bound / float(self.scale[1]), np.array([0.0, 1.0])
        guess = np.array([here.place[0] + share * ahead[0], level])
        step = max(float(np.linalg.norm(guess - here.place)), SMALLEST)
        last = self.point(self.correct(guess, row, level, step, bound), guess - here.place + SMALLEST * ahead, bound)
        return last, BranchEnd("reached", f"{self.maps.told(self.maps.name, bound)} is reached")

    def _jump(self, a: PeriodicLaunch, b: PeriodicLaunch) -> BranchEnd | None:
        """The end of the branch where the map jumps between two points, of which it joins two curves."""
        if a.impacts == b.impacts:
            return None
        reach = float(np.linalg.norm(b.place - a.place)) * float(self.scale[0])
        spans = [(min(pair) - reach, max(pair) + reach) for pair in zip(a.alphas, b.alphas, strict=True)]
        spans = [(max(low, 1e-3 * high), high) for low, high in spans]
        if not any(self.maps.jumps_between(span, point.value) for span in spans for point in (a, b)):
            return None
        low, high, width = 0.0, 1.0, 1.0
        before, behind = a, b
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            try:
                point = self.between_points(a, b, middle)
            except NoOrbit:
                return self._jumped(before, behind)
            if point.impacts == a.impacts:
                low, before = middle, point
            else:
                high, behind = middle, point
            width *= 0.5
        apart = float(np.linalg.norm(behind.place - before.place))
        return self._jumped(before, behind) if apart > 4 * width * float(np.linalg.norm(b.place - a.place)) else None

    def _jumped(self, before: PeriodicLaunch, behind: PeriodicLaunch) -> BranchEnd:
        counts = " and ".join(map(str, before.impacts)), " and ".join(map(str, behind.impacts))
        return BranchEnd(
            "jump", f"the map jumps near {self._place(before)}: {counts[0]} impacts in a hop, {counts[1]} behind"
        )

    def _inside(self, a: PeriodicLaunch, b: PeriodicLaunch) -> Iterator[PeriodicLaunch | FoundEvent]:
        """The events and asked values between two points, in order along the curve."""
        found: list[tuple[float, PeriodicLaunch | FoundEvent]] = []
        for kind, level in (("fold", 1.0), ("flip", -1.0)):
            if located := self._crossing(a, b, level):
                share, point, smooth = located
                if smooth and kind == "fold" and (a.value - point.value) * (b.value - point.value) < 0:
                    kind = "branch point"
                found.append((share, FoundEvent(kind if smooth else "border collision", point)))
        folds = [(share, item.point) for share, item in found if isinstance(item, FoundEvent) and item.kind != "flip"]
        joints = [(0.0, a), *sorted(folds, key=lambda fold: fold[0]), (1.0, b)]
        for (low, first), (high, second) in pairwise(joints):
            for value in self.asked:
                if min(first.value, second.value) < value < max(first.value, second.value):
                    try:
                        share = low + (high - low) * (value - first.value) / (second.value - first.value)
                        found.append((share, self.at_value(first, second, value)))
                    except NoOrbit:  # beside a fold the value hardly tells the place; another section finds the branch
                        continue
        yield from (item for _, item in sorted(found, key=lambda pair: pair[0]))

    def _crossing(
        self, a: PeriodicLaunch, b: PeriodicLaunch, level: float
    ) -> tuple[float, PeriodicLaunch, bool] | None:
        """Where between two points the multiplier passes a level: the share of the chord, the point, and whether the
        multiplier passes it smoothly and does not jump over it."""
        first, last = a.multiplier - level, b.multiplier - level
        if not (np.isfinite(first) and np.isfinite(last)) or (first >= 0) == (last >= 0):
            return None
        if 0.0 in (first, last):  # begins or ends the branch, or is seen when all its points are known
            return None
        points = {0.0: a, 1.0: b}

        def excess(share: float) -> float:
            points[share] = self.between_points(a, b, share)
            value = points[share].multiplier - level
            return value if np.isfinite(value) else 0.0

        try:
            share = bracketed_root(excess, 0.0, 1.0, first, last, width=LOCATED)
            point = points.get(share) or self.between_points(a, b, share)
        except NoOrbit:
            share = min(points, key=lambda each: abs(points[each].multiplier - level))
            return share, points[share], False
        beside = sorted(abs(points[each].multiplier - level) for each in points if abs(each - share) < 1e-9)
        size = abs(first) + abs(last)
        return share, point, abs(point.multiplier - level) <= 1e-3 * size and (not beside or beside[0] <= 1e-3 * size)

    def _place(self, point: PeriodicLaunch) -> str:
        """Where a point is, in words."""
        return f"{self.maps.told(self.maps.name, point.value, 9)}, {self.maps.told('alpha', point.alphas[0], 9)}"

    def _closed(self, start: PeriodicLaunch, side: int, passed: list[PeriodicLaunch]) -> BranchEnd | None:
        """The end of a curve that has come back to its start, at one of the asked values."""
        again = [p for p in passed[1:] if p.value == start.value]
        close = [p for p in again if abs(p.place[0] - start.place[0]) <= SAME_PLACE]
        if not close:
            return None
        if side * float(close[0].tangent @ start.tangent) > 0:
            return BranchEnd("closed", "it comes back to where it began")
        return BranchEnd("stuck", "two branches are too close to be told apart")

    def _round_corner(self, here: PeriodicLaunch, ahead: Vector) -> PeriodicLaunch | None:
        """The curve behind a corner of the map, where a small circle round the last point cuts it; None where it does
        not, or where the map jumps there."""
        sideways = np.array([-ahead[1], ahead[0]])

        def on_circle(angle: float) -> Vector:
            return here.place + AROUND * (np.cos(angle) * ahead + np.sin(angle) * sideways)

        def excess(angle: float) -> float:
            place = on_circle(angle)
            alpha, value = np.array([place[0] * self.scale[0]]), self._value(place)
            return float(self.maps.excess(alpha, value, self.period)[0])

        if not self.free and not self.maps.low < here.value - AROUND * self.scale[1] < here.value < self.maps.high:
            return None
        values = np.array([excess(angle) for angle in ANGLES])
        for i in np.flatnonzero((values[1:] >= 0) != (values[:-1] >= 0)):
            fa, fb = float(values[i]), float(values[i + 1])
            if not np.isfinite(fa + fb):
                continue
            angle = bracketed_root(excess, ANGLES[i], ANGLES[i + 1], fa, fb)
            # At a jump the excess is small on one side only.
            if max(abs(excess(angle + side * BESIDE)) for side in (-1, 1)) <= 1e-2 * (abs(fa) + abs(fb)):
                place = on_circle(angle)
                return self.point(place, place - here.place)
        return None

    def _why_stuck(self, here: PeriodicLaunch, ahead: Vector) -> BranchEnd:
        """Why the curve cannot be followed further."""
        place = f"near {self._place(here)}"
        beyond = here.place + AROUND * ahead
        value, reach = self._value(beyond), AROUND * float(self.scale[0])
        for alpha in (float(beyond[0] * self.scale[0]), *here.alphas[1:]):
            if (status := self.maps.status(alpha, value)) != "lifts_off":
                return BranchEnd("no launch", f"{place} a hop has no next launch any more: {STATUSES[status]}")
        for alpha in here.alphas:
            if self.maps.jumps_between((alpha - reach, alpha + reach), value):
                return BranchEnd("jump", f"the map jumps {place}")
        return BranchEnd("stuck", f"{place} the map is not smooth, and the curve is lost")
