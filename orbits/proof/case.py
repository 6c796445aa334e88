"""The proof of what an orbit says: that it exists, is alone nearby, is of its family and is a motion."""

import time
from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any

import casadi as ca
from flint import arb, ctx

from ..errors import InputError
from ..model.machine import Machine, check_parameters, machine_in_words
from ..model.model import Model
from ..model.phase import Arc, Statement
from ..periodic.formulations import CONTACT_FORCE, contact_reversor, half_orbit
from ..symbolic.formula import symbolic_numerals
from .claim import CONTACT_DURATION, Claim
from .decimals import bounds_of_fractions, enclosure_of, lower_decimal, upper_decimal
from .enclosure import Passage
from .exact import BallLeg, Decimals, Equations, Numbers
from .loss import enclosed_loss
from .motion import Motion, Refuted
from .refusal import Unproved
from .root import FIRST_BITS, ProvedRoot, evaluated_on, prove_root
from .theorem import Enclosure, Proof
from .wording import machine_sentence, motion_sentence, parameter_texts, root_sentence, units_sentence

BITS_PER_DIGIT = 3.33
# Bits that are asked for where no number of digits is.
USUAL_BITS = 60
MOST_DIGITS = 300
# What an orbit says of alpha is right if it is within its own error, twice over, and a few units of the last place.
CLAIMED, CLAIM_ROUNDINGS = 2.0, 8 * 2.0**-52
NO_CONTACT = "the orbit has no contact that ends, of which anything could be proved"
PROVED, REFUTED, UNDECIDED = "proved", "refuted", "undecided"


def scene_texts(claim: Claim, parameters: Mapping[str, Decimals]) -> dict[str, str]:
    """What the parameters are exactly, by name, without those that only set a scene."""
    texts = parameter_texts(exact_numbers(claim.machine, parameters))
    for name in (claim.machine.model.homotopy, claim.machine.model.gauge):
        texts.pop(name or "", None)
    return texts


def whole_proof(
    claim: Claim, digits: int | None, parameters: Mapping[str, Decimals], motion: bool, loss: bool,
    about_alpha: bool = True,
) -> Proof:  # fmt: skip
    """The proof for all values of the parameters at once; whether with what is said of alpha, which is not that of each
    part of an interval."""
    began = time.perf_counter()
    case = Case(claim, parameters, digits)
    with ctx.workprec(FIRST_BITS):
        case.prove(motion, loss, about_alpha)
    return Proof(
        proved=not case.reasons,
        statement=case.told(),
        machine=machine_in_words(claim.machine),
        family=case.family,
        parameters=parameter_bounds(case.numbers),
        enclosures=case.enclosures,
        radius=case.radius,
        uniqueness_radius=case.uniqueness_radius,
        conditions=case.conditions,
        reasons=tuple(case.reasons),
        digits=digits,
        seconds=time.perf_counter() - began,
    )


def parameter_bounds(numbers: Numbers) -> dict[str, Enclosure]:
    """The exact bounds of the parameters by name."""
    return {name: bounds_of_fractions(bounds) for name, bounds in numbers.values.items()}


def exact_numbers(machine: Machine, parameters: Mapping[str, Decimals]) -> Numbers:
    """The exact parameters of a machine; raises `InputError` for names that it has not or that cannot be varied, and
    for values that it cannot have."""
    if parameters:
        check_parameters(machine, *parameters)
    numbers = Numbers(machine.values, parameters)
    for end in (0, 1):
        machine.with_values(**{name: float(numbers.values[name][end]) for name in parameters})
    return numbers


def checked_digits(digits: int | None) -> int | None:
    """A number of digits that can be asked for; raises `InputError` for another."""
    if digits is not None and (
        isinstance(digits, bool) or not (isinstance(digits, int) and 1 <= digits <= MOST_DIGITS)
    ):
        raise InputError(f"digits = {digits!r}; it is a whole number from 1 to {MOST_DIGITS}")
    return digits


def bits_of_digits(digits: int | None) -> int:
    """How many bits enclose so many decimal digits; the usual number for None."""
    return USUAL_BITS if digits is None else int(BITS_PER_DIGIT * (digits + 2))


