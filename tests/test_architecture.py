"""The rooms and their order, the import direction, the light start, and what may not be in the sources."""

import ast
import gc
import re
import subprocess
import sys
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

import orbits
from studies.docs.rooms import PAGE, page, rooms

ROOT = Path(__file__).parent.parent
RANK = {"orbits": 0, "problems": 1, "studies": 2}
ROOMS = rooms()  # of the engine from the ground up: each imports only from itself and from rooms before it
MOST_FLOORS = 14
# Modules without a test of their name, each with the file of tests that exercises it most.
TESTED_WITH = {
    "balls/curve_motion": "proof/test_branch",
    "balls/equations": "balls/test_enclosure",
    "mechanics/balance": "test_checks",
    "mechanics/grip": "periodic/test_swings",
    "periodic/swing": "periodic/test_swings",
    "checks/at_states": "test_checks",
    "checks/checked": "test_checks",
    "checks/relation": "test_checks",
    "show/springs_for_drake": "show/test_simulators",
    "sweeps/diagram_grid": "sweeps/test_boundaries",
    "continuation/curve": "continuation/test_family_problem",
    "continuation/event_place": "continuation/test_follow_event",
    "continuation/event_start": "continuation/test_follow_event",
    "curves/kkt_limits": "curves/test_kkt_curve",
    "curves/kkt_options": "curves/test_kkt_curve",
    "curves/kkt_points": "curves/test_kkt_curve",
    "curves/kkt_start": "curves/test_kkt_curve",
    "design/design_curve": "design/test_moving_design",
    "design/evaluator": "design/test_sensitivities",
    "design/event_statement": "continuation/test_follow_event",
    "design/extremes": "design/test_design_quantities",
    "design/moving_number": "design/test_moving_design",
    "design/traced_designs": "design/test_moving_design",
    "exact/decimals": "exact/test_outward_decimals",
    "exact/jets": "proof/hops/test_hop_theorems",
    "exact/refusal": "proof/test_prove",
    "exact/statement": "proof/test_prove",
    "flow/taylor_step": "flow/test_taylor",
    "mechanics/coordinates": "mechanics/test_coefficients",
    "mechanics/kinetics": "mechanics/test_coefficients",
    "model/casadi_functions": "model/test_casadi_machine",
    "model/model": "test_checks",
    "model/phase": "flow/test_phase_field",
    "numerics/quadrature": "shooting/test_error_bound",
    "shooting/arc_functions": "shooting/test_single_shooting",
    "mechanics/drawing": "show/test_plane",
    "mechanics/lagrange": "mechanics/test_coefficients",
    "mechanics/structure": "mechanics/test_mechanism",
    "periodic/branch_statement": "periodic/test_branch_points",
    "periodic/cycle_shape": "periodic/test_orbit",
    "periodic/energy_changes": "periodic/test_certificate",
    "periodic/motion_conditions": "periodic/test_certificate",
    "periodic/orbit_found": "periodic/test_find",
    "periodic/oscillation_curve": "periodic/test_oscillator",
    "periodic/oscillations": "periodic/test_along_energy",
    "periodic/quantities": "continuation/test_motion_columns",
    "periodic/tuned_extremes": "periodic/test_tuned_orbits",
    "periodic/tuned_search": "periodic/test_tuned_orbits",
    "proof/branch_claim": "continuation/test_proved_curve",
    "proof/branch_motion": "proof/test_branch",
    "proof/branch_piece": "proof/test_branch",
    "proof/branch_words": "proof/test_branch",
    "proof/claim_options": "proof/test_orbit_case",
    "proof/claimed_numbers": "proof/test_orbit_case",
    "proof/proved_existence": "proof/test_orbit_case",
    "proof/proved_motion": "proof/test_orbit_case",
    "proof/hops/exact_hops": "proof/hops/test_hop_theorems",
    "proof/hops/hop_jets": "proof/hops/test_hop_theorems",
    "proof/launches": "proof/test_attraction",
    "proof/sticking_friction": "proof/test_runs",
    "proof/wording": "proof/test_attraction",
    "returns/bifurcation": "returns/test_diagram",
    "returns/launch_cycles": "returns/test_bifurcations",
    "returns/launch_curve": "returns/test_launch_branches",
    "returns/flown_hops": "returns/test_flown_curve",
    "returns/hop_borders": "returns/test_hop_tracer",
    "returns/hop_curve": "returns/test_hop_tracer",
    "returns/hop_problem": "returns/test_followed_events",
    "returns/periodic_launch": "returns/test_flown_curve",
    "returns/hops": "returns/test_return_map",
    "returns/limited_hops": "returns/test_resolution",
    "returns/preimages": "returns/test_resolution",
    "show/diagram_cells": "show/test_sweep_figures",
    "show/pages/bokeh_figures": "show/pages/test_hop_view",
    "show/pages/map_view": "problems/explorer/test_page",
    "show/pages/player": "show/pages/test_hop_view",
    "sweeps/boundary_curves": "sweeps/test_existence",
    "sweeps/sparse_grid": "sweeps/test_existence",
    "hops/arcs": "hops/test_impacts",
    "hops/hop_inputs": "hops/test_schedule",
    "hops/hop_statuses": "hops/test_endings",
    "hops/flyer": "hops/test_impacts",
    "hops/recorded_simulation": "hops/test_simulation",
    "symbolic/identities": "symbolic/test_normal_forms",
    "symbolic/tree_formulas": "exact/test_formulas",
    "symbolic/tree_linear": "exact/test_exact_mechanics",
    "problems/explorer/processes": "problems/explorer/test_worker",
    "problems/explorer/page_state": "problems/explorer/test_page",
}
# Numeric constants of all modules, which may only become fewer, and those that a module which iterates may have.
MOST_CONSTANTS_OF_ALL, MOST_CONSTANTS = 250, 3
SOURCES = sorted(path for package in RANK for path in (ROOT / package).rglob("*.py"))
ENGINE = [path for path in SOURCES if path.is_relative_to(ROOT / "orbits")]


