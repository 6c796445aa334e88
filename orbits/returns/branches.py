"""Branches of periodic launches: curves in the launch speed and a parameter of the return map.

They are followed as a `LaunchCurve`, behind corners of the map as `BordersOfCurve` finds them there, and where the hops
are known by their equations as a `CycleCurve` in all unknowns of these.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..curves import ASKS, End, Event, Points, Run, Start, Test
from ..errors import NoOrbit
from ..hops.impacts import STATUSES
from .bifurcation import name_of_hops
from .border_events import COLLISION, BordersOfCurve, distance
from .cycle_curve import STEPS_OF_CYCLES, CycleCurve
from .cycle_statement import MULTIPLIER_AT
from .cycles import MapsAlong
from .launch_curve import AROUND, STEPS_OF_BRANCHES, CurveOfHops, LaunchCurve, PeriodicLaunch, place_in_words


@dataclass(frozen=True, kw_only=True)
class Branching:
    """Where branches begin, and how far they are followed; distances are shares of the ranges.

    beside_lossless : distance from a lossless hop at which fixed points beside it are searched for
    doubled : distances in launch speed, tried in turn, from a flip to the first hops of twice the period
    doubled_within : largest distance from the flip to these hops in the parameter, as a multiple of that in speed
    both_sides : their two launches lie on both sides of the flip up to this share of the distance, or they are others
    doubled_change : their multiplier begins at 1, and differs from it by less: else a flip or a fold may lie between
    far_from_lost : at such a distance from where it was lost the curve in all unknowns of the hops is tried again
    growth : of a small change over many hops, up to which they are followed
    smooth : the multiplier passes a level smoothly where it comes this close to it, as a share of its change
    """

    beside_lossless: float = 1e-8
    doubled: tuple[float, ...] = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-2)
    doubled_within: float = 20.0
    both_sides: float = 0.5
    doubled_change: float = 1.0
    far_from_lost: float = 1e-2
    growth: float = 1e6
    smooth: float = 1e-3


BRANCHING = Branching()


class BranchCurve(LaunchCurve):
    """The launches of a branch, which goes on behind corners of the map and in all unknowns of the hops."""

    def __init__(
        self, maps: MapsAlong, between: tuple[float, float], period: int, apart: float, options: Branching = BRANCHING
    ):
        super().__init__(maps, between, period, apart)
        self.options = options
        if maps.pieces is None and maps.along is not None:
            self.tests = (*self.tests, Test("far", _near_to_lost, ASKS))

    @cached_property
    def borders(self) -> BordersOfCurve:
        """What happens at the borders of the map."""
        return BordersOfCurve(self)

    def in_all_unknowns(self, launch: PeriodicLaunch) -> tuple[CycleCurve, Points] | None:
        """The curve in all unknowns of the hops and its point (1) at a launch, None where these are not known."""
        if self.maps.pieces is not None or self.maps.along is None:
            return None
        curve = CycleCurve(self, launch.impacts)
        return (curve, first) if (first := curve.begin(launch)) else None

    def changed(self, event: Event, passed: Sequence[Points]) -> Start | End | None:
        known = self.in_all_unknowns(event.point.own[0])
        return Start.at(*known) if known else None

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> Start | End:
        """Behind the corner at the last point, where there is one."""
        own = [(launch, length) for each in passed for launch, length in zip(each.own, each.lengths, strict=True)]
        last, i = own[-1][0], len(own) - 1
        while i and own[i][1] and distance(own[i][0], last) < AROUND:  # a curve that goes on has a length of 0
            i -= 1
        if (behind := self.borders.behind(own[i][0], last)) is None:
            return self._why_stuck(last)
        return Start.at(self, self.of_launch(behind), ("corner", passed[-1][-1:]))

    def _why_stuck(self, launch: PeriodicLaunch) -> End:
        """Why the curve cannot be followed further."""
        place = f"near {place_in_words(self.maps, launch)}"
        speed, beyond = np.array([launch.alpha, launch.value]) + AROUND * launch.tangent * self.scale
        value, reach = float(self.possible(beyond)), AROUND * float(self.scale[0])
        for alpha in (float(speed), *launch.alphas[1:]):
            if (status := self.maps.status(alpha, value)) != "lifts_off":
                return End("no launch", f"{place} a hop has no next launch any more: {STATUSES[status]}")
        for alpha in launch.alphas:
            if self.maps.jumps_between((alpha - reach, alpha + reach), value):
                return End("jump", f"the map jumps {place}")
        return End("stuck", f"{place} the map is not smooth, and the curve is lost")


def _near_to_lost(curve: Any, points: Points) -> np.ndarray:
    """Negative for launches (m,) that are far from where the curve in all unknowns was lost, or have other impacts."""
    lost = curve.begun
    farthest = curve.options.far_from_lost
    near = [launch.impacts == lost.impacts and distance(launch, lost) <= farthest for launch in points.own]
    return np.where(near, 1.0, -1.0)


class BranchTracer:
    """Follows the branches of one period.

    maps, between, period : as of a `LaunchCurve`
    values : of the parameter that get an exact point
    longest : the longest distance of two points, as a share of the ranges
    """

    def __init__(
        self, maps: MapsAlong, between: tuple[float, float], period: int, values: tuple[float, ...],
        longest: float = STEPS_OF_BRANCHES.apart, options: Branching = BRANCHING,
    ):  # fmt: skip
        self.maps, self.values, self.options = maps, values, options
        self.curve = BranchCurve(maps, between, period, longest if period <= 2 else 2.0 * longest / period, options)
        self.borders, self.scale = self.curve.borders, self.curve.scale

    def start(self, alpha: float, value: float) -> PeriodicLaunch:
        """The point of a periodic launch found at a value of the parameter."""
        return self.curve.at(np.array([alpha, value]), np.array([0.0, 1.0]))

    def start_lossless(self, alpha: float) -> tuple[PeriodicLaunch, list[PeriodicLaunch]]:
        """A lossless hop, which is a fixed point without injection, and the fixed points just below and above it, each
        with the tangent that leads away. Two branches of fixed points begin there, both tangent to the launch speed's
        axis and with unbounded curvature."""
        hop, away = np.array([alpha, 0.0]), np.array([self.options.beside_lossless, 0.0]) * self.scale
        beside = [self.curve.near(hop + side * away, side * away) for side in (-1.0, 1.0)]
        return PeriodicLaunch(0.0, (alpha,), 1.0, beside[1].impacts, hop / self.scale, np.array([1.0, 0.0])), beside

    def start_beside_flip(self, flip: PeriodicLaunch) -> PeriodicLaunch:
        """Hops of twice the period beside those whose multiplier is -1; raises `NoOrbit` where none are found."""
        # The fixed point moves with the parameter too, possibly faster, so that there are hops on one side only.
        for step in (side * length for length in self.options.doubled for side in (1, -1)):
            away = np.array([step, 0.0])
            try:
                first = self.curve.near((flip.place + away) * self.scale, away * self.scale)
            except NoOrbit:
                continue
            mirrored = 2.0 * flip.alpha - first.alpha  # near the flip the launch after half of the hops
            beside = abs(first.alphas[len(flip.alphas)] - mirrored) <= self.options.both_sides * abs(
                first.alpha - flip.alpha
            )
            beside &= abs(first.multiplier - 1.0) <= self.options.doubled_change
            if beside and abs(first.place[1] - flip.place[1]) <= self.options.doubled_within * abs(step):
                onward = first.tangent @ (first.place - flip.place) >= 0
                return first if onward else replace(first, tangent=-first.tangent)
        raise NoOrbit("no hops of twice the period are found beside the flip")

    def trace(
        self, start: PeriodicLaunch, side: int, first_step: float = STEPS_OF_BRANCHES.first
    ) -> Iterator[PeriodicLaunch | Event | End]:
        """The points and events from one, in order along its tangent (`side` 1) or against it (-1); an end is last."""
        first, maps = self.curve.of_launch(start, side), self.maps
        if start.value == (maps.high if first.tangents[0, -1] > 0 else maps.low):
            yield self._reached(start.value)
            return
        curve: CurveOfHops = self.curve.begun_at(start)
        if first_step >= STEPS_OF_CYCLES.shortest and (known := self.curve.in_all_unknowns(first.own[0])):
            curve, first = known
        last, passed, corner = first.own[0], list[Event](), False
        for item in Run(curve, first, maps.high, behind=maps.low, at=self.values, lengths=first_step):
            if isinstance(item, End):
                yield from passed
                yield self._end(item, last)
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
        curve, period = self.curve, self.curve.period
        if last.impacts != launch.impacts and (jump := self.borders.jump(last, launch)):
            return jump[0], End("jump", jump[1])
        half = period // 2 * (1 - period % 2)
        if (last.alphas[half] - last.alphas[0]) * (launch.alphas[half] - launch.alphas[0]) < 0:
            reason = f"its launches become those of half the period, at another flip of the {name_of_hops(half)}"
            return last, End("flip", reason)
        if (bound := min(max(launch.alpha, curve.between[0]), curve.between[1])) != launch.alpha:
            end = End("left", f"it leaves the launch speeds of the range at {self.maps.in_words('alpha', bound)}")
            share = (bound - last.alpha) / (launch.alpha - last.alpha)
            value = last.value + share * (launch.value - last.value)
            try:
                return curve.near(np.array([bound, value]), last.tangent * self.scale), end
            except NoOrbit:
                return last, end
        if period > 2 and abs(launch.multiplier) > self.options.growth:
            growth = f"{launch.multiplier:.0e}-fold"
            return launch, End("stuck", f"small changes grow {growth} over the hops, and rounding decides")
        return launch, None

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

    def _reached(self, bound: float) -> End:
        return End("reached", f"{self.maps.in_words(self.maps.name, bound)} is reached")

    def _end(self, end: End, last: PeriodicLaunch) -> End:
        """The end of a branch."""
        if end.kind == "reached":
            return self._reached(last.value)
        if end.kind == "stopped":
            return End("stuck", f"it has {STEPS_OF_BRANCHES.most} points")
        return end
