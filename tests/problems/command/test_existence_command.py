"""`orbits existence`: what it prints and writes, and what it refuses."""

import pytest
from conftest import PROVED, middle
from scripts import lines_of

CUBIC = "existence --spring 'r + beta*r**3'"
FOLD = "--along beta=-0.02:0.02 --across mass_ratio=0.5,2"


@pytest.mark.slow
def test_the_diagram_ends_at_the_fold(orbits):
    done = orbits(f"{CUBIC} {FOLD} --samples 3 --json")
    assert done.code == 0
    document = done.document
    fold = middle(PROVED["fold"]["beta"])
    assert (document["along"], document["across"], document["count"]) == ("beta", "mass_ratio", 6)
    for row in document["rows"]:
        assert row["stretches"][0]["status"] == "no orbit"
        assert row["stretches"][0]["high"] == pytest.approx(fold, abs=0.04e-6)
    assert len(document["members"]) == 6


@pytest.mark.slow
def test_files_are_written_and_two_processes_write_the_same(orbits, tmp_path):
    for workers in (1, 2):
        rows, figure = tmp_path / f"rows{workers}.csv", tmp_path / "diagram.png"
        done = orbits(f"{CUBIC} {FOLD} --samples 2 --colour stroke --workers {workers} --output {rows} --plot {figure}")
        assert done.code == 0
        assert "motions for beta" in done.out
        assert figure.stat().st_size > 5000
    first, second = ((tmp_path / f"rows{workers}.csv").read_bytes() for workers in (1, 2))
    assert first == second
    assert first.startswith(b"mass_ratio,from beta,to beta,status")


def test_exit_code_1_where_nothing_hops(orbits):
    assert orbits(f"{CUBIC} --along beta=-0.9:-0.8 --across mass_ratio=0.5,2 --samples 2").code == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--along beta=0.2:0.1 --across mass_ratio=1,2", "low must be below high"),
        ("--along beta --across mass_ratio=1,2", "--along 'beta' is not of the form NAME=LOW:HIGH"),
        ("--along beta=0.1,0.2 --across mass_ratio=1,2", "--along 'beta=0.1,0.2' must be NAME=LOW:HIGH"),
        ("--along beta=0:1 --across beta=0:1", "a second parameter"),
        ("--along beta=0:1 --across rest_length=6:9 --samples 5,1", "samples = (5, 1)"),
        ("--along beta=0:1 --across rest_length=6:9 --samples a", "--samples 'a' is not a list of numbers"),
        ("--along beta=0:1 --across rest_length=6:9 --colour hue", "unknown quantity 'hue'"),
        ("--along beta=0:1 --across rest_length=6:9 --output a.txt", "must end in"),
        ("--along beta=0:1 --across rest_length=6:9 --plot no/such/folder/a.png", "no/such"),
        ("--along beta=0:1", "--across"),
    ],
)
def test_bad_input_is_one_line(orbits, options, message):
    done = orbits(f"{CUBIC} {options}")
    assert done.code == 2
    assert message in done.err
    assert len(lines_of(done.err)) == 1
    assert not done.out
