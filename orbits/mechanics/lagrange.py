"""The equations of motion of a mechanism, from its kinetic energy and the forces of its elements.

Each element exerts a force f against a function of the coordinates y (n,) with the gradient J (n,), so that in
flight

    M y'' = -sum of J f,

M (n, n) being the inertia. A mass that moves along a function h of the coordinates which is no straight line adds the
force m v^T (Hessian of h) v. In contact the gap g(y) = weights . y stays closed: one coordinate is eliminated, y = E s
with a matrix E of numbers, and E^T M E s'' = -sum of E^T J f. The row of the eliminated coordinate gives the force
lambda of the contact,

    lambda dg/dy = M y'' + sum of J f.

Coordinates that stick are at rest in contact too, at 0, and the ground exerts a force on each. With the gradients of
the gap and of these as the columns of G, an impact changes the speeds by M^-1 G (G^T M^-1 G)^-1 per change of the
speeds that it brings to 0. The coefficients of the forces are
functions of the parameters, and numbers where these make no difference. Nothing is rounded while they are derived: all
numbers are symbols (`Numerals`), and whatever the structure depends on, as whether a coefficient is 0, whether an
extension is a sum of coordinates, and whether two forces are one, is decided exactly (`Entries`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

import casadi as ca
import numpy as np

from ..errors import InputError
from ..laws.law import Algebraic, Key, Parameters, Scalars
from ..model.model import CONTACT_FORCE, names_of_holding
from ..model.phase import is_used, weighted_sum
from .coefficients import Coefficients, Entries, Symbols
from .coordinates import Coordinates
from .elements import Damper, Element, Force, Mass, Scalar, Spring
from .inertia import Inertia, inverse, squares_of
from .terms import Gravity, Term, mass_of, moving_masses, terms_of, with_law


@dataclass(frozen=True, eq=False)
class ClosedGap:
    """The gap as a sum of coordinates, and the coordinates that remain while it is closed.

    weights : (n,), the largest being 1: the contact force is the force on its coordinate, which is eliminated
    left : the places of the remaining ones among the coordinates and displacements
    s : the symbols of these
    sticks : the places of the coordinates that stick while it is closed
    """

    weights: list[Fraction]
    exact: ca.SX
    left: list[int]
    s: ca.SX
    sticks: tuple[int, ...] = ()

    @classmethod
    def of(cls, c: Coordinates, expression: Scalar, sticks: Sequence[str] = ()) -> "ClosedGap":
        """The gap that an expression states, with the coordinates that stick; raises `InputError` for one that is no
        sum of coordinates."""
        weights, at_closed = c.weights(expression), c.at_zero(expression)
        sums = weights is not None and c.vanishes(at_closed) and not any(weights[c.size :])
        if weights is None or not sums or max(weights) <= 0:
            raise InputError(
                f"gap '{expression}' is no sum of coordinates with numbers before them, as \"foot - plate\""
            )
        weights = [weight / max(weights) for weight in weights[: c.size]]
        held = tuple(map(c.names.index, sticks))
        if any(weights[i] for i in held):
            raise InputError(f"gap '{expression}' opens along the ground: what sticks ({sticks[0]}) is not in it")
        left = [i for i in range(len(c.moved)) if i not in (weights.index(Fraction(1)), *held)]
        return cls(weights, ca.vertcat(*map(c.numerals.number, weights)), left, ca.SX.sym("s", len(left)), held)

    @property
    def own(self) -> int:
        """The number of coordinates that remain."""
        return len(self.weights) - 1 - len(self.sticks)

    @cached_property
    def held(self) -> ca.SX:
        """The matrix (n, 1 + sticks) of the gradients of the gap and of what sticks."""
        return ca.horzcat(self.exact, *(ca.SX.eye(len(self.weights))[:, i] for i in self.sticks))

    @cached_property
    def numbers(self) -> np.ndarray:
        """The weights (n,) as doubles."""
        return np.array(self.weights, dtype=float)

    @cached_property
    def embed(self) -> np.ndarray:
        """The matrix (n + k, own + k) from the remaining coordinates and displacements to all of them."""
        place, own = self.weights.index(Fraction(1)), self.own
        matrix = np.eye(len(self.left) + 1 + len(self.sticks))[:, self.left]
        matrix[place, :own] = -self.numbers[self.left[:own]]
        return matrix

    @cached_property
    def exact_embed(self) -> ca.SX:
        """The same matrix, with symbols for its numbers."""
        place, own = self.weights.index(Fraction(1)), self.own
        matrix = ca.SX.eye(len(self.left) + 1 + len(self.sticks))[:, self.left]
        matrix[place, :own] = -self.exact[self.left[:own]].T
        return matrix

    def inside(self, expression: ca.SX, c: Coordinates) -> ca.SX:
        """An expression of the coordinates as one of the remaining ones."""
        return ca.substitute(expression, c.y, ca.densify(ca.sparsify(self.exact_embed) @ self.s))

    def weights_inside(self, weights: Sequence[Fraction]) -> list[Fraction]:
        """The weights of the remaining ones in a sum of all coordinates and displacements."""
        lost = weights[self.weights.index(Fraction(1))]
        gap = [*self.weights, *(Fraction(0) for _ in range(len(weights) - len(self.weights)))]
        return [weights[i] - lost * gap[i] for i in self.left]


@dataclass(frozen=True, eq=False)
class InFlight:
    """The equations of motion of the flight.

    terms : the forces
    parts : the masses, with the gradients (n,) along which they move, that make the kinetic energy
    inertia : (n, n)
    gradients : (n + k, terms) of the functions that the forces act against
    accelerations : (n, terms) per force; `coefficients` of these
    kick : (n, 1 + sticks), the change of the speeds per impulse of the contact and of what sticks
    impact, impact_mass : (1 + sticks, n) the change of the speeds per change of the gap's speed and of those that
        stick, and the masses (1 + sticks, 1 + sticks) that these speeds have
    moves_ends : whether a force depends on the rates of the actuators
    quadratic : (n, 1), the accelerations by the forces quadratic in the rates, of places and rates; None where they are
        among the forces of `coefficients`
    """

    terms: list[Term]
    parts: list[tuple[ca.SX, ca.SX]]
    inertia: ca.SX
    gradients: ca.SX
    accelerations: ca.SX
    coefficients: Coefficients
    kick: ca.SX
    impact: Coefficients
    impact_mass: ca.SX
    moves_ends: bool
    quadratic: Coefficients | None = None


@dataclass(frozen=True, eq=False)
class InContact:
    """The equations of motion of the contact.

    symbols : of its expressions
    terms : the forces that differ there
    row : (1 + sticks, terms), the contact force and those on what sticks, per force; `force_coefficients` of these
    inertia : of the remaining coordinates; `coefficients` of their accelerations per force
    quadratic : as in flight
    """

    symbols: Symbols
    terms: list[Term]
    row: ca.SX
    force_coefficients: Coefficients
    inertia: ca.SX
    coefficients: Coefficients
    quadratic: Coefficients | None = None


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
        return CONTACT_FORCE, *names_of_holding(self.coordinates.names[i] for i in self.gap.sticks)

    def with_laws(self, laws: Sequence[Key]) -> "Mechanics":
        """The same mechanics with the keys of the springs' laws."""
        own = self.coordinates.p
        p = own | {name: ca.SX.sym(name) for law in laws for name in law.names if name not in own}
        c, flight, contact = replace(self.coordinates, p=p), self.in_flight, self.in_contact
        flying, standing = ([with_law(c, term, laws) for term in each.terms] for each in (flight, contact))
        flight = replace(flight, terms=flying)
        contact = replace(contact, terms=standing, symbols=c.symbols(self.gap.s))
        return replace(self, coordinates=c, in_flight=flight, in_contact=contact, laws=tuple(laws))

    def law_of(self, spring: Element | None) -> Key:
        """The key of a spring's law."""
        assert isinstance(spring, Spring)
        return self.laws[spring.force]

    def inside(self, expression: ca.SX) -> ca.SX:
        """An expression of the coordinates as one of the coordinates of the contact."""
        return self.gap.inside(expression, self.coordinates)

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
        row, place = self.in_contact.force_coefficients(p, s)[held], (self.embedded(s), self.embedded(rates))
        return weighted_sum(row, forces_of(self.in_contact.terms, [row], place, p, q))

    def positions_and_rates(self, x: Scalars, p: Parameters) -> tuple[list[Algebraic], list[Algebraic]]:
        """Coordinates with the actuators' displacements, and their rates, of a flight or a contact state."""
        actuators = self.coordinates.actuators
        ends = len(x) - len(actuators)
        moved = [p[rate] if self.in_flight.moves_ends else 0.0 for _, rate in actuators]
        return [*x[:ends:2], *x[ends:]], [*x[1:ends:2], *moved]

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
        if phase.quadratic:
            each = zip(changes, phase.quadratic(p, [*own[0], *own[1]]), strict=True)
            changes = [change + more if is_used(more) else change for change, (more,) in each]
        pairs = [part for pair in zip(own[1], changes, strict=False) for part in pair]
        return [*pairs, *(p[rate] for _, rate in self.coordinates.actuators)]

    def turning(self, unit: ca.SX) -> Callable:
        """(coordinates, rates, p) -> the slopes of the kinetic energy in a unit by the coordinates and displacements,
        which vanish where an inertia does not depend on them."""
        c, inertia, rates = self.coordinates, self.in_flight.inertia / unit, ca.SX.sym("v", self.size)
        if not c.varies(inertia):
            return lambda y, v, p: [0.0] * len(c.moved)
        slopes = c.numerals.rounded(ca.gradient(ca.bilin(inertia, rates, rates) / 2, c.y))
        function = ca.Function("turning", [c.y, rates, ca.vertcat(*c.p.values())], [slopes])
        return lambda y, v, p: ca.vertsplit(
            function(ca.vertcat(*y), ca.vertcat(*v[: rates.numel()]), ca.vertcat(*(p[name] for name in c.p)))
        )


