"""Enclosures of the flights of a hopper whose spring is a polynomial, for all launch speeds of an interval together.

With the body's mass (1 + M)/M, the foot's 1 + M and the gravity 1/(1 + M), the extension r of a flight and its gap g
times 1 + M obey r'' = -phi(r) and g'' = phi(r) - 1 whatever M is. So r + g = c + s t - t**2/2, from an extension c with
the rate s, and g begins with g = g' = 0.

All are functions of the time and of a launch speed x = m + d. Their Taylor polynomials in d have K coefficients that
are numbers for each time, the derivatives at m over factorials, and a last one, the K-th derivative over K! somewhere
in the interval (Lagrange). So errors grow with the K-th power of the interval's length, and only the last coefficient
widens much from step to step. Each step is a Taylor polynomial in the time; its last coefficient is that over a box
which holds the motion by Picard's inclusion X + [0, h] f(B) in B.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import TypeAlias

import numpy as np
from flint import arb, arb_poly

from ..exact.refusal import Unproved, check_proof_time

# The order of the polynomials in time, the first, the shortest and the longest step, and when a flight ends at last.
TIME_ORDER, FIRST_TIME_STEP, SHORTEST_TIME_STEP, LONGEST_TIME_STEP, LATEST_LANDING = 22, 1 / 8, 2.0**-12, 1 / 4, 64.0
LAST_TERM = 2.0**-66  # the last term of a step is smaller, or the step is halved
TIMES_OF_INCLUSION, WIDENED_BOX = 10, arb(0, 0.1)  # how often a box is widened, and by which share
PARTS_OF_STEP = 4  # at the ends of which floats look for a landing
Jets: TypeAlias = arb_poly  # in the deviation of the launch speed


@dataclass(frozen=True)
class FlightAt:
    """Enclosures at a time, or at all of an interval: the extension, the gap and their rates, and the derivatives of
    these by the launch speed."""

    r: arb
    rate: arb
    gap: arb
    opening: arb
    r_moves: arb
    rate_moves: arb
    gap_moves: arb
    opening_moves: arb


@dataclass(frozen=True)
class FlightStep:
    """A step: its first time and its length, and for each coefficient in the deviation of the launch speed the
    polynomials in time of the extension and of the gap."""

    start: float
    length: float
    extensions: tuple[arb_poly, ...]
    gaps: tuple[arb_poly, ...]

    @cached_property
    def rates(self) -> tuple[tuple[arb_poly, ...], tuple[arb_poly, ...]]:
        """The same of the rates; as a last coefficient is one over all of the step, so is that of its derivative."""
        return tuple(each.derivative() for each in self.extensions), tuple(each.derivative() for each in self.gaps)

    @cached_property
    def middles(self) -> np.ndarray:
        """The gap's polynomials in floats (times, deviations), without the last one in the deviation."""
        return np.array([[float(each[n].mid()) for each in self.gaps[:-1]] for n in range(TIME_ORDER + 1)])

    def at(self, t: arb, deviation: arb) -> FlightAt:
        """What is enclosed at times of the step, from its start on."""
        values, moves = list[arb](), list[arb]()
        for polynomials in (self.extensions, self.rates[0], self.gaps, self.rates[1]):
            value, slope = arb(0), arb(0)
            for j in range(len(polynomials) - 1, -1, -1):
                each = polynomials[j](t)
                value = value * deviation + each
                if j:
                    slope = slope * deviation + j * each
            values.append(value)
            moves.append(slope)
        return FlightAt(*values, *moves)


