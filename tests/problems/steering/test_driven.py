"""Driven machines: the motion with its machine, after its file, and animated."""

import json
from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import cumulative_trapezoid, trapezoid

from orbits import Control, InputError
from problems import Driven, Hopper, Juggler, steering
from problems.steering.driven import WithMovedEnd

C = 0.01


@pytest.mark.slow
def test_a_driven_motion_is_a_control_with_its_machine(driven_hopper, started_hopper):
    assert isinstance(driven_hopper, Control)
    assert driven_hopper.source == Hopper(damping=C)
    assert driven_hopper.states == ("y1", "y1'", "y2", "y2'", "u")
    assert driven_hopper.periodic
    assert not started_hopper.periodic
    assert driven_hopper.launch == pytest.approx(driven_hopper(0.0)[1])
    assert started_hopper.launch is None
    t = np.linspace(0, driven_hopper.end, 50)
    assert driven_hopper(t).shape == (50, 5)
    flight, contact = driven_hopper.legs
    assert np.array_equal(driven_hopper(3.0), flight.path(3.0)[:5])
    standing = contact.path(2.0)
    assert np.array_equal(driven_hopper(flight.duration + 2.0), [standing[0], standing[1], 0, 0, standing[2]])
    assert driven_hopper.motion.in_contact([1.0, 10.0]).tolist() == [False, True]
    with pytest.raises(InputError, match="times lie between 0 and"):
        driven_hopper(driven_hopper.end + 1)


@pytest.mark.slow
def test_the_table_tells_the_work(driven_hopper, started_hopper):
    """The integral of the power is the actuator's work, and the running cost of the effort ends at it."""
    for one in (driven_hopper, started_hopper):
        machine, t = one.source, np.linspace(0, one.end, 10001)
        table = one.table(t)
        assert trapezoid(table["power"], t) == pytest.approx(steering.work(machine, one)[0], rel=1e-3)
        assert table["running cost"][-1] == pytest.approx(one.cost, rel=1e-12)
        assert trapezoid(table["w"] ** 2, t) == pytest.approx(one.cost, rel=1e-3)
        done, positive = steering.work(machine, one)
        assert [table["work"][-1], table["positive work"][-1]] == pytest.approx([done, positive], rel=1e-12)
        so_far = cumulative_trapezoid(table["power"], t, initial=0)
        assert table["work"] == pytest.approx(so_far, abs=2e-3)
        assert table["power"] == pytest.approx(table["actuator force"] * table["w"], abs=1e-12)
        assert table["actuator force"] == pytest.approx(-table["spring force"], abs=1e-12)
    names = ["time", "stage", "y1", "y1'", "y2", "y2'", "u", "w", "running cost", "power", "actuator force"]
    assert list(driven_hopper.table()) == [*names, "work", "positive work", "spring force", "contact force"]


def test_the_largest_force_and_power_are_exact(driven_hopper):
    """The spring pulls as it is long, and the power jumps between intervals: dense samples of each, with its ends."""
    forces, powers = list[float](), list[float]()
    for leg in driven_hopper.legs:
        for start, end in pairwise(leg.inputs.times):
            rows = leg.path(np.linspace(start, end, 2001))
            pulls = rows[:, 0] - rows[:, 2] - rows[:, 4] if leg.phase == "flight" else rows[:, 0] - rows[:, 2]
            forces.append(np.abs(pulls).max())
            powers.append(forces[-1] * abs(float(leg.inputs(0.5 * (start + end))[0])))
    for largest, sampled in zip(driven_hopper.largest, (max(forces), max(powers)), strict=True):
        assert sampled * (1 - 1e-14) <= largest < sampled * (1 + 1e-6)


@pytest.mark.parametrize(
    "name", slow_after(1, ["driven_hopper", "started_hopper", "driven_leg"]), ids=["kept", "started", "leg"]
)
def test_files(name, tmp_path, request):
    """Motion and machine come back to the last bit, and can be used."""
    driven = request.getfixturevalue(name)
    again = Driven.load(driven.save(tmp_path / "driven.json"))
    assert again.save(tmp_path / "again.json").read_bytes() == (tmp_path / "driven.json").read_bytes()
    assert again.source == driven.source
    t = np.linspace(0, driven.end, 33)
    assert np.array_equal(again(t), driven(t))
    assert np.array_equal(again.dimensionless().inputs_at(0.1), driven.dimensionless().inputs_at(0.1))
    one, other = (each.simulate(1) for each in (again, driven))
    assert np.array_equal(one.run.launches, other.run.launches)
    assert np.array_equal(Control.load(tmp_path / "driven.json").legs[0].path(0.1), driven.legs[0].path(0.1))


@pytest.mark.usefixtures("any_digest")
@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ({"statement": {"spring": "table:/etc/passwd"}}, "in another file, which is not read"),
        ({"statement": {"spring": "__import__('os')"}}, "the machine"),
        ({"statement": {"spring": "r + r**3"}}, "it belongs to another machine"),
        ({"statement": {"sprung": "r"}}, "unknown key 'sprung'"),
        ({"statement": {"parameters": 3}}, "parameters"),
        ({"statement": 3}, "statement = 3; it must be a table"),
        ({"machine": {}}, "it belongs to another machine"),
    ],
)
def test_a_damaged_file_is_refused(driven_hopper, tmp_path, damage, words):
    document = json.loads(driven_hopper.save(tmp_path / "driven.json").read_text())
    (tmp_path / "driven.json").write_text(json.dumps(document | damage))
    with pytest.raises(InputError, match=words) as error:
        Driven.load(tmp_path / "driven.json")
    assert "is not a saved motion of a driven machine" in str(error.value)


@pytest.mark.parametrize("machine", [Hopper(rest_length=9.0), Juggler(rest_length=20.0)], ids=repr)
def test_an_animation_shows_the_end_that_moves(machine):
    """The spring is drawn from there, as long as its force says."""
    driven = steering.recover(machine, 0.1, intervals=14)
    motion = driven.motion
    shown = WithMovedEnd(**{each.name: getattr(motion, each.name) for each in fields(motion)})
    ((end, above),) = shown.springs
    states = driven(np.linspace(0, driven.end, 20))
    drawn = shown.heights[above](states) - shown.heights[end](states)
    extension = driven.actuated.model.extension(states) - states[:, -1]
    assert drawn == pytest.approx(machine.rest_length + extension, abs=1e-12)
    assert np.abs(states[:, -1]).max() > 1e-3


@pytest.mark.slow
def test_an_animation(driven_leg, tmp_path):
    from PIL import Image

    with Image.open(driven_leg.animate(tmp_path / "leg.gif", frames=4)) as picture:
        assert picture.n_frames == 4
