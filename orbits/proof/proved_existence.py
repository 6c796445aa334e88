"""Solutions of the equations of half an orbit that are proved to exist and to be unique nearby."""

from dataclasses import dataclass

from flint import arb, ctx

from ..balls import (
    FIRST_BITS,
    BallProgram,
    Equations,
    IntervalParameters,
    Motion,
    ProvedRoot,
    ball_of_fraction,
    evaluated_on,
    narrowed_root,
    prove_root,
)
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
    Unproved,
    enclosure_of,
    lower_decimal,
    nearest_power_of_two,
)
from ..symbolic import ExactExpression
from .claim_options import CLAIMS
from .digits import DIGITS, bits_of_digits


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


def narrowed_existence(found: ProvedExistence, digits: int | None) -> ProvedExistence:
    """A proved solution, enclosed to a number of digits; raises `Unproved`."""
    root = narrowed_root(found.equations, found.root, bits_of_digits(digits))
    return _existence(found.half, found.statement, found.equations, root, digits)


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
        unknowns = {name: widened_enclosure(ball, digits) for name, ball in balls.items()}
        radius = lower_decimal(root.unique_within(units))
    return ProvedExistence(half, statement, equations, root, balls, unknowns, radius)


def widened_enclosure(ball: arb, digits: int | None) -> Enclosure:
    """An enclosure of positive width: one of width 0 could not be verified by another method."""
    bits = max(bits_of_digits(digits), DIGITS.default_bits)
    return enclosure_of(ball if ball.rad() > 0 else ball + arb(0, abs(ball) * arb(2) ** -bits), digits)


def flight_statement(found: ProvedExistence) -> ExactStatement:
    """The statement of the half flight in all of its states."""
    return found.statement if found.half.lone is None else found.half.flight()


def whole_flight(found: ProvedExistence) -> Motion:
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