@dataclass(frozen=True)
class EnclosedFlight:
    """A flight, up to a time at which all gaps are closed, or the latest one.

    middle : m
    reach : the interval of the deviations
    """

    middle: arb
    reach: arb
    steps: tuple[FlightStep, ...]

    @cached_property
    def _ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Times, and the gap's coefficients (times, deviations) then, in floats."""
        shares = np.arange(1, PARTS_OF_STEP + 1) / PARTS_OF_STEP
        times = np.concatenate([each.start + each.length * shares for each in self.steps])
        rows = [np.vander(each.length * shares, TIME_ORDER + 1, increasing=True) @ each.middles for each in self.steps]
        return times, np.concatenate(rows)

    @cached_property
    def open_steps(self) -> list[bool]:
        """Whether the gap is proved to be positive throughout each step for all launch speeds."""
        return [step.at(arb(0).union(arb(step.length)), self.reach).gap > 0 for step in self.steps]

    def at(self, t: arb, x: arb) -> FlightAt:
        """What is enclosed at a time, or at all of an interval, for launch speeds of the flight."""
        found = list[FlightAt]()
        for step in self.steps:
            low, high = arb(step.start), arb(step.start + step.length)
            if not (t < low or t > high):
                found.append(step.at((t.intersection(low.union(high)) - low), x - self.middle))
        if not found or t < 0 or not t <= high:
            raise Unproved("the flight is not enclosed for so long")
        first, *more = found
        for each in more:
            first = FlightAt(*(a.union(b) for a, b in zip(vars(first).values(), vars(each).values(), strict=True)))
        return first

    def guessed_landing(self, x: arb, after: float) -> float:
        """About the first time after another one at which the gap closes, in floats."""
        times, coefficients = self._ends
        powers = float((x - self.middle).mid()) ** np.arange(coefficients.shape[1])
        below = np.flatnonzero((coefficients @ powers < 0) & (times > after))
        if not len(below):
            raise Unproved("no landing is found")
        step = self.steps[int(below[0]) // PARTS_OF_STEP]
        row = (step.middles @ powers)[::-1]
        high = times[below[0]] - step.start
        low = max(high - step.length / PARTS_OF_STEP, after - step.start)
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.polyval(row, middle) > 0 else (low, middle)
        return step.start + high


def flight_of(law: Sequence[arb], middle: arb, reach: arb, c: Sequence[arb], s: Sequence[arb]) -> EnclosedFlight:
    """The flight under a force with these coefficients, from an extension c and its rate s: their coefficients in the
    deviation of the launch speed from `middle` that are numbers, and the last one, for deviations within `reach`.

    Raises `Unproved` where it is not enclosed."""
    size, t, length, steps = len(c), 0.0, FIRST_TIME_STEP, list[FlightStep]()
    r, rate, gap, opening = [*c], [*s], [arb(0)] * size, [arb(0)] * size
    while t < LATEST_LANDING:
        check_proof_time()
        wide = _over_all(r, reach), _over_all(rate, reach)
        while (last := _last_coefficients(law, wide, length, size)) is None:
            length /= 2
            if length < SHORTEST_TIME_STEP:
                raise Unproved("the flight is not enclosed")
        over_all = _coefficients(law, *wide, TIME_ORDER - 1, size)
        at_middle = _coefficients(law, Jets(r[:-1]), Jets(rate[:-1]), TIME_ORDER - 1, size - 1)
        rows = [[each[j] for each in at_middle] + [last[j]] for j in range(size - 1)]
        rows.append([each[size - 1] for each in over_all] + [last[size - 1]])
        extensions, gaps = [arb_poly(row) for row in rows], list[arb_poly]()
        for j, row in enumerate(rows):
            falls = arb(-0.5) if j == 0 else arb(0)
            gaps.append(arb_poly([gap[j], opening[j], falls - row[2], *(-each for each in row[3:])]))
        steps.append(FlightStep(t, length, tuple(extensions), tuple(gaps)))
        end = arb(length)
        r, gap = [each(end) for each in extensions], [each(end) for each in gaps]
        rate, opening = ([each(end) for each in own] for own in steps[-1].rates)
        t += length
        if _over_all(gap, reach)[0] < 0:
            break
        length = min(2 * length, LONGEST_TIME_STEP) if len(steps) % 4 == 0 else length
    return EnclosedFlight(middle, reach, tuple(steps))


def _over_all(jets: Sequence[arb], reach: arb) -> Jets:
    """The coefficients of functions of the deviation about each place of `reach`, the last of them over all of it."""
    count, powers = len(jets), [arb(1)]
    for _ in jets:
        powers.append(powers[-1] * reach)
    return Jets([sum((comb(i, j) * jets[i] * powers[i - j] for i in range(j, count)), arb(0)) for j in range(count)])


def _coefficients(law: Sequence[arb], r: Jets, rate: Jets, order: int, size: int) -> list[Jets]:
    """The Taylor coefficients in time up to an order of the solution of r'' = -phi(r), each with its coefficients in
    the deviation."""
    found, powers = [r, rate], [list[Jets]() for _ in law]
    powers[1] = found
    for n in range(order - 1):
        force = law[1] * found[n] + (law[0] if n == 0 else 0)
        for k in range(2, len(law)):
            lower = powers[k - 1]
            powers[k].append(sum((found[i] * lower[n - i] for i in range(n + 1)), Jets()).truncate(size))
            force = force + law[k] * powers[k][n]
        found.append(force * (arb(-1) / ((n + 1) * (n + 2))))
    return found[: order + 1]


def _last_coefficients(law: Sequence[arb], start: tuple[Jets, Jets], length: float, size: int) -> Jets | None:
    """The last Taylor coefficients in time over a step; None where they are not small, or no box holds the motion."""
    if (box := _inclusion(law, start, length, size)) is None:
        return None
    last = _coefficients(law, *box, TIME_ORDER, size)[TIME_ORDER]
    return last if abs(last[0]) * arb(length**TIME_ORDER) < LAST_TERM or length == SHORTEST_TIME_STEP else None


def _inclusion(law: Sequence[arb], start: tuple[Jets, Jets], length: float, size: int) -> tuple[Jets, Jets] | None:
    """Boxes that hold the coefficients of the extension and of its rate over a step; None where none are found."""
    times, (r, rate) = arb(0).union(arb(length)), start
    for _ in range(TIMES_OF_INCLUSION):
        force = Jets()
        for each in reversed(law):
            force = (force * r).truncate(size) + each
        new = start[0] + times * rate, start[1] - times * force
        if all(old[j].contains(own[j]) for old, own in zip((r, rate), new, strict=True) for j in range(size)):
            return new
        r, rate = (_widened(each, size) for each in new)
    return None


def _widened(jets: Jets, size: int) -> Jets:
    tiny = arb(0, 2.0**-70)
    return Jets([x + WIDENED_BOX * (x - x.mid()) + tiny * (abs(x) + 1) for x in (jets[j] for j in range(size))])
