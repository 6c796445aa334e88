"""The forces of the ground on machines whose masses have places across, and the speeds after a step with an impact.

The ground bears the weight of the masses m at the heights Z, and moves them along itself at the places X:

    N = sum of m (g + Z''),    T = sum of m X''.

So no other force of the mechanism acts on it from outside. Where a step ends with a speed, the point that lands takes
over: only on it there is an impulse, and the momentum along every motion about it stays. With y the coordinates before
and y+ = S y those after, J the gradients of the places, E the signs of S, and s = -1 where S mirrors the plane,

    M(y+) y+' = [I(y+) E + sum of m (JZ(y+)^T JZ(y) + s JX(y+)^T JX(y))] y',

I being what masses at heights and across do not have of the inertia M. Where the labels exchange two legs, the
gradients of y+ are those of the mass that has the place of this one in the new labels.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

from ..errors import InputError
from ..laws import Algebraic, Parameters, Scalars
from ..model import NORMAL_FORCE, TANGENTIAL_FORCE, Planar, SignedShift, weighted_sum
from ..symbolic import (
    ZERO,
    Column,
    ExactExpression,
    ExactRows,
    derivative_by,
    inner_product,
    substitute,
    symbols,
    total,
    vanishes,
)
from .coefficients import Coefficients
from .coordinates import all_vanish
from .elements import Inerter, Mass, Scalar, Weight, paths_of, value_of
from .kinetics import Square
from .lagrange import Mechanics, forces_of, stated_inertia
from .stepping import Stepping
from .terms import mass_of

# What a force of the ground is per force of the mechanism, and its part that is quadratic in the rates.
_Row: TypeAlias = tuple[Column, ExactExpression]


class _Reaction(NamedTuple):
    """The two forces in a phase.

    rows : (2, terms of the flight), per force
    by_rates : (2, 1), what is quadratic in the rates, of places and rates
    vanish : whether each of the two is 0 on all motions
    """

    rows: Coefficients
    by_rates: Coefficients
    vanish: tuple[bool, bool]


class Reactions(NamedTuple):
    """The forces of the ground on a mechanism.

    flight, contact : the forces in these phases, where some springs have no laws yet
    friction : as in `Mechanism`
    handed : the speeds after a step forward and after one back, per speed before; None without hand-overs
    travel : (1, n), the speed of the centre of mass along the ground per speed; None where nothing sticks at 0
    momentum : (2, n), across and along the ground per speed
    weight : (1, 1), that of the machine on the ground; None where nothing sticks
    across : (1, 1), the place of the centre of mass along the ground
    """

    flight: _Reaction
    contact: _Reaction
    friction: Scalar | None
    handed: tuple[tuple[SignedShift, Coefficients], ...] | None
    travel: Coefficients | None = None
    momentum: Coefficients | None = None
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
                linear = weighted_sum(row, forces_of(terms, [row], place, p, q))
                if reaction.by_rates.exact[i] == 0:
                    return linear
                return linear + reaction.by_rates(p, [*s, *rates])[i][0]

            return force

        return {name: force_of(i) for i, name in enumerate((NORMAL_FORCE, TANGENTIAL_FORCE))}

    @property
    def by_rates(self) -> bool:
        """Whether one of the forces depends on rates."""
        return any(exact != 0 for each in (self.flight, self.contact) for exact in each.by_rates.exact)

    @property
    def planar(self) -> Planar:
        """The speeds after landing, as in `Model`."""
        share = self.friction
        limit = None if share is None else lambda p: value_of(share, {}, p)
        forward, back = (_taken_over(*each) for each in self.handed) if self.handed else (None, None)
        travel = self.travel and (lambda x, p: weighted_sum(self.travel(p, x[::2])[0], x[1::2]))
        momentum = self.momentum and (lambda x, p: [weighted_sum(row, x[1::2]) for row in self.momentum(p, x[::2])])
        weight = self.weight and (lambda p: self.weight(p, [])[0][0])
        across = self.across and (lambda x, p: self.across(p, x[::2])[0][0])
        return Planar(not self.flight.vanish[0], limit, forward, back, travel, weight, across, momentum)


def _taken_over(label: SignedShift, speeds: Coefficients) -> Callable:
    def taken_over(x: Scalars, p: Parameters) -> list[Algebraic]:
        y, v = label.image(x, p)[::2], x[1::2]
        rates = [weighted_sum(row, v) for row in speeds(p, x[::2])]
        return [part for pair in zip(y, rates, strict=True) for part in pair]

    return taken_over


def reactions_of(
    m: Mechanics, inertia: Sequence[Sequence[Scalar]], friction: Scalar | None, steps: Stepping | None, hangs: bool
) -> Reactions | None:
    """The reactions of a mechanism, None without a gap unless it hangs by a grip, and where no mass states where it is
    across; raises `InputError` where the maps of its steps do not turn its places across."""
    masses = [each for each in m.elements if isinstance(each, Mass)]
    if not (m.gap.eliminated or hangs) or all(each.across is None for each in masses):
        return None
    c, flight, contact, gap, n = m.coordinates, m.in_flight, m.in_contact, m.gap, m.size
    sums, bends = [ZERO, ZERO], [ZERO, ZERO]
    for each in masses:
        for i, place in enumerate(paths_of(each)):
            path = Square.of(mass_of(c, each.mass), c.scalar(place), c.y, c.v)
            sums[i], bends[i] = sums[i] + path.mass * c.scalar(place), bends[i] + path.mass * path.bend
    if steps and steps.reversible:
        _refuse_unturned(m, steps, sums)
    along, heavy = [c.gradient(each)[:n] for each in sums], ZERO
    carried = [ZERO] * len(flight.terms)
    for weight in (each for each in m.elements if isinstance(each, Mass | Weight)):
        place = next(
            j for j, term in enumerate(flight.terms)
            if term.is_weight and (not m.gravity.varies or term.element is weight)
        )  # fmt: skip
        own = mass_of(c, weight.mass) * m.gravity.at_ground(c)
        carried[place], heavy = carried[place] + own, heavy + own
    mass = total(mass_of(c, each.mass) for each in masses)
    travel = c.coefficients([[each / mass for each in along[1]]]) if len(gap.sticks) > len(gap.anywhere) else None
    flying, held = list[_Row](), list[_Row]()
    for weights, slopes, bend in zip([carried, [ZERO] * len(carried)], along, bends, strict=True):
        pulls, bent, pushes = _momentum(m, slopes)
        row = [own + pull for own, pull in zip(weights, pulls, strict=True)], bend + bent
        *linear, quadratic = gap.inside([*row[0], row[1]])
        pushes = gap.inside(pushes)
        forces = zip(*contact.held, strict=True) if gap.held else [()] * len(linear)  # a hanging machine has no gap
        flying.append(row)
        held.append(
            (
                [own + inner_product(pushes, force) for own, force in zip(linear, forces, strict=True)],
                quadratic + inner_product(pushes, contact.bent_row),
            )
        )
    return Reactions(
        _reaction(flying, c.y, c.v), _reaction(held, gap.s, gap.w), friction,
        _handed(m, masses, stated_inertia(c, inertia), steps) if steps and (steps.row or steps.turned) else None,
        travel, c.coefficients(along) if gap.anywhere else None,
        c.coefficients([[heavy]], []) if gap.sticks else None,
        c.coefficients([[sums[1] / mass]]),
    )  # fmt: skip


def _momentum(m: Mechanics, slopes: Column) -> tuple[Column, ExactExpression, Column]:
    """The products of slopes (n,) and the accelerations of the flight, per force and by the rates, and of those per
    impulse of the contact and of what sticks.

    Where all that has mass moves along with a coordinate, its equation of motion has them without any inverse.
    """
    flight, held = m.in_flight, m.gap.held
    for i, row in enumerate(flight.kinetics.matrix):
        if all_vanish(a - b for a, b in zip(row, slopes, strict=True)):
            return [-each for each in flight.gradients[i]], -flight.kinetics.centrifugal[i], [each[i] for each in held]
    columns = zip(*flight.accelerations, strict=True)
    kicks = zip(*flight.kick, strict=True)
    return (
        [inner_product(slopes, each) for each in columns],
        inner_product(slopes, flight.bent),
        [inner_product(slopes, each) for each in kicks],
    )


def _reaction(rows: Sequence[_Row], place: Column, rates: Column) -> _Reaction:
    linear = Coefficients([row for row, _ in rows], place)
    quadratic = Coefficients([[ZERO if vanishes(own) else own] for _, own in rows], [*place, *rates])
    vanish = [quadratic.exact[i] == 0 and all(each == 0 for each in linear.exact[i::2]) for i in range(2)]
    return _Reaction(linear, quadratic, (vanish[0], vanish[1]))


def _refuse_unturned(m: Mechanics, steps: Stepping, sums: Column) -> None:
    """Raise `InputError` where the reversors of flight and contact do not leave heights as they are, and places across
    as they are or mirrored: halves of motions then need different friction."""
    c, gap = m.coordinates, m.gap
    around = steps.relabelling.after(steps.reversor)
    moving = [c.y[i] for i in gap.left if i not in gap.anywhere]
    for by, place, here in ((steps.reversor, c.y, c.y), (around, moving, gap.inside(c.y))):
        there = dict(zip(c.y, by.image(here, {}), strict=True))
        for whole, signs in zip(sums, ((1,), (1, -1)), strict=True):
            (at,), (own,) = substitute([whole], there), substitute([whole], dict(zip(c.y, here, strict=True)))
            changes = ([derivative_by(at - sign * own, each) for each in place] for sign in signs)
            if not any(map(all_vanish, changes)):
                raise InputError(
                    "the reversor and the symmetry change the places of the masses, so the ground's forces differ "
                    "between the halves of a motion: leave across= out"
                )


def _handed(
    m: Mechanics, masses: Sequence[Mass], stated: ExactRows | None, steps: Stepping
) -> tuple[tuple[SignedShift, Coefficients], ...] | None:
    """The relabelling of states and the matrix (n, n) of the speeds after a step, and those for a step back; None where
    the labels do not map the masses onto each other."""
    c, n, found = m.coordinates, m.size, list[tuple[SignedShift, Coefficients]]()
    for label in (steps.relabelling, steps.relabelling.inverse):
        image = dict(zip(c.y, label.image(c.y, {}), strict=True))
        mirrored, others = -1 if min(label.signs) < 0 else 1, masses
        if steps.turned:
            if not m.gap.along or (exchanged := _exchanged(m, masses, image)) is None:
                return None
            mirrored, others = 1, exchanged
        paths = [
            (c.scalar(each.inertance), each.extension, each.extension, 0)
            for each in m.elements
            if isinstance(each, Inerter)
        ]
        paths += [
            (mass_of(c, each.mass), place, there, sign)
            for each, other in zip(masses, others, strict=True)
            for place, there, sign in zip(paths_of(each), paths_of(other), (1, mirrored), strict=False)
        ]
        whole = [list(row) for row in stated or [[ZERO] * n] * n]
        whole = [[sign * each for sign, each in zip(label.signs, substitute(row, image), strict=True)] for row in whole]
        for mass, place, there, sign in paths:
            before, after = c.gradient(place)[:n], substitute(c.gradient(there)[:n], image)
            # What has no mass at heights and across is turned by the labels alone.
            own = (
                [sign * each for each in before]
                if sign
                else [s * each for s, each in zip(label.signs, after, strict=True)]
            )
            whole = [
                [entry + mass * a * b for entry, b in zip(row, own, strict=True)]
                for row, a in zip(whole, after, strict=True)
            ]
        columns = zip(*whole, strict=True)
        speeds = [_solved_there(m, list(column), image) for column in columns]
        found.append((steps.states(label), c.coefficients([[each[i] for each in speeds] for i in range(n)])))
    return tuple(found)


def _exchanged(
    m: Mechanics, masses: Sequence[Mass], image: dict[ExactExpression, ExactExpression]
) -> list[Mass] | None:
    """The mass that has the place of each one in the new labels, counted from the point that has closed the gap; None
    where there are none."""
    c, (foot,) = m.coordinates, m.gap.along
    places = [list(map(c.scalar, paths_of(each)[:2])) for each in masses]
    weights, after = [mass_of(c, each.mass) for each in masses], [substitute(each, image) for each in places]

    def lies(j: int, i: int) -> bool:
        """Whether mass j lies in the new labels where mass i lies."""
        (z, x), (height, across) = places[i], after[j]
        apart = m.gap.inside([height - z, across - (x - foot)])
        return vanishes(weights[i] - weights[j]) and all_vanish(apart)

    found = [next((own for j, own in enumerate(masses) if lies(j, i)), None) for i in range(len(masses))]
    return [each for each in found if each] if all(found) else None


def _solved_there(m: Mechanics, loads: Column, image: dict[ExactExpression, ExactExpression]) -> Column:
    """The inverse of the inertia at the image of a place, times loads at the place."""
    unknowns = symbols("load", m.size)
    found = substitute(m.in_flight.kinetics.accelerations(unknowns), image)
    return substitute(found, dict(zip(unknowns, loads, strict=True)))
