"""Forces of elements as terms of the equations of motion."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from ..errors import InputError
from ..laws import Algebraic, Key, Parameters, Scalars
from ..model import weighted_sum
from ..symbolic import ONE, ZERO, Column, ExactExpression, depends_on, inner_product, total
from .coordinates import Coordinates
from .elements import Damper, Element, Force, Inerter, Mass, Potential, Scalar, Spring, Weight, paths_of, value_of

# Share of the variation of gravity, led from 0 to 1 to come from constant gravity to the one that is stated.
GRAVITY_SHARE = "gravity_share"


class Term(NamedTuple):
    """One force of a mechanism.

    element : whose force it is
    force : (y, v, p, q) -> the force, of coordinates with the actuators' displacements, rates, parameters and data
    gradient : (n + k,), of the function that it acts against, by the coordinates and the displacements
    conservative : whether it is one of the energy's
    what : equal for terms that are the same function of the place, None where that is not known
    place : the function of the coordinates that the force depends on
    by_rates : the force as an expression, of one that depends on the rates
    """

    element: Element
    force: Callable
    gradient: Column
    conservative: bool = True
    what: str | Spring | None = None
    place: Scalar = 0.0
    by_rates: ExactExpression | None = None

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

    def at_ground(self, c: Coordinates) -> ExactExpression:
        """The acceleration at the height 0."""
        return c.scalar(self.surface) * c.of_function(lambda y, v: self.key.expression(ca.SX(0), c.p, []))

    def pull(self, height: Algebraic, p: Parameters) -> Algebraic:
        """Gravity at a height over that at the ground, with the share of its variation that the parameter says."""
        ground = self.key.expression(0.0, p, [])
        return 1 + p[GRAVITY_SHARE] * (self.key.expression(height, p, []) / ground - 1)


def moving_masses(elements: Sequence[Element]) -> list[tuple[Scalar, Scalar]]:
    """The functions of the coordinates along which something with a mass moves, and the masses."""
    masses = [(place, each.mass) for each in elements if isinstance(each, Mass) for place in paths_of(each)]
    return masses + [(each.extension, each.inertance) for each in elements if isinstance(each, Inerter)]


def mass_of(c: Coordinates, expression: Scalar) -> ExactExpression:
    """A mass, which does not depend on the coordinates; raises `InputError` for one that does."""
    mass = c.scalar(expression)
    if depends_on([mass], c.y):
        raise InputError(f"mass '{expression}' depends on coordinates: state it as inertia=")
    return mass


def terms_of(c: Coordinates, elements: Sequence[Element], gravity: Gravity) -> list[Term]:
    """The forces of elements, of springs without laws yet."""
    ground = gravity.at_ground(c)
    forces = [term for element in elements for term in _terms_of(c, element, gravity, ground)]
    weights = [term for term in forces if term.what == "constant gravity"]
    forces = [term for term in forces if term.what != "constant gravity"]
    if weights:  # under constant gravity all weights are one force
        whole = [total(column) for column in zip(*(each.gradient for each in weights), strict=True)]
        forces.append(weights[0]._replace(gradient=whole))
    return forces


def with_law(c: Coordinates, term: Term, laws: Sequence[Key]) -> Term:
    """A term, of a spring with the force of its law; the force of a `Spring` is here its place among the laws."""
    if not isinstance(term.element, Spring):
        return term
    extension, law = term.element.extension, laws[term.element.force].expression
    return term._replace(force=lambda y, v, p, q: law(value_of(extension, c.named(y), p), p, q))


def _no_law(y: Scalars, v: Scalars, p: Parameters, q: Scalars) -> float:
    raise AssertionError("the springs have no laws yet")


def _terms_of(c: Coordinates, element: Element, gravity: Gravity, ground: ExactExpression) -> Iterator[Term]:
    """The forces of an element, the acceleration of gravity being `ground` at the height 0."""
    if isinstance(element, Spring):
        yield Term(element, _no_law, c.gradient(element.extension), True, element, element.extension)
    elif isinstance(element, Mass | Weight):
        height, size = element.height, mass_of(c, element.mass) * ground
        weight = [size * each for each in c.gradient(height)]
        if gravity.varies:
            pull = lambda y, v, p, q: gravity.pull(value_of(height, c.named(y), p), p)  # noqa: E731
            yield Term(element, pull, weight, True, "gravity", height)
        else:  # the same force for all
            yield Term(element, lambda y, v, p, q: 1.0, weight, True, "constant gravity")
    elif isinstance(element, Damper):
        gradient, coefficient = c.gradient(element.extension), c.scalar(element.coefficient)
        weights, rate = c.coefficients([gradient]), inner_product(gradient, c.v)
        force = lambda y, v, p, q: weighted_sum(weights(p, y)[0], v)  # noqa: E731
        along = [coefficient * each for each in gradient]
        yield Term(element, force, along, False, "damper", element.extension, rate)
    elif isinstance(element, Potential):
        for i, slope in enumerate(c.gradient(element.energy)):
            if not slope.is_(0):
                unit = [ONE if j == i else ZERO for j in range(len(c.moved))]
                yield Term(element, _of_place(c, slope), unit)
    elif isinstance(element, Force):
        stated = element.force
        against = lambda y, v, p, q: -stated(c.named(y), c.named(v), p)  # noqa: E731
        by_rates = c.of_function(lambda y, v: against(y, v, c.p, []))
        yield Term(element, against, c.gradient(element.along), False, by_rates=by_rates)


def _of_place(c: Coordinates, expression: ExactExpression) -> Callable:
    """(y, v, p, q) -> an expression of the coordinates."""
    found = c.coefficients([[expression]])
    return lambda y, v, p, q: found(p, y)[0][0]
