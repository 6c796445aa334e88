"""The conditions that friction holds what sticks, and that what stands in flight is pushed and held.

Let F be the contact force and T a force on what sticks, both 0 at landing. The needed coefficient is the largest |T|/F
in the contact. From the landing to a time t the ratio T/F at t is T'/F' at some time between (Cauchy's mean value
theorem), where F' > 0. Where F > 0, it is q + (T' - q F')(t - m)/F for the ratio q at a time m and T', F' at some time
between, by the mean value theorem for T - q F, which is 0 at m.
"""

from collections.abc import Sequence
from fractions import Fraction
from heapq import heappop, heappush
from math import inf, nextafter

from flint import arb

from ..balls import Derivatives, Motion, Refuted, between
from ..exact import ExactMechanics, HalfOrbit, Unproved, decimal_text, enclosure_of
from ..mechanics import Square
from ..symbolic import Column, ExactExpression, exact_number, inner_product, substitute, total, vanishes

# The relative width to which the needed coefficient is enclosed for a message.
NEEDED_TO = 1e-4
PARTS_OF_CONTACT = 200  # at most, on which the coefficient is enclosed


def check_friction(half: HalfOrbit, contact: Motion) -> None:
    """The forces F_x on what sticks are below mu F_z in magnitude, F_z the contact force: mu F_z + F_x and mu F_z - F_x
    are positive. If the reversor of the contact takes F_z to itself and F_x to itself or its negative, these vanish at
    landing as they do at lift-off, and are positive in the other half where they are in this one; and where their
    derivatives are positive at landing, so is the limit of mu - |F_x|/F_z there. Otherwise the forces on the point that
    has landed are the images of these, which so have to be positive too. All grow with mu, as F_z > 0 where both are
    positive: so the least value of an interval is decisive."""
    m = half.mechanics
    (mu,) = substitute([_coefficient(half)], m.contact)
    landed, force = m.landed_force, m.contact_force
    same = all(vanishes(a - b) for a, b in zip(landed, force, strict=True))
    if not (same or m.places):
        raise Unproved("the contact force is not the same at the mirror image of a state")
    for i, name in enumerate(m.stated.sticks):
        along = [held[i] for held in m.holding_forces]
        images = m.contact_reversor.turned(along[:: m.contact_order], m.s, m.w)
        if same and any(all(vanishes(a - sign * b) for a, b in zip(images, along, strict=True)) for sign in (1, -1)):
            _check_held(half, contact, name, mu, force, along)
        elif m.places:
            _check_held(half, contact, name, mu, landed, images)
            _check_held(half, contact, name, mu, force, along, vanishes_first=False)
        else:
            raise Unproved(f"the force on {name} is not the same, or the negative, at the mirror image of a state")


def _check_held(
    half: HalfOrbit, contact: Motion, name: str, mu: ExactExpression, force: Column, along: Column,
    vanishes_first: bool = True,
) -> None:  # fmt: skip
    """Prove that mu times a force exceeds another one in magnitude, where both vanish at landing or neither does."""
    for sign in (1, -1):
        room = contact.chain([mu * a + sign * b for a, b in zip(force, along, strict=True)], 1)
        if vanishes_first and not contact.first(room, 0).contains(0):
            raise Unproved(f"the force on {name} does not vanish at landing")
        try:
            contact.check_positive(room, zero_at_start=int(vanishes_first))
        except (Unproved, Refuted) as error:
            words, low = "", _least_coefficient(half)
            if vanishes_first:
                needed = needed_friction(contact, contact.chain(force, 1), contact.chain(along, 1))
                begins = "" if low is None else f", and the interval of it begins at {decimal_text(low)}"
                words = f": {name} needs a coefficient in {enclosure_of(needed)}{begins}" if needed.is_finite() else ""
            raise type(error)(f"{error}{words}") from None


