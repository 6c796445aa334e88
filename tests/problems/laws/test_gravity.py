"""Named laws of gravity by other means."""

import numpy as np
import pytest

from problems.laws import gravity


@pytest.mark.parametrize("name", gravity.NAMED)
def test_named_gravity(name):
    law = gravity.NAMED[name]()
    assert law(0.0) == 1
    expected = {"constant": 1.0, "inverse_square": 1.01**-2, "linear": 0.99, "exponential": np.exp(-0.01)}[name]
    assert law(10.0) == pytest.approx(expected, rel=1e-14)
