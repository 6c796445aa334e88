"""A walker against published equations that were solved elsewhere, closed forms, and its conditions integrated here."""

from dataclasses import replace

import numpy as np
import pytest

from orbits import InputError, NoOrbit, find, follow, simulate
from orbits.mechanics import Spring
from orbits.show.plane import labelled, plane_paths
from problems import walker
from problems.machines.walker import UNITS_OF_WALKER

TUNE = ("torso_inertia", "hip_stiffness")
# Designs with their step angle, the solution of two programs in other coordinates: rates in mid-stance, half times of
# single and double stance, and the tuned numbers.
KNOWN = [
    (
        {"leg_mass": 0.1, "leg_centre": 1.0, "leg_inertia": 0.0, "torso_height": 0.0},
        0.3, (0.093394720911678, -1.5619009862584996, -0.5297977502514608), 2.3901085903795560, 0.4044357111253,
        (0.41824193818688386, 0.39402694221511943),
    ),
    (
        {"leg_mass": 0.05, "leg_centre": 0.5, "leg_inertia": 0.05 / 12, "torso_height": 0.2},
        0.2, (0.129029428982737, -0.793348702896021, -0.381185176861880), 2.615125701614618, 0.4711610002383,
        (0.266701219273255, 0.311268251173758),
    ),
]  # fmt: skip


@pytest.fixture(scope="module", params=range(len(KNOWN)))
def known(request):
    design, angle, *figures = KNOWN[request.param]
    machine = walker(**design, torso_inertia=round(figures[3][0], 2), hip_stiffness=round(figures[3][1], 2))
    return find(machine, tune=TUNE, at={"angle": angle}), angle, *figures


def test_it_is_the_walker_that_two_programs_found(known):
    walk, angle, rates, single, double, tuned = known
    assert walk.admissible, walk.violations
    np.testing.assert_allclose(walk.rates, rates, rtol=0, atol=1e-11)
    assert walk.half_stance == pytest.approx(single, abs=1e-11)
    assert walk.half_double_stance == pytest.approx(double, abs=1e-11)
    assert [*walk.tuned.values()] == pytest.approx(tuned, abs=1e-11)
    assert walk.step == pytest.approx(2 * np.sin(angle), abs=1e-13)
    assert walk.mean_speed == pytest.approx(walk.step / (2 * (single + double)), abs=1e-11)


def test_each_leg_has_its_colour_and_stands_still_where_it_landed(known):
    walk, *_ = known
    begins = walk.period + np.array([0.0, walk.flight_time])  # of the second leg's stance, and of the double one
    t = np.concatenate([begins[0] + np.linspace(0, walk.flight_time, 9), [begins[1] + walk.contact_time / 2]])
    torso, first, second, centre, path = plane_paths(*labelled(walk, t))
    names = ["torso", "first leg", "second leg", "torso", "path of the hip"]
    assert [each.outline.name for each in (torso, first, second, centre, path)] == names
    assert torso.colour == centre.colour
    assert len({torso.colour, first.colour, second.colour}) == 3
    assert second.points[:, 1] == pytest.approx(np.array([[walk.step, 0.0]] * 10), abs=1e-12)
    assert first.points[[0, 8, 9], 1, 0] == pytest.approx([0.0, 2 * walk.step, 2 * walk.step], abs=1e-12)
    assert first.points[:, 1, 1].max() > 0.03
    assert path.points[4, 0] == pytest.approx([walk.step, 1.0], abs=1e-12)
    for leg in (first, second):
        assert np.linalg.norm(np.diff(leg.points, axis=1), axis=2) == pytest.approx(1.0)
    assert np.linalg.norm(centre.points - path.points, axis=2) == pytest.approx(walk.source.values["torso_height"])


def test_a_simulation_is_drawn_as_the_walk_is(known):
    walk, *_ = known
    run = simulate(walk.source, walk, hops=2)
    t = np.linspace(0, run.end, 50)
    for simulated, own in zip(plane_paths(*labelled(run, t)), plane_paths(*labelled(walk, t)), strict=True):
        assert simulated.points == pytest.approx(own.points, abs=1e-5)


