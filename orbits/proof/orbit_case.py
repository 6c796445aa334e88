"""The proof of the claims of an orbit: that it exists, is unique nearby, is of its family and is a motion."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import isfinite
from typing import Any, NamedTuple

from flint import arb, ctx

from ..balls import (
    FIRST_BITS,
    BallProgram,
    Equations,
    IntervalParameters,
    Motion,
    ProvedRoot,
    Refuted,
    ball_of_fraction,
    evaluated_on,
    narrowed_root,
    prove_root,
)
from ..errors import InputError
from ..exact import (
    CONTACT_DURATION,
    FLIGHT_DURATION,
    Claim,
    Enclosure,
    ExactMechanics,
    ExactStatement,
    HalfOrbit,
    Scale,
    StatedMachine,
    Undecided,
    Unproved,
    bounds_of_fractions,
    decimal_text,
    enclosure_of,
    lower_decimal,
    nearest_power_of_two,
    radius_of,
)
from ..model import Machine, machine_in_words
from ..symbolic import ExactExpression, substitute, vanishes
from .attraction import Attraction, Hop, attraction_of
from .digits import DIGITS, bits_of_digits, with_enough_digits
from .loss import Loss, enclosed_loss
from .sticking_friction import check_friction
from .theorem import Part, Proof
from .wording import attraction_sentence, loss_sentence, motion_sentence, root_sentence


class ClaimOptions(NamedTuple):
    """How near the numbers of a claim are to those that are proved."""

    errors_of_alpha: float = 2.0  # error of alpha that is allowed, as a multiple of its own bound
    roundings: float = 8 * 2.0**-52  # share of alpha that is allowed in addition, a few units of the last place
    share_of_others: float = 1e-11  # share of other numbers that is allowed, as they are correct to some roundings
    # Multiple of the error of alpha that is allowed in other numbers in addition: an orbit bounds no errors of theirs.
    errors_of_others: float = 1e3
    # Widest box of a run with tuned numbers, as a share of the unknowns: its equations are ill-conditioned.
    share_of_runs: float = 2.0**-34
    roundings_of_map: float = 512 * 2.0**-52  # share of a fixed point of the map that is allowed
    share_of_slope: float = 1e-6  # share of the multiplier of a hop that is allowed
    share_of_flip: float = 1e-9  # share of a range to which a period doubling is located


CLAIMS = ClaimOptions()
NO_CONTACT = "the orbit has no contact that ends, of which anything could be proved"
PROVED, REFUTED, UNDECIDED = "proved", "refuted", "undecided"
MAIN_UNKNOWNS = ("alpha", "flight_time", "contact_time")
CONDITIONS = ("clearance", "separation", "contact_force", "contact_end")
# Those of machines that stick besides.
CONDITIONS_OF_RUNS = ("heights", "friction")


def check_mirrored(model: Any) -> None:
    """Raise `InputError` for a model whose orbits are not their own mirror images."""
    if model.reversor is None:
        why = "loses energy, as by a damper, or states no reversor, and so is not its own mirror image in time"
        raise InputError(f"this {model.name} {why}: nothing is proved of its orbits")


def not_stated(machine: Machine, reason: Unproved, conditions: Mapping[str, str] | None = None) -> Proof:
    """The proof, with nothing proved, for a machine that no theorem can state."""
    words = machine_in_words(machine)
    statement = f"Nothing is proved of the {words['machine']}: no theorem can state it."
    reasons = (f"the machine: {reason}",)
    return Proof(proved=False, statement=statement, machine=words, conditions=conditions or {}, reasons=reasons)


@dataclass(frozen=True)
class ProvedExistence:
    """A proved solution of the equations of half an orbit.

    balls, unknowns : enclosures of the numbers in the theorem, of the launch and the times of the whole phases, in the
        units of the machine; the second as decimals
    uniqueness_radius : in the units of the machine
    """

    half: HalfOrbit
    statement: ExactStatement
    equations: Equations
    root: ProvedRoot
    balls: dict[str, arb]
    unknowns: dict[str, Enclosure]
    uniqueness_radius: str

    def ball(self, each: ExactExpression) -> arb:
        """An enclosure of a function of the unknowns, in the units of the equations."""
        return ball_of(each, self.statement, self.equations, self.root)


def ball_of(each: ExactExpression, statement: ExactStatement, equations: Equations, root: ProvedRoot) -> arb:
    """An enclosure of a function of the unknowns, in the units of the equations."""
    inputs = [*statement.unknowns.values(), *equations.intervals.symbols.values()]
    return BallProgram(inputs, [each])([*root.box, *equations.intervals.balls()])[0]


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


@dataclass(frozen=True)
class _Wanted:
    """What is to be proved of a solution: the names of the conditions of a motion, and what `whole_proof` describes."""

    conditions: tuple[str, ...]
    loss: bool
    attraction: bool
    about_claim: bool


@dataclass(frozen=True)
class _Proved:
    """A solution, None where none is proved, and the verdicts on its motion."""

    found: ProvedExistence | None
    verdicts: Verdicts

    @property
    def undecided(self) -> bool:
        """Whether more digits may prove all that is not proved."""
        return 0 < self.verdicts.undecided == len(self.verdicts.reasons)


def whole_proof(
    claim: Claim, stated: StatedMachine, digits: int | None, motion: bool, loss: bool, attraction: bool = False,
    about_claim: bool = True,
) -> Proof:  # fmt: skip
    """The proof for all values of the parameters together; `about_claim` : whether it checks the orbit's own numbers,
    which hold only for the part of an interval with the machine's own values."""
    began = time.perf_counter()
    names = [name for name in CONDITIONS if name != "separation" or stated.separation is not None]
    names += CONDITIONS_OF_RUNS if stated.sticks else ()

    def attempt(digits: int | None, before: _Proved | None) -> _Proved:
        wanted = _Wanted(tuple(names) if motion else (), loss, attraction, about_claim)
        return _verdicts_with(claim, stated, wanted, digits, before.found if before else None)

    hopeless = bool(stated.of_motion.keys() & {*stated.wide} or (about_claim and claim.contradictions))
    proved, digits, left = with_enough_digits(attempt, lambda each: not hopeless and each.undecided, digits)
    found, verdicts = proved.found, replace(proved.verdicts, reasons=(*proved.verdicts.reasons, *left))
    parameters = {name: bounds_of_fractions(bounds) for name, bounds in stated.parameters.items()}
    words = machine_in_words(claim.machine)
    if found is None:
        statement = f"{stated.words()} Nothing is proved of an orbit with alpha near {claim.alpha!r}."
        return Proof(
            proved=False, statement=statement, machine=words, stated=stated.document(), parameters=parameters,
            conditions=verdicts.conditions, reasons=verdicts.reasons, digits=digits,
            seconds=time.perf_counter() - began,
        )  # fmt: skip
    radius = found.uniqueness_radius
    enclosures = {name: each for name, each in found.unknowns.items() if name in (*MAIN_UNKNOWNS, *stated.tuned)}
    enclosures |= verdicts.enclosures
    reasons = (*(claim.contradictions if about_claim else ()), *verdicts.reasons)
    sentences = [
        stated.words(),
        root_sentence(found.unknowns, radius, bool(stated.wide), stated),
        motion_sentence(verdicts.family, verdicts.conditions, verdicts.enclosures, stated.steps),
    ]
    if verdicts.loss and not reasons:
        sentences.append(loss_sentence(enclosures["loss_coefficient"], verdicts.loss.bounce_side))
    within = None
    if verdicts.attraction and not reasons:
        within = decimal_text(verdicts.attraction.within)
        sentences.append(attraction_sentence(within, verdicts.attraction))
    return Proof(
        proved=not reasons,
        statement=" ".join(filter(None, sentences)),
        machine=words,
        stated=stated.document() | {"eliminated": stated.coordinates[found.half.mechanics.gap.index(Fraction(1))]},
        family=verdicts.family,
        parameters=parameters,
        enclosures=enclosures,
        radius=radius_of(found.unknowns["alpha"]),
        uniqueness_radius=radius,
        parts=(Part(parameters, found.unknowns, radius),),
        conditions=verdicts.conditions,
        bounce_side=verdicts.loss.bounce_side if verdicts.loss else None,
        attraction_radius=within,
        reasons=reasons,
        digits=digits,
        seconds=time.perf_counter() - began,
    )


