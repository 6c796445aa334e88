"""All launches of a linear hopper from which hops of a period come back, between two launch speeds, proved.

The body has the mass (1 + M)/M and the foot 1 + M, the spring between them has the force r, and the acceleration of
gravity is 1/(1 + M). A flight begins at an extension c, with the foot at rest and the rate s of the body: at a launch
c = 1 and s = alpha, after a bounce c > 1. With the extension r = c cos t + s sin t the gap is, times 1 + M,

    g(t) = c (1 - cos t) + s (t - sin t) - t**2/2.

It does not fall with c, and grows with s. So for all c and s of two intervals the first zero of g lies between that at
both lower bounds and that at both upper ones. Where g is positive before it, and its rate there negative, it is the
landing, and moves analytically. There the foot loses its speed v. For r > 1 the contact would have to pull: the next
flight begins, with the rate r' + v. For r < 1 the contact pushes until r = 1, and as only landings lose energy, the
next launch speed w without injection and its derivative are

    w**2 = alpha**2 - M (v_1**2 + ... + v_k**2),    w w' = alpha - M (v_1 v_1' + ... + v_k v_k')

if the first of these is positive. In v v' the derivative of the landing's time, which has the factor 1/v, cancels.

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
from math import cos, sin

import numpy as np
from flint import arb, ctx

from ..balls.programs import ball_of_fraction
from ..balls.root import FIRST_BITS
from ..errors import InputError
from ..exact.bounds import Enclosure
from ..exact.decimals import decimal_text
from ..exact.exact_mechanics import ExactMechanics, Scale
from ..exact.expressions import exact_number, symbols, vanishes
from ..exact.outward_decimals import bounds_of_fractions, enclosure_of
from ..exact.refusal import Unproved, check_proof_time
from ..exact.stated import StatedMachine, stated_machine
from ..model.machine import Machine, machine_in_words
from ..proof.theorem import Proof
from ..running import interrupts
from .fixed_point_statement import landed_in_contact
from .periodic_hops import PeriodicHops
from .proved_map import FOUND_TO, MAP_IN_WORDS

ONLY_LINEAR = (
    "that no hops are missing is proved of the dimensionless two-mass hopper with the spring 'r', without a rest "
    "length, alone: `prove_fixed_point` proves the hops of other machines one by one"
)
MOST_LANDINGS = 12  # of a hop; those with more stay undecided
# The times between which the first landing is looked for in floats, in units of the machine, and half the width of its
# enclosure.
TIMES_OF_FLIGHT, WITHIN_LANDING = np.linspace(0.0, 40.0, 4001)[1:], arb(2) ** -44
BY_EXTENSION, BY_RATE = 1 - np.cos(TIMES_OF_FLIGHT), TIMES_OF_FLIGHT - np.sin(TIMES_OF_FLIGHT)
BY_GRAVITY = TIMES_OF_FLIGHT**2 / 2
# Halvings to a landing and of the times at which the gap is decided, and the longest and shortest first time.
STEPS_TO_LANDING, HALVINGS_OF_FLIGHT, FIRST_TIMES = 60, 30, (0.25, 1e-6)
FIRST_PARTS = 40  # of the range, which are halved until they are decided
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
    low, high : of the range of launch speeds
    """

    mass_ratio: arb
    inject: arb
    low: arb
    high: arb

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

    def hops(self, x: arb, count: int) -> tuple[arb, arb] | None:
        """Enclosures of the launch speed after some hops and of its derivative; None where one of them is proved to be
        outside of the range."""
        after, slope = x, arb(1)
        for _ in range(count):
            if after < self.low or after > self.high:
                return None
            after, own = self.hop(after)
            slope = slope * own
        return after, slope

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
                waiting += [(a, 0.5 * (a + b)), (0.5 * (a + b), b)]
        found.sort(key=lambda each: each[1])
        return LaunchesBack(tuple(x for x, _ in found), tuple(own for _, own in found), _joined_intervals(undecided))

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
    ratio, ends = _mass_ratio(stated), [Fraction(Decimal(repr(each))) for each in (hops.low, hops.high)]
    with ctx.workprec(FIRST_BITS):
        closed_form = LinearHopper(*map(ball_of_fraction, (ratio, inject, *ends)))
        shorter = [closed_form.launches_back(d, shortest) for d in range(1, hops.period) if hops.period % d == 0]
        known = [x for cycle in hops for x in cycle.launches]
        back, reasons = closed_form.launches_back(hops.period, shortest, known), list[str]()
        found = list[arb]()
        for x, (a, b) in zip(back.found, back.alone, strict=True):
            if any(a < y.lower() and y.upper() < b for each in shorter for y in each.found):
                continue  # it is the only one there, and comes back earlier
            found.append(x)
            for d in (d for d in range(1, hops.period) if hops.period % d == 0):
                earlier = closed_form.hops(x, d)
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
        | {"injection": [decimal_text(inject)] * 2, "undecided": [[repr(a), repr(b)] for a, b in back.undecided]},
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
        intervals, length = ", ".join(f"[{a!r}, {b!r}]" for a, b in undecided), sum(b - a for a, b in undecided)
        many = f"{len(undecided)} intervals of together" if len(undecided) > 1 else "one interval of length"
        but = f", but for {many} {length:.2g} in which others may lie: {intervals}"
    there = (
        f"exactly one in each of {', '.join(map(str, enclosures.values()))}, and no others" if enclosures else "none"
    )
    return (
        f"With inject = {decimal_text(inject)}: of the launches from which {n} hop{'s' * (n > 1)}, all of them with "
        f"launch speeds between {hops.low!r} and {hops.high!r}, come back, and not fewer hops, there is {there}{but}."
    )


def _mass_ratio(stated: StatedMachine) -> Fraction:
    """M of a stated machine; raises `InputError` for any but a linear hopper."""
    mechanics, (low, high) = (
        ExactMechanics(stated, Scale()),
        stated.parameters.get("mass_ratio", (Fraction(0), Fraction(1))),
    )
    plain = mechanics.size == 2 and low == high and not (mechanics.pieces or mechanics.domains or mechanics.separation)
    if (
        not plain
        or len(mechanics.accelerations) != 1
        or [*map(Fraction, mechanics.gap)] != [0, 1]
        or len(mechanics.s) != 1
    ):
        raise InputError(ONLY_LINEAR)
    (body, foot), (place,), before = mechanics.y, mechanics.s, symbols("before", 4)
    m, one, r = exact_number(low), exact_number(Fraction(1)), body - foot
    pairs = [
        *zip(mechanics.accelerations[0], [-(one / m + r) * m / (one + m), (r - one) / (one + m)], strict=True),
        (mechanics.contact_force[0], one - place),
        (mechanics.contact_accelerations[0][0], -(one / m + place) * m / (one + m)),
        *zip(mechanics.embedded(mechanics.s), [place, exact_number(Fraction(0))], strict=True),
        *zip(landed_in_contact(mechanics, before), before[:2], strict=True),
    ]
    if not all(vanishes(own - expected) for own, expected in pairs):
        raise InputError(ONLY_LINEAR)
    return low
