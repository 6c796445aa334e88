"""Branch points of the vertical hop of a runner, against an integration of the linear equations by DOP853."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits import InputError, NoOrbit, find, find_branch_points
from problems import Hopper, runner

TUNE = ("inertia", "hip_stiffness")
BOX = {"inertia": (0.8, 9.0), "hip_stiffness": (5.0, 14.0)}


def singular_values(inertia, hip, rest, m2=0.1, s=4.493409457909064):
    """Of the force and of the two angles in mid-contact per rate in mid-flight, for m1 = k = g = 1 and a linear leg,
    whose hop has a closed form; s = tan s."""
    mu, rho = m2 / (1 + m2), 1 / (1 + m2)
    wf, size = np.sqrt(1 / mu), m2 / np.cos(s)
    half, fall = s / wf, -s / wf / rho
    start = np.array([m2 + 1, fall])
    contact = np.pi + np.arctan2(fall, m2 + 1)

    def flight(t, y):
        leg = rest + size * np.cos(wf * t)
        return [y[1] / leg**2, hip * (y[2] - y[0]) / mu, y[3], -hip * (y[2] - y[0]) / inertia]

    def stance(t, y):
        leg = rest - 1 + start @ [np.cos(t), np.sin(t)]
        return [y[1] / leg**2, hip * (y[2] - y[0]) + leg * y[0], y[3], -hip * (y[2] - y[0]) / inertia]

    columns = []
    for first in ([0, (rest + size) ** 2, 0, 0], [0, 0, 0, 1]):
        y = solve_ivp(flight, (0, half), first, method="DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
        force = -m2 * y[0] + hip * (y[2] - y[0]) / (rest + m2)
        y = solve_ivp(stance, (0, contact), y, method="DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
        columns.append([force, y[0], y[2]])
    return np.linalg.svd(np.array(columns).T)[1]


@pytest.fixture(scope="module")
def points():
    return find_branch_points(runner(rest_length=3.707978), BOX, designs=24)


@pytest.fixture(scope="module")
def point(points):
    return points[1]


@pytest.mark.slow
def test_one_motion_is_free_there(point):
    assert point.nullity == 1
    assert 0.1 < point.conditioning <= 1


@pytest.mark.slow
def test_the_hop_is_a_motion(point):
    assert point.hop.admissible
    assert point.hop.alpha == pytest.approx(4.493409457909064 * np.sqrt(0.1 * 1.1), rel=1e-14)


@pytest.mark.slow
def test_runs_begin_there(point):
    changes = []
    for speed in (0.02, 0.04):
        run = find(point.machine, start=point.start(speed), tune=TUNE, at={"speed": speed})
        away = [(run.source.values[name] - point.values[name]) / speed**2 for name in TUNE]
        changes.append([*away, (run.step / speed - point.step) / speed**2])
    np.testing.assert_allclose(changes[0], changes[1], rtol=0.02)


@pytest.mark.slow
class TestOfTheRunner:
    def test_the_rank_is_lost(self, points):
        for each in points:
            largest, least = singular_values(*each.values.values(), 3.707978)
            assert least < 1e-12 * largest

    def test_the_errors_are_bounds(self, points):
        references = [(0.9903795363095751, 12.548131683990596), (7.0824419372526, 5.5255512874429)]
        for each, reference in zip(points, references, strict=True):
            for name, value in zip(TUNE, reference, strict=True):
                assert abs(each.values[name] - value) < 2 * each.errors[name] < 1e-11

    def test_no_run_begins_without_speed(self, points):
        with pytest.raises(InputError, match="every design hops"):
            points[0].start(0.0)


@pytest.mark.slow
def test_the_hop_may_depend_on_the_ranges():
    machine, over = runner(inertia=7.0824419372526), {"rest_length": (3.6, 3.8), "hip_stiffness": (5.4, 5.7)}
    (only,) = find_branch_points(machine, over, designs=8)
    assert only.values["rest_length"] == pytest.approx(3.707978, abs=1e-11)


@pytest.mark.parametrize(
    ("over", "text"),
    [
        ({"inertia": (1.0, 2.0)}, "ranges of two"),
        ({"inertia": (2.0, 1.0), "hip_stiffness": (5.0, 6.0)}, r"'inertia' = \(2, 1\)"),
        ({"inertia": (1.0, 2.0), "hip": (5.0, 6.0)}, "hip"),
        ({"inertia": (-3.0, 9.0), "hip_stiffness": (5.0, 6.0)}, r"\(-3, 9\): state a range of values that the machine"),
        ({"inertia": 5.0, "hip_stiffness": (5.0, 6.0)}, "over 'inertia' = 5.0; it must be a pair"),
        ("inertia", "a mapping of names to ranges"),
    ],
)
def test_ranges_are_refused(over, text):
    with pytest.raises(InputError, match=text):
        find_branch_points(runner(), over)


def test_machines_are_refused():
    with pytest.raises(InputError, match="coordinates that stick"):
        find_branch_points(Hopper(), {"mass_ratio": (1.0, 2.0), "rest_length": (5.0, 6.0)})
    with pytest.raises(InputError, match="designs = 3"):
        find_branch_points(runner(), BOX, designs=3)
    with pytest.raises(NoOrbit, match="pass through each other"):
        find_branch_points(runner(rest_length=2.0), BOX, designs=8)


def test_none():
    with pytest.raises(NoOrbit, match=r"no run branches off .* inertia from 3 to 4"):
        find_branch_points(runner(), {"inertia": (3.0, 4.0), "hip_stiffness": (7.0, 9.0)}, designs=8)
