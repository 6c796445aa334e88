"""All launches of a hopper from which hops of a period come back, between two launch speeds, proved.

The body has the mass (1 + M)/M and the foot 1 + M, the spring between them has the force phi(r), a polynomial, and the
acceleration of gravity is 1/(1 + M). A flight begins at an extension c, with the foot at rest and the rate s of the
body: at a launch phi(c) = 1 and s = alpha, after a bounce phi(c) > 1. The extension obeys r'' = -phi(r), and the gap
is, times 1 + M,

    g(t) = c + s t - t**2/2 - r(t).

Where g is positive before a zero, and its rate there negative, that is the landing, and moves analytically. There the
foot loses its speed v. For phi(r) > 1 the contact would have to pull: the next flight begins, with the rate r' + v. For
phi(r) < 1 the contact pushes until phi(r) = 1, and as only landings lose energy, the next launch speed w without
injection and its derivative are

    w**2 = alpha**2 - M (v_1**2 + ... + v_k**2),    w w' = alpha - M (v_1 v_1' + ... + v_k v_k')

if the first of these is positive. In v v' the derivative of the landing's time, which has the factor 1/v, cancels. All
of this is enclosed in closed form for phi(r) = r, in `linear_hopper`, else by Taylor polynomials in the time and in the
launch speed, in `polynomial_hopper`.

Theorem. Let the n-th iterate F of w + inject be enclosed on an interval X of launch speeds, in this way with every hop
smooth, and F' there. If F(X) and X have no common point, or one of the n launches of X cannot lie in the range, no
launch in X comes back after n hops in the range. If F' - 1 has no zero, at most one does, which lies in
N = m - (F(m) - m)/(F'(X) - 1) for any m in X; if N lies inside X, exactly one does.

Proof. F is differentiable on X, as each hop is on an interval that holds the images of X. By the mean value theorem
F(x) - x has one zero at most where its derivative has none, and a zero x is m - (F(m) - m)/(F'(xi) - 1) for some xi in
X. If N lies inside X, then F(x) - x has different signs at the ends of X. This is Newton's method on intervals (R. E.
Moore, Interval Analysis, Prentice-Hall 1966).

Intervals that are halved until they are short, as beside lossless launches, grazes and changes of the number of
bounces, and what leads there, stay undecided: a launch that comes back may lie in them.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from itertools import pairwise
from typing import Protocol

import numpy as np
from flint import arb, ctx

from ..balls.programs import ball_of_fraction
from ..balls.root import FIRST_BITS
from ..errors import InputError
from ..exact.bounds import Enclosure
from ..exact.decimals import decimal_text
from ..exact.exact_mechanics import ExactMechanics, Scale
from ..exact.expressions import (
    ZERO,
    ExactExpression,
    derivative_by,
    exact_number,
    substitute,
    symbols,
    total,
    vanishes,
)
from ..exact.outward_decimals import bounds_of_fractions, enclosure_of, upper_fraction
from ..exact.refusal import Unproved
from ..exact.stated import StatedMachine, stated_machine
from ..model.machine import Machine, machine_in_words
from ..proof.theorem import Proof
from ..running import interrupts
from .fixed_point_statement import landed_in_contact
from .linear_hopper import LinearHopper
from .periodic_hops import PeriodicHops
from .polynomial_hopper import PolynomialHopper
from .proved_map import FOUND_TO, MAP_IN_WORDS

ONLY_POLYNOMIAL = (
    "that no hops are missing is proved of the dimensionless two-mass hopper whose spring is a polynomial in r, as "
    "'r + 0.3*r**3', under constant gravity and without a rest length, alone: `prove_fixed_point` proves the hops of "
    "other machines one by one"
)
LARGEST_DEGREE, WITHIN_LIFTOFF = 9, 2.0**-60  # of a polynomial; half the width of the stated extension at the launch
# Parts of the range, which are halved until they are decided: at no round share, as a launch that comes back is not
# found where it lies on the edge.
FIRST_PARTS, FIRST_HALF = 41, 0.4881
SHRINKS = 0.7  # an interval that Newton's method leaves longer than this share is halved
LAUNCH_REFINEMENTS, SHORTEST_OF_KNOWN = 4, 1e-9  # intervals with a launch that was found are halved to that length
LARGEST_SHARE_LEFT = 0.01  # the share of the range beyond which nothing is proved


@dataclass(frozen=True)
class LaunchesBack:
    """The launches from which hops come back after a number of them.

    found : enclosures of one each
    alone : for each the interval in which it is the only one
    undecided : intervals in which others may lie, ascending
    """

    found: tuple[arb, ...]
    alone: tuple[tuple[float, float], ...]
    undecided: tuple[tuple[float, float], ...]


class EnclosedMap(Protocol):
    """Enclosures of a map of launch speeds."""

    @property
    def liftoff(self) -> arb:
        """The extension at the launch."""

    def hop(self, x: arb) -> tuple[arb, arb]:
        """Enclosures of the next launch speed, with the injection, and of its derivative, for a ball of launch speeds;
        raises `Unproved`."""


@dataclass(frozen=True)
class LaunchRange:
    """The hops of a map with launch speeds between two, of which there are enclosures."""

    of: EnclosedMap
    low: arb
    high: arb

    def hops(self, x: arb, count: int) -> tuple[arb, arb] | None:
        """Enclosures of the launch speed after some hops and of its derivative; None where one of them is proved to be
        outside of the range."""
        after, slope = x, arb(1)
        for _ in range(count):
            if after < self.low or after > self.high:
                return None
            after, own = self.of.hop(after)
            slope = slope * own
        return after, slope

    def keeps(self, x: arb, count: int) -> bool:
        """Whether all launches of some hops are proved to lie in the range."""
        for _ in range(count):
            if not self.low <= x <= self.high:
                return False
            x, _ = self.of.hop(x)
        return True

    def launches_back(self, count: int, shortest: float, known: Sequence[float] = ()) -> LaunchesBack:
        """All launches that come back after some hops, not necessarily for the first time. Intervals with one that is
        `known` are halved further than others."""
        low, high = np.nextafter(float(self.low.lower()), 0.0), np.nextafter(float(self.high.upper()), np.inf)
        edges = np.linspace(low, high, FIRST_PARTS + 1).tolist()
        waiting, found = [*pairwise(edges)], list[tuple[arb, tuple[float, float]]]()
        undecided, shortest_of_known = list[tuple[float, float]](), min(shortest, SHORTEST_OF_KNOWN)
        while waiting:
            interrupts.heed()
            a, b = waiting.pop()
            try:
                if (narrower := self._narrowed(a, b, count)) is None:
                    continue
                p = float(np.nextafter(float(narrower.lower()), 0.0))
                q = float(np.nextafter(float(narrower.upper()), np.inf))
                if a < p and q < b:
                    found.append((self._refined(narrower, count), (a, b)))
                    continue
                p, q = max(a, p), min(b, q)
                if q - p < SHRINKS * (b - a):
                    waiting.append((p, q))
                    continue
            except Unproved:
                pass
            if b - a < (shortest_of_known if any(a <= x <= b for x in known) else shortest):
                undecided.append((a, b))
            else:
                waiting += [(a, a + FIRST_HALF * (b - a)), (a + FIRST_HALF * (b - a), b)]
        found.sort(key=lambda each: each[1])
        # Wider by a rounding, as the ends are written as decimals.
        wider = [(float(np.nextafter(a, 0.0)), float(np.nextafter(b, np.inf))) for a, b in undecided]
        return LaunchesBack(tuple(x for x, _ in found), tuple(own for _, own in found), _joined_intervals(wider))

    def _narrowed(self, a: float, b: float, count: int) -> arb | None:
        """Where the one launch of an interval that comes back can lie; None where there is none. Raises `Unproved`
        where there may be several."""
        x, m = arb(a).union(arb(b)), arb(0.5 * (a + b))
        if (image := self.hops(x, count)) is None or not image[0].overlaps(x):
            return None
        if (image[1] - 1).contains(0):
            raise Unproved("the derivative is not proved to differ from 1")
        if (middle := self.hops(m, count)) is None:
            raise Unproved("the launches from the middle leave the range")
        found = m - (middle[0] - m) / (image[1] - 1)
        return found if found.overlaps(x) else None

    def _refined(self, x: arb, count: int) -> arb:
        """A narrower enclosure of the launch in x that comes back."""
        for _ in range(LAUNCH_REFINEMENTS):
            image, middle = self.hops(x, count), self.hops(arb(x.mid()), count)
            if image is None or middle is None or (image[1] - 1).contains(0):
                break
            x = x.intersection(x.mid() - (middle[0] - x.mid()) / (image[1] - 1))
        return x


def _joined_intervals(intervals: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Intervals, ascending, with those that share an end as one."""
    found = list[tuple[float, float]]()
    for a, b in sorted(intervals):
        if found and a <= found[-1][1]:
            found[-1] = found[-1][0], max(b, found[-1][1])
        else:
            found.append((a, b))
    return tuple(found)


