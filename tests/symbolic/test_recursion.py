"""Rows of operations: each once, what is affine in the state, and derivatives."""

import casadi as ca
import numpy as np

from orbits.symbolic import taylor_coefficients
from orbits.symbolic.recursion import Recursion

X, P = ca.SX.sym("x", 4), ca.SX.sym("p", 3)


def rows_of(*results: ca.SX) -> tuple[Recursion, list[int]]:
    """The rows of results of X and P."""
    recursion = Recursion()
    (found,) = recursion.graph(ca.Function("f", [X, P], [ca.vertcat(*results)]))
    return recursion, [found[i] for i in range(len(results))]


def test_equal_operations_are_one_row():
    recursion, (one, other) = rows_of(ca.sin(X[0] * X[1]) + P[0], P[0] + ca.sin(X[1] * X[0]))
    assert one == other
    assert recursion.add(ca.OP_SQ, one) == recursion.add(ca.OP_MUL, other, one)


def test_neutral_numbers_leave_no_row():
    recursion, (row,) = rows_of(X[0] * P[0])
    zero, one = recursion.number(0), recursion.number(1)
    assert recursion.add(ca.OP_ADD, row, zero) == recursion.add(ca.OP_MUL, one, row) == row
    assert recursion.add(ca.OP_SUB, row, zero) == recursion.add(ca.OP_DIV, row, one) == row
    assert recursion.add(ca.OP_MUL, row, zero) == recursion.add(ca.OP_DIV, zero, row) == zero


def test_a_force_of_one_extension_is_one_function():
    """r + b r**3 of r = x0 - x2 - p2, shared by two masses, beside what is affine."""
    r = X[0] - X[2] - P[2]
    force = r + P[0] * r**3
    recursion, (one, other) = rows_of(-force / P[1] + 2 * X[1], 3 * force - X[3] * P[1])
    first, second = recursion.affine(one), recursion.affine(other)
    assert len(first.functions) == 1
    assert first.functions.keys() == second.functions.keys()
    assert (first.states.keys(), second.states.keys()) == ({1}, {3})
    (function,) = first.functions
    assert len(recursion.arguments[function]) == 1


def test_derivatives_by_parameters_and_arguments():
    """Against automatic differentiation: each slope is a row, whose value is that of a series of order 0."""
    law = ca.exp(P[0] * X[0]) * ca.sqrt(1 + X[1] ** 2) / (2 + P[1] * X[0]) + (2 + X[0]) ** P[2]
    recursion, (row,) = rows_of(law)
    rng = np.random.default_rng(1)
    x, p = rng.uniform(0.2, 0.9, 4), rng.uniform(0.2, 0.9, 3)

    def value(place: int) -> float:
        op, inputs, number = recursion.rows[place]
        if number is not None:
            return number
        if op == ca.OP_INPUT:
            return (x, p)[inputs[0]][inputs[1]]
        values = [ca.SX(value(each)) for each in inputs]
        return float(ca.SX.unary(op, *values) if len(values) == 1 else ca.SX.binary(op, *values))

    by_p = np.array(ca.Function("s", [X, P], [ca.jacobian(law, P)])(x, p)).ravel()
    by_x = np.array(ca.Function("s", [X, P], [ca.jacobian(law, X)])(x, p)).ravel()
    for j in range(3):
        assert np.isclose(value(recursion.slope(row, recursion.input(1, j))), by_p[j], rtol=1e-14)
    found = np.zeros(4)
    for argument in recursion.arguments[row]:
        for j, factor in recursion.affine(argument).states.items():
            found[j] += value(recursion.slope(row, argument)) * value(factor)
    assert np.allclose(found, by_x, rtol=1e-14)


def test_what_is_zero_has_no_row():
    """A field of zeros has the series of a straight line."""
    field = ca.Function("field", [X, P], [ca.vertcat(X[1], 0 * X[0], 0, 0), ca.SX(0, 1)])
    c = np.array(ca.Function("c", [X, P], [ca.densify(taylor_coefficients(field, X, P, 3))])([1, 2, 3, 4], [0, 0, 0]))
    assert c.tolist() == [[1, 2, 0, 0], [2, 0, 0, 0], [3, 0, 0, 0], [4, 0, 0, 0]]
