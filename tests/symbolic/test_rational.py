"""Normal forms: against arithmetic in fractions at points, identities, and what is no identity."""

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import rational
from orbits.symbolic.polynomials import number_of
from orbits.symbolic.rational import NormalForms, Ratio, normalised, rounded

A, B, C = (ca.SX.sym(name) for name in "abc")
SYMBOLS = [A, B, C]


def constant(expression, exact=None):
    """The number that an expression of a, b and c is."""
    function = ca.Function("entry", [ca.vertcat(*SYMBOLS)], [ca.SX(expression)])
    found = normalised(function, SYMBOLS, exact or {})
    return found.forms.constant(found.results[0])


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


def test_symbols_that_stand_for_numbers():
    assert constant(A + B - A, {0: Fraction(10**16), 1: Fraction(3)}) == 3
    assert constant(A * C / C, {0: Fraction(1, 3)}) == Fraction(1, 3)


def test_independence_of_some_symbols():
    forms = NormalForms(SYMBOLS)
    a, b, c = map(forms.symbol, range(3))
    product = forms.multiply(forms.add(a, b), c)
    ratio = forms.multiply(product, forms.inverse(forms.add(forms.multiply(a, a), forms.multiply(a, b))))
    free = forms.without(ratio, [1])
    assert free is not None
    assert forms.variables(free) == {0, 2}
    assert forms.without(ratio, [0]) is None


def value(polynomial, point):
    """A polynomial at a point of fractions."""
    total = Fraction(0)
    for monomial, coefficient in polynomial.items():
        term = Fraction(coefficient)
        for generator, exponent in monomial:
            term *= point[generator] ** exponent
        total += term
    return total


def drawn(random, forms, point, depth):
    """A random expression of three symbols as a normal form, and its value at a point."""
    if depth == 0:
        place = int(random.integers(4))
        if place == 3:
            number = Fraction(int(random.integers(-3, 4)), int(random.integers(1, 4)))
            return Ratio({(): number_of(number)} if number else {}), number
        return forms.symbol(place), point[place]
    (left, x), (right, y) = (drawn(random, forms, point, depth - 1) for _ in range(2))
    kind = int(random.integers(4))
    if kind == 0 or (kind == 3 and not right.numerator):
        return forms.add(left, right), x + y
    if kind == 1:
        return forms.multiply(left, right), x * y
    if kind == 2:
        return forms.power(left, 2), x**2
    return forms.multiply(left, forms.inverse(right)), x / y


def test_arithmetic_at_points():
    """300 random expressions, each at one point where it has a value."""
    random, point, done = np.random.default_rng(5), [Fraction(3, 7), Fraction(-5, 11), Fraction(13, 17)], 0
    while done < 300:
        forms = NormalForms(SYMBOLS)
        try:
            form, number = drawn(random, forms, point, int(random.integers(1, 5)))
        except (rational.TooLargeError, ZeroDivisionError):
            continue
        denominator = value(forms.expanded(form.factors), point)
        assert value(form.numerator, point) == number * denominator
        done += 1


def test_the_expression_is_the_same_function():
    expression = (A**2 * B - 3 * C / A + 0.25) / (B - C) ** 2 - ca.sin(A * B) * ca.sqrt(C)
    function = ca.Function("entry", [ca.vertcat(*SYMBOLS)], [expression])
    found = normalised(function, SYMBOLS, {})
    again = ca.Function("again", [ca.vertcat(*SYMBOLS)], [found.forms.expression(found.results[0])])
    for point in np.random.default_rng(1).uniform(0.5, 2.0, (10, 3)):
        assert float(again(point)) == pytest.approx(float(function(point)), rel=1e-12)


def test_numbers_beyond_doubles_are_not_rounded():
    for number in (Fraction(10) ** 400, Fraction(1, 10**400), Fraction(1, 10**310)):
        with pytest.raises(OverflowError):
            rounded(number)
    assert rounded(Fraction(1, 3)) == 1 / 3
