"""Launches of driven machines at other speeds: the contact force vanishes there."""

import numpy as np
import pytest
from scipy.optimize import brentq

from orbits import InputError
from problems import Actuated, Actuator, Chain, Hopper, springs
from problems.steering.actuated_launch import launch_argument, launched_at


def test_a_force_at_rest_changes_no_launch():
    """The foot is lifted where spring and damper carry its weight."""
    driven = Actuated(Hopper("r + 0.1*r**3", damping=0.01), Actuator(kind="force"))
    found = launch_argument(driven, {"liftoff": 1.0, "alpha": 4.0}, 4.5)
    expected = brentq(lambda y: y + 0.1 * y**3 + 0.01 * 4.5 - 1, 0, 2, xtol=1e-15)
    assert found == {"liftoff": pytest.approx(expected, abs=1e-13), "alpha": 4.5}


def test_of_a_launch_that_is_more_than_a_speed_the_rest_stays():
    like = {"liftoff": 0.9, "alpha": 3.0, "y1": 2.0, "y1'": 0.5}
    found = launched_at(Actuated(Chain(masses=(1, 1, 1)), Actuator("y2 - y3")), like, 3.5)
    assert found == {**like, "alpha": 3.5, "liftoff": pytest.approx(1.0, abs=1e-14)}


@pytest.mark.parametrize("length", [20.0, 1e4, 1e7])
def test_rounding_of_the_force_does_not_hide_the_launch(length):
    """An air spring cancels digits: its force 1 - c alpha lies at a length that its formula states."""
    driven = Actuated(Hopper(springs.air(length=length, exponent=1.3), damping=0.05), Actuator(kind="force"))
    for alpha in (3.0, 4.4, 4.456, 4.544):
        found = launched_at(driven, {"liftoff": 0.8, "alpha": 4.5}, alpha)["liftoff"]
        expected = length * np.expm1(-np.log1p(-1.3 * (1 - 0.05 * alpha) / length) / 1.3)
        assert found == pytest.approx(expected, abs=4e-16 * length)


def test_where_nothing_lifts_off():
    driven = Actuated(Hopper("tanh(r)/2"), Actuator(kind="force"))  # never as strong as the foot is heavy
    with pytest.raises(InputError, match="the contact force vanishes nowhere near"):
        launched_at(driven, {"liftoff": 0.0, "alpha": 1.0}, np.float64(1.0))
