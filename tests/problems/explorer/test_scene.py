"""The scene of a page: machines that formulas state, others with their own laws, and the one of the command line."""

from dataclasses import replace

import pytest

from orbits import InputError
from problems import (
    Hopper,
    Juggler,
    alternating_hopper,
    hopper_in_si,
    inerter_hopper,
    rocking_block,
    runner,
    shuttle,
    walker,
)
from problems.command.options import first_scene
from problems.explorer import beginning
from problems.explorer.scene import scene_of_machine
from problems.laws import springs
from tests.problems.explorer.scenes import SHORT_ROWS

MACHINES = [
    Hopper("r + beta*r**3", rest_length=8.0, parameters={"beta": 0.3}),
    Hopper("tanh", "exp(-z/H)", 2.0, 20.0, parameters={"b": 0.1, "H": 90.0}, restitution=0.5),
    Juggler(),
    hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8),
    hopper_in_si(60.0, 3.0, force="b*r**3", stiffness=8000.0, parameters={"b": 1e6}, body_radius=6e6, rest_length=1.0),
]


@pytest.mark.parametrize("machine", MACHINES, ids=repr)
def test_a_machine_that_formulas_state_is_one_on_the_page(machine):
    scene = scene_of_machine(machine)
    assert not scene.fixed_laws
    assert scene.build() == machine


@pytest.mark.parametrize(
    "machine", [inerter_hopper(), Hopper(lambda r: r), Hopper(springs.table(([-9, 0, 4, 9], [-9, 0, 4, 9])))]
)
def test_any_other_machine_keeps_its_laws(machine):
    scene = scene_of_machine(machine)
    assert scene.fixed_laws
    assert scene.build(machine).values == machine.values
    name = next(iter(scene.numbers))
    assert scene.with_numbers(**{name: 1.5}).build(machine).values[name] == 1.5
    with pytest.raises(InputError, match="made in Python"):
        scene.build()


@pytest.mark.parametrize("own", [{}, {"body_mass": 5.0, "stiffness": 2500.0, "in_si": True}])
def test_a_hopper_on_two_feet_made_in_python_has_its_sliders(own):
    machine = alternating_hopper(20.0, 60.0, **own)
    scene = scene_of_machine(machine)
    assert (scene.machine, scene.si, scene.along) == ("alternating-hopper", bool(own), "foot_mass")
    assert scene.build().describe() == machine.describe()
    stiffening = alternating_hopper(spring="r + b*r**3", parameters={"b": 0.1})
    assert scene_of_machine(stiffening).fixed_laws


def test_a_runner_made_in_python_is_tuned_on_the_page():
    machine = runner(0.12, 3.7, 5.7, 5.4, in_si=True, body_mass=2.0, stiffness=1.0, friction=0.7)
    scene = scene_of_machine(machine)
    assert (scene.machine, scene.si, scene.along, scene.tuned) == (
        "runner",
        True,
        "speed",
        ("inertia", "hip_stiffness"),
    )
    assert scene.build().values == machine.values
    with pytest.raises(InputError, match="with plain springs"):
        scene_of_machine(runner(spring="r + b*r**3", parameters={"b": 0.1}))


def test_the_command_lines_machine_is_what_the_page_begins_with(tmp_path):
    assert first_scene(2) == replace(beginning("hopper"), family=2)
    scene = first_scene(machine="juggler", spring="sinh", settings=("b=0.4",), mass_ratio=2.0)
    assert scene.build() == Juggler("sinh", mass_ratio=2.0, parameters={"b": 0.4})
    (tmp_path / "rows.csv").write_text(SHORT_ROWS.text, encoding="utf-8")
    assert first_scene(machine=None, spring=f"table:{tmp_path}/rows.csv").rows == SHORT_ROWS
    assert first_scene(3, machine="wheel") == replace(beginning("wheel"), family=3)
    small = first_scene(machine="rocker", settings=("gravity_ratio=0.4", "share=0.5"))
    assert small.build().describe() == rocking_block(gravity_ratio=0.4, share=0.5).describe()
    (tmp_path / "machine.toml").write_text(
        'machine = "shuttle"\n[si]\ninertia = 0.5\nbody_inertia = 0.5\nstiffness = 20.0\nangle = 0.3', encoding="utf-8"
    )
    balanced = first_scene(machine=f"{tmp_path}/machine.toml").build()
    assert balanced.describe() == shuttle(0.5, 0.5, 20.0, 0.3).describe()
    assert first_scene(machine="runner") == beginning("runner")
    for refused in (lambda: first_scene(machine="walker"), lambda: scene_of_machine(walker())):
        with pytest.raises(InputError, match=r"call find\(tune=\)"):
            refused()
    with pytest.raises(InputError, match="without a value"):
        first_scene(machine=None, spring="r + c*r**3")
