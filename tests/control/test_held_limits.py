"""What an actuator can do: forces at speeds, and what exceeds its limits."""

import numpy as np
import pytest

from orbits import find
from orbits.control import hold
from orbits.control.held_cycle import Plan
from orbits.control.held_limits import Demand, HeldLimits, Room, limits_in
from orbits.errors import InputError
from problems import Actuator, Hopper, steering


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
    assert limits.exceeded(Demand(np.array([0.0, force]), np.array([0.0, speed]))) == names


def test_rates_and_displacements_that_are_exceeded():
    limits, none = HeldLimits(rate=2.0, stroke=1.0), np.zeros(1)
    assert limits.exceeded(Demand(none, none, np.array([-2.0, 2.0]), np.array([-1.0]))) == []
    assert limits.exceeded(Demand(none, none, np.array([-2.1, 1.0]), np.array([0.0]))) == ["rate"]
    assert limits.exceeded(Demand(none, none, none, np.array([0.5, -1.1]))) == ["stroke"]


def test_a_state_out_of_reach_is_brought_back_within_the_room():
    """A state of 3 beyond a reach of 1 needs a change of -4 within the time 0.5: it is cut to the room of 0.5."""
    room = Room(np.full(2, -0.5), np.full(2, 0.5), np.ones(5))
    plan = Plan(np.linspace(0.0, 2.0, 5), 2, np.array([0, 2]), np.array([0, 2]), np.array([1, 3]))
    for off, wanted in ((3.0, -0.5), (-3.0, 0.5)):
        assert room.cut(0, 0.1, plan, np.zeros(5), off) == wanted
    assert room.cut(0, 0.1, plan, np.zeros(5), 0.0) == 0.1


def test_limits_that_the_hop_itself_exceeds():
    """The message says what the hop needs, by the actuator's largest rate, displacement, force and power."""
    moved = steering.keep_hopping(Hopper(damping=0.01), intervals=20)
    needs = {"rate": np.abs(moved.schedule(moved.actuator.rate)[1][moved.actuator.rate]).max()}
    needs["stroke"] = np.abs(moved(np.linspace(0.0, moved.end, 20001))[:, -1]).max()
    pushed = steering.keep_hopping(Hopper(damping=0.02), actuator=Actuator("y1 - y2", kind="force"), intervals=20)
    named = [(moved, *each) for each in needs.items()]
    named += [(pushed, *each) for each in zip(("force", "power"), pushed.largest, strict=True)]
    for kept, name, need in named:
        with pytest.raises(InputError, match=rf"{name} = 0\.01: .* widen the bound") as found:
            kept.hold(**{name: 0.01})
        assert float(str(found.value).split("needs ")[1].split(";")[0]) == pytest.approx(need, rel=1e-3)
        kept.hold(**{name: 1.001 * need})
    with pytest.raises(InputError, match=r"speed_force = \(8\.0, 0\.01\): the hop itself needs \d+\.\d+ times this"):
        pushed.hold(speed_force=(8.0, 0.01))
    with pytest.raises(InputError, match=r"stroke = 1: .* the actuator is a force; leave it out"):
        pushed.hold(stroke=1.0)


def test_limits_in_other_units():
    sizes = {"rate": 2.0, "stroke": 4.0, "force": 10.0, "power": 5.0, "speed": 0.5}
    bare = limits_in(HeldLimits(force=20.0, power=15.0, speed_force=(1.0, 30.0)), sizes)
    assert bare == HeldLimits(force=2.0, power=3.0, speed_force=(2.0, 3.0))
    assert bare.stated() == {"force": 2.0, "power": 3.0, "speed_force": (2.0, 3.0)}


def test_invalid_limits():
    with pytest.raises(InputError, match="force = 0; a bound of the actuator must be above 0"):
        HeldLimits(force=0.0)
    with pytest.raises(InputError, match=r"speed_force = 3\.0; it must be two numbers"):
        HeldLimits(speed_force=3.0)
    with pytest.raises(InputError, match=r"speed_force = \(1, -1\): both numbers must be above 0"):
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
