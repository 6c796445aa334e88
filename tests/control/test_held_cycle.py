"""The instants of a feedback in its cycle, and small changes along it."""

import numpy as np
import pytest

from orbits import find
from orbits.control.held_cycle import Cycle, linearised, planned
from orbits.control.holding import hold
from problems import Hopper


def cycle(times=(0.0, 10.0), inputs=(0.0,)):
    return Cycle(None, "hold", np.zeros(4), 6.0, 4.0, np.array(times), np.array(inputs), "force", None, 1.0, None)


@pytest.mark.parametrize(
    ("when", "delay", "begins", "measured"),
    [
        ("continuous", 0.0, [0.6, 3.0, 6.4, 8.0], [0.6, 3.0, 6.4, 8.0]),
        ("continuous", 0.5, [0.6, 3.0, 6.4, 8.0], [0.1, 2.5, 5.9, 7.5]),
        ("lift-off", 0.2, [0.6, 3.0, 6.4, 8.0], [0.0, 0.0, 0.0, 0.0]),
        ("apex", 0.4, [3.4, 4.4, 6.4, 8.0], [3.0, 3.0, 3.0, 3.0]),
    ],
)
def test_when_inputs_are_decided(when, delay, begins, measured):
    plan = planned(cycle(), when, 2, delay, (0.1, 0.9))
    assert plan.times[plan.begins] == pytest.approx(begins)
    assert plan.times[plan.measured] == pytest.approx(measured)
    assert plan.times[plan.landing] == 6.0
    assert plan.times[plan.ends][-1] == pytest.approx(9.6)
    assert [plan.acts(j) for j in plan.begins] == [0, 1, 2, 3]
    assert plan.landing not in plan.needed(cycle())  # nothing happens at the landing of the cycle


def test_an_input_of_the_cycle_itself():
    """It changes at its own instants, which belong to the plan."""
    own = cycle((0.0, 2.0, 6.0, 10.0), (1.0, -1.0, 0.5))
    assert [own.input_after(t) for t in (0.0, 1.9, 2.0, 6.0, 9.9)] == [1.0, 1.0, -1.0, 0.5, 0.5]
    plan = planned(own, "continuous", 1, 0.0, (0.1, 0.9))
    assert {2.0, 6.0} <= set(plan.times[plan.needed(own)].tolist())


def test_the_pieces_of_a_cycle_are_its_derivative():
    """Their product is the multiplier of the energy, 1; with an input in a piece, it is that of differences."""
    orbit = find(Hopper("cubic"))
    held = hold(orbit, "y1 - y2")
    found = linearised(held.cycle, held.plan)
    product = np.linalg.multi_dot([piece.carry for piece in reversed(found.pieces)])
    assert product == pytest.approx(np.array([[1.0]]), rel=1e-9)
    assert np.abs(found.states[-1] - orbit(0.0)).max() < 1e-9
    spring = orbit(np.linspace(0, orbit.period, 2000))
    assert found.speed.max() == pytest.approx(np.abs(spring[:, 1] - spring[:, 3]).max(), rel=1e-3)
