"""Crafted files and options: whatever they say, there is a result or one short reason, soon and in little memory."""

import json
import random
import re
import signal
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import pytest
from documents import saved

import orbits
import problems
from orbits import Family, InputError, Orbit
from orbits.errors import MESSAGES
from problems.command.cli import main
from problems.laws import springs
from studies import crafted_calls, valid_calls

resource = pytest.importorskip("resource", reason="needs signals and limits of POSIX systems")

pytestmark = pytest.mark.usefixtures("any_digest")

LONGEST, LARGEST = 10.0, 8e5  # seconds of computing; kB of memory beyond that of the tests before
NUMBERS = ("0", "-1", "1", "1e15", "1e300", "1e-300", "nan", "inf", "-inf", "1e999", "x", "", "0x10", "9" * 5000, "1e4")
TEXTS = (
    "",
    "x" * 10_000,
    "'",
    "\x00",
    "\x1b[31m",
    "é",
    "r^3",
    "(" * 5000,
    "r" + "+r" * 4000,
    "__import__('os')",
    "1/0",
    "r/r",
)
VALUES = (
    *(None, True, "abc", "", [], {}, [[]], -1, 1e308, 10**400, [1.0], ["x"], {"x": 1}, [None], 0, 2.5, "x" * 10_000),
    *(1e-320, [0.0, 0.0, 0.0]),
)
NESTED = ("[" * 60_000, '{"a":' * 60_000, "[" * 5000 + "]" * 5000)


def mutated(document: object, rng: random.Random) -> object:
    """A document with one value or key changed, somewhere in it."""
    keys = list(document) if isinstance(document, dict) else range(len(document))  # type: ignore[arg-type]
    if not keys:
        return rng.choice(VALUES)
    key = rng.choice(list(keys))
    inner = document[key]  # type: ignore[index]
    if isinstance(inner, dict | list) and inner and rng.random() < 0.75:
        document[key] = mutated(inner, rng)  # type: ignore[index]
    elif rng.random() < 0.2:
        del document[key]  # type: ignore[attr-defined]
    else:
        document[key] = rng.choice(VALUES)  # type: ignore[index]
    return document


def crafted_document(text: str, rng: random.Random) -> str:
    """A saved document with a fault: a changed value, a cut, foreign bytes, or deep nesting."""
    kind = rng.random()
    if kind < 0.75:
        lines = text.splitlines()
        at = rng.randrange(len(lines))
        lines[at] = json.dumps(mutated(json.loads(lines[at]), rng))
        return "\n".join(lines) + "\n"
    if kind < 0.85:
        return text[: rng.randrange(len(text))]
    return rng.choice((*NESTED, "", "\x00" * 100, "null", "[]", "3", text * 2, text.replace(":", ": NaN, 1:", 1)))


def crafted_machine(rng: random.Random) -> str:
    """A machine file with a fault, sometimes with what to design."""
    value = lambda: rng.choice((*map(json.dumps, ("x" * 5000, True, [], [1], {}, "r")), *NUMBERS[:12]))  # noqa: E731
    lines = [
        f"{key} = {value()}" for key in rng.sample(("mass_ratio", "rest_length", "spring", "machine", "damping"), 2)
    ]
    if rng.random() < 0.3:
        return rng.choice(
            (f"a = {NESTED[2]}", "a." * 20_000 + "b = 1", "[" * 50_000, f"spring = '{'(' * 30_000}'", "a=1\n" * 9)
        )
    if rng.random() < 0.5:
        lines += ["[si]", f"body_mass = {value()}", "foot_mass = 1", f"stiffness = {value()}"]
    else:
        lines = ['spring = "cubic"', "[design]", f"minimise = {rng.choice((value(), json.dumps('alpha')))}"]
        lines += [f"{key} = {value()}" for key in rng.sample(("family", "starts", "subject_to", "seed", "points"), 1)]
        lines += ["[design.over]", f"beta = [{rng.choice(NUMBERS)}, {rng.choice(NUMBERS)}]"]
    return "\n".join(lines)


def crafted_table(rng: random.Random) -> str:
    """Rows of a measured spring, good, noisy or a loop, with a fault."""
    r = [0.4 * i for i in range(-30, 31)]
    r = rng.choice((r, r + r[::-1], r * 3, rng.sample(r, 40), r[30:], r[:2], [1.0] * 9))
    bump = rng.choice((0.0, 0.01, 1.0, 1e200))
    rows = [f"{x};{x + 0.02 * x**3 + rng.uniform(-bump, bump)}" for x in r]
    for _ in range(rng.choice((0, 1, 3))):
        row = rng.choice(("  # note", "1", ";", f"{rng.choice(NUMBERS)};{rng.choice(NUMBERS)}", "1;-1,234", "x" * 9999))
        rows.insert(rng.randrange(len(rows)), row)
    heads = ("r;f", "Travel time;Travel [mm];Force [N]", "compression;force", "Extension;Compressive force", "r", "")
    return "\n".join([rng.choice(("r;f", "r [m];f [N]", *heads)), *rows])


