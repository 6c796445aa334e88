"""The motions of all launches that are a little faster than a lossless hop, enclosed: their flights until after the
landing, with the derivatives by the speed of the launch, and their contacts until after the middle.

A launch is a state in contact whose contact force is 0. Those near the hop's own lie on a curve, place over speed,
where the force rises or falls with the place. With x the states of the flight and u their derivatives by the speed of
the launch, along that curve and at fixed times, the system x' = f(x), u' = Df(x) u is followed. It is in two parts; the
second part is a window of time about the landing of the hop.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from flint import arb, ctx

from ..balls import BallProgram, Equations, IntervalParameters, Motion, between, evaluated_on
from ..exact import FLIGHT_DURATION, ExactArc, ExactStatement, HalfOrbit, Unproved, unknown
from ..symbolic import ExactExpression, along, derivative_by, expression, inner_product, symbol, symbols
from .loss import launch_expressions


class LaunchOptions(NamedTuple):
    """How sets of launches are followed to their landings, and what their windows hold."""

    bits: int = 64  # of the motions: sets of launches are wider by far than roundings
    widenings: int = 12  # of the places of all launches, until they are enclosed
    wider: float = 1.25  # factor of each widening
    parts: int = 8  # of each step, on which signs of the states are checked one by one
    cells: int = 24  # parts of a window on which landings are enclosed
    passes: int = 3  # over the means on each cell
    # Largest ratio of the time between the landings to that by which the first one is early; to leading order it is 3.
    latest_bounce: float = 4.5
    decades: int = 6  # of the distances that are tried
    window_beyond: float = 1.5  # how far the window reaches, relative to the landing predicted by the leading order
    contact_beyond: float = 1.1  # how far the contact is followed, relative to its middle


LAUNCHES = LaunchOptions()


@dataclass(frozen=True)
class Launches:
    """Launches from enclosures of their places and speeds; the hop's is one of them.

    curve : an enclosure of the places of all of these launches, inside `place`, from which motions are followed
    place_by_speed : an enclosure of the derivative along the curve
    """

    half: HalfOrbit
    place: arb
    speed: arb
    curve: arb
    place_by_speed: arb

    def follow(self, equations: Equations, *others: arb) -> list[Motion]:
        """The motions of all launches on the arcs of equations, whose unknowns are the place and the speed of a launch
        and others, which are enclosed; raises `Unproved`."""
        return motions_of(equations, [self.place, self.speed, *others])

    def power(self) -> arb:
        """An enclosure of the derivative of the energy by the speed, along the curve."""
        _, power, *_ = launch_expressions(self.half, 0)
        return BallProgram([*self.half.launch_unknowns.values()], [power])([self.place, self.speed])[0]


def motions_of(equations: Equations, box: Sequence[arb]) -> list[Motion]:
    """The motions on the arcs of equations for all unknowns in a box; raises `Unproved`."""
    with ctx.workprec(LAUNCHES.bits):
        passages = evaluated_on(equations, [each.mid() for each in box], [each.rad() for each in box]).passages
        equations.check_domains(passages)
    return [Motion(leg, passage) for leg, passage in zip(equations.legs, passages, strict=True)]


def launches_beyond(half: HalfOrbit, place: arb, speed: arb, reach: arb) -> Launches:
    """The launches that are faster by at most `reach` than a launch of this place and speed, on the curve through it.

    By the theorem of Picard and Lindelof the curve stays in an enclosure if its slope, over all of it, does not lead
    out of it. There the force has a derivative by the place that is not 0: so there are no other launches. Raises
    `Unproved` where none is found.
    """
    own, lifted = half.launch_unknowns, half.lifted[0]
    by_place = derivative_by(lifted, own["liftoff"])
    program = BallProgram([*own.values()], [-derivative_by(lifted, own["alpha"]) / by_place, by_place])
    speeds, places = between(speed, speed + reach), _widened_ball(place)
    for _ in range(LAUNCHES.widenings):
        slope, rises = program([places, speeds])
        curve = place + slope * between(arb(0), reach)
        if rises.contains(0) or not curve.is_finite():
            break
        if places.contains(_widened_ball(curve)):
            return Launches(half, places, speeds, curve, slope)
        places = _widened_ball(_widened_ball(curve))
    raise Unproved("the places of lift-off near that of the hop are not enclosed")


def _widened_ball(value: arb) -> arb:
    """A wider ball, which also holds the ball's bounds as decimals."""
    return (
        value.mid()
        + LAUNCHES.wider * (value - value.mid())
        + arb(0, (1 + abs(value)).abs_upper() * 2.0**-LAUNCHES.bits)
    )


class Landing(NamedTuple):
    """Enclosures over some time about the landing of the hop, for all launches.

    jerk : the third derivative of the gap, with its sign turned
    gap_by_speed, gap_rate_by_speed, gap_acceleration_by_speed, place_by_speed : derivatives by the speed of the launch,
        at fixed times, of the gap, its rate and its acceleration, and of the contact's coordinate
    place, rate, rate_after : of the contact's coordinate; the last after a plastic landing
    mass : twice the energy that a landing takes, divided by the square of the gap's rate
    """

    jerk: arb
    gap_by_speed: arb
    gap_rate_by_speed: arb
    gap_acceleration_by_speed: arb
    place_by_speed: arb
    place: arb
    rate: arb
    rate_after: arb
    mass: arb


