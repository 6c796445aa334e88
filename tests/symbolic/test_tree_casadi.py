"""Exact expressions from CasADi's and as CasADi's: values, derivatives, and numbers that doubles do not have."""

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from orbits import InputError
from orbits.symbolic import derivative_by, exact_number, lifted, lowered, rounded, symbol

A, B = (ca.SX.sym(name) for name in "ab")
X, Y = symbol("a"), symbol("b")
EXPRESSIONS = [
    (A - 2 * B) ** 3 / (1 + A**2), A**B - ca.sqrt(A), ca.sin(A) * ca.cos(B) - ca.tan(A * B), ca.atan2(A, B),
    ca.fmin(A, B**2), ca.if_else(A > B, A * B, ca.exp(B)), ca.fabs(A - B) + ca.sign(A), ca.erf(A) - ca.log1p(B),
    ca.asinh(A) + ca.tanh(B) ** 2, A**1.5,
]  # fmt: skip


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_values_and_derivatives_are_casadis(expression):
    (found,) = lifted([expression], {A: X, B: Y})
    again = lowered([found, derivative_by(found, X), derivative_by(found, Y)], {X: A, Y: B})
    known = ca.vertcat(expression, ca.gradient(expression, ca.vertcat(A, B)))
    both = ca.Function("both", [A, B], [known, ca.vertcat(*again)])
    for point in np.random.default_rng(2).uniform(0.3, 2.0, (8, 2)):
        expected, values = both(*point)
        assert np.array(values) == pytest.approx(np.array(expected), rel=1e-13, abs=1e-14)


def test_doubles_are_the_numbers_that_they_are():
    (found,) = lifted([A * 0.1], {A: X})
    assert found is X * Fraction(0.1)


def test_what_is_not_finite_stays():
    (found,) = lowered(lifted([ca.SX(np.inf) * A], {A: X}), {X: A})
    assert float(ca.evalf(ca.substitute(found, A, 2.0))) == np.inf


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (Fraction(10) ** 400, r"the size 1.00e\+400, above 1e308"),
        (Fraction(1, 10**400), r"the size 1.00e-400, below 1e-300"),
        (-Fraction(1, 10**310), r"the size 1.00e-310, below 1e-300"),
    ],
)
def test_numbers_beyond_doubles_are_refused(number, text):
    with pytest.raises(InputError, match=f"{text}.*other units"):
        lowered([exact_number(number) * X], {X: A})
    assert rounded(Fraction(1, 3)) == 1 / 3