def _verdicts_with(
    claim: Claim, stated: StatedMachine, wanted: _Wanted, digits: int | None, before: ProvedExistence | None
) -> _Proved:
    """What is proved with a number of digits, from the solution with fewer digits if there is one;
    raises `Unproved` where that is not enclosed more narrowly."""
    with ctx.workprec(FIRST_BITS):
        try:
            with_contact = bool(wanted.conditions) and CONTACT_DURATION in claim.unknowns
            found = narrowed_existence(before, digits) if before else existence_of(claim, stated, with_contact, digits)
        except Unproved as error:
            if before:
                raise
            undecided = isinstance(error, Undecided)
            conditions = dict.fromkeys(wanted.conditions, UNDECIDED)
            return _Proved(None, Verdicts(None, conditions, reasons=(f"existence: {error}",), undecided=undecided))
        with_loss = wanted.loss or (wanted.attraction and not claim.machine.restitution)
        with ctx.workprec(max(FIRST_BITS, bits_of_digits(digits))):
            verdicts = _verdicts(found, claim, wanted.conditions, with_loss, digits, wanted.about_claim)
        if wanted.attraction:
            verdicts = _with_attraction(found, claim, verdicts)
    return _Proved(found, verdicts)


def narrowed_existence(found: ProvedExistence, digits: int | None) -> ProvedExistence:
    """A proved solution, enclosed to a number of digits; raises `Unproved`."""
    root = narrowed_root(found.equations, found.root, bits_of_digits(digits))
    return _existence(found.half, found.statement, found.equations, root, digits)