def name_of(path: Path) -> str:
    """The path from the project's root."""
    return str(path.relative_to(ROOT))


@cache
def tree_of(path: Path) -> ast.Module:
    """The syntax tree of a file. It stays, and while it is made there is no garbage to look for among all others."""
    gc.disable()
    try:
        return ast.parse(path.read_text(encoding="utf-8"))
    finally:
        gc.enable()


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """All nodes of the syntax tree of a file."""
    return [*ast.walk(tree_of(path))]


def module_of(path: Path) -> str:
    """The dotted name of a module."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@cache
def imported(path: Path, for_types: bool = True) -> list[tuple[str, str]]:
    """The modules that a file imports, wherever in it, by absolute name, each with the name taken from it or ''; if
    asked, without those that it imports for type checkers alone, as the public names of a package are not."""
    package = path.relative_to(ROOT).parent.parts
    blocks = [node for node in tree_of(path).body if isinstance(node, ast.If)]
    left_out = set() if for_types or path.name == "__init__.py" else {each for block in blocks for each in block.body}
    found = []
    for node in (node for node in nodes_of(path) if node not in left_out):
        if isinstance(node, ast.Import):
            found += [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(filter(None, (above, node.module)))
            found += [(module, alias.name) for alias in node.names]
    return found


def needs(paths: list[Path]) -> dict[str, set[str]]:
    """Which of some modules each of them imports when it runs, by dotted name; a package's face is the module that it
    hands on."""
    modules = {module_of(path) for path in paths}
    found: dict[str, set[str]] = defaultdict(set)
    for path in paths:
        for module, name in imported(path, for_types=False):
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
    assert len({room for room in ROOMS if (ROOT / "orbits" / room).is_dir()}) <= 21


def test_the_page_says_what_is_in_the_rooms():
    """`python studies/docs/rooms.py` writes it."""
    assert PAGE.read_text(encoding="utf-8") == page()


def docstrings(paths: list[Path]) -> list[tuple[str, str]]:
    """The docstrings of files, their classes and their functions, each with the name of its file."""
    documented = ast.Module | ast.ClassDef | ast.FunctionDef
    nodes = [(name_of(path), node) for path in paths for node in nodes_of(path) if isinstance(node, documented)]
    return [(name, found) for name, node in nodes if (found := ast.get_docstring(node))]


def test_docstrings_begin_with_what_they_are_about():
    wrong = []
    for path in [*SOURCES, *(ROOT / "tests").rglob("*.py")]:
        found = re.findall(r'^ *""" *((?:The same|Those|As)\b.*)', path.read_text(encoding="utf-8"), re.MULTILINE)
        wrong += [f"{name_of(path)}: {text}" for text in found]
    assert not wrong, "\n".join(wrong)


