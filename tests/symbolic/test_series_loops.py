"""Series as loops in machine code, against those of the graph."""

import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import InLoops, Kernel, VariationsInLoops, variations

ORDER, COLUMNS, VARIED, STEP = 10, 3, (0, 2), 0.3


def field(of) -> ca.Function:
    """The field x'' = -p0 f(x, x') + p2 x, with a third state and quantities that are watched, one of which stays."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 3)
    rates = ca.vertcat(x[1], -p[0] * of(x, p) + p[2] * x[0], 0.5 * x[2] - x[0] * p[1] + 2)
    return ca.Function("field", [x, p], [rates, ca.vertcat(x[0] * x[1], p[1] ** 2)])


def in_loops(own: ca.Function) -> InLoops:
    """A step that finds the series of z = (x, dx), data = (p, dp), and the columns after a time."""
    n, rows, size = own.numel_out(0), sum(map(own.numel_out, (0, 1))), own.numel_out(0) * COLUMNS
    z, data = ca.SX.sym("z", n + size), ca.SX.sym("data", 3 + len(VARIED) * COLUMNS)
    c, ends, moved, h = (ca.SX.sym(*s) for s in (("c", ORDER + 1, rows), ("e", 4, size), ("m", size), ("h", 1)))
    before = ca.Function("before", [z, data], [z[:n], data[:3], z[n:], data[3:]])
    choose = ca.Function("choose", [z, data, c, ends], [ca.vec(ends), STEP])
    after = ca.Function("after", [z, data, c, ca.vec(ends), h, moved], [z, ca.vec(c), ca.vec(ends), moved, 1, 0])
    return InLoops(before, VariationsInLoops(own, VARIED, COLUMNS, ORDER), choose, after, lambda: after)


OPERATIONS = {
    "polynomial": lambda x, p: x[0] ** 3 - (x[0] - 1) * x[1] + 2 * x[0],
    "quotient": lambda x, p: x[0] / (2 + x[1] * x[1]) + 1 / (1 + x[0]) + x[0] * x[2] / p[1],
    "power": lambda x, p: (1 + x[0]) ** 2.5 + ca.sqrt(1 + x[0] * x[1]),
    "exponential": lambda x, p: ca.exp(-x[0]) - ca.sinh(x[1]) * ca.cosh(x[0]),
    "rotation": lambda x, p: ca.sin(x[0]) * x[1] ** 2 - ca.cos(x[0]) + ca.cos(x[0] - x[1]) / ca.exp(p[1]),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_loops_find_the_series_of_the_graph(name):
    own, rng = field(OPERATIONS[name]), np.random.default_rng(3)
    count = 11  # more than one block of lanes
    z, data = rng.uniform(0.2, 0.9, (count, 3 + 3 * COLUMNS)), rng.uniform(0.4, 1.2, (count, 3 + 2 * COLUMNS))
    kernel = Kernel(in_loops(own))
    _, (c, ends, moved), _, _ = kernel(z, data)
    assert kernel.compiled
    series = variations(own, VARIED, COLUMNS, ORDER)
    for i in range(count):
        known = (
            z[i, :3],
            data[i, :3],
            z[i, 3:].reshape(3, COLUMNS, order="F"),
            data[i, 3:].reshape(2, COLUMNS, order="F"),
        )
        rows, columns = (np.array(each) for each in series(*known))
        assert np.allclose(c[i].reshape(5, ORDER + 1).T, rows, rtol=1e-12, atol=1e-13)
        assert np.allclose(ends[i].reshape(-1, 4).T, columns[[0, 1, -2, -1]], rtol=1e-11, atol=1e-12)
        assert moved[i] == pytest.approx(STEP ** np.arange(ORDER + 1) @ columns, rel=1e-12)


def test_some_operations_have_no_loop():
    for of in (lambda x, p: ca.log(2 + x[0]), lambda x, p: (1 + x[0]) ** (0.5 + x[1])):
        assert not VariationsInLoops(field(of), VARIED, COLUMNS, ORDER).able
