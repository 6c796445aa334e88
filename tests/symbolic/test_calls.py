"""Fast calls of functions, at one point and at many, against CasADi's own."""

import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import BufferedFunction, ElementwiseFunction


@pytest.mark.parametrize("compiled", [False, True])
def test_functions_at_many_points(compiled):
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    results = [
        ca.vertcat(x[0] * ca.sin(p[1]), 2.0, ca.if_else(x[1] > 0, x[2] ** 2, ca.exp(x[1])), 0),
        ca.SX(0, 1),
        ca.vertcat(p[0], ca.fmin(x[0], x[1]), ca.atan2(x[0], x[1])),
    ]
    function = ca.Function("f", [x, p], results)
    rng, rows = np.random.default_rng(3), ElementwiseFunction(function)
    if compiled:
        assert rows.kernel.compile()
    for count in (1, 2, 7, 100):
        points, parameters = rng.normal(size=(count, 3)), rng.normal(size=(count, 2))
        for values in (parameters, parameters[:1], np.asfortranarray(parameters)):
            found = rows(points, values)
            for i in range(count):
                expected = function(points[i], values[min(i, len(values) - 1)])
                for mine, theirs in zip(found, expected, strict=True):
                    assert mine[i] == pytest.approx(theirs.full().ravel(), rel=1e-15)


@pytest.mark.parametrize("compiled", [False, True])
def test_arguments_of_wrong_shapes_are_refused(compiled):
    """Machine code would read and write beyond their ends."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p")
    rows = ElementwiseFunction(ca.Function("f", [x, p], [x * p]))
    if compiled:
        assert rows.kernel.compile()
    assert np.array_equal(rows(np.arange(12).reshape(4, 3), np.full((4, 1), 2))[0], 2.0 * np.arange(12).reshape(4, 3))
    points, values = np.ones((4, 3)), np.ones((4, 1))
    for wrong in ((points, values[:, 0]), (points[:, :2], values), (points, values[:2]), (points[:0], values[:0])):
        with pytest.raises(ValueError, match="arguments of shapes"):
            rows(*wrong)
    with pytest.raises(ValueError, match="arguments of shapes"):
        rows(points, values, values)


class TestCalls:
    def test_is_the_function(self):
        x, y = ca.SX.sym("x", 2), ca.SX.sym("y", 2, 3)
        f = ca.Function("f", [x, y], [y.T @ x, ca.densify(ca.jacobian(y.T @ x, x))])
        call = BufferedFunction(f)
        a, b = np.array([1.0, 2.0]), np.arange(6.0).reshape(2, 3)
        for got, expected in zip(call(a, b), f(a, b), strict=True):
            assert got == pytest.approx(np.array(expected))
        first = call(a, b)[0]
        call(2 * a, b)
        assert first == pytest.approx(np.array(f(a, b)[0]))  # results are the caller's own