def mechanics_of(
    c: Coordinates, elements: Sequence[Element], inertia: Sequence[Sequence[Scalar]], gap: Scalar, gravity: Gravity,
    sticks: Sequence[str] = (),
) -> Mechanics:  # fmt: skip
    """The mechanics of elements whose springs have no laws yet; the force of each `Spring` is its place among the laws.

    inertia : (n, n) beside that of the elements
    sticks : the coordinates that stick while the gap is closed

    Raises `InputError` for an inertia that is singular, and for a gap that no coordinate closes.
    """
    stated = stated_inertia(c, inertia)
    whole = _inertia(c, elements, stated)
    terms = terms_of(c, elements, gravity, stated)
    closed = ClosedGap.of(c, gap, sticks)
    flight = _flight_equations(c, elements, terms, stated, whole, closed)
    return Mechanics(c, tuple(elements), gravity, closed, flight, _contact_equations(c, closed, flight))


def forces_of(
    terms: Sequence[Term], rows: Sequence[Scalars], place: tuple[Scalars, Scalars], p: Parameters, q: Scalars
) -> list[Algebraic]:
    """The forces at a place and its rates, of the terms that have a coefficient in one of the rows; 0 for the
    others."""
    used = [any(is_used(row[j]) for row in rows) for j in range(len(terms))]
    return [term.force(*place, p, q) if use else 0.0 for term, use in zip(terms, used, strict=True)]


