"""`orbits uncertainty`: what it prints and writes, and what it refuses."""

import csv
import json

import pytest

COMMAND = "uncertainty --spring 'k*r' --masses 60,3 --set k=8000"


def test_the_spread_follows_from_dimensions(orbits):
    """alpha goes as 1/sqrt(k) and as g: a deviation of 1 % of k is one of 0.5 % of alpha."""
    done = orbits(f"{COMMAND} --over 'k=norm(8000,80)' --samples 64 --json")
    assert (done.code, done.err) == (0, "")
    document = done.document
    assert document["linear"]["alpha"] / document["mean"]["alpha"] == pytest.approx(0.005, rel=1e-3)
    assert document["share"] == 1.0
    assert document["deviation"]["alpha"] == pytest.approx(document["linear"]["alpha"], rel=0.1)


@pytest.mark.slow
def test_indices_files_and_figures(orbits, tmp_path):
    """Times do not depend on gravity, so that all of their spread is that of the stiffness."""
    table, figure = tmp_path / "spread.csv", tmp_path / "indices.png"
    over = "--over k=7000:9000 --over surface_gravity=9:10"
    done = orbits(
        f"{COMMAND} {over} --samples 70 --quantities stroke,alpha/2 --indices --output {table} --plot {figure}"
    )
    assert (done.code, done.err) == (0, "")
    assert "with 95 % confidence intervals" in " ".join(done.out.split())
    assert "from 64 samples" in done.out
    with open(table, newline="") as file:
        rows = [*csv.DictReader(file)]
    assert [row["quantity"] for row in rows] == ["alpha", "flight_time", "stroke", "alpha/2"]
    assert [row["unit"] for row in rows[:3]] == ["m/s", "s", "m"]
    assert figure.stat().st_size > 5000
    document = orbits(f"{COMMAND} {over} --samples 16 --indices --json").document
    assert document["indices"]["shares"]["flight_time"]["surface_gravity"]["total"] == pytest.approx(0, abs=1e-9)
    saved = orbits(f"{COMMAND} {over} --samples 16 --json --output {tmp_path / 'spread.json'}").document
    assert json.loads((tmp_path / "spread.json").read_text())["mean"] == saved["mean"]


def test_the_figure_of_a_quantity(orbits, tmp_path):
    figure = tmp_path / "stroke.png"
    line = f"{COMMAND} --over k=7000:9000 --samples 16 --quantities stroke --plot {figure} --quantity"
    assert orbits(f"{line} stroke").code == 0
    assert figure.stat().st_size > 5000
    assert orbits(f"{line} contact_time").code == 0  # which it computes then too
    refused = orbits(f"{line} clearance")
    assert (refused.code, "the orbit has no clearance" in refused.err) == (1, True)
    assert orbits(f"{line} strike").code == 2


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        ("", 2, "--over"),
        ("--over k", 2, "is not of the form NAME=LOW:HIGH"),
        ("--over 'k=norm(8000,-1)'", 2, "the standard deviation must be finite and above 0"),
        ("--over mass=1:2", 2, "mass"),
        ("--over k=7000:9000 --samples 1", 2, "samples"),
        ("--over k=7000:9000 --quantities strike", 2, "did you mean 'stroke'"),
        ("--over k=7000:9000 --output spread.txt", 2, "must end in"),
        ("--over k=7000:9000 --quantity stroke", 2, "give --plot FILE too"),
        ("--over k=7000:9000 --family 40 --limit 1e-9", 1, "time"),
    ],
)
def test_refusals(options, code, words, orbits):
    done = orbits(f"{COMMAND} {options}")
    assert (done.code, done.out) == (code, "")
    assert words in done.err
