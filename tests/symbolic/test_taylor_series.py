"""Taylor series of expression graphs against repeated symbolic differentiation and closed-form solutions."""

import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import composed_coefficients, has_taylor_series, taylor_coefficients

ORDER = 10
FUNCTIONS = {
    "add": lambda r: 2 + r,
    "polynomial": lambda r: r**7 - 3 * r**3 + r,
    "quotient": lambda r: r / (2 + r * r),
    "inverse": lambda r: 1 / (1 + r),
    "inverse square": lambda r: (1 + r) ** -2,
    "power": lambda r: (1 + r) ** 2.5,
    "variable power": lambda r: (1 + r) ** (0.5 + r),
    "square root": lambda r: ca.sqrt(1 + r),
    "exp": ca.exp,
    "expm1": ca.expm1,
    "log": lambda r: ca.log(2 + r),
    "log1p": ca.log1p,
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "asin": ca.asin,
    "acos": ca.acos,
    "atan": ca.atan,
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "tanh": ca.tanh,
    "asinh": ca.asinh,
    "acosh": lambda r: ca.acosh(2 + r),
    "atanh": ca.atanh,
    "erf": ca.erf,
    "nested": lambda r: ca.exp(-(ca.sin(r) ** 2)) / ca.cosh(r),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_coefficients_are_lie_derivatives(name):
    """Coefficient k of g(x(t)) is the k-th derivative of g along the field, over k!."""
    g = FUNCTIONS[name]
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    rates = ca.vertcat(x[1], -p * g(x[0]))
    field = ca.Function("field", [x, p], [rates, g(x[0])])
    assert has_taylor_series(field)
    series = ca.Function("series", [x, p], [taylor_coefficients(field, x, p, ORDER)])
    terms, term = [], g(x[0])
    for k in range(7):
        terms.append(term)
        term = ca.jtimes(term, x, rates) / (k + 1)
    expected = np.array(ca.Function("lie", [x, p], [ca.vertcat(*terms)])([0.3, 0.7], 1.3)).ravel()
    assert np.array(series([0.3, 0.7], 1.3))[2, :7] == pytest.approx(expected, rel=1e-13, abs=1e-14)


def test_the_exponential_has_its_series():
    x = ca.SX.sym("x")
    field = ca.Function("field", [x, ca.SX.sym("p", 0)], [x, ca.SX(0, 1)])
    series = ca.Function("series", [x], [taylor_coefficients(field, x, ca.SX.sym("p", 0), 20)])
    factorials = np.cumprod(np.maximum(np.arange(21), 1.0))
    assert np.array(series(1)).ravel() == pytest.approx(1 / factorials, rel=1e-14)


@pytest.mark.parametrize("g", [ca.fabs, ca.sign, lambda r: ca.if_else(r > 0, r, 2 * r), lambda r: ca.fmax(r, 0)])
def test_graphs_without_a_series_are_recognised(g):
    x = ca.SX.sym("x")
    assert not has_taylor_series(ca.Function("field", [x, ca.SX.sym("p", 0)], [g(x), ca.SX(0, 1)]))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_series_of_a_function_along_a_polynomial(name):
    """Against the derivatives of the composed function, of a place and a parameter."""
    t, p, x = ca.SX.sym("t"), ca.SX.sym("p"), ca.SX.sym("x", 2)
    places = [0.3 + 0.7 * t - 0.2 * t**3, 0.4 - 0.1 * t**2]
    of = ca.Function("of", [x, p], [FUNCTIONS[name](x[0]) * (p + x[1])])
    rows = [[0.3, 0.7, 0.0, -0.2, 0.0, 0.0], [0.4, 0.0, -0.1, 0.0, 0.0, 0.0]]
    found = composed_coefficients(of, [[ca.SX(value) for value in row] for row in rows], p)
    term, expected = of(ca.vertcat(*places), p), []
    for k in range(6):
        expected.append(term)
        term = ca.jacobian(term, t) / (k + 1)
    both = ca.Function("both", [t, p], [ca.densify(found), ca.vertcat(*expected)])(0.0, 1.3)
    assert np.array(both[0]).ravel() == pytest.approx(np.array(both[1]).ravel(), rel=1e-13, abs=1e-14)


def test_the_series_of_nothing():
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    rows = [[ca.SX(1.0), ca.SX(2.0)]] * 2
    assert composed_coefficients(ca.Function("f", [x, p], [ca.SX(1, 1)]), rows, p).is_zero()
