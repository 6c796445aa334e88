"""Enclosures of hops of a linear hopper, and of their derivatives by the launch speed, in closed form.

With the extension r = c cos t + s sin t the gap is, times 1 + M,

    g(t) = c (1 - cos t) + s (t - sin t) - t**2/2.

It does not fall with c, and grows with s. So for all c and s of two intervals the first zero of g lies between that at
both lower bounds and that at both upper ones.
"""

from dataclasses import dataclass
from math import cos, sin

import numpy as np
from flint import arb

from ..exact.refusal import Unproved, check_proof_time

MOST_LANDINGS = 12  # of a hop; those with more stay undecided
# The times between which the first landing is looked for in floats, in units of the machine, and half the width of its
# enclosure.
TIMES_OF_FLIGHT, WITHIN_LANDING = np.linspace(0.0, 40.0, 4001)[1:], arb(2) ** -44
BY_EXTENSION, BY_RATE = 1 - np.cos(TIMES_OF_FLIGHT), TIMES_OF_FLIGHT - np.sin(TIMES_OF_FLIGHT)
BY_GRAVITY = TIMES_OF_FLIGHT**2 / 2
# Halvings to a landing and of the times at which the gap is decided, and the longest and shortest first time.
STEPS_TO_LANDING, HALVINGS_OF_FLIGHT, FIRST_TIMES = 60, 30, (0.25, 1e-6)


def _check_open(c: arb, s: arb, low: arb, high: arb, left: int = HALVINGS_OF_FLIGHT) -> None:
    """Prove that the gap is positive between two times at which it is."""
    t = low.union(high)
    rate = s - t + c * t.sin() - s * t.cos()
    if c * (1 - t.cos()) + s * (t - t.sin()) - t * t / 2 > 0 or rate > 0 or rate < 0:
        return
    m = ((low + high) / 2).mid()
    there = c * (1 - m.cos()) + s * (m - m.sin()) - m * m / 2
    if there + rate * (t - m) > 0:
        return
    if left == 0 or not there > 0:
        raise Unproved("the gap is not proved to be open")
    _check_open(c, s, low, m, left - 1)
    _check_open(c, s, m, high, left - 1)


def _first_landing(c: arb, s: arb, launched: bool, is_open: bool = True) -> tuple[arb, arb]:
    """Times before and after the first zero of the gap, for numbers c and s; of a zero, where it is not to be proved
    that the gap is open until then."""
    start = arb(FIRST_TIMES[0])
    while True:  # until there the first derivative of the gap that is not 0 at the beginning is positive
        t = arb(0).union(start)
        if (s * t.cos() - c * t.sin() if launched else c * t.cos() + s * t.sin() - 1) > 0:
            break
        start = start / 2
        if start < FIRST_TIMES[1]:
            raise Unproved("the gap is not proved to open")
    times, (cf, sf) = TIMES_OF_FLIGHT, (float(c), float(s))
    gaps = cf * BY_EXTENSION + sf * BY_RATE - BY_GRAVITY
    after = max(int(np.argmax((gaps < 0) & (times > float(start)))), 1)
    low, high = float(times[after - 1]), float(times[after])
    for _ in range(STEPS_TO_LANDING):
        middle = 0.5 * (low + high)
        if cf * (1 - cos(middle)) + sf * (middle - sin(middle)) - middle * middle / 2 > 0:
            low = middle
        else:
            high = middle
    t = arb(high)
    for _ in range(3):
        rate = s - t + c * t.sin() - s * t.cos()
        step = (c * (1 - t.cos()) + s * (t - t.sin()) - t * t / 2) / rate
        t = (t - step).mid() if step.is_finite() else t
    before, after_it = ((t + side * WITHIN_LANDING).mid() for side in (-1, 1))
    ends = [c * (1 - x.cos()) + s * (x - x.sin()) - x * x / 2 for x in (start, before, after_it)]
    if not (before > start and ends[0] > 0 and ends[1] > 0 and ends[2] < 0):
        raise Unproved("the landing is not enclosed")
    if is_open:
        _check_open(c, s, start, before)
    return before, after_it


@dataclass(frozen=True)
class LinearHopper:
    """The map of a linear hopper.

    mass_ratio, inject : enclosures of M and of the injection
    """

    mass_ratio: arb
    inject: arb

    @property
    def liftoff(self) -> arb:
        """The extension at the launch."""
        return arb(1)

    def hop(self, x: arb) -> tuple[arb, arb]:
        """Enclosures of the next launch speed, with the injection, and of its derivative, for a ball of launch speeds;
        raises `Unproved`."""
        following, slope = self._hop(x)
        if x.rad() > 0:
            middle = arb(x.mid())
            following = following.intersection(self._hop(middle)[0] + slope * (x - middle))
        return following + self.inject, slope

    def _hop(self, x: arb) -> tuple[arb, arb]:
        both, m = 1 + self.mass_ratio, self.mass_ratio
        c, s, dc, ds, lost, change_of_lost = arb(1), x, arb(0), arb(1), arb(0), arb(0)
        for landing in range(MOST_LANDINGS):
            check_proof_time()
            first, _ = _first_landing(c.lower().mid(), s.lower().mid(), landing == 0)
            _, last = _first_landing(c.upper().mid(), s.upper().mid(), landing == 0, is_open=False)
            t = first.union(last)
            even, odd = t.cos(), t.sin()
            place, change = c * even + s * odd, s * even - c * odd
            speed, force = (s - t - change) / both, (place - 1) / both
            if not speed < 0:
                raise Unproved("the landing is not proved to be transversal")
            gap_moves, speed_moves = ((1 - even) * dc + (t - odd) * ds) / both, (odd * dc + (1 - even) * ds) / both
            lost += m * speed**2
            change_of_lost += m * (speed * speed_moves - force * gap_moves)
            if place < 1:
                square = x * x - lost
                if not square > 0:
                    raise Unproved("the hopper may not lift off again")
                return square.sqrt(), (x - change_of_lost) / square.sqrt()
            if not place > 1:
                raise Unproved("it is not decided whether the hopper bounces")
            later = -gap_moves / speed
            dc, ds = (
                even * dc + odd * ds + change * later,
                even * ds - odd * dc - place * later + speed_moves + force * later,
            )
            c, s = place, change + speed
        raise Unproved("a hop has too many landings")
