"""Lift-off: springs without a slope at rest, and springs that cannot lift the foot."""

import pytest

from orbits import NoOrbit, find
from problems import Hopper


@pytest.mark.parametrize("spring", ["r*sqrt(abs(r))", "r*abs(r)**0.5", "sign(r)*abs(r)**1.5"])
def test_a_spring_without_slope_at_rest(spring):
    """One law in three spellings: homogeneous, so its half period at amplitude A goes with A^-0.25."""
    assert find(Hopper(spring)).alpha == pytest.approx(3.459326351441497, rel=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: find(Hopper("tanh(r)")), "lifts off cleanly|leaves the ground"),
        (lambda: find(Hopper("tanh(1.9*r)/1.9")), r"largest tension 0.5263"),
        (lambda: find(Hopper("r - 0.5*r**3")), r"largest tension 0.5443"),
    ],
)
def test_springs_that_cannot_lift_the_foot(make, message):
    with pytest.raises(NoOrbit, match=message):
        make()
