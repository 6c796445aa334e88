"""Fields of the page: what changes a scene, and what is no scene."""

import numpy as np
import pytest

from orbits import InputError
from orbits.errors import MESSAGES
from problems import rimless_wheel
from problems.explorer import beginning
from problems.explorer.dials import dials_of
from problems.explorer.fields import changed, shown_fields
from tests.problems.explorer.scenes import SCENES


@pytest.mark.parametrize(
    ("act", "told"),
    [
        ("number", {"name": "gamma", "value": 1.0}),
        ("number", {"name": "beta", "value": "1"}),
        ("number", {"name": "beta", "value": None}),
        ("number", {"name": ["beta"], "value": 1.0}),
        ("number", {"name": "beta", "value": float("nan")}),
        ("spring", {"value": "table:/etc/passwd"}),
        ("spring", {"value": 3}),
        ("spring", {}),
        ("gravity", {"value": "r"}),
        ("machine", {"value": "rocket"}),
        ("machine", {"value": "given"}),
        ("family", {"value": "1"}),
        ("family", {"value": 0}),
        ("family", {"value": True}),
        ("rows", {"name": 1, "text": "x"}),
        ("rows", {"name": "x", "text": None}),
        ("branch", {"value": "loading"}),
        ("launch", {"value": -1.0}),
        ("along", {"value": "__class__.x"}),
        ("along", {"value": np.nan}),
        ("__class__", {}),
        ("x" * 10_000, {}),
    ],
    ids=lambda value: str(value)[:40],
)
def test_fields_take_nothing_that_is_no_scene(act, told):
    with pytest.raises(InputError) as error:
        changed(SCENES["cubic"], act, told).build()
    assert len(str(error.value)) <= MESSAGES.longest


@pytest.mark.parametrize(
    ("act", "value", "words"),
    [
        ("gravity", "exp(-z/10)", "need a machine that hops"),
        ("rows", None, "need a machine that hops"),
        ("floating", True, "all of its numbers"),
        ("spring", "r + b*r**3", "no 'stiffness': write it with that"),
        ("number", 7.5, "a whole number, at least 3"),
    ],
)
def test_what_no_machine_that_steps_has_is_refused(act, value, words):
    change = {"name": "spokes", "value": value} if act != "rows" else {"name": "x.csv", "text": "extension,force\n"}
    with pytest.raises(InputError, match=words):
        changed(SCENES["wheel"], act, change).build()


def test_a_run_has_a_speed_above_0_and_its_tuned_numbers_are_no_sliders():
    runner = beginning("runner")
    with pytest.raises(InputError, match="the speed of a run must be above 0"):
        changed(runner, "number", {"name": "speed", "value": 0.0})
    fields = shown_fields(runner, dials_of(runner.build(), runner), False)
    assert [dial["name"] for dial in fields["dials"]] == ["foot_mass", "rest_length", "speed"]
    assert fields["alongs"] == [("", "none"), ("speed", "speed")]  # along another one a third would have to be tuned
    quadratic = changed(runner, "spring", {"value": "r + b*r**3"})
    assert quadratic.build().values["b"] == quadratic.numbers["b"]
    assert "stiffness" not in quadratic.build().values


def test_small_angles_and_back():
    scene = changed(beginning("wheel"), "floating", {"value": True})
    assert scene.build().describe() == rimless_wheel(inertia_ratio=1.0, gravity_ratio=0.5).describe()
    assert (scene.along, shown_fields(scene, [], False)["scene"]["floating"]) == ("", True)
    assert changed(scene, "floating", {"value": False}).numbers == beginning("wheel").numbers


def test_a_formula_brings_its_parameters_and_takes_the_old_ones_away():
    scene = changed(SCENES["cubic"], "spring", {"value": "r + beta*r**3 + delta*r**5"})
    assert scene.numbers == {"mass_ratio": 1.0, "rest_length": 8.0, "beta": 0.3, "delta": 0.1}
    scene = changed(scene, "spring", {"value": "tanh"})
    assert scene.numbers == {"mass_ratio": 1.0, "rest_length": 8.0, "b": 0.2}
    assert scene.along == ""
    scene = changed(changed(scene, "floating", {"value": True}), "gravity", {"value": "inverse_square"})
    assert scene.numbers["rest_length"] == 8.0  # gravity that varies with height asks for one
