"""Verifies a saved proof that all hops of a period are known, from its statement alone: see `orbits.check_proof`.

Its motions are not those of the prover, which encloses hops by closed forms and by polynomials in the launch speed.
Here Lagrange's equations are followed in flight and in contact, for an interval of launch speeds by the derivatives at
all of it (`Passage`), to the first place where the gap, or the contact force, vanishes (`Leg`). Both take the next
launch speed from the energy that the landings lose, as the place of the launch is the same; the contact is followed to
see that the machine comes there. Launch speeds outside of the intervals that the statement leaves undecided are halved
until it is shown of each interval that no launch in it comes back, or exactly one, by the mean value theorem.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import reduce
from itertools import chain, pairwise
from typing import Any

from flint import arb, arb_mat, ctx

from .check_proof import (
    Bounds,
    Field,
    Machine,
    Passage,
    Tree,
    ball,
    bounds_of,
    check,
    dot,
    moved,
    number,
    solved,
)
from .check_statement import LIMIT, Unverified, check_printed, decimal, heed

# Bits, halvings to decide a sign, and the most landings of a hop.
BITS, HALVINGS, MOST_LANDINGS = 100, 24, 4
# The parts of the range, the least of their lengths, steps to what is enclosed, and the share of a first half: a launch
# that comes back would be on the edge of parts at round shares.
PARTS, LEAST, STEPS, HALF = 5, Fraction(1, 2**26), 4, Fraction(31, 64)
MOST_LEFT = Fraction(1, 100)  # the share of the range that may be undecided
# The fields of the file that say nothing.
EMPTY = ("alpha", "flight_time", "contact_time", "radius", "uniqueness_radius", "family", "bounce_side",
         "attraction_radius", "digits")  # fmt: skip


class Leg:
    """The motions of a field from c + D w, for all w of an interval, up to the first zero of a function that is
    positive before; at their beginning its derivatives below an `order` are known to be 0.

    end, slopes : the states there of the motion from c, and the derivatives of all by w
    half : half the derivative by w of the square of the function's rate there
    """

    def __init__(self, field: Field, of: Tree, centre: list[arb], slopes: Sequence[arb], reach: arb, order: int):
        self.field, self.of, self.reach = field, of, [reach]
        self.rate = field.along(of, 1)
        seeds = arb_mat([[each] for each in slopes])
        self.passage = Passage(field, centre, seeds, self.reach, lambda box: field.values(box)[of] < 0)
        self.times = [Fraction(0)]
        for part in self.passage.parts:
            self.times.append(self.times[-1] + part.time)
        time, middle = self._middle()
        value, (slope,) = field.linear(middle, of)
        least = arb(2) ** (24 - ctx.prec) + 4 * abs(value)
        speed = field.values(middle[1])[self.rate]
        width = (abs(slope / speed) * abs(reach) * arb(1.25) + least / abs(speed)).upper()
        if not width < 1:
            raise Unverified("the place where a function vanishes is not enclosed")
        width = Fraction(float(width)) * Fraction(1001, 1000)
        between = max(time - width, Fraction(0)), time + width
        signs = [self._over_all(each) for each in between]
        found = [self._between(k, *between) for k in range(len(self.times) - 1)]
        parts = [each for each in found if each]
        if not (parts and signs[0] > 0 and signs[1] < 0 and all(at[self.rate] < 0 for at, _ in parts)):
            raise Unverified("the place where a function vanishes is not enclosed")
        self._check_positive(order, between[0])
        self.slopes = hulls([self._moves(*each) for each in parts])
        rates, (speed,) = (
            hulls([[at[each] for each in field.rates] for at, _ in parts]),
            hulls([[at[self.rate]] for at, _ in parts]),
        )
        self.end = moved(middle[0], arb_mat([[each] for each in rates]), [-value / speed])
        (self.half,) = hulls([[self._half(*each)] for each in parts])

    def _middle(self) -> tuple[Fraction, tuple]:
        """About the time at which the function vanishes on the motion from c, and what is enclosed then."""
        values = [self.field.values(c)[self.of] for _, c, _ in self.passage.starts[1:]]
        k = next((k for k, each in enumerate(values) if each < 0), len(self.passage.parts) - 1)
        time, (low, high) = self.times[k], (self.times[k], self.times[k + 1])
        time = (low + high) / 2
        for _ in range(6):
            at = self.field.values(self._at(time)[0])
            step = (at[self.of] / at[self.rate]).mid()
            time = min(max(time - Fraction(float(step)), low), high)
        return time, self._at(time)

    def _at(self, time: Fraction) -> tuple[list[arb], list[arb], arb_mat]:
        """The motion from c, all motions, and the derivatives by w, at a time."""
        if not 0 <= time <= self.times[-1]:
            raise Unverified("the motion is not enclosed for so long")
        k = max(k for k in range(len(self.times) - 1) if self.times[k] <= time)
        (part, centre, slopes), t = self.passage.starts[k], time - self.times[k]
        centre = list(self.field.end(centre, t)) if t else list(centre)
        slopes = arb_mat([[each(ball(t)) for each in row[1:]] for row in part.polynomials]) * slopes
        return centre, moved(centre, slopes, self.reach), slopes

    def _over_all(self, time: Fraction) -> arb:
        """The function at a time on all motions."""
        value, row = self.field.linear(self._at(time), self.of)
        return value + dot(row, self.reach, arb(0))

    def _between(self, k: int, low: Fraction, high: Fraction) -> tuple | None:
        """The values of trees on all motions in a step between two times, and the derivatives by w; None outside."""
        low, high = max(low, self.times[k]), min(high, self.times[k + 1])
        if low > high:
            return None
        (part, _, slopes), t = self.passage.starts[k], ball(low - self.times[k]).union(ball(high - self.times[k]))
        transition = arb_mat([[each(t) for each in row[1:]] for row in part.polynomials])
        return part.values(t), transition * slopes

    def _moves(self, at: Any, slopes: arb_mat) -> list[arb]:
        """The derivatives by w of the states where the function vanishes."""
        (change,) = (arb_mat([[at[each] for each in self.field.gradient(self.of)]]) * slopes).tolist()[0]
        later = -change / at[self.rate]
        return [own + at[rate] * later for (own,), rate in zip(slopes.tolist(), self.field.rates, strict=True)]

    def _half(self, at: Any, slopes: arb_mat) -> arb:
        """Half the derivative by w of the square of the function's rate where it vanishes: in the product of the rate
        with its own change, the rate of rates times that of the time, the rate cancels."""
        changes = [dot([at[each] for each in self.field.gradient(of)], [own for (own,) in slopes.tolist()], arb(0))
                   for of in (self.of, self.rate)]  # fmt: skip
        return at[self.rate] * changes[1] - at[self.field.along(self.of, 2)] * changes[0]

    def _check_positive(self, order: int, end: Fraction) -> None:
        """See that the function is positive up to a time at which it is."""
        waiting = [
            (k, low, min(high, end), HALVINGS) for k, (low, high) in enumerate(pairwise(self.times)) if low < end
        ]
        first = self.field.along(self.of, order)
        while waiting:
            k, low, high, left = waiting.pop()
            t = ball(low - self.times[k]).union(ball(high - self.times[k]))
            at = self.passage.parts[k].values(t)
            if at[self.of] > 0 or (low == 0 and order and at[first] > 0):
                continue
            moves = at[self.rate] < 0 or at[self.rate] > 0
            if moves and low > 0 and self._over_all(low) > 0 and self._over_all(high) > 0:
                continue
            if left == 0:
                raise Unverified("a sign along the motion is not decided")
            middle = (low + high) / 2
            waiting += [(k, low, middle, left - 1), (k, middle, high, left - 1)]


def hulls(rows: Sequence[Sequence[arb]]) -> list[arb]:
    """For each place in rows the least ball that holds the entries there."""
    return [reduce(arb.union, each) for each in zip(*rows, strict=True)]


class Hops:
    """The map of launch speeds of a stated machine with plastic landings: of the hops that are smooth."""

    def __init__(self, stated: Mapping[str, Any]):
        m = self.machine = Machine(stated, bounds_of(stated["parameters"]))
        if len(m.names) != 2 or m.steps or m.sticks or m.constants or len(m.edges) > 2 or stated["separation"]:
            raise Unverified("this program verifies all hops of machines of two coordinates with one smooth law")
        self.flight, self.contact = Field(m, False), Field(m, True)
        self.place = m.names.index(stated["launch"])
        along = [row[0] for row in m.embedded]
        momentum = [dot(row, m.rates) for row in m.inertia]
        heavy = dot(along, [dot(row, along) for row in m.inertia])
        self.landed = dot(along, momentum) / heavy  # the rate of the contact's coordinate after a landing
        _, (yields,) = solved(m.inertia, m.weights)
        # Twice the energy that a landing loses is the square of the gap's rate over the first factor here, and that of
        # a rate of the contact's coordinate is the square of that times the second.
        self.share = number(1) / (dot(m.weights, yields) * heavy)
        if any(slope is not number(0) for of in (heavy, self.share) for slope in self.flight.gradient(of)):
            raise Unverified("this program verifies all hops of machines whose inertia is constant")
        self.along = [each.value for each in along]
        self.inject, self.low, self.high = (ball(decimal(text)) for text in (stated["injection"][0], *stated["range"]))
        self.liftoff = self._liftoff(*map(decimal, stated["liftoff"]))

    def _states(self, place: arb, rate: arb, half: int) -> list[arb]:
        """States with closed gap of the contact's coordinate and its rate, or, with half = 0, their derivatives."""
        sides = [[ball(each) * value for each in self.along] for value in (place, rate)]
        return [*sides[0], *sides[1], arb(half)]

    def _force(self, place: arb) -> arb:
        return self.contact.values(self._states(place, arb(0), 1))[self.contact.force]

    def _slope_of_force(self, place: arb) -> arb:
        at = self.contact.values(self._states(place, arb(0), 1))
        return dot(
            [at[each] for each in self.contact.gradient(self.contact.force)[:2]], [*map(ball, self.along)], arb(0)
        )

    def _liftoff(self, low: Fraction, high: Fraction) -> arb:
        """The place of the launch, at which the contact force vanishes and falls."""
        force = self.contact.force
        if any(slope is not number(0) for slope in self.contact.gradient(force)[2:4]):
            raise Unverified("the contact force depends on speeds")
        ends, between = [self._force(ball(each)) for each in (low, high)], ball(low).union(ball(high))
        if not (ends[0] > 0 and ends[1] < 0 and self._slope_of_force(between) < 0):
            raise Unverified("the place of the launch is not shown to be enclosed")
        for _ in range(STEPS):
            between = between.intersection(
                between.mid() - self._force(arb(between.mid())) / self._slope_of_force(between)
            )
        return between

    def hop(self, centre: arb, x: arb) -> tuple[arb, arb]:
        """The next launch speed from a centre, and its derivative for all launch speeds of an interval."""
        reach, place, rate, lost, half = x - centre, (self.liftoff, arb(0)), (centre, arb(1)), arb(0), arb(0)
        for landing in range(MOST_LANDINGS):
            start, slopes = (self._states(place[i], rate[i], 1 - i) for i in (0, 1))
            leg = Leg(self.flight, self.machine.gap, start, slopes, reach, 3 if landing == 0 else 2)
            at, share = self.flight.values(leg.end), self.flight.values(leg.end)[self.share]
            lost, half = lost + share * at[leg.rate] * at[leg.rate], half + share * leg.half
            place = leg.end[self.place], leg.slopes[self.place]
            every = moved(leg.end, arb_mat([[each] for each in leg.slopes]), [reach])
            value, (slope,) = self.flight.linear((leg.end, every, arb_mat([[s] for s in leg.slopes])), self.landed)
            rate = value, slope
            force = self._force(place[0] + place[1] * reach)
            if force > 0:
                break
            if not force < 0:
                raise Unverified("it is not decided whether the machine leaves the ground at once")
        else:
            raise Unverified("a hop has too many landings")
        start, slopes = (self._states(place[i], rate[i], 1 - i) for i in (0, 1))
        leg = Leg(self.contact, self.contact.force, start, slopes, reach, 0)
        if not self._slope_of_force(self.liftoff.union(leg.end[self.place] + leg.slopes[self.place] * reach)) < 0:
            raise Unverified("the place of the next launch is not shown to be that of the launch")
        square = centre * centre - lost, (centre + reach) * (centre + reach) - lost - 2 * half * reach
        if not (square[1] > 0 and square[0] > 0):
            raise Unverified("the next launch speed is not shown to be positive")
        return square[0].sqrt() + self.inject, (x - half) / square[1].sqrt()

    def hops(self, x: arb, count: int) -> tuple[arb, arb, arb] | None:
        """After some hops the launch speed from the middle of an interval, those from all of it, and the derivative;
        None where one of the hops is shown to begin outside of the range."""
        middle, every, slope = arb(x.mid()), x, arb(1)
        for _ in range(count):
            if every < self.low or every > self.high:
                return None
            centre = arb(middle.mid())
            every = every.union(centre)  # as the derivative counts between the centre and all others
            following, own = self.hop(centre, every)
            every = following + own * (every - centre)
            middle, slope = following + own * (middle - centre), slope * own
            by_slope = middle + slope * (x - x.mid())
            every = every.intersection(by_slope) if every.overlaps(by_slope) else every
        return middle, every, slope

    def newton(self, x: arb, count: int) -> arb | None:
        """Where the one launch of an interval that comes back can lie; None where none does."""
        if (found := self.hops(x, count)) is None or not found[1].overlaps(x):
            return None
        middle, _, slope = found
        if (slope - 1).contains(0):
            raise Unverified("the derivative is not shown to differ from 1")
        image = x.mid() - (middle - x.mid()) / (slope - 1)
        return image if image.overlaps(x) else None

    def stay(self, x: arb, count: int) -> bool:
        """Whether the hops from an interval are shown to begin in the range."""
        for _ in range(count):
            if not self.low <= x <= self.high:
                return False
            centre = arb(x.mid())
            following, slope = self.hop(centre, x)
            x = following + slope * (x - centre)
        return True


