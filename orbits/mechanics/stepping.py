"""Machines that step from one point of contact to another: their reversor and their relabelling, decided exactly.

R is the reversor of the places in flight, S the relabelling after a landing, Rc = S R the reversor in contact, see
`model.symmetry`. The gap g opens; the gap that closes at landing is g R. Once that point has landed, the relabelled
machine stands with g closed, and the force on the point that landed is the force that holds the landing gap closed in
the labels of before, at S^-1 of the place. Where the same point opens again, that is the contact force of the new
labels, and one force is watched.
"""

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..laws import Algebraic, Parameters, Scalars, from_key
from ..model import Affine, SignedShift, weighted_sum
from ..symbolic import (
    ZERO,
    Column,
    ExactExpression,
    call,
    exact_number,
    expression,
    inner_product,
    substitute,
    total,
    vanishes,
)
from .coefficients import Coefficients
from .coordinates import Coordinates, all_vanish
from .elements import Potential, Scalar, Spring
from .lagrange import Mechanics, forces_of
from .structure import Structure
from .terms import Term

# A law in pieces is odd where its breakpoints and forces at opposite extensions agree to this share. The forces are
# compared at these shares of each piece; a polynomial has fewer coefficients.
ODD_TO, COMPARED = 1e-12, np.linspace(0.05, 0.95, 12)
REMEDY = (
    "give a spring whose extension changes its sign an odd law, such as r + r**3; a `Mechanism` with reversor=None can "
    "only be simulated"
)
StatedGap = tuple[list[Fraction], ExactExpression]  # weights of the coordinates, and the offset, of a sum of them


class Stepping(NamedTuple):
    """The maps of a mechanism, whose shifts are exact expressions.

    reversor, relabelling : of the coordinates (n,)
    reversible : whether motions are turned back, at least if nothing damps them
    landing : the gap that closes at landing
    turned : whether the reversor turns the gap's coordinate over, so that it closes from the other side, and two points
        stand in contact
    row : (1, terms of the flight), the force on the landed point per force; None where the same point opens again, and
        where the gap is turned over
    quadratic : what is quadratic in the rates in that force, of places and rates in contact; None where that vanishes
    """

    coordinates: Coordinates
    reversor: SignedShift
    relabelling: SignedShift
    reversible: bool
    landing: StatedGap
    turned: bool
    row: Coefficients | None
    quadratic: Coefficients | None = None

    def states(self, stated: SignedShift) -> SignedShift:
        """The map of the flight states; the rates of a reversor have the other signs."""
        turned = -1 if stated is self.reversor else 1
        signs = tuple(each for sign in stated.signs for each in (sign, turned * sign))
        if stated.shift is None:
            return SignedShift(signs)
        shifts = self.coordinates.coefficients([[expression(each) for each in stated.shifts({})]])
        return SignedShift(signs, lambda p: [each for shift in shifts(p)[0] for each in (shift, 0.0)])

    def landing_gap(self, gap: Sequence[Fraction]) -> Callable[[Parameters], Affine] | None:
        """The gap that opens, as in `Model`."""
        (weights, offset), c = self.landing, self.coordinates
        if self.turned or (weights == gap and vanishes(offset)):
            return None
        found, numbers = c.coefficients([[offset]]), tuple(each for weight in weights for each in (float(weight), 0.0))
        return lambda p: Affine(numbers, found(p)[0][0])

    def landed_force(self, m: Mechanics) -> Callable:
        """(x, p, q) -> the force on the landed point."""
        row, step = self.row, self.states(self.relabelling)
        assert row is not None

        def over_step(term: Term) -> Term:
            """A term; the data of a law in pieces are those of the place after the step."""
            if not _in_pieces(m, term):
                return term
            place = self.coordinates.scalar(term.place)
            (before,), (here,) = substitute([place], _before_step(m, self.relabelling)), m.gap.inside([place])
            sign = 1.0 if vanishes(before - here) else -1.0
            after = lambda y, v, p: step.image(_alternating(y, v), p)[::2]  # noqa: E731
            return term._replace(force=lambda y, v, p, q: sign * term.force(after(y, v, p), v, p, q))

        terms, back = list(map(over_step, m.in_flight.terms)), step.inverse

        def force(x: Scalars, p: Parameters, q: Scalars) -> Algebraic:
            s, rates = m.positions_and_rates(x, p)
            before, rows = back.image(_alternating(m.embedded(s), m.embedded(rates)), p), row(p, s)
            linear = weighted_sum(rows[0], forces_of(terms, rows, (before[::2], before[1::2]), p, q))
            return linear if self.quadratic is None else linear + self.quadratic(p, [*s, *rates])[0][0]

        return force

    def refuse_forces(self, m: Mechanics) -> bool:
        """Whether motions are turned back where laws in pieces are odd alone; raises `InputError` for an inertia or a
        force that is not turned into itself."""
        around = self.relabelling.after(self.reversor)
        return any([_needs_odd(m, self.reversor, "flight"), _needs_odd(m, around, "contact")])


