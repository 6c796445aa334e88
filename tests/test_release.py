"""What belongs to one version agrees: numbers, changes, and the commands of hosted machines."""

import re
import tomllib
from pathlib import Path

import orbits

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def text_of(*path: str) -> str:
    return ROOT.joinpath(*path).read_text(encoding="utf-8")


def test_the_version_is_one():
    """That of the package, of the citation with its date, of the conda recipe, and of the latest changes."""
    version = PROJECT["version"]
    date = re.search(r"^date-released: (.*)$", text_of("CITATION.cff"), re.M)[1]
    assert orbits.__version__ == version
    assert f"\nversion: {version}\n" in text_of("CITATION.cff")
    assert f'\n  version: "{version}"\n' in text_of(".github", "conda", "recipe.yaml")
    headings = re.findall(r"^## (.*)$", text_of(".github", "CHANGES.md"), re.M)
    assert next(each for each in headings if each != "Unreleased") == f"{version} ({date})"


def test_the_conda_recipe_needs_what_the_wheel_needs():
    recipe = text_of(".github", "conda", "recipe.yaml")
    for requirement in PROJECT["dependencies"]:
        name, lowest = requirement.split(">=")
        assert re.search(rf"^    - {name}(-base)? >={re.escape(lowest)}$", recipe, re.M), requirement
    assert f'python_min: "{PROJECT["requires-python"].removeprefix(">=")}"' in recipe
    assert "\n      - orbits = " + PROJECT["scripts"]["orbits"] in recipe


def test_the_extras_are_listed():
    """Each with what it is for, where the installation is described."""
    rows = re.findall(r"^\| `(\w+)` \|", text_of("studies", "docs", "start.md").partition("### Run")[0], re.M)
    assert sorted(rows) == sorted(PROJECT["optional-dependencies"])


def test_hosted_machines_run_the_commands_that_are_documented():
    tests, site = (text_of(".github", "workflows", f"{name}.yml") for name in ("tests", "documentation"))
    second = re.search(r"^```sh\n.*\n(.*)\n```$", text_of("README.md"), re.M)[1]
    install, run = (each.removeprefix(".venv/bin/") for each in second.split(" && ")[1:])
    assert f"run: python -m {install}\n" in tests
    assert f"run: {run}\n" in tests
    assert "run: .ci/run\n" in tests
    assert "run: python studies/docs/build.py --output site\n" in site


def test_the_paper_has_the_length_of_one():
    """At most 1,000 words, and a reference for each citation."""
    text, references = text_of("studies", "paper", "paper.md"), text_of("studies", "paper", "paper.bib")
    assert len(text.split()) <= 1000
    cited = set(re.findall(r"@([a-z]+\d{4})", text))
    assert cited == set(re.findall(r"^@[a-z]+\{(.*),$", references, re.M))
