"""What editors and type checkers tell a user: mistakes are found, and names are completed."""

import re
import rlcompleter
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

import orbits
import problems
from orbits.continuation import Point
from orbits.periodic import Certificate

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "tests" / "data" / "user_script.py"
DOCUMENTED = re.compile(r"^\.\. (?:autofunction|autoclass|autoexception|data):: (\S+)\.(\w+)$", re.MULTILINE)


def documented() -> list[str]:
    """The import of each name that the pages of the Python interface describe, from where they say it is."""
    pages = (ROOT / "studies" / "docs" / "api").glob("*.md")
    names = [found for page in pages for found in DOCUMENTED.findall(page.read_text(encoding="utf-8"))]
    assert len(names) > 90
    return [f"from {place} import {name} as name_{i}\n" for i, (place, name) in enumerate(names)]


def as_point() -> list[str]:
    """Each number of a certificate as one of a point of a family."""
    head = ["from orbits import Point\n", "from orbits.periodic.certificate import Certificate\n"]
    use = "    print(point.{0}, certificate.{0} == point.{0})\n"
    function = "def f(point: Point, certificate: Certificate) -> None:\n"
    return [*head, function, *(use.format(each.name) for each in fields(Certificate))]


def lines_with_errors(script: Path) -> dict[int, str]:
    """What mypy finds in a script, by the number of its line, as it does for packages that are installed. The large
    packages that no type of the script comes from are not read."""
    skipped = "[mypy-IPython.*,bokeh.*,dask.*,distributed.*]\nfollow_imports = skip"
    (script.parent / "mypy.ini").write_text(f"[mypy]\n{skipped}")
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(script.parent / "cache"), script.name]
    run = subprocess.run(command, cwd=script.parent, capture_output=True, text=True, timeout=600)
    assert run.returncode in (0, 1), run.stdout + run.stderr
    pattern = re.compile(rf"^{script.name}:(\d+): error: (.*)$", re.MULTILINE)
    return {int(number): text for number, text in pattern.findall(run.stdout)}


@pytest.mark.slow
@pytest.mark.extra("mypy")
def test_mistakes_in_a_script_are_found(tmp_path):
    """All of them and nothing else, and every public name has a type where it is documented."""
    lines = SCRIPT.read_text(encoding="utf-8").splitlines(keepends=True)
    wrong = {number for number, line in enumerate(lines, 1) if line.endswith("# wrong\n")}
    assert len(wrong) > 35
    script = tmp_path / "script.py"
    script.write_text("".join([*lines, *documented(), *as_point()]), encoding="utf-8")
    found = lines_with_errors(script)
    text = script.read_text(encoding="utf-8").splitlines()
    assert not [f"{text[number - 1]}: {found[number]}" for number in found.keys() - wrong]
    assert not [text[number - 1] for number in wrong - found.keys()]


@pytest.fixture(scope="module")
def names():
    """What a user has at hand, by name."""
    hopper = problems.Hopper("cubic")
    family = orbits.follow(hopper, "beta", 0.4, at=[0.35])
    run = orbits.simulate(problems.Hopper(restitution=0.3), 4.6, hops=1)
    own = {"orbit": orbits.find(hopper), "family": family, "point": family.points[0], "run": run}
    return {"orbits": orbits, "problems": problems, "hopper": hopper, "step": orbits.ReturnMap(hopper), **own}


COMPLETED = {
    "orbits.fin": {"find", "find_all", "find_branch_points"},
    "orbits.follow_": {"follow_branch", "follow_branch_points", "follow_event", "follow_fold"},
    "problems.hop": {"hopper_in_si"},
    "problems.springs.b": {"belleville", "bilinear"},
    "hopper.mass": {"mass_ratio"},
    "orbit.al": {"alpha"},
    "orbit.certificate.lo": {"loss_coefficient", "loss_error", "losses_in_words"},
    "family.ev": {"events"},
    "point.cl": {"clearance"},
    "step.fix": {"fixed_points"},
    "run.im": {"impacts"},
}


@pytest.mark.parametrize("prefix", COMPLETED)
def test_names_are_completed(prefix, names):
    thing, _, begun = prefix.rpartition(".")
    found = {name for name in dir(eval(thing, names)) if name.startswith(begun)}
    assert found == COMPLETED[prefix]
    completer, texts = rlcompleter.Completer(names), []
    while (text := completer.complete(prefix, len(texts))) is not None:
        texts.append(text)
    assert found <= {text.rpartition(".")[2].rstrip("()") for text in texts}


def test_what_is_listed_is_what_users_use(names):
    """Without what the machinery of results needs, and without numbers that this orbit does not have."""
    listed = {each: {name for name in dir(names[each]) if not name.startswith("_")} for each in names}
    assert len(listed["orbit"]) <= 45
    assert {"alpha", "certificate", "period", "plot", "save", "table", "units", "source"} <= listed["orbit"]
    assert not {"of_saved", "what", "heading", "bare", "with_tuned", "step", "speed", "tuned_errors"} & listed["orbit"]
    assert not {"of_saved", "what", "heading"} & (listed["family"] | listed["run"])
    assert listed["orbits"] == {name for name in orbits.__all__ if not name.startswith("_")}
    assert listed["problems"] == {*problems.__all__}
    assert "np" not in dir(problems.springs)
    assert "np" not in dir(problems.gravity)
    assert {*Point.__annotations__, *(each.name for each in fields(Certificate))} <= {*dir(names["point"])}


@pytest.mark.parametrize(
    "name", [each.name for each in fields(Certificate) if each.name not in ("family", "error", "violations")]
)
def test_a_number_of_the_certificate_is_named_where_it_is(name, names):
    with pytest.raises(AttributeError, match=f"'Orbit' object has no attribute '{name}'; take certificate.{name}$"):
        getattr(names["orbit"], name)


def test_what_is_missing_is_missing(names):
    with pytest.raises(AttributeError, match=r"'Orbit' object has no attribute 'alhpa'$") as found:
        names["orbit"].alhpa  # noqa: B018
    assert (found.value.name, found.value.obj) == ("alhpa", names["orbit"])
    with pytest.raises(AttributeError, match=r"'Simulation' object has no attribute 'clearance'$"):
        names["run"].clearance  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'base'; take source.base$"):
        orbits.find(problems.hopper_in_si(60.0, 3.0, stiffness=8000.0)).base  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'coefficients'$"):
        names["orbit"].coefficients  # noqa: B018 -- of the internal flight
