"""`orbits map --along`: what it prints and writes, and what it refuses."""

import json

import pytest

from orbits.returns import Basins

ALONG = "map --alpha 4.5:4.6:40 --along inject --from 0.06 --to 0.075"


@pytest.mark.slow
def test_flips_are_located(orbits, tmp_path):
    """Curve (d) of Fig. 8 of the paper."""
    figure, rows = tmp_path / "flips.png", tmp_path / "flips.csv"
    done = orbits(f"{ALONG} --json --attractor 5 --plot {figure} --save {rows}")
    assert done.code == 0
    (flip,) = (event for event in done.document["events"] if event["kind"] == "flip")
    assert flip["inject"] == pytest.approx(0.071587384137, abs=2e-12)
    assert {branch["period"] for branch in done.document["branches"]} == {1, 2}
    assert figure.stat().st_size > 5000
    assert rows.read_text().startswith("branch,period,inject,alpha")


def test_a_branch_in_words_and_in_a_file(orbits, tmp_path):
    path = tmp_path / "branch.json"
    done = orbits(f"map --alpha 4.5:4.55:20 --along inject --from 0.04 --to 0.05 --attractor 0 --save {path}")
    assert done.code == 0
    assert "fixed points" in done.out
    assert "inject = 0.05 is reached" in done.out
    assert json.loads(path.read_text())["branches"][0]["stable"][0] is True


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("map --alpha 4.5 --along inject --from 0 --to 1", "a range --alpha A:B:N"),
        ("map --alpha 4:5:9 --along inject --from 0", "--along needs --from V, --to W"),
        ("map --alpha 4:5:9 --along inject --from 0 --to 1 --cobweb 4.5", "leave out --cobweb"),
        ("map --alpha 4:5:9 --along inject --from 0 --to 1 --all", "leave out --cobweb, --all and --basins"),
        ("map --alpha 4:5:9 --from 0", "need --along NAME"),
        ("map --alpha 4:5:9 --save x.json", "needs --along NAME or --basins"),
        ("map --alpha 4 --basins", "--basins needs a range --alpha A:B:N"),
        ("map --alpha 4:5:9 --basins --cobweb 4.5", "leave out --cobweb, --all and --start"),
        ("map --alpha 4:5:9 --basins --along inject --from 0 --to 1", "and --basins"),
        ("map --alpha 4:5:9 --along speed --from 0 --to 1", "has a parameter 'speed'"),
        ("map --alpha 4:5:9 --along mass_ratio --from 1 --to 2", "every fixed point here is a lossless hop"),
        ("map --alpha 4:5:9 --along inject --from 1 --to 0", "low must be below high"),
    ],
)
def test_bad_input_is_named(line, words, orbits):
    done = orbits(line)
    assert (done.code, done.out) == (2, "")
    assert words in done.err


def test_basins_are_printed_and_saved(orbits, tmp_path):
    """The shares of two attracting hops are those that the map itself has."""
    line = "map --mass-ratio 0.2 --alpha 3:6:100 --inject 0.1 --basins"
    done = orbits(f"{line} --plot {tmp_path / 'basins.png'} --save {tmp_path / 'basins.json'}")
    assert done.code == 0
    assert "100.000% come to an attracting" in done.out
    assert (tmp_path / "basins.png").exists()
    found = Basins.load(tmp_path / "basins.json")
    assert [found.share_of(alpha) for alpha in found] == pytest.approx([0.89324, 0.10676], abs=2e-5)
    assert orbits(f"{line} --json").document["hops"] == found.hops


@pytest.mark.parametrize("line", ["map --alpha 1e15 --json", "map --alpha 1e-300:1e300:5 --json"])
def test_a_launch_too_fast_to_follow_is_lost(line, orbits):
    done = orbits(line)
    assert done.document["status"][-1] == "lost"
    assert done.document["next"][-1] is None


def test_a_map_of_many_launches_is_a_summary_unless_all_are_asked_for(orbits):
    short, whole = orbits("map --alpha 3:12:300"), orbits("map --alpha 3:12:300 --all")
    document = orbits("map --alpha 3:12:300 --json").document
    assert len(short.out.splitlines()) < 20
    assert f"{'rests':<24}{document['status'].count('rests')}\n" in short.out
    assert len(whole.out.splitlines()) == 301
    assert len(document["alpha"]) == 300


def test_a_hop_without_a_next_launch(orbits):
    """With hysteresis too it has the loss of its impact."""
    done = orbits("map --spring 'lossy:r + 0.1*r**3' --set loss_factor=0.1 --alpha 4.3:4.4:2")
    assert (done.code, done.err) == (0, "")
    _, launch, loss, *rest = done.out.splitlines()[2].split()
    assert (launch, *rest) == ("-", "1", "rests")
    assert float(loss) > 0
