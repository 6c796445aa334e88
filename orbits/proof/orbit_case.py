"""The proof of the claims of an orbit: that it exists, is unique nearby, is of its family and is a motion."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from flint import ctx

from ..balls import FIRST_BITS, Motion
from ..errors import InputError
from ..exact import (
    CONTACT_DURATION,
    Claim,
    StatedMachine,
    Undecided,
    Unproved,
    bounds_of_fractions,
    decimal_text,
    enclosure_of,
    radius_of,
)
from ..model import Machine, machine_in_words
from .attraction import Hop, attraction_of
from .claimed_numbers import wrong_numbers, wrong_places
from .digits import bits_of_digits, with_enough_digits
from .loss import enclosed_loss
from .proved_existence import ProvedExistence, existence_of, flight_statement, narrowed_existence, whole_flight
from .proved_motion import (
    CONDITIONS,
    CONDITIONS_OF_RUNS,
    CONDITIONS_OF_STANCES,
    PROVED,
    UNDECIDED,
    Verdicts,
    counted_family,
    motion_conditions,
)
from .theorem import Part, Proof
from .wording import attraction_sentence, loss_sentence, motion_sentence, root_sentence

MAIN_UNKNOWNS = ("alpha", "flight_time", "contact_time")


def check_mirrored(model: Any) -> None:
    """Raise `InputError` for a model whose orbits are not their own mirror images."""
    if model.reversor is None:
        why = "loses energy, for example in a damper, or states no reversor, so its motion is not symmetric in time"
        raise InputError(f"this {model.name} {why}: nothing can be proved of its orbits")


def not_stated(machine: Machine, reason: Unproved, conditions: Mapping[str, str] | None = None) -> Proof:
    """The proof, with nothing proved, for a machine that no theorem can state."""
    words = machine_in_words(machine)
    statement = f"Nothing is proved of the {words['machine']}: no theorem can state it."
    reasons = (f"the machine: {reason}",)
    return Proof(proved=False, statement=statement, machine=words, conditions=conditions or {}, reasons=reasons)


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
    names += (*(CONDITIONS_OF_RUNS if stated.sticks else ()), *(CONDITIONS_OF_STANCES if stated.places else ()))

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
        motion_sentence(verdicts.family, verdicts.conditions, verdicts.enclosures, stated),
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


def _verdicts(
    found: ProvedExistence, claim: Claim, names: Sequence[str], loss: bool, digits: int | None, about_claim: bool
) -> Verdicts:
    """The verdicts on the motion, for these conditions, and on the orbit's claims."""
    reasons = tuple(wrong_numbers(found, claim)) if about_claim else ()
    if not (names or loss):
        return Verdicts(reasons=reasons)
    try:
        flight = whole_flight(found)
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
            wrong.append(f"family: {turns}, but the orbit states {claim.family}")
        wrong += [f"the orbit itself states that it is not a motion: {each}" for each in claim.violations]
        wrong += wrong_places(found, flight, claim)
    ends = CONTACT_DURATION in found.statement.unknowns
    contact = Motion(found.equations.legs[-1], found.root.evaluated.passages[-1]) if ends else None
    verdicts = motion_conditions(found.half, flight, contact, names)
    reasons, undecided = (*counted.reasons, *wrong, *verdicts.reasons), counted.undecided + verdicts.undecided
    return replace(counted, conditions=verdicts.conditions, reasons=reasons, undecided=undecided)


def _loss_verdict(found: ProvedExistence, flight: Motion, claim: Claim, conditions: Mapping[str, str]) -> Verdicts:
    """The verdict on the loss coefficient: there are hops near the orbit only if it is a motion."""
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