def test_the_modules_that_a_room_names_are_there():
    """In brackets, as (`programs`), in the docstring of a room."""
    modules = {path.stem for path in ENGINE}
    for name, text in docstrings(
        [ROOT / "orbits" / room / "__init__.py" for room in ROOMS if (ROOT / "orbits" / room).is_dir()]
    ):
        named = re.findall(r"\(((?:`\w+`(?:, )?)+)\)", text)
        assert {each for names in named for each in re.findall(r"\w+", names)} <= modules, name


# Of named tuples, results, and classes of other packages.
PROTECTED = {"_asdict", "_exit", "_fields", "_replace", "_conform", "_fields_in", "_processes", "_result_queue",
             "_writer", "_repr_html_"}  # fmt: skip


def test_private_methods_are_called_in_their_module():
    wrong = []
    for path in (path for path in SOURCES if not path.is_relative_to(ROOT / "studies")):
        own = {getattr(node, "name", "") for node in nodes_of(path)} | PROTECTED
        own |= {getattr(node.target, "id", "") for node in nodes_of(path) if isinstance(node, ast.AnnAssign)}
        named = [node for node in nodes_of(path) if isinstance(node, ast.Attribute) and re.match(r"_[^_]", node.attr)]
        own |= {node.attr for node in named if getattr(node.value, "id", "") in ("self", "cls")}
        wrong += [f"{name_of(path)}: {ast.unparse(node)}" for node in named if node.attr not in own]
    assert not wrong, "\n".join(wrong)


def test_rooms_import_from_rooms_below():
    wrong = []
    for path in ENGINE:
        own = room_of(module_of(path))
        if own in ("", "__main__"):
            continue
        for module, name in imported(path):
            if module.split(".")[0] == "orbits":
                other = room_of(module) or name
                if other != own and ROOMS.index(other) >= ROOMS.index(own):
                    wrong.append(f"{name_of(path)} imports {module}")
                if name.startswith("_") and module != module_of(path):
                    wrong.append(f"{name_of(path)} imports {module}.{name}")
    assert not wrong, "\n".join(wrong)


def test_no_circles_and_few_floors():
    modules = needs(ENGINE)
    heights(modules)
    rooms: dict[str, set[str]] = defaultdict(set)
    for module, others in modules.items():
        if room_of(module):
            rooms[room_of(module)] |= {room_of(other) for other in others} - {room_of(module)}
    assert max(heights(rooms).values()) <= MOST_FLOORS


def public_names_of(package: Path) -> dict[str, str]:
    """The public names that a package states, each with its module."""
    stated = [line for block in tree_of(package).body if isinstance(block, ast.If) for line in block.body]
    imports = [line for line in stated if isinstance(line, ast.ImportFrom)]
    return {each.name: line.module or each.name for line in imports for each in line.names}


def test_rooms_import_what_other_rooms_hand_out():
    """In the engine and in the machines. What a room hands out is imported elsewhere, and is not named as a module in
    which it is not."""
    packages = [path for path in SOURCES if path.name == "__init__.py" and module_of(path).count(".") == 1]
    public, used, wrong = {module_of(path): public_names_of(path) for path in packages}, defaultdict(set), []
    for path in SOURCES:
        own = ".".join(module_of(path).split(".")[:2])
        for module, name in imported(path):
            room = ".".join(module.split(".")[:2])
            if room in public and room != own:
                used[room].add(name)
                if not path.is_relative_to(ROOT / "studies") and not (module == room and name in public[room]):
                    wrong.append(f"{name_of(path)} imports {module}.{name}")
    for path in packages:
        room, modules = module_of(path), {each.stem for each in path.parent.rglob("*.py")}
        wrong += [f"{room}.{name} is in {place}" for name, place in public[room].items() if name in modules - {place}]
        wrong += [f"nothing imports {room}.{name}" for name in public[room].keys() - used[room]]
    assert not wrong, "\n".join(sorted(wrong))


def test_packages_import_from_packages_below():
    wrong = []
    for path in SOURCES:
        own = path.relative_to(ROOT).parts[0]
        for module, name in imported(path):
            package = module.split(".")[0]
            if package in RANK and package != own and (RANK[package] >= RANK[own] or name.startswith("_")):
                wrong.append(f"{name_of(path)} imports {module}.{name}")
    assert not wrong, "\n".join(wrong)


