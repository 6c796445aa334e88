"""A fold of a family, proved: a regular zero of the statement of folds (G. Moore, A. Spence, SIAM Journal on Numerical
Analysis 17, 1980), which is regular only where the family turns quadratically."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from flint import arb, ctx

from ..balls import FIRST_BITS, Equations, IntervalParameters, ProvedRoot, ball_of_fraction, prove_root
from ..errors import InputError
from ..exact import (
    FLIGHT_DURATION,
    NOT_ACROSS,
    Decimals,
    ExactMechanics,
    HalfOrbit,
    Scale,
    StatedMachine,
    Unproved,
    bounds_of_fractions,
    enclosure_of,
    lower_decimal,
    radius_of,
    stated_machine,
    statement_of_folds,
)
from ..model import Machine, machine_in_words
from ..symbolic import substitute, symbol
from .digits import bits_of_digits
from .orbit_case import check_mirrored, not_stated
from .proved_existence import ball_of
from .theorem import Part, Proof
from .wording import enclosed_words

# The other unknowns of a fold are searched for within these shares of the launch speed.
SHARES_OF_SPEED = (0.01, 0.1, 0.001)


def proof_of_fold(
    machine: Machine, unknowns: Mapping[str, float], directions: Mapping[str, float], along: str, value: float,
    parameters: Mapping[str, Decimals], digits: int | None,
) -> Proof:  # fmt: skip
    """The proof of a fold near a guess: unknowns of half an orbit and their directions by name, that of "alpha" being
    1, and the value of the parameter; see `prove_fold`."""
    began, reasons, part = time.perf_counter(), list[str](), None
    check_mirrored(machine.model)
    try:
        stated = stated_machine(machine, parameters, along)
    except Unproved as error:
        return not_stated(machine, error)
    others = {name: bounds for name, bounds in stated.parameters.items() if name != along}
    try:
        with ctx.workprec(FIRST_BITS):
            part = _fold(stated, unknowns, directions, along, value, digits)
    except Unproved as error:
        reasons.append(f"the fold: {error}")
    enclosures = {name: part.unknowns[name] for name in part.unknowns if name in (along, "alpha")} if part else {}
    bounds = {name: bounds_of_fractions(each) for name, each in others.items()}
    each = "For each value of the parameters in their intervals, " if stated.wide else ""
    words = each + (_fold_words(part, along) if part else f"Nothing is proved of a fold in {along}.")
    return Proof(
        proved=part is not None,
        statement=f"{stated.words(free=along)} {words}",
        machine=machine_in_words(machine),
        kind="fold",
        stated=stated.document() | {"parameters": stated.document()["parameters"] | {along: None}},
        parameters=bounds,
        enclosures=enclosures,
        radius=radius_of(part.unknowns["alpha"]) if part else None,
        uniqueness_radius=part.uniqueness_radius if part else None,
        parts=(part,) if part else (),
        reasons=tuple(reasons),
        digits=digits,
        seconds=time.perf_counter() - began,
    )


@dataclass(frozen=True)
class ProvedFold:
    """A proved zero of the equations of folds.

    sizes : the units in which the unknowns are solved for
    balls : enclosures of the unknowns by name, in the units of the machine
    """

    root: ProvedRoot
    sizes: list[arb]
    balls: dict[str, arb]

    def alone_in(self) -> dict[str, arb]:
        """The box by name in which there is no other zero, in the units of the machine."""
        box = zip(self.root.centre, self.root.radii, self.sizes, strict=True)
        return {name: (c + arb(0, r)) * size for name, (c, r, size) in zip(self.balls, box, strict=True)}


def proved_fold(
    stated: StatedMachine, unknowns: Mapping[str, float], directions: Mapping[str, float], along: str, value: float,
    digits: int | None, reach: Mapping[str, arb] | None = None,
) -> ProvedFold:  # fmt: skip
    """The fold near a guess; raises `Unproved`.

    reach : the distance from the guess within which there is to be no other fold, by the name of the unknown
    """
    mechanics = ExactMechanics(
        stated, Scale.of(unknowns["alpha"], unknowns.get(FLIGHT_DURATION, unknowns["alpha"])), along
    )
    half = HalfOrbit(mechanics)
    statement = half.statement(with_contact=False)
    if mechanics.pieces:
        raise InputError(f"a fold is not proved: {NOT_ACROSS}")
    if missing := [name for name in statement.unknowns if name not in unknowns]:
        raise Unproved(f"the fold has no {missing[0]}")
    named = [*statement.unknowns, *(f"d{name}" for name in statement.unknowns), along]
    if twice := sorted({name for name in named if named.count(name) > 1}):
        raise Unproved(f"the name '{twice[0]}' stands for a direction of the family: rename the parameter")
    folded = statement_of_folds(statement, symbol(along))
    units = {name: half.unit_of(name) for name in statement.unknowns}
    units |= {f"d{name}": units[name] / units["alpha"] for name in statement.unknowns if name != "alpha"}
    units |= {along: Fraction(1)}
    guess = {**unknowns, **{f"d{name}": each for name, each in directions.items()}, along: value}
    others = {name: bounds for name, bounds in stated.parameters.items() if name != along}
    equations = Equations(folded, IntervalParameters(others))
    start = [guess[name] / float(units[name]) for name in folded.unknowns]
    boxes = list[list[arb]]()
    if reach:
        radii = [reach[name] / ball_of_fraction(units[name]) for name in folded.unknowns]
        along_curve = radii[list(folded.unknowns).index("alpha")]
        boxes = [[radius.max(share * along_curve).abs_upper() for radius in radii] for share in SHARES_OF_SPEED]
    root = prove_root(equations, start, bits_of_digits(digits), boxes)
    equations.check_domains(root.evaluated.passages)
    with ctx.workprec(bits_of_digits(digits) + FIRST_BITS):
        sizes = [ball_of_fraction(units[name]) for name in folded.unknowns]
        balls = {name: ball * size for name, ball, size in zip(folded.unknowns, root.box, sizes, strict=True)}
        (half_flight,) = substitute([half.half_flight], {symbol(along): folded.unknowns[along]})
        if not ball_of(half_flight, folded, equations, root) > 0:
            raise Unproved("the time of the flight is not proved to be positive")
    return ProvedFold(root, sizes, balls)


def _fold(
    stated: StatedMachine, unknowns: Mapping[str, float], directions: Mapping[str, float], along: str, value: float,
    digits: int | None,
) -> Part:  # fmt: skip
    """The enclosures of a fold."""
    found = proved_fold(stated, unknowns, directions, along, value, digits)
    with ctx.workprec(bits_of_digits(digits) + FIRST_BITS):
        enclosures = {name: enclosure_of(ball, digits) for name, ball in found.balls.items()}
        alone = lower_decimal(found.root.unique_within(found.sizes))
    bounds = {name: bounds_of_fractions(each) for name, each in stated.parameters.items() if name != along}
    return Part(bounds, enclosures, alone)


def _fold_words(part: Part, along: str) -> str:
    place = f"The equations of the flight of its orbits have a fold in {along}, with {enclosed_words(part.unknowns)}"
    varied = "names that begin with d are those of the direction of the family there, in which alpha changes by 1"
    regular = "It is nondegenerate: the equations of the fold are regular there, so that the family turns quadratically"
    alone = f"No other zero of these has all unknowns within {part.uniqueness_radius} of these enclosures"
    return f"{place}; {varied}. {regular}. {alone}."
