"""What happens to a branch of periodic launches at borders of the map.

The map is smooth only in pieces. Where the number of impacts changes, the map may jump, which ends a branch. Where only
its slope jumps, the curve has a corner, and is found again at a launch speed beyond the border. Where the slope is the
same on both sides, the curve continues and the border is an event.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..curves import Event
from ..errors import NoOrbit
from ..numerics import solve
from .hop_borders import COLLISIONS, kind_of_border
from .launch_curve import LAUNCH_CURVE, LaunchCurve, place_in_words
from .map_pieces import CONTINUOUS, MapBorder
from .periodic_launch import MULTIPLIER_AT, PeriodicLaunch


class BorderSearch(NamedTuple):
    """The search for events and corners at borders of the map; lengths are shares of the ranges.

    halvings : of a step in which the number of impacts changes and the map may jump
    secants, located : steps of the secant method to the value at which a launch is at a border, and the length of a
        step after which it is there
    beyond : a border is that between two points up to this many times their distance from them
    apart : difference of two values of the parameter for the secant method, where those of the points are the same
    same_sides : the multipliers on both sides of a border agree up to this share
    corner : the curve behind a corner is at most this multiple of the distance of its points away
    """

    halvings: int = 12
    secants: int = 30
    located: float = 1e-14
    beyond: float = 2.0
    apart: float = 1e-6
    same_sides: float = 1e-6
    corner: float = 1e3


BORDER_SEARCH = BorderSearch()


class BordersOfCurve:
    """The borders of the map along a curve of periodic launches; `PeriodicLaunch`es are points of it."""

    def __init__(self, curve: LaunchCurve, options: BorderSearch = BORDER_SEARCH):
        self.curve, self.maps, self.scale, self.options = curve, curve.maps, curve.scale, options

    def in_order(self, before: PeriodicLaunch, behind: PeriodicLaunch, found: list[Event]) -> Iterator[Event]:
        """The events between two neighbouring points in order: the found ones, and those at which a launch passes a
        border, in place of the same found less exactly."""
        borders = [] if before.impacts == behind.impacts else self._passed(before, behind)
        if borders:
            found = [*(event for event in found if event.kind not in COLLISIONS), *borders]
        chord = behind.place - before.place
        yield from sorted(found, key=lambda event: float((event.point.place - before.place) @ chord))

    def _passed(self, before: PeriodicLaunch, behind: PeriodicLaunch) -> list[Event]:
        """The events between two neighbouring points at which one of their launches is at a border of the map."""
        found = list[Event]()
        for hop, counts in enumerate(zip(before.impacts, behind.impacts, strict=True)):
            if counts[0] != counts[1] and (event := self._at_border(before, behind, hop)):
                found.append(event)
        return found

    def _at_border(self, before: PeriodicLaunch, behind: PeriodicLaunch, hop: int) -> Event | None:
        """The event at which a launch is at a border: the parameter for which the border's own launch comes back, by
        the secant method. None where it is not found between the points."""
        ends, values = (before.alphas[hop], behind.alphas[hop]), [before.value, behind.value]
        if values[0] == values[1]:
            values[1] += self.options.apart * self.curve.span
        try:
            excesses = [self._of_border(ends, value)[0] for value in values]
            for _ in range(self.options.secants):
                if excesses[1] == excesses[0] or abs(values[1] - values[0]) <= self.options.located * self.curve.span:
                    break
                step = excesses[1] * (values[1] - values[0]) / (excesses[1] - excesses[0])
                values = [values[1], float(self.curve.possible(values[1] - step))]
                excesses = [excesses[1], self._of_border(ends, values[1])[0]]
            _, border, launches, impacts, sides = self._of_border(ends, values[1])
        except NoOrbit:
            return None
        reach = self.options.beyond * max(abs(before.value - behind.value), LAUNCH_CURVE.around * self.curve.span)
        if min(abs(values[1] - before.value), abs(values[1] - behind.value)) > reach:
            return None
        alphas = (*launches[-hop:], *launches[:-hop]) if hop else launches
        counts = (*impacts[-hop:], *impacts[:-hop]) if hop else impacts
        place = np.array([alphas[0], values[1]]) / self.scale
        multiplier = (
            sides[0] if abs(sides[1] - sides[0]) <= self.options.same_sides * (1 + abs(sides[0])) else float("nan")
        )
        about = counts, place, behind.tangent, border.kind, sides
        return Event(kind_of_border(sides), point=PeriodicLaunch(values[1], alphas, multiplier, *about))

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

    def _middle(self, before: PeriodicLaunch, behind: PeriodicLaunch) -> PeriodicLaunch:
        """The point of the curve half-way between two; raises `NoOrbit`."""
        chord, middle = behind.place - before.place, 0.5 * (before.place + behind.place)
        found = self.curve.near(middle * self.scale, chord * self.scale, chord / self.scale)
        if np.linalg.norm(found.place - middle) > np.linalg.norm(chord):
            raise NoOrbit("the curve is elsewhere")
        return found

    def jump(self, before: PeriodicLaunch, behind: PeriodicLaunch) -> tuple[PeriodicLaunch, str] | None:
        """The last launch of a branch before a jump of the map, and that end in words, from two launches on different
        curves; None without one."""
        size, impacts = distance(before, behind), before.impacts
        if impacts == behind.impacts or (self.maps.pieces is not None and not self._jumps(before, behind)):
            return None
        pairs, reach = zip(before.alphas, behind.alphas, strict=True), size * float(self.scale[0])
        spans = [(min(pair) - reach, max(pair) + reach) for pair in pairs]
        spans = [(max(low, 1e-3 * high), high) for low, high in spans]
        values = [float(self.curve.possible(point.value)) for point in (before, behind)]
        if not any(self.maps.jumps_between(span, value) for span in spans for value in values):
            return None
        for _ in range(self.options.halvings):
            try:
                middle = self._middle(before, behind)
            except NoOrbit:
                break
            before, behind = (middle, behind) if middle.impacts == impacts else (before, middle)
        else:
            if distance(before, behind) <= 4 * size / 2**self.options.halvings:
                return None
        place, counts = place_in_words(self.maps, before), (" and ".join(map(str, x.impacts)) for x in (before, behind))
        return before, f"the map jumps near {place}: from {next(counts)} impacts in a hop to {next(counts)}"

    def _jumps(self, before: PeriodicLaunch, behind: PeriodicLaunch) -> bool:
        """Whether a border where the map is not continuous lies between the launches of two points."""
        assert self.maps.pieces is not None
        spans = [sorted(pair) for pair in zip(before.alphas, behind.alphas, strict=True)]
        jumps = [border.alpha for border in self.maps.pieces.borders if border.kind not in CONTINUOUS]
        return any(low <= alpha <= high for low, high in spans for alpha in jumps)

    def corner(self, a: PeriodicLaunch, b: PeriodicLaunch) -> list[Event]:
        """The event at a corner of the curve between two launches, where its tangents meet, if its multiplier passes 1
        or -1 there."""
        sides = a.multiplier, b.multiplier
        if not any((sides[0] - level) * (sides[1] - level) < 0 for level in MULTIPLIER_AT.values()):
            return []
        share, _ = solve(np.column_stack([a.tangent, -b.tangent]), b.place - a.place)
        if abs(share) <= 2.0 * LAUNCH_CURVE.around:  # else the tangents turn near the corner
            place = a.place + share * a.tangent
            alpha, value = (place * self.scale).tolist()
            a = replace(a, value=value, alphas=(alpha, *a.alphas[1:]), place=place)
        return [Event(kind_of_border(sides), point=replace(a, multiplier=float("nan"), sides=sides))]

    def behind(self, before: PeriodicLaunch, last: PeriodicLaunch) -> PeriodicLaunch | None:
        """The curve behind a border or a corner of the map at the last launch, which it comes to from another one, at a
        launch speed on the other side; None where there is none, or the map jumps there. Behind a graze it bends away
        at once."""
        reach, value = 10.0 * LAUNCH_CURVE.around * float(self.scale[0]), float(self.curve.possible(last.value))
        borders = self.maps.pieces_at(value, last.alpha - reach, last.alpha + reach).borders
        near = [each for each in borders if abs(each.alpha - last.alpha) <= reach]
        continuous = [each.alpha for each in near if each.kind in CONTINUOUS]
        if near and not continuous:
            return None
        at = min(continuous, key=lambda each: abs(each - last.alpha), default=last.alpha)
        side = np.sign(at - before.alpha) if continuous else np.sign(last.tangent[0])
        ahead = np.array([side * reach, 0.0])
        try:
            found = self.curve.near(np.array([at, last.value]) + ahead, ahead)
        except NoOrbit:
            return None
        corner = not near and distance(found, last) > self.options.corner * LAUNCH_CURVE.around
        return None if corner else found


def distance(a: PeriodicLaunch, b: PeriodicLaunch) -> float:
    """The distance of two launches in shares of the ranges."""
    return float(np.linalg.norm(a.place - b.place))