def existence_of(claim: Claim, stated: StatedMachine, with_contact: bool, digits: int | None) -> ProvedExistence:
    """The proved solution near an orbit's claim; raises `Unproved`."""
    scale = Scale.of(claim.alpha, claim.flight_time / 2, max(claim.family, 1))
    sizes = {name: nearest_power_of_two(abs(claim.unknowns[name])) for name in stated.tuned if name in claim.unknowns}
    half = HalfOrbit(ExactMechanics(stated, scale, units=sizes))
    statement = half.statement(with_contact)
    if missing := [name for name in statement.unknowns if name not in claim.unknowns]:
        raise Unproved(f"the orbit has no {missing[0]}")
    equations = Equations(statement, IntervalParameters(stated.of_motion))
    guess = [claim.unknowns[name] / float(half.unit_of(name)) for name in statement.unknowns]
    boxes = [[arb(CLAIMS.share_of_runs) * (1 + abs(each)) for each in guess]] if stated.sticks else []
    root = prove_root(equations, guess, bits_of_digits(digits), boxes)
    return _existence(half, statement, equations, root, digits)


def _existence(
    half: HalfOrbit, statement: ExactStatement, equations: Equations, root: ProvedRoot, digits: int | None
) -> ProvedExistence:
    """The solution with this root of its equations; raises `Unproved`."""
    equations.check_domains(root.evaluated.passages)
    with ctx.workprec(bits_of_digits(digits) + FIRST_BITS):
        units = [ball_of_fraction(half.unit_of(name)) for name in statement.unknowns]
        balls = {name: ball * unit for name, ball, unit in zip(statement.unknowns, root.box, units, strict=True)}
        balls.pop(FLIGHT_DURATION, None)
        half_contact = balls.pop(CONTACT_DURATION, None)
        time_unit = ball_of_fraction(half.mechanics.scale.time)
        balls["flight_time"] = 2 * ball_of(half.half_flight, statement, equations, root) * time_unit
        if half_contact is not None:
            balls["contact_time"] = 2 * half_contact
        if not balls["flight_time"] > 0:
            raise Unproved("the time of the flight is not proved to be positive")
        unknowns = {name: _widened_enclosure(ball, digits) for name, ball in balls.items()}
        radius = lower_decimal(root.unique_within(units))
    return ProvedExistence(half, statement, equations, root, balls, unknowns, radius)


