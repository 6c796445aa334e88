"""A scene and its forms: link, machine file, lines of Python; what a hostile link can do; the ends of sliders."""

import base64
import os
import runpy
import time
import zlib
from dataclasses import replace
from urllib.parse import parse_qs

import pytest

from orbits import InputError, find
from orbits.errors import LONGEST_MESSAGE
from problems import Hopper, Juggler, explorer, hopper_in_si, inerter_hopper
from problems.command.options import first_scene, machine_of
from problems.explorer.dials import dials_of
from problems.explorer.fields import changed, shown_fields
from problems.explorer.forms import (
    link_of,
    machine_file,
    python_lines,
    scene_of_link,
    scene_of_statement,
)
from problems.explorer.scene import LARGEST_ROWS, DroppedRows, Scene, beginning, scene_of_machine
from problems.laws import springs
from problems.machines.files import read

ROWS = DroppedRows("leg spring.csv", springs.SAMPLE.read_text(encoding="utf-8"), "mean")
SHORT_ROWS = DroppedRows("rows.csv", "extension,force\n" + "\n".join(f"{r},{r + r**3 / 50}" for r in range(-20, 21)))
IN_SI = beginning("hopper", True)
SCENES = {
    "cubic": beginning("hopper"),
    "juggler": beginning("juggler"),
    "in SI": IN_SI,
    "linear in SI": beginning("juggler", True),
    "named": Scene(spring="tanh", numbers={"b": 0.1}, family=2).complete(),
    "potential": Scene(spring="potential:r**2/2 + c*r**4", numbers={"c": 0.02, "rest_length": 9.0}).complete(),
    "gravity": Scene(gravity="exp(-z/H)", numbers={"H": 90.0}).complete(),
    "sphere": replace(IN_SI, gravity="inverse_square", numbers={**IN_SI.numbers, "R": 1e4}).complete(),
    "restitution": replace(
        beginning("hopper"), numbers={**beginning("hopper").numbers, "restitution": 0.25}
    ).complete(),
    "rows": Scene(rows=SHORT_ROWS, along="mass_ratio").complete(),
    "measured leg": replace(IN_SI, rows=ROWS).complete(),
    "around": replace(beginning("hopper"), launch=2.5, along="rest_length", start=(0.8290513811936318, 2.94, 2.9)),
}
given = pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)


def arguments(query: str) -> dict[str, list[bytes]]:
    """A query as a server has it."""
    return {name: [each.encode() for each in values] for name, values in parse_qs(query).items()}


@given
def test_a_link_brings_the_scene_back(scene):
    query, whole = link_of(scene)
    assert whole
    assert scene_of_link(arguments(query)) == scene


