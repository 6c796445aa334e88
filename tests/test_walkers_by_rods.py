"""Walkers and brachiators against an integration of rods on pins in Cartesian coordinates, from one mid-swing to the
next."""

import json
from pathlib import Path

import numpy as np
import pytest
from rods import on_two_legs, point

CASES = Path(__file__).parent.parent / "studies" / "exact_orbits" / "cases"


def stepped(leg, body, angle, rates, times, stiffness=0.0, leg_spring=0.0):
    """The least force up on the standing foot and the largest friction that a step needs, after checks that it loses
    nothing.

    The leg that swings lands at rest and without force, the other one lifts off without force, and mid-stance returns
    with the legs' rates exchanged. The drift of the pins and of the energy bounds the error of the integration.
    """
    one, both, other = (on_two_legs(leg, body, ends, stiffness, leg_spring) for ends in ((0,), (0, 1), (1,)))
    half_stance, double_stance = np.linspace(0, times[0], 101), np.linspace(0, 2 * times[1], 101)
    first = one.move(one.hung(np.zeros(3), rates), half_stance)
    second = both.move(first[-1], double_stance)
    third = other.move(second[-1], half_stance)
    walked = ((one, first), (both, second), (other, third))
    assert max(rods.drift(path) for rods, path in walked) < 1e-11
    assert np.ptp(np.concatenate([rods.energy(path) for rods, path in walked])) < 1e-11
    assert first[-1, :, :2, 2] == pytest.approx(np.array([[angle, -angle], [0.0, 0.0]]), abs=1e-11)
    feet = both.forces(second)[:, :2]
    assert [*feet[0, 1], *feet[-1, 0]] == pytest.approx([0.0] * 4, abs=1e-10)
    assert second[-1, 0, 2, 2] == pytest.approx(-second[0, 0, 2, 2], abs=1e-11)
    assert third[-1, 0, :, 2] == pytest.approx(np.zeros(3), abs=1e-10)
    assert third[-1, 1, [1, 0, 2], 2] == pytest.approx(rates, abs=1e-10)
    standing = one.forces(first)[:, 0]
    loaded = np.concatenate([standing, *(foot[foot[:, 1] > 1e-6] for foot in np.moveaxis(feet, 1, 0))])
    return standing[:, 1].min(), np.abs(loaded[:, 0] / loaded[:, 1]).max()


def swung(arm, body, angle, half_swing, body_rate=0.0):
    """The rates in mid-swing of both arms and of the body below them, after checks that two swings lose nothing.

    The machine hangs straight down in the middle of each swing, and both arms are at rest at its end, with the free
    hand at the next hold. The angles of rods are from the vertical above, so that their rates have the other sign.
    """
    one, other = (on_two_legs(arm, body, ends) for ends in ((0,), (1,)))
    released = one.hung([np.pi + angle, np.pi - angle, 0.0], [0.0, 0.0, -body_rate])
    first = one.move(released, np.linspace(0, 2 * half_swing, 3))
    second = other.move(first[-1], np.linspace(0, 2 * half_swing, 3))
    for path, rods, free, place in ((first, one, 1, 2), (second, other, 0, 4)):
        assert rods.drift(path) < 1e-11
        assert np.ptp(rods.energy(path)) < 1e-11
        assert np.exp(1j * path[1, 0, [1 - free, free, 2], 2]) == pytest.approx(np.array([-1.0, 1.0, 1.0]), abs=1e-10)
        hand = point(path[-1], free, arm[1] - 1)
        assert hand == pytest.approx(np.array([[place * np.sin(angle), 0.0], [0.0, 0.0]]), abs=1e-9)
        assert path[-1, 1, :, 2] == pytest.approx([0.0, 0.0, -body_rate], abs=1e-9)
    return -first[1, 1, :, 2]


def stated(name):
    """A case of the exact orbits: its parameters, its unknowns and its other numbers."""
    case = json.loads((CASES / f"{name}.json").read_text())
    numbers, unknowns = ({key: each["value"] for key, each in case[of].items()} for of in ("numbers", "unknowns"))
    return case["parameters"], unknowns, numbers


def test_the_exact_walker():
    p, x, numbers = stated("walker")
    m, angle, rates = p["foot_mass"], p["step_angle"], [x[f"{of}_start"] for of in ("stance", "swing", "torso")]
    times, body = (x["half_stance"], numbers["two_feet_time"] / 2), (1 - 2 * m, 0.0, x["inertia"])
    stepped((m, 1.0, 0.0), body, angle, rates, times, x["hip_stiffness"])


def test_the_exact_brachiator():
    p, x, numbers = stated("brachiator")
    m = p["arm_mass"]
    rates = swung((m, 0.5, m / 12), (1 - 2 * m, 0.0, 1.0), x["release"], x["half"])
    assert rates == pytest.approx([numbers["held_rate"], numbers["free_rate"], 0.0], abs=1e-11)


def test_arms_of_another_inertia_do_not_pass():
    with pytest.raises(AssertionError):
        swung((0.25, 0.5, 0.0208), (0.5, 0.0, 1.0), 1.2072434456591203, 1.918479383230644)
