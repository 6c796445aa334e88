import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import repeated


@pytest.mark.parametrize("compiled", [False, True])
def test_sums_and_largest_values_over_places(compiled):
    before, place, x = (ca.SX.sym(name, count) for name, count in (("before", 2), ("place", 2), ("x", 1)))
    value = place[1] * ca.sin(place[0] * x)
    step = ca.Function("step", [before, place, x], [ca.vertcat(before[0] + value, ca.fmax(before[1], value))])
    places = np.random.default_rng(3).normal(size=(5, 2))
    function = repeated(step, [0.5, -np.inf], places)
    assert not compiled or function.kernel.compile()
    xs = np.linspace(0.1, 2.0, 11)[:, None]
    values = places[:, 1] * np.sin(places[:, 0] * xs)
    assert function(xs)[0] == pytest.approx(np.column_stack([0.5 + values.sum(1), values.max(1)]), rel=1e-14)


def test_columns_one_after_the_other_and_the_same_digits_in_machine_code():
    before, column, x = (ca.SX.sym(name, count) for name, count in (("before", 2), ("column", 2), ("x", 1)))
    step = ca.Function("step", [before, ca.SX(0, 1), column, x], [before * x + column])
    coefficients, xs = np.random.default_rng(4).normal(size=(9, 2, 6)), np.linspace(-1.0, 1.0, 9)[:, None]
    arguments = coefficients.reshape(9, -1), xs
    interpreted, compiled = (repeated(step, [0.0, 0.0], np.empty((6, 0)), columns=2) for _ in range(2))
    interpreted.kernel._loop = None
    assert compiled.kernel.compile()
    expected = [np.polyval(row, x) for rows, (x,) in zip(coefficients, xs, strict=True) for row in rows]
    assert interpreted(*arguments)[0].ravel() == pytest.approx(expected, rel=1e-14)
    assert np.array_equal(interpreted(*arguments)[0], compiled(*arguments)[0])
