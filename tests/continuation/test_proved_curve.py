"""What cannot be claimed to be a curve is refused."""

import dataclasses

import pytest

from orbits import InputError, follow
from problems import Hopper


@pytest.fixture(scope="module")
def machine():
    return Hopper("cubic", rest_length=30.0)


def test_what_cannot_be_a_curve(machine):
    family = follow(machine, "beta", stop=0.55, start=0.5)
    with pytest.raises(InputError, match="two points"):
        dataclasses.replace(family, points=family.points[:1], events=()).prove(machine, continuous=True)
    with pytest.raises(InputError, match="no parameter"):
        family.prove(Hopper(), continuous=True)
