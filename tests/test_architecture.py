"""The import direction, the light start, and what may not be in the sources."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
RANK = {"orbits": 0, "problems": 1, "studies": 2}


def imported(path: Path):
    """Top-level names of the project's packages that a file imports, and whether it reaches for a private name."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield from ((node.module, alias.name) for alias in node.names)


@pytest.mark.parametrize(
    "path", sorted(p for package in RANK for p in (ROOT / package).glob("*.py")), ids=lambda p: p.name
)
def test_imports_point_down(path):
    own = path.parent.name
    for module, name in imported(path):
        package = module.split(".")[0]
        if package in RANK and package != own:
            assert RANK[package] < RANK[own], f"{path.name} imports {module}"
            assert not name.startswith("_"), f"{path.name} imports the private {module}.{name}"


@pytest.mark.parametrize("path", sorted((ROOT / "orbits").glob("*.py")), ids=lambda p: p.name)
def test_the_engine_knows_no_machine(path):
    words = path.read_text(encoding="utf-8").lower()
    names = {node.id for node in ast.walk(ast.parse(words)) if isinstance(node, ast.Name)}
    assert not names & {"hopper", "juggler", "spring"}


@pytest.mark.parametrize(
    "path", sorted(p for package in RANK for p in (ROOT / package).glob("*.py")), ids=lambda p: p.name
)
def test_nothing_is_evaluated(path):
    calls = [node.func for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    assert not {call.id for call in calls if isinstance(call, ast.Name)} & {"eval", "exec", "compile", "__import__"}


def loaded_by(code: str) -> set[str]:
    """Which heavy packages a fresh interpreter has loaded after running `code`."""
    heavy = ("casadi", "numpy", "scipy", "matplotlib")
    code += f"\nimport sys; print('LOADED', *[name for name in {heavy} if name in sys.modules])"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    return set(output.split("LOADED")[1].split())


def test_what_a_scene_does_not_need_is_not_loaded():
    assert loaded_by("import problems.cli") == set()
    find = "from orbits import find; from problems import Hopper; find(Hopper({}, {}, 1.0, 20.0, parameters={}))"
    assert loaded_by(find.format("'r'", "'1'", {})) == {"casadi", "numpy"}
    varying = find.format("'cubic'", "'exp(-z/H)'", {"H": 90.0})
    assert loaded_by(varying) == {"casadi", "numpy"}


def test_no_trace_of_the_workshop():
    for path in ROOT.rglob("*"):
        if path.suffix in (".py", ".md", ".toml", ".cff") and ".git" not in path.parts and ".venv" not in path.parts:
            text = path.read_text(encoding="utf-8")
            assert "../" + "shared" not in text, path
            assert "/wo" + "rk/" not in text, path