def stated_inertia(c: Coordinates, stated: Sequence[Sequence[Scalar]]) -> ca.SX:
    """The matrix (n, n) that is stated beside the elements."""
    matrix = ca.SX(c.size, c.size)
    for i, row in enumerate(stated):
        for j, entry in enumerate(row):
            if entry != 0:
                matrix[i, j] = c.scalar(entry)
    return matrix


def _inertia(c: Coordinates, elements: Sequence[Element], stated: ca.SX) -> ca.SX:
    """The matrix (n, n) of the kinetic energy."""
    matrix = stated
    for place, mass in moving_masses(elements):
        gradient = ca.sparsify(c.gradient(place))
        if not c.vanishes(gradient[c.size :]):
            raise InputError(f"'{place}' moves with an actuator: what has mass moves with coordinates alone")
        matrix = matrix + mass_of(c, mass) * (gradient[: c.size] @ gradient[: c.size].T)
    matrix = ca.sparsify(matrix)
    if still := [name for i, name in enumerate(c.names) if c.vanishes(matrix[i, i])]:
        raise InputError(f"coordinate '{still[0]}' has no inertia: give it a Mass, or state its inertia")
    return matrix


def _flight_equations(
    c: Coordinates, elements: Sequence[Element], terms: list[Term], stated: ca.SX, inertia: ca.SX, gap: ClosedGap
) -> InFlight:
    """The equations of the flight; the inertia is the `stated` one and that of the elements."""
    parts = [(c.scalar(mass), c.gradient(place)[: c.size]) for place, mass in moving_masses(elements)]
    parts += squares_of(stated, c.vanishes) if stated.nnz() else []
    gradients, solved = ca.horzcat(*(term.gradient for term in terms)), Inertia(c.size, parts, as_number(c, gap))
    accelerations, kick = -solved.solve(gradients[: c.size, :]), solved.solve(gap.held)
    masses, compliance = inverse_of(c, gap.held.T @ kick), gap.held.T @ kick
    dampers = [term.gradient[c.size :] for term in terms if term.what == "damper"]
    moves_ends = any(not c.vanishes(along) for along in dampers) or any(isinstance(each, Force) for each in elements)
    by_place, quadratic = accelerations, None
    if any(isinstance(each, Mass) and each.across is not None for each in elements):
        by_place, quadratic = _bent_apart(c, terms, accelerations, (c.y, c.v))
    return InFlight(
        terms, parts, inertia, gradients, accelerations, c.coefficients(by_place), kick,
        c.coefficients(masses @ kick.T if gap.sticks else kick.T / compliance), masses, moves_ends, quadratic,
    )  # fmt: skip