def refuse_uneven(m: Mechanics, p: Parameters) -> None:
    """Raise `InputError` for a law in pieces that is not odd at parameter values."""
    for term in m.in_flight.terms:
        if _in_pieces(m, term) and (pieces := m.law_of(term.element).pieces):
            own, table = from_key(m.law_of(term.element), p), np.array(pieces.table(p)[0], dtype=float)
            ends = np.asarray(pieces.ends(table, p), dtype=float)
            farthest = 1 + 2 * np.abs(ends[np.isfinite(ends)]).max(initial=0.0)
            ends = np.clip(ends, -farthest, farthest)
            r = ends[:-1, None] + np.diff(ends)[:, None] * COMPARED
            even = np.abs(ends + ends[::-1]).max() <= ODD_TO * farthest
            if not (even and np.abs(own(r) + own(-r)).max() <= ODD_TO * np.abs(own(r)).max()):
                raise InputError(
                    f"spring '{own.text}' is not odd, and its extension changes its sign on a step: {REMEDY}"
                )


def steps_of(c: Coordinates, s: Structure, m: Mechanics) -> Stepping | None:
    """The maps that a structure states, None where it states none; raises `InputError` for maps that do not fit the
    gaps."""
    if s.reversor == () and not s.symmetry and len(s.gaps) < 2:
        return None
    if s.actuators or len(s.gaps) > 2:
        raise InputError("a machine that steps must have two gaps, one that opens and one that lands, and no actuators")
    back, label = (
        _own_inverse(c, _stated(c, dict(s.reversor or ()), "reversor")),
        _stated(c, dict(s.symmetry), "symmetry"),
    )
    gap, landing = m.gap.weights, _image_of_gap((m.gap.weights, ZERO), back)
    if s.grazes and s.reversor is None:  # what nothing turns back closes from the other side all the same
        landing = [-weight for weight in gap], ZERO
    if len(s.gaps) == 2:
        largest, (name, expression) = max(c.weights(s.gaps[0][1]) or [Fraction(1)]), s.gaps[1]
        offset = c.at_zero(expression) / largest
        stated = [weight / largest for weight in c.weights(expression) or []], offset
        if s.reversor is not None and not (stated[0] == landing[0] and vanishes(offset - landing[1])):
            raise InputError(f"gap '{name}' = '{expression}' is not the image of '{s.gap}' under the reversor")
        landing = stated
    same = _side(gap, _image_of_gap(landing, label.inverse)) if len(landing[0]) == c.size else 0
    around = _image_of_gap((gap, ZERO), label.after(back))
    if not same or (s.reversor is not None and not _side(gap, around)):
        raise InputError(f"the symmetry must take the gap that lands to gap '{s.gap}'")
    turned = _side(gap, landing) < 0
    if turned != s.grazes:
        passes = f"gap '{s.gap}' is 0 in mid-flight too" if turned else f"gap '{s.gap}' is open in mid-flight"
        raise InputError(f"{passes}, where the reversor leads it: state grazes={turned}")
    row, quadratic = _landed_rows(m, label, landing[0]) if same < 0 and not turned else (None, None)
    return Stepping(c, back, label, s.reversor is not None, landing, turned, row, quadratic)


def _landed_rows(
    m: Mechanics, label: SignedShift, weights: Sequence[Fraction]
) -> tuple[Coefficients, Coefficients | None]:
    """The force that holds the landing gap closed in the labels of before, per force and by the rates, as functions of
    the contact."""
    flight, gap, numbers = m.in_flight, m.gap, list(map(exact_number, weights))
    before = _before_step(m, label)
    compliance = inner_product(numbers, flight.kinetics.accelerations(numbers))
    columns = [*zip(*flight.accelerations, strict=True), flight.bent]
    *row, bent = substitute([-inner_product(numbers, each) / compliance for each in columns], before)
    place = [*gap.s, *gap.w]
    return Coefficients([row], gap.s), None if vanishes(bent) else Coefficients([[bent]], place)


def _stated(c: Coordinates, stated: Mapping[str, Scalar], what: str) -> SignedShift:
    """A map as it is stated, by coordinate."""
    signs, shifts = list[int](), list[ExactExpression]()
    for i, name in enumerate(c.names):
        weights, unit = c.weights(stated.get(name, name)), [Fraction(i == j) for j in range(c.size)]
        if weights != unit and weights != [-each for each in unit]:
            raise InputError(
                f"{what} of '{name}': '{stated[name]}' must be the coordinate or its negative, plus an amount; to "
                "swap two coordinates, use their sum and their difference as coordinates"
            )
        signs.append(int(weights[i]))
        shifts.append(c.at_zero(stated.get(name, name)))
    return SignedShift(tuple(signs), None if all_vanish(shifts) else lambda p: shifts)