def crafted_line(rng: random.Random, folder: Path) -> list[str]:
    """A command line with a value that no one means."""
    leg, table = folder / "leg.toml", folder / "rows.csv"
    leg.write_text("[si]\nbody_mass = 60\nfoot_mass = 3\nstiffness = 8000\nrest_length = 0.8\n")
    table.write_text(crafted_table(rng))
    number, text = rng.choice(NUMBERS), rng.choice(TEXTS)
    lines = (
        ["find", "--mass-ratio", number], ["find", "--rest-length", number], ["find", "--spring", text],
        ["find", "--gravity", text, "--rest-length", "9"], ["find", "--spring", "cubic", "--set", f"beta={number}"],
        ["find", "--set", text], ["find", "--method", text], ["find", "--machine", text], ["find", text], [text],
        ["find", "--plot", text or "x"], ["map", "--alpha", number], ["map", "--alpha", f"1:{number}:5"],
        ["map", "--alpha", f"{number}:9:5"], ["map", "--alpha", f"1:2:{number}"], ["map", "--alpha", text],
        ["map", "--alpha", "4", "--inject", number], ["map", "--alpha", "4", "--damping", number],
        ["map", "--alpha", "4", "--restitution", number], ["map", "--alpha", "4", "--drag", number, "--json"],
        ["simulate", "--alpha", number, "--hops", "2"], ["simulate", "--alpha", "4", "--hops", number],
        ["simulate", "--alpha", "4", "--time", number], ["simulate", "--alpha", "4", "--hops", "2", "--inject", number],
        ["follow", "--spring", "cubic", "--along", "beta", "--from", "0.1", "--to", number, "--longest", "0.5"],
        ["follow", "--along", text, "--to", "1"],
        ["find", "--spring", f"table:{table}"], ["find", "--spring", f"table:{table}?noise={number}"],
        ["find", "--spring", f"table:{table}?branch={rng.choice(('loading', 'unloading', 'mean', text))}&noise=0"],
        ["find", "--spring", f"table:{springs.SAMPLE}?{text}"], ["find", "--machine", str(leg), "--spring", text],
        ["find", "--machine", str(leg), "--set", f"{rng.choice(('body_mass', 'stiffness', 'body_radius'))}={number}"],
        ["find", "--machine", str(leg), "--rest-length", number], ["map", "--alpha", "1:2:3", "--cobweb", number],
        ["map", "--alpha", "3:9:5", "--plot", str(folder / "map.png"), "--cobweb", number],
        ["follow", "--spring", "cubic", "--along", "beta", "--to", "1", "--at", text],
    )  # fmt: skip
    return rng.choice(lines)


class TooLong(BaseException):
    """A run that has computed for too long; no `except Exception` swallows it."""


def complaint_of(run, most: float = LONGEST) -> str:
    """What is wrong with how a run ends, which returns its code and its message; "" where nothing is."""

    def stop(*_):
        raise TooLong

    before, began = signal.signal(signal.SIGPROF, stop), time.process_time()
    signal.setitimer(signal.ITIMER_PROF, most)
    try:
        code, message = run()
    except TooLong:
        return f"takes more than {most:g} s"
    except Exception as error:
        return f"raises {type(error).__name__}: {error}"[:200]
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
    if code not in (0, 1, 2) or "internal error" in message or "Traceback" in message or "Warning" in message:
        return f"code {code}: {message[:200]}"
    if len(" ".join(message.split())) > MESSAGES.longest + len("orbits: \n"):
        return f"a message of {len(message)} characters: {message[:100]}"
    used = time.process_time() - began
    return f"takes {used:.1f} s" if used > most else ""


def by_command(arguments: list[str]):
    """A run of the command: its exit code and what it says on the terminal's error stream."""
    out, err, before = StringIO(), StringIO(), sys.argv
    sys.argv = ["orbits", *arguments]
    try:
        with redirect_stdout(out), redirect_stderr(err):
            main()
    except SystemExit as end:
        return end.code, err.getvalue()
    finally:
        sys.argv = before
    return 0, ""


