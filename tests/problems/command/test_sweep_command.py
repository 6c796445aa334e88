"""`orbits sweep`: what it prints and writes, how it goes on, and what it refuses."""

import os
import shlex
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from scripts import lines_of

from orbits import Sweep, find
from problems import Hopper
from tests.browser import PATIENCE, wait_for

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


def test_members_may_be_found_by_another_method(orbits):
    shot = orbits(f"{CUBIC} --over beta=0.1,0.2 --method shooting --json").document
    orbit = find(Hopper("r + beta*r**3", parameters={"beta": 0.1}), method="shooting")
    assert shot["members"][0]["alpha"] == pytest.approx(orbit.alpha, rel=1e-14)
    refused = orbits(f"{CUBIC} --over beta=0.1,0.2 --method newton")
    assert (refused.code, "method = 'newton'" in refused.err) == (2, True)


def test_tuned_members_have_the_frequency(orbits):
    done = orbits("sweep --spring 'k*r' --tune k=1.5 --at frequency=0.1 --over mass_ratio=0.5,1,2 --json")
    assert done.code == 0, done.err
    for member in done.document["members"]:
        orbit = find(Hopper("k*r", mass_ratio=member["mass_ratio"], parameters={"k": member["k"]}))
        assert orbit.period == pytest.approx(10, rel=1e-12)
        assert member["k_error"] < 1e-11
        assert member["admissible"] is True
    refused = orbits("sweep --spring 'k*r' --tune k=1.5 --over mass_ratio=0.5,1,2")
    words = "tune = ['k'] names 1 of the parameters of the hopper, and 0 are needed: one for each quantity of at = []"
    assert (refused.code, words in " ".join(refused.err.split())) == (2, True)


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
    assert "belongs to another sweep" in other.err
    assert len(Sweep.load(store)) == 20


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("", "--over NAME=RANGE"),
        ("--over beta", "NAME=LOW:HIGH"),
        ("--over beta=1:2:3", "NAME=LOW:HIGH"),
        ("--over beta=1:x", "--over '1:x'"),
        ("--over beta=0:1:log", "above 0"),
        ("--over 'beta=norm(1,0)'", "above 0"),
        ("--over gamma=0:1 --set beta=0.1", "gamma"),
        ("--over beta=0:1 --sampling halton", "halton"),
        ("--over beta=0:1 --family a", "--family 'a'"),
        ("--over beta=0:1 --resume", "--store FILE"),
        ("--over beta=0:1 --from designs.csv", "--over NAME=RANGE"),
        ("--from nothing.csv", "not a table of designs"),
        ("--over 'mass_ratio=norm(1,1)' --set beta=0.1", "mass_ratio"),
        ("--over beta=0:1 --output members.xyz", "must end in"),
        ("--over beta=0:1 --store /nowhere/study.db --resume", "no folder"),
        ("--over beta=", "is not a list of numbers"),
        ("--over 'beta=norm(0,inf)'", "finite"),
        ("--over 'beta=cauchy(0,1)'", "cauchy(0,1)"),
        ("--over beta=0:1 --output /nowhere/members.csv", "no folder '/nowhere'"),
        ("--over beta=0:1 --plot /nowhere/members.png", "no folder '/nowhere'"),
        ("--over beta=0:1 --quantities stroke,stroke", "'stroke' appears twice in quantities"),
        ("--over beta=0:1 --workers 0", "--workers"),
        ("--over beta=0:1 --outcome fixed_points --between 5:4", "low must be below high"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(orbits, options, said):
    refused(orbits(f"{CUBIC} {options}"), said)


def refused(done, said: str) -> None:
    """Bad input was refused in one line."""
    assert (done.code, done.out) == (2, "")
    assert said in done.err
    assert len(lines_of(done.err)) == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "first line"),
        (b"beta,mass_ratio\n", "no rows"),
        (b"beta,mass_ratio\n0.1,1\nnan,2\n", "row 2 of column 'beta' is 'nan'"),
        (b"beta,mass_ratio\n0.1,1\n0.2,heavy\n", "row 2 of column 'mass_ratio' is 'heavy'"),
        (b"beta,mass_ratio\n0.1,1\n0.2\n", "line 3 has 1 values for 2 columns"),
        (b"beta,mass_ratio\n0.1,1\n\xe4,2\n", "line 3 is not text in UTF-8"),
        (b"beta\n" + b"1" * 200_000, "field larger"),
        (b"beta,mass_ratio\n0.1,-1\n", "mass_ratio = -1"),
    ],
)
def test_a_table_that_is_none_is_refused(orbits, tmp_path, content, said):
    table = tmp_path / "designs.csv"
    table.write_bytes(content)
    refused(orbits(f"{CUBIC} --from {table}"), said)
    assert table.read_bytes() == content


