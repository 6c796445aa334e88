"""The equations of motion of a mechanism, from its kinetic energy and the forces of its elements.

Each element exerts a force f against a function of the coordinates y (n,) with the gradient J (n,), so that in
flight

    M y'' + C = -sum of J f,

with the inertia M (n, n) and what is quadratic in the rates, C (n,), of `kinetics`. In contact the gap
g(y) = weights . y stays closed: one coordinate is eliminated, y = E s with a matrix E of numbers, and the row of the
eliminated coordinate gives the force of the contact. Coordinates that stick are at rest in contact too, at 0, and the
ground exerts a force on each. With the gradients of the gap and of these as the columns of G, an impact changes the
speeds by M^-1 G (G^T M^-1 G)^-1 per change of the speeds that it brings to 0.

The coefficients of the forces are functions of the parameters, and numbers where these make no difference. Nothing is
rounded while they are derived on exact expressions, and whatever the structure depends on, as whether a coefficient is
0, whether an extension is a sum of coordinates, and whether two forces are one, is decided exactly.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, cached_property
from types import MappingProxyType
from typing import NamedTuple

import casadi as ca

from ..errors import InputError
from ..laws import Algebraic, Key, Parameters, Scalars
from ..model import CONTACT_FORCE, is_used, names_of_holding, weighted_sum
from ..symbolic import (
    ZERO,
    Column,
    ExactExpression,
    ExactRows,
    derivative_by,
    inner_product,
    rows_of,
    substitute,
    total,
    vanishes,
)
from .coefficients import Coefficients
from .coordinates import Coordinates, all_vanish
from .elements import Damper, Element, Force, Inerter, Mass, Scalar, Spring, paths_of
from .kinetics import Closed, ClosedGap, Kinetics, Square
from .terms import Gravity, Term, mass_of, terms_of, with_law

NO_STICKS: Mapping[str, Scalar] = MappingProxyType({})


class InFlight(NamedTuple):
    """The equations of motion of the flight.

    terms : the forces
    kinetics : the kinetic energy
    gradients : (n + k, terms) of the functions that the forces act against
    accelerations : (n, terms) per force; `coefficients` of these
    bent : (n,), the accelerations by what is quadratic in the rates; `quadratic` of these, None where they vanish
    kick : (n, 1 + sticks), the change of the speeds per impulse of the contact and of what sticks
    impact, impact_mass : (1 + sticks, n) the change of the speeds per change of the gap's speed and of the speeds that
        stick, and the masses (1 + sticks, 1 + sticks) that these speeds have
    moves_ends : whether a force depends on the rates of the actuators
    """

    terms: list[Term]
    kinetics: Kinetics
    gradients: ExactRows
    accelerations: ExactRows
    coefficients: Coefficients
    bent: Column
    quadratic: Coefficients | None
    kick: ExactRows
    impact: Coefficients
    impact_mass: ExactRows
    moves_ends: bool


class InContact(NamedTuple):
    """The equations of motion of the contact.

    terms : the forces that differ there
    held, bent_row : (1 + sticks, terms of the flight) and (1 + sticks,), the contact force and those on what sticks,
        per force and by what is quadratic in the rates
    row : the same (1 + sticks, terms) per force that differs
    force_coefficients, force_quadratic : of these, as forces across and along the ground on the point that closes
    inertia : of the remaining coordinates; `coefficients` of their accelerations per force
    quadratic : as in flight
    """

    terms: list[Term]
    held: ExactRows
    bent_row: Column
    row: ExactRows
    force_coefficients: Coefficients
    force_quadratic: Coefficients | None
    inertia: ExactRows
    coefficients: Coefficients
    quadratic: Coefficients | None


@dataclass(frozen=True, eq=False)
class Mechanics:
    """The equations of motion of a mechanism.

    coordinates, elements, gravity, gap : the statement from which they follow
    in_flight, in_contact : the equations of both phases
    laws : the keys of the springs' laws, none as long as they make no difference
    """

    coordinates: Coordinates
    elements: tuple[Element, ...]
    gravity: Gravity
    gap: ClosedGap
    in_flight: InFlight
    in_contact: InContact
    laws: tuple[Key, ...] = ()

    @property
    def size(self) -> int:
        """The number n of coordinates."""
        return self.coordinates.size

    @property
    def conservative(self) -> bool:
        """Whether no element damps or drives, and no spring has hysteresis."""
        return not self.hysteretic and not any(isinstance(each, Damper | Force) for each in self.elements)

    @property
    def hysteretic(self) -> list[Spring]:
        """The springs with hysteresis, whose laws differ while they extend and while they shorten."""
        springs = [element for element in self.elements if isinstance(element, Spring)]
        return [spring for spring in springs if self.laws and self.law_of(spring).branches]

    @property
    def names_of_forces(self) -> tuple[str, ...]:
        """The names of the contact force and of the forces on what sticks."""
        force = [CONTACT_FORCE] if self.gap.eliminated else []
        return *force, *names_of_holding(self.coordinates.names[i] for i in self.gap.sticks)

    def with_laws(self, laws: Sequence[Key]) -> "Mechanics":
        """These mechanics with the keys of the springs' laws."""
        own = self.coordinates.p
        p = own | {name: ca.SX.sym(name) for law in laws for name in law.names if name not in own}
        c, flight, contact = replace(self.coordinates, p=p), self.in_flight, self.in_contact
        flying, standing = ([with_law(c, term, laws) for term in each.terms] for each in (flight, contact))
        flight = flight._replace(terms=flying)
        contact = contact._replace(terms=standing)
        return replace(self, coordinates=c, in_flight=flight, in_contact=contact, laws=tuple(laws))

    def law_of(self, spring: Element | None) -> Key:
        """The key of a spring's law."""
        assert isinstance(spring, Spring)
        return self.laws[spring.force]

    def flight(self, x: Scalars, p: Parameters, q: Scalars) -> list[Algebraic]:
        """The field of the flight, see `Phase`."""
        y, v = self.positions_and_rates(x, p)
        return self._field(self.in_flight, self.in_flight.coefficients(p, y), (y, v), (y, v), p, q)

    def contact(self, x: Scalars, p: Parameters, q: Scalars) -> list[Algebraic]:
        """The field of the contact, see `Phase`."""
        s, rates = self.positions_and_rates(x, p)
        place = self.embedded(s), self.embedded(rates)
        return self._field(self.in_contact, self.in_contact.coefficients(p, s), place, (s, rates), p, q)

    def contact_force(self, x: Scalars, p: Parameters, q: Scalars, held: int = 0) -> Algebraic:
        """The force of the contact, which presses where it is above 0; where `held` is not 0, the force on the
        coordinate that sticks of this number, from 1."""
        s, rates = self.positions_and_rates(x, p)
        contact, place = self.in_contact, (self.embedded(s), self.embedded(rates))
        row = contact.force_coefficients(p, s)[held]
        force = weighted_sum(row, forces_of(contact.terms, [row], place, p, q))
        return _with_bent([force], contact.force_quadratic, (s, rates), p, held)[0]

    def positions_and_rates(self, x: Scalars, p: Parameters) -> tuple[list[Algebraic], list[Algebraic]]:
        """Coordinates with the actuators' displacements, and their rates, of a flight or a contact state."""
        actuators, gap = self.coordinates.actuators, self.gap
        still = len(gap.anywhere) if len(x) == 2 * gap.own + len(gap.anywhere) + len(actuators) else 0
        ends = len(x) - len(actuators) - still
        moved = [p[rate] if self.in_flight.moves_ends else 0.0 for _, rate in actuators]
        return [*x[:ends:2], *x[ends:]], [*x[1:ends:2], *[0.0] * still, *moved]

    def embedded(self, s: Scalars) -> list[Algebraic]:
        """All coordinates (n + k), or rates, from those of the contact."""
        return [weighted_sum(row, s) for row in self._rows]

    @cached_property
    def _rows(self) -> list[list[float]]:
        return self.gap.embed.tolist()

    def _field(
        self, phase: InFlight | InContact, rows: Sequence[Scalars], place: tuple[Scalars, Scalars],
        own: tuple[Scalars, Scalars], p: Parameters, q: Scalars,
    ) -> list[Algebraic]:  # fmt: skip
        forces = forces_of(phase.terms, rows, place, p, q)
        changes = [weighted_sum(row, forces) for row in rows]
        changes = _with_bent(changes, phase.quadratic, own, p)
        pairs = [part for pair in zip(own[1], changes, strict=False) for part in pair]
        still = own[1][len(changes) : len(own[1]) - len(self.coordinates.actuators)]  # what sticks anywhere
        return [*pairs, *still, *(p[rate] for _, rate in self.coordinates.actuators)]

    def turning(self, unit: ExactExpression) -> Callable:
        """(coordinates, rates, p) -> the slopes of the kinetic energy in a unit by the coordinates and displacements,
        which vanish where an inertia does not depend on them."""
        c, matrix = self.coordinates, self.in_flight.kinetics.matrix
        if not c.varies(each for row in matrix for each in row):
            return lambda y, v, p: [0.0] * len(c.moved)

        @cache
        def slopes() -> Coefficients:
            rates = c.v[: self.size]
            energy = inner_product(rates, [inner_product(row, rates) for row in matrix]) / (2 * unit)
            return c.coefficients([[derivative_by(energy, each) for each in c.y]], [*c.y, *c.v])

        return lambda y, v, p: slopes()(p, [*y, *v])[0]


