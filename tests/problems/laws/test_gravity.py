"""Named laws of gravity by other means."""

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
    remedy = f"must be 1 at z = 0: an acceleration in m/s^2 of a machine in SI is surface_gravity={float(stated):g}$"
    with pytest.raises(InputError, match=remedy.replace("^", r"\^")):
        Hopper(gravity=stated)
    with pytest.raises(InputError, match="is surface_gravity, above 0"):
        Hopper(gravity=-9.81)