def check_saved(document: Mapping[str, Any], limit: float = LIMIT) -> list[str]:
    """Why a saved proof, of an orbit or of all hops, is not verified, in words; empty where all of its theorem is.
    Raises `OutOfTime` where that takes more than `limit` seconds of processor time."""
    of_hops = isinstance(document, dict) and document.get("kind") == "all hops"
    return check(document, [check_all_hops] if of_hops else (), limit)


def check_all_hops(document: Mapping[str, Any]) -> None:
    """See that the launches from which hops of a period come back, all in a range and outside of the undecided
    intervals, are exactly one in each enclosure; raises `Unverified`."""
    stated, said = document["machine"], bounds_of(document["enclosures"])
    period, low, high = stated["period"], *map(decimal, stated["range"])
    undecided = sorted(bounds_of({str(i): pair for i, pair in enumerate(stated["undecided"])}).values())
    _check_fields(document, said)
    shortest = LEAST * (high - low)
    with ctx.workprec(BITS):
        hops, waiting = Hops(stated), list[tuple[Fraction, Fraction]]()
        edges = [low, *(each for pair in undecided for each in pair), high]
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            cuts = [a + (b - a) * Fraction(i, PARTS) for i in range(PARTS + 1)]
            waiting += [*pairwise(cuts)] if a < b else []
        left = dict(said)
        while waiting:
            a, b = waiting.pop()
            x, why = ball(a).union(ball(b)), "the interval is not decided"
            heed()
            try:
                image = hops.newton(x, period)
            except Unverified as reason:
                image, why = x, str(reason)
            if image is None:
                continue
            if ball(a) < image < ball(b):
                _match(hops, image, (a, b), period, left)
                continue
            if b - a < shortest:
                raise Unverified(f"launches near {float(a):.12g} are not decided: {why}")
            x = x.intersection(image)
            if x.rad() < 0.35 * ball(b - a):
                waiting.append((max(a, _fraction(x.lower())), min(b, _fraction(x.upper()))))
            else:
                waiting += [(a, a + HALF * (b - a)), (a + HALF * (b - a), b)]
    if left:
        raise Unverified(f"no launch that comes back is shown to lie in the enclosure of {', '.join(left)}")