def test_the_bodies_for_simulators_move_as_it_is_drawn(known, tmp_path):
    walk, *_ = known
    t = np.linspace(0, 2.9 * walk.period, 40)
    lines = (walk.export(tmp_path, t) / "motion.csv").read_text().splitlines()
    rows = np.array([[x for i, x in enumerate(line.split(",")) if i != 1] for line in lines[1:]], float)
    across, up, pitch, *hips = rows[:, 1:6].T
    _, *legs, _, _ = plane_paths(*labelled(walk, t))
    for hip, leg in zip(hips, legs, strict=True):
        foot = np.stack([across - np.sin(pitch + hip), up - np.cos(pitch + hip)], axis=1)
        assert foot == pytest.approx(leg.points[:, 1], abs=1e-12)


def test_quantities_of_motions_are_columns_of_a_family_along_the_angle(known):
    walk, angle, *_ = known
    curve = follow(walk.source, "angle", angle + 1e-3, walk, tune=TUNE)
    assert curve.column("mean_speed")[0] == pytest.approx(walk.mean_speed, abs=1e-12)
    assert curve.column("step") == pytest.approx(2 * np.sin(curve.column("angle")), abs=1e-12)


def test_its_numbers_in_si_have_units():
    machine = walker(9.0, 0.35, 0.6, 0.1, 15.0, 180.0, mass=60.0, leg_length=0.9, in_si=True)
    units = {**UNITS_OF_WALKER, "surface_gravity": "m/s^2"}
    assert machine.describe()["units"] == units
    texts = machine.units.texts()
    lengths = {name: texts[name] for name in ("clearance", "step", "alpha", "liftoff_extension")}
    assert lengths == {"clearance": "m", "step": "m", "alpha": "rad/s", "liftoff_extension": "rad"}
    forces = {name: texts[name] for name in ("smallest_contact_force", "landing_jerk", "half_stance")}
    assert forces == {"smallest_contact_force": "N", "landing_jerk": "m/s^3", "half_stance": "s"}
    with pytest.raises(InputError, match="a walker in SI needs mass"):
        walker(9.0, 0.35, 0.6, 0.1, 15.0, 180.0, in_si=True)


@pytest.mark.parametrize(
    "change",
    [
        {"gap": "-leg_length*sin(lean)*sin(angle)"},  # half the height
        {"gap": "-2*leg_length*sin(lean)*sin(angle)*(2 + cos(torso))"},
        {"sticks": ["angle"]},
        {"sticks": {"angle": "4*leg_length*cos(lean)*sin(angle)"}},
        {"elements": [*walker().elements, Spring("leg_length*sin(lean + angle)", "0.02*r")]},  # to a wall
    ],
)
def test_points_whose_forces_are_not_those_of_the_ground_are_refused(change):
    with pytest.raises(InputError, match="the forces on both points of the walker do not add up"):
        _ = replace(walker(), **change).model


@pytest.mark.parametrize(
    ("numbers", "telling"),
    [
        ({"leg_centre": 2.0}, "leg_centre = 2; it must be at most leg_length = 1"),
        ({"torso_inertia": 0.0}, "the torso has no inertia"),
    ],
)
def test_more_numbers_of_no_walker_are_refused(numbers, telling):
    with pytest.raises(InputError, match=telling):
        walker(**numbers)


def test_walks_that_are_none_are_refused_at_once():
    with pytest.raises(InputError, match="at 'angle' = 0: there the walker rests"):
        find(walker(), tune=TUNE, at={"angle": 0.0})
    with pytest.raises(InputError, match="'leg_length' does not change with 'angle'"):
        _ = replace(walker(), sticks={"angle": "leg_length"}).model
    with pytest.raises(NoOrbit, match="no small steps of a walker"):
        find(walker(hip_stiffness=0.0), tune=TUNE, at={"angle": 0.3})


def test_numbers_that_are_0_may_be_tuned():
    walk = find(walker(torso_inertia=0.42), tune=("leg_spring", "hip_stiffness"), at={"angle": 0.3})
    assert walk.admissible
    assert 0 < walk.tuned["leg_spring"] < 0.01
