"""Theorems about lossless orbits, proved by interval arithmetic: the method, its lemmas, and the trusted software.

A name in brackets, as (`rigorous_step`), is the module with the corresponding code: in the room `exact` for
statements, in `balls` for numbers and motions, and in this one for theorems, in `hops` for those about hops of the map.

The claim. Let a machine be stated in formulas, with exact decimals or intervals for its parameters (`stated`). A
lossless orbit is a zero of a boundary value statement F(w) = 0, whose unknowns w are the position and the speed of the
launch, half the durations, and the further unknowns of a launch (`statement`). `prove` encloses a zero, and shows that
no other zero is nearby, and that the solution is a motion. With interval parameters all of this is proved for each
value in them.

From the text to the equations. A formula becomes an exact expression (`formulas`, `tree`), in which a numeral is the
decimal that is written, and only identities simplify it (`identities`). The conditions for its operations to be
defined, even where they cancel, are collected and checked along the whole motion. Lagrange's equations follow from the
kinetic energy (`kinetics`) and the forces (`exact_mechanics`), and those of the contact from the closed gap. A float of
the machine stands for the shortest decimal that rounds to it, and a Python function for the formula that it computes,
which is part of the statement.

Numbers. Expressions become programs (`programs`) of Arb's balls, midpoint and radius, rounded outward. Floats are used
for guesses only: of roots, units, steps, tubes and frames. Each guess is then tested in balls.

Lemma 1, a step (`rigorous_step`). Let p be the Taylor polynomial of order K of the solution of x' = f(x) from c, and
E a vector of radii. The distance between p and the solution from a point within E0 of c obeys an integral inequality
with the Jacobian over the tube p([0, h]) +- E and with the defect f(p) - p' = R t**K, R by Lagrange's form. If

    E0 + h |Df| E + |R| h**(K + 1)/(K + 1) < E    in each component,

then each such solution exists on [0, h] and stays in the tube. The Jacobian between a point and p is taken over the
segment between them, which lies in the tube, as the tube is convex at each time.

Lemma 2, a set of motions (`enclosure`). The derivatives D of the flow with respect to its start obey the variational
equations; Lemma 1 encloses them for all starts of the set. By the mean value theorem the state from c + d is that from
c, plus D d with D in the enclosure, componentwise. Products of enclosures are represented in orthogonal frames, to
reduce wrapping.

A motion under a law that is smooth in pieces (`crossing`) is enclosed by Lemma 1 within a piece, while the tube stays
off the breakpoints. The force of the law is continuous, and so are the rates. Where a set crosses a breakpoint, x' and
the variational equations lie in the hull of both laws over a tube that is proved by x0 + [0, h] F(tube) in tube; this
is continued until the whole set is in the next piece. The difference d of two motions obeys d' = A(t) d there, with A
in the hull of both laws' Jacobians over the tube, as the rates are continuous and differentiable on both sides. So the
estimate of the mean value theorem holds across a breakpoint too, also where the slope of the force jumps. A motion that
begins at a breakpoint is first enclosed across it.

A table is stated by rows of decimals: an extension, and the force, its slope and its curvature there. The law between
two rows is the polynomial of degree 5 with these six values, in exact fractions; it is twice continuously
differentiable. Beyond the rows there is no law: it is proved that the motion stays between the first and the last. The
theorem is about this law. How well it describes the measured spring, and the noise of the rows, are not part of it.

Lemma 3, existence and uniqueness (`root`). Krawczyk's operator K(U) = u - Y F(u) + (1 - Y F'(U)) (U - u): if K(U) lies
in the interior of U, then F has exactly one zero in U, and it lies in K(U). For an interval parameter q, F(u) holds the
values for all q, since F(u, q) is in F(u, q0) + F_q(U, Q) (q - q0) by the mean value theorem, so that the statement is
Krawczyk's for each q with the same U. An interval that is too wide is halved, and each part is proved separately. The
radius of uniqueness is the distance by which U extends beyond the enclosure. Later enclosures are intersections of
Krawczyk images of boxes that contain the zero, hence contain it too.

Lemma 4, the whole orbit (`proved_existence`). The equations have only forces that depend on the coordinates, and terms
that are quadratic in the rates, so that they hold with time and all rates reversed. A motion that reaches a state with
all rates 0 is its own mirror image about that time. So half a flight from the launch to such a state is half of a
flight that lands as it was launched; likewise for the contact. Where under constant gravity one extension moves
independently, another linear combination of the coordinates moves on a parabola; F then requires that the rate of the
extension vanishes when that combination is at the top of its parabola, which determines the half time.

A machine may state a reversor R of the flight, with places that change sign about a centre, a relabelling S after the
landing, and the gap that closes at landing (`exact_symmetry`). It is then decided exactly, by identities of quotients
of polynomials in the states, the parameters and function values that are odd or even, that R turns the inertia and the
forces in flight, and Rc = S R those in contact; that both are their own inverses; that Rc takes the closed gap to
itself; and that the second gap is the image of the first under R. A flight from a launch x to a state that R leaves as
it is therefore lands in R x, where the second gap and its rate are 0, as the first and its rate are at x, and a contact
from Rc x to a state that Rc leaves as it is ends in x. What is to be positive throughout is proved in one half of each
phase for the function and for its image: both gaps in flight, the second one in contact, and the forces on the point
that opens and on the one that has landed; the second force is 0 at landing to first order. That S is how the machine
stands after a landing, and that its hinges in flight hold, is part of the statement.

Coordinates that stick (`exact_mechanics`) are 0 in contact in addition to the gap, each held by a force that vanishes
at lift- off too. It is decided exactly that inertia, forces, extensions and heights do not depend on their places,
which R takes to a step less the place and S to the place less that step: so Rc takes 0 to 0. The conditions are then
more than the unknowns of a launch and the times. Parameters that are tuned, the step among them, are further unknowns
of the same statement: they are constant states of each phase, so that Lemmas 1 to 3 hold as they are, and the theorem
is that there are such numbers. Prescribed quantities are further equations. Friction: with the contact force F and the
force T on what sticks, mu F + T and mu F - T vanish at landing, as Rc takes F to itself and T to itself or its
negative; both are positive inside the half contact, their first derivatives at landing too.

A coordinate that sticks at any place is constant in contact: an unknown of the launch, as tuned parameters are. Rc has
to leave it as it is. A gap may then be a formula that vanishes with one coordinate y, as at each y = 0: with y also its
first two derivatives by time are 0 at lift-off, and its third is the slope of the gap by y times that of y. The forces
on the point that opens, across and along the ground, follow from those on y and on what sticks by the slopes of the gap
and of the point's place along the ground. Those on the point that has landed are these at the image of the state by Rc,
as the two points are mirror images. If the gap grazes the ground, it is decided exactly that it and its rate vanish in
each state that R leaves as it is; then it is positive before mid-flight if its second derivative is positive up to
there. In flight the ground bears the weights and the masses times the accelerations of their heights, and moves the
masses along itself, where R leaves the heights as they are and their centre too or turns it over: so these forces are
the same in the other half, or the second its negative.

Lemma 5, signs (`motion`, `proved_motion`). A function g of the states is positive where its enclosure is, also by g(m)
+ g'(T)(T - m). At lift-off the gap, its speed and its acceleration are 0: the first two as the launch is a state of the
contact, the third by the equation of lift-off. If its third derivative is positive on [0, a], then by Taylor's formula
the gap is above t**3 min g'''/6 > 0 on (0, a]. Likewise the contact force, which is 0 at landing by the same equation,
with its first derivative; and the contact speed, which is 0 in mid-contact, read backwards from there.

Lemma 6, the family. Intervals of time on which the rate of the extension has a sign alternate with intervals on which
its derivative has one. On the latter the rate is monotone: it has one zero where the signs before and after differ, and
none where they agree. The last of these intervals contains mid-flight, where the rate is 0, and no other zero. The
zeros before it are counted. Where the reversor does not take the extension to itself, the rate has a sign there.

A family as one continuous curve (`branch`) is proved piece by piece: on each a coordinate runs through an interval, and
Krawczyk's operator is evaluated for all of its values together, along motions that are polynomials in time and in the
position on the piece, with bounds on the remainders (`taylor_model`, `curve_motion`, `tube`). The end of each piece is
proved to be the beginning of the next one (`branch_way`), and folds are counted.

The loss coefficient (`loss`) is enclosed from the enclosures of its factors: the jerk of the gap, the derivative of the
gap by alpha at landing, through the monodromy of the half flight, and the energies.

Attraction (`attraction`): up to a determined distance, launches above a lossless hop converge to it. This is proved
from enclosures of their flights and contacts (`launches`) and of the losses at their landings (`landings`, `bounces`).

Fixed points of the return map with an injection (`hop_theorems`) are solutions of another statement (`exact_hops`),
which follows from the number of impacts of each hop (`hop_word`): hops that return to their launch speed, their events,
and the multiplier, which is enclosed through the derivatives of the events; and, by further derivatives (`hop_jets`),
the point at which a fixed point loses its stability by period doubling.

What is trusted: Arb and python-flint; CPython; Python's own parser of arithmetic; and these rooms, with the exact
expressions of `symbolic` and the kinetic energy of `mechanics`, which a second program can check for proofs of orbits
(`orbits.check_proof`) and of hops (`orbits.check_returns`). Forces that jump, abs and sign are refused, and so are
machines that state no mechanics.

Sources: R. Krawczyk, Computing 4 (1969) 187-201; R. E. Moore, R. B. Kearfott, M. J. Cloud, Introduction to Interval
Analysis, SIAM 2009; T. Kapela, M. Mrozek, D. Wilczak, P. Zgliczynski, CAPD::DynSys, Communications in Nonlinear Science
and Numerical Simulation 101 (2021) 105578; F. Johansson, Arb, IEEE Transactions on Computers 66 (2017) 1281-1292.
"""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .branch_claim import BranchClaim
    from .digits import checked_digits
    from .hops.hop_theorems import ClaimedHops, HopGuess, proof_of_doubling, proof_of_fixed_point
    from .prove import Decimal, Exact, need_flint, prove, prove_absence, prove_branch, prove_claims, prove_fold
    from .theorem import Proof

__all__ = [*public_names(__name__)]
