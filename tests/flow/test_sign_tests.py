import numpy as np
import pytest

from orbits.flow import sign_tests

ORDERS = 29


@pytest.mark.parametrize("count", [1, 37])
def test_no_change_of_sign_is_missed(count):
    """Of two functions of two rows and a rate, where motions begin with a double zero too, against many samples."""
    kinds, rng = ((False, 2), (True, 0), (False, 0)), np.random.default_rng(count)
    c = rng.normal(size=(count, 2, ORDERS)) * 0.6 ** np.arange(ORDERS)
    weights, offsets = np.array([[1.0, 0.0], [0.5, 1.0], [0.0, 2.0]]), np.array([0.0, 7.0, 0.3])
    lengths = rng.uniform(0.1, 0.7, (count, 1))
    begins = (np.arange(count) % 2 == 0).astype(float)[:, None]
    c[begins[:, 0] > 0, 0, :2] = 0.0
    tests = sign_tests(2, ORDERS, kinds)
    (found,) = tests(c.reshape(count, -1), lengths, begins, weights.reshape(1, -1), offsets[None])
    found, times = found.reshape(count, 3, 3), np.linspace(0.0, 1.0, 400)
    decided = 0
    for i, ((by_rate, order), weight, offset) in enumerate(zip(kinds, weights, offsets, strict=True)):
        for own, coefficients, h, fresh in zip(found[:, i], c, lengths[:, 0], begins[:, 0], strict=True):
            series = np.polynomial.Polynomial(weight @ coefficients) + offset
            series = series.deriv() if by_rate else series
            divided = np.polynomial.Polynomial(series.coef[order:] if fresh else series.coef)
            assert own[0] == pytest.approx(divided(0.0), rel=1e-13)
            assert own[2] == np.sign(divided(h))
            signs = np.sign(divided(times * h))
            assert own[1] or (signs == signs[0]).all()
            decided += not own[1]
    assert decided > count
