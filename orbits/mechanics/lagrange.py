"""The equations of motion of a mechanism, from its kinetic energy and the forces of its elements.

Each element exerts a force f against a function of the coordinates y (n,), of which J (n,) is the gradient, so that in
flight

    M y'' = -sum of J f,

M (n, n) being the inertia. A mass that moves along a function h of the coordinates which is no straight line adds the
force m v^T (Hessian of h) v. In contact the gap g(y) = weights . y stays closed: one coordinate is eliminated, y = E s
with a matrix E of numbers, and E^T M E s'' = -sum of E^T J f. The row of the eliminated coordinate gives the force
lambda of the contact,

    lambda dg/dy = M y'' + sum of J f.

An impact changes the speeds by M^-1 dg / (dg M^-1 dg) per change of the gap's speed. The coefficients of the forces are
functions of the parameters, and numbers where these make no difference. Nothing is rounded while they are derived: all
numbers are symbols (`Numerals`), and whatever the structure depends on, as whether a coefficient is 0, whether an
extension is a sum of coordinates, and whether two forces are one, is decided exactly (`Entries`).
"""

from collections.abc import Callable, Sequence
from copy import copy
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np

from ..errors import InputError
from ..laws.law import Key, Parameters, Scalars
from ..symbolic.formula import symbolic_numerals
from .coefficients import Coefficients, Entries, Numerals, Symbols
from .elements import Damper, Element, Force, Inerter, Mass, Potential, Scalar, Spring, Weight, value_of
from .inertia import Inertia, squares_of
from .terms import Term, is_used, one_weight, weighted_sum

# Share of the variation of gravity, led from 0 to 1 to come from constant gravity to the one that is stated.
GRAVITY_SHARE = "gravity_share"


