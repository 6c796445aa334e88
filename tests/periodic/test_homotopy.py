"""Gravity whose variation is brought in, up to where the machine does not come back."""

from itertools import pairwise

import pytest

from orbits import NoOrbit, find
from problems import Hopper
from problems.laws import gravity


def test_gravity_that_does_not_bring_it_back_is_a_named_failure():
    with pytest.raises(NoOrbit, match=r"no lossless orbit of family 1: with .*% of gravity's variation"):
        find(Hopper("r", gravity.linear(kappa=0.2), rest_length=20.0))


@pytest.mark.parametrize("kappa", [0.1, 0.15, 0.2])
def test_how_much_of_the_variation_it_bears(kappa):
    """With gravity 1 + kappa z the launch speed vanishes at kappa = 2/21: the steps end there, ever smaller."""
    shares = list[float]()
    with pytest.raises(NoOrbit) as caught:
        find(Hopper("r", gravity.linear(kappa=kappa), rest_length=20.0), progress=shares.append)
    assert shares == sorted(set(shares))
    assert 0 < 2 / 21 / kappa - shares[-1] < 1e-3
    assert f"with {100 * shares[-1]:.3g}% of gravity's variation" in str(caught.value)
    steps = [b - a for a, b in pairwise([0.0, *shares])]
    assert all(step <= 2 * before for before, step in pairwise(steps))


def test_gravity_is_brought_in_up_to_all_of_it():
    """A start beside the orbit leads to it without any steps."""
    shares, machine = list[float](), Hopper("r", gravity.linear(kappa=0.05), rest_length=20.0)
    orbit = find(machine, progress=shares.append)
    assert shares == sorted(set(shares))
    assert 0 < shares[0] < shares[-1] == 1.0
    beside = find(machine, start={"liftoff": 1.001, "alpha": 1.001 * orbit.alpha, "duration": orbit.flight_time / 2})
    assert orbit.alpha == pytest.approx(beside.alpha, rel=1e-13)
    assert orbit.alpha == pytest.approx(1.8414712648586353, rel=1e-13)