def _widened_enclosure(ball: arb, digits: int | None) -> Enclosure:
    """An enclosure of positive width: one of width 0 could not be verified by another method."""
    bits = max(bits_of_digits(digits), DIGITS.default_bits)
    return enclosure_of(ball if ball.rad() > 0 else ball + arb(0, abs(ball) * arb(2) ** -bits), digits)


def _verdicts(
    found: ProvedExistence, claim: Claim, names: Sequence[str], loss: bool, digits: int | None, about_claim: bool
) -> Verdicts:
    """The verdicts on the motion, for these conditions, and on the orbit's claims."""
    reasons = tuple(wrong_numbers(found, claim)) if about_claim else ()
    if not (names or loss):
        return Verdicts(reasons=reasons)
    try:
        flight = _flight(found)
    except Unproved as error:
        said = *reasons, f"the flight: {error}"
        return Verdicts(None, dict.fromkeys(names, UNDECIDED), reasons=said, undecided=isinstance(error, Undecided))
    motion = _motion_verdicts(found, flight, claim, names, digits, about_claim) if names else Verdicts()
    lost = _loss_verdict(found, flight, claim, motion.conditions) if loss else Verdicts()
    enclosures, reasons = {**motion.enclosures, **lost.enclosures}, (*reasons, *motion.reasons, *lost.reasons)
    undecided = motion.undecided + lost.undecided
    return Verdicts(motion.family, motion.conditions, enclosures, lost.loss, reasons=reasons, undecided=undecided)


def _motion_verdicts(
    found: ProvedExistence, flight: Motion, claim: Claim, names: Sequence[str], digits: int | None, about_claim: bool
) -> Verdicts:
    """The verdicts on the family and these conditions, and on the orbit's claims about both."""
    counted, wrong = counted_family(found.half, flight, digits), list[str]()
    if about_claim:
        if counted.family not in (None, claim.family):
            turns = f"the extension turns as in family {counted.family}"
            wrong.append(f"family: {turns}, and the orbit says {claim.family}")
        wrong += [f"the orbit itself says that it is no motion: {each}" for each in claim.violations]
        wrong += _wrong_places(found, flight, claim)
    ends = CONTACT_DURATION in found.statement.unknowns
    contact = Motion(found.equations.legs[-1], found.root.evaluated.passages[-1]) if ends else None
    verdicts = motion_conditions(found.half, flight, contact, names)
    reasons, undecided = (*counted.reasons, *wrong, *verdicts.reasons), counted.undecided + verdicts.undecided
    return replace(counted, conditions=verdicts.conditions, reasons=reasons, undecided=undecided)


def _loss_verdict(found: ProvedExistence, flight: Motion, claim: Claim, conditions: Mapping[str, str]) -> Verdicts:
    """The verdict on the loss coefficient: there are hops beside the orbit only if it is a motion."""
    try:
        _check_losses(found, claim, "a loss coefficient", "Cd")
        if {*conditions.values()} != {PROVED}:
            raise Undecided("it needs the conditions of a motion, which are not all proved")
        unknowns = flight_statement(found).unknowns
        lost = enclosed_loss(found.half, flight, {name: found.ball(each) for name, each in unknowns.items()}, ctx.prec)
        return Verdicts(enclosures={"loss_coefficient": enclosure_of(lost.coefficient)}, loss=lost)
    except Unproved as error:
        return Verdicts(reasons=(f"the loss coefficient: {error}",), undecided=isinstance(error, Undecided))


