"""Losses of launches that land with a bounce before the hop's landing, as the gap falls with their speed.

In the notation of `attraction`, with D < 0, a launch lands first a time a before the hop would, with d = A a**3/(6 |D|)
and the speed v = B a**2/2 - d G, the means now being over the time from T - a to T. At all earlier times of the window
its gap is positive, or it is among those times. The landing removes the gap's rate and leaves the places. So the
acceleration of the gap goes from M a + d H, H being its derivative by the speed, to

    e = M a + d H + v L,    L its derivative by the rates along their change, 0 where the inertia is constant.

It is positive: the contact would pull, and the foot leaves immediately. With the means A', B' of the jerk from then on
the gap is e t**2/2 - A' t**3/6 and first vanishes again at t = 3 e/A', with the speed v' = t**2 (B'/2 - A'/3). This
loses m v'**2/2 too. To leading order t = 3 a, v = J a**2/2 and v' = 3 v, so that ten times as much is lost as without.
"""

from dataclasses import dataclass, replace
from functools import reduce

from flint import arb

from ..balls import BallProgram, Equations, IntervalParameters, Motion, between
from ..exact import ExactStatement, HalfOrbit, Unproved, unknown
from ..symbolic import along, derivative_by, expression, inner_product, substitute, symbol, total
from .landings import JerkIntegrals
from .launches import LAUNCHES, Flight, Launches, motions_of, states_between


@dataclass(frozen=True)
class _SecondLanding:
    """Enclosures of the second landing of launches that first land a time a before the hop would.

    pace, delay : its speed over a**2, and its time after the first over a
    rate, rate_after : of the contact's coordinate between the landings, and after the second
    """

    pace: arb
    delay: arb
    mass: arb
    place: arb
    rate: arb
    rate_after: arb
    motion: Motion


class Bounces:
    """The equations of the flights between two landings."""

    def __init__(self, half: HalfOrbit):
        m, arc = half.mechanics, half.flight().arcs[0]
        self.half, states, rates = half, arc.states, arc.rates[0]
        names = {f"first {each.value}": unknown(f"first {each.value}") for each in states}
        time = unknown("time of the bounce")
        bounce = replace(arc, start=[*names.values()], duration=time, guards=[[]], conditions=[])
        self.equations = Equations(ExactStatement(names | {"time": time}, (bounce,)), IntervalParameters({}))
        gaps = [half.gap]
        for _ in range(3):
            gaps.append(along(gaps[-1], states, rates))
        weights, coordinate = [expression(each) for each in m.gap], m.independent[0]
        mobility = m.kinetics.accelerations(weights)
        mass = 1 / inner_product(weights, mobility)
        after = [v - each * mass * gaps[1] for v, each in zip(m.v, mobility, strict=True)]
        landed = [each for pair in zip(m.y, after, strict=True) for each in pair]
        self._landed = BallProgram(states, landed)
        # The derivative by the rates, at all rates between those before and after the landing.
        share = symbol("share of the landing")
        turning = mass * total(derivative_by(gaps[2], v) * each for v, each in zip(m.v, mobility, strict=True))
        between_both = {v: v - share * each * mass * gaps[1] for v, each in zip(m.v, mobility, strict=True)}
        self._turning = BallProgram([*states, share], substitute([turning], between_both))
        functions = [-gaps[3], mass, m.y[coordinate], m.v[coordinate], after[coordinate]]
        self._program = BallProgram(self.equations.legs[0].state, functions)

    def turning(self, states: list[arb]) -> arb:
        """L, where launches land with these states."""
        return self._turning([*states, between(arb(0), arb(1))])[0]

    def second(self, states: list[arb], early: arb, rising: arb) -> _SecondLanding:
        """The second landing of launches that land with these states, earlier than the hop by `early`, where
        afterwards the acceleration of the gap is `rising` times that time; raises `Unproved`."""
        length = LAUNCHES.latest_bounce * early.upper()
        (motion,) = motions_of(self.equations, [*self._landed(states), length])
        cell, jerks, end = length / LAUNCHES.cells, JerkIntegrals(), arb(0)
        found, rate = list[tuple[arb, ...]](), None
        for i in range(LAUNCHES.cells):
            begin, end = end, end + cell
            inside = states_between(motion, arb(i) / LAUNCHES.cells, arb(i + 1) / LAUNCHES.cells, 1)
            jerk, mass, place, own, after = (
                reduce(arb.union, each) for each in zip(*map(self._program, inside), strict=True)
            )
            rate = own if rate is None else rate.union(own)
            if not jerk > 0:
                raise Unproved("the jerk between the two landings is not proved to keep its sign")
            means, jerks = jerks.further(jerk, cell)
            if (rising * early * 3 / means.square).overlaps(between(begin, end)):
                delay = 3 * rising / means.square
                pace = delay**2 * (means.linear / 2 - means.square / 3)
                found.append((pace, delay, mass, place, rate, after))
            if rising * early * end**2 / 2 < jerks.thrice:
                pace, delay, mass, place, rate, after = (reduce(arb.union, each) for each in zip(*found, strict=True))
                return _SecondLanding(pace, delay, mass, place, rate, after, motion)
        raise Unproved("not all launches are proved to land again after their bounce")


def losses_with_bounce(
    launches: Launches, flight: Flight, bounces: Bounces, reach: arb
) -> tuple[arb, arb, list[Motion]]:
    """The losses of `losses_at_landing` with the flights between the landings."""
    power, cell, jerks, end = launches.power(), flight.window / LAUNCHES.cells, JerkIntegrals(), arb(0)
    found, rate, motions = list[tuple[arb, arb]](), None, list[Motion]()
    for _ in range(LAUNCHES.cells):
        begin, end = end, end + cell
        here, height, early = flight.landing(-end, -begin), jerks.thrice, between(begin, end)
        if not (here.jerk > 0 and here.gap_by_speed < 0 and here.mass > 0 and power > 0):
            raise Unproved("the signs of the jerk and of the derivatives by the speed are not decided")
        means, jerks = jerks.further(here.jerk, cell)
        rate = here.rate if rate is None else rate.union(here.rate)
        if height > -reach * here.gap_by_speed:
            continue  # none lands so early
        share = -means.square / (6 * here.gap_by_speed)
        pace = means.linear / 2 - early * share * here.gap_rate_by_speed
        states = flight.states(-end, -begin)
        rising = means.flat + early**2 * share * here.gap_acceleration_by_speed + early * pace * bounces.turning(states)
        if not (pace > 0 and rising > 0):
            raise Unproved("the first landing is not proved to take energy and to bounce")
        second = bounces.second(states, early, rising)
        if not second.pace > 0:
            raise Unproved("the second landing is not proved to take energy")
        loss = (here.mass * pace**2 + second.mass * second.pace**2) / (2 * power * share.root(3) ** 4)
        if not loss * (share.root(3) * early).min(reach.root(3)) < 1:
            raise Unproved("the next launch is not proved to be faster than the hop")
        aside = here.place_by_speed - launches.place_by_speed * between(arb(0), arb(1))
        fallen = second.rate * second.delay - rate + share * early**2 * aside
        if not (second.rate_after < 0 and fallen < 0):
            raise Unproved("the contact is not proved to go on below the place of the next launch")
        found.append((loss, second.place))
        motions.append(second.motion)
    losses, places = (reduce(arb.union, each) for each in zip(*found, strict=True))
    return losses, places, motions
