"""Gravity whose variation is brought in, up to where the machine does not come back."""

import pytest

from orbits import NoOrbit, find
from problems import Hopper
from problems.laws import gravity


def test_gravity_that_does_not_bring_it_back_is_a_named_failure():
    with pytest.raises(NoOrbit, match=r"no lossless orbit of family 1: with .*% of gravity's variation"):
        find(Hopper("r", gravity.linear(kappa=0.2), rest_length=20.0))
