"""Families that are interrupted and resumed: the curve is that of an unbroken run."""

import subprocess
import sys
from importlib import import_module
from importlib.metadata import PackageNotFoundError

import numpy as np
import pytest
from browser import wait_for
from families import GOLDEN

from orbits import Family, InputError, follow, follow_branch, follow_event
from orbits.continuation import checkpoint
from problems import Hopper


@pytest.mark.slow
def test_a_killed_run_is_resumed(tmp_path):
    """Every finished point is on disk; resumed, the curve is that of an uninterrupted run."""
    path = tmp_path / "family.jsonl"
    code = (
        "from orbits import follow; from problems import Hopper\n"
        f"follow(Hopper('cubic'), 'beta', 5.0, 0.0, longest=0.002, output={str(path)!r})"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    wait_for(lambda: path.exists() and path.read_text().count("\n") > 20, "20 points are on disk")
    process.kill()
    process.wait()
    broken = Family.load(path)
    assert 15 < len(broken) < 500
    assert broken.end.kind == "interrupted"
    rest = follow(Hopper("cubic"), "beta", 5.0, 0.0, at=[2.0], resume=broken, output=path)
    assert rest.points[: len(broken) - 1] == broken.points[:-1]
    assert rest.at(2.0)[0].alpha == pytest.approx(GOLDEN[2.0], rel=1e-12)
    assert rest.end.kind == "reached"
    assert Family.load(path) == rest


@pytest.mark.slow
def test_another_machine_cannot_resume(softening_family):
    with pytest.raises(InputError, match="another machine"):
        follow(Hopper("cubic", rest_length=31.0), "beta", -0.02, 0.0, resume=softening_family)


@pytest.mark.slow
def test_a_resumed_family_has_each_event_once(softening_family, tmp_path):
    """Wherever the file was cut."""
    lines = softening_family.save(tmp_path / "whole.jsonl").read_text().splitlines(keepends=True)
    fold = next(i for i, line in enumerate(lines) if '"fold"' in line)
    for count in (fold, fold + 1, fold + 2):
        path = tmp_path / "cut.jsonl"
        path.write_text("".join(lines[:count]))
        resumed = follow(
            Hopper("cubic", rest_length=30.0), "beta", -0.02, 0.0, resume=Family.load(path), output=path, most=12
        )
        assert [event.kind for event in resumed.events].count("fold") == 1
        assert Family.load(path) == resumed


def test_what_cannot_be_resumed_or_watched_is_said(softening_family):
    half = follow(Hopper("cubic"), "beta", 1.0, 0.0, most=5)
    with pytest.raises(InputError, match="number 1, by the method 'relative'"):
        follow(Hopper("cubic"), "beta", 1.0, 0.0, family=2, resume=half)
    assert follow(Hopper("cubic"), "beta", 1.0, resume=half)[-1].value == 1.0  # from where it began
    done = follow(Hopper("cubic"), "beta", 1.0, 0.0, longest=0.2)
    for question, message in (
        ({"stop": 1.0, "resume": done}, "has reached beta = 1 already"),
        ({"stop": 0.5, "resume": done}, "not between 0 and 0.5"),
        ({"stop": 1.0, "resume": "x"}, "a family of `follow`"),
        ({"stop": 1.0, "watch": {"fold": lambda orbit: 1.0}}, "with a name that nothing else has"),
        ({"stop": 1.0, "watch": [abs]}, "a mapping of names"),
        ({"stop": 1.0, "at": 0.5}, "a list of values"),
        ({"stop": 1.0, "watch": {"word": lambda orbit: "x"}, "most": 1}, "watch 'word' returns 'x'"),
    ):
        with pytest.raises(InputError, match=message):
            follow(Hopper("cubic"), "beta", start=0.0, **question)
    with pytest.raises(InputError, match="rename it"):
        follow(Hopper("r + alpha*r**3", parameters={"alpha": 0.1}), "alpha", 1.0)
    with pytest.raises(InputError, match="it must be the name of a parameter"):
        follow(Hopper("cubic"), ["beta"], 1.0)


def test_a_file_that_cannot_be_written_is_refused_before_the_run(tmp_path, monkeypatch):
    machine = Hopper("cubic")
    family = follow(machine, "beta", 1.0, 0.0, most=2)
    for module, name in (("follow", "begin_run"), ("follow", "FamilyProblem"), ("follow_event", "run_along_event")):
        monkeypatch.delattr(import_module(f"orbits.continuation.{module}"), name)
    for name, reason in (("missing/x.jsonl", "there is no folder"), ("x.txt", "its name must end in .jsonl")):
        path = tmp_path / name
        with pytest.raises(InputError, match=reason):
            follow(machine, "beta", 1.0, 0.0, output=path)
        with pytest.raises(InputError, match=reason):
            follow_branch(machine, family[0], "beta", 1.0, output=path)
        with pytest.raises(InputError, match=reason):
            follow_event(family, "fold", "mass_ratio", 2.0, output=path)


def test_a_family_of_sources_that_are_not_installed(monkeypatch):
    def of_installed(name):
        if name == "persistent-orbits":
            raise PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr("importlib.metadata.version", of_installed)
    versions = checkpoint.versions.__wrapped__()
    assert list(versions) == ["persistent-orbits", "casadi", "numpy", "python"]
    assert versions["persistent-orbits"] == "unknown"


@pytest.mark.parametrize("stop", [0.4, 0.1])
def test_progress_is_the_share_of_the_way(stop):
    """From a value that is not 0, in either direction: from 0 to 1, with each point as far as it lies."""
    shares = list[float]()
    family = follow(Hopper("cubic", rest_length=9.0), "beta", stop, start=0.2, progress=shares.append)
    values = np.array([point.value for point in family.points])
    assert shares == pytest.approx((values - 0.2) / (stop - 0.2), abs=1e-12)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