def _with_bent(
    changes: Sequence[Algebraic], quadratic: Coefficients | None, own: tuple[Scalars, Scalars], p: Parameters,
    first: int = 0,
) -> list[Algebraic]:  # fmt: skip
    """What is linear in the forces, with what is quadratic in the rates, from its row `first` on."""
    if quadratic is None:
        return list(changes)
    rows = quadratic(p, [*own[0], *own[1]])[first : first + len(changes)]
    return [change + more if is_used(more) else change for change, (more,) in zip(changes, rows, strict=True)]


def mechanics_of(
    c: Coordinates, elements: Sequence[Element], inertia: Sequence[Sequence[Scalar]], gap: Scalar | None,
    gravity: Gravity, sticks: Mapping[str, Scalar] = NO_STICKS, anywhere: Collection[str] = (),
) -> Mechanics:  # fmt: skip
    """The mechanics of elements whose springs have no laws yet; the force of each `Spring` is its place among the laws.

    inertia : (n, n) in addition to that of the elements
    gap : None for a machine without one
    sticks : the coordinates that stick while the gap is closed, each with the place along the ground that it holds
    anywhere : those of them that stick at any place, on which the motion depends

    Raises `InputError` for an inertia that is singular, and for a gap that no coordinate closes.
    """
    kinetics = _kinetics_of(c, elements, stated_inertia(c, inertia))
    closed = closed_gap(c, gap, sticks, anywhere)
    standing = Closed(kinetics, closed)
    flight = _flight_equations(c, elements, terms_of(c, elements, gravity), kinetics, standing)
    return Mechanics(c, tuple(elements), gravity, closed, flight, _contact_equations(c, closed, flight, standing))


