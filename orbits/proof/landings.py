"""The losses at landing of launches a little faster than a hop, enclosed over all times at which they may land.

The jerk J of a gap is its third derivative with its sign turned. From a time at which the gap and its first two
derivatives vanish they are, s later, -A s**3/6, -B s**2/2 and -M s: the means A, B, M of J over that time have the
weights 3 (1 - t/s)**2, 2 (1 - t/s) and 1. They change with s at the rates 3 (B - A)/s, 2 (M - B)/s and (J - M)/s.
"""

from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

from flint import arb

from ..balls import between
from ..exact import Unproved
from .launches import LAUNCHES, Flight, Launches

NO_TIME = arb(0)


class MeanJerks(NamedTuple):
    """Enclosures of the means M, B and A of the jerk."""

    flat: arb
    linear: arb
    square: arb


@dataclass(frozen=True)
class JerkIntegrals:
    """Integrals of the jerk over a time, in which it is enclosed part by part.

    time : from the start, 0 for no part yet
    once, twice, thrice : the first, the second and the third integral from the start
    hull : an enclosure of the jerk over all of the time, None for no part yet
    """

    time: arb = NO_TIME
    once: arb = NO_TIME
    twice: arb = NO_TIME
    thrice: arb = NO_TIME
    hull: arb | None = None

    def further(self, jerk: arb, length: arb) -> "tuple[MeanJerks, JerkIntegrals]":
        """The means until any time in a further length, in which the jerk is enclosed, and the integrals to its end."""
        hull = jerk if self.hull is None else self.hull.union(jerk)
        thrice = self.thrice + length * self.twice + length**2 / 2 * self.once + length**3 / 6 * jerk
        twice = self.twice + length * self.once + length**2 / 2 * jerk
        further = JerkIntegrals(self.time + length, self.once + length * jerk, twice, thrice, hull)
        return self._means(hull, jerk, length), further

    def _means(self, hull: arb, jerk: arb, length: arb) -> MeanJerks:
        flat = linear = square = hull
        if self.time > 0:
            t, moved = self.time, between(arb(0), length)
            s = t + moved
            for _ in range(LAUNCHES.passes):
                flat = flat.intersection(self.once / t + moved / s * (jerk - flat))
                linear = linear.intersection(2 * self.twice / t**2 + 2 * moved / s * (flat - linear))
                square = square.intersection(6 * self.thrice / t**3 + 3 * moved / s * (linear - square))
        return MeanJerks(flat, linear, square)


def losses_at_landing(launches: Launches, flight: Flight, reach: arb) -> tuple[arb, arb]:
    """Enclosures of c, where a launch that is faster by d <= reach loses a speed c d**(4/3), and of the place of the
    contact's coordinate at landing; raises `Unproved`.

    It is proved too that the next launch is faster than the hop, and that the coordinate at landing is below the place
    of that launch and falls.
    """
    near = flight.landing(-flight.window, arb(0), LAUNCHES.parts)
    if not (near.jerk > 0 and near.gap_by_speed > 0):
        raise Unproved("before the landing of the hop the gap is not proved to exceed the hop's")
    power, cell, jerks, end = launches.power(), flight.window / LAUNCHES.cells, JerkIntegrals(), arb(0)
    found = list[tuple[arb, arb, arb]]()  # c, place and rate
    for _ in range(LAUNCHES.cells):
        begin, end = end, end + cell
        here = flight.landing(begin, end)
        if not (here.jerk > 0 and here.gap_by_speed > 0 and here.mass > 0 and power > 0):
            raise Unproved("the signs of the jerk and of the derivatives by the speed are not decided")
        (means, jerks), times = jerks.further(here.jerk, cell), between(begin, end)
        # d is this times the cube of the time, and the speed of the landing `pace` times its square.
        share = means.square / (6 * here.gap_by_speed)
        pace = means.linear / 2 - times * share * here.gap_rate_by_speed
        if not pace > 0:
            raise Unproved("the landing is not proved to take energy")
        loss = here.mass * pace**2 / (2 * power * share.root(3) ** 4)
        if not loss * (share.root(3) * times).min(reach.root(3)) < 1:
            raise Unproved("the next launch is not proved to be faster than the hop")
        found.append((loss, here.place, here.rate))
        losses, places, rate = (reduce(arb.union, each) for each in zip(*found, strict=True))
        aside = here.place_by_speed - launches.place_by_speed * between(arb(0), arb(1))
        if not (here.rate_after < 0 and rate + share * times**2 * aside < 0):
            raise Unproved("the contact is not proved to go on below the place of the next launch")
        if reach * here.gap_by_speed < jerks.thrice:  # all launches have landed
            return losses, places
    raise Unproved("not all launches are proved to land by the end of the window")
