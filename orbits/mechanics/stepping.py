"""Machines that step from one point of contact to another: their reversor and their relabelling, decided exactly.

R is the reversor of the places in flight, S the relabelling after a landing, Rc = S R the reversor in contact, see
`model.symmetry`. The gap g opens; the gap that closes at landing is g R. Once that point has landed, the relabelled
machine stands with g closed, and the force on the point that landed is the force that holds the landing gap closed in
the labels of before, at S^-1 of the place. Where the same point opens again, that is the contact force of the new
labels, and one force is watched.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca
import numpy as np

from ..errors import InputError
from ..laws.law import Algebraic, Parameters, Scalars, from_key
from ..model.phase import Affine, weighted_sum
from ..model.symmetry import SignedShift
from ..symbolic.formula import symbolic_numerals
from .coefficients import Coefficients
from .coordinates import Coordinates
from .elements import Potential, Scalar, Spring
from .inertia import Inertia
from .lagrange import Mechanics, forces_of
from .structure import Structure
from .terms import Term

# A law in pieces is odd where its breakpoints and forces at opposite extensions agree to this share. The forces are
# compared at these shares of each piece, of which a polynomial has fewer coefficients.
ODD_TO, COMPARED = 1e-12, np.linspace(0.05, 0.95, 12)
REMEDY = (
    "state an odd law for a spring whose extension changes its sign, as r + r**3; a `Mechanism` with reversor=None is "
    "simulated alone"
)
StatedGap = tuple[list[Fraction], ca.SX]  # weights of the coordinates, and the offset, of a sum of them


@dataclass(frozen=True, eq=False)
class Stepping:
    """The maps of a mechanism, with symbols for their numbers.

    reversor, relabelling : of the coordinates (n,)
    reversible : whether motions are turned back, at least if nothing damps them
    landing : the gap that closes at landing
    row : (1, terms of the flight), the force on the landed point per force; None where the same point opens again
    """

    coordinates: Coordinates
    reversor: SignedShift
    relabelling: SignedShift
    reversible: bool
    landing: StatedGap
    row: Coefficients | None

    def states(self, stated: SignedShift) -> SignedShift:
        """The map of the flight states, of which the rates of a reversor have the other signs."""
        turned = -1 if stated is self.reversor else 1
        signs = tuple(each for sign in stated.signs for each in (sign, turned * sign))
        if stated.shift is None:
            return SignedShift(signs)
        shifts = self.coordinates.coefficients(ca.SX(ca.horzcat(*stated.shifts({}))))
        return SignedShift(signs, lambda p: [each for shift in shifts(p)[0] for each in (shift, 0.0)])

    def landing_gap(self, gap: Sequence[Fraction]) -> Callable[[Parameters], Affine] | None:
        """As in `Model`, for the gap that opens."""
        (weights, offset), c = self.landing, self.coordinates
        if weights == gap and c.vanishes(offset):
            return None
        found, numbers = c.coefficients(offset), tuple(each for weight in weights for each in (float(weight), 0.0))
        return lambda p: Affine(numbers, found(p)[0][0])

    def landed_force(self, m: Mechanics) -> Callable:
        """(x, p, q) -> the force on the landed point."""
        row, step = self.row, self.states(self.relabelling)
        assert row is not None

        def over_step(term: Term) -> Term:
            """A term; the data of a law in pieces are those of the place after the step."""
            if not _in_pieces(m, term):
                return term
            c, place = self.coordinates, self.coordinates.scalar(term.place)
            change = ca.substitute(place, c.y, _before_step(m, self.relabelling)) - m.inside(place)
            sign = 1.0 if c.vanishes(change, c.symbols(m.gap.s)) else -1.0
            after = lambda y, v, p: step.image(_alternating(y, v), p)[::2]  # noqa: E731
            return term._replace(force=lambda y, v, p, q: sign * term.force(after(y, v, p), v, p, q))

        terms, back = list(map(over_step, m.in_flight.terms)), step.inverse

        def force(x: Scalars, p: Parameters, q: Scalars) -> Algebraic:
            s, rates = m.positions_and_rates(x, p)
            before, rows = back.image(_alternating(m.embedded(s), m.embedded(rates)), p), row(p, s)
            return weighted_sum(rows[0], forces_of(terms, rows, (before[::2], before[1::2]), p, q))

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
        raise InputError("a machine that steps has two gaps, that which opens and that which lands, and no actuators")
    back, label = (
        _own_inverse(c, _stated(c, dict(s.reversor or ()), "reversor")),
        _stated(c, dict(s.symmetry), "symmetry"),
    )
    gap, landing = m.gap.weights, _image_of_gap(c, (m.gap.weights, ca.SX(0)), back)
    if len(s.gaps) == 2:
        largest, (name, expression) = max(c.weights(s.gap) or [Fraction(1)]), s.gaps[1]
        offset = c.at_zero(expression) / c.numerals.number(largest)
        stated = [weight / largest for weight in c.weights(expression) or []], offset
        if s.reversor is not None and not (stated[0] == landing[0] and c.vanishes(offset - landing[1])):
            raise InputError(f"gap '{name}' = '{expression}' is not the image of '{s.gap}' under the reversor")
        landing = stated
    same = _side(c, gap, _image_of_gap(c, landing, label.inverse)) if len(landing[0]) == c.size else 0
    around = _image_of_gap(c, (gap, ca.SX(0)), label.after(back))
    if not same or (s.reversor is not None and not _side(c, gap, around)):
        raise InputError(f"the gap that lands is not gap '{s.gap}' after the symmetry: state one that makes it so")
    row = None
    if same < 0:
        numbers, before = ca.vertcat(*map(c.numerals.number, landing[0])), _before_step(m, label)
        kick = Inertia(c.size, m.in_flight.parts, lambda expression: expression).solve(numbers)
        share = -(numbers.T @ m.in_flight.accelerations) / (numbers.T @ kick)
        row = c.coefficients(ca.substitute(share, c.y, before), c.symbols(m.gap.s))
    return Stepping(c, back, label, s.reversor is not None, landing, row)


def _stated(c: Coordinates, stated: Mapping[str, Scalar], what: str) -> SignedShift:
    """A map as it is stated, by coordinate."""
    signs, shifts = list[int](), list[ca.SX]()
    for i, name in enumerate(c.names):
        weights, unit = c.weights(stated.get(name, name)), [Fraction(i == j) for j in range(c.size)]
        if weights != unit and weights != [-each for each in unit]:
            raise InputError(
                f"{what} of '{name}': '{stated[name]}' is neither the coordinate nor its negative, with an amount of "
                "parameters added; state a swap of two coordinates in their sum and their difference"
            )
        signs.append(int(weights[i]))
        shifts.append(c.at_zero(stated.get(name, name)))
    still = c.vanishes(ca.vertcat(*shifts))
    return SignedShift(tuple(signs), None if still else lambda p: shifts)


def _own_inverse(c: Coordinates, reversor: SignedShift) -> SignedShift:
    """A reversor; raises `InputError` for one that is not its own inverse."""
    for name, sign, shift in zip(c.names, reversor.signs, reversor.shifts({}), strict=True):
        if sign > 0 and not c.vanishes(ca.SX(shift)):
            raise InputError(
                f"reversor of '{name}': done twice, it does not lead back to '{name}'; state '{name}' as it is, or its "
                "negative plus an amount"
            )
    return reversor


def _image_of_gap(c: Coordinates, gap: StatedGap, by: SignedShift) -> StatedGap:
    """A sum of coordinates of the image of a place."""
    numbers, shifts = ca.vertcat(*map(c.numerals.number, gap[0])), ca.vertcat(*map(ca.SX, by.shifts({})))
    return [weight * sign for weight, sign in zip(gap[0], by.signs, strict=True)], gap[1] + ca.dot(numbers, shifts)


def _side(c: Coordinates, gap: Sequence[Fraction], image: StatedGap) -> int:
    """1 where a sum of coordinates is the gap, -1 where it is its negative, 0 for another."""
    weights, offset = image
    signs = {1: list(gap), -1: [-weight for weight in gap]}
    return next((sign for sign in signs if weights == signs[sign] and c.vanishes(offset)), 0)


def _before_step(m: Mechanics, label: SignedShift) -> ca.SX:
    """The place (n,) in contact in the labels of before the step."""
    closed = ca.densify(ca.sparsify(m.gap.exact_embed) @ m.gap.s)
    return ca.SX(ca.vertcat(*label.inverse.image(ca.vertsplit(closed), {})))


def _alternating(y: Scalars, v: Scalars) -> list[Algebraic]:
    return [part for pair in zip(y, v, strict=True) for part in pair]


def _in_pieces(m: Mechanics, term: Term) -> bool:
    return isinstance(term.element, Spring) and m.law_of(term.element).pieces is not None


def _needs_odd(m: Mechanics, by: SignedShift, where: str) -> bool:
    """Whether a map turns the motions in flight, or in contact, back if laws in pieces are odd, and not otherwise;
    raises `InputError` where it does not even then."""
    c, flight = m.coordinates, m.in_flight
    embed, place = (ca.SX.eye(c.size), c.y) if where == "flight" else (ca.sparsify(m.gap.exact_embed), m.gap.s)
    closed = ca.densify(embed @ place)
    there, signs = ca.vertcat(*by.image(ca.vertsplit(closed), {})), ca.diag(ca.SX(ca.DM(by.signs)))

    def left(expression: ca.SX, turned: ca.SX) -> ca.SX:
        """What is left of an expression at a place less that at its image, which `turned` turns back."""
        at, here = (ca.substitute(expression, c.y, each) for each in (there, closed))
        return ca.densify(embed.T @ (signs @ at @ turned - here))

    def force(term: Term, like: Callable) -> ca.SX:
        """The force of a term at rest; a law in pieces is like another one."""
        if isinstance(term.element, Potential):
            return term.gradient * ca.dot(term.gradient, c.gradient(term.element.energy))
        with symbolic_numerals(c.numerals.symbols, folded=True):  # decimals are not rounded, as in the maps
            own = like(c.scalar(term.place)) if _in_pieces(m, term) else term.force(ca.vertsplit(c.y), still, c.p, [])
        return term.gradient * own

    still, symbols = [0.0] * c.size, c.symbols(place)
    maps = "the reversor" if where == "flight" else "the reversor and the symmetry"
    refused = f"motions in {where} are not turned back by {maps}, for {{}}: {REMEDY}"
    if not c.vanishes(left(flight.inertia, signs) @ embed, symbols):
        raise InputError(refused.format("the inertia"))
    for like in (ca.exp, ca.atan):
        each = [left(force(term, like), ca.SX(1)) for term in flight.terms]
        if c.vanishes(sum(each, ca.SX(embed.shape[1], 1)), symbols):
            return like is ca.atan
    element = next(term.element for term, own in zip(flight.terms, each, strict=True) if not c.vanishes(own, symbols))
    spring = f"the spring '{m.law_of(element).text}' along '{element.extension}'" if isinstance(element, Spring) else ""
    raise InputError(refused.format(spring or repr(element)))
