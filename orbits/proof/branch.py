"""A family proved as one continuous curve of orbits, with its folds: the theorem, and its proof.

Theorem. Let F(u, q) = 0 be the equations of half an orbit (`statement`) with the parameter q as a further unknown.
There are a continuous curve of solutions X = (u, q), from the one that is enclosed at q = A to the one that is enclosed
at q = B, and pieces of it; on each piece one coordinate of X, which is q or the launch speed, runs one way through an
interval, and the others are enclosed, and unique, in a tube about polynomials of it. The curve has exactly the folds in
q that are enclosed, all of them nondegenerate; between them q runs one way. Where a part of the curve is said to be of
motions, each orbit on it is one, and of the family that is stated.

A piece (`tube`). Let the coordinate X_k = c + d s run, and let the others be p(s) + w. If Krawczyk's operator, for each
s, maps the box |w| <= W into its interior, then there is exactly one solution in it, it is regular, and by the implicit
function theorem it is a smooth function of s: a smooth arc. The operator is evaluated for all s together, in Taylor
models (`taylor_model`), along motions that are enclosed for all s together (`curve_motion`), so that its width does not
grow with the length of the piece, but with the error of the polynomials.

Joints (`branch_way`). The end of one arc is enclosed by the radii of its tube. If this enclosure lies in the box of the
next piece at the same value of X_k (or, where another coordinate runs there, at each value that X_k may have there),
then it is the only solution in that box, and the arcs have this point in common. In the same way the first arc holds
the solution that is proved for q = A exactly, the last one that for q = B. So the union of the arcs, each between
its joints, is a continuous curve. It does not turn back at a joint: the next arc runs the same coordinate the same way,
or else dq/ds is proved to have one sign, the same, on both sides of the joint. If the points of a family lie on several
curves, the proof fails: the end of one arc is not in the next box.

Folds. On an arc that q runs along there is none. On another one the derivative of q is that of the polynomial and of
w, |w'| <= v with v from F_w w' = -F_s. Where its sign is undecided, on a part S of the arc, the equations of folds
F = 0, F_u v = 0 with v = 1 for the launch speed (`fold`) have exactly one zero in a box that is proved to hold all
points of S with the direction of the arc there. A zero of dq/ds on S is a zero of these equations in this box. So there
is at most one; and as the zero that is enclosed lies in the tube, it is on the arc, and there is one. It is regular, so
that q turns quadratically there, and the signs before and after it differ.

Motions (`branch_motion`). The signs of Lemmas 5 and 6 of `orbits.proof` are taken over all orbits of a part of an arc.
The contact is another arc of the motion, whose half time is enclosed in a tube of its own, with the unknowns of the
flight known within theirs. A part on which a sign is undecided is halved some times; what remains, about the places
where a condition is lost, is reported as undecided, and then the whole is not reported as proved.

For laws in pieces no curve is proved: the time at which a breakpoint is crossed changes along it, and the motion there
has no Taylor models.

Sources: J. B. van den Berg, J.-P. Lessard, K. Mischaikow, Mathematics of Computation 79 (2010) 1565-1584, for curves
from a predictor and a radius of uniqueness; M. Breden, J.-P. Lessard, M. Vanicat, Acta Applicandae Mathematicae 128
(2013) 113-152; R. B. Kearfott, Z. Xing, SIAM Journal on Numerical Analysis 31 (1994) 892-914, for interval step
control; M. Berz, K. Makino, Reliable Computing 4 (1998) 361-369, for Taylor models; R. Lohner, in E. Kaucher et al.,
Computerarithmetic, Teubner 1987, for the frames.
"""

import time
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

from flint import arb, ctx

from ..balls import FIRST_BITS, ball_of_fraction, model_arithmetic
from ..exact import Claim, Scale, StatedMachine, Unproved, stated_machine
from ..running import default_limit, time_limit
from .branch_claim import BranchClaim
from .branch_motion import MotionChecks, MotionStretch
from .branch_piece import CurveEquations, floats_about
from .branch_way import Way
from .branch_words import ProvedCurve, branch_proof
from .claimed_numbers import wrong_numbers
from .orbit_case import check_mirrored, not_stated
from .proved_existence import ProvedExistence, existence_of
from .theorem import Proof

# Default limit of the processor time of a proof, in seconds.
LIMIT_OF_BRANCH = 600.0


def proof_of_branch(claim: BranchClaim, digits: int | None, motion: bool, limit: float | None) -> Proof:
    """The proof that a family is one curve; see `Family.prove`."""
    began = time.perf_counter()
    check_mirrored(claim.machine.model)
    with default_limit(LIMIT_OF_BRANCH) if limit is None else time_limit(limit):
        try:
            stated = stated_machine(claim.machine, {}, claim.along)
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
        raise Unproved(f"the family has no {missing[0]}: follow it with the simplest method")
    ends = _proved_end(equations, claim.first, digits, reasons), _proved_end(equations, claim.last, digits, reasons)
    values = claim.points[0, -1], claim.points[-1, -1]
    balls = [equations.balls(_coordinates_of(equations, end, value)) for end, value in zip(ends, values, strict=True)]
    way = Way(equations, claim, balls, digits)
    links = way.followed()
    stretches = list[MotionStretch]()
    if motion:
        checks = MotionChecks(equations, way.solve)
        for link in links:
            stretches += checks.along(link.piece, *floats_about(link.begin, link.end))
    return ProvedCurve(ends, links, stretches)


def _proved_end(equations: CurveEquations, claim: Claim, digits: int | None, reasons: list[str]) -> ProvedExistence:
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


def _coordinates_of(equations: CurveEquations, end: ProvedExistence, value: float) -> dict[str, arb]:
    """The coordinates of an end, in units of the machine."""
    units = (ball_of_fraction(end.half.unit_of(name)) for name in end.statement.unknowns)
    balls = {name: ball * unit for name, ball, unit in zip(end.statement.unknowns, end.root.box, units, strict=True)}
    return {**balls, equations.along: ball_of_fraction(Fraction(Decimal(repr(float(value)))))}