def _with_attraction(found: ProvedExistence, claim: Claim, verdicts: Verdicts) -> Verdicts:
    """The verdicts with that on the attraction of launches above alpha."""
    try:
        _check_losses(found, claim, "attraction", "cdn")
        if verdicts.loss is None or {*verdicts.conditions.values()} != {PROVED}:
            raise Undecided("it needs the conditions of a motion and the loss coefficient, which are not all proved")
        half, half_contact = found.half, found.ball(found.statement.unknowns[CONTACT_DURATION])
        launch = {name: found.ball(each) for name, each in half.launch_unknowns.items()}
        contact = found.statement.arcs[-1]
        hop = Hop(half, launch, found.ball(half.half_flight), half_contact, contact, verdicts.loss)
        attraction = attraction_of(hop)
    except Unproved as error:
        undecided = verdicts.undecided + isinstance(error, Undecided)
        return replace(verdicts, reasons=(*verdicts.reasons, f"attraction: {error}"), undecided=undecided)
    enclosures = {**verdicts.enclosures, "attraction_loss": attraction.losses}
    return replace(verdicts, attraction=attraction, enclosures=enclosures)


def _check_losses(found: ProvedExistence, claim: Claim, what: str, names: str) -> None:
    """Raise `Unproved` for a machine whose losses have no such theorem: landings that are not plastic, steps, and
    parameters that are called as the numbers in the law of the losses."""
    if claim.machine.restitution:
        raise Unproved(f"impacts are not plastic, with restitution = {claim.machine.restitution!r}")
    found.half.mechanics.stated.refuse_steps(what)
    found.half.mechanics.stated.refuse_names(names, "a number in the law of the losses")


def wrong_numbers(found: ProvedExistence, claim: Claim) -> list[str]:
    """The reasons why the orbit's alpha and times are wrong, in words."""
    reasons = list[str]()
    error = CLAIMS.errors_of_alpha * claim.error + CLAIMS.roundings * abs(claim.alpha)
    balls = found.balls
    if not isfinite(error) or not (balls["alpha"] + arb(0, error)).overlaps(arb(claim.alpha)):
        claimed = f"the orbit says {claim.alpha!r} with an error of {claim.error:.1e}"
        reasons.append(f"alpha: {claimed}, and lies outside the enclosure {found.unknowns['alpha']}")
    for name, claimed_time in (("flight_time", claim.flight_time), ("contact_time", claim.contact_time)):
        if name in balls and claimed_time is not None and not _agrees(balls[name], claimed_time, claim):
            reasons.append(f"{name}: the orbit says {claimed_time!r}, outside the enclosure {found.unknowns[name]}")
    for name in claim.tuned:
        if not _agrees(balls[name], value := claim.unknowns[name], claim):
            reasons.append(f"{name}: the orbit says {value!r}, outside the enclosure {found.unknowns[name]}")
    return reasons


def _agrees(ball: arb, claimed: float, claim: Claim) -> bool:
    """Whether an enclosed number agrees with an orbit's, within the orbit's error."""
    error = CLAIMS.share_of_others * max(abs(claimed), claim.alpha * 1e-3) + CLAIMS.errors_of_others * claim.error
    return isfinite(error) and isfinite(claimed) and bool((ball + arb(0, error)).overlaps(arb(claimed)))


def _wrong_places(found: ProvedExistence, flight: Motion, claim: Claim) -> list[str]:
    """The reasons why the orbit's extension at lift-off and coordinates in mid-flight are wrong, in words."""
    mechanics = found.half.mechanics
    places = [
        place * ball_of_fraction(mechanics.scale.length) for place in flight.passage.finish[: 2 * mechanics.size : 2]
    ]
    ends = dict(zip(mechanics.stated.coordinates, places, strict=True))
    claimed = {f"{name} in mid-flight": (ends[name], value) for name, value in claim.places.items() if name in ends}
    if claim.liftoff_extension is not None:
        counted = flight.chain([mechanics.counts] * len(flight.leg.rates), 0)
        claimed["liftoff_extension"] = flight.first(counted, 0), claim.liftoff_extension
    wrong = [(name, value) for name, (ball, value) in claimed.items() if not _agrees(ball, value, claim)]
    return [f"{name}: the orbit says {value!r}, which is not so" for name, value in wrong]


