"""The forces of the ground on machines whose masses have places across, and the speeds after a step with an impact.

The ground bears the weight of the masses m at the heights Z, and moves them along itself at the places X:

    N = sum of m (g + Z''),    T = sum of m X''.

So no other force of the mechanism acts on it from outside. Where a step ends with a speed, the point that lands takes
over: only on it there is an impulse, and the momentum along every motion about it stays. With y the coordinates before
and y+ = S y those after, J the gradients of the places, E the signs of S, and s = -1 where S mirrors the plane,

    M(y+) y+' = [I(y+) E + sum of m (JZ(y+)^T JZ(y) + s JX(y+)^T JX(y))] y',

I being what masses at heights and across do not have of the inertia M.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca

from ..errors import InputError
from ..laws.law import Algebraic, Parameters, Scalars
from ..model.phase import weighted_sum
from ..model.planar import NORMAL_FORCE, TANGENTIAL_FORCE, Planar
from ..model.symmetry import SignedShift
from .coefficients import Coefficients
from .elements import Inerter, Mass, Scalar, Weight, paths_of, value_of
from .inertia import Inertia
from .lagrange import Mechanics, forces_of, held_by, stated_inertia
from .stepping import Stepping
from .terms import bend_of, mass_of


class _Reaction(NamedTuple):
    """The two forces in a phase.

    rows : (2, terms of the flight), per force
    by_rates : (place, rates, parameters of these names) -> what is quadratic in the rates, one after the other
    vanish : whether each of the two is 0 on all motions
    """

    rows: Coefficients
    by_rates: ca.Function
    names: tuple[str, ...]
    vanish: tuple[bool, bool]


class Reactions(NamedTuple):
    """The forces of the ground on a mechanism.

    flight, contact : the forces in these phases, of which some springs have no laws yet
    friction : as in `Mechanism`
    handed : the speeds after a step forward and after one back, per speed before; None without hand-overs
    travel : (1, n), the speed of the centre of mass along the ground per speed; None where nothing sticks
    weight : (1, 1), that of the machine on the ground; None where nothing sticks
    across : (1, 1), the place of the centre of mass along the ground
    """

    flight: _Reaction
    contact: _Reaction
    friction: Scalar | None
    handed: tuple[tuple[SignedShift, Coefficients], ...] | None
    travel: Coefficients | None = None
    weight: Coefficients | None = None
    across: Coefficients | None = None

    def watch(self, mechanics: Mechanics, contact: bool) -> dict[str, Callable]:
        """The forces in flight, or in contact, as `Phase.watch` has them."""
        reaction, terms = self.contact if contact else self.flight, mechanics.in_flight.terms

        def force_of(i: int) -> Callable:
            def force(x: Scalars, p: Parameters, q: Scalars) -> Algebraic:
                s, rates = mechanics.positions_and_rates(x, p)
                place = (mechanics.embedded(s), mechanics.embedded(rates)) if contact else (s, rates)
                row = reaction.rows(p, s)[i]
                total = weighted_sum(row, forces_of(terms, [row], place, p, q))
                if not reaction.by_rates.sparsity_out(0).has_nz(i, 0):
                    return total
                arguments = ca.vertcat(*s), ca.vertcat(*rates), ca.vertcat(*(p[name] for name in reaction.names))
                return total + reaction.by_rates(*arguments)[i]

            return force

        return {name: force_of(i) for i, name in enumerate((NORMAL_FORCE, TANGENTIAL_FORCE))}

    @property
    def by_rates(self) -> bool:
        """Whether one of the forces depends on rates."""
        return any(each.by_rates.sparsity_out(0).nnz() for each in (self.flight, self.contact))

    @property
    def planar(self) -> Planar:
        """As in `Model`."""
        share = self.friction
        limit = None if share is None else lambda p: value_of(share, {}, p)
        forward, back = (_taken_over(*each) for each in self.handed) if self.handed else (None, None)
        travel = self.travel and (lambda x, p: weighted_sum(self.travel(p, x[::2])[0], x[1::2]))
        weight = self.weight and (lambda p: self.weight(p, [])[0][0])
        across = self.across and (lambda x, p: self.across(p, x[::2])[0][0])
        return Planar(not self.flight.vanish[0], limit, forward, back, travel, weight, across)


def _taken_over(label: SignedShift, speeds: Coefficients) -> Callable:
    def taken_over(x: Scalars, p: Parameters) -> list[Algebraic]:
        y, v = label.image(x, p)[::2], x[1::2]
        rates = [weighted_sum(row, v) for row in speeds(p, x[::2])]
        return [part for pair in zip(y, rates, strict=True) for part in pair]

    return taken_over


def reactions_of(
    m: Mechanics, inertia: Sequence[Sequence[Scalar]], friction: Scalar | None, steps: Stepping | None
) -> Reactions | None:
    """The reactions of a mechanism, None where no mass states where it is across; raises `InputError` where the maps
    of its steps do not turn its places across."""
    masses = [each for each in m.elements if isinstance(each, Mass)]
    if all(each.across is None for each in masses):
        return None
    c, flight, gap = m.coordinates, m.in_flight, m.gap
    sums, bends = [ca.SX(0), ca.SX(0)], [ca.SX(0), ca.SX(0)]
    for each in masses:
        for i, place in enumerate(paths_of(each)):
            sums[i] += mass_of(c, each.mass) * c.scalar(place)
            bends[i] += mass_of(c, each.mass) * bend_of(c, place)
    if steps and steps.reversible:
        _refuse_unturned(m, steps, sums)
    along = ca.vertcat(*(ca.gradient(each, c.y)[: c.size].T for each in sums))
    rows, heavy = ca.densify(along @ flight.accelerations), ca.SX(0)
    for weight in (each for each in m.elements if isinstance(each, Mass | Weight)):
        place = next(
            j for j, term in enumerate(flight.terms)
            if term.is_weight and (not m.gravity.varies or term.element is weight)
        )  # fmt: skip
        rows[0, place] += mass_of(c, weight.mass) * m.gravity.at_ground(c)
        heavy += mass_of(c, weight.mass) * m.gravity.at_ground(c)
    held = held_by(c, gap, flight, ca.SX.eye(len(flight.terms)))
    in_contact = m.inside(rows) + m.inside(along @ flight.kick) @ held
    rates, embed = ca.SX.sym("w", gap.s.numel()), ca.sparsify(gap.exact_embed)
    bent = ca.vertcat(*bends)
    total = sum((mass_of(c, each.mass) for each in masses), ca.SX(0))
    travel = c.coefficients(along[1, :] / total, c.symbols(c.y)) if gap.sticks else None
    inside = lambda expression: ca.substitute(m.inside(expression), c.v, ca.densify(embed @ rates))  # noqa: E731
    return Reactions(
        _reaction(m, rows, bent, lambda each: each, c.y, c.v),
        _reaction(m, in_contact, inside(bent), inside, gap.s, rates), friction,
        _handed(m, masses, stated_inertia(c, inertia), steps) if steps and steps.row else None, travel,
        c.coefficients(heavy, c.symbols()) if gap.sticks else None,
        c.coefficients(sums[1] / total, c.symbols(c.y)),
    )  # fmt: skip


def _reaction(m: Mechanics, rows: ca.SX, bent: ca.SX, inside: Callable, place: ca.SX, rates: ca.SX) -> _Reaction:
    c, terms, by_place = m.coordinates, m.in_flight.terms, ca.densify(rows)
    quadratic = bent
    for j, term in enumerate(terms):
        if term.element is None:  # the forces quadratic in the rates are written out, so that what cancels is seen
            quadratic = quadratic + by_place[:, j] * inside(term.by_rates)
            by_place[:, j] = 0
    symbols = c.symbols(place, rates)
    for i in range(2):
        if c.vanishes(ca.densify(quadratic[i]), symbols):
            quadratic[i] = 0
    coefficients = c.coefficients(by_place, c.symbols(place))
    exact = coefficients.exact
    vanish = tuple(quadratic[i].is_zero() and all(each == 0 for each in exact[i::2]) for i in range(2))
    function = ca.Function(
        "by_rates", [place, rates, ca.vertcat(*c.p.values())], [c.numerals.rounded(ca.sparsify(quadratic))]
    )
    return _Reaction(coefficients, function, tuple(c.p), (vanish[0], vanish[1]))


def _refuse_unturned(m: Mechanics, steps: Stepping, sums: Sequence[ca.SX]) -> None:
    """Raise `InputError` where the reversors of flight and contact do not leave heights as they are, and places across
    as they are or mirrored: halves of motions then need different friction."""
    c, gap = m.coordinates, m.gap
    around, closed = steps.relabelling.after(steps.reversor), ca.densify(ca.sparsify(gap.exact_embed) @ gap.s)
    for by, place, here in ((steps.reversor, c.y, c.y), (around, gap.s, closed)):
        there = ca.vertcat(*by.image(ca.vertsplit(here), {}))
        for whole, signs in zip(sums, ((1,), (1, -1)), strict=True):
            at, own = ca.substitute(whole, c.y, there), ca.substitute(whole, c.y, here)
            changes = (ca.densify(ca.gradient(at - sign * own, place)) for sign in signs)
            if not any(c.vanishes(change, c.symbols(place)) for change in changes):
                raise InputError(
                    "the reversor and the symmetry change the places of the masses, so that the ground's forces in one "
                    "half of a motion are not those in the other: leave across= out"
                )


def _handed(
    m: Mechanics, masses: Sequence[Mass], stated: ca.SX, steps: Stepping
) -> tuple[tuple[SignedShift, Coefficients], ...]:
    """The relabelling of states and the matrix (n, n) of the speeds after a step, and those for a step back."""
    c, found = m.coordinates, list[tuple[SignedShift, Coefficients]]()
    for label in (steps.relabelling, steps.relabelling.inverse):
        image = ca.densify(ca.vertcat(*label.image(ca.vertsplit(c.y), {})))
        there = lambda expression, image=image: ca.substitute(expression, c.y, image)  # noqa: E731
        signs, mirrored = ca.diag(ca.SX(ca.DM(label.signs))), -1 if min(label.signs) < 0 else 1
        whole = there(stated) @ signs
        for each in m.elements:
            if isinstance(each, Inerter):
                gradient = there(c.gradient(each.extension)[: c.size])
                whole += c.scalar(each.inertance) * (gradient @ gradient.T @ signs)
        for each in masses:
            for place, sign in zip(paths_of(each), (1, mirrored), strict=False):
                gradient = c.gradient(place)[: c.size]
                whole += sign * mass_of(c, each.mass) * (there(gradient) @ gradient.T)
        parts = [(there(mass), there(gradient)) for mass, gradient in m.in_flight.parts]
        solved = Inertia(c.size, parts, lambda expression: expression).solve(ca.densify(whole))
        found.append((steps.states(label), c.coefficients(ca.densify(solved))))
    return tuple(found)
