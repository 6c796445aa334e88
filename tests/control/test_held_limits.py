"""What an actuator can do: forces at speeds, and what exceeds its limits."""

import numpy as np
import pytest

from orbits import find
from orbits.control import hold
from orbits.control.held_limits import HeldLimits, limits_in
from orbits.errors import InputError
from problems import Hopper


def test_forces_at_speeds():
    limits = HeldLimits(force=3.0, power=4.0, speed_force=(2.0, 5.0))
    assert limits.forces(np.array([0.0, 1.0, 1.5, 2.0, 3.0])) == pytest.approx([3.0, 2.5, 1.25, 0.0, 0.0])
    assert HeldLimits(power=4.0).forces(np.array([0.0, 2.0])).tolist() == [np.inf, 2.0]


def test_speeds_at_forces():
    limits = HeldLimits(rate=1.8, power=4.0, speed_force=(2.0, 5.0))
    assert limits.speeds(np.array([0.0, 2.5, 4.0, 5.0, 6.0])) == pytest.approx([1.8, 1.0, 0.4, 0.0, 0.0])


@pytest.mark.parametrize(
    ("force", "speed", "names"),
    [
        (2.0, 0.0, []),
        (3.1, 0.0, ["force"]),
        (2.9, 1.5, ["power", "speed_force"]),
        (-2.9, 1.3, []),
        (1.0, 1.7, ["speed_force"]),
    ],
)
def test_what_is_exceeded(force, speed, names):
    limits = HeldLimits(force=3.0, power=4.0, speed_force=(2.0, 5.0))
    assert limits.exceeded(np.array([0.0, force]), np.array([0.0, speed])) == names


def test_limits_in_other_units():
    sizes = {"rate": 2.0, "stroke": 4.0, "force": 10.0, "power": 5.0, "speed": 0.5}
    bare = limits_in(HeldLimits(force=20.0, power=15.0, speed_force=(1.0, 30.0)), sizes)
    assert bare == HeldLimits(force=2.0, power=3.0, speed_force=(2.0, 3.0))
    assert bare.stated() == {"force": 2.0, "power": 3.0, "speed_force": (2.0, 3.0)}


def test_invalid_limits():
    with pytest.raises(InputError, match="force = 0: a bound of what acts is above 0"):
        HeldLimits(force=0.0)
    with pytest.raises(InputError, match=r"speed_force = 3\.0; it is two numbers"):
        HeldLimits(speed_force=3.0)
    with pytest.raises(InputError, match="speed_force = -1"):
        HeldLimits(speed_force=(1.0, -1.0))


def test_the_room_of_a_force():
    """By the fastest speed of the cycle in each interval, with a margin."""
    orbit = find(Hopper())
    held = hold(orbit, "y1 - y2", force=0.5, power=0.9)
    for i, (a, b) in enumerate(zip(held.plan.begins, held.plan.ends, strict=True)):
        x = orbit(np.linspace(held.plan.times[a], held.plan.times[b], 4001))
        fastest = 1.2 * np.abs(x[:, 1] - x[:, 3]).max()
        assert held.room.high[i] == pytest.approx(min(0.5, 0.9 / fastest), rel=1e-2)
    assert (held.room.low == -held.room.high).all()
