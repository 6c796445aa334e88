"""Enclosures of hops of a hopper whose spring is a polynomial phi, and of their derivatives by the launch speed.

phi has an odd degree and rises at last. It is 1 at one extension only, rho, and -1/M at one only, and rises there. So
the contact pushes exactly below rho. In contact the body at y with the speed w has the energy (1 + M) w**2/2 + M V(y) +
y with V' = phi, of which M V + y falls up to the extension with phi = -1/M, and rises above it without bounds, as it
does on the other side. So a body that lands below rho with an energy above that of rest at rho comes there, at the
latest after it has turned once, and the energy tells the speed w of the next launch.

A hop is a function of the launch speed x. Its values are enclosed at the middle of a ball, and its derivatives over all
of the ball; between them stands the mean value theorem. So the flights after bounces, from an extension c and a rate s
that depend on x. For all x of the ball the gap is positive up to a time, negative at a later one, and falls between the
two: there lies its first zero, the landing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from math import floor, lcm
from typing import Any

from flint import arb, arb_poly, fmpz_poly

from ..balls.programs import ball_of_fraction
from ..errors import InputError
from ..exact.refusal import Unproved, check_proof_time
from .linear_hopper import FIRST_TIMES
from .polynomial_flight import EnclosedFlight, FlightAt, flight_of

# Launches of intervals of twice this length are enclosed together, with so many derivatives by the launch speed.
LENGTH_OF_LAUNCHES, DERIVATIVES = 2.0**-7, 8
MOST_ENCLOSED_LANDINGS = 4  # of a hop; those with more stay undecided
# Half the width of a landing's enclosure, and the factors that widen it where that is not enough.
HALF_OF_LANDING, WIDER_LANDINGS = arb(2) ** -60, (1.1, 1.5, 2.5)
HALVINGS_OF_STEP = 24
ONE_ROOT = (
    "that no hops are missing is proved of springs whose force is a polynomial of an odd degree that is {at} at one "
    "extension only, where it rises, and rises at last"
)


@dataclass(frozen=True)
class _Ball:
    """A function of the launch speed: at the middle, over all of the ball, and its derivative over all of it."""

    middle: arb
    all: arb
    slope: arb

    @classmethod
    def of(cls, middle: arb, every: arb, slope: arb, deviation: arb) -> "_Ball":
        by_slope = middle + slope * deviation
        return cls(middle, every.intersection(by_slope) if every.overlaps(by_slope) else by_slope, slope)


@dataclass(frozen=True)
class PolynomialHopper:
    """The map of launch speeds of the dimensionless hopper.

    law : the coefficients of phi
    mass_ratio, inject : M, and an enclosure of the injection
    liftoff : an enclosure of rho
    """

    law: tuple[arb, ...]
    mass_ratio: arb
    inject: arb
    liftoff: arb
    _flights: dict[int, EnclosedFlight] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def of(cls, law: Sequence[Fraction], mass_ratio: Fraction, inject: Fraction) -> "PolynomialHopper":
        """Raises `InputError` for other polynomials."""
        liftoff = _one_root([law[0] - 1, *law[1:]], "1")
        _one_root([law[0] + 1 / mass_ratio, *law[1:]], "-1/M")
        ratio, injected = map(ball_of_fraction, (mass_ratio, inject))
        return cls(tuple(map(ball_of_fraction, law)), ratio, injected, liftoff)

    def hop(self, x: arb) -> tuple[arb, arb]:
        """Enclosures of the next launch speed, with the injection, and of its derivative, for a ball of launch speeds;
        raises `Unproved`."""
        middle, m, both, flight = arb(x.mid()), self.mass_ratio, 1 + self.mass_ratio, self._launch(x)
        force, deviation = arb_poly([*self.law]), x - middle
        lost, lost_at_middle, change_of_lost = arb(0), arb(0), arb(0)
        for landing in range(MOST_ENCLOSED_LANDINGS):
            check_proof_time()
            at_middle, over_all = _landing(flight, x, force, landing == 0)
            speed, push = over_all.opening / both, (force(over_all.r) - 1) / both
            if not speed < 0:
                raise Unproved("the landing is not proved to be transversal")
            lost_at_middle += m * (at_middle.opening / both) * (at_middle.opening / both)
            lost += m * speed * speed
            change_of_lost += m * (speed * over_all.opening_moves - push * over_all.gap_moves) / both
            later = -over_all.gap_moves / over_all.opening
            c = _Ball.of(at_middle.r, over_all.r, over_all.r_moves + over_all.rate * later, deviation)
            if c.all < self.liftoff:
                square = _Ball.of(middle * middle - lost_at_middle, x * x - lost, 2 * (x - change_of_lost), deviation)
                if not square.all > 0:
                    raise Unproved("the hopper may not lift off again")
                slope = (x - change_of_lost) / square.all.sqrt()
                following = _Ball.of(square.middle.sqrt(), square.all.sqrt(), slope, deviation)
                return following.all + self.inject, slope
            if not c.all > self.liftoff:
                raise Unproved("it is not decided whether the hopper bounces")
            moves = over_all.rate_moves - force(over_all.r) * later + over_all.opening_moves / both + push * later
            s = _Ball.of(at_middle.rate + at_middle.opening / both, over_all.rate + speed, moves, deviation)
            flight = flight_of(self.law, middle, deviation, (c.middle, c.slope), (s.middle, s.slope))
        raise Unproved("a hop has too many landings")

    def _launch(self, x: arb) -> EnclosedFlight:
        """The flights from launches, of a piece that holds all launch speeds of a ball."""
        place = floor(float(x.lower()) / LENGTH_OF_LAUNCHES)
        for k in (place, place - 1):
            middle, reach = arb((k + 1) * LENGTH_OF_LAUNCHES), arb(0, LENGTH_OF_LAUNCHES)
            if k >= 0 and (middle + reach).contains(x):
                break
        else:
            raise Unproved("the interval of launch speeds is too long")
        if k not in self._flights:
            rest = [arb(0)] * (DERIVATIVES - 1)
            launch = [self.liftoff, arb(0), *rest], [middle, arb(1), *rest]
            self._flights[k] = flight_of(self.law, middle, reach, *launch)
        return self._flights[k]


def _one_root(polynomial: Sequence[Fraction], at: str) -> arb:
    """An enclosure of the one real root of a polynomial; raises `InputError` where there is not just one, simple, at
    which it rises."""
    whole = lcm(*(each.denominator for each in polynomial))
    pairs: list[Any] = fmpz_poly([int(each * whole) for each in polynomial]).complex_roots()  # with multiplicities
    roots = [root.real for root, _ in pairs if root.imag.contains(0)]
    slope = arb_poly([*map(ball_of_fraction, polynomial)]).derivative()
    if len(roots) != 1 or not slope(roots[0]) > 0 or len(polynomial) % 2 or not polynomial[-1] > 0:
        raise InputError(ONE_ROOT.format(at=at))
    return roots[0]


def _landing(flight: EnclosedFlight, x: arb, force: arb_poly, launched: bool) -> tuple[FlightAt, FlightAt]:
    """What is enclosed at the first landing, from the middle of a ball of launch speeds and from all of it."""
    middle, start = arb(x.mid()), arb(FIRST_TIMES[0])
    while True:  # until there the first derivative of the gap that is not 0 at the beginning is positive
        at = flight.at(arb(0).union(start), x)
        if (force.derivative()(at.r) * at.rate if launched else force(at.r) - 1) > 0:
            break
        start = start / 2
        if start < FIRST_TIMES[1]:
            raise Unproved("the gap is not proved to open")
    t = arb(flight.guessed_landing(middle, float(start)))
    for _ in range(3):
        at = flight.at(t, middle)
        moved = t - at.gap / at.opening
        t = moved.mid() if moved.is_finite() else t
    at = flight.at(t, middle)
    width = HALF_OF_LANDING + 2 * arb((at.gap / at.opening).rad())
    between, at = _zero_between(flight, middle, t, width), flight.at(t, x)
    later = abs(at.gap_moves / at.opening).upper() * x.rad()
    for wider in WIDER_LANDINGS:
        try:
            wide = _zero_between(flight, x, t, width + later * wider) if x.rad() > 0 else between
            break
        except Unproved:
            if wider == WIDER_LANDINGS[-1]:
                raise
    _check_steps_open(flight, x, start, arb(wide.lower().mid()))
    return flight.at(between, middle), flight.at(wide, x)


def _gap_at(flight: EnclosedFlight, x: arb, t: arb) -> arb:
    """The gap at a time for all launch speeds of a ball, by the mean value theorem."""
    middle = arb(x.mid())
    return flight.at(t, middle).gap + flight.at(t, x).gap_moves * (x - middle)


def _zero_between(flight: EnclosedFlight, x: arb, t: arb, width: arb) -> arb:
    """The times of this width about another one, with the gap positive before and negative after, where it falls, for
    all launch speeds of a ball."""
    before, after = arb((t - width).mid()), arb((t + width).mid())
    between = before.union(after)
    if not (_gap_at(flight, x, before) > 0 and _gap_at(flight, x, after) < 0 and flight.at(between, x).opening < 0):
        raise Unproved("the landing is not enclosed")
    return between


def _check_steps_open(flight: EnclosedFlight, x: arb, start: arb, before: arb) -> None:
    """Prove that the gap is positive between two times at which it is, for all launch speeds of a ball."""
    for step, known in zip(flight.steps, flight.open_steps, strict=True):
        low, high = arb(step.start), arb(step.start + step.length)
        if not known and high > start and low < before:
            low, high = (low if low > start else start), (high if high < before else before)
            _check_open_between(flight, x, low, high, HALVINGS_OF_STEP)


def _check_open_between(flight: EnclosedFlight, x: arb, low: arb, high: arb, left: int) -> None:
    at = flight.at(low.union(high), x)
    if at.gap > 0:
        return
    falls = at.opening < 0 or at.opening > 0
    if falls and _gap_at(flight, x, low) > 0 and _gap_at(flight, x, high) > 0:
        return
    middle = ((low + high) / 2).mid()
    if left == 0 or not _gap_at(flight, x, middle) > 0:
        raise Unproved("the gap is not proved to be open")
    _check_open_between(flight, x, low, middle, left - 1)
    _check_open_between(flight, x, middle, high, left - 1)