@given
def test_a_machine_file_makes_the_same_machine(scene, tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(machine_file(scene), encoding="utf-8")
    if scene.rows:
        (tmp_path / scene.rows.name).write_text(scene.rows.text, encoding="utf-8")
    assert machine_of(machine=str(path)).describe() == scene.build().describe()
    again = scene_of_statement(read(path))
    assert again.complete().build().describe() == scene.build().describe()


@given
def test_python_lines_find_the_same_hop(scene, tmp_path, monkeypatch):
    if scene.rows:
        (tmp_path / scene.rows.name).write_text(scene.rows.text, encoding="utf-8")
    path = tmp_path / "lines.py"
    path.write_text(python_lines(scene), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    orbit = runpy.run_path(str(path))["orbit"]
    start = scene.start and dict(zip(("liftoff", "alpha", "duration"), scene.start, strict=True))
    assert orbit.alpha == find(scene.build(), scene.family, start=start).alpha


def test_python_lines_of_a_machine_with_fixed_laws(tmp_path):
    scene = beginning("inerter_hopper").with_numbers(inertance=0.3)
    path = tmp_path / "lines.py"
    path.write_text(python_lines(scene), encoding="utf-8")
    assert runpy.run_path(str(path))["orbit"].alpha == find(inerter_hopper(inertance=0.3)).alpha
    with pytest.raises(InputError, match="no machine file"):
        machine_file(scene)


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


PACKED = base64.urlsafe_b64encode(zlib.compress(b"extension,force\n" * 10)).decode()
BOMB = base64.urlsafe_b64encode(zlib.compress(b"0" * (8 * LARGEST_ROWS), 9)).decode()
HOSTILE = {
    "a file": "spring=table:/etc/passwd",
    "a file with blanks": "spring=%20table%20:/etc/passwd",
    "a file as gravity": "gravity=table:/etc/passwd",
    "a file in capitals": "spring=TABLE:/etc/passwd",
    "a file as potential": "spring=potential:table:/etc/passwd",
    "a call": "spring=__import__('os').system('true')",
    "an attribute": "spring=r.real",
    "unknown word": "machine=hopper&over=1",
    "unknown machine": "machine=rocket",
    "a class": "machine=__class__",
    "not a number": "spring=b*r&p.b=nan",
    "infinite": "spring=b*r&p.b=1e999",
    "no number": "spring=b*r&p.b=x",
    "no name": "p.a-b=1",
    "a dunder beside letters": "p.é=1",
    "twice": "family=1&family=2",
    "family 0": "family=0",
    "no whole family": "family=1.5",
    "huge family": "family=1000000",
    "infinite family": "family=inf",
    "short start": "start=1,2",
    "no start": "start=1,nan,2",
    "launch below": "launch=-1",
    "deep": "spring=" + "(" * 900,
    "long": "spring=" + "r%2B" * 4000 + "r",
    "many": "&".join(f"p.x{i}=1" for i in range(60)),
    "many in the formula": "spring=r" + "".join(f"%2Bx{i}" for i in range(60)),
    "bomb": f"rows={BOMB}",
    "cut": f"rows={PACKED[:20]}",
    "no base64": "rows=%21%21",
    "no zip": "rows=" + base64.urlsafe_b64encode(b"1,2").decode(),
    "unknown branch": f"rows={PACKED}&branch=up",
    "noise below": f"rows={PACKED}&noise=-1",
}


@pytest.mark.parametrize("query", HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_link_is_refused(query, monkeypatch):
    monkeypatch.setattr("builtins.open", lambda *_, **__: pytest.fail("a file is read"))
    monkeypatch.setattr(os, "system", lambda *_: pytest.fail("a command is run"))
    began = time.monotonic()
    with pytest.raises(InputError) as error:
        scene_of_link(arguments(query)).build()
    assert len(str(error.value)) <= LONGEST_MESSAGE
    assert time.monotonic() - began < 2


def test_rows_in_a_link_have_no_say_in_where_files_are(tmp_path):
    query, _ = link_of(replace(SCENES["rows"], rows=replace(SHORT_ROWS, name="../../etc/cron.d/x y")))
    scene = scene_of_link(arguments(query))
    assert scene.rows.name == "_.._etc_cron.d_x_y"
    assert find(scene.build()).alpha == find(SCENES["rows"].build()).alpha


def test_rows_that_are_too_many_stay_out_of_the_link():
    rows = "extension,force\n" + "\n".join(f"{r / 3e3 - 2!r},{(r * 7919) % 6007 / 1e5!r}" for r in range(9000))
    query, whole = link_of(replace(SCENES["rows"], rows=DroppedRows("rows.csv", rows)))
    assert not whole
    assert len(query) < 500
    with pytest.raises(InputError, match="at most"):
        DroppedRows("rows.csv", "1" * (LARGEST_ROWS + 1))


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
        ("__class__", {}),
        ("x" * 10_000, {}),
    ],
    ids=lambda value: str(value)[:40],
)
def test_fields_take_nothing_that_is_no_scene(act, told):
    with pytest.raises(InputError) as error:
        changed(SCENES["cubic"], act, told).build()
    assert len(str(error.value)) <= LONGEST_MESSAGE


def test_a_formula_brings_its_parameters_and_takes_the_old_ones_away():
    scene = changed(SCENES["cubic"], "spring", {"value": "r + beta*r**3 + delta*r**5"})
    assert scene.numbers == {"mass_ratio": 1.0, "rest_length": 8.0, "beta": 0.3, "delta": 0.1}
    scene = changed(scene, "spring", {"value": "tanh"})
    assert scene.numbers == {"mass_ratio": 1.0, "rest_length": 8.0, "b": 0.2}
    assert scene.along == ""
    scene = changed(changed(scene, "floating", {"value": True}), "gravity", {"value": "inverse_square"})
    assert scene.numbers["rest_length"] == 8.0  # gravity that varies with height asks for one


@given
def test_sliders_end_where_there_is_no_such_machine(scene):
    machine = scene.build()
    dials = dials_of(machine, scene)
    assert {dial.name for dial in dials} - {"restitution"} <= {*scene.numbers}
    for dial in dials[:-1]:
        assert dial.low <= dial.value <= dial.high
        assert not dial.factors or dial.low > 0
        for end in (dial.low, dial.high):
            machine.with_values(**{dial.name: end})
    shown = {dial["name"]: dial for dial in shown_fields(scene.with_numbers(mass_ratio=1e6), dials, False)["dials"]}
    assert "mass_ratio" not in shown or shown["mass_ratio"]["high"] == 1e6


def test_scales_go_by_factors_and_have_their_units():
    dials = {dial.name: dial for dial in dials_of(IN_SI.build(), IN_SI)}
    assert [name for name, dial in dials.items() if not dial.factors] == ["restitution"]
    assert (dials["k"].low, dials["k"].high, dials["k"].unit) == (800.0, 80000.0, "N/m")
    cubic = {dial.name: dial for dial in dials_of(SCENES["cubic"].build(), SCENES["cubic"])}
    assert not cubic["beta"].factors
    assert cubic["beta"].low < 0 < 1 < cubic["beta"].high


def test_the_command_lines_machine_is_what_the_page_begins_with(tmp_path):
    assert first_scene(2) == replace(beginning("hopper"), family=2)
    scene = first_scene(machine="juggler", spring="sinh", settings=("b=0.4",), mass_ratio=2.0)
    assert scene.build() == Juggler("sinh", mass_ratio=2.0, parameters={"b": 0.4})
    (tmp_path / "rows.csv").write_text(SHORT_ROWS.text, encoding="utf-8")
    assert first_scene(machine=None, spring=f"table:{tmp_path}/rows.csv").rows == SHORT_ROWS
    with pytest.raises(InputError, match="without a value"):
        first_scene(machine=None, spring="r + c*r**3")


def test_the_room_is_documented():
    assert explorer.__doc__


@pytest.mark.parametrize(
    ("stated", "along"),
    [
        ({"spring": "r + beta*r**3", "rest_length": 30.0, "parameters": {"beta": 0.1}}, "beta"),
        ({"si": {"body_mass": 70.0, "foot_mass": 5.0, "stiffness": 2e4, "rest_length": 1.0}}, "stiffness"),
        ({"machine": "juggler"}, "mass_ratio"),
    ],
)
def test_a_family_is_followed_along_what_changes_the_hop(stated, along):
    assert scene_of_statement(stated).along == along