def _bent_apart(
    c: Coordinates, terms: Sequence[Term], rows: ca.SX, own: tuple[ca.SX, ca.SX], inside: Callable = lambda each: each
) -> tuple[ca.SX, Coefficients | None]:
    """Rows (n, terms) without the forces that are quadratic in the rates, and the sums of these, written out so that
    what cancels is seen; None without any."""
    quadratic, rows = ca.SX(rows.shape[0], 1), ca.densify(rows)
    bent = [j for j, term in enumerate(terms) if term.element is None]
    for j in bent:
        quadratic += rows[:, j] * inside(terms[j].by_rates)
        rows[:, j] = 0
    return ca.sparsify(rows), c.coefficients(quadratic, c.symbols(*own)) if bent else None


def _contact_equations(c: Coordinates, gap: ClosedGap, flight: InFlight) -> InContact:
    """The equations of the contact."""
    n, m, symbols = c.size, gap.own, c.symbols(gap.s)
    embed = ca.sparsify(gap.exact_embed[:n, :m])
    terms, merging = _merged(c, gap, symbols, flight.terms)
    columns = ca.SX(ca.sparsify(ca.DM(merging)))
    along = embed.T @ (gap.inside(flight.gradients, c) @ columns)[:n, :]
    parts = [(gap.inside(mass, c), embed.T @ gap.inside(gradient, c)) for mass, gradient in flight.parts]
    # The contact force takes away the acceleration of the gap that the other forces would make.
    row, quadratic = held_by(c, gap, flight, columns), None
    accelerations = -Inertia(m, parts, as_number(c, gap)).solve(along)
    if flight.quadratic:
        rates = ca.SX.sym("w", gap.s.numel())
        moving = lambda each: ca.substitute(gap.inside(each, c), c.v, ca.densify(ca.sparsify(gap.exact_embed) @ rates))  # noqa: E731
        accelerations, quadratic = _bent_apart(c, terms, accelerations, (gap.s, rates), moving)
    return InContact(
        symbols, terms, row, c.coefficients(row, symbols),
        ca.sparsify(embed.T @ gap.inside(flight.inertia, c) @ embed),
        c.coefficients(accelerations, symbols), quadratic,
    )  # fmt: skip


def held_by(c: Coordinates, gap: ClosedGap, flight: InFlight, columns: ca.SX) -> ca.SX:
    """The contact force, and the forces on what sticks, (1 + sticks, k) per force of the flight, of which `columns`
    (terms, k) are sums."""
    opening = gap.held.T @ gap.inside(flight.accelerations, c) @ columns
    compliance = gap.inside(gap.held.T @ flight.kick, c)
    return -inverse_of(c, compliance, c.symbols(gap.s)) @ opening if gap.sticks else -opening / compliance


def inverse_of(c: Coordinates, compliance: ca.SX, symbols: Symbols | None = None) -> ca.SX:
    """The inverse of the compliance of what is held, of which entries that vanish are left out."""
    if compliance.numel() == 1:
        return 1 / compliance
    for i, j in np.ndindex(*compliance.shape):
        if c.vanishes(compliance[i, j], symbols):
            compliance[i, j] = 0
    return inverse(ca.sparsify(compliance))


def as_number(c: Coordinates, gap: ClosedGap) -> Callable[[ca.SX], ca.SX]:
    """An expression -> the same one, a number where it is one."""

    def exactly(expression: ca.SX) -> ca.SX:
        (value,) = Entries(expression, c.symbols(c.y, gap.s)).exact
        return expression if value is None else c.numerals.number(value)

    return exactly


def _merged(c: Coordinates, gap: ClosedGap, symbols: Symbols, terms: Sequence[Term]) -> tuple[list[Term], np.ndarray]:
    """The terms that differ in contact, and the matrix (terms, different terms) that assigns the ones to the others."""
    found: list[tuple[Term, list[int]]] = []
    for i, term in enumerate(terms):
        for other, members in found:
            alike = term.what is not None and term.what == other.what
            if alike and c.vanishes(gap.inside(c.scalar(term.place) - c.scalar(other.place), c), symbols):
                members.append(i)
                break
        else:
            found.append((term, [i]))
    columns = np.zeros((len(terms), len(found)))
    for j, (_, members) in enumerate(found):
        columns[members, j] = 1.0
    return [term for term, _ in found], columns