def check_stance(half: HalfOrbit, flight: Motion) -> None:
    """In flight the force of the ground across it is positive, and times mu above that along it in magnitude. In the
    other half these forces are the same, except for the sign of the second, as the masses are at images of their
    places, with the same accelerations."""
    forces, mu = ground_forces(half.mechanics), _coefficient(half)
    functions = [("the force on what stands", [across for across, _ in forces])]
    functions += [("friction on what stands", [mu * a + sign * b for a, b in forces]) for sign in (1, -1)]
    for what, each in functions:
        try:
            flight.check_positive(flight.chain(each, 1))
        except (Unproved, Refuted) as error:
            raise type(error)(f"{what}: {error}") from None


def ground_forces(m: ExactMechanics) -> list[Column]:
    """The forces of the ground on the machine in flight, across and along it, for each law: the weights and the masses
    times the accelerations of their heights, and the sum of the masses times the acceleration of their centre. Raises
    `Unproved` unless the reversor leaves the heights as they are, and the place of the centre too or turns it over."""
    along = m.centre
    if along is None:
        raise Unproved("the places of some masses along the ground are not stated")
    masses, weights = (
        [(m.formula(height), m.formula(mass)) for height, mass in each] for each in (m.stated.masses, m.stated.weights)
    )
    heavy = [*masses, *weights]
    *images, image = m.reversor.turned([*(height for height, _ in heavy), along], m.y, m.v)
    heights = all(vanishes(a - height) for a, (height, _) in zip(images, heavy, strict=True))
    if not (heights and (vanishes(image - along) or vanishes(image + along))):
        raise Unproved("the reversor does not leave the heights of the masses as they are, or their centre")
    weight = m.scale.time**2 * total(mass * m.gravity(height) for height, mass in heavy)
    centre = [(along, total(mass for _, mass in masses))]
    squares = [[Square.of(mass, place, m.y, m.v) for place, mass in each] for each in (masses, centre)]

    def inert(own: Sequence[Square], accelerations: Column) -> ExactExpression:
        return total(each.mass * (inner_product(each.gradient, accelerations) + each.bend) for each in own)

    return [[weight + inert(squares[0], each), inert(squares[1], each)] for each in m.accelerations]


def _least_coefficient(half: HalfOrbit) -> Fraction | None:
    """The least value of the coefficient of friction where it is a parameter; None for another formula."""
    stated = half.mechanics.stated
    return next((low for name, (low, _) in stated.parameters.items() if name == stated.friction), None)


def _coefficient(half: HalfOrbit) -> ExactExpression:
    """The coefficient of friction, or the least value of an interval of it."""
    if half.mechanics.stated.friction is None:
        raise Unproved("no coefficient of friction is stated, and the one that the orbit needs is not known")
    low = _least_coefficient(half)
    return half.mechanics.formula(half.mechanics.stated.friction) if low is None else exact_number(low)


def needed_friction(contact: Motion, force: Derivatives, along: Derivatives) -> arb:
    """An enclosure of the largest ratio in magnitude of a force on what sticks and the contact force, which both vanish
    at landing; not finite where the parts are too few to bound it."""
    pieces, least, waiting = contact.passage.pieces, arb(0), list[tuple[float, int, arb, arb]]()

    def add(i: int, low: arb, high: arb) -> None:
        nonlocal least
        middle, times, most = (low + high) / 2, between(low, high), arb("inf")
        fall, pull = (contact.value(each, 1, pieces[i], times) for each in (along, force))
        above, below = (contact.value(each, 0, pieces[i], middle) for each in (along, force))
        pushes = contact.value(force, 0, pieces[i], times)
        if below > 0:
            ratio = above / below
            least = least.max(abs(ratio).lower())
            if pushes > 0:
                most = abs(ratio + (fall - ratio * pull) * (times - middle) / pushes)
        if i == 0 and low.is_zero() and pull > 0:
            most = abs(fall / pull)
        heappush(waiting, (-float(most.upper()) if most.is_finite() else -inf, i, low, high))

    for i, piece in enumerate(pieces):
        add(i, arb(0), piece.step.h)
    for _ in range(PARTS_OF_CONTACT):
        most, i, low, high = waiting[0]
        if -most < float(least) * (1 + NEEDED_TO):
            break
        heappop(waiting)
        add(i, low, (low + high) / 2)
        add(i, (low + high) / 2, high)
    return least.union(arb(nextafter(-waiting[0][0], inf)))
