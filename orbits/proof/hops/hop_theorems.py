"""Hops of the return map with injection that come back, and where a fixed point loses its stability, proved.

The map takes the launch speed alpha of a machine of two coordinates to the speed at the next lift-off, and adds the
injection to it; see `orbits.returns.return_map`. `exact_hops` has the equations.

Theorem 1. Let the equations of n hops with k_1, ..., k_n impacts have a zero at which, along the enclosed motion,

    1. the gap is positive inside each flight, and closes at its end with a speed;
    2. after all but the last landing of a hop the gap's acceleration is positive: the contact would have to pull;
    3. the contact force is positive from the last landing of a hop until it vanishes at the end, where it falls;
    4. each launch speed alpha_i, and alpha_i - inject, are positive;
    5. alpha_(d+1) is not alpha_1 for any d < n that divides n.

Then the map takes each alpha_i to alpha_(i+1), by a hop with k_i impacts, and alpha_n to alpha_1 = alpha; alpha is a
fixed point of the n-th iterate of the map and of no earlier one; and this iterate is analytic near alpha (for a law in
pieces: continuously differentiable). Its derivative m there is that of `exact_hops`. The fixed point of the map or, for
n > 1, the cycle of hops is asymptotically stable for |m| < 1, and unstable for |m| > 1.

Proof. At the launch the gap and its first two derivatives are 0 (Lemma 5 of `orbits.proof`), and the third is positive,
as 1 is proved there by its sign. So each landing is the first zero of the gap in its flight. The machine leaves
immediately by 2, or stays by 3; it lifts off when the force first vanishes, by the equations at the place of the
launch, and by 4 with a speed that opens the gap as at the launch. So each hop is that of the map, and its last equation
says to which launch it leads. All of these conditions are strict on the closed times of the hops, except at the
beginnings of the flights, where the first derivative of the gap that does not vanish is positive up to some time. So
they hold for all launches near alpha, whose events are simple zeros: their times are analytic functions of alpha by the
implicit function theorem. Breakpoints of a law are crossed transversally. The least period divides n, and is not a
proper divisor of it by 5. The statement on stability holds for any differentiable map of the line, as the iterate is
one.

Theorem 2. Let the equations and their first derivatives by alpha have a zero with the multiplier -1, for an injection
that is an unknown, which Krawczyk's operator proves, and the conditions 1 to 4. Let P be the map without injection.
Then P'' is not 0 there: the equations reduce to P + inject - alpha = 0 and P' + 1 = 0, whose Jacobian has the
determinant -P''. The fixed points nearby are a curve alpha(inject) with the slope 1/(1 - m) = 1/2, along which the
multiplier changes at the rate P''/2, which is not 0. If besides a = P''**2/2 + P'''/3 is not 0, hops of period two
begin there: for injections near it on one side there is a cycle of them, for a > 0 stable, and on the side where the
fixed point is unstable; for a < 0 unstable, and on the other side (J. Guckenheimer, P. Holmes, Nonlinear Oscillations,
Dynamical Systems, and Bifurcations of Vector Fields, Springer 1983, theorem 3.5.1).

A fixed point needs an injection above 0, as landings only lose. Without any, all are lossless orbits: they land with no
speed, and these equations are singular.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

from flint import arb, ctx

from ...balls import FIRST_BITS, Equations, IntervalParameters, ball_of_fraction, between, evaluated_on
from ...errors import InputError
from ...exact import (
    NOT_ACROSS,
    Bounds,
    Decimals,
    Enclosure,
    ExactMechanics,
    Scale,
    StatedMachine,
    Undecided,
    Unproved,
    bounds_of_fractions,
    decimal_text,
    enclosure_of,
    exact_bounds,
    parameter_of,
    radius_of,
    range_text,
    stated_machine,
    unknown,
)
from ...model import Machine, machine_in_words
from ..claim_options import CLAIMS
from ..digits import with_enough_digits
from ..orbit_case import not_stated
from ..proved_motion import PROVED
from ..theorem import Part, Proof
from ..wording import enclosed_words
from .exact_hops import INJECTION, HopStatement, hop_statement
from .hop_jets import Jet, doubling_statement, next_jet, pace_of
from .hop_word import HopWord
from .proved_hop import ProvedHop, conditions_of_hop, proved_hop

MAP_IN_WORDS = (
    "A hop flies from a lift-off, with the launch speed alpha, until the gap closes, and lands plastically; where the "
    "contact would have to pull it leaves at once and flies on, else it stays until the contact force vanishes, and "
    "lifts off. The return map takes alpha to the speed there, with inject added to it."
)
CONDITIONS_OF_HOPS = {
    "clearance": "the gap is open throughout each open flight, and closes with a speed",
    "bounces": "after each landing but the last the contact would have to pull",
    "contact_force": "after the last landing the contact pushes until it lifts off",
    "liftoff": "the speed of the lift-off is positive",
    "separation": "the separation stays positive throughout",
    "least_period": "the first launch speed comes back after no smaller number of hops",
}


@dataclass(frozen=True)
class HopGuess:
    """Guesses of the unknowns of hops that come back, in the machine's units.

    liftoff : the place of the launch
    launches : the launch speed of each hop
    flights, contacts : times of the flights and of the contact of each
    inject : the injection
    """

    liftoff: float
    launches: tuple[float, ...]
    flights: tuple[tuple[float, ...], ...]
    contacts: tuple[float, ...]
    inject: float

    @property
    def word(self) -> HopWord:
        """The word of the hops."""
        return HopWord(tuple(map(len, self.flights)))

    def unknowns(self, hop: HopStatement) -> dict[str, float]:
        """The guesses by the names of the unknowns."""
        times = [time for own, last in zip(self.flights, self.contacts, strict=True) for time in (*own, last)]
        named = dict(zip((*hop.word.launches, *hop.word.times), (*self.launches, *times), strict=True))
        return {"liftoff": self.liftoff, **named, INJECTION: self.inject}


@dataclass(frozen=True)
class ClaimedHops:
    """The claims about hops that come back.

    launches : the launch speeds
    error : of these, in addition to what the map's rounding explains
    multiplier, impacts : None where they are not claimed; the impacts are those of each hop
    """

    launches: tuple[float, ...]
    multiplier: float | None = None
    impacts: tuple[int, ...] | None = None
    error: float = 0.0


def proof_of_fixed_point(
    machine: Machine, guess: HopGuess, inject: Decimals, said: ClaimedHops | None, parameters: Mapping[str, Decimals],
    digits: int | None,
) -> Proof:  # fmt: skip
    """The proof of hops near a guess that come back, with what is claimed of them; see `prove_fixed_point`."""
    injected, kind = exact_bounds(INJECTION, inject), "fixed point" if len(guess.launches) == 1 else "periodic hops"
    return _proof(kind, machine, injected, parameters, digits, lambda case: _of_fixed_point(case, guess, said))


def proof_of_doubling(
    machine: Machine, guess: HopGuess, said: tuple[float, float], parameters: Mapping[str, Decimals],
    digits: int | None,
) -> Proof:  # fmt: skip
    """The proof of a doubling near a guess, with the claimed inject and alpha; see `prove_doubling`."""
    return _proof("period doubling", machine, None, parameters, digits, lambda case: _of_doubling(case, guess, said))


@dataclass(frozen=True)
class _Case:
    """The subject of a proof: the machine as it is stated, and the injection, None where it is an unknown."""

    stated: StatedMachine
    inject: Bounds | None
    digits: int | None

    @property
    def bounds(self) -> dict[str, Bounds]:
        """The bounds of all parameters by name."""
        return {**self.stated.parameters, **({INJECTION: self.inject} if self.inject else {})}

    @property
    def intervals(self) -> IntervalParameters:
        """The parameters that are intervals."""
        return IntervalParameters(self.bounds)

    def hop(self, guess: HopGuess, inject: Bounds | None) -> HopStatement:
        """The statement of hops that come back with an injection; None for an unknown."""
        self.stated.refuse_steps("a hop of the map")
        scale = Scale.of(guess.launches[0], guess.flights[0][0] / 2)
        mechanics = ExactMechanics(self.stated, scale)
        if mechanics.size != 2:
            raise Unproved("a launch has several numbers, so there is no map of launch speeds")
        if inject is None:
            return hop_statement(mechanics, guess.word, unknown(INJECTION))
        low, high = (each / scale.speed for each in inject)
        return hop_statement(mechanics, guess.word, parameter_of(INJECTION, low, high))


@dataclass(frozen=True)
class _Result:
    """The results of a proof: the zero, further enclosures and sentences, verdicts, reasons for the rest, and how many
    of these more digits may remove."""

    found: ProvedHop | None = None
    enclosures: dict[str, Enclosure] = field(default_factory=dict)
    sentences: list[str] = field(default_factory=list)
    conditions: Mapping[str, str] = field(default_factory=dict)
    reasons: list[str] = field(default_factory=list)
    undecided: int = 0


def _proof(
    kind: str, machine: Machine, inject: Bounds | None, parameters: Mapping[str, Decimals], digits: int | None,
    prove_case: Callable[[_Case], _Result],
) -> Proof:  # fmt: skip
    began = time.perf_counter()
    try:
        stated = stated_machine(machine, parameters)
    except Unproved as error:
        return replace(not_stated(machine, error), kind=kind)
    if INJECTION in stated.parameters:
        raise InputError(f"a parameter called '{INJECTION}' has the name of the injection; rename it")

    def attempt(digits: int | None, before: _Result | None) -> _Result:
        try:
            with ctx.workprec(FIRST_BITS):
                return prove_case(_Case(stated, inject, digits))
        except Unproved as error:
            if before and before.found:
                raise
            return _Result(reasons=[f"the {kind}: {error}"], undecided=isinstance(error, Undecided))

    def undecided(each: _Result) -> bool:
        return not case.intervals and 0 < each.undecided == len(each.reasons)

    case = _Case(stated, inject, digits)
    result, digits, left = with_enough_digits(attempt, undecided, digits)
    reasons = *result.reasons, *left
    bounds = {name: bounds_of_fractions(each) for name, each in case.bounds.items()}
    enclosures, part = dict[str, Enclosure](), None
    if result.found:
        part = result.found.part(bounds)
        main = (*result.found.further, *result.found.base.statement.unknowns)
        enclosures = {**{name: part.unknowns[name] for name in main}, **result.enclosures}
    return Proof(
        proved=not reasons,
        statement=" ".join([stated.words(), MAP_IN_WORDS, *_sentences(case, result, part)]),
        machine=machine_in_words(machine),
        kind=kind,
        stated=stated.document() | {"injection": None if inject is None else [*map(decimal_text, inject)]},
        parameters=bounds,
        enclosures=enclosures,
        parts=(part,) if part else (),
        radius=radius_of(part.unknowns["alpha"]) if part else None,
        uniqueness_radius=part.uniqueness_radius if part else None,
        conditions=result.conditions,
        reasons=reasons,
        digits=digits,
        seconds=time.perf_counter() - began,
    )


def _of_fixed_point(case: _Case, guess: HopGuess, said: ClaimedHops | None) -> _Result:
    """The results on a fixed point, or on hops of a longer period."""
    assert case.inject is not None
    hop = case.hop(guess, case.inject)
    equations = Equations(hop.statement, case.intervals)
    found = proved_hop(hop, {}, equations, guess.unknowns(hop), case.digits)
    inject = between(*map(ball_of_fraction, case.inject))
    motion = conditions_of_hop(found, inject)
    reasons = [*motion.reasons]
    multiplier = 1 + found.jet(0, found.balls).last
    enclosures = {"multiplier": enclosure_of(multiplier)}
    stable = abs(multiplier) < 1
    if not (stable or abs(multiplier) > 1):
        reasons.append(f"stability: the multiplier lies in {enclosures['multiplier']}, which holds 1 or -1")
    reasons += _wrong_claims(found, multiplier, said)
    period = hop.word.period
    of, what = ("map", "fixed point is") if period == 1 else (f"map's iterate of {period} hops", "hops are")
    words = f"The multiplier, which is the derivative of the {of} there, is in {enclosures['multiplier']}"
    if stable or abs(multiplier) > 1:
        words += f": the {what} {'asymptotically stable' if stable else 'unstable'}"
    return _Result(found, enclosures, [f"{words}."], motion.conditions, reasons, motion.undecided)


def _wrong_claims(found: ProvedHop, multiplier: arb, said: ClaimedHops | None) -> list[str]:
    """The reasons why claims are wrong; the error of a launch grows where the map runs along the identity line."""
    if said is None:
        return []
    hop, reasons, who = found.base, list[str](), "fixed point says" if len(said.launches) == 1 else "hops say"
    along = max(1.0, 1 / float(abs(1 - multiplier).abs_lower() + arb(2) ** -60))
    for name, place in zip(hop.word.launches, said.launches, strict=True):
        allowed = arb(0, CLAIMS.roundings_of_map * abs(place) * along + said.error)
        if not (found.ball(name) + allowed).overlaps(arb(place)):
            enclosed = enclosure_of(found.ball(name))
            reasons.append(f"{name}: the {who} {place!r}, outside the enclosure {enclosed}")
    slope = said.multiplier
    if slope is not None and not (multiplier + arb(0, CLAIMS.share_of_slope * (1 + abs(slope)))).overlaps(arb(slope)):
        reasons.append(f"multiplier: the {who} {slope!r}, outside {enclosure_of(multiplier)}")
    if said.impacts is not None and said.impacts != hop.word.impacts:
        reasons.append(f"impacts: the {who} {said.impacts}, and the equations are those of {hop.word.impacts}")
    return reasons


def _of_doubling(case: _Case, guess: HopGuess, said: tuple[float, float]) -> _Result:
    """The results on a period doubling."""
    hop = case.hop(guess, None)
    if hop.half.mechanics.pieces:
        raise InputError(f"a period doubling is not proved: {NOT_ACROSS}")
    further = {INJECTION: unknown(INJECTION)}
    jet = _guessed_jet(case, guess)
    hop = replace(hop, pace=pace_of(jet.unknowns, hop.statement))
    directions = {
        name: float(each.mid() * ball_of_fraction(hop.unit_of(name) * hop.pace)) for name, each in jet.unknowns.items()
    }
    equations = Equations(doubling_statement(hop, further[INJECTION]), case.intervals)
    found = proved_hop(hop, further, equations, guess.unknowns(hop) | directions, case.digits)
    motion = conditions_of_hop(found, found.ball(INJECTION))
    reasons = [*motion.reasons]
    second = found.jet(1, found.jets)
    third = found.jet(2, {**found.jets, **second.unknowns})
    speed = ball_of_fraction(hop.half.mechanics.scale.speed)
    rate, cubic = second.last / 2 / speed, (second.last**2 / 2 + third.last / 3) / speed**2
    enclosures = {"multiplier_rate": enclosure_of(rate), "cubic_coefficient": enclosure_of(cubic)}
    words = [f"Its multiplier is -1, and changes with inject at a rate in {enclosures['multiplier_rate']}."]
    if rate.contains(0) or cubic.contains(0):
        reasons.append("the rate of the multiplier, and the coefficient of the cycles, are not proved to have a sign")
    else:
        side = "above" if (rate < 0) == (cubic > 0) else "below"
        words.append(
            f"So it passes through -1 there, and a cycle of two hops begins: for injections just {side} it is "
            f"{'stable' if cubic > 0 else 'unstable'}, as half the square of the map's second derivative and a third "
            f"of its third derivative are together in {enclosures['cubic_coefficient']}."
        )
    for name, value in zip((INJECTION, "alpha"), said, strict=True):
        if not (found.ball(name) + arb(0, CLAIMS.share_of_flip * (1 + abs(value)))).overlaps(arb(value)):
            reasons.append(f"{name}: the flip says {value!r}, outside the enclosure {enclosure_of(found.ball(name))}")
    return _Result(found, enclosures, words, motion.conditions, reasons, motion.undecided)


def _guessed_jet(case: _Case, guess: HopGuess) -> Jet:
    """Guesses of the derivatives of the unknowns by alpha, from the equations at the guess."""
    inject = Fraction(guess.inject)
    hop = case.hop(guess, (inject, inject))
    equations = Equations(hop.statement, case.intervals)
    units = {name: float(hop.unit_of(name)) for name in equations.unknowns}
    centre = [arb(guess.unknowns(hop)[name] / unit) for name, unit in units.items()]
    point = evaluated_on(equations, centre, [arb(0)] * len(centre), wide=False)
    return next_jet(hop.statement, 0, point.slopes, {})


def _sentences(case: _Case, result: _Result, part: Part | None) -> list[str]:
    """The sentences on the results of a proof."""
    inject = "an unknown inject" if case.inject is None else f"inject {range_text(case.inject)}"
    if result.found is None or part is None:
        return [f"Nothing is proved of hops that come back with {inject}."]
    each = "For each value in these intervals the" if case.intervals else "The"
    word = result.found.base.word
    hops = f"{word.in_words()}{'' if case.inject else ' with the multiplier -1'}"
    words = [
        f"With {inject}: {each} equations of {hops} have a solution with "
        f"{enclosed_words(part.unknowns)}{'' if case.inject else '; a d before a name is the derivative by alpha'}.",
        f"No other solution has all of these ({', '.join(part.unknowns).replace('_', ' ')}) within "
        f"{part.uniqueness_radius} of these enclosures.",
    ]
    proved = [CONDITIONS_OF_HOPS[name] for name, verdict in result.conditions.items() if verdict == PROVED]
    if len(proved) < len(result.conditions):
        return [*words, f"Of its motion: {'; '.join(proved)}."] if proved else words
    what = (
        f"They are hops of the return map of the least period {word.period}"
        if word.period > 1
        else "It is a fixed point of the return map"
    )
    return [*words, f"{what}: {'; '.join(proved)}.", *result.sentences]