def flight_statement(found: ProvedExistence) -> ExactStatement:
    """The statement of the half flight in all of its states."""
    return found.statement if found.half.lone is None else found.half.flight()


def _flight(found: ProvedExistence) -> Motion:
    """The half flight in all of its states, along which all formulas are proved to have values."""
    if found.half.lone is None:
        return Motion(found.equations.legs[0], found.root.evaluated.passages[0])
    statement = flight_statement(found)
    equations = Equations(statement, found.equations.intervals)
    box = [found.root.box[found.equations.unknowns.index(name)] for name in statement.unknowns]
    middles, radii = [value.mid() for value in box], [value.rad() for value in box]
    passages = evaluated_on(equations, middles, radii, fineness=found.root.fineness).passages
    equations.check_domains(passages)
    flight = Motion(equations.legs[0], passages[0])
    rates = passages[0].finish[1 : 2 * len(found.half.mechanics.v) : 2]
    if wrong := [i for i, value in enumerate(rates) if not value.contains(0)]:
        raise Unproved(f"the rate of coordinate {wrong[0] + 1} is proved not to vanish in mid-flight")
    return flight


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
    return Verdicts(family, enclosures={name: _widened_enclosure(ball, digits) for name, ball in places.items()})


def motion_conditions(half: HalfOrbit, flight: Motion, contact: Motion | None, names: Sequence[str]) -> Verdicts:
    """The verdicts on the conditions of a motion."""
    checks = {
        "clearance": lambda: _check_gaps(half, flight, contact),
        "separation": lambda: _check_separation(half, flight, contact),
        "contact_force": lambda: _check_force(half, _contact_that_ends(contact)),
        "contact_end": lambda: _check_end(half, _contact_that_ends(contact)),
        "heights": lambda: _check_heights(half, flight, contact),
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
    half; where that is another one, it is also positive in contact."""
    laws, (opens, lands), landing = len(flight.leg.rates), half.mechanics.stated.points, half.landing_gap
    gap = flight.chain([half.gap] * laws, 3)
    if not flight.first(gap, 2).contains(0):
        raise Unproved("the gap's acceleration does not vanish with the contact force")
    with _about(opens):
        flight.check_positive(gap, zero_at_start=3)
    if landing is not None:
        with _about(lands):
            flight.check_positive(flight.chain([landing] * laws, 1))
            _check_in_contact(half, _contact_that_ends(contact), landing)


def _check_in_contact(half: HalfOrbit, contact: Motion, function: ExactExpression) -> None:
    """Prove that a function of the flight state is positive in both halves of the contact."""
    m = half.mechanics
    (inside,) = substitute([function], dict(zip(m.y, m.embedded(m.s), strict=True)))
    for each in dict.fromkeys([inside, *m.contact_reversor.turned([inside], m.s, m.w)]):
        contact.check_positive(contact.chain([each] * len(contact.leg.rates), 1))


def _check_separation(half: HalfOrbit, flight: Motion, contact: Motion | None) -> None:
    assert half.mechanics.separation is not None
    _check_always(half, flight, contact, half.mechanics.separation)


def _check_heights(half: HalfOrbit, flight: Motion, contact: Motion | None) -> None:
    """The stated heights but for the gap itself."""
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
    """Of a contact of one coordinate, what vanishes in mid-contact does so there first: its rate, or its place beside
    the centre where the reversor of the contact takes it to the other side; of several, the equations require all."""
    m, laws = half.mechanics, len(contact.leg.rates)
    if len(m.s) == 1:
        (middle,) = m.contact_reversor.fixed(m.s, m.w)
        value = contact.first(contact.chain([middle] * laws, 0), 0)
        if value.contains(0):
            raise Unproved("the contact may begin in its middle")
        contact.check_positive(contact.chain([middle if value > 0 else -middle] * laws, 1), zero_at_end=True)
