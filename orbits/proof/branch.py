"""DOC"""

import time
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

from flint import arb, ctx

from ..symbolic.time_limit import time_limit
from .branch_claim import BranchClaim
from .branch_motion import MotionChecks, Stretch
from .branch_piece import CurveEquations
from .branch_way import Way
from .branch_words import ProvedCurve, branch_proof
from .case import ProvedExistence, check_mirrored, existence_of, not_stated, wrong_numbers
from .claim import Claim
from .mechanics import Scale
from .programs import ball_of_fraction
from .refusal import Unproved
from .root import FIRST_BITS
from .stated import StatedMachine, stated_machine
from .taylor_model import model_arithmetic
from .theorem import Proof


def proof_of_branch(claim: BranchClaim, digits: int | None, motion: bool, limit: float) -> Proof:
    """The proof that a family is one curve; see `Family.prove`."""
    began = time.perf_counter()
    check_mirrored(claim.machine.model)
    with time_limit(limit):
        try:
            stated = stated_machine(claim.machine, {})
        except Unproved as error:
            return not_stated(claim.machine, error)
        found, reasons = None, list[str]()
        try:
            with model_arithmetic():
                found = _proved_curve(claim, stated, digits, motion, reasons)
        except Unproved as error:
            reasons.append(f"the curve: {error}")
        return branch_proof(claim, stated, found, motion, reasons, digits, time.perf_counter() - began)


def _proved_curve(
    claim: BranchClaim, stated: StatedMachine, digits: int | None, motion: bool, reasons: list[str]
) -> ProvedCurve:
    middle = claim.points[len(claim.points) // 2]
    speed = float(middle[list(claim.names).index("alpha")])
    scale = Scale.of(speed, claim.first.flight_time / 2, max(claim.first.family, 1))
    equations = CurveEquations(stated, claim.along, scale)
    if missing := [name for name in equations.names if name not in claim.names]:
        raise Unproved(f"the family has no {missing[0]}: follow it by the simplest method")
    ends = tuple(_end(equations, each, digits, reasons) for each in (claim.first, claim.last))
    way = Way(equations, claim, [equations.balls(_by_name(equations, end, value)) for end, value in zip(
        ends, (claim.points[0, -1], claim.points[-1, -1]), strict=True)], digits)  # fmt: skip
    links = way.followed()
    stretches = list[Stretch]()
    if motion:
        checks = MotionChecks(equations, way.solve)
        for link in links:
            stretches += checks.along(
                link.piece, max(float(link.begin.lower()), -1.0), min(float(link.end.upper()), 1.0)
            )
    return ProvedCurve(ends, links, stretches)


def _end(equations: CurveEquations, claim: Claim, digits: int | None, reasons: list[str]) -> ProvedExistence:
    """An end of the curve, proved for the exact value of the parameter there."""
    value = Fraction(Decimal(repr(claim.machine.values[equations.along])))
    bounds = {**equations.stated.parameters, equations.along: (value, value)}
    with ctx.workprec(FIRST_BITS):
        try:
            found = existence_of(claim, replace(equations.stated, parameters=bounds), False, digits)
        except Unproved as error:
            raise Unproved(f"its end at {equations.along} = {float(value)!r}: {error}") from None
        reasons += wrong_numbers(found, claim)
        return found


def _by_name(equations: CurveEquations, end: ProvedExistence, value: float) -> dict[str, arb]:
    """The coordinates of an end, in units of the machine."""
    units = (ball_of_fraction(end.half.unit_of(name)) for name in end.statement.unknowns)
    balls = {name: ball * unit for name, ball, unit in zip(end.statement.unknowns, end.root.box, units, strict=True)}
    return {**balls, equations.along: ball_of_fraction(Fraction(Decimal(repr(float(value)))))}
