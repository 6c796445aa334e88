"""Machines that step from one point of contact to another: their reversor and their relabelling, decided exactly.

R is the reversor of the places in flight, S the relabelling after a landing, Rc = S R the reversor in contact, see
`model.symmetry`. The gap g opens; the gap that closes at landing is g R. Once that point has landed, the relabelled
machine stands with g closed, and the force on the point that landed is the force that holds the landing gap closed in
the labels of before, at S^-1 of the place. Where the same point opens again, that is the force on it in the new labels
too, and one force is watched.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..errors import InputError
from ..laws.law import Algebraic, Key, Parameters, Scalars, from_key
from ..model.phase import Affine
from ..model.symmetry import SignedShift
from .coefficients import Coefficients, Symbols
from .coordinates import Coordinates
from .elements import Mass, Potential, Scalar, Spring, Weight
from .inertia import Inertia
from .lagrange import Mechanics, forces_of
from .structure import Structure
from .terms import mass_of

# A law in pieces is odd where its breakpoints and forces at opposite extensions agree to this share. The forces are
# compared at these shares of each piece, of which a polynomial has fewer coefficients.
ODD_TO, COMPARED = 1e-12, np.linspace(0.05, 0.95, 12)


class Turn(NamedTuple):
    """A spring whose extension a map turns into that of another one, times a sign; the numbers are those of the
    laws."""

    law: int
    other: int
    sign: int


@dataclass(frozen=True, eq=False)
class Stepping:
    """The maps of a mechanism, with symbols for their numbers.

    reversor, relabelling : of the coordinates (n,)
    reversible : whether motions are turned back, at least if nothing damps them
    landing : weights (n,) and offset of the gap that closes at landing
    turns : the springs that have to be alike or odd
    row : (1, terms of the flight), the force on the landed point per force; None where the same point opens again
    alike : signs of the springs' terms, by place, whose extensions at S^-1 of a place in contact are those at the place
    """

    coordinates: Coordinates
    reversor: SignedShift
    relabelling: SignedShift
    reversible: bool
    landing: tuple[list[Fraction], ca.SX]
    turns: tuple[Turn, ...]
    row: Coefficients | None
    alike: Mapping[int, int]

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
        weights, offset = self.landing
        if weights == gap and self.coordinates.vanishes(offset):
            return None
        found = self.coordinates.coefficients(offset)
        numbers = tuple(each for weight in weights for each in (float(weight), 0.0))
        return lambda p: Affine(numbers, found(p)[0][0])

    def landed_force(self, mechanics: Mechanics) -> Callable:
        """(x, p, q) -> the force on the landed point."""
        back, row = self.states(self.relabelling).inverse, self.row
        assert row is not None

        def force(x: Scalars, p: Parameters, q: Scalars) -> Algebraic:
            s, rates = mechanics.positions_and_rates(x, p)
            y, v = mechanics.embedded(s), mechanics.embedded(rates)
            before = back.image([part for pair in zip(y, v, strict=True) for part in pair], p)
            rows, terms = row(p, s), mechanics.in_flight.terms
            forces = forces_of(terms, rows, (before[::2], before[1::2]), p, q)
            for j, sign in self.alike.items():
                if mechanics.law_of(terms[j].element).pieces:
                    forces[j] = sign * terms[j].force(y, v, p, q)
            return sum((a * f for a, f in zip(rows[0], forces, strict=True)), 0.0)

        return force

    def refuse_laws(self, laws: Sequence[Key]) -> None:
        """Raise `InputError` for smooth laws that the maps do not turn into themselves or another one."""
        for law, other, sign in self.turns:
            key, r = laws[law], ca.SX.sym("r")
            if key != laws[other]:
                raise InputError(
                    f"the springs '{key.text}' and '{laws[other].text}' take each other's places on a step: give both "
                    "the same law"
                )
            c = self.coordinates
            p = c.p | {name: ca.SX.sym(name) for name in key.names if name not in c.p}
            if sign > 0 or key.pieces:
                continue
            with_laws = Coordinates(c.names, c.actuators, p, c.numerals, c.y, c.v)
            both = ca.SX(key.expression(r, p, [])) + ca.SX(key.expression(-r, p, []))
            if not with_laws.vanishes(both, with_laws.symbols(r)):
                raise InputError(_not_odd(key))

    def refuse_tables(self, laws: Sequence[Key], p: Parameters) -> None:
        """The same for laws in pieces at parameter values."""
        for law, _, sign in self.turns:
            if sign < 0 and (pieces := laws[law].pieces):
                own, table = from_key(laws[law], p), np.array(pieces.table(p)[0], dtype=float)
                breaks = np.asarray(pieces.ends(table, p), dtype=float)
                ends = np.where(np.isfinite(breaks), breaks, 0.0)
                ends = np.where(breaks == ends, ends, np.sign(breaks) * (1 + 2 * np.abs(ends).max()))
                r = ends[:-1, None] + np.diff(ends)[:, None] * COMPARED
                if not np.allclose(ends, -ends[::-1], 0.0, ODD_TO * ends[-1]) or (
                    np.abs(own(r) + own(-r)).max() > ODD_TO * np.abs(own(r)).max()
                ):
                    raise InputError(_not_odd(laws[law]))


def _not_odd(law: Key) -> str:
    return (
        f"spring '{law.text}' is no odd function of its extension, which changes its sign on a step, so that no motion "
        "is turned back: state a law with phi(-r) = -phi(r), or reversor=None for simulations alone"
    )


def steps_of(c: Coordinates, s: Structure, m: Mechanics) -> Stepping | None:
    """The maps that a structure states, None where it states none.

    Raises `InputError` for maps that do not fit the mechanics, with what they do not turn.
    """
    if s.reversor == () and not s.symmetry and len(s.gaps) < 2:
        return None
    if s.actuators:
        raise InputError("a machine with actuators has no symmetry: leave reversor=, symmetry= and further gaps= out")
    back, label = _stated(c, dict(s.reversor or ()), "reversor"), _stated(c, dict(s.symmetry), "symmetry")
    gap, reversible = m.gap.weights, s.reversor is not None
    landing = _image_of_gap(c, gap, ca.SX(0), back)
    if len(s.gaps) > 2:
        raise InputError(
            f"gaps {', '.join(name for name, _ in s.gaps)}: two of them, that which opens and that which lands"
        )
    if len(s.gaps) == 2:
        largest, (name, expression) = max(c.weights(s.gap) or [Fraction(1)]), s.gaps[1]
        weights = c.weights(expression)
        if weights is None:
            raise InputError(f"gap '{name}' = '{expression}' is no sum of coordinates with numbers before them")
        stated = [weight / largest for weight in weights], c.at_zero(expression) / c.numerals.number(largest)
        if reversible and not (stated[0] == landing[0] and c.vanishes(stated[1] - landing[1])):
            raise InputError(f"gap '{name}' = '{expression}' is not the image of '{s.gap}' under the reversor")
        landing = stated
    same = _side(c, gap, _image_of_gap(c, *landing, label.inverse))
    if not same:
        raise InputError(
            f"the gap that lands is not gap '{s.gap}' after the symmetry: state the symmetry that makes it so"
        )
    turns, around = list[Turn](), label.after(back)
    if reversible:
        if not _side(c, gap, _image_of_gap(c, gap, ca.SX(0), around)):
            raise InputError(f"the reversor and the symmetry do not lead the closed gap '{s.gap}' to itself")
        if m.conservative:
            turns += _turned(c, m, back, "flight") + _turned(c, m, around, "contact")
    row, alike = None, dict[int, int]()
    if same < 0:
        closed = ca.sparsify(m.gap.exact_embed) @ m.gap.s
        before = ca.vertcat(*label.inverse.image(ca.vertsplit(ca.densify(closed)), {}))
        there = lambda expression: ca.substitute(expression, c.y, before)  # noqa: E731
        numbers = ca.vertcat(*map(c.numerals.number, landing[0]))
        flight, symbols = m.in_flight, c.symbols(m.gap.s)
        kick = Inertia(c.size, flight.parts, lambda expression: expression).solve(numbers)
        row = c.coefficients(-there(numbers.T @ flight.accelerations) / there(numbers.T @ kick), symbols)
        for j, term in enumerate(flight.terms):
            if isinstance(term.element, Spring):
                own = m.inside(c.scalar(term.place))
                if sign := _sign_of(c, there(c.scalar(term.place)), own, symbols):
                    alike[j] = sign
    return Stepping(c, back, label, reversible, landing, tuple(dict.fromkeys(turns)), row, alike)


def _stated(c: Coordinates, stated: Mapping[str, Scalar], what: str) -> SignedShift:
    """A map as it is stated, by coordinate."""
    signs, shifts = list[int](), list[ca.SX]()
    for i, name in enumerate(c.names):
        expression = stated.get(name, name)
        weights, unit = c.weights(expression), [Fraction(i == j) for j in range(c.size)]
        if weights != unit and weights != [-each for each in unit]:
            raise InputError(
                f"{what} of '{name}': '{expression}' is neither the coordinate nor its negative, with an amount of "
                "parameters added; state a swap of two coordinates in their sum and their difference"
            )
        signs.append(int(weights[i]))
        shifts.append(c.at_zero(expression))
    if c.vanishes(ca.vertcat(*shifts)):
        return SignedShift(tuple(signs))
    return SignedShift(tuple(signs), lambda p: shifts)


def _image_of_gap(
    c: Coordinates, weights: Sequence[Fraction], offset: ca.SX, by: SignedShift
) -> tuple[list[Fraction], ca.SX]:
    """A sum of coordinates of the image of a place."""
    numbers = ca.vertcat(*map(c.numerals.number, weights))
    turned = [weight * sign for weight, sign in zip(weights, by.signs, strict=True)]
    return turned, offset + ca.dot(numbers, ca.vertcat(*map(ca.SX, by.shifts({}))))


def _side(c: Coordinates, gap: Sequence[Fraction], image: tuple[list[Fraction], ca.SX]) -> int:
    """1 where a sum of coordinates is the gap, -1 where it is its negative, 0 for another."""
    weights, offset = image
    if not c.vanishes(offset):
        return 0
    return 1 if weights == list(gap) else -1 if weights == [-weight for weight in gap] else 0


def _sign_of(c: Coordinates, image: ca.SX, own: ca.SX, symbols: Symbols) -> int:
    """1 where two expressions are the same, -1 where one is the negative of the other, 0 else."""
    return next((sign for sign in (1, -1) if c.vanishes(image - sign * own, symbols)), 0)


def _turned(c: Coordinates, m: Mechanics, by: SignedShift, where: str) -> list[Turn]:
    """The springs that have to be alike or odd for a map to turn the motions in flight, or in contact, back; raises
    `InputError` for an inertia or a force that it does not turn into itself."""
    embed = ca.SX.eye(c.size) if where == "flight" else ca.sparsify(m.gap.exact_embed)
    place = c.y if where == "flight" else m.gap.s
    closed = ca.densify(embed @ place)
    there = ca.vertcat(*by.image(ca.vertsplit(closed), {}))
    symbols, signs = c.symbols(place), ca.diag(ca.SX(ca.DM(by.signs)))
    at, here = (lambda e, x=x: ca.substitute(e, c.y, x) for x in (there, closed))
    inertia = m.in_flight.inertia
    maps = "the reversor" if where == "flight" else "the reversor and the symmetry"
    remedy = "state another, or reversor=None for simulations alone"
    refuse = lambda what: InputError(f"{maps} do not turn motions in {where} back, for {what}: {remedy}")  # noqa: E731
    if not c.vanishes(embed.T @ (signs @ at(inertia) @ signs - here(inertia)) @ embed, symbols):
        raise refuse("the inertia")
    ground, total, changing = m.gravity.at_ground(c), ca.SX(0), list[object]()
    for element in m.elements:
        if isinstance(element, Potential):
            energy = c.scalar(element.energy)
        elif isinstance(element, Mass | Weight):
            height = c.scalar(element.height)
            if m.gravity.varies and not c.vanishes(at(height) - here(height), symbols):
                raise refuse(f"the height '{element.height}', on which gravity depends,")
            energy = mass_of(c, element.mass) * ground * height
        else:
            continue
        change = ca.gradient(at(energy) - here(energy), place)
        total += change
        changing += [] if c.vanishes(change, symbols) else [element]
    if not c.vanishes(ca.densify(total) if isinstance(total, ca.SX) else total, symbols):
        raise refuse(f"{changing[0]!r}")
    springs, found = [each for each in m.elements if isinstance(each, Spring)], list[Turn]()
    for spring in springs:
        image = at(c.scalar(spring.extension))
        each = ((other, _sign_of(c, image, here(c.scalar(other.extension)), symbols)) for other in (spring, *springs))
        turn = next((Turn(spring.force, other.force, sign) for other, sign in each if sign), None)
        if turn is None:
            raise refuse(f"the extension '{spring.extension}' of a spring")
        found.append(turn)
    return found