def iterates(path: Path) -> bool:
    """Whether a module repeats something: with `while`, or with `for` over a `range`."""
    loops = [node.iter for node in nodes_of(path) if isinstance(node, ast.For)]
    over_range = (getattr(name, "id", "") == "range" for loop in loops for name in ast.walk(loop))
    return any(over_range) or any(isinstance(node, ast.While) for node in nodes_of(path))


def numeric_constants(path: Path) -> list[str]:
    """The names at the top level of a module that stand for literal numbers, or for arithmetic or tuples of these."""
    found, parts = [], (ast.Tuple, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop, ast.expr_context)
    for node in tree_of(path).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        target, value = node.targets[0] if isinstance(node, ast.Assign) else node.target, node.value
        both = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        for name, each in zip(target.elts, value.elts, strict=True) if both else [(target, value)]:
            leaves = [leaf for leaf in ast.walk(each) if not isinstance(leaf, parts)]
            if leaves and all(isinstance(leaf, ast.Constant) and type(leaf.value) in (int, float) for leaf in leaves):
                found.append(ast.unparse(name))
    return found


def test_the_constants_of_an_algorithm_are_its_options():
    """A module that iterates has few numeric constants: more of them are fields of a frozen options object."""
    modules = [path for path in SOURCES if not path.is_relative_to(ROOT / "studies")]
    assert sum(len(numeric_constants(path)) for path in modules) <= MOST_CONSTANTS_OF_ALL
    counts = {name_of(path.with_suffix("")): len(numeric_constants(path)) for path in modules if iterates(path)}
    wrong = {name: count for name, count in counts.items() if count > MOST_CONSTANTS}
    assert not wrong, f"numeric constants: put them into a frozen options object: {wrong}"


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


def test_public_functions_are_typed():
    wrong = []
    for path in ENGINE:
        for function in public_functions(tree_of(path)):
            arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
            bare = [a.arg for a in arguments if a.annotation is None and a.arg not in ("self", "cls")]
            bare += ["its value"] if function.returns is None else []
            wrong += [f"{name_of(path)}, {function.name}: {each}" for each in bare]
    assert not wrong, "\n".join(wrong)


def test_the_engine_knows_no_machine():
    machines = {"hopper", "juggler", "wheel", "rocker", "shuttle", "spoke"}
    names = {path: {node.id.lower() for node in nodes_of(path) if isinstance(node, ast.Name)} for path in ENGINE}
    wrong = [name_of(path) for path in ENGINE if machines & names[path]]
    assert not wrong, wrong


def test_nothing_is_evaluated():
    evaluate = {"eval", "exec", "compile", "__import__"}
    wrong = []
    for path in SOURCES:
        calls = [node.func for node in nodes_of(path) if isinstance(node, ast.Call)]
        wrong += [f"{name_of(path)} calls {f.id}" for f in calls if isinstance(f, ast.Name) and f.id in evaluate]
    assert not wrong, "\n".join(wrong)


def loaded_by(*scenes: str) -> list[set[str]]:
    """Which heavy packages a fresh interpreter has loaded after each of the scenes that it runs."""
    heavy = ("casadi", "flint", "numpy", "scipy", "matplotlib", "llvmlite", "importlib.metadata", "numpy.ma",
             "multiprocessing", "concurrent.futures", "subprocess", "csv", "html")  # fmt: skip
    tell = f"import sys; print('LOADED', *[name for name in {heavy} if name in sys.modules])"
    code = "\n".join(line for scene in scenes for line in (scene, tell))
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    return [set(loaded.splitlines()[0].split()) for loaded in output.split("LOADED")[1:]]


def test_what_a_scene_does_not_need_is_not_loaded():
    find = "from orbits import find; from problems import Hopper; find(Hopper({}, {}, 1.0, 20.0, parameters={}))"
    linear, varying = find.format("'r'", "'1'", {}), find.format("'cubic'", "'exp(-z/H)'", {"H": 90.0})
    hops = "from orbits import ReturnMap, simulate; ReturnMap(Hopper('r'))([4.4]); simulate(Hopper('r'), 4.3, hops=2)"
    loaded, numbers = loaded_by("import problems.command.cli", linear, hops, varying), {"casadi", "numpy"}
    assert loaded == [set(), numbers, numbers, {*numbers, "llvmlite"}]  # Taylor series are machine code


