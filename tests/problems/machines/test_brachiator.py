"""Brachiators against digits of an integration with 34, and against equations of motion by hand."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits import InputError, find, find_all, follow
from problems import brachiator
from problems.machines import build, read

CASE = Path(__file__).parents[3] / "studies" / "exact_orbits" / "cases" / "brachiator.json"
WITH_BODY = {"arm_mass": 0.15, "body_inertia": 0.02, "body_centre": 0.2}
NEAR_BODY = {"angle": 0.6, "body'": 0.6, "half_swing": 1.7}


@pytest.fixture(scope="module")
def swing():
    return find(brachiator(arm_mass=0.25, arm_centre=0.5, arm_inertia=0.25 / 12))


def by_hand(t, x, p):
    """The rates of two arms, by Lagrange's equations on paper: x = (held, free, held', free')."""
    m, d, inertia = p["arm_mass"], p["arm_centre"], p.get("arm_inertia", p["arm_mass"] / 12)
    held, free, first, second = x
    coupled, turned = m * d * np.cos(held - free), m * d * np.sin(held - free)
    matrix = [[m * (1 - d) ** 2 + inertia + 1 - m, coupled], [coupled, m * d**2 + inertia]]
    loads = [
        -turned * second**2 - (m * (1 - d) + 1 - m) * np.sin(held),
        turned * first**2 - m * d * np.sin(free),
    ]
    return [first, second, *np.linalg.solve(matrix, loads)]


def test_the_swing_of_two_rods(swing):
    known = json.loads(CASE.read_text())["unknowns"]
    numbers = json.loads(CASE.read_text())["numbers"]
    assert swing.angle == pytest.approx(known["release"]["value"], rel=1e-14)
    assert swing.half_swing == pytest.approx(known["half"]["value"], rel=1e-14)
    assert swing.rates == pytest.approx([numbers[name]["value"] for name in ("held_rate", "free_rate")], rel=1e-13)
    assert swing.mean_speed == pytest.approx(numbers["mean_speed"]["value"], rel=1e-14)
    assert swing.step == pytest.approx(numbers["reach"]["value"], rel=1e-14)
    assert swing.admissible
    assert swing.smallest_separation == pytest.approx(np.cos(swing.angle), rel=1e-13)
    assert max(swing.errors.values()) < 1e-14


def test_the_forces_of_the_bar_by_the_work_of_the_masses(swing):
    """In mid-swing all hangs straight down, and the bar carries the weight and the centripetal forces."""
    first, second = swing.rates
    m = 0.25
    turned = m * 0.5 * first**2 + (1 - 2 * m) * first**2 + m * (first**2 + 0.5 * second**2)
    assert swing.largest_grip_force == pytest.approx(1 + turned, rel=1e-12)
    # At release nothing moves, so that the bar carries the weight less the masses' downward accelerations.
    b, p = swing.angle, swing.source.values
    *_, turn, other = by_hand(0.0, [-b, b - np.pi, 0.0, 0.0], p)
    shoulder = -np.sin(b) * turn
    heights = [0.5 * shoulder, shoulder, shoulder + 0.5 * np.sin(b - np.pi) * other]
    assert swing.smallest_grip_force == pytest.approx(1 + np.dot([m, 1 - 2 * m, m], heights), rel=1e-12)


@pytest.mark.parametrize("numbers", [{"arm_mass": 0.3, "arm_centre": 0.4}, {"arm_mass": 0.21, "arm_inertia": 0.0}])
def test_two_swings_by_hand_lead_from_hold_to_hold(numbers):
    machine = brachiator(**numbers)
    swing, p = find(machine), machine.values
    accurate = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "args": (p,)}
    x = np.array([-swing.angle, swing.angle - np.pi, 0.0, 0.0])
    for _ in range(2):
        half = solve_ivp(by_hand, (0, swing.half_swing), x, **accurate).y[:, -1]
        assert half == pytest.approx([0.0, 0.0, *swing.rates], abs=1e-11)
        whole = solve_ivp(by_hand, (0, swing.period), x, **accurate).y[:, -1]
        x = np.array([whole[1] - np.pi, whole[0] - np.pi, whole[3], whole[2]])  # in the names of the next swing
    assert x == pytest.approx([-swing.angle, swing.angle - np.pi, 0.0, 0.0], abs=1e-9)
    assert swing(np.array([swing.half_swing, 1.5 * swing.half_swing])) == pytest.approx(
        np.array([[0, swing.rates[0], 0, swing.rates[1]], swing(0.5 * swing.half_swing) * [-1, 1, -1, 1]]), abs=1e-12
    )


