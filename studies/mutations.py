"""Do the tests of a room notice a change of its code? Random changes of operators and numbers, one at a time.

In a copy of the sources one operator or one number of the engine becomes another: `+` and `-`, `*` and `/`, `and` and
`or` change places, a power becomes a product, a comparison and a sign are reversed, `not` is left out, a number grows
by one. Then the tests of the module's own room run until one fails, the quickest first. A change is caught by a
failure, by an error, or by a run that takes several times as long as that of the unchanged sources.
Run: python studies/mutations.py [--count N] [--seed N] [--workers N] [--output FOLDER] [--quick]
"""

import argparse
import ast
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import SimpleQueue
from xml.etree import ElementTree

ROOT = Path(__file__).parent.parent
COPIED = ("orbits", "problems", "studies", "tests", "README.md", "pyproject.toml")
# The tests of rooms whose own folder does not have all of them.
TESTED_BY = {
    "balls": ("balls", "proof/test_branch.py", "proof/test_orbit_case.py", "exact/test_stated.py"),
    "continuation": ("continuation", "periodic/test_fold_statement.py", "shooting/test_newton_kernel.py"),
    "control": ("control", "problems/steering"),
    "design": ("design", "problems/command/test_optimize_command.py"),
    "exact": ("exact", "proof"),
    "flow": (
        *("flow", "shooting", "mechanics/test_mechanism.py", "control/test_control.py", "laws/test_features.py"),
        "laws/test_law_statement.py",
    ),
    "laws": ("laws", "problems/laws", "periodic"),
    "mechanics": ("mechanics", "test_checks.py"),
    "model": ("model", "flow", "periodic", *(f"mechanics/test_{name}.py" for name in ("derived", "parts", "terms"))),
    "numerics": ("numerics", "hops/test_impacts.py", "returns/test_resolution.py"),
    "periodic": (
        *("periodic", "shooting", "laws/test_features.py", "problems/machines", "design/test_designs_at_once.py"),
        *("sweeps/test_members.py", "continuation/test_motion_columns.py"),
    ),
    "proof": ("proof", "exact", "continuation/test_proved_curve.py"),
    "returns": (
        *("returns", "hops/test_multiplier.py", "problems/machines/test_juggler.py"),
        "show/test_map_figures.py",
    ),
    "running": ("running", "symbolic", "sweeps/test_execution.py"),
    "shooting": ("shooting", "periodic", "mechanics/test_parts.py", "problems/laws/test_measured.py"),
    "hops": ("hops", "mechanics/test_parts.py", "problems/machines", "returns/test_return_map.py"),
    "symbolic": (
        *("symbolic", "laws/test_features.py", "laws/test_law_statement.py", "design/test_design_problem.py"),
        "control/test_steer.py",
    ),
    "sweeps": ("sweeps", "design/test_designs_at_once.py"),
}
# What rooms do for machines in SI, what every result can do, and how much computations take are tested here; numerics
# has neither units nor results.
SHARED = tuple(f"tests/test_{name}.py" for name in ("units", "messages", "result", "efforts"))
SWAPPED = {
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult},
    **{ast.And: ast.Or, ast.Or: ast.And, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq},
    **{ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Is: ast.IsNot, ast.IsNot: ast.Is},
    **{ast.In: ast.NotIn, ast.NotIn: ast.In},
}
PYTEST = (sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider")
ALL = ("-m", "not browser and not docs")  # the quick mode has only the quick tests of the module itself
# A run is given so many times the time of the unchanged sources, and a start; and so much memory in bytes.
SLOWER, START, MEMORY = 4.0, 60.0, 6 * 2**30


@dataclass(frozen=True)
class Mutation:
    """A change: the number of its place among those of a module, its line, and the expression before and after."""

    module: str
    place: int
    line: int
    before: str
    after: str

    @property
    def tests(self) -> tuple[str, ...]:
        """Where the tests of the module's room are."""
        room = Path(self.module).parts[1]
        rooms = TESTED_BY.get(room, (f"test_{room}" if room.endswith(".py") else room,))
        return *(f"tests/{name}" for name in rooms), *(SHARED if room != "numerics" else ())

    @property
    def own_tests(self) -> tuple[str, ...]:
        """Where the tests of the module itself are."""
        path = Path(self.module)
        return (f"tests/{path.parts[1]}/test_{path.name}",)


@dataclass(frozen=True)
class Outcome:
    """What became of a change: whether it was "caught", "caught by time" or has "survived", and the seconds taken."""

    mutation: Mutation
    verdict: str
    seconds: float


def places(tree: ast.AST) -> Iterator[ast.AST]:
    """The operators and numbers of a module that can be changed, but for annotations, decorators and messages."""
    skipped = set()
    for node in ast.walk(tree):
        if id(node) in skipped:
            skipped.update(map(id, ast.iter_child_nodes(node)))
            continue
        aside = [getattr(node, name, None) for name in ("annotation", "returns")]
        aside += [*getattr(node, "decorator_list", []), node.exc if isinstance(node, ast.Raise) else None]
        skipped.update(id(part) for part in aside if part is not None)
        if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Call) and ast.unparse(node.func) == "Message"):
            skipped.update(map(id, ast.iter_child_nodes(node)))
        swapped = isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in SWAPPED
        turned = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not)
        counted = isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value + 1 != node.value
        if swapped or turned or counted or isinstance(node, ast.Compare):
            yield node


