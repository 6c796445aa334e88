"""Forces of elements as terms of the equations of motion, and sums of them."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import casadi as ca

from ..laws.law import Scalars
from .elements import Element, Mass, Weight


class Term(NamedTuple):
    """One force of a mechanism.

    element : whose force it is, None for what is quadratic in the speeds
    force : (y, v, p, q) -> the force, of coordinates with the actuators' displacements, rates, parameters and data
    gradient : (n + k,), of the function that it acts against, by the coordinates and the displacements
    conservative : whether it is one of the energy's
    what : equal for terms that are the same function of the place, None where that is not known
    place : of which the force is a function
    by_rates : the force as an expression, of one that depends on the rates
    """

    element: Element | None
    force: Callable
    gradient: ca.SX
    conservative: bool = True
    what: Any = None
    place: Any = None
    by_rates: ca.SX | None = None

    @property
    def is_weight(self) -> bool:
        """Whether it is the weight of a mass."""
        return isinstance(self.element, Mass | Weight)


def one_weight(terms: Sequence[Term]) -> list[Term]:
    """The terms with all weights under constant gravity in one."""
    weights = [term for term in terms if term.what == "constant gravity"]
    others = [term for term in terms if term.what != "constant gravity"]
    if weights:
        others.append(weights[0]._replace(gradient=sum((each.gradient for each in weights[1:]), weights[0].gradient)))
    return others


def is_used(coefficient: Any) -> bool:
    """Whether a coefficient is anything but the number 0."""
    return not (isinstance(coefficient, float) and coefficient == 0.0)


def weighted_sum(weights: Scalars, values: Scalars) -> Any:
    """The sum of products, without those whose weight is 0."""
    total: Any = None
    for weight, value in zip(weights, values, strict=False):
        if is_used(weight):
            part = value if isinstance(weight, float) and weight == 1.0 else weight * value
            total = part if total is None else total + part
    return 0.0 if total is None else total
