"""Motions of optimal control: called, tabled and saved, against closed forms and after their files."""

import json

import numpy as np
import pytest
from carts import CART, HALF

from orbits import Control, InputError, steer
from orbits.control import Guess, Input, Stage
from orbits.model import Phase


def test_states_inputs_and_costs_in_closed_form(steered_cart):
    t = np.linspace(0, 1, 21).reshape(3, 7)
    assert steered_cart.states == ("x", "v")
    assert steered_cart(t).shape == (3, 7, 2)
    assert steered_cart(t)[..., 0] == pytest.approx(t**2 * (3 - 2 * t), abs=1e-11)
    assert steered_cart.inputs_at(t)[..., 0] == pytest.approx(6 - 12 * t, abs=1e-9)
    assert steered_cart.inputs_at(t).shape == (3, 7, 1)
    table = steered_cart.table(t.ravel())
    assert table["running cost"] == pytest.approx(36 * t.ravel() - 72 * t.ravel() ** 2 + 48 * t.ravel() ** 3, abs=1e-9)
    assert list(table) == ["time", "stage", "x", "v", "f", "running cost"]
    assert steered_cart.table()["running cost"][-1] == pytest.approx(steered_cart.cost, abs=1e-12)
    assert steered_cart(0.25).shape == (2,)
    assert steered_cart([]).shape == (0, 2)


@pytest.mark.parametrize("t", [-0.1, 1.1, np.nan, "a", None, [0.5, [0.2]]])
def test_times_lie_within_the_motion(steered_cart, t):
    for ask in (steered_cart, steered_cart.inputs_at, *([] if t is None else [steered_cart.table])):
        with pytest.raises(InputError, match="times lie between 0 and 1"):
            ask(t)


def test_stages_of_other_states(steered_relay, steered_cart):
    """A call gives what all stages have, in the order of the first; an input that a stage does not have is 0."""
    t = np.linspace(0, 1, 20)
    assert steered_relay.states == ("x", "v")
    assert steered_relay(t) == pytest.approx(steered_cart(t), abs=1e-9)
    assert steered_relay.inputs == ("f", "g")
    assert steered_relay.inputs_at([0.2, HALF, 0.7])[:, 1] == pytest.approx([0, 1, 1])
    assert steered_relay.legs[1].path(HALF)[2] == pytest.approx(HALF)  # the heat of the sled is in its own leg
    assert steered_relay.table(t)["stage"].tolist() == ["cart"] * 10 + ["sled"] * 10
    assert steered_relay.table()["running cost"][-1] == pytest.approx(12, abs=1e-8)


def test_files(steered_relay, steered_cart, tmp_path):
    """All comes back to the last bit, also into a solve."""
    for one in (steered_relay, steered_cart):
        again = Control.load(one.save(tmp_path / "control.json"))
        assert again.save(tmp_path / "again.json").read_bytes() == (tmp_path / "control.json").read_bytes()
        t = np.linspace(0, 1, 33)
        assert np.array_equal(again(t), one(t))
        assert np.array_equal(again.inputs_at(t), one.inputs_at(t))
        assert str(again) == str(one)
        assert np.isnan(again.coarseness)
    ends = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - 1, x[1]]}
    stage = Stage(CART, 4, (1.0, 1.0), {"f": Input(degree=1)}, **ends, running=lambda x, p, q: p["f"] ** 2)
    assert steer([stage], guess=again).cost == pytest.approx(12, abs=1e-9)


def test_a_stage_without_inputs_comes_back(tmp_path):
    fall = Phase("fall", ("y", "v"), lambda x, p, q: [x[1], -1.0])
    stage = Stage(fall, 2, (0.1, 9.0), start=lambda x, before, p: [x[0] - 2, x[1]], end=lambda x, p: [x[0]])
    found = steer([stage], guess=[Guess(1.5, lambda t: [2 - t, -t])])
    assert found.end == pytest.approx(2, abs=1e-9)
    again = Control.load(found.save(tmp_path / "fall.json"))
    assert np.array_equal(again([0.3, 1.0]), found([0.3, 1.0]))
    assert again.inputs_at([0.3, 1.0]).shape == (2, 0)
    assert len(found.plot().figure.axes) == 1  # no panel for inputs


def changed(document, *path_and_value):
    """A document with another value at a place."""
    *path, last, value = path_and_value
    inside = document
    for key in path:
        inside = inside[key]
    inside[last] = value
    return document


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (("format", "persistent-orbits orbit 1"), "expected 'persistent-orbits control 1'"),
        (("cost", "12"), "cost = '12'; it must be a finite number"),
        (("cost", 10**400), "cost"),
        (("legs", []), "its stages do not follow"),
        (("legs", 0, "start", 0.5), "its stages do not follow"),
        (("legs", 0, "path", "times", [0.0, 0.5]), "its motion is damaged"),
        (("legs", 0, "path", "times", [0.0]), "its motion is damaged"),
        (("legs", 0, "path", "coefficients", [[["a"]]]), "not an array of finite numbers"),
        (("legs", 0, "path", "coefficients", None), "its motion is damaged"),
        (("legs", 0, "path", "names", ["x", "v", "w"]), "its stage 'cart' is damaged"),
        (("legs", 0, "states", ["x"] * 9), "its stage 'cart' is damaged"),
        (("legs", 0, "states", []), "its stage 'cart' is damaged"),
        (("legs", 0, "inputs", "names", ["f", "g"]), "its motion is damaged"),
        (("units", {"cost": "J", "time": "s"}), "its units do not fit"),
        (("bare", {}), "its units do not fit"),
        (("parameters", {"a": None}), "parameters.a = None"),
    ],
)
@pytest.mark.usefixtures("any_digest")
def test_a_damaged_file_is_refused(steered_cart, tmp_path, damage, words):
    document = json.loads(steered_cart.save(tmp_path / "control.json").read_text())
    (tmp_path / "control.json").write_text(json.dumps(changed(document, *damage)))
    with pytest.raises(InputError, match=words) as error:
        Control.load(tmp_path / "control.json")
    assert "is not a saved control" in str(error.value)


@pytest.mark.parametrize("text", ["", "[]", "null", "{", "[" * 100000, '{"format": 1}'])
def test_what_is_no_file_of_a_control(tmp_path, text):
    (tmp_path / "control.json").write_text(text)
    with pytest.raises(InputError, match="is not a saved control"):
        Control.load(tmp_path / "control.json")