def test_a_body_that_hangs_from_the_shoulder():
    swing = find(brachiator(**WITH_BODY), start=NEAR_BODY)
    known = {"angle": 0.611906774689, "body'": 0.61154799004, "half_swing": 1.70837526548}  # of another program
    assert swing.start == pytest.approx(known, rel=2e-11)
    assert len(swing.rates) == 3


@pytest.mark.slow
def test_the_search_finds_the_fastest_swing_with_a_body():
    swing = find(brachiator(**WITH_BODY))
    assert swing.angle == pytest.approx(0.611906774689, rel=2e-11)


def test_a_body_of_no_extent_is_a_mass_at_the_shoulder():
    """Nothing turns it, so that it keeps its speed, and passes 0 in mid-swing only if that is 0."""
    start = {"angle": 1.2, "body'": 0.0, "half_swing": 1.9}
    body = find(brachiator(body_inertia=0.1, body_centre=0.0), start=start)
    alone = find(brachiator(), start={"angle": 1.2, "half_swing": 1.9})
    assert [body.angle, body.half_swing] == pytest.approx([alone.angle, alone.half_swing], rel=1e-13)
    assert abs(body.start["body'"]) < 1e-14


def test_in_si_and_in_other_units(swing):
    metres = find(brachiator(in_si=True, mass=10.0, arm_mass=2.5, arm_length=0.6, arm_centre=0.3))
    time, weight = np.sqrt(0.6 / 9.80665), 10 * 9.80665
    assert metres.angle == pytest.approx(swing.angle, rel=1e-13)
    assert metres.half_swing == pytest.approx(swing.half_swing * time, rel=1e-13)
    assert metres.mean_speed == pytest.approx(swing.mean_speed * 0.6 / time, rel=1e-13)
    assert metres.largest_grip_force == pytest.approx(swing.largest_grip_force * weight, rel=1e-12)
    assert metres.rates == pytest.approx(swing.rates / time, rel=1e-12)
    assert [metres.unit_of(name) for name in ("angle", "half_swing", "mean_speed", "largest_grip_force")] == [
        "rad", "s", "m/s", "N",
    ]  # fmt: skip
    assert "m/s" in str(metres)


def test_several_swings_by_admissibility_and_speed():
    swings = find_all(brachiator())
    admissible = [swing.admissible for swing in swings]
    assert admissible == sorted(admissible, reverse=True)
    assert [round(swing.angle, 6) for swing in swings[:3]] == [1.207243, 0.413821, 0.138002]
    assert all("above the bar" in swing.violations[0] for swing in swings if not swing.admissible)


def test_a_file_states_it(tmp_path):
    path = tmp_path / "ape.toml"
    path.write_text('machine = "brachiator"\n[si]\nmass = 10.0\narm_mass = 2.5\narm_length = 0.6\narm_centre = 0.3\n')
    machine = build(read(path), str(path))
    assert machine.in_si
    assert machine.values["arm_mass"] == 2.5
    path.write_text('machine = "brachiator"\nspring = "r"\n')
    with pytest.raises(InputError, match="a brachiator has arm_mass"):
        build(read(path), str(path))
    path.write_text('machine = "brachiator"\n[parameters]\narm_mas = 0.2\n')
    with pytest.raises(InputError, match="unknown key 'arm_mas'"):
        build(read(path), str(path))


@pytest.mark.parametrize(
    ("numbers", "why"),
    [
        ({"arm_mass": 0.5}, "arm_mass = 0.5; it must be below half the mass 1"),
        ({"arm_mass": -0.1}, "arm_mass = -0.1; for a brachiator it must lie above 0"),
        ({"arm_length": -1.0}, "arm_length = -1; for a brachiator it must lie above 0"),
        ({"arm_centre": 2.0}, "arm_centre = 2; it must lie from 0"),
        ({"arm_inertia": -1.0}, "the inertia of coordinate"),
        ({"in_si": True, "mass": 10.0}, r"needs arm_mass \(kg\)"),
    ],
)
def test_refused_numbers(numbers, why):
    with pytest.raises(InputError, match=why):
        brachiator(**numbers)


def test_a_family_goes_to_no_machine_that_cannot_be():
    with pytest.raises(InputError, match=r"mass - 2\*arm_mass = -0\.4"):
        follow(brachiator(), "arm_mass", 0.7)
