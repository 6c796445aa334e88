"""Walkers and brachiators against an integration of rods on pins in Cartesian coordinates, from one mid-swing to the
next."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import slow_after
from rods import on_two_legs, point

from orbits import find, find_all
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
    (0.0558, 0.864, 0.00199, 0.059, 0.1645, 0.2132, 0.75, 0.10),
]
# Brachiators at random: arm_mass, arm_centre, arm_inertia, and the angle of the fastest swing by that search.
BRACHIATORS = [
    (0.2901, 0.3963, 0.02576, 1.254),
    (0.1617, 0.5712, 0.00874, 0.988),
    (0.0875, 0.4532, 0.00145, 1.193),
    (0.2886, 0.8296, 0.02174, 1.396),
    (0.131, 0.9086, 0.00346, 0.141),
    (0.1006, 0.3668, 0.00686, 0.959),
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
    """The rates in mid-swing of both arms and of the body below them, after checks that a swing loses nothing.

    The machine hangs straight down in the middle, and at the end both arms are at rest with the free hand at the next
    hold, and the body is as at the start. The angles of rods are from the vertical above, and fall where those of the
    machine grow.
    """
    rods = on_two_legs(arm, body, (0,))
    released = rods.hung([np.pi + angle, np.pi - angle, 0.0], [0.0, 0.0, -body_rate])
    path = rods.move(released, np.linspace(0, 2 * half_swing, 3))
    assert rods.drift(path) < 1e-11
    assert np.ptp(rods.energy(path)) < 1e-11
    assert path[1, 0, :, 2] == pytest.approx([np.pi, 0.0, 0.0], abs=1e-11)
    hand = point(path[-1], 1, arm[1] - 1)
    assert hand == pytest.approx(np.array([[2 * np.sin(angle), 0.0], [0.0, 0.0]]), abs=1e-9)
    assert path[-1, 0, 2, 2] == pytest.approx(0.0, abs=1e-9)
    assert path[-1, 1, :, 2] == pytest.approx([0.0, 0.0, -body_rate], abs=1e-9)
    return -path[1, 1, :, 2]


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


@pytest.mark.parametrize("numbers", slow_after(2, [(row,) for row in BRACHIATORS]))
def test_brachiators_at_random(numbers):
    *arm, angle = numbers
    first, *others = [swing for swing in find_all(brachiator(*arm)) if swing.admissible]
    assert first.angle == pytest.approx(angle, abs=1e-3)
    for swing in (first, *others[:1]):
        assert swing.mean_speed <= first.mean_speed
        rates = swung(arm, (1 - 2 * arm[0], 0.0, 1.0), swing.angle, swing.half_swing)
        assert swing.rates == pytest.approx(rates[:2], abs=1e-10)


@pytest.mark.parametrize(
    ("arm", "body", "near"),
    slow_after(1, [
        ((0.15, 0.5, 0.0125), (0.2, 0.02), (0.612, 0.612, 1.708)),
        ((0.137, 0.54, 0.004), (0.307, 0.0113), (0.715, 1.261, 1.438)),
        ((0.241, 0.442, 0.0133), (0.294, 0.0211), (0.748, 1.37, 1.555)),
        ((0.125, 0.345, 0.0135), (0.376, 0.0164), (0.593, 0.475, 1.594)),
    ]),
)  # fmt: skip
def test_brachiators_with_a_body(arm, body, near):
    centre, inertia = body
    machine = brachiator(*arm, body_centre=centre, body_inertia=inertia)
    start = dict(zip(("angle", "body'", "half_swing"), near, strict=True))
    swing = find(machine, start=start)
    assert [*swing.start.values()] == pytest.approx(near, abs=1e-3)
    whole = (1 - 2 * arm[0], -centre, inertia)
    assert swing.rates == pytest.approx(
        swung(arm, whole, swing.angle, swing.half_swing, swing.start["body'"]), abs=1e-10
    )