def by_loading(load, path: Path):
    """A run that loads, prints and saves a document again: 0 where that goes, 2 with the error's message."""
    try:
        found = load(path)
        str(found), found.document(), found.save(path.with_name(f"again{path.suffix}"))
    except InputError as error:
        return 2, str(error)
    return 0, ""


def crafted_run(documents: dict[str, str], folder: Path, rng: random.Random):
    """A run of a crafted file or line, and what to call it."""
    kind = rng.choice(("orbit", "orbit in SI", "family", "resume", "machine", "line", "line"))
    if kind == "line":
        line = crafted_line(rng, folder)
        return lambda: by_command(line), " ".join(line)
    if kind == "machine":
        path, text = folder / "machine.toml", crafted_machine(rng)
        path.write_text(text)
        line = ["optimize", str(path)] if "design" in text else ["find", "--machine", str(path)]
        return lambda: by_command(line), text
    text = crafted_document(documents["family" if kind == "resume" else kind], rng)
    path = folder / ("orbit.json" if kind.startswith("orbit") else "family.jsonl")
    path.write_text(text)
    if kind == "resume":
        line = ["follow", "--spring", "cubic", "--rest-length", "20", "--along", "beta", "--from", "0.1", "--to", "0.3"]
        line += ["--longest", "0.5", "--resume", str(path)]
        return lambda: by_command(line), f"resume {text}"
    load = Orbit.load if kind.startswith("orbit") else Family.load
    return lambda: by_loading(load, path), text


def campaign(count: int, seed: int, folder: Path) -> list[str]:
    """What is wrong with how each of so many crafted inputs ends, and with the memory that they take together."""
    documents, rng, wrong = saved(folder), random.Random(seed), list[str]()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for number in range(count):
        run, name = crafted_run(documents, folder, rng)
        if complaint := complaint_of(run):
            wrong.append(f"{number}: {complaint} | {ascii(name)[:300]}")
    if (memory := resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) > LARGEST:
        wrong.append(f"they take {memory / 1e6:.2f} GB of memory")
    return wrong


def test_twenty_crafted_inputs(tmp_path):
    assert not campaign(20, 16, tmp_path)


@pytest.mark.slow
def test_a_hundred_crafted_inputs(tmp_path):
    assert not campaign(100, 2026, tmp_path)


@pytest.mark.parametrize("name", ["a\0", "a\ud800"])
def test_a_name_that_no_file_can_have_is_refused(name, saved_documents, tmp_path):
    path = tmp_path / "saved"
    path.write_text(saved_documents["orbit"])
    orbit = Orbit.load(path)
    path.write_text(saved_documents["family"])
    family = Family.load(path)
    for save, ending in ((orbit.save, ".json"), (family.save, ".csv"), (family.save, ".jsonl")):
        with pytest.raises(InputError, match="cannot be written to"):
            save(tmp_path / f"{name}{ending}")


def test_deep_nesting_and_large_files_are_refused(tmp_path):
    path = tmp_path / "deep.toml"
    path.write_text(f"a = {NESTED[2]}")
    code, message = by_command(["find", "--machine", str(path)])
    assert (code, "nested too deeply" in " ".join(message.split())) == (2, True)
    path.write_text("#" * 100_000)
    assert "at most 16384 are read" in " ".join(by_command(["find", "--machine", str(path)])[1].split())


def test_every_public_name_is_among_the_calls():
    """Functions by their names, classes by the results and builders that are of them."""
    text = Path(valid_calls.__file__).read_text(encoding="utf-8")
    uncalled = {"InputError", "NoOrbit", "OrbitsError", "Machine", "Units", "__version__"}  # nothing to call
    results = {"BifurcationCurve", "BifurcationDiagram", "BranchPoint", "Control", "Design", "DesignCurve", "Existence"}
    results |= {"Front", "HopMultipliers", "OptimalFamily", "PeriodDiagram", "Proof", "ReturningHops", "Simulation"}
    results |= {"Families", "Sweep", "Uncertainty", "Driven", "DrivenFamily", "Disturbed"}
    results |= {"Oscillation", "OscillationFamily", "Swing", "SwingFamily"}
    names = {*orbits.__all__, *problems.__all__} - uncalled - results - {"explore"}
    assert sorted(name for name in names if not re.search(rf"\b{name}\b", text)) == []
    assert {*crafted_calls.COMMANDS} == {*crafted_calls.commands.commands}


@pytest.mark.slow
def test_twenty_crafted_calls():
    assert not crafted_calls.main(calls=20, seed=2026)["faults"]
