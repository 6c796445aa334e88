"""`orbits optimize`: a design and a front of a machine file, and what is refused."""

import json

import pytest

FILE = """machine = "hopper"
spring = "k*r + b*r**3"
[parameters]
k = 5000.0
b = 1e5
[si]
body_mass = 60.0
foot_mass = 3.0
rest_length = 0.8
[design]
minimise = "largest_contact_force"
subject_to = ["stroke <= 0.25", "centre_of_mass_rise == 0.2"]
family = 2
starts = 1
[design.over]
k = [500, 5e4]
b = [0, 1e7]
"""


@pytest.mark.slow
def test_command_line(orbits, tmp_path):
    path = tmp_path / "leg.toml"
    path.write_text(FILE)
    run = orbits(f"optimize '{path}' --json --plot '{tmp_path / 'best.png'}' --save '{tmp_path / 'best.json'}'")
    assert run.code == 0
    assert run.document["quantities"]["centre_of_mass_rise"] == pytest.approx(0.2, rel=1e-9)
    assert run.document["orbit"]["admissible"]
    assert (tmp_path / "best.png").stat().st_size > 10_000
    saved = json.loads((tmp_path / "best.json").read_text())["orbit"]
    assert saved == saved | run.document["orbit"]  # the file has the whole motion besides
    assert "minimise largest_contact_force" in orbits("optimize", path).out
    assert orbits("find --family 2 --machine", path).code == 0


@pytest.mark.slow
def test_command_line_of_a_front(orbits, tmp_path):
    path = tmp_path / "leg.toml"
    objectives = '["alpha", "loss_coefficient"]\npoints = 3'
    text = FILE.replace('"largest_contact_force"', objectives).replace(', "centre_of_mass_rise == 0.2"', "")
    path.write_text(text.replace("k = [500, 5e4]\n", "").replace("k = 5000.0", "k = 2e4"))
    run = orbits(f"optimize '{path}' --json --plot '{tmp_path / 'front.png'}' --save '{tmp_path / 'front.json'}'")
    assert run.code == 0
    assert len(run.document["points"]) == 3
    saved = json.loads((tmp_path / "front.json").read_text())
    assert saved["refused"] == run.document["refused"]
    for point, told in zip(saved["points"], run.document["points"], strict=True):
        assert point == point | told | {"orbit": point["orbit"] | told["orbit"]}
    assert (tmp_path / "front.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("old", "new", "code", "words"),
    [
        ("0.25", "0.01", 1, "'stroke <= 0.01' is missed by"),
        ("k = [500, 5e4]", "k = [5e4, 500]", 2, "low must be below high"),
        ('"largest_contact_force"', '"largest_contact_forse"', 2, "did you mean 'largest_contact_force'"),
        ("family = 2", "famly = 2", 2, "unknown key 'famly'; did you mean 'family'"),
        ("starts = 1", "starts = 'locals'", 2, "it must be a number, or 'global'"),
        ("family = 2", "points = 2", 2, "points are for a front"),
        ("[design.over]\nk = [500, 5e4]\nb = [0, 1e7]\n", "", 2, "[design.over] must name the parameters"),
        (FILE[FILE.index("[design]") :], "", 2, "has no [design]"),
    ],
)
def test_command_line_failures(orbits, tmp_path, old, new, code, words):
    path = tmp_path / "leg.toml"
    path.write_text(FILE.replace(old, new))
    run = orbits("optimize", path)
    assert run.code == code
    assert words in run.err


@pytest.mark.slow
def test_a_design_with_a_tuned_parameter(orbits, tmp_path):
    """In SI; the best orbit is the one that `orbits find` tunes on that machine."""
    path = tmp_path / "leg.toml"
    own = 'minimise = "stroke"\ntune = ["k"]\nat = {frequency = 2.0}\n[design.over]\nb = [1e4, 1e6]\n'
    path.write_text(FILE[: FILE.index("minimise")] + own)
    done = orbits("optimize --json", path)
    assert done.code == 0, done.err
    best = done.document
    assert best["kkt"] < 1e-10
    assert [each["text"] for each in best["active"]] in (["b >= 10000"], ["b <= 1e+06"])
    stated = FILE[: FILE.index("[design]")].replace("b = 1e5", f"b = {best['parameters']['b']!r}")
    path.write_text(stated)
    found = orbits("find --tune k --at frequency=2.0 --json --machine", path).document
    assert found["tuned"].keys() == {"k"}
    assert found["parameters"]["k"] == pytest.approx(best["parameters"]["k"], rel=1e-11)
    assert found["alpha"] == pytest.approx(best["orbit"]["alpha"], rel=1e-11)
    assert found["prescribed"] == best["orbit"]["prescribed"] == {"frequency": 2.0}
    path.write_text(stated + own.replace('"stroke"', '["stroke", "alpha"]').replace("minimise", "[design]\nminimise"))
    front = orbits("optimize --json", path).document
    assert {point["orbit"]["prescribed"]["frequency"] for point in front["points"]} == {2.0}
