"""The conditions of a motion: its family, gaps, forces of the ground, heights, and the end of the contact."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from ..balls import Motion, Refuted
from ..exact import Enclosure, HalfOrbit, Undecided, Unproved
from ..symbolic import ExactExpression, substitute, vanishes
from .attraction import Attraction
from .loss import Loss
from .proved_existence import widened_enclosure
from .sticking_friction import check_friction, check_stance

NO_CONTACT = "the contact of the orbit does not end, so nothing can be proved"
PROVED, REFUTED, UNDECIDED = "proved", "refuted", "undecided"
CONDITIONS = ("clearance", "separation", "contact_force", "contact_end")
# Those of machines that stick besides, and of those of them that stand in flight too.
CONDITIONS_OF_RUNS, CONDITIONS_OF_STANCES = ("heights", "friction"), ("stance",)


@dataclass(frozen=True)
class Verdicts:
    """The verdicts on the motion of a solution: family, conditions, enclosures, reasons for what is not proved, and how
    many of these more digits may remove."""

    family: int | None = None
    conditions: Mapping[str, str] = field(default_factory=dict)
    enclosures: Mapping[str, Enclosure] = field(default_factory=dict)
    loss: Loss | None = None
    attraction: Attraction | None = None
    reasons: tuple[str, ...] = ()
    undecided: int = 0


def counted_family(half: HalfOrbit, flight: Motion, digits: int | None) -> Verdicts:
    """The family, and the extension at lift-off and in mid-flight; the reason where it cannot be counted."""
    m = half.mechanics
    counted = flight.chain([m.counts] * len(flight.leg.rates), 2)
    (image,) = m.reversor.turned([m.counts], m.y, m.v)
    try:
        family = flight.count_turns(counted, turns_at_end=vanishes(image - m.counts))
    except Unproved as error:
        return Verdicts(reasons=(f"family: {error}",), undecided=isinstance(error, Undecided))
    places = {"liftoff_extension": flight.first(counted, 0), "mid_flight_extension": flight.last(counted, 0)}
    return Verdicts(family, enclosures={name: widened_enclosure(ball, digits) for name, ball in places.items()})


def motion_conditions(half: HalfOrbit, flight: Motion, contact: Motion | None, names: Sequence[str]) -> Verdicts:
    """The verdicts on the conditions of a motion."""
    checks = {
        "clearance": lambda: _check_gaps(half, flight, contact),
        "separation": lambda: _check_separation(half, flight, contact),
        "contact_force": lambda: _check_force(half, _contact_that_ends(contact)),
        "contact_end": lambda: _check_end(half, _contact_that_ends(contact)),
        "heights": lambda: _check_heights(half, flight, contact),
        "stance": lambda: check_stance(half, flight),
        "friction": lambda: check_friction(half, _contact_that_ends(contact)),
    }
    return verdicts_of({name: checks[name] for name in names})


def verdicts_of(checks: Mapping[str, Callable[[], None]]) -> Verdicts:
    """The verdicts of checks of conditions by name."""
    verdicts, reasons, undecided = dict.fromkeys(checks, PROVED), list[str](), 0
    for name, check in checks.items():
        try:
            check()
        except (Unproved, Refuted) as error:
            verdicts[name] = UNDECIDED if isinstance(error, Unproved) else REFUTED
            undecided += isinstance(error, Undecided)
            reasons.append(f"{name}: {error}")
    return Verdicts(conditions=verdicts, reasons=tuple(reasons), undecided=undecided)


def _contact_that_ends(contact: Motion | None) -> Motion:
    if contact is None:
        raise Unproved(NO_CONTACT)
    return contact


@contextmanager
def _about(point: str) -> Iterator[None]:
    """Begin the messages of errors with the point of contact that they are about, if it has a name."""
    try:
        yield
    except (Unproved, Refuted) as error:
        raise type(error)(f"the {point}: {error}" if point else str(error)) from None


def _check_gaps(half: HalfOrbit, flight: Motion, contact: Motion | None) -> None:
    """The gap and its speed are 0 at lift-off, as the launch is a contact state; its acceleration is 0, as the
    contact force vanishes there. In the other half of the flight the gap is as that which closes at landing is in this
    half; where that is another one, it is also positive in contact. One that grazes the ground has a zero of second
    order in mid-flight, since it and its rate vanish in each state that the reversor leaves as it is."""
    laws, (opens, lands), landing = len(flight.leg.rates), half.mechanics.stated.points, half.landing_gap
    gap = flight.chain([half.gap] * laws, 3)
    if not flight.first(gap, 2).contains(0):
        raise Unproved("the gap's acceleration does not vanish with the contact force")
    with _about(opens):
        flight.check_positive(gap, zero_at_start=3, zero_at_end=2 if half.mechanics.stated.grazes else 0)
    if landing is not None:
        with _about(lands):
            flight.check_positive(flight.chain([landing] * laws, 1))
            _check_in_contact(half, _contact_that_ends(contact), landing)


def _check_in_contact(half: HalfOrbit, contact: Motion, function: ExactExpression) -> None:
    """Prove that a function of the flight state is positive in both halves of the contact."""
    m = half.mechanics
    (inside,) = substitute([function], m.contact)
    for each in dict.fromkeys([inside, *m.contact_reversor.turned([inside], m.s, m.w)]):
        contact.check_positive(contact.chain([each] * len(contact.leg.rates), 1))


def _check_separation(half: HalfOrbit, flight: Motion, contact: Motion | None) -> None:
    assert half.mechanics.separation is not None
    _check_always(half, flight, contact, half.mechanics.separation)


def _check_heights(half: HalfOrbit, flight: Motion, contact: Motion | None) -> None:
    """The stated heights except the gap itself."""
    for name, height in half.mechanics.heights:
        if not vanishes(height - half.gap * half.mechanics.scale.length):
            with _about(name):
                _check_always(half, flight, contact, height)


def _check_always(half: HalfOrbit, flight: Motion, contact: Motion | None, function: ExactExpression) -> None:
    """Prove that a function of the flight state is positive in both halves of flight and contact."""
    m = half.mechanics
    for each in dict.fromkeys([function, *m.reversor.turned([function], m.y, m.v)]):
        flight.check_positive(flight.chain([each] * len(flight.leg.rates), 1))
    _check_in_contact(half, _contact_that_ends(contact), function)


def _check_force(half: HalfOrbit, contact: Motion) -> None:
    """The force on the point that has landed vanishes at landing. In the other half of the contact the force on the
    point that opens is as that force is in this half; where these are two forces, both are positive in this half."""
    m, (opens, lands) = half.mechanics, half.mechanics.stated.points
    force = contact.chain(m.landed_force, 1)
    if not contact.first(force, 0).contains(0):
        raise Unproved("the contact force does not vanish at landing")
    with _about(lands):
        contact.check_positive(force, zero_at_start=1)
    if not all(vanishes(a - b) for a, b in zip(m.landed_force, m.contact_force, strict=True)):
        with _about(opens):
            contact.check_positive(contact.chain(m.contact_force, 1))


def _check_end(half: HalfOrbit, contact: Motion) -> None:
    """Of a contact of one coordinate, what vanishes in mid-contact does so there first: its rate, or its distance from
    the centre where the reversor of the contact takes it to the other side; of several, the equations require all."""
    m, laws = half.mechanics, len(contact.leg.rates)
    if len(m.s) == 1:
        (middle,) = m.contact_reversor.fixed(m.s, m.w)
        value = contact.first(contact.chain([middle] * laws, 0), 0)
        if value.contains(0):
            raise Unproved("the contact may begin in its middle")
        contact.check_positive(contact.chain([middle if value > 0 else -middle] * laws, 1), zero_at_end=1)
