"""Machines in the plane: outlines against plane geometry, how steps lead them on, and their pictures."""

import math
from dataclasses import replace

import numpy as np
import pytest
from looks import check_looks

from orbits import InputError, Mechanism, find
from orbits.mechanics import Drawing, Outline, Potential, Spring
from orbits.show.plane import landings_of, motion_in_plane, plane_paths
from problems import rimless_wheel, rocking_block, shuttle

ANGLE, LENGTH = math.pi / 8, 0.4


@pytest.fixture(scope="module")
def walk():
    return find(rimless_wheel(2.0, LENGTH, 8, 0.5, 0.5, 20.0))


@pytest.fixture(scope="module")
def rock():
    return find(rocking_block(angle=0.3))


def paths_at(orbit, t):
    return plane_paths(orbit.source, orbit(t), landings_of(orbit, t))


def test_a_wheel_rolls_on_from_spoke_to_spoke(walk):
    """Its tips are a regular polygon around the hub, none is below ground, and two of them stand where those of before
    the step stood, or a step farther."""
    period, step = walk.period, 2 * LENGTH * math.sin(ANGLE)
    t = np.concatenate([np.linspace(0, 3.9 * period, 200), walk.flight_time + period * np.arange(3) + 1e-9])
    *spokes, body, path = paths_at(walk, t)
    assert len(spokes) == 8
    hub, tips = spokes[0].points[:, 0], np.stack([each.points[:, 1] for each in spokes], axis=1)
    assert np.hypot(*(tips - hub[:, None]).T) == pytest.approx(LENGTH)
    assert np.hypot(*(tips - np.roll(tips, 1, axis=1)).T) == pytest.approx(step)
    assert tips[..., 1].min() == pytest.approx(0, abs=1e-9)
    for k, places in enumerate(tips[-3:]):
        feet = np.sort(places[places[:, 1] < 1e-6, 0])
        assert feet == pytest.approx([k * step, (k + 1) * step], abs=1e-6)
    assert body.points.mean(1) == pytest.approx(hub)
    assert np.array_equal(path.points[:, 0], hub)
    turned = np.unwrap(np.arctan2(*(tips[:200, 0] - hub[:200]).T))
    assert np.abs(np.diff(turned)).max() < 0.1  # each spoke is the same one from step to step


def test_what_stands_does_not_slide(walk, rock):
    """The corner or tip on which each stands keeps its place in a flight."""
    for orbit in (walk, rock):
        t = np.linspace(0.01, 0.99, 50) * orbit.flight_time + orbit.period
        points = np.concatenate([each.points for each in paths_at(orbit, t)], axis=1)
        standing = np.abs(points[..., 1]).max(0) < 1e-12
        assert standing.any()
        assert np.ptp(points[:, standing, 0], axis=0) == pytest.approx(0, abs=1e-12)


def test_a_block_rocks_to_both_sides(rock):
    """A cycle on it is its mirror image about the middle of its base."""
    t = np.linspace(0, rock.period, 60)[:-1]
    block, body, _ = paths_at(rock, t)
    later, body_later, _ = paths_at(rock, t + rock.period)
    middle = -math.sin(0.3)
    for one, other in ((block, later), (body, body_later)):
        assert other.points[..., 0] == pytest.approx(2 * middle - one.points[..., 0], abs=1e-12)
        assert other.points[..., 1] == pytest.approx(one.points[..., 1], abs=1e-12)
    sides = np.hypot(*(block.points - np.roll(block.points, 1, axis=1)).T)
    assert np.sort(sides, axis=0)[:2] == pytest.approx(2 * math.sin(0.3))
    assert block.points[..., 1].min() == pytest.approx(0, abs=1e-12)


def test_a_shuttle_touches_both_walls():
    orbit = find(shuttle(angle=0.4))
    t = np.array([0.0, orbit.flight_time]) + 1e-9
    wall, other, rod, *_ = paths_at(orbit, t)
    ends = rod.points[:, 1]
    assert np.arctan2(*ends.T) == pytest.approx([-0.4, 0.4], abs=1e-6)
    assert {each.colour for each in (wall, other)} == {wall.colour} != {rod.colour}
    assert np.ptp(wall.points, axis=0) == pytest.approx(0)