@pytest.mark.slow
def test_verbs_load_no_library_that_they_do_not_use():
    """SciPy takes 0.3 s to import, matplotlib longer: what finds, follows, maps, sweeps and optimises uses neither."""
    hopper = "import orbits; from problems import Hopper; h = Hopper('r + b*r**3', parameters={'b': 0.3})"
    verbs = (
        "orbits.follow(h, 'b', 0.31)", "orbits.simulate(h, 3.5, hops=2)", "orbits.multipliers(h, orbits.find(h))",
        "orbits.ReturnMap(h, inject=0.03).fixed_points(2.5, 3.0)", "orbits.sweep(h, {'b': (0.3, 0.4)}, 5, seed=1)",
        "orbits.optimize(h, minimise='alpha', over={'b': (0.2, 0.4)})",
    )  # fmt: skip
    for verb, loaded in zip(verbs, loaded_by(hopper, *verbs)[1:], strict=True):
        assert not loaded & {"scipy", "matplotlib", "flint", "concurrent.futures", "subprocess"}, verb


def test_names_of_the_package_are_loaded_when_they_are_used_and_only_proofs_need_flint():
    """Without the extra `proof` everything but proofs is there."""
    checks = "orbits.checks; assert callable(orbits.check)"
    others = "from orbits import bifurcations, existence, follow, optimize, simulate, steer, sweep, uncertainty"
    package, errors, *rooms = loaded_by("import orbits", "orbits.errors.InputError; orbits.InputError", checks, others)
    assert package == set()
    assert "casadi" not in errors
    assert all("casadi" in loaded and "flint" not in loaded for loaded in rooms)
    assert not hasattr(orbits, "no_such_room")


def test_what_needs_an_extra_is_marked():
    """A module that is skipped where a package is missing is `extra` (or of a kind that has a run of its own)."""
    own = ("docs", "browser", "slow")
    wrong = []
    for path in (ROOT / "tests").rglob("test_*.py"):
        text = path.read_text(encoding="utf-8")
        if not any(f"mark.{name}" in text for name in own):
            packages = set(re.findall(r"importorskip\(\"(\w+)", text))
            wrong += [f"{name_of(path)}: {each}" for each in packages if f'mark.extra("{each}"' not in text]
    assert not wrong, wrong


def test_every_module_has_a_test_of_its_name():
    """It is tests/<room>/test_<module>.py, for machines in tests/problems/<room>; or the table names another one."""
    modules = [path for path in SOURCES if path.stem[:2] != "__" and not path.is_relative_to(ROOT / "studies")]
    names = {name_of(path.with_suffix("")).removeprefix("orbits/") for path in modules}
    tests = {name_of(path.with_suffix("")).removeprefix("tests/") for path in (ROOT / "tests").rglob("test_*.py")}
    untested = {name for name in names if str(Path(name).with_name(f"test_{Path(name).name}")) not in tests}
    assert untested == set(TESTED_WITH), sorted(untested ^ set(TESTED_WITH))
    assert set(TESTED_WITH.values()) <= tests, sorted(set(TESTED_WITH.values()) - tests)


def test_the_top_level_is_the_agreed_one():
    """Beside these stand only files whose names begin with a dot, and folders that are not kept."""
    agreed = {"CITATION.cff", "LICENSE", "README.md", "pyproject.toml", "orbits", "problems", "studies", "tests"}
    passing = {"PKG-INFO", "build", "dist", "figures", "site"}  # of distributions, and those that .gitignore names
    names = {path.name for path in ROOT.iterdir() if path.name[0] != "." and path.suffix != ".egg-info"}
    assert agreed <= names <= agreed | passing, sorted(names - agreed)


def test_no_trace_of_the_workshop():
    for path in ROOT.rglob("*"):
        if path.suffix in (".py", ".md", ".toml", ".cff") and ".git" not in path.parts and ".venv" not in path.parts:
            text = path.read_text(encoding="utf-8")
            assert "../" + "shared" not in text, path
            assert "/wo" + "rk/" not in text, path


def test_no_file_name_occurs_twice():
    """Neither in the engine nor in the machines."""
    names = [path.name for path in SOURCES if not path.is_relative_to(ROOT / "studies")]
    assert not {name for name in names if names.count(name) > 1} - {"__init__.py"}


def test_the_rooms_of_the_machines_have_no_circle():
    paths = [path for path in SOURCES if path.is_relative_to(ROOT / "problems")]
    rooms: dict[str, set[str]] = defaultdict(set)
    for module, others in needs(paths).items():
        if room_of(module):
            rooms[room_of(module)] |= {room_of(other) for other in others} - {room_of(module), ""}
    heights(rooms)
