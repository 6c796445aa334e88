"""Walkers and brachiators against an integration of rods on pins in Cartesian coordinates, from one mid-swing to the
next."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import slow_after
from rods import on_two_legs, point

from orbits import find
from problems import brachiator, walker

CASES = Path(__file__).parent.parent / "studies" / "exact_orbits" / "cases"
# Walkers at random: leg_mass, leg_centre, leg_inertia, torso_height, leg_spring, the angle at landing, and two digits
# of torso_inertia and hip_stiffness, which an earlier search by shooting found.
WALKERS = [
    (0.0285, 0.8446, 0.00259, 0.0722, 0.0, 0.4433, 0.63, 0.40),
    (0.1258, 1.0, 0.0, 0.0, 0.0755, 0.1931, 0.046, 0.22),  # the standing leg turns back in mid-stance
    (0.1122, 0.9929, 0.00404, 0.0, 0.0, 0.5327, 0.59, 0.37),
    (0.1155, 0.6252, 0.01152, 0.1856, 0.0, 0.3277, 1.8, 0.39),
    (0.1016, 0.6498, 0.00258, 0.2765, 0.0569, 0.2346, 0.81, 0.26),  # double stance needs most friction
    (0.0312, 1.0, 0.0, 0.0, 0.0415, 0.584, 1.2, 0.36),
    (0.0315, 0.4287, 0.00182, 0.0, 0.0968, 0.4942, 0.52, 0.27),
    (0.184, 0.5414, 0.0116, 0.0131, 0.0, 0.1378, 0.075, 0.32),
    (0.0558, 0.864, 0.00199, 0.059, 0.1645, 0.2132, 0.75, 0.10),
    (0.0902, 0.4244, 0.00784, 0.0601, 0.0643, 0.5287, 0.64, 0.27),
    (0.1386, 0.5081, 0.00944, 0.0, 0.1267, 0.2551, 0.17, 0.17),
]


def stepped(leg, body, angle, rates, times, stiffness=0.0, leg_spring=0.0):
    """The least force up on the standing foot and the largest friction that a step needs, after checks that it loses
    nothing.

    The leg that swings lands at rest and without force, the other one lifts off without force, and mid-stance returns
    with the legs' rates exchanged. The drift of the pins and of the energy bounds the error of the integration.
    """
    one, both, other = (on_two_legs(leg, body, ends, stiffness, leg_spring) for ends in ((0,), (0, 1), (1,)))
    half_stance, double_stance = np.linspace(0, times[0], 401), np.linspace(0, 2 * times[1], 401)
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


@pytest.mark.parametrize(
    ("numbers", "start"),
    [
        ({"arm_mass": 0.3, "arm_centre": 0.6}, None),
        ({"arm_mass": 0.15, "body_inertia": 0.02, "body_centre": 0.2}, {"angle": 0.6, "body'": 0.6, "half_swing": 1.7}),
    ],
)
def test_brachiators_that_are_found(numbers, start):
    swing, m = find(brachiator(**numbers), start=start), numbers["arm_mass"]
    body = (1 - 2 * m, -numbers.get("body_centre", 0.0), numbers.get("body_inertia", 1.0))
    arm, rate = (m, numbers.get("arm_centre", 0.5), m / 12), swing.release.get("body'", 0.0)
    rates = swung(arm, body, swing.angle, swing.half_swing, rate)
    assert rates[: len(swing.rates)] == pytest.approx(swing.rates, abs=1e-11)


def test_arms_of_another_inertia_do_not_pass():
    with pytest.raises(AssertionError):
        swung((0.25, 0.5, 0.0208), (0.5, 0.0, 1.0), 1.2072434456591203, 1.918479383230644)


@pytest.mark.parametrize("numbers", slow_after(2, [(row,) for row in WALKERS]))
def test_walkers_at_random(numbers):
    *leg, c, leg_spring, angle, inertia, stiffness = numbers
    machine = walker(*leg, c, inertia, stiffness, leg_spring)
    walk = find(machine, tune=("torso_inertia", "hip_stiffness"), at={"angle": angle})
    assert walk.admissible
    inertia, stiffness = walk.tuned.values()
    times, body = (walk.half_stance, walk.half_double_stance), (1 - 2 * leg[0], c, inertia)
    least, friction = stepped(leg, body, angle, walk.rates, times, stiffness, leg_spring)
    assert walk.certificate.smallest_contact_force == pytest.approx(least, abs=1e-4)
    assert walk.certificate.friction_needed == pytest.approx(friction, abs=1e-3)