def _own_inverse(c: Coordinates, reversor: SignedShift) -> SignedShift:
    """A reversor; raises `InputError` for one that is not its own inverse."""
    for name, sign, shift in zip(c.names, reversor.signs, reversor.shifts({}), strict=True):
        if sign > 0 and not vanishes(expression(shift)):
            raise InputError(
                f"reversor of '{name}': applied twice, it must lead back to '{name}'; state '{name}' itself, or its "
                "negative plus an amount"
            )
    return reversor


def _image_of_gap(gap: StatedGap, by: SignedShift) -> StatedGap:
    """A sum of coordinates of the image of a place."""
    moved = total(weight * expression(shift) for weight, shift in zip(gap[0], by.shifts({}), strict=True))
    return [weight * sign for weight, sign in zip(gap[0], by.signs, strict=True)], gap[1] + moved


def _side(gap: Sequence[Fraction], image: StatedGap) -> int:
    """1 where a sum of coordinates is the gap, -1 where it is its negative, 0 for another."""
    weights, offset = image
    signs = {1: list(gap), -1: [-weight for weight in gap]}
    return next((sign for sign in signs if weights == signs[sign] and vanishes(offset)), 0)


def _before_step(m: Mechanics, label: SignedShift) -> dict[ExactExpression, ExactExpression]:
    """The places and rates in the labels of before the step, by those in contact."""
    y, v, back = m.coordinates.y, m.coordinates.v, label.inverse
    places, rates = back.image(m.gap.inside(y), {}), m.gap.inside(v)
    turned = [sign * rate for sign, rate in zip(back.signs, rates, strict=True)]
    return dict(zip([*y, *v], [*places, *turned], strict=True))


def _alternating(y: Scalars, v: Scalars) -> list[Algebraic]:
    return [part for pair in zip(y, v, strict=True) for part in pair]


def _in_pieces(m: Mechanics, term: Term) -> bool:
    return isinstance(term.element, Spring) and m.law_of(term.element).pieces is not None


def _needs_odd(m: Mechanics, by: SignedShift, where: str) -> bool:
    """Whether a map turns the motions in flight, or in contact, back if laws in pieces are odd, and not otherwise;
    raises `InputError` where it does not even then."""
    c, flight, gap = m.coordinates, m.in_flight, m.gap
    closed = c.y if where == "flight" else gap.inside(c.y)
    matrix = (
        [row[: gap.own] for row in gap.exact_embed]
        if where == "contact"
        else [[int(i == j) for j in range(c.size)] for i in range(c.size)]
    )
    embed = [list(map(exact_number, column)) for column in zip(*matrix, strict=True)]
    there, here = (dict(zip(c.y, each, strict=True)) for each in (by.image(closed, {}), closed))

    def left(column: Column, sign: int = 1) -> Column:
        """What is left of a column at a place less that at its image, which the signs turn back."""
        pairs = zip(by.signs, substitute(column, there), substitute(column, here), strict=True)
        change = [own * sign * at - now for own, at, now in pairs]
        return [inner_product(each, change) for each in embed]

    def force(term: Term, like: str) -> Column:
        """The force of a term at rest; a law in pieces is like another one."""
        if isinstance(term.element, Potential):
            own = inner_product(term.gradient, c.gradient(term.element.energy))
        elif _in_pieces(m, term):
            own = call(like, c.scalar(term.place))
        else:
            own = c.of_function(lambda y, v: term.force(y, [0.0] * c.size, c.p, []))
        return [slope * own for slope in term.gradient]

    maps = "the reversor" if where == "flight" else "the reversor and the symmetry"
    refused = f"the motions in {where} are not reversed by {maps}, because of {{}}: {REMEDY}"
    inertia = [left(column, sign) for sign, column in zip(by.signs, flight.kinetics.matrix, strict=True)]
    if not all_vanish(inner_product(each, row) for row in zip(*inertia, strict=True) for each in embed):
        raise InputError(refused.format("the inertia"))
    for like in ("exp", "atan"):
        each = [left(force(term, like)) for term in flight.terms]
        if all_vanish(total(rows) for rows in zip(*each, strict=True)):
            return like == "atan"
    element = next(term.element for term, own in zip(flight.terms, each, strict=True) if not all_vanish(own))
    spring = f"the spring '{m.law_of(element).text}' along '{element.extension}'" if isinstance(element, Spring) else ""
    raise InputError(refused.format(spring or repr(element)))
