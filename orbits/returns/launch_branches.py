"""Branches of periodic launches that are speeds, whose hops have no statement, and the tracer of each kind of hops.

They are followed as a `LaunchCurve`, behind corners of the map as `BordersOfCurve` finds them there.
"""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ..curves import End, Event, Points, Run, Start
from ..errors import NoOrbit
from .border_events import BordersOfCurve, distance
from .hop_borders import COLLISION
from .hop_tracer import LOST, FlownTracer, HopTracer, Tracer
from .launch_curve import LAUNCH_CURVE, STEPS_OF_BRANCHES, LaunchCurve
from .launch_cycles import MapsAlong
from .periodic_launch import MULTIPLIER_AT, PeriodicLaunch


class BranchCurve(LaunchCurve):
    """The launches of a branch, which continues behind corners of the map."""

    @cached_property
    def borders(self) -> BordersOfCurve:
        """What happens at the borders of the map."""
        return BordersOfCurve(self)

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> Start | End:
        """Behind the corner at the last point, where there is one."""
        own = [(launch, length) for each in passed for launch, length in zip(each.own, each.lengths, strict=True)]
        last, i = own[-1][0], len(own) - 1
        # A curve that goes on has a length of 0.
        while i and own[i][1] and distance(own[i][0], last) < LAUNCH_CURVE.around:
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

    def start(self, launches: np.ndarray, value: float) -> PeriodicLaunch:
        """The point of a periodic launch found at a value of the parameter."""
        return self.curve.at(np.array([launches[0][0], value]), np.array([0.0, 1.0]))

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


def tracer_of(maps: MapsAlong, between: tuple[float, float], period: int, values: tuple[float, ...]) -> Any:
    """The tracer of branches of a period."""
    kind = HopTracer if maps.along else BranchTracer if maps.one_speed else FlownTracer
    return kind(maps, between, period, values)
