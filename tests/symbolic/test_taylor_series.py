"""Taylor series of expression graphs against repeated symbolic differentiation and closed-form solutions."""

import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import driven_coefficients, has_taylor_series, tangent, taylor_coefficients, variations

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


def test_sensitivities_with_columns_of_nothing():
    """A field with a constant rate, a parameter that it does not have and one that enters alone."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 3)
    field = ca.Function("f", [x, p], [ca.vertcat(x[1], -x[0] * p[0], p[2]), x[0] * x[1]])
    series = variations(field, (0, 1, 2), 6, 20)
    start, values, h, step = np.array([1.0, 0.5, 0.2]), np.array([2.0, 5.0, 0.3]), 0.3, 1e-6
    powers = h ** np.arange(21)

    def end(start, values):
        return powers @ series(start, values, 0, 0)[0].full()[:, :3]

    slopes = powers @ series(start, values, *np.vsplit(np.eye(6), 2))[1].full()
    for i, dx in enumerate(slopes.reshape(6, 3)):
        change = np.eye(6)[i]
        moved = [end(start + sign * step * change[:3], values + sign * step * change[3:]) for sign in (1, -1)]
        assert dx == pytest.approx((moved[0] - moved[1]) / (2 * step), abs=1e-8)
        alone = tangent(field, (0, 1, 2), 20)(start, values, *np.split(change, 2))[1].full()
        assert powers @ alone == pytest.approx(dx, rel=1e-14, abs=1e-14)


def test_forces_drive_all_states():
    """Two masses on one nonlinear spring, of four multiples, also of 0: the motion of one force gives every state, and
    the watched quantity; with damping nothing is driven."""
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", 4)
    force = ca.sinh(x[0] - x[2])
    rates = ca.vertcat(x[1], -p[2] - p[0] * force, x[3], -p[3] + p[1] * force)
    rng = np.random.default_rng(5)
    for own, driven in ((rates, True), (rates - 0.1 * ca.vertcat(0, x[1], 0, x[3]), False)):
        field = ca.Function("field", [x, p], [own, x[0] * x[2]])
        base, shares, series = driven_coefficients(field, x, p, 12)
        assert (series.shape[0] < 5) == driven
        both = [base + shares @ series, taylor_coefficients(field, x, p, 12)]
        compared = ca.Function("compared", [x, p], [ca.densify(each) for each in both])
        for multiples in (rng.uniform(0.5, 2, 4), np.array([0.0, 1.5, 1.0, 1.0]), np.array([1e-9, -1e9, 0.0, 1.0])):
            mine, theirs = (np.array(each) for each in compared(rng.normal(size=4), multiples))
            assert mine == pytest.approx(theirs, rel=1e-11, abs=1e-12 * np.abs(theirs).max())
