"""The weight that a contact carries: the weight of everything that rises with its gap while no spring changes its
length."""

from collections.abc import Callable
from fractions import Fraction
from functools import cache

import numpy as np

from ..laws import Algebraic, Parameters
from ..running import exclusive
from ..symbolic import Column, ExactExpression, exact_number, inner_product, total, vanishes
from .lagrange import Mechanics

CLOSE = 1e-9  # of a rate to a rational number, before that is decided exactly
LARGEST_DENOMINATOR = 60


def carried_weight(mechanics: Mechanics, stepping: bool) -> Callable[[Parameters], Algebraic | None]:
    """p -> the weight, see `Model`; None where no such motion is known, or where two points take turns (`stepping`).

    The rates (n,) of that motion open the gap with the speed 1, and are rational numbers such that of the conservative
    forces only weights have power, for example where all places rise together. By momentum the weight is the mean
    contact force of a periodic motion under constant gravity.
    """

    @cache
    @exclusive
    def found() -> Callable[[Parameters], Algebraic] | None:
        rates = None if stepping else _rates(mechanics)
        if rates is None:
            return None
        power = total(inner_product(each.gradient, rates) for each in mechanics.in_flight.terms if each.is_weight)
        coefficients = mechanics.coordinates.coefficients([[power]])
        return None if coefficients.by_coordinates else lambda p: coefficients(p)[0][0]

    return lambda p: weight(p) if (weight := found()) else None


def _rates(mechanics: Mechanics) -> list[ExactExpression] | None:
    """The rates (n + k,), None where there are no such numbers."""
    c, terms = mechanics.coordinates, mechanics.in_flight.terms
    strained: list[Column] = [each.gradient for each in terms if each.conservative and not each.is_weight]
    ends = len(c.moved) - c.size
    gap = [*mechanics.gap.numbers.tolist(), *[0.0] * ends]
    # A configuration and parameters at random, as it has to hold for all.
    random = np.random.default_rng(1)
    y, p = (dict(zip(names, random.uniform(0.5, 1.5, len(names)).tolist(), strict=True)) for names in (c.moved, c.p))
    rows = c.coefficients(strained)(p, [*y.values()]) if strained else []
    matrix = np.array([gap, *([float(entry) for entry in row] for row in rows)])
    matrix[1:, c.size :] = 0.0  # actuators stand still
    numbers = np.linalg.lstsq(matrix, np.eye(len(matrix))[0], rcond=None)[0]
    near = [Fraction(each).limit_denominator(LARGEST_DENOMINATOR) for each in numbers.tolist()]
    if not np.abs(numbers - np.array(near, dtype=float)).max() < CLOSE:
        return None
    rates, opening = [*map(exact_number, near)], sum(Fraction(w) * each for w, each in zip(gap, near, strict=True))
    return rates if opening == 1 and all(vanishes(inner_product(each, rates)) for each in strained) else None
