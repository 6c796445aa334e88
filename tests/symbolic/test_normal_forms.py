"""Normal forms: against arithmetic in fractions at points, identities, and what is no identity."""

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import (
    ExactExpression,
    expression as exact,
    lifted,
    lowered,
    number_of,
    substitute,
    symbol,
    vanishes,
    without,
)
from orbits.symbolic.identities import simplified
from orbits.symbolic.normal_forms import constant as constant_of, normal_form, written
from orbits.symbolic.tree import call, symbols_in

A, B, C = SYMBOLS = [ca.SX.sym(name) for name in "abc"]
EXACT = list(map(symbol, "abc"))


def tree(expression) -> ExactExpression:
    """The exact expression of one of a, b and c."""
    return lifted([ca.SX(expression)], dict(zip(SYMBOLS, EXACT, strict=True)))[0]


def constant(expression):
    """The number that an expression of a, b and c is; both decisions agree."""
    found = tree(expression)
    number = number_of(found)
    assert number == constant_of(normal_form(found))
    assert vanishes(found) == (number == 0)
    return number


@pytest.mark.parametrize(
    ("expression", "number"),
    [
        (A - B - (A - B), 0),
        ((A + B) ** 2 - A**2 - 2 * A * B - B**2, 0),
        ((A**2 - B**2) / (A - B) / (A + B), 1),
        (1 / (1 / A + 1 / B) - A * B / (A + B), 0),
        (1 / (A + B) + 1 / (A - B) - 2 * A / (A**2 - B**2), 0),
        (3 * (A + B * C) / (A / 2 + B * C / 2), 6),
        (ca.sin(A) ** 2 + ca.cos(A) ** 2, 1),
        (ca.sin(A) / ca.cos(A) - ca.tan(A), 0),
        (1 / ca.cos(A) ** 2 - ca.tan(A) ** 2, 1),
        (ca.cos(A) ** 4 - ca.sin(A) ** 4 - 1 + 2 * ca.sin(A) ** 2, 0),
        (ca.sqrt(A + B) ** 2 / (A + B), 1),
        ((1 - ca.sqrt(A)) / (1 - A) - 1 / (1 + ca.sqrt(A)), 0),
        (ca.sqrt(ca.sqrt(A)) ** 4 - A, 0),
        (ca.exp(A * B) - ca.exp(B * A), 0),
        (ca.sin(A - B) + ca.sin(B - A), 0),
        (ca.cos(A - B) - ca.cos(B - A) + ca.tan(C) + ca.tan(-C), 0),
        (ca.tanh(A - B) + ca.tanh(B - A), 0),
        ((A - B) * ca.fabs(A - B) + (B - A) * ca.fabs(B - A), 0),
        (ca.cosh(-2 * A) - ca.cosh(2 * A) + ca.erf(-B) + ca.erf(B), 0),
        (A + 2.0**-80 - A, Fraction(1, 2**80)),
        (ca.SX(0.1) * A / A, Fraction(0.1)),
    ],
)
def test_identities(expression, number):
    assert constant(expression) == number


@pytest.mark.parametrize(
    "expression",
    [
        A + 2.0**-80, 1 + A * 1e-300, ca.exp(-50 * A), ca.fabs(A), ca.fabs(A) / A, ca.sqrt(A**2) - A, A**0.5, A**-2,
        ca.if_else(A > 0, 1, 1 + A), ca.sin(A) ** 2 - ca.cos(A) ** 2, 1 / (A - A), ca.SX(np.inf) * A, A**100,
    ],
)  # fmt: skip
def test_no_identities(expression):
    assert constant(expression) is None


def test_what_is_too_long_is_no_number_unless_it_drops_out():
    long = (1 + A + B + C) ** 16
    assert constant(long / (1 + A + B + C) ** 15 - A - B - C) in (1, None)
    assert constant(long * A - A * long + B / B) == 1


def test_independence_of_some_symbols():
    a, b, c = EXACT
    ratio = (a + b) * c / (a**2 + a * b)
    free = without(ratio, [b])
    assert free is not None
    assert free is without(free, [b])
    assert vanishes(free - c / a)
    assert without(ratio, [a]) is None


def drawn(random, depth):
    """A random expression of three symbols."""
    if depth == 0:
        place = int(random.integers(4))
        return exact(Fraction(int(random.integers(-3, 4)), int(random.integers(1, 4)))) if place == 3 else EXACT[place]
    left, right = (drawn(random, depth - 1) for _ in range(2))
    kind = int(random.integers(4))
    if kind == 0 or (kind == 3 and vanishes(right)):
        return left + right
    return left * right if kind == 1 else left**2 if kind == 2 else left / right


def test_arithmetic_at_points():
    """300 random expressions, each at one point: the normal form has the same value in fractions."""
    random = np.random.default_rng(5)
    point = dict(zip(EXACT, (Fraction(3, 7), Fraction(-5, 11), Fraction(13, 17)), strict=True))
    for _ in range(300):
        own = drawn(random, int(random.integers(1, 5)))
        value, again = substitute([own, written(normal_form(own))], point)
        assert value is again or not value.is_number  # the point is a pole


def test_the_expression_is_the_same_function():
    expression = (A**2 * B - 3 * C / A + 0.25) / (B - C) ** 2 - ca.sin(A * B) * ca.sqrt(C)
    found = written(normal_form(tree(expression)))
    again = lowered([found], dict(zip(EXACT, SYMBOLS, strict=True)))[0]
    both = ca.Function("entry", [ca.vertcat(*SYMBOLS)], [expression, again])
    for point in np.random.default_rng(1).uniform(0.5, 2.0, (10, 3)):
        known, value = map(float, both(point))
        assert value == pytest.approx(known, rel=1e-12)


def test_a_symbol_that_drops_out_of_an_argument_comes_back_nowhere():
    """Equal function values are one, also those of other machines, which lack the symbol."""
    x, h = symbol("x"), symbol("h")
    first = simplified(call("exp", (x + h) * (x - h) + h * h))
    again = simplified(call("exp", x * x))
    assert first is again
    assert symbols_in([again])[again] == {x}
