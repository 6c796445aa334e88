"""Series as loops in machine code, against those of the graph and their derivatives."""

import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import CodedFunction, Kernel, VariationSeries, taylor_coefficients

ORDER, STEP = 10, 0.3
OPERATIONS = {
    "polynomial": lambda x, p: x[0] ** 3 - (x[0] - 1) * x[1] + 2 * x[0],
    "quotient": lambda x, p: x[0] / (2 + x[1] * x[1]) + 1 / (1 + x[0]) + x[0] * x[2] / p[1],
    "power": lambda x, p: (1 + x[0]) ** 2.5 + ca.sqrt(1 + x[0] * x[1]) + (1 + x[1]) ** p[0],
    "variable power": lambda x, p: (1 + x[0]) ** (0.5 + x[1] * p[2]),
    "exponential": lambda x, p: ca.exp(-x[0]) - ca.sinh(x[1]) * ca.cosh(x[0]) + ca.expm1(p[0] * x[0]),
    "logarithm": lambda x, p: ca.log(2 + x[0]) * ca.log1p(x[1]) - ca.erf(x[0] * p[0]),
    "rotation": lambda x, p: ca.sin(x[0]) * x[1] ** 2 - ca.cos(x[0]) + ca.cos(x[0] - x[1]) / ca.exp(p[1]),
    "tangent": lambda x, p: ca.tan(x[0] * p[2]) + ca.tanh(x[1] - x[0]) + ca.atan(x[1]) + ca.asinh(x[0]),
    "inverse": lambda x, p: ca.asin(x[0] / 2) - ca.acos(x[1] / 2) + ca.acosh(2 + x[1]) + ca.atanh(x[0] / 3),
    "of each difference": lambda x, p: (x[0] - x[2]) ** 3 * p[2] + ca.sin(x[1] - 2 * x[2]) / (1 + p[0] ** 2),
    "nothing": lambda x, p: 0 * x[0],
}


def field(of) -> ca.Function:
    """The field x'' = -p0 f(x, x') + p2 x, with a third state and quantities that are watched, one of which stays and
    one of which is 0."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 3)
    rates = ca.vertcat(x[1], -p[0] * of(x, p) + p[2] * x[0], 0.5 * x[2] - x[0] * p[1] + 2)
    return ca.Function("field", [x, p], [rates, ca.vertcat(x[0] * x[1], p[1] ** 2, 0)])


def expected(own: ca.Function, varied: tuple[int, ...], columns: int) -> ca.Function:
    """(x, p, dx, dp) -> the coefficients (rows, K + 1), and those of the columns (n columns, K + 1)."""
    x, p = own.sx_in()
    c = taylor_coefficients(own, x, p, ORDER)
    dx, dp = ca.SX.sym("dx", 3, columns), ca.SX.sym("dp", len(varied), columns)
    moves = ca.SX(p.numel(), columns)
    for i, row in enumerate(varied):
        moves[row, :] = dp[i, :]
    slopes = ca.jtimes(ca.vec(c[:3, :]), ca.vertcat(x, p), ca.vertcat(dx, moves))
    columns_of = [ca.reshape(each, 3, ORDER + 1) for each in ca.horzsplit(slopes)]
    return ca.Function("series", [x, p, dx, dp], [ca.densify(c), ca.densify(ca.vertcat(*columns_of))])


@pytest.mark.parametrize("columns", [0, 1, 3, 6])
@pytest.mark.parametrize("name", OPERATIONS)
def test_loops_find_the_series_of_the_graph(name, columns):
    """With few columns, found together, and many, found one after the other; and their values after a time."""
    own, rng, varied = field(OPERATIONS[name]), np.random.default_rng(3), (0, 2)
    series, count, size = VariationSeries(own, varied, columns, ORDER), 11, 3 * columns  # more than one block of lanes

    def append(code, arguments):
        z, data = arguments
        found = series.append(code, z[:3], data[:3], z[3:], data[3:])
        after = series.columns_after(code, found, code.splat(STEP))
        places = [found.columns + q * found.stride + k for q in range(size) for k in range(ORDER + 1)]
        return [z, found.rows, [code.later(place) for place in places], after, [code.splat(1)], [code.splat(0)]]

    room = -(-6 * (ORDER + 2) // 8) * 8
    sizes = [3 + size, room, size * (ORDER + 1), size, 1, 1]
    kernel = Kernel(CodedFunction([3 + size, 3 + 2 * columns], sizes, append))
    z, data = rng.uniform(0.2, 0.9, (count, 3 + size)), rng.uniform(0.4, 1.2, (count, 3 + 2 * columns))
    c, slopes, after = kernel(z, data).records
    wanted = expected(own, varied, columns)
    for i in range(count):
        dx, dp = z[i, 3:].reshape(3, columns, order="F"), data[i, 3:].reshape(2, columns, order="F")
        rows, of_columns = (np.array(each) for each in wanted(z[i, :3], data[i, :3], dx, dp))
        assert np.allclose(c[i, : 6 * (ORDER + 2)].reshape(6, -1)[:, :-1], rows, rtol=1e-12, atol=1e-13)
        if columns:
            assert np.allclose(slopes[i].reshape(size, -1), of_columns, rtol=1e-11, atol=1e-12)
            assert after[i] == pytest.approx(of_columns @ STEP ** np.arange(ORDER + 1), rel=1e-11, abs=1e-12)


def test_two_masses_on_one_spring():
    """The force is one function of one argument, so that a column takes one sum of products."""
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", 3)
    stretch = x[0] - x[2] - p[2]
    force = stretch + p[0] * stretch**3
    rates = ca.vertcat(x[1], -1 - force, x[3], -1 + force / p[1])
    series = VariationSeries(ca.Function("field", [x, p], [rates, ca.SX(0, 1)]), (0, 1), 3, ORDER)
    assert [len(slopes) for slopes in series.terms.slopes.values()] == [1]
    assert [len(states) for states in series.terms.arguments.values()] == [2]
