"""Steered motions of laws with corners, divided where they pass from one piece to the next."""

import numpy as np
import pytest

from orbits import simulate
from orbits.control import Guess
from problems import Actuated, Hopper, Juggler, springs, steering
from problems.steering.corners import passages_of

SHARP = Hopper(springs.bilinear(ratio=2.0, gap=0.5), mass_ratio=0.5, rest_length=20.0)


def test_the_cost_tends_to_that_of_a_straight_law():
    """Of ratios a little above and below 1; the linear law is steered without parts, on a few other intervals."""
    costs = []
    for ratio in (0.98, 1.0, 1.02):
        machine = Hopper(
            springs.bilinear(ratio=ratio, gap=0.5) if ratio != 1 else "r", mass_ratio=0.5, rest_length=20.0
        )
        costs.append(steering.recover(machine, 0.1, intervals=14).cost)
    assert (costs[0] + costs[2]) / 2 == pytest.approx(costs[1], rel=1e-2)


def test_the_parts_of_a_phase_are_one_leg():
    kept = steering.keep_hopping(SHARP.with_values(damping=0.01), intervals=14)
    assert [leg.phase for leg in kept.legs] == ["flight", "contact"]
    assert kept.periodic
    places = kept(kept.legs[0].inputs.times[:-1])
    assert np.abs(places[:, 0] - places[:, 2] - places[:, 4] - 0.5).min() < 1e-9  # a change of the rate at the corner
    assert np.all(np.diff(kept.table()["running cost"]) >= 0)
    again = steering.keep_hopping(SHARP.with_values(damping=0.011), intervals=14, guess=kept)
    assert 1.1 < again.cost / kept.cost < 1.3


@pytest.mark.slow
def test_a_start_passes_corners_in_the_order_of_its_motion():
    """The first swings of the guess pass the corner, those of the motion do not."""
    machine = Juggler(springs.bilinear(ratio=2.0, gap=0.5), mass_ratio=0.5)
    up = steering.start_up(machine, 2, intervals=14)
    assert steering.missed(machine, up) < 1e-9
    assert max(up(np.linspace(0, up.end, 500))[:, 2]) < 0.5


def test_passages_of_a_guess():
    driven = Actuated(Hopper(springs.end_stops(gap=1.0, stop=5.0)))
    contact, p = driven.model.contact, driven.values
    guess = Guess(2 * np.pi, lambda t: [1.5 * np.sin(t), 1.5 * np.cos(t), 0.0])
    found = passages_of(contact, p, guess)
    assert [each.piece for each in found] == [1, 2, 1, 0, 1]
    first = np.arcsin(1 / 1.5)
    ends = [first, np.pi - first, np.pi + first, 2 * np.pi - first, 2 * np.pi]
    assert [each.end for each in found] == pytest.approx(ends, abs=1e-9)


def test_a_motion_begins_on_a_row_of_a_table_up_to_rounding():
    rows = np.linspace(-12, 12, 25)
    machine = Juggler(springs.table((rows, rows + 0.02 * rows**3), noise=0), mass_ratio=0.5)
    exact = simulate(machine, state=[0.0, 4.0, 0.0, 4.0], hops=1).launches
    for off in (3e-36, -3e-36):
        assert simulate(machine, state=[off, 4.0, off, 4.0], hops=1).launches == pytest.approx(exact, rel=1e-12)