def forces_of(
    terms: Sequence[Term], rows: Sequence[Scalars], place: tuple[Scalars, Scalars], p: Parameters, q: Scalars
) -> list[Algebraic]:
    """The forces at a place and its rates, of the terms that have a coefficient in one of the rows; 0 for the
    others."""
    used = [any(is_used(row[j]) for row in rows) for j in range(len(terms))]
    return [term.force(*place, p, q) if use else 0.0 for term, use in zip(terms, used, strict=True)]


def closed_gap(
    c: Coordinates, expression: Scalar | None, sticks: Mapping[str, Scalar] = NO_STICKS, anywhere: Collection[str] = ()
) -> ClosedGap:
    """The gap that an expression states, None for no gap, with the coordinates that stick; raises `InputError` for an
    expression that is neither a sum of coordinates nor 0 where a single coordinate is."""
    if expression is None:
        return ClosedGap([Fraction(0)] * c.size, (), c.y, c.v)
    held, free = (tuple(map(c.names.index, each)) for each in (sticks, anywhere))
    along = tuple(map(c.scalar, sticks.values()))
    for i, (name, place) in zip(held, sticks.items(), strict=True):
        if vanishes(derivative_by(c.scalar(place), c.y[i])):
            raise InputError(f"sticks: '{place}' does not change with '{name}'; state its place along the ground")
    if (weights := c.weights(expression)) is None:
        height = c.scalar(expression)
        closing = [i for i in range(c.size) if i not in held and _closes(height, c.y[i])]
        if len(closing) != 1:
            raise InputError(
                f"gap '{expression}' is not a sum of coordinates with numbers before them, such as \"foot - plate\", "
                'and no formula that changes its sign with one of them alone, such as "length*sin(lean)"'
            )
        unit = [Fraction(i == closing[0]) for i in range(c.size)]
        return ClosedGap(unit, held, c.y, c.v, free, height, along)
    if not vanishes(c.at_zero(expression)) or any(weights[c.size :]) or max(weights) <= 0:
        raise InputError(
            f"gap '{expression}' is not a sum of coordinates with numbers before them, such as \"foot - plate\""
        )
    weights = [weight / max(weights) for weight in weights[: c.size]]
    if any(weights[i] for i in held):
        raise InputError(f"gap '{expression}' depends on what sticks ({next(iter(sticks))}): a gap must open upward")
    return ClosedGap(weights, held, c.y, c.v, free)


def _closes(height: ExactExpression, coordinate: ExactExpression) -> bool:
    """Whether a height vanishes with a coordinate, wherever the others are, and its slope does not."""
    at, slope = substitute([height, derivative_by(height, coordinate)], {coordinate: ZERO})
    return vanishes(at) and not vanishes(slope)