@pytest.mark.parametrize("spoilt", ["text", "folder", "middle", "cut", "head", "of other machines", "question"])
def test_a_file_that_is_no_store_is_refused_untouched(orbits, tmp_path, spoilt):
    store = tmp_path / "study.db"
    command = f"{CUBIC} --over beta=0:1 --samples 1000 --store {store} --resume"
    if spoilt == "folder":
        store.mkdir()
        refused(orbits(command), "study.db is not a store of a sweep: it is a folder")
        return
    assert orbits(command).code == 0
    content = bytearray(store.read_bytes())
    middle, question = len(content) // 2, content.index(b'{"machine"')
    if spoilt == "text":
        content = bytearray(b"no store at all")
    elif spoilt == "middle":
        content[middle : middle + 8192] = np.random.default_rng(0).bytes(8192)
    elif spoilt == "cut":
        del content[middle:]
    elif spoilt == "head":
        content[:16] = bytes(16)
    elif spoilt == "question":
        content[question : question + 3] = b"{{{"
    store.write_bytes(content)
    if spoilt == "of other machines":
        refused(orbits(f"{command} --mass-ratio 2"), "its machine mass_ratio is 1.0 there, but 2.0 here")
    else:
        refused(orbits(command), "study.db is")
    assert store.read_bytes() == content
    assert [file.name for file in tmp_path.iterdir()] == ["study.db"]


def test_a_file_that_cannot_be_written_is_refused_before_the_sweep(orbits, tmp_path, monkeypatch):
    """No store is begun, as by the same sweep without that file."""
    store = tmp_path / "study.db"
    command = f"{CUBIC} --over beta=0:1 --samples 2 --store {store}"
    for name in ("members.csv", "members.png"):
        (tmp_path / name).mkdir()
    refused(orbits(f"{command} --output {tmp_path / 'members.csv'}"), "it is a folder")
    refused(orbits(f"{command} --plot {tmp_path / 'members.png'}"), "it is a folder")
    for package, ending in (("xarray", "nc"), ("netCDF4", "nc"), ("pandas", "parquet"), ("pyarrow", "parquet")):
        for other in ("xarray", "netCDF4", "pandas", "pyarrow"):
            monkeypatch.setitem(sys.modules, other, None if other == package else sys)
        output = f"--output {tmp_path / 'members'}.{ending}"
        refused(orbits(f"{command} {output}"), f"{package} is needed: pip install 'persistent-orbits[data]'")
    assert not store.exists()
    assert orbits(command).code == 0
    assert store.exists()


def members_in(store: Path) -> set[int]:
    """The members that a store has so far, by its tables alone."""
    if not store.exists():
        return set()
    with closing(sqlite3.connect(f"{store.as_uri()}?mode=ro", uri=True)) as connection:
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
        return {m for (m,) in connection.execute("SELECT member FROM members")} if "members" in tables else set()


def interrupted(options: list[str], begun: Callable[[], bool]) -> str:
    """What a long sweep says that is interrupted as soon as it has begun, by a Ctrl-C that reaches all processes of the
    terminal's group; only the command answers, and none is left."""
    command = [sys.executable, "-m", "orbits", *shlex.split(CUBIC), "--over", "beta=0:1", "--samples", "1000000"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([*command, *options], process_group=0, **pipes) as running:
        try:
            wait_for(begun, "the sweep has begun")
            os.killpg(running.pid, signal.SIGINT)
            out, err = running.communicate(timeout=PATIENCE)  # ends when no process has the pipes any more
        except BaseException:
            os.killpg(running.pid, signal.SIGKILL)
            raise
    assert (running.returncode, out) == (130, "")
    first, *others = lines_of(err)
    assert first.startswith("orbits: interrupted: ")
    assert all(line.startswith("  ") for line in others)  # those of one message
    return " ".join(" ".join([first, *others]).split())


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_an_interrupt_says_what_is_kept(tmp_path, workers):
    """A sweep without a store has begun for sure after twice the time after which one with a store had members."""
    store, start = tmp_path / "study.db", time.monotonic()
    said = interrupted(["--workers", workers, "--store", str(store)], lambda: bool(members_in(store)))
    kept = len(Sweep.load(store))
    assert kept > 0
    assert f"{kept} of 1000000 members are in" in said
    assert "--resume" in said
    if workers == "2":
        return
    now = time.monotonic()
    end = now + 2 * (now - start) + 1
    said = interrupted(["--workers", workers], lambda: time.monotonic() > end)
    assert "nothing is kept: name a store" in said
