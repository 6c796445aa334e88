"""The condition that friction holds what sticks, and the coefficient that it needs.

Let F be the contact force and T a force on what sticks, both 0 at landing. The needed coefficient is the largest |T|/F
in the contact. From the landing to a time t the ratio T/F at t is T'/F' at some time between (Cauchy's mean value
theorem), where F' > 0. Where F > 0, it is q + (T' - q F')(t - m)/F for the ratio q at a time m and T', F' at some time
between, by the mean value theorem for T - q F, which is 0 at m.
"""

from heapq import heappop, heappush
from math import inf, nextafter

from flint import arb

from ..balls import Derivatives, Motion, Refuted, between
from ..exact import HalfOrbit, Unproved, decimal_text, enclosure_of
from ..symbolic import exact_number, substitute, vanishes

# The relative width to which the needed coefficient is enclosed for a message.
NEEDED_TO = 1e-4
PARTS_OF_CONTACT = 200  # at most, on which the coefficient is enclosed


def check_friction(half: HalfOrbit, contact: Motion) -> None:
    """The forces F_x on what sticks are below mu F_z in magnitude, F_z the contact force. The reversor of the contact
    takes F_z to itself and F_x to itself or its negative: so mu F_z + F_x and mu F_z - F_x, which vanish at landing as
    they do at lift-off, are positive in the other half where they are in this one; and where their derivatives are
    positive at landing, so is the limit of mu - |F_x|/F_z there. Both grow with mu, as F_z > 0 where both are positive:
    so the least value of an interval is decisive."""
    m = half.mechanics
    if m.stated.friction is None:
        raise Unproved("no coefficient of friction is stated, and the one that the orbit needs is not known")
    low, _ = m.stated.parameters.get(m.stated.friction, (None, None))
    mu = m.formula(m.stated.friction) if low is None else exact_number(low)
    (mu,) = substitute([mu], dict(zip(m.y, m.embedded(m.s), strict=True)))
    if not all(vanishes(a - b) for a, b in zip(m.landed_force, m.contact_force, strict=True)):
        raise Unproved("the contact force is not the same at the mirror image of a state")
    for i, name in enumerate(m.stated.sticks):
        along = [held[i] for held in m.holding_forces]
        images = m.contact_reversor.turned(along[:: m.contact_order], m.s, m.w)
        if not any(all(vanishes(a - sign * b) for a, b in zip(images, along, strict=True)) for sign in (1, -1)):
            raise Unproved(f"the force on {name} is not the same, or the negative, at the mirror image of a state")
        for sign in (1, -1):
            left = [mu * force + sign * each for force, each in zip(m.contact_force, along, strict=True)]
            room = contact.chain(left, 1)
            if not contact.first(room, 0).contains(0):
                raise Unproved(f"the force on {name} does not vanish at landing")
            try:
                contact.check_positive(room, zero_at_start=1)
            except (Unproved, Refuted) as error:
                needed = needed_friction(contact, contact.chain(m.contact_force, 1), contact.chain(along, 1))
                begins = "" if low is None else f", and the interval of it begins at {decimal_text(low)}"
                words = f": {name} needs a coefficient in {enclosure_of(needed)}{begins}" if needed.is_finite() else ""
                raise type(error)(f"{error}{words}") from None


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