def statement_to_prove(model: Model, with_contact: bool) -> Statement:
    """The boundary value statement of an orbit: the smallest of its flight and, unless that has it already, half of the
    contact, up to where its speed vanishes."""
    flight = model.reduction.statement if model.reduction else half_orbit(model)
    if not with_contact or CONTACT_DURATION in flight.unknowns:
        return flight
    place = contact_reversor(model.reversor, model.embed) if model.reversor else ()
    contact = Arc(
        model.contact,
        start=lambda u, before, p: model.touchdown(u, p),
        duration=lambda u, p: u[CONTACT_DURATION],
        conditions=lambda u, x, p: [value for value, sign in zip(x, place, strict=True) if sign < 0],
    )
    unknowns, durations = (*flight.unknowns, CONTACT_DURATION), (*flight.durations, CONTACT_DURATION)
    return Statement(f"{flight.name} with contact", unknowns, (*flight.arcs, contact), durations)


class Case:
    """One proof as it grows.

    numbers : the exact parameters
    statement, root : the boundary value statement, and its proved root
    family, enclosures, conditions, reasons : as in `Proof`
    """

    def __init__(self, claim: Claim, parameters: Mapping[str, Decimals], digits: int | None):
        machine, model = claim.machine, claim.machine.model
        if model.reversor is None:
            raise InputError(f"a {model.name} is not its own mirror image in time: its orbits cannot be proved")
        self.numbers, self.parameters = exact_numbers(machine, parameters), parameters
        self.claim, self.machine, self.model, self.digits = claim, machine, model, digits
        self.family: int | None = None
        self.root: ProvedRoot | None = None
        self.enclosures: dict[str, Enclosure] = {}
        self.conditions: dict[str, str] = {}
        self.reasons: list[str] = []
        self.radius: str | None = None
        self.uniqueness_radius: str | None = None
        self.stable_side: str | None = None

    def prove(self, motion: bool, loss: bool, about_alpha: bool) -> None:
        """Prove existence and uniqueness, and the rest where it is asked for."""
        bits = bits_of_digits(self.digits)
        try:
            self._prove_existence(motion and CONTACT_DURATION in self.claim.unknowns, bits)
        except Unproved as error:
            self.reasons.append(f"existence: {error}")
            self.conditions |= dict.fromkeys(self._names() if motion else (), UNDECIDED)
            return
        self._enclose()
        if about_alpha:
            self._check_alpha()
        if not (motion or loss):
            return
        try:
            flight, leg = self._flight()
        except Unproved as error:
            self.reasons.append(f"the flight: {error}")
            self.conditions |= dict.fromkeys(self._names() if motion else (), UNDECIDED)
            return
        if motion:
            self._prove_motion(flight)
        if loss and self.root is not None:
            try:
                named = dict(zip(self.statement.unknowns, self.root.box, strict=True))
                ball, side = enclosed_loss(self.model, flight, leg, named, ctx.prec)
                # Only a motion attracts.
                self.stable_side = side if motion and not self.reasons else None
                self.enclosures["loss_coefficient"] = enclosure_of(ball)
            except Unproved as error:
                self.reasons.append(f"the loss coefficient: {error}")

    def told(self) -> str:
        """The theorem, as far as it is proved, in words."""
        machine = machine_sentence(machine_in_words(self.machine), scene_texts(self.claim, self.parameters))
        if self.root is None:
            return f"{machine} Nothing is proved of an orbit with alpha near {self.claim.alpha!r}."
        names, each = ", ".join(self.statement.unknowns), bool(self.numbers.wide)
        root = root_sentence(names, self.enclosures, self.uniqueness_radius or "0", each)
        side = f" The hop attracts from {self.stable_side}, and not from the other side." if self.stable_side else ""
        units = units_sentence(self.machine.units)
        return " ".join(filter(None, (machine, root, motion_sentence(self.family, self.conditions), units))) + side

    def _names(self) -> tuple[str, ...]:
        """The conditions of a motion that apply."""
        apart = () if self.model.separation(self.numbers.floats()) is None else ("separation",)
        return ("clearance", *apart, "contact_force", "contact_end")

    def _prove_existence(self, with_contact: bool, bits: int) -> None:
        self.statement = statement_to_prove(self.model, with_contact)
        self.equations = Equations(self.statement, self.numbers)
        known = self.claim.unknowns
        if missing := [name for name in self.statement.unknowns if name not in known]:
            raise Unproved(f"the orbit has no {missing[0]}")
        self.root = prove_root(self.equations, [known[name] for name in self.statement.unknowns], bits)

    def ball(self, name: str) -> arb:
        """The enclosure of an unknown."""
        assert self.root is not None
        return self.root.box[self.statement.unknowns.index(name)]

    def _enclose(self) -> None:
        """The decimals of what is known from the root alone."""
        assert self.root is not None
        with ctx.workprec(bits_of_digits(self.digits) + FIRST_BITS):
            alpha = self.ball("alpha")
            self.enclosures["alpha"] = enclosure_of(alpha, self.digits)
            self.enclosures["flight_time"] = enclosure_of(2 * self._duration(), self.digits)
            if CONTACT_DURATION in self.statement.unknowns:
                self.enclosures["contact_time"] = enclosure_of(2 * self.ball(CONTACT_DURATION), self.digits)
            self.radius = upper_decimal(alpha.rad())
            self.uniqueness_radius = lower_decimal(self.root.unique_within())

    def _duration(self) -> arb:
        """The time of half the flight."""
        assert self.root is not None
        equations = self.equations
        with symbolic_numerals(equations.expressions.numerals):
            u = {name: ca.SX.sym(name) for name in self.statement.unknowns}
            duration = ca.SX(self.statement.arcs[0].duration(u, equations.expressions.p))
        inputs = [*u.values(), *equations.expressions.wide]
        (value,) = equations.expressions.program(inputs, [duration])(
            [*self.root.box, *self.numbers.balls(), *equations.expressions.constants()]
        )
        return value

    def _check_alpha(self) -> None:
        """Compare what the orbit says of alpha with what is proved."""
        error = CLAIMED * self.claim.error + CLAIM_ROUNDINGS * abs(self.claim.alpha)
        if not isfinite(error) or not (self.ball("alpha") + arb(0, error)).overlaps(arb(self.claim.alpha)):
            told = f"the orbit says {self.claim.alpha!r} with an error of {self.claim.error:.1e}"
            self.reasons.append(f"alpha: {told}, and lies outside the enclosure {self.enclosures['alpha']}")

    def _flight(self) -> tuple[Motion, BallLeg]:
        """The half flight in the flight states."""
        assert self.root is not None
        arc = self.statement.arcs[0]
        if arc.phase is self.model.flight:
            return self._enclosed(0, self.equations, self.root.evaluated.passages[0]), self.equations.legs[0]
        whole = Arc(
            self.model.flight,
            start=lambda u, before, p: self.model.launch(u, p),
            duration=arc.duration,
            conditions=lambda u, x, p: [],
        )
        equations = Equations(Statement("flight", self.statement.unknowns, (whole,)), self.numbers)
        box = self.root.box
        centre, radii = [value.mid() for value in box], [value.rad() for value in box]
        passage = evaluated_on(equations, centre, radii).passages[0]
        return self._enclosed(0, equations, passage), equations.legs[0]

    @staticmethod
    def _enclosed(number: int, equations: Equations, passage: Passage) -> Motion:
        expressions = equations.expressions
        return Motion(expressions, equations.legs[number].graph, passage)

    def _prove_motion(self, flight: Motion) -> None:
        """Prove the family and the conditions of a motion."""
        assert self.root is not None
        model = self.model
        self._check_mirror(flight)
        try:
            self.family = flight.count_turns(flight.chain(lambda x, data: model.extension.at(x), 2))
        except Unproved as error:
            self.reasons.append(f"family: {error}")
        else:
            self._enclose_extensions(flight)
            if self.family != self.claim.family:
                told = f"the extension turns as in family {self.family}"
                self.reasons.append(f"family: {told}, and the orbit says {self.claim.family}")
        for violation in self.claim.violations:
            self.reasons.append(f"the orbit itself says that it is no motion: {violation}")

        def gap(x: Any, data: Any = ()) -> Any:
            return model.gap(flight.expressions.p).at(x)

        self._condition("clearance", lambda: self._check_gap(flight, gap))
        contact = None
        if CONTACT_DURATION in self.statement.unknowns:
            contact = self._enclosed(-1, self.equations, self.root.evaluated.passages[-1])
        if "separation" in self._names():
            self._condition("separation", lambda: self._check_separation(flight, contact))
        self._condition("contact_force", lambda: self._check_force(contact))
        self._condition("contact_end", lambda: self._check_end(contact))

    def _check_mirror(self, flight: Motion) -> None:
        """See that the flight comes to its own mirror image in mid-flight in all states, also those not solved for."""
        states = zip(self.model.flight.states, flight.passage.finish, self.model.reversor or (), strict=False)
        if wrong := [name for name, value, sign in states if sign < 0 and not value.contains(0)]:
            self.reasons.append(f"the model contradicts itself: {wrong[0]} does not vanish in mid-flight")

    def _condition(self, name: str, check: Callable[[], None]) -> None:
        try:
            check()
            self.conditions[name] = PROVED
        except Unproved as error:
            self.conditions[name] = UNDECIDED
            self.reasons.append(f"{name}: {error}")
        except Refuted as error:
            self.conditions[name] = REFUTED
            self.reasons.append(f"{name}: {error}")

    def _check_gap(self, flight: Motion, gap: Callable) -> None:
        each = flight.chain(gap, 3)
        if not self._begins_at_zero(flight, gap):
            raise Unproved("the model's formulas do not show that the gap and its speed are 0 at lift-off")
        if not flight.first(each, 2).contains(0):
            raise Unproved("the model contradicts itself: the gap's acceleration does not vanish with its lift-off")
        flight.check_positive(each, zero_at_start=3)

    def _begins_at_zero(self, flight: Motion, gap: Callable) -> bool:
        """Whether the gap and its speed vanish at lift-off whatever the unknowns are, by the formulas alone."""
        expressions, leg = flight.expressions, flight.leg
        u = {name: ca.SX.sym(name) for name in self.statement.unknowns}
        with symbolic_numerals(expressions.numerals):
            launch = ca.vertcat(*self.model.launch(u, expressions.p))
            functions = ca.vertcat(
                gap(leg.moving), ca.jtimes(gap(leg.moving), _column(leg.state), _column(leg.rates[0]))
            )
        return ca.substitute(functions, _column(leg.moving), launch).is_zero()

    def _check_separation(self, flight: Motion, contact: Motion | None) -> None:
        def apart(motion: Motion, embed: Any = None) -> Callable:
            distance = self.model.separation(motion.expressions.p)
            return lambda x, data: distance.at(x if embed is None else _embedded(embed, x))

        flight.check_positive(flight.chain(apart(flight), 1))
        if contact is None:
            raise Unproved(NO_CONTACT)
        contact.check_positive(contact.chain(apart(contact, self.model.embed), 1))

    def _check_force(self, contact: Motion | None) -> None:
        if contact is None:
            raise Unproved(NO_CONTACT)
        force = self.model.contact.watch[CONTACT_FORCE]
        each = contact.chain(lambda x, data: force(x, contact.expressions.p, data), 1)
        if not contact.first(each, 0).contains(0):
            raise Unproved("the model contradicts itself: the contact force does not vanish with its lift-off")
        contact.check_positive(each, zero_at_start=1)

    def _check_end(self, contact: Motion | None) -> None:
        if contact is None:
            raise Unproved(NO_CONTACT)
        if self.model.one_speed:
            speed = self.model.contact_speed
            contact.check_positive(contact.chain(lambda x, data: -speed.at(x), 1), zero_at_end=True)
        # Of several speeds the equations demand that all vanish at the end of the half contact, which is mid-contact.

    def _enclose_extensions(self, flight: Motion) -> None:
        """The extension at lift-off and in mid-flight."""
        each = flight.chain(lambda x, data: self.model.extension.at(x), 0)
        self.enclosures["liftoff_extension"] = enclosure_of(flight.first(each, 0), self.digits)
        self.enclosures["mid_flight_extension"] = enclosure_of(flight.last(each, 0), self.digits)


def _column(expressions: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*expressions)


def _embedded(embed: Any, x: Any) -> list[Any]:
    """A contact state as one of the flight."""
    return [sum(weight * part for weight, part in zip(row, x, strict=False) if weight) for row in embed.tolist()]
