"""Named laws of gravity by other means."""

import re

import numpy as np
import pytest

from orbits import InputError
from problems import Hopper
from problems.laws import gravity


@pytest.mark.parametrize("name", gravity.NAMED)
def test_named_gravity(name):
    law = gravity.NAMED[name]()
    assert law(0.0) == 1
    expected = {"constant": 1.0, "inverse_square": 1.01**-2, "linear": 0.99, "exponential": np.exp(-0.01)}[name]
    assert law(10.0) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("stated", [1.62, "1.62", 2])
def test_an_acceleration_is_no_ratio(stated):
    value = f"{float(stated):g}"
    remedy = f"must be 1 at z = 0: for {value} m/s^2 use hopper_in_si(..., surface_gravity={value})"
    with pytest.raises(InputError, match=re.escape(remedy)):
        Hopper(gravity=stated)
    with pytest.raises(InputError, match="an acceleration above 0 in m/s"):
        Hopper(gravity=-9.81)