class LaunchEquations:
    """The equations of the flights of launches and of contacts that begin as their mirror images do.

    contact : the arc of the contact of the hop
    """

    def __init__(self, half: HalfOrbit, contact: ExactArc):
        self.half, own = half, half.launch_unknowns
        # Half the flight time of the hop; the time for which launches are followed before and after its landing.
        half_time, window = unknown(FLIGHT_DURATION), unknown("window")
        arc = half.flight().arcs[0]
        changes = [symbol(f"by speed {each.value}") for each in arc.states]
        _, _, *by_speed = launch_expressions(half, 0)
        first = replace(
            arc,
            states=[*arc.states, *changes],
            rates=[[*law, *(along(each, arc.states, changes) for each in law)] for law in arc.rates],
            start=[*half.launch, *by_speed],
            duration=2 * half_time - window,
            guards=[[]],
            conditions=[],
        )
        before = symbols("before", len(first.states))
        second = replace(first, start=before, before=tuple(before), duration=2 * window)
        unknowns = own | {FLIGHT_DURATION: half_time, "window": window}
        self.flight = Equations(ExactStatement(unknowns, (first, second)), IntervalParameters({}))
        time = unknown("time in contact")
        arc_of_contact = replace(contact, duration=time, before=(), conditions=[], guards=[[]])
        self.contact = Equations(ExactStatement(own | {"time": time}, (arc_of_contact,)), IntervalParameters({}))
        self.landing = BallProgram(self.flight.legs[1].state, _landing_functions(half, first))


class Flight:
    """The flight of launches, from lift-off to a time after the landing of the hop.

    half_time : an enclosure of half the time of the flight of the hop
    window : the time for which launches are followed before that landing, and as long after it
    motions : before the window, and in it
    """

    def __init__(self, equations: LaunchEquations, launches: Launches, half_time: arb, window: arb):
        self.half, self.window, self._program = equations.half, window, equations.landing
        self.motions = launches.follow(equations.flight, half_time, window)

    def landing(self, low: arb, high: arb, parts: int = 1) -> Landing:
        """The enclosures between two times of the window, which count from the landing of the hop."""
        found: list[arb] | None = None
        low, high = ((each + self.window) / (2 * self.window) for each in (low, high))
        for states in states_between(self.motions[1], low, high, parts):
            values = self._program(states)
            found = values if found is None else [a.union(b) for a, b in zip(found, values, strict=True)]
        assert found is not None
        return Landing(*found)

    def states(self, low: arb, high: arb) -> list[arb]:
        """Enclosures of the states of the flight between two times of the window, likewise."""
        low, high = ((each + self.window) / (2 * self.window) for each in (low, high))
        each, *others = states_between(self.motions[1], low, high, 1)
        for other in others:
            each = [a.union(b) for a, b in zip(each, other, strict=True)]
        return each[: 2 * self.half.mechanics.size]

    def check_clearance(self) -> None:
        """Prove that the foot does not touch before the window; raises `Unproved` and `Refuted`."""
        first = self.motions[0]
        gap = first.chain([self.half.gap], 3)
        if not first.first(gap, 2).contains(0):
            raise Unproved("the gap's acceleration does not vanish with the contact force")
        first.check_positive(gap, zero_at_start=3)


def _landing_functions(half: HalfOrbit, arc: ExactArc) -> list[ExactExpression]:
    """The functions of `Landing`, on an arc whose states are those of the flight and their derivatives."""
    m, own = half.mechanics, arc.states[: len(arc.states) // 2]
    by_speed = dict(zip(own, arc.states[len(own) :], strict=True))
    gaps = [half.gap]
    for _ in range(3):
        gaps.append(along(gaps[-1], own, arc.rates[0][: len(own)]))
    gaps_by_speed = [along(each, own, arc.states[len(own) :]) for each in gaps[:3]]
    weights, coordinate = [expression(each) for each in m.gap], m.independent[0]
    mobility = m.kinetics.accelerations(weights)
    mass = 1 / inner_product(weights, mobility)
    after = m.v[coordinate] - mobility[coordinate] * mass * gaps[1]
    return [-gaps[3], *gaps_by_speed, by_speed[m.y[coordinate]], m.y[coordinate], m.v[coordinate], after, mass]


def states_between(motion: Motion, low: arb, high: arb, parts: int) -> Iterator[list[arb]]:
    """Enclosures of the states of a motion, on `parts` parts of each of its steps, which together cover the times
    from `low` to `high`; the motion lasts from 0 to 1."""
    for piece in motion.passage.pieces:
        first, last = (low - piece.begins).lower(), (high - piece.begins).upper()
        first, last = first if first > 0 else arb(0), last if last < piece.step.h else piece.step.h
        if not first > last:
            length = last - first
            for i in range(parts):
                yield piece.step.at(between(first + length * i / parts, first + length * (i + 1) / parts))


def comes_below(contact: Motion, place: arb) -> bool:
    """Whether all motions of a contact are proved to pass below a place while they fall."""
    for states in states_between(contact, arb(0), arb(1), LAUNCHES.parts):
        if not states[1] < 0:
            return False
        if states[0] < place:
            return True
    return False
