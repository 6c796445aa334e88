"""Taylor models hold the functions that they stand for."""

import math
import random

import pytest
from flint import arb

from orbits.balls import TaylorModel, model_arithmetic

PLACES = [-1.0, -0.7, -0.2, 0.0, 0.35, 0.9, 1.0]


@pytest.fixture(autouse=True)
def arithmetic():
    with model_arithmetic():
        yield


def polynomial(seed, degree, shrink=1):
    """Coefficients of a polynomial in s, and its model with a small rest."""
    draw = random.Random(seed)
    coefficients = [draw.uniform(-0.2, 0.2) / shrink**k for k in range(degree + 1)]
    return coefficients, TaylorModel.of_curve([arb(each) for each in coefficients], arb(1e-9))


def value(coefficients, s):
    return sum(each * s**k for k, each in enumerate(coefficients))


@pytest.mark.parametrize("degree", [3, 10])
def test_products_beyond_the_degree(degree):
    (a, first), (b, second) = polynomial(1, degree), polynomial(2, degree)
    found = first * second + 3 * first - second / 7
    assert float(found.rest) < (1e-6 if degree == 3 else 1.0)
    for s in PLACES:
        for off in (-1e-9, 0.0, 1e-9):
            x, y = value(a, s) + off, value(b, s) - off
            assert found.on(arb(s)).overlaps(arb(x * y + 3 * x - y / 7))


FUNCTIONS = {"exp": math.exp, "sin": math.sin, "tanh": math.tanh, "sqrt": math.sqrt, "log": math.log, "sinh": math.sinh}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_and_quotients(name):
    coefficients, model = polynomial(3, 6, shrink=8)
    found = getattr(1.5 + model, name)() / (2 + model)
    for s in PLACES:
        x = value(coefficients, s)
        here = found.on(arb(s))
        assert (here + arb(0, 1e-14)).overlaps(arb(FUNCTIONS[name](1.5 + x) / (2 + x)))
        assert here.rad() < 1e-5


def test_what_has_no_value_is_not_bounded():
    _, model = polynomial(4, 3)
    assert not (1 / model).is_finite()
    assert not (model - 5).log().is_finite()