def changed(node: ast.AST) -> ast.AST:
    """The node with its operator or its number changed."""
    node = deepcopy(node)
    if isinstance(node, ast.Compare):
        node.ops[0] = SWAPPED[type(node.ops[0])]()
    elif isinstance(node, ast.BinOp | ast.BoolOp):
        node.op = SWAPPED[type(node.op)]()
    elif isinstance(node, ast.UnaryOp):
        return node.operand
    elif isinstance(node, ast.Constant):
        node.value += 1
    return node


class _Replace(ast.NodeTransformer):
    """Puts another node in the place of one."""

    def __init__(self, old: ast.AST, new: ast.AST):
        self.old, self.new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self.new if node is self.old else super().visit(node)


def source_after(text: str, place: int) -> str:
    """The source of a module after the change at one of its places."""
    tree = ast.parse(text)
    node = list(places(tree))[place]
    return ast.unparse(ast.fix_missing_locations(_Replace(node, changed(node)).visit(tree)))


def mutations(count: int, seed: int, rooms: tuple[str, ...]) -> list[Mutation]:
    """So many different changes, drawn evenly from all places in the modules of the rooms."""
    found = []
    for path in sorted(path for room in rooms for path in (ROOT / "orbits" / room).glob("*.py")):
        for place, node in enumerate(places(ast.parse(path.read_text(encoding="utf-8")))):
            before, after = ast.unparse(node), ast.unparse(changed(node))
            found.append(Mutation(str(path.relative_to(ROOT)), place, node.lineno, before, after))
    return random.Random(seed).sample(found, count)


