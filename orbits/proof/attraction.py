"""A proof that a lossless hop attracts the launches above it, within an explicit distance, where landings are plastic.

Let a launch be faster than a hop's, whose speed is alpha, by d with 0 < d <= d0, and let its landing have no bounce:
the gap at T, when the hop lands, rises with the speed of the launch. This is checked in balls for all of these launches
together (`launches`, `landings`). Where the gap falls, there is one bounce; see `bounces`.

The landing. The gap g0 of the hop has a triple zero at T, as its flight is its own mirror image. With -g0''' = J it is

    g0(T + s) = -A s**3/6,   g0'(T + s) = -B s**2/2,   A, B means of J between T and T + s with positive weights.

For the launch g(T + s) = g0(T + s) + d D and g'(T + s) = g0'(T + s) + d G, by the mean value theorem, with D and G
values of the derivatives of gap and rate by the speed of launches between. Where J > 0 and D > 0, g is positive up to
T: from lift-off until near T as in `motion`, and there because g0 and d D are. After T it first vanishes at a time with

    d = A s**3/(6 D),   and the rate -v,   v = B s**2/2 - d G.

The loss. The landing takes the energy m v**2/2, 1/m the gap's mobility. The energy of launches rises with their speed
at a rate P > 0. So the loss in speed, if launches of the remaining energy lie above alpha, is c d**(4/3) with
c = m v**2/(2 P d**(4/3)); and they do where c d**(1/3) < 1, as the loss is then less than the excess over the hop.

The contact. Let the next launch be that of the remaining energy. From its mirror image, with the speed turned, a
contact begins that pushes until its coordinate rests, and by symmetry on to that launch, where the force falls to 0.
At landing the coordinate y is lower than the place of the next launch and falling. The contact from the mirror image
passes y while it falls, and there has the same energy, hence the same rate: it is the contact after the landing.

Convergence. So d falls to d - c d**(4/3) > 0 at each hop, c in [c1, c2], c1 > 0, and its only limit is 0. With
x = d**(-1/3), x rises to x (1 - c/x)**(-1/3) > x + c1/3. So d <= (d**(-1/3) + n c1/3)**-3 after n hops.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from flint import arb

from ..balls import Motion, Refuted, ball_of_fraction
from ..exact import NOT_ACROSS, Enclosure, ExactArc, ExactMechanics, HalfOrbit, TooLong, Unproved, enclosure_of
from ..symbolic import substitute
from .bounces import Bounces, losses_with_bounce
from .landings import losses_at_landing
from .launches import LAUNCHES, Flight, LaunchEquations, comes_below, launches_beyond
from .loss import Loss


@dataclass(frozen=True)
class Attraction:
    """Launches from these places, faster than the hop by at most `within`, converge to it; each, faster by d, loses a
    speed c d**(4/3) with c in `losses`; in the machine's units. `bounce` : whether each of them bounces once."""

    within: Fraction
    losses: Enclosure
    places: Enclosure
    bounce: bool


@dataclass(frozen=True)
class Hop:
    """A hop as proved: its half orbit, enclosures of its unknowns by name and of half the times of its phases,
    in the units of the equations, the arc of its contact, and its loss."""

    half: HalfOrbit
    unknowns: Mapping[str, arb]
    half_flight: arb
    half_contact: arb
    contact: ExactArc
    loss: Loss


def attraction_of(hop: Hop) -> Attraction:
    """The theorem for the largest distance of a list for which its proof succeeds, by bisection; raises `Unproved`."""
    mechanics = hop.half.mechanics
    if mechanics.stated.wide:
        raise Unproved("it can be proved only if each parameter has one value")
    if mechanics.pieces is not None:
        raise Unproved(NOT_ACROSS)
    bounces = Bounces(hop.half) if hop.loss.bounce_side == "above" else None
    equations = LaunchEquations(hop.half, hop.contact)
    distances, found, reason = _distances(hop.loss.coefficient * (10 if bounces else 1)), None, ""
    low, high = 0, len(distances)  # proved below the first, not from the second on
    while low < high:
        middle = (low + high) // 2
        try:
            found, low = _proved_within(hop, equations, bounces, distances[middle]), middle + 1
        except TooLong:
            if found is None:
                raise
            break
        except (Unproved, Refuted) as error:
            high, reason = middle, f"within {float(distances[middle]):g} of alpha: {error}"
    if found is None:
        raise Unproved(reason)
    return found


def _distances(coefficient: arb) -> list[Fraction]:
    """Decimals of one digit, in the machine's units and ascending, up to where the leading order of the loss would be
    all of a distance."""
    whole = float(coefficient.mid()) ** -3
    last = math.floor(math.log10(whole))
    decades = (Fraction(10) ** exponent for exponent in range(last - LAUNCHES.decades + 1, last + 1))
    return [each for decade in decades for digit in (1, 2, 5) if (each := digit * decade) < whole]


def _proved_within(hop: Hop, equations: LaunchEquations, bounces: Bounces | None, within: Fraction) -> Attraction:
    """The theorem for a distance; raises `Unproved` and `Refuted`."""
    mechanics = hop.half.mechanics
    speed, length = (ball_of_fraction(each) for each in (mechanics.scale.speed, mechanics.scale.length))
    reach = ball_of_fraction(within) / speed
    launches = launches_beyond(hop.half, hop.unknowns["liftoff"], hop.unknowns["alpha"], reach)
    window = _rounded(LAUNCHES.window_beyond, (hop.loss.delay * reach).root(3))
    flight = Flight(equations, launches, hop.half_flight, window)
    flight.check_clearance()
    motions = list(flight.motions)
    if bounces is None:
        losses, places = losses_at_landing(launches, flight, reach)
    else:
        losses, places, between_landings = losses_with_bounce(launches, flight, bounces, reach)
        motions += between_landings
    (contact,) = launches.follow(equations.contact, _rounded(LAUNCHES.contact_beyond, hop.half_contact))
    _check_contacts(mechanics, contact, places.lower())
    _check_apart(mechanics, motions, contact)
    stated = enclosure_of(losses / speed.root(3))
    if not Decimal(stated.low) > 0:
        raise Unproved("the losses are not bounded from below by a decimal above 0")
    return Attraction(within, stated, enclosure_of(launches.curve * length), bounces is not None)


def _check_contacts(mechanics: ExactMechanics, contact: Motion, lowest: arb) -> None:
    """Prove that contacts which begin as the mirror images of launches push until they rest, and pass below a place
    while they fall; raises `Unproved` and `Refuted`."""
    force = contact.chain(mechanics.contact_force, 1)
    if not contact.first(force, 0).contains(0):
        raise Unproved("the contact force does not vanish at landing")
    contact.check_positive(force, zero_at_start=1)
    if not contact.passage.finish[1] > 0:
        raise Unproved("the contacts of the next launches are not proved to come to rest")
    if not comes_below(contact, lowest):
        raise Unproved("the contacts of the next launches are not proved to pass the landing")


def _check_apart(mechanics: ExactMechanics, flights: Sequence[Motion], contact: Motion) -> None:
    """Prove that the separation, where one is stated, stays positive; raises `Unproved` and `Refuted`."""
    if mechanics.separation is None:
        return
    closed = dict(zip(mechanics.y, mechanics.embedded(mechanics.s), strict=True))
    for motion in flights:
        motion.check_positive(motion.chain([mechanics.separation], 1))
    contact.check_positive(contact.chain(substitute([mechanics.separation], closed), 1))


def _rounded(factor: float, time: arb) -> arb:
    """Approximately a multiple of a time, as an exact number."""
    return arb(factor * float(time.mid()))