def stated_inertia(c: Coordinates, stated: Sequence[Sequence[Scalar]]) -> ExactRows | None:
    """The matrix (n, n) that is stated in addition to the elements; None without one."""
    return [list(map(c.scalar, row)) for row in stated] or None


def moving_masses(elements: Sequence[Element]) -> list[tuple[list[Scalar], Scalar]]:
    """The functions of the coordinates along which something with a mass moves, and the mass."""
    masses = [(paths_of(each), each.mass) for each in elements if isinstance(each, Mass)]
    return masses + [([each.extension], each.inertance) for each in elements if isinstance(each, Inerter)]


def _kinetics_of(c: Coordinates, elements: Sequence[Element], stated: ExactRows | None) -> Kinetics:
    """The kinetic energy of the elements and of the `stated` inertia."""
    paths, y, v = list[list[Square]](), c.y[: c.size], c.v[: c.size]
    for places, mass in moving_masses(elements):
        size = mass_of(c, mass)
        for place in places:
            if not all_vanish(c.gradient(place)[c.size :]):
                raise InputError(f"'{place}' moves with an actuator, but a mass can move with coordinates only")
        paths.append([Square.of(size, c.scalar(place), y, v) for place in places])
    found = Kinetics.of(paths, stated, y, v)
    if still := [name for i, name in enumerate(c.names) if vanishes(found.matrix[i][i])]:
        raise InputError(f"coordinate '{still[0]}' has no inertia: give it a Mass, or state its inertia")
    return found


def _flight_equations(
    c: Coordinates, elements: Sequence[Element], terms: list[Term], kinetics: Kinetics, closed: Closed
) -> InFlight:
    """The equations of the flight."""
    gradients = rows_of([term.gradient for term in terms], len(c.moved))
    rows = kinetics.per_force([[-each for each in row] for row in gradients[: c.size]])
    impact = [[inner_product(row, kick) for kick in closed.kick] for row in closed.masses]
    dampers = [term.gradient[c.size :] for term in terms if term.what == "damper"]
    moves_ends = not all(map(all_vanish, dampers)) or any(isinstance(each, Force) for each in elements)
    bent = kinetics.accelerations([ZERO] * c.size, bent=True)
    return InFlight(
        terms, kinetics, gradients, rows, c.coefficients(rows), bent, _quadratic(kinetics, bent, [*c.y, *c.v]),
        closed.kick, c.coefficients(impact), closed.masses, moves_ends,
    )  # fmt: skip


def _quadratic(kinetics: Kinetics, bent: Column, place: Column) -> Coefficients | None:
    """The values of what follows from C of a kinetic energy; None where that vanishes."""
    return Coefficients([[each] for each in bent], place) if kinetics.bends and not all_vanish(bent) else None


def _contact_equations(c: Coordinates, gap: ClosedGap, flight: InFlight, closed: Closed) -> InContact:
    """The equations of the contact."""
    accelerations = closed.accelerations([[-each for each in row] for row in flight.gradients[: c.size]])
    bent = [each for (each,) in closed.accelerations([[ZERO]] * c.size, bent=True)]
    held, bent_row = (
        closed.forces(flight.accelerations),
        [row[0] for row in closed.forces([[each] for each in flight.bent])],
    )
    terms, merging = _merged(c, gap, flight.terms)
    merged = lambda rows: [[total(row[i] for i in members) for members in merging] for row in rows]  # noqa: E731
    row, place = merged(held), [*gap.s, *gap.w]
    on_points, bent_on_points = gap.on_points(row), [each for (each,) in gap.on_points([[each] for each in bent_row])]
    return InContact(
        terms, held, bent_row, row, c.coefficients(on_points, gap.s),
        _quadratic(flight.kinetics, bent_on_points, place), closed.own.matrix,
        c.coefficients(merged(accelerations), gap.s),
        _quadratic(flight.kinetics, bent, place),
    )  # fmt: skip


def _merged(c: Coordinates, gap: ClosedGap, terms: Sequence[Term]) -> tuple[list[Term], list[list[int]]]:
    """The terms that differ in contact, and the places of the terms of the flight that are each of them."""
    found: list[tuple[Term, list[int]]] = []
    for i, term in enumerate(terms):
        for other, members in found:
            alike = term.what is not None and term.what == other.what
            if alike and all_vanish(gap.inside([c.scalar(term.place) - c.scalar(other.place)])):
                members.append(i)
                break
        else:
            found.append((term, [i]))
    return [term for term, _ in found], [members for _, members in found]
