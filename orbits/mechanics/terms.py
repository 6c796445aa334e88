"""Forces of elements, and forces quadratic in the speeds, as terms of the equations of motion."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..errors import InputError
from ..laws.law import Algebraic, Key, Parameters, Scalars
from ..model.phase import weighted_sum
from ..symbolic.formula import symbolic_numerals
from .coordinates import Coordinates
from .elements import Damper, Element, Force, Inerter, Mass, Potential, Scalar, Spring, Weight, paths_of, value_of

# Share of the variation of gravity, led from 0 to 1 to come from constant gravity to the one that is stated.
GRAVITY_SHARE = "gravity_share"


class Term(NamedTuple):
    """One force of a mechanism.

    element : whose force it is, None for a force quadratic in the speeds
    force : (y, v, p, q) -> the force, of coordinates with the actuators' displacements, rates, parameters and data
    gradient : (n + k,), of the function that it acts against, by the coordinates and the displacements
    conservative : whether it is one of the energy's
    what : equal for terms that are the same function of the place, None where that is not known
    place : the function of the coordinates that the force depends on
    by_rates : the force as an expression, of one that depends on the rates
    """

    element: Element | None
    force: Callable
    gradient: ca.SX
    conservative: bool = True
    what: str | Spring | None = None
    place: Scalar = 0.0
    by_rates: ca.SX | None = None

    @property
    def is_weight(self) -> bool:
        """Whether it is the weight of a mass."""
        return isinstance(self.element, Mass | Weight)


@dataclass(frozen=True)
class Gravity:
    """The law of a height, with its unit.

    key : of the acceleration
    surface : the factor of the law
    """

    key: Key
    surface: Scalar

    @property
    def varies(self) -> bool:
        """Whether it depends on the height."""
        return self.key.degree() > 0

    def at_ground(self, c: Coordinates) -> ca.SX:
        """The acceleration at the height 0."""
        with symbolic_numerals(c.numerals.symbols, folded=True):
            law = self.key.expression(ca.SX(0), c.p, [])
        return c.scalar(self.surface) * law

    def pull(self, height: Algebraic, p: Parameters) -> Algebraic:
        """Gravity at a height over that at the ground, with the share of its variation that the parameter says."""
        ground = self.key.expression(0.0, p, [])
        return 1 + p[GRAVITY_SHARE] * (self.key.expression(height, p, []) / ground - 1)


def moving_masses(elements: Sequence[Element]) -> list[tuple[Scalar, Scalar]]:
    """The functions of the coordinates along which something with a mass moves, and the masses."""
    masses = [(place, each.mass) for each in elements if isinstance(each, Mass) for place in paths_of(each)]
    return masses + [(each.extension, each.inertance) for each in elements if isinstance(each, Inerter)]


def bend_of(c: Coordinates, place: Scalar) -> ca.SX:
    """The second derivative of a function of the coordinates in a motion without accelerations of these."""
    return ca.bilin(ca.jacobian(c.gradient(place), c.y), c.v, c.v)


def mass_of(c: Coordinates, expression: Scalar) -> ca.SX:
    """A mass, which does not depend on the coordinates; raises `InputError` for one that does."""
    mass = c.scalar(expression)
    if ca.depends_on(mass, c.y):
        raise InputError(f"mass '{expression}' depends on coordinates: state such an inertia as inertia=")
    return mass


def terms_of(c: Coordinates, elements: Sequence[Element], gravity: Gravity, stated: ca.SX) -> list[Term]:
    """All forces: those of the elements, of springs without laws yet, and those quadratic in the speeds, `stated`
    being the inertia (n, n) beside that of the elements."""
    ground = gravity.at_ground(c)
    forces = [term for element in elements for term in _terms_of(c, element, gravity, ground)]
    weights = [term for term in forces if term.what == "constant gravity"]
    forces = [term for term in forces if term.what != "constant gravity"]
    if weights:  # under constant gravity all weights are one force
        whole = sum((each.gradient for each in weights[1:]), weights[0].gradient)
        forces.append(weights[0]._replace(gradient=whole))
    return [*forces, *_inertial_terms(c, elements, stated)]


def with_law(c: Coordinates, term: Term, laws: Sequence[Key]) -> Term:
    """A term, of a spring with the force of its law; the force of a `Spring` is here its place among the laws."""
    if not isinstance(term.element, Spring):
        return term
    extension, law = term.element.extension, laws[term.element.force].expression
    return term._replace(force=lambda y, v, p, q: law(value_of(extension, c.named(y), p), p, q))


def _no_law(y: Scalars, v: Scalars, p: Parameters, q: Scalars) -> float:
    raise AssertionError("the springs have no laws yet")


def _terms_of(c: Coordinates, element: Element, gravity: Gravity, ground: ca.SX) -> Iterator[Term]:
    """The forces of an element, the acceleration of gravity being `ground` at the height 0."""
    if isinstance(element, Spring):
        yield Term(element, _no_law, c.gradient(element.extension), True, element, element.extension)
    elif isinstance(element, Mass | Weight):
        height, weight = element.height, mass_of(c, element.mass) * c.gradient(element.height) * ground
        if gravity.varies:
            pull = lambda y, v, p, q: gravity.pull(value_of(height, c.named(y), p), p)  # noqa: E731
            yield Term(element, pull, weight, True, "gravity", height)
        else:  # the same force for all
            yield Term(element, lambda y, v, p, q: 1.0, weight, True, "constant gravity")
    elif isinstance(element, Damper):
        gradient, coefficient = c.gradient(element.extension), c.scalar(element.coefficient)
        weights, rate = c.coefficients(gradient.T), ca.dot(gradient, c.v)
        force = lambda y, v, p, q: weighted_sum(weights(p, y)[0], v)  # noqa: E731
        yield Term(element, force, gradient * coefficient, False, "damper", element.extension, rate)
    elif isinstance(element, Potential):
        slopes = c.gradient(element.energy)
        for i, along in enumerate(np.eye(len(c.moved))):
            if not slopes[i].is_zero():
                yield Term(element, _of_state(c, slopes[i]), ca.SX(along))
    elif isinstance(element, Force):
        stated = element.force
        against = lambda y, v, p, q: -stated(c.named(y), c.named(v), p)  # noqa: E731
        by_rates = ca.SX(against(ca.vertsplit(c.y), ca.vertsplit(c.v), c.p, []))
        yield Term(element, against, c.gradient(element.along), False, by_rates=by_rates)


def _inertial_terms(c: Coordinates, elements: Sequence[Element], stated: ca.SX) -> Iterator[Term]:
    """Forces quadratic in the speeds: a mass that moves along a function h of the coordinates has the acceleration
    J^T y'' + v^T (Hessian of h) v; and the terms of a stated inertia that depends on the configuration."""
    symbols = c.symbols(c.y, c.v)
    turning = [each for each in elements if isinstance(each, Mass) and each.across is not None]
    # Those of a mass on a circle vanish together.
    whole = [sum(c.gradient(place) * bend_of(c, place) for place in paths_of(each)) for each in turning]
    round_ = [each for each, force in zip(turning, whole, strict=True) if c.vanishes(ca.densify(force), symbols)]
    for place, mass in moving_masses([each for each in elements if not any(each is one for one in round_)]):
        bend = bend_of(c, place)
        if not c.vanishes(bend, symbols):
            along = c.scalar(mass) * c.gradient(place)
            yield Term(None, _of_state(c, bend), along, False, by_rates=bend)
    v = c.v[: c.size]
    if c.varies(stated):
        energy = ca.bilin(stated, v, v) / 2
        force = ca.jtimes(stated @ v, c.y, c.v) - ca.gradient(energy, c.y)[: c.size]
        for i, row in enumerate(np.eye(len(c.moved))[: c.size]):
            yield Term(None, _of_state(c, force[i]), ca.SX(row), False, by_rates=force[i])


def _of_state(c: Coordinates, expression: ca.SX) -> Callable:
    """(y, v, p, q) -> an expression of the symbols."""
    function = ca.Function("force", [c.y, c.v, ca.vertcat(*c.p.values())], [c.numerals.rounded(expression)])
    return lambda y, v, p, q: function(ca.vertcat(*y), ca.vertcat(*v), ca.vertcat(*(p[name] for name in c.p)))