def proof_of_all_hops(machine: Machine, hops: PeriodicHops, inject: Fraction, shortest: float) -> Proof:
    """The proof that these are all hops of their period; see `prove_all_hops`."""
    began, stated = time.perf_counter(), stated_machine(machine, {})
    ends = [ball_of_fraction(Fraction(Decimal(repr(each)))) for each in (hops.low, hops.high)]
    with ctx.workprec(FIRST_BITS):
        of = enclosed_map(stated, inject)
        launches, liftoff = LaunchRange(of, *ends), enclosure_of(of.liftoff + arb(0, WITHIN_LIFTOFF))
        shorter = [launches.launches_back(d, shortest) for d in range(1, hops.period) if hops.period % d == 0]
        known = [x for cycle in hops for x in cycle.launches]
        back, reasons = launches.launches_back(hops.period, shortest, known), list[str]()
        found = list[arb]()
        for x, (a, b) in zip(back.found, back.alone, strict=True):
            if any(a < y.lower() and y.upper() < b for each in shorter for y in each.found):
                continue  # it is the only one there, and comes back earlier
            found.append(x)
            if not launches.keeps(x, hops.period):
                reasons.append(f"range: one of the hops from the launch in {enclosure_of(x)} may begin outside of it")
            for d in (d for d in range(1, hops.period) if hops.period % d == 0):
                earlier = launches.hops(x, d)
                if earlier is not None and earlier[0].overlaps(x):
                    reasons.append(f"least period: the launch in {enclosure_of(x)} may come back after {d} hops")
        said = [(x, FOUND_TO * x + cycle.error) for cycle in hops for x in cycle.launches]
        near = [[i for i, ball in enumerate(found) if (ball + arb(0, error)).overlaps(arb(x))] for x, error in said]
        reasons += [f"launch: hops of period {hops.period} are not proved to come back to {x!r}"
                    for (x, _), own in zip(said, near, strict=True) if len(own) != 1]  # fmt: skip
        reasons += [f"launch: the result does not have the one in {enclosure_of(ball)}"
                    for i, ball in enumerate(found) if [i] not in near]  # fmt: skip
        share = sum(b - a for a, b in back.undecided) / (hops.high - hops.low)
        if share > LARGEST_SHARE_LEFT:
            remedy = f"take a smaller shortest= than {shortest:g}, or a narrower range"
            reasons.append(f"undecided: {share:.0%} of the range is left: {remedy}")
        enclosures = {f"alpha_{i + 1}": enclosure_of(ball) for i, ball in enumerate(found)}
    return Proof(
        proved=not reasons,
        statement=" ".join([stated.words(), MAP_IN_WORDS, _words_of_all(hops, inject, enclosures, back.undecided)]),
        machine=machine_in_words(machine),
        kind="all hops",
        stated=stated.document()
        | {
            "eliminated": stated.coordinates[1],
            "liftoff": [liftoff.low, liftoff.high],
            "injection": [decimal_text(inject)] * 2,
            "period": hops.period,
            "range": [repr(hops.low), repr(hops.high)],
            "undecided": [[repr(a), repr(b)] for a, b in back.undecided],
        },
        parameters={name: bounds_of_fractions(each) for name, each in stated.parameters.items()},
        enclosures=enclosures,
        reasons=tuple(reasons),
        seconds=time.perf_counter() - began,
    )