def _fraction(value: arb) -> Fraction:
    mantissa, exponent = value.mid().man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def _match(hops: Hops, image: arb, own: tuple[Fraction, Fraction], period: int, left: dict[str, Any]) -> None:
    """Take the enclosure of the one launch of an interval that comes back, which lies in its image, from those that are
    left, if it does not come back earlier."""
    a, b = own
    for _ in range(STEPS):
        inside = [name for name, (low, high) in left.items() if ball(low) <= image <= ball(high)]
        if inside or (closer := hops.newton(image, period)) is None or not image.contains(closer):
            break
        image = closer
    shorter = [d for d in range(1, period) if period % d == 0]
    if inside:
        if not hops.stay(image, period):
            raise Unverified("a hop is not shown to begin in the range")
        for d in shorter:
            after = hops.hops(image, d)
            if after is None or after[1].overlaps(image):
                raise Unverified(f"the launch of {inside[0]} may come back after {d} hops")
        del left[inside[0]]
        return
    around = image + arb(0, 2) * image.rad() + arb(0, 1e-15)
    for d in shorter:
        closer = hops.newton(around, d)
        if closer is not None and around.contains_interior(closer) and ball(a) < closer < ball(b):
            return  # the one launch of the interval comes back earlier
    raise Unverified(f"a launch near {float(image.mid()):.15g} comes back, and no enclosure has it")


