"""`orbits sweep`: what it prints and writes, how it goes on, and what it refuses."""

import json
import os
import shlex
import signal
import sqlite3
import subprocess
import sys

import numpy as np
import pytest

from orbits import Sweep, find
from problems import Hopper

CUBIC = "sweep --spring 'r + beta*r**3'"


def test_members_are_what_find_finds(orbits):
    done = orbits(
        f"{CUBIC} --over beta=0:1 --over mass_ratio=0.1:10:log --samples 7 --seed 3 --quantities period --json"
    )
    assert done.code == 0
    document = done.document
    assert document["parameters"] == ["beta", "mass_ratio"]
    assert document["count"] == 7
    assert document["status"] == {"certified": 7, "inadmissible": 0, "no orbit": 0, "failed": 0}
    for i, member in enumerate(document["members"]):
        assert member["index"] == i
        orbit = find(Hopper("cubic", mass_ratio=member["mass_ratio"], parameters={"beta": member["beta"]}))
        assert member["alpha"] == pytest.approx(orbit.alpha, rel=1e-13)
        assert member["period"] == pytest.approx(orbit.period, rel=1e-12)


def test_two_runs_print_the_same_bytes(orbits):
    command = f"{CUBIC} --over beta=0:1 --samples 300 --json"
    first = orbits(command)
    assert first.out == orbits(command).out == orbits(f"{command} --workers 2").out


def test_values_distributions_and_tables(orbits, tmp_path):
    values = orbits(f"{CUBIC} --over beta=0.1,0.2 --family 1,2 --json").document
    assert [(m["beta"], m["family"]) for m in values["members"]] == [(0.1, 1), (0.1, 2), (0.2, 1), (0.2, 2)]
    drawn = orbits(f"{CUBIC} --over 'beta=norm(0.5,0.01)' --samples 64 --json").document
    assert np.mean([member["beta"] for member in drawn["members"]]) == pytest.approx(0.5, abs=1e-3)
    table = tmp_path / "designs.csv"
    table.write_text("beta,mass_ratio\n0.3,1\n0.4,2\n", encoding="utf-8")
    read = orbits(f"{CUBIC} --from {shlex.quote(str(table))} --json").document
    assert [(m["beta"], m["mass_ratio"]) for m in read["members"]] == [(0.3, 1.0), (0.4, 2.0)]


def test_files_are_written(orbits, tmp_path):
    table, figure = tmp_path / "members.csv", tmp_path / "members.png"
    done = orbits(f"{CUBIC} --over beta=0:1 --samples 20 --output {table} --plot {figure}")
    assert done.code == 0
    assert "20 certified" in done.out
    assert len(table.read_text(encoding="utf-8").splitlines()) == 21
    assert figure.stat().st_size > 5000


def test_the_exit_code_says_whether_any_member_hops(orbits):
    assert orbits(f"{CUBIC} --over beta=0.1,-0.2").code == 0
    assert orbits(f"{CUBIC} --over beta=-0.3,-0.2").code == 1


def test_a_store_is_refused_without_resume_and_gone_on_with(orbits, tmp_path):
    store = tmp_path / "study.db"
    command = f"{CUBIC} --over beta=0:1 --samples 20 --store {store}"
    assert orbits(f"{command} --resume").code == 0
    again = orbits(command)
    assert again.code == 2
    assert "exists" in again.err
    assert orbits(f"{command} --resume --json").document["count"] == 20
    other = orbits(f"{CUBIC} --over beta=0:2 --samples 20 --store {store} --resume")
    assert other.code == 2
    assert "another question" in other.err
    assert len(Sweep.load(store)) == 20


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("", "--over NAME=RANGE"),
        ("--over beta", "NAME=LOW:HIGH"),
        ("--over beta=1:2:3", "NAME=LOW:HIGH"),
        ("--over beta=1:x", "--over '1:x'"),
        ("--over beta=1:0", "low < high"),
        ("--over beta=0:1:log", "above 0"),
        ("--over beta=0:1 --over beta=1:2", "twice"),
        ("--over 'beta=norm(1,0)'", "above 0"),
        ("--over gamma=0:1 --set beta=0.1", "gamma"),
        ("--over beta=0:1 --samples 0", "samples = 0"),
        ("--over beta=0:1 --sampling halton", "halton"),
        ("--over beta=0:1 --family 0", "family = 0"),
        ("--over beta=0:1 --family a", "--family 'a'"),
        ("--over beta=0:1 --quantities perod", "perod"),
        ("--over beta=0:1 --resume", "--store FILE"),
        ("--over beta=0:1 --from designs.csv", "--over NAME=RANGE"),
        ("--from nothing.csv", "no table of designs"),
        ("--over mass_ratio=-1:1 --set beta=0.1", "mass_ratio"),
        ("--over 'mass_ratio=norm(1,1)' --set beta=0.1", "mass_ratio"),
        ("--over beta=0:1 --output members.xyz", "needs an ending"),
        ("--over beta=0:1 --store /nowhere/study.db --resume", "no folder"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(orbits, options, said):
    done = orbits(f"{CUBIC} {options}")
    assert (done.code, done.out) == (2, "")
    assert said in done.err
    assert len(done.err.splitlines()) == 1


@pytest.mark.slow
def test_a_sweep_that_is_killed_again_and_again_ends_with_the_unbroken_answer(tmp_path):
    """Killed at random: nothing that was acknowledged is lost, and the answer is that of one run to the last bit."""
    store, generator = tmp_path / "study.db", np.random.default_rng(0)
    command = [sys.executable, "-m", "orbits", *shlex.split(CUBIC), "--over", "beta=0:1", "--samples", "5000"]
    command += ["--store", str(store), "--resume", "--json"]
    known: set[int] = set()
    for _ in range(12):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        try:
            process.communicate(timeout=float(generator.uniform(0.6, 3.0)))
            break
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGKILL)
            process.communicate()
        if store.exists():
            connection = sqlite3.connect(f"{store.as_uri()}?mode=ro", uri=True)
            tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
            now = {m for (m,) in connection.execute("SELECT member FROM members")} if "members" in tables else set()
            connection.close()
            assert known <= now
            known = now
    done = subprocess.run(command, capture_output=True, check=True)
    fresh = subprocess.run([*command[:-4], "--json"], capture_output=True, check=True)
    assert json.loads(done.stdout) == json.loads(fresh.stdout)