def _words_of_all(
    hops: PeriodicHops, inject: Fraction, enclosures: dict[str, Enclosure], undecided: tuple[tuple[float, float], ...]
) -> str:
    """The sentence on the result of a proof."""
    n, but = hops.period, ""
    if undecided:
        ends = [(repr(a), repr(b)) for a, b in undecided]
        intervals = ", ".join(f"[{a}, {b}]" for a, b in ends)
        length = upper_fraction(sum((Fraction(b) - Fraction(a) for a, b in ends), Fraction(0)))
        many = f"{len(undecided)} intervals of together" if len(undecided) > 1 else "one interval of length"
        but = f", but for {many} {length} in which others may lie: {intervals}"
    there = (
        f"exactly one in each of {', '.join(map(str, enclosures.values()))}, and no others" if enclosures else "none"
    )
    return (
        f"With inject = {decimal_text(inject)}: of the launches from which {n} hop{'s' * (n > 1)}, all of them with "
        f"launch speeds between {hops.low!r} and {hops.high!r}, come back, and not fewer hops, there is {there}{but}."
    )


def enclosed_map(stated: StatedMachine, inject: Fraction) -> EnclosedMap:
    """The map of a stated machine; raises `InputError` for any but a hopper with a polynomial spring."""
    mechanics, (low, high) = (
        ExactMechanics(stated, Scale()),
        stated.parameters.get("mass_ratio", (Fraction(0), Fraction(1))),
    )
    conditions = mechanics.pieces or mechanics.domains or any(mechanics.law_domains) or mechanics.separation
    lone = mechanics.lone_extension() if mechanics.size == 2 and low == high and not conditions else None
    if lone is None or [*map(Fraction, mechanics.gap)] != [0, 1] or len(mechanics.s) != 1:
        raise InputError(ONLY_POLYNOMIAL)
    (body, foot), (place,), before = mechanics.y, mechanics.s, symbols("before", 4)
    law, m, one, r = (
        _coefficients_of_force(-lone.accelerations[0], lone.place),
        exact_number(low),
        exact_number(1),
        body - foot,
    )

    def force(extension: ExactExpression) -> ExactExpression:
        return total(exact_number(each) * extension**k for k, each in enumerate(law))

    pairs = [
        *zip(mechanics.accelerations[0], [-(one / m + force(r)) * m / (one + m), (force(r) - one) / (one + m)],
             strict=True),
        (mechanics.contact_force[0], one - force(place)),
        (mechanics.contact_accelerations[0][0], -(one / m + force(place)) * m / (one + m)),
        *zip(mechanics.embedded(mechanics.s), [place, ZERO], strict=True),
        *zip(landed_in_contact(mechanics, before), before[:2], strict=True),
    ]  # fmt: skip
    if not all(vanishes(own - expected) for own, expected in pairs):
        raise InputError(ONLY_POLYNOMIAL)
    if law == [0, 1]:
        return LinearHopper(ball_of_fraction(low), ball_of_fraction(inject))
    return PolynomialHopper.of(law, low, inject)


def _coefficients_of_force(force: ExactExpression, place: ExactExpression) -> list[Fraction]:
    """The coefficients of the polynomial that a function of a symbol is; raises `InputError` for any other."""
    found, rate, factorial = list[Fraction](), force, 1
    for k in range(LARGEST_DEGREE + 1):
        (at_zero,) = substitute([rate], {place: ZERO})
        if not at_zero.is_number:
            break
        found.append(at_zero.value / factorial)
        rate, factorial = derivative_by(rate, place), factorial * (k + 1)
    while found and not found[-1]:
        found.pop()
    if len(found) < 2 or not vanishes(force - total(exact_number(each) * place**k for k, each in enumerate(found))):
        raise InputError(ONLY_POLYNOMIAL)
    return found