class Mechanics:
    """The equations of motion of coordinates with elements, whose springs' laws are told by `with_laws`.

    coordinates, actuators : their names; each actuator is the name of a displacement and that of its rate
    inertia : (n, n) scalars beside the elements' own inertia
    gap : weights (n,)
    gravity : key of the law of a height, with `surface` its unit; None where it is 1
    names : of all parameters but those of the springs' laws

    The force of a `Spring` is here its place among the laws.

    Raises `InputError` for an inertia that is singular, and for a gap that no coordinate closes.
    """

    def __init__(
        self, coordinates: Sequence[str], actuators: Sequence[tuple[str, str]], elements: Sequence[Element],
        inertia: Sequence[Sequence[Scalar]], gap: Scalar, gravity: Key, surface: Scalar, names: Sequence[str],
    ):  # fmt: skip
        self.coordinates, self.actuators = tuple(coordinates), tuple(actuators)
        self.size = len(self.coordinates)
        self.moved = (*self.coordinates, *(name for name, _ in self.actuators))
        self.y = ca.SX.sym("y", len(self.moved))
        self.v = ca.SX.sym("v", len(self.moved))
        self.p, self.numerals = {name: ca.SX.sym(name) for name in names}, Numerals()
        self.in_flight = self.symbols(self.y)
        self._weights = dict[Scalar, list[Fraction] | None]()  # found before
        self.gravity, self.varying = gravity, gravity.degree() > 0
        with symbolic_numerals(self.numerals.symbols, folded=True):
            at_ground = gravity.expression(ca.SX(0), self.p, [])
        self.ground_gravity = self.scalar(surface) * at_ground
        self.elements = tuple(elements)
        self.inertia = self._inertia(inertia)
        if still := [name for i, name in enumerate(self.coordinates) if self.vanishes(self.inertia[i, i])]:
            raise InputError(f"coordinate '{still[0]}' has no inertia: give it a Mass, or state its inertia")
        self.laws: tuple[Key, ...] = ()
        self.conservative = not any(isinstance(element, Damper | Force) for element in elements)
        terms = [term for element in elements for term in self._terms_of(element)]
        self.terms = [*one_weight(terms), *self._inertial_terms()]
        dampers = [term.gradient[self.size :] for term in self.terms if term.what == "damper"]
        self.damped_ends = any(not self.vanishes(gradient) for gradient in dampers) or any(
            isinstance(element, Force) for element in elements
        )
        self.gap_weights = self._gap(gap)
        self.exact_gap = ca.vertcat(*map(self.numerals.number, self.gap_weights))
        self.gap, self.eliminated = np.array(self.gap_weights, dtype=float), self.gap_weights.index(Fraction(1))
        kept = [i for i in range(self.size) if i != self.eliminated]
        self.kept = [*kept, *range(self.size, len(self.moved))]
        self.embed, self.exact_embed = np.eye(len(self.moved))[:, self.kept], ca.SX.eye(len(self.moved))[:, self.kept]
        self.embed[self.eliminated, : len(kept)] = -self.gap[kept]
        self.exact_embed[self.eliminated, : len(kept)] = -self.exact_gap[kept].T
        self.s = ca.SX.sym("s", len(self.kept))
        self.in_contact = self.symbols(self.s)
        self._derive()

    def with_laws(self, laws: Sequence[Key]) -> "Mechanics":
        """The same mechanics with the keys of the springs' laws."""
        found = copy(self)
        found.laws = tuple(laws)
        found.p = self.p | {name: ca.SX.sym(name) for law in laws for name in law.names if name not in self.p}
        found.in_flight, found.in_contact = found.symbols(self.y), found.symbols(self.s)
        found.terms, found.contact_terms = (
            [found._pulled(each) for each in terms] for terms in (self.terms, self.contact_terms)
        )
        return found

    def law_of(self, spring: Element | None) -> Key:
        """The key of a spring's law."""
        assert isinstance(spring, Spring)
        return self.laws[spring.force]

    def _pulled(self, term: Term) -> Term:
        """A term, of a spring with the force of its law."""
        if not isinstance(term.element, Spring):
            return term
        extension, law = term.element.extension, self.law_of(term.element).expression
        return term._replace(force=lambda y, v, p, q: law(value_of(extension, self._named(y), p), p, q))

    @staticmethod
    def _pull(y: Scalars, v: Scalars, p: Parameters, q: Scalars) -> Any:
        raise AssertionError("the springs have no laws yet")

    def scalar(self, expression: Scalar) -> ca.SX:
        """An expression of the coordinates and parameters, with symbols for its numerals."""
        if not (isinstance(expression, str) or callable(expression)):
            return self.numerals.number(float(expression))
        y = dict(zip(self.moved, ca.vertsplit(self.y), strict=True))
        with symbolic_numerals(self.numerals.symbols, folded=True):
            return ca.SX(value_of(expression, y, self.p))

    def symbols(self, *place: ca.SX) -> Symbols:
        """The symbols of expressions of these and of the parameters."""
        return Symbols(ca.vertcat(*place), self.p, self.numerals)

    def coefficients(self, matrix: ca.SX, symbols: Symbols | None = None) -> Coefficients:
        """A matrix of expressions of the coordinates, or of other symbols, and of the parameters."""
        return Coefficients(matrix, symbols or self.in_flight)

    def vanishes(self, matrix: ca.SX, symbols: Symbols | None = None) -> bool:
        """Whether all entries of a matrix are 0."""
        return matrix.is_zero() or Entries(matrix, symbols or self.in_flight).vanishes

    def varies(self, matrix: ca.SX, symbols: Symbols | None = None) -> bool:
        """Whether a matrix depends on the coordinates, or on the other symbols' place."""
        symbols = symbols or self.in_flight
        return ca.depends_on(matrix, symbols.place) and Entries(matrix, symbols).varies

    def gradient(self, expression: Scalar) -> ca.SX:
        """The gradient (n + k,) of an expression by the coordinates and displacements."""
        return ca.gradient(self.scalar(expression), self.y)

    def affine(self, expression: Scalar) -> Coefficients | None:
        """The weights of the coordinates and displacements and the offset of an expression, functions of the
        parameters; None where it is not affine."""
        gradient = self.gradient(expression)
        found = self.coefficients(ca.horzcat(gradient.T, at_zero(self.scalar(expression), self.y)))
        return None if found.by_coordinates else found

    def _inertia(self, stated: Sequence[Sequence[Scalar]]) -> ca.SX:
        """The matrix (n, n) of the kinetic energy."""
        matrix = ca.SX(self.size, self.size)
        for i, row in enumerate(stated):
            for j, entry in enumerate(row):
                if entry != 0:
                    matrix[i, j] = self.scalar(entry)
        self.stated_inertia = matrix
        for place, mass in self._moving_masses():
            gradient = ca.sparsify(self.gradient(place))
            if not self.vanishes(gradient[self.size :]):
                raise InputError(f"'{place}' moves with an actuator: what has mass moves with coordinates alone")
            matrix = matrix + self._mass(mass) * (gradient[: self.size] @ gradient[: self.size].T)
        return ca.sparsify(matrix)

    def _mass(self, expression: Scalar) -> ca.SX:
        """A mass, which does not depend on the coordinates."""
        mass = self.scalar(expression)
        if ca.depends_on(mass, self.y):
            raise InputError(f"mass '{expression}' depends on coordinates: state such an inertia as inertia=")
        return mass

    def _moving_masses(self) -> list[tuple[Scalar, Scalar]]:
        """The functions of the coordinates along which something with a mass moves, and the masses."""
        masses = [(element.height, element.mass) for element in self.elements if isinstance(element, Mass)]
        return masses + [(each.extension, each.inertance) for each in self.elements if isinstance(each, Inerter)]

    def weights(self, expression: Scalar) -> list[Fraction] | None:
        """The weights (n + k,) of the coordinates and displacements in an expression that is a sum of these, with
        rational numbers before them, and of parameters; None for another."""
        if expression not in self._weights:
            weights = Entries(self.gradient(expression), self.in_flight).exact
            numbers = [weight for weight in weights if weight is not None]
            self._weights[expression] = numbers if len(numbers) == len(weights) else None
        return self._weights[expression]

    def weights_in_contact(self, weights: Sequence[Fraction]) -> list[Fraction]:
        """The weights of the coordinates of the contact and of the displacements in a sum of all of these."""
        lost, gap = weights[self.eliminated], [*self.gap_weights, *(0 for _ in self.actuators)]
        return [weights[i] - lost * gap[i] for i in self.kept]

    def _gap(self, expression: Scalar) -> list[Fraction]:
        """The weights (n,) of the gap, the largest of which is 1: the contact force is that on its coordinate."""
        weights, at_closed = self.weights(expression), at_zero(self.scalar(expression), self.y)
        sums = weights is not None and self.vanishes(at_closed) and not any(weights[self.size :])
        if weights is None or not sums or max(weights) <= 0:
            raise InputError(
                f"gap '{expression}' is no sum of coordinates with numbers before them, as \"foot - plate\""
            )
        return [weight / max(weights) for weight in weights[: self.size]]

    def _terms_of(self, element: Element) -> list[Term]:
        """The forces of an element."""
        if isinstance(element, Spring):
            return [Term(element, self._pull, self.gradient(element.extension), True, element, element.extension)]
        if isinstance(element, Mass | Weight):
            return [self._weight(element)]
        if isinstance(element, Damper):
            gradient, coefficient = self.gradient(element.extension), self.scalar(element.coefficient)
            rate, force = ca.dot(gradient, self.v), self._along(gradient)
            return [Term(element, force, gradient * coefficient, False, "damper", element.extension, rate)]
        if isinstance(element, Potential):
            slopes = self.gradient(element.energy)
            return [
                Term(element, self._of_state(slopes[i]), ca.SX(np.eye(len(self.moved))[:, i]))
                for i in range(len(self.moved))
                if not slopes[i].is_zero()
            ]
        if isinstance(element, Force):
            given = element.force
            against = lambda y, v, p, q: -given(self._named(y), self._named(v), p)  # noqa: E731
            by_rates = ca.SX(against(ca.vertsplit(self.y), ca.vertsplit(self.v), self.p, []))
            return [Term(element, against, self.gradient(element.along), False, by_rates=by_rates)]
        return []

    def _weight(self, element: Mass | Weight) -> Term:
        """The weight of a mass; where gravity is constant the same force for all."""
        weight = self._mass(element.mass) * self.gradient(element.height)
        if not self.varying:
            return Term(element, lambda y, v, p, q: 1.0, weight * self.ground_gravity, True, "constant gravity", "0")
        height = element.height
        pull = lambda y, v, p, q: self.pull(value_of(height, self._named(y), p), p)  # noqa: E731
        return Term(element, pull, weight * self.ground_gravity, True, "gravity", height)

    def pull(self, height: Any, p: Parameters) -> Any:
        """Gravity at a height over that at the ground, with the share of its variation that the parameter tells."""
        ground = self.gravity.expression(0.0, p, [])
        return 1 + p[GRAVITY_SHARE] * (self.gravity.expression(height, p, []) / ground - 1)

    def _inertial_terms(self) -> list[Term]:
        """What is quadratic in the speeds: a mass that moves along a function h of the coordinates has the acceleration
        J^T y'' + v^T (Hessian of h) v; and what a stated inertia that depends on the configuration adds."""
        terms = []
        for place, mass in self._moving_masses():
            bend = ca.bilin(ca.jacobian(self.gradient(place), self.y), self.v, self.v)
            if not self.vanishes(bend, self.symbols(self.y, self.v)):
                along = self.scalar(mass) * self.gradient(place)
                terms.append(Term(None, self._of_state(bend), along, False, by_rates=bend))
        n, v, inertia = self.size, self.v[: self.size], self.stated_inertia
        if self.varies(inertia):
            energy = ca.bilin(inertia, v, v) / 2
            force = ca.jtimes(inertia @ v, self.y, self.v) - ca.gradient(energy, self.y)[:n]
            each = enumerate(np.eye(len(self.moved))[:n])
            terms += [Term(None, self._of_state(force[i]), ca.SX(row), False, by_rates=force[i]) for i, row in each]
        return terms

    def _named(self, values: Sequence[Any]) -> dict[str, Any]:
        return dict(zip(self.moved, values, strict=True))

    def _along(self, gradient: ca.SX) -> Callable:
        """(y, v, p, q) -> the rate of a function with this gradient."""
        weights = self.coefficients(gradient.T)
        return lambda y, v, p, q: weighted_sum(weights(p, y)[0], v)

    def _of_state(self, expression: ca.SX) -> Callable:
        """(y, v, p, q) -> an expression of the symbols."""
        inputs = [self.y, self.v, ca.vertcat(*self.p.values())]
        function = ca.Function("force", inputs, [self.numerals.rounded(expression)])
        return lambda y, v, p, q: function(ca.vertcat(*y), ca.vertcat(*v), ca.vertcat(*(p[name] for name in self.p)))

    def _derive(self) -> None:
        """The coefficients of the forces in both phases."""
        n, gap = self.size, self.exact_gap
        self.gradients = ca.horzcat(*(term.gradient for term in self.terms))
        parts = self._parts()
        inertia = Inertia(n, parts, self._exactly)
        self.accelerations, kick = -inertia.solve(self.gradients[:n, :]), inertia.solve(gap)
        compliance = gap.T @ kick
        self.flight_coefficients = self.coefficients(self.accelerations)
        self.impact = self.coefficients(kick.T / compliance)
        self.impact_mass = 1 / compliance
        self._derive_contact(parts, kick)

    def _parts(self) -> list[tuple[ca.SX, ca.SX]]:
        """The masses, with the gradients (n,) along which they move, that make the kinetic energy."""
        n = self.size
        moving = [(self.scalar(mass), self.gradient(place)[:n]) for place, mass in self._moving_masses()]
        return [*moving, *(squares_of(self.stated_inertia, self.vanishes) if self.stated_inertia.nnz() else [])]

    def _exactly(self, expression: ca.SX) -> ca.SX:
        """The same expression, a number where it is one."""
        (value,) = Entries(expression, self.symbols(self.y, self.s)).exact
        return expression if value is None else self.numerals.number(value)

    def _derive_contact(self, parts: Sequence[tuple[ca.SX, ca.SX]], kick: ca.SX) -> None:
        n, m = self.size, self.size - 1
        embed = ca.sparsify(self.exact_embed[:n, :m])
        self.contact_terms, merging = self._merged()
        columns = ca.SX(ca.sparsify(ca.DM(merging)))
        merged = self.inside(self.gradients) @ columns
        along = embed.T @ merged[:n, :]
        self.contact_gradients = ca.vertcat(along, merged[n:, :])
        self.contact_inertia = ca.sparsify(embed.T @ self.inside(self.inertia) @ embed)
        held = Inertia(m, [(self.inside(mass), embed.T @ self.inside(along)) for mass, along in parts], self._exactly)
        # The contact force takes away the acceleration of the gap that the other forces would make.
        opening = self.exact_gap.T @ self.inside(self.accelerations) @ columns
        self.contact_row = -opening / self.inside(self.exact_gap.T @ kick)
        self.contact_coefficients = self.coefficients(-held.solve(along), self.in_contact)
        self.contact_force_coefficients = self.coefficients(self.contact_row, self.in_contact)

    def inside(self, expression: ca.SX) -> ca.SX:
        """An expression of the coordinates as one of those of the contact."""
        place = ca.densify(ca.sparsify(self.exact_embed) @ self.s)
        return ca.substitute(expression, self.y, place)

    def vanishes_in_contact(self, expression: Scalar) -> bool:
        """Whether an expression of the coordinates is 0 in contact."""
        return self.vanishes(self.inside(self.scalar(expression)), self.in_contact)

    def _merged(self) -> tuple[list[Term], np.ndarray]:
        """The terms that differ in contact, and the matrix (terms, different terms) of which belong to which."""
        found: list[tuple[Term, list[int]]] = []
        for i, term in enumerate(self.terms):
            for other, members in found:
                if term.what is not None and term.what == other.what and self._same(term, other):
                    members.append(i)
                    break
            else:
                found.append((term, [i]))
        columns = np.zeros((len(self.terms), len(found)))
        for j, (_, members) in enumerate(found):
            columns[members, j] = 1.0
        return [term for term, _ in found], columns

    def _same(self, a: Term, b: Term) -> bool:
        """Whether two terms are the same function of the contact's coordinates."""
        apart = self.inside(self.scalar(a.place) - self.scalar(b.place))
        return self.vanishes(apart, self.in_contact)

    def turning(self, inertia: ca.SX, symbols: Symbols) -> Callable:
        """(coordinates, rates, p) -> the slopes of the kinetic energy by the coordinates (and displacements), which
        vanish where an inertia does not depend on them."""
        place, count, rates = symbols.place, symbols.size, ca.SX.sym("v", inertia.shape[0])
        if not self.varies(inertia, symbols):
            return lambda y, v, p: [0.0] * count
        slopes = self.numerals.rounded(ca.gradient(ca.bilin(inertia, rates, rates) / 2, place))
        function = ca.Function("turning", [place, rates, ca.vertcat(*self.p.values())], [slopes])
        return lambda y, v, p: ca.vertsplit(
            function(ca.vertcat(*y), ca.vertcat(*v[: rates.numel()]), ca.vertcat(*(p[name] for name in self.p)))
        )

    def flight(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        """The field of the flight, see `Phase`."""
        y, v = self.positions_and_rates(x, p)
        return self._field(self.terms, self.flight_coefficients(p, y), (y, v), v, p, q)

    def contact(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        """The field of the contact, see `Phase`."""
        s, rates = self.positions_and_rates(x, p)
        place = self.embedded(s, rates)
        return self._field(self.contact_terms, self.contact_coefficients(p, s), place, rates, p, q)

    def contact_force(self, x: Scalars, p: Parameters, q: Scalars) -> Any:
        """The force of the contact, which presses where it is above 0."""
        s, rates = self.positions_and_rates(x, p)
        rows = self.contact_force_coefficients(p, s)
        return weighted_sum(rows[0], self.forces(self.contact_terms, rows, self.embedded(s, rates), p, q))

    def positions_and_rates(self, x: Scalars, p: Parameters) -> tuple[list[Any], list[Any]]:
        """Coordinates with the actuators' displacements, and their rates, of a flight or a contact state."""
        ends = len(x) - len(self.actuators)
        moved = [p[rate] if self.damped_ends else 0.0 for _, rate in self.actuators]
        return [*x[:ends:2], *x[ends:]], [*x[1:ends:2], *moved]

    def embedded(self, s: Scalars, rates: Scalars) -> tuple[list[Any], list[Any]]:
        """All coordinates and rates, of those of the contact or of all."""
        if len(s) == len(self.moved):
            return list(s), list(rates)
        rows = self.embed.tolist()
        return [weighted_sum(row, s) for row in rows], [weighted_sum(row, rates) for row in rows]

    @staticmethod
    def forces(
        terms: Sequence[Term], rows: Sequence[Scalars], place: tuple[Scalars, Scalars], p: Parameters, q: Scalars
    ) -> list[Any]:
        """The forces at a place and its rates, of those terms that have a coefficient in one of the rows; 0 for the
        others."""
        used = [any(is_used(row[j]) for row in rows) for j in range(len(terms))]
        return [term.force(*place, p, q) if use else 0.0 for term, use in zip(terms, used, strict=True)]

    def _field(
        self, terms: Sequence[Term], rows: Sequence[Scalars], place: tuple, rates: Scalars, p: Parameters, q: Scalars
    ) -> list[Any]:
        forces = self.forces(terms, rows, place, p, q)
        changes = [weighted_sum(row, forces) for row in rows]
        pairs = [part for pair in zip(rates, changes, strict=False) for part in pair]
        return [*pairs, *(p[rate] for _, rate in self.actuators)]


def at_zero(expression: ca.SX, y: ca.SX) -> ca.SX:
    """An expression where all coordinates are 0."""
    return ca.substitute(expression, y, ca.SX(ca.DM.zeros(y.numel())))