def _check_fields(document: Mapping[str, Any], said: Bounds) -> None:
    """See that the file says what is verified, and no more."""
    stated, again = document["machine"], dict.fromkeys(EMPTY)
    again |= {"format": "persistent-orbits proof 2", "kind": "all hops", "proved": True, "motion": False, "parts": [],
              "conditions": {}, "reasons": [], "units": stated["units"]}  # fmt: skip
    again["parameters"], texts = ({name: {"low": low, "high": high} for name, (low, high) in pairs.items()}
                                  for pairs in (stated["parameters"], document["enclosures"]))  # fmt: skip
    again |= texts
    if false := [name for name, value in again.items() if document.get(name) != value]:
        raise Unverified(f"'{false[0]}' is not what the file says elsewhere, or this program does not verify it")
    check_printed(document)
    low, high = map(decimal, stated["range"])
    undecided, period = [*map(decimal, chain(*stated["undecided"]))], stated["period"]
    left = sum(undecided[1::2]) - sum(undecided[::2])
    exact = [[*map(decimal, pair)] for pair in (*stated["parameters"].values(), stated["injection"])]
    if [*said] != [f"alpha_{i + 1}" for i in range(len(said))] or period < 1:
        raise Unverified("the period is no number of hops, or the launches are not numbered")
    if not (0 < low < high and left <= MOST_LEFT * (high - low) and all(a == b for a, b in exact)):
        raise Unverified("the range is empty, or too much of it is undecided, or the machine has intervals")
    apart = sorted([*said.values(), *zip(undecided[::2], undecided[1::2], strict=True)])
    if not (all(b < c for (_, b), (c, _) in pairwise(apart)) and all(low <= a and b <= high for a, b in said.values())):
        raise Unverified("enclosures and undecided intervals have common launches, or enclosures leave the range")