class Copy:
    """A copy of the sources in a folder of its own, in which the tests run.

    known : the answers of `quickest`, filled as they are needed; copies share them
    chosen : the options of pytest that choose tests
    """

    def __init__(
        self, folder: Path, known: dict[tuple[str, ...], tuple[list[str], float]], chosen: tuple[str, ...] = ALL
    ):
        self.root, self.known, self.chosen = folder, known, chosen
        for name in COPIED:
            source, target = ROOT / name, folder / name
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "pictures"))
            else:
                shutil.copy(source, target)

    def passes(self, tests: list[str], limit: float, report: Path | None = None) -> bool | None:
        """Whether the tests pass, None where they take longer than `limit` seconds; `report` is a file to write."""
        # Changes may keep a file's length and time, so that compiled modules must not be kept.
        own = {"PYTHONPATH": str(self.root), "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
        with tempfile.TemporaryDirectory() as files:
            options = [f"--basetemp={files}/pytest", *([f"--junitxml={report}"] if report else [])]
            run = subprocess.Popen(
                [*PYTEST, *self.chosen, *options, *tests],
                cwd=self.root,
                env={**os.environ, **own},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            resource.prlimit(run.pid, resource.RLIMIT_AS, (MEMORY, MEMORY))
            try:
                return run.wait(limit) == 0
            except subprocess.TimeoutExpired:
                os.killpg(run.pid, signal.SIGKILL)
                run.wait()
                return None

    def quickest(self, folders: tuple[str, ...]) -> tuple[list[str], float]:
        """The tests in these folders, the quickest first, and the seconds that they may take."""
        if folders not in self.known:
            report = self.root / "report.xml"
            if not self.passes(list(folders), 3600.0, report):
                raise RuntimeError(f"the tests in {', '.join(folders)} fail without a change")
            taken = {}
            for case in ElementTree.parse(report).iter("testcase"):
                taken[self._named(case.attrib["classname"], case.attrib["name"])] = float(case.attrib["time"])
            ordered = sorted(taken, key=lambda name: taken[name])
            if not self.passes(ordered, 3600.0):
                raise RuntimeError(f"the tests in {', '.join(folders)} fail in another order without a change")
            self.known[folders] = ordered, SLOWER * sum(taken.values()) + START
        return self.known[folders]

    def _named(self, place: str, name: str) -> str:
        """A test as pytest names it, from the dotted place in its report: a module, and a class where it is in one."""
        parts = place.split(".")
        ends = (k for k in range(len(parts), 0, -1) if (self.root / "/".join(parts[:k])).with_suffix(".py").exists())
        count = next(ends)
        return "::".join(["/".join(parts[:count]) + ".py", *parts[count:], name])

    def outcome(self, mutation: Mutation, tested: tuple[str, ...]) -> Outcome:
        """What becomes of a change under the tests in these folders and files."""
        path, (tests, limit) = self.root / mutation.module, self.quickest(tested)
        text = path.read_text(encoding="utf-8")
        path.write_text(source_after(text, mutation.place), encoding="utf-8")
        began = time.perf_counter()
        try:
            passed = self.passes(tests, limit)
        finally:
            path.write_text(text, encoding="utf-8")
        verdict = {True: "survived", False: "caught", None: "caught by time"}[passed]
        return Outcome(mutation, verdict, time.perf_counter() - began)


def main(
    output: Path | None = None, quick: bool = False, count: int = 60, seed: int = 0, workers: int = 1
) -> dict[str, int]:
    """The numbers of changes that were run and caught; prints each and leaves them in `output`/mutations.jsonl."""
    rooms = sorted(path.name for path in (ROOT / "orbits").iterdir() if (path / "__init__.py").exists())
    asked = mutations(1, 2, ("numerics",)) if quick else mutations(count, seed, tuple(rooms))
    copies: SimpleQueue[Copy] = SimpleQueue()

    def outcome(mutation: Mutation) -> Outcome:
        copy = copies.get()
        try:
            return copy.outcome(mutation, mutation.own_tests if quick else mutation.tests)
        finally:
            copies.put(copy)

    if output:
        output.mkdir(parents=True, exist_ok=True)
    survived, known = 0, {}
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        for worker in range(workers):
            copies.put(Copy(Path(folder) / str(worker), known, () if quick else ALL))
        for done in pool.map(outcome, asked):
            m = done.mutation
            survived += done.verdict == "survived"
            print(
                f"{done.verdict:<15}{done.seconds:6.1f} s  {m.module}:{m.line}: {m.before}  ->  {m.after}", flush=True
            )
            if output:
                with open(output / "mutations.jsonl", "a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(done)) + "\n")
    print(f"{len(asked) - survived} of {len(asked)} changes are caught by the tests of their rooms")
    return {"run": len(asked), "caught": len(asked) - survived}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--output", type=Path)
    parser.add_argument("--quick", action="store_true")
    main(**vars(parser.parse_args()))
