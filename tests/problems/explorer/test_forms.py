"""The forms of a scene: link, machine file, lines of Python; and what a hostile link can do."""

import base64
import json
import os
import runpy
import time
import zlib
from dataclasses import replace

import pytest
from click.testing import CliRunner

from orbits import InputError, find
from orbits.errors import MESSAGES
from problems import inerter_hopper
from problems.command.cli import orbits
from problems.command.options import machine_of
from problems.explorer import beginning, scene_of_statement
from problems.explorer.forms import link_of, machine_file, python_lines, scene_of_link
from problems.explorer.scene import LARGEST, DroppedRows
from problems.laws.springs import SAMPLE
from problems.machines import read, search
from tests.problems.explorer.scenes import SCENES, SHORT_ROWS, arguments, given


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


def test_the_machine_file_of_a_runner_finds_its_run(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(machine_file(beginning("runner")), encoding="utf-8")
    done = CliRunner().invoke(orbits, ["find", "--machine", str(path), "--json"])
    run = json.loads(done.output)
    assert run["speed"] == pytest.approx(0.4, rel=1e-12)
    assert run["parameters"]["inertia"] == pytest.approx(5.6540484222, rel=1e-9)  # of two programs
    path.write_text(path.read_text(encoding="utf-8").replace("tune =", "tuned ="), encoding="utf-8")
    with pytest.raises(InputError, match=r"\[find\]: unknown key 'tuned'; did you mean 'tune'"):
        search(read(path), str(path))


@pytest.mark.parametrize("name", ["sphere", "potential", "measured leg", "around", "wheel", "runner"])
def test_python_lines_find_the_same_hop(name, tmp_path, monkeypatch):
    scene = SCENES[name]
    if scene.rows:
        (tmp_path / scene.rows.name).write_text(scene.rows.text, encoding="utf-8")
    path = tmp_path / "lines.py"
    path.write_text(python_lines(scene), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    orbit = runpy.run_path(str(path))["orbit"]
    start = scene.start and dict(zip(scene.start_names, scene.start, strict=True))
    tuned = {"tune": scene.tuned, "at": scene.prescribed} if scene.tuned else {}
    assert orbit.alpha == find(scene.build(), scene.family, start=start, **tuned).alpha


def test_python_lines_of_a_machine_with_fixed_laws(tmp_path):
    scene = beginning("inerter_hopper").with_numbers(inertance=0.3)
    path = tmp_path / "lines.py"
    path.write_text(python_lines(scene), encoding="utf-8")
    assert runpy.run_path(str(path))["orbit"].alpha == find(inerter_hopper(inertance=0.3)).alpha
    with pytest.raises(InputError, match="no machine file"):
        machine_file(scene)


PACKED = base64.urlsafe_b64encode(zlib.compress(b"extension,force\n" * 10)).decode()
BOMB = base64.urlsafe_b64encode(zlib.compress(b"0" * (8 * LARGEST.rows), 9)).decode()
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
    began = time.process_time()
    with pytest.raises(InputError) as error:
        scene_of_link(arguments(query)).build()
    assert len(str(error.value)) <= MESSAGES.longest
    assert time.process_time() - began < 2


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
        DroppedRows("rows.csv", "1" * (LARGEST.rows + 1))


@pytest.mark.parametrize(
    ("stated", "along"),
    [
        ({"spring": "r + beta*r**3", "rest_length": 30.0, "parameters": {"beta": 0.1}}, "beta"),
        ({"si": {"body_mass": 70.0, "foot_mass": 5.0, "stiffness": 2e4, "rest_length": 1.0}}, "stiffness"),
        ({"machine": "juggler"}, "mass_ratio"),
        ({"machine": "wheel"}, "angle"),
        ({"machine": "runner", "rest_length": 4.0}, "speed"),
        ({"machine": "rocker", "parameters": {"inertia_ratio": 2.0}}, "gravity_ratio"),
    ],
)
def test_a_family_is_followed_along_what_changes_the_hop(stated, along):
    assert scene_of_statement(stated).along == along


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"ground": {"mass": 2.0, "stiffness": 5.0}}, r"leave \[ground\] out"),
        ({"spring": "lossy:r", "parameters": {"loss_factor": 0.1}}, "state the mean of its branches"),
        ({"spring": f"table:{SAMPLE}?scale=s", "parameters": {"s": 1.1}}, "leave scale out"),
    ],
)
def test_what_the_page_does_not_show_is_refused(stated, words):
    with pytest.raises(InputError, match=words):
        scene_of_statement(stated)