def test_on_a_slope_the_ground_falls():
    tilted = rimless_wheel(2.0, LENGTH, 8, 0.5, 0.5, 20.0, slope=0.1)
    states = np.zeros((4, 4))  # two feet stand
    spokes = plane_paths(tilted, states, np.arange(4))[:8]
    tips = np.stack([each.points[:, 1] for each in spokes], axis=1)
    for k, places in enumerate(tips):
        along, across = places @ [math.cos(0.1), -math.sin(0.1)], places @ [math.sin(0.1), math.cos(0.1)]
        assert np.sort(along[np.abs(across) < 1e-12]) / (2 * LENGTH * math.sin(ANGLE)) == pytest.approx([k - 1, k])


def test_pictures_can_be_read(walk, rock):
    for orbit in (walk, rock, find(shuttle(angle=0.4))):
        axes = orbit.plot()
        check_looks(f"in the plane: {orbit.machine['machine']}", axes.figure)
        _, names = axes.get_legend_handles_labels()
        assert names[-1] == "inner body"
        assert len(names) == 2


def test_a_page_shows_cycles_after_which_it_looks_as_at_first(walk, rock):
    wheel, block = motion_in_plane(walk), motion_in_plane(rock)
    assert (wheel.cycles, block.cycles) == (4, 2)  # half a turn of eight spokes; both sides
    for motion, total in ((wheel, 18), (block, 6)):
        sizes, names = motion.outlines["size"], motion.outlines["name"]
        assert (sum(sizes), names[-2], sizes[-2], sizes[-1]) == (total, "inner body", 2, 0)
        last = motion.points[-len(motion.points) * 2 // total :].reshape(-1, 2, 2)
        assert np.sort(last[0], axis=0) == pytest.approx(np.sort(last[-1], axis=0), abs=1e-5)


@pytest.mark.parametrize(("spokes", "cycles"), [(6, 3), (7, 7)])
def test_half_a_turn_or_a_whole_one_leads_back(spokes, cycles):
    assert motion_in_plane(find(rimless_wheel(2.0, LENGTH, spokes, 0.5, 0.5, 20.0))).cycles == cycles


def test_the_path_on_a_page_is_of_arcs_about_the_feet(walk, rock):
    wheel, block = motion_in_plane(walk), motion_in_plane(rock)
    assert wheel.advance == pytest.approx(2 * LENGTH * math.sin(ANGLE))
    feet = np.array([[x, 0.0] for x in wheel.marks])
    path = wheel.trails.reshape(-1, 2)
    far = np.hypot(*(path[:, None] - feet).transpose(2, 0, 1))
    assert np.sort(far, axis=1)[:, 0] == pytest.approx(LENGTH, rel=1e-6)
    assert (np.diff(path[:, 0]) > -1e-6).all()  # it never goes back
    assert path[-1, 0] - path[0, 0] == pytest.approx(6 * wheel.advance, rel=1e-2)
    assert (block.advance, block.marks) == (0.0, [])


def test_what_is_no_drawing_is_refused():
    def stated(drawing):
        elements = [Spring("phi - theta"), Potential("cos(theta)")]
        return Mechanism(("phi", "theta"), elements, gap="theta", inertia={"phi": 1.0, "theta": 1.0}, drawing=drawing)

    with pytest.raises(InputError, match="'sin\\(theta_1\\)' has 'theta_1'"):
        stated(Drawing([Outline("rod", [(0.0, 0.0), ("sin(theta_1)", "steps + i")])]))
    with pytest.raises(InputError, match="onward has 'z'; it may only have 'x' and 'y'"):
        stated(Drawing([], onward={"z": "x"}))
    with pytest.raises(InputError, match="it must be a Drawing of a list of Outlines"):
        stated([])
    assert replace(rimless_wheel(angle=0.3), drawing=None).drawing is None
