"""The rooms and their order, the import direction, the light start, and what may not be in the sources."""

import ast
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
RANK = {"orbits": 0, "problems": 1, "studies": 2}
# The rooms of the engine from the ground up: each imports only from itself and from rooms before it.
ROOMS = (
    "errors",
    "check_proof",
    "io",
    "numerics",
    "symbolic",
    "model",
    "plot",
    "animation",
    "pages",
    "flow",
    "periodic",
    "proof",
    "hybrid",
    "continuation",
    "control",
    "design",
    "sweeps",
)
MOST_FLOORS = 10
SOURCES = sorted(path for package in RANK for path in (ROOT / package).rglob("*.py"))
ENGINE = [path for path in SOURCES if path.is_relative_to(ROOT / "orbits")]


def name_of(path: Path) -> str:
    """The path from the project's root."""
    return str(path.relative_to(ROOT))


def module_of(path: Path) -> str:
    """The dotted name of a module."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imported(path: Path):
    """The modules that a file imports, wherever in it, by absolute name, each with the name taken from it or ''."""
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(filter(None, (above, node.module)))
            yield from ((module, alias.name) for alias in node.names)


def needs(paths: list[Path]) -> dict[str, set[str]]:
    """Which of some modules each of them imports, by dotted name; a package's face is the module that it hands on."""
    modules = {module_of(path) for path in paths}
    found: dict[str, set[str]] = defaultdict(set)
    for path in paths:
        for module, name in imported(path):
            for target in (f"{module}.{name}", module):
                if target in modules and target != module_of(path):
                    found[module_of(path)].add(target)
                    break
    return found


def heights(graph: dict[str, set[str]]) -> dict[str, int]:
    """The floor of everything in a graph: 1 for what imports nothing, else one above all that it imports."""
    floors: dict[str, int] = {}

    def floor(name: str, below: tuple[str, ...] = ()) -> int:
        assert name not in below, f"a circle of imports: {' -> '.join((*below, name))}"
        if name not in floors:
            floors[name] = 1 + max((floor(other, (*below, name)) for other in graph.get(name, ())), default=0)
        return floors[name]

    for name in list(graph):
        floor(name)
    return floors


def room_of(module: str) -> str:
    """The room of a module of the engine, '' for the package itself."""
    return [*module.split("."), ""][1]


def test_every_file_of_the_engine_is_in_a_room():
    rooms = {room_of(module_of(path)) for path in ENGINE} - {"", "__main__"}
    assert rooms == set(ROOMS)
    assert len({room for room in ROOMS if (ROOT / "orbits" / room).is_dir()}) <= 12


@pytest.mark.parametrize("path", ENGINE, ids=name_of)
def test_rooms_import_from_rooms_below(path):
    own = room_of(module_of(path))
    if own in ("", "__main__"):
        return
    for module, name in imported(path):
        if module.split(".")[0] == "orbits":
            other = room_of(module) or name
            assert other == own or ROOMS.index(other) < ROOMS.index(own), f"{name_of(path)} imports {module}"
            assert not (name.startswith("_") and module != module_of(path)), f"{name_of(path)} imports {module}.{name}"


def test_no_circles_and_few_floors():
    modules = needs(ENGINE)
    heights(modules)
    rooms: dict[str, set[str]] = defaultdict(set)
    for module, others in modules.items():
        if room_of(module):
            rooms[room_of(module)] |= {room_of(other) for other in others} - {room_of(module)}
    assert max(heights(rooms).values()) <= MOST_FLOORS


@pytest.mark.parametrize("path", sorted((ROOT / "orbits").glob("*/__init__.py")), ids=name_of)
def test_a_rooms_face_is_its_docstring(path):
    (only,) = ast.parse(path.read_text(encoding="utf-8")).body
    assert isinstance(only, ast.Expr)


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_packages_import_from_packages_below(path):
    own = path.relative_to(ROOT).parts[0]
    for module, name in imported(path):
        package = module.split(".")[0]
        if package in RANK and package != own:
            assert RANK[package] < RANK[own], f"{path.name} imports {module}"
            assert not name.startswith("_"), f"{path.name} imports the private {module}.{name}"


def test_a_top_level_name_means_one_thing():
    """Every function, class and constant of engine and machines has a name of its own."""
    homes: dict[str, list[str]] = defaultdict(list)
    for path in SOURCES:
        # The second program that verifies proofs shares nothing with the first, not even names.
        if path.is_relative_to(ROOT / "studies") or path.name == "check_proof.py":
            continue
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = []
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names = [node.name]
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names = [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
            for name in names:
                homes[name].append(name_of(path))
    twice = {name: files for name, files in homes.items() if len(files) > 1 and name not in SAME_IN_EACH}
    assert not twice


# Names that mean the same in each module that has them: what a package hands on, and the
# laws that springs and gravity have alike.
SAME_IN_EACH = {"__all__", "__getattr__", "NAMED", "formula", "function", "linear"}


def public_functions(tree: ast.Module):
    """The public functions of a module, and the public methods of its public classes."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for member in node.body:
                if isinstance(member, ast.FunctionDef) and (
                    not member.name.startswith("_") or member.name == "__call__"
                ):
                    yield member


@pytest.mark.parametrize("path", ENGINE, ids=name_of)
def test_public_functions_are_typed(path):
    for function in public_functions(ast.parse(path.read_text(encoding="utf-8"))):
        arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
        bare = [a.arg for a in arguments if a.annotation is None and a.arg not in ("self", "cls")]
        assert not bare, f"{function.name}: {', '.join(bare)}"
        assert function.returns is not None, function.name


@pytest.mark.parametrize("path", ENGINE, ids=name_of)
def test_the_engine_knows_no_machine(path):
    words = path.read_text(encoding="utf-8").lower()
    names = {node.id for node in ast.walk(ast.parse(words)) if isinstance(node, ast.Name)}
    assert not names & {"hopper", "juggler"}


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_nothing_is_evaluated(path):
    calls = [node.func for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    assert not {call.id for call in calls if isinstance(call, ast.Name)} & {"eval", "exec", "compile", "__import__"}


def loaded_by(code: str) -> set[str]:
    """Which heavy packages a fresh interpreter has loaded after running `code`."""
    heavy = ("casadi", "flint", "numpy", "scipy", "matplotlib", "llvmlite", "importlib.metadata", "numpy.ma")
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
