"""The loss coefficient of the hops near a lossless one, enclosed. Near a lossless hop the map of launch speeds is alpha
+ d -> alpha + d - c |d|**(4/3) + o(|d|**(4/3)), with c = C on the side where the gap at the landing time is positive,
so that the foot lands once, and c = 10 C on the other, where it bounces once (see `periodic.loss_coefficient`). Which
side has the bounce follows from the sign of the gap's derivative by alpha. Within which distance the hop attracts the
launches above it is another theorem (`attraction`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flint import arb, arb_mat, ctx

from ..balls import FINE, UNDEFINED, BallLeg, BallProgram, Motion, ball_of_fraction, follow_set, unit_matrix
from ..exact import HalfOrbit, Undecided, Unproved
from ..symbolic import ExactExpression, derivative_by, expression, inner_product, substitute


@dataclass(frozen=True)
class Loss:
    """An enclosure of C, and the side on which hops land with a bounce, "above" or "below".

    delay : (delay |d|)**(1/3) is the time by which hops near it land later, or earlier, to leading order, in the units
        of the equations
    """

    coefficient: arb
    bounce_side: str
    delay: arb


def enclosed_loss(half: HalfOrbit, flight: Motion, unknowns: Mapping[str, arb], bits: int) -> Loss:
    """The loss near an enclosed half flight in the flight states, with enclosures of the unknowns by name; raises
    `Unproved` where the signs that it requires are not decided."""
    m, leg, (law, *others) = half.mechanics, flight.leg, flight.passage.pieces[0].laws
    if others:
        raise Undecided("the flight begins at a breakpoint of the spring's law, where its jerk may jump")
    if m.size != 2:
        raise Unproved("a launch has several numbers, so there is no map of launch speeds to state the loss")
    mass, power, *by_alpha = launch_expressions(half, law)
    intervals = leg.state[len(leg.moving) + 1 :]
    program = BallProgram([*half.launch_unknowns.values(), *intervals], [mass, power, *by_alpha])
    wide = flight.passage.start[len(leg.moving) + 1 :]
    mass_ball, power_ball, *by_alpha_balls = program([*(unknowns[name] for name in half.launch_unknowns), *wide])
    # From the narrowest enclosures of the unknowns, not from the wider set of the enclosed motion.
    start = leg.start([*unknowns.values(), *wide])
    try:
        with ctx.workprec(2 * bits):
            transition = _transition(leg, start, bits)
    except UNDEFINED:
        raise Unproved("the motion reaches a place where a law has no value") from None
    at_landing = _by_alpha_at_landing(transition, by_alpha_balls)
    (change,) = BallProgram(leg.moving, [half.gap])(at_landing)
    third = flight.chain([half.gap] * len(leg.rates), 3)
    jerk = third.programs[law][3](start)[0] / start[len(leg.moving)] ** 3
    if not (jerk > 0 and (change > 0 or change < 0) and mass_ball > 0 and power_ball > 0):
        raise Undecided("the signs of the jerk at landing and of the gap's change with alpha are not decided")
    delay = 6 * abs(change) / jerk
    loss = mass_ball * jerk**2 / 8 * delay ** (arb(4) / 3) / power_ball
    if not 2 * loss.rad() < loss.lower():  # it would not even say how large the losses are
        raise Unproved("its enclosure is wider than its least value: narrow the intervals of the parameters")
    # C takes a speed to the power 4/3 to a speed.
    unit = ball_of_fraction(m.scale.speed) ** (arb(-1) / 3)
    return Loss(loss * unit, "below" if change > 0 else "above", delay)


def launch_expressions(half: HalfOrbit, law: int) -> list[ExactExpression]:
    """Twice the energy that a landing loses over the square of the gap's speed, the derivative of the energy of a
    launch by alpha, and those (2 n,) of the launch itself, as functions of the launch."""
    m, own = half.mechanics, half.launch_unknowns
    lifted, launch = half.lifted[law], half.launch
    # The place of the launch follows its speed, since the contact force stays 0.
    slope = -derivative_by(lifted, own["alpha"]) / derivative_by(lifted, own["liftoff"])
    by_alpha = [derivative_by(each, own["alpha"]) + derivative_by(each, own["liftoff"]) * slope for each in launch]
    momentum = [inner_product(row, m.v) for row in m.inertia]
    kinetic = inner_product(m.v, momentum) / 2
    by_place = [derivative_by(kinetic, place) - force for place, force in zip(m.y, m.conservative[law], strict=True)]
    gap = [expression(each) for each in m.gap]
    mass = 1 / inner_product(gap, m.kinetics.accelerations(gap))
    places = dict(zip([*m.y, *m.v], [*launch[::2], *launch[1::2]], strict=True))
    mass, *gradient = substitute([mass, *by_place, *momentum], places)
    return [mass, inner_product(gradient, [*by_alpha[::2], *by_alpha[1::2]]), *by_alpha]


def _by_alpha_at_landing(half: arb_mat, by_alpha: Sequence[arb]) -> list[arb]:
    """The derivatives (2 n,) by alpha of the state at landing, by those of the launch and over half a flight: the
    second half is the mirror image of the first, whose speeds are turned."""
    n = len(by_alpha)
    mirror = arb_mat(n, n, [(-1) ** i if i == j else 0 for i in range(n) for j in range(n)])
    try:
        found = mirror * half.solve(mirror * (half * arb_mat(n, 1, list(by_alpha))))
    except ZeroDivisionError:
        raise Unproved("the derivatives of the flight are not enclosed narrowly enough") from None
    return [found[i, 0] for i in range(n)]


def _transition(leg: BallLeg, start: Sequence[arb], bits: int) -> arb_mat:
    """The derivatives (m, m) of the state in mid-flight by the state at lift-off, over fixed times."""
    n, m = len(start), len(leg.moving)
    radii = arb_mat(n, 1, [arb(0, value.rad()) for value in start])
    middles, breakpoints = [value.mid() for value in start], leg.breakpoints(start)
    passage = follow_set(leg.variation, middles, unit_matrix(n), radii, bits, FINE, breakpoints)
    return arb_mat([row[:m] for row in passage.slopes.tolist()[:m]])
