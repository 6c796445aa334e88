"""Where families of walks begin, against numbers that another program computed with thirty digits."""

import numpy as np
import pytest

from orbits import InputError, NoOrbit, find, find_branch_points, follow_branch_points
from orbits.periodic.small_steps import SmallSteps, small_steps
from problems import walker


@pytest.mark.parametrize(
    ("design", "numbers"),
    [
        (
            {"leg_mass": 0.1, "leg_centre": 1.0, "leg_inertia": 0.0},
            {"T": 2.2804328747582771924, "J": 0.37651441529673177031, "rate": 2.9780492212091721879,
             "D": 0.37668375396845587, "k": 0.4},
        ),
        (
            {"leg_mass": 0.05, "leg_centre": 0.5, "leg_inertia": 0.05 / 12},
            {"T": 2.185417019379132257, "J": 0.45260913211273761187, "rate": 2.5601496206182641272,
             "D": 0.37082094392531044, "k": 0.475},
        ),
    ],
)  # fmt: skip
def test_families_begin_at_known_designs(design, numbers):
    machine = walker(
        **design, torso_height=0.0, torso_inertia=round(numbers["J"], 1), hip_stiffness=numbers["k"] + 0.01
    )
    steps = SmallSteps(machine.model, machine.values)
    found = [steps.solved(near, ("torso_inertia", "hip_stiffness")) for near in steps.guesses()]
    step = min((each for each in found if each), key=lambda each: abs(each.tuned["torso_inertia"] - numbers["J"]))
    assert step.flight == pytest.approx(numbers["T"], abs=1e-11)
    assert step.contact == pytest.approx(numbers["D"], abs=1e-11)
    assert [*step.tuned.values()] == pytest.approx([numbers["J"], numbers["k"]], abs=1e-11)
    places = machine.model.launch_places
    assert step.launch[places["alpha"]] == pytest.approx(numbers["rate"], abs=1e-10)


def test_the_double_stance_of_a_small_step_has_its_closed_form():
    """tan(w D) = w phi/phi', with w^2 = 2 k/J, where the torso's centre of mass is the hip."""
    machine = walker(leg_mass=0.05, leg_centre=0.5, leg_inertia=0.0, torso_inertia=0.4, hip_stiffness=0.5)
    steps = SmallSteps(machine.model, machine.values)
    step = steps.solved(steps.guesses()[0], ("torso_inertia", "hip_stiffness"))
    places, frequency = (
        machine.model.launch_places,
        np.sqrt(2 * step.tuned["hip_stiffness"] / step.tuned["torso_inertia"]),
    )
    angle, rate = (step.launch[places[name]] for name in ("liftoff", "alpha"))
    assert angle == pytest.approx(1 / (2 * step.tuned["hip_stiffness"]), abs=1e-12)
    assert np.tan(frequency * step.contact) == pytest.approx(frequency * angle / rate, abs=1e-11)


def test_the_nearest_and_then_the_fastest_small_steps_come_first():
    machine = walker(leg_mass=0.1, leg_centre=1.0, leg_inertia=0.0, torso_inertia=0.38, hip_stiffness=0.4)
    starts = next(small_steps(machine.model, machine.values, ("torso_inertia", "hip_stiffness")))
    assert starts[0]["duration"] == pytest.approx(2.2804328747582771924, abs=1e-11)
    assert len(starts) > 1
    assert all(start["angle"] == pytest.approx(-0.02) for start in starts)


def test_walks_branch_off_rest_at_known_designs():
    """Against thirty digits of another program, and a walk that is found from there."""
    machine = walker(leg_mass=0.1, leg_centre=1.0, leg_inertia=0.0, torso_inertia=0.5, hip_stiffness=0.5)
    (point,) = find_branch_points(machine, {"torso_inertia": (0.3, 0.45), "hip_stiffness": (0.3, 0.5)})
    assert [*point.values.values()] == pytest.approx([0.37651441529673177031, 0.4], abs=1e-11)
    assert point.step == pytest.approx(2.0, abs=1e-8)
    assert max(point.errors.values()) < 1e-11
    walk = find(point.machine, start=point.start(0.02), tune=("torso_inertia", "hip_stiffness"), at={"angle": 0.1})
    assert walk.admissible
    assert walk.step == pytest.approx(2 * np.sin(0.1), abs=1e-12)
    with pytest.raises(InputError, match="at 0 every design is at rest, so no walk"):
        point.start(0)
    with pytest.raises(InputError, match="a walk begins at this point"):
        follow_branch_points(point, "leg_mass", [0.11])
    with pytest.raises(NoOrbit, match="no walk of a walker that begins with torso_inertia from"):
        find_branch_points(machine, {"torso_inertia": (0.1, 0.2), "hip_stiffness": (0.3, 0.35)})
