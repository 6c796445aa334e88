"""The loss coefficient of the hops beside a lossless one, enclosed.

Beside a lossless hop the map of launch speeds is alpha + d -> alpha + d - C d**(4/3) + o(d**(4/3)) for d on the stable
side, where the gap at the landing time is positive (see `periodic.local_law`). So where C > 0 is proved and with it the
sign of the gap's derivative by alpha, the hop attracts from that side, and on the other side the launch speed falls.
"""

from collections.abc import Mapping, Sequence

import casadi as ca
from flint import arb, arb_mat, ctx

from ..model.model import Model
from ..symbolic.formula import symbolic_numerals
from .enclosure import FINE, follow_set, unit_matrix
from .exact import BallLeg
from .motion import Motion
from .programs import UNDEFINED
from .refusal import Unproved


def enclosed_loss(
    model: Model, flight: Motion, leg: BallLeg, unknowns: Mapping[str, arb], bits: int
) -> tuple[arb, str]:
    """An enclosure of C, and the side on which the hop attracts, "above" or "below".

    flight : the half flight in the flight states, whose leg has all programs
    unknowns : enclosures by name
    """
    if not model.one_speed:
        raise Unproved("a launch is more than a speed: no map of launch speeds tells what is lost")
    assert model.reversor is not None
    expressions, m = flight.expressions, len(model.flight.states)
    with symbolic_numerals(expressions.numerals):
        data = flight.leg.laws[flight.passage.pieces[0].laws[0]]
        u, p = {name: ca.SX.sym(name) for name in unknowns}, expressions.p
        launch = [ca.SX(each) for each in model.launch(u, p)]
        by_alpha = ca.jacobian(ca.vertcat(*launch), u["alpha"])
        if model.liftoff_slope:
            by_alpha = by_alpha + ca.jacobian(ca.vertcat(*launch), u["liftoff"]) * model.liftoff_slope(u, p)
        landing = [sign * each for sign, each in zip(model.reversor, launch, strict=True)]
        gradient = [ca.SX(each) for each in model.flight_gradient(launch, p, data)]
        power = ca.dot(ca.vertcat(*gradient), by_alpha)
        weights = [ca.SX(each) for each in model.gap(p).weights]
        outputs = [ca.SX(model.impact_mass(landing, p)), power, *ca.vertsplit(ca.densify(by_alpha)), *weights]
    program = expressions.program([*u.values(), *expressions.wide], outputs)
    stills = flight.passage.start[m + 1 :]
    mass, power_ball, *rest = program([*unknowns.values(), *stills, *expressions.constants()])
    # From the narrowest enclosures of the unknowns, not from the wider set of the enclosed motion.
    start = leg.start([*unknowns.values(), *stills, *expressions.constants()])
    try:
        with ctx.workprec(2 * bits):
            half = _transition(leg, start, expressions.constants(), m, bits)
    except UNDEFINED:
        raise Unproved("the motion comes to where a law has no value") from None
    mirror = arb_mat(m, m, [sign if i == j else 0 for i, sign in enumerate(model.reversor) for j in range(m)])
    try:
        at_landing = mirror * half.solve(mirror * (half * arb_mat(m, 1, rest[:m])))
    except ZeroDivisionError:
        raise Unproved("the derivatives of the flight are not enclosed narrowly enough") from None
    slope = sum((weight * at_landing[i, 0] for i, weight in enumerate(rest[m : 2 * m])), arb(0))
    gap = flight.chain(lambda x, data: model.gap(expressions.p).at(x), 3)
    law = flight.passage.pieces[0].laws[0]
    (by_leg,) = gap.programs[law][3]([*start, *gap.constants])
    jerk = by_leg / start[m] ** 3
    if not (jerk > 0 and (slope > 0 or slope < 0) and mass > 0 and power_ball > 0):
        raise Unproved("the signs of the jerk at landing and of the gap's change with alpha are not decided")
    loss = mass * jerk**2 / 8 * (6 * abs(slope) / jerk) ** (arb(4) / 3) / power_ball
    return loss, "above" if slope > 0 else "below"


def _transition(leg: BallLeg, start: Sequence[arb], constants: Sequence[arb], m: int, bits: int) -> arb_mat:
    """The derivatives (m, m) of the state in mid-flight by the state at lift-off, over fixed times."""
    n = len(start)
    radii = arb_mat(n, 1, [arb(0, value.rad()) for value in start])
    middles, breakpoints = [value.mid() for value in start], leg.breakpoints(start[m + 1 :])
    passage = follow_set(leg.variation, constants, middles, unit_matrix(n), radii, bits, FINE, breakpoints)
    return arb_mat([row[:m] for row in passage.slopes.tolist()[:m]])
