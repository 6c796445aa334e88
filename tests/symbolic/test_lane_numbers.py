"""Numbers of lanes against NumPy's."""

import numpy as np

from orbits.symbolic import CodedFunction, Kernel, Number


def test_operators_are_those_of_arrays():
    """Of numbers of either sign, infinities and NaN: the least and largest are those of the numbers among them."""

    def append(code, arguments):
        x, y = (Number(code, each) for each in arguments[0])
        masks = x < y, x <= y, x > 0.5, x >= y, (x < y) & ~(x > 0.0), (x < 0.0) | (y < 0.0)
        numbers = x + y, x - 2.0, 3.0 * x, x / y, -x, abs(x), abs(x).root(), x.least(y, 1.0), x.largest(y, -1.0)
        numbers += x.times_plus(y, 2.0), (x < y).choose(x, 7.0)
        results = [*(each.name for each in numbers), *(each.value() for each in masks)]
        return [arguments[0], results, [code.splat(1)], [code.splat(0)]]

    x, y = np.random.default_rng(2).normal(size=(2, 30))
    x[:3], y[2:5] = (np.inf, -np.inf, np.nan), (np.nan, np.inf, 0.0)
    found = Kernel(CodedFunction([2], [2, 17, 1, 1], append))(np.column_stack([x, y])).records[0].T
    with np.errstate(all="ignore"):
        numbers = x + y, x - 2, 3 * x, x / y, -x, abs(x), np.sqrt(abs(x)), np.fmin(np.fmin(x, y), 1), None, x * y + 2
        numbers = [np.fmax(np.fmax(x, y), -1) if each is None else each for each in numbers]
        numbers.append(np.where(x < y, x, 7.0))
        masks = x < y, x <= y, x > 0.5, x >= y, (x < y) & ~(x > 0), (x < 0) | (y < 0)
    for mine, theirs in zip(found, [*numbers, *masks], strict=True):
        assert np.allclose(mine, theirs, rtol=1e-15, equal_nan=True)
