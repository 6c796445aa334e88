"""Does any call break? Crafted calls of every command, verb and machine end in a result or in one short reason.

Each call is a valid one with a few values replaced by ones that no one means, drawn by a seed and its number. A fault
is an internal error, a warning, a NaN that is accepted or returned, ten seconds of the clock and of the processor
without a word, or an interrupt that is not heeded: a call that takes long is interrupted as by Ctrl-C.
Run: python studies/crafted_calls.py [--calls N] [--first N] [--seed N] [--only VERB] [--unnamed]
"""

import argparse
import faulthandler
import io
import json
import logging
import os
import random
import re
import signal
import sqlite3
import sys
import tempfile
import time
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable
from contextlib import closing, redirect_stderr, redirect_stdout, suppress
from decimal import Decimal
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import click
import numpy as np

import orbits
import problems
from orbits import Family, InputError, NoOrbit, Orbit, OrbitsError, Sweep, follow
from problems import Hopper
from problems.command.cli import main as command, orbits as commands
from studies.valid_calls import BUILDERS, MACHINES, calls

# Seconds of the processor, and of the clock too without a word: without a word, of a call before it is interrupted,
# until it has heeded that, and until it is interrupted again, as Python may lose one while it collects garbage.
SILENT, LONGEST, HEEDED, AGAIN = 10.0, 12.0, 10.0, 2.0


def words(text: str) -> list[str]:
    return text.split()


NUMBERS = words("nan inf -inf 1e308 -1e308 1e-320 -0 0 -1 1 2.5 1e999 x 0x10 1e15 1_000 \u0661 1e-16 1,2 1:2 -- 1e5 7")
NUMBERS += ["", "0.3 ", "9" * 5000]
WHOLE = words("0 1 2 3 7 12 100 5000 1000000 99999999999")
EXTREMES = words("nan inf 1e308 1e-320 -0 0 1e-16 1e15 0.3 2.5 1e5 -1e308 1 1e-5 20")
RANGES = words("0:1 1:0 1:1 nan:1 0:inf 1e-320:1e308:log -1:1:log 1:2:3:4 : norm(0,0) norm(nan,1) norm(1,1e308)")
RANGES += words("norm(0.3,0.02) 1,2,3 1,1 , -1e308:1e308 0:1e-320 0.3:0.4 1:2:3 1:2:1e9 1:2:-3 1e-320:1:5 3:9:1000001")
NAMES = [*words("beta alpha mass_ratio rest_length damping x \u00e9 period inject"), "", "a b", "a" * 300]
FORMULAS = """r/r|1e308*r|1e-320*r|r**1e308|exp(exp(r))|sqrt(r)|log(r)|abs(r)|r - 0.5*r**3|nan*r|tanh(1e6*r)|-r|0|1|r**3
sin(1e9*r)|potential:|potential:r**4|table:|loop:|r; r|1/(1+z)**2|1e308|-1|z|1 - z|table:/dev/zero|cubic|tanh|lossy:r
beta*r|1/r|r**-1|r^3|\u00e9|__import__('os')|1/0|'""".replace("\n", "|").split("|")
FORMULAS += ["", "x" * 3000, "\x00", "\x1b[31m", "(" * 5000, "r" + "+r" * 4000]
ODD = (None, True, "", "x" * 300, 1j, b"x", object(), [], {}, (), [[]], {"x": 1}, {1: 2}, (1, 0), (np.nan, 1), "\u00e9")
ODD += (np.zeros(0), np.array(np.nan), np.array(["a"]), Decimal("NaN"), 10**400, lambda: 0, int, range(3), Path("/"))
FLOATS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, -0.0, 0, -1, 1, 2.5, 10**400, True, "1", 1e15, 1e-16, 7)
FLOATS += (np.float64("nan"), 1e5, 1000)


# ---- the command line

# Valid lines; a file in them is one of `make_files`.
LINES = """
find
find --spring cubic --set beta=0.3
find --spring cubic --set beta=0.3 --rest-length 9
find --machine juggler
find --masses 60,3 --rest-length 0.8 --spring 8000*r+2e6*r**3
find --machine leg.toml
find --machine ground.toml
find --machine wheel --set inertia_ratio=1 --set gravity_ratio=0.5
find --machine wheel.toml
find --machine rocker --set inertia_ratio=1 --set gravity_ratio=0.5
find --spring table:rows.csv
find --machine shuttle --set inertia_ratio=1
find --start orbit.json --spring cubic --set beta=0.3 --rest-length 20
find --machine runner --tune inertia --tune hip_stiffness --at speed=0.4
find --gravity 1/(1+z/R)**2 --set R=150 --rest-length 20
find --spring k*r --tune k=1 --at frequency=0.1
find --spring tanh --set b=0.2
find --explain
prove
prove --spring cubic --set beta=0.3 --rest-length 8
prove --spring cubic --between beta=0.299:0.301 --rest-length 8
prove --inject 0.03 --near 4.6
prove --spring cubic --along beta --from 0.1 --to 0.12 --rest-length 30
prove --loss
prove --spring k*r --tune k=1 --at frequency=0.1
check --spring cubic --set beta=0.3
check --machine leg.toml
check --machine wheel.toml --start wheel.json
check-proof proof.json
check-proof orbit.json
follow --spring cubic --along beta --from 0.1 --to 0.3 --longest 0.5
follow --spring cubic --along beta --from 0 --to -0.02 --event fold --second mass_ratio=1.2
follow --spring cubic --tune beta=0.3 --along period --to 6
follow --along mass_ratio --to 2
follow --machine leg.toml --along body_mass --to 62
follow --spring cubic --rest-length 20 --along beta --from 0.1 --to 0.3 --resume family.jsonl
follow --machine wheel --set gravity_ratio=0.5 --along inertia_ratio --from 1 --to 1.1
map --alpha 4
map --alpha 3:9:5
map --alpha 4.3:5:20 --along inject --from 0.02 --to 0.03
map --machine leg.toml --alpha 1:2:3
map --spring cubic --set beta=0.3 --alpha 3:4:5 --plot map.png
map --damping 0.1 --alpha 4
simulate --alpha 4 --hops 2
simulate --alpha 4 --time 9 --damping 0.01
simulate --restitution 0.3 --alpha 4.6 --hops 3
simulate --machine leg.toml --alpha 2 --hops 2
simulate --machine wheel.toml --start wheel.json --hops 2
simulate --drag 0.1 --alpha 4 --hops 2 --inject 0.01
simulate --machine juggler --alpha 5 --hops 2
simulate --start orbit.json --hops 1
optimize design.toml
optimize front.toml
optimize leg.toml
optimize crafted.toml
sweep --spring cubic --over beta=0.1:0.3 --samples 8
sweep --over mass_ratio=0.1:10:log --samples 8 --family 1,2
sweep --spring cubic --from designs.csv
sweep --over alpha=3:6 --outcome map --samples 5
sweep --over mass_ratio=1,2 --outcome fixed_points --between 4:5
sweep --spring cubic --over beta=0.1,0.2 --store new.db
sweep --spring cubic --rest-length 20 --over beta=0.1,0.2 --store store.db --resume
sweep --spring k*r --over mass_ratio=1,2 --tune k=1 --at frequency=0.1
sweep --machine leg.toml --over body_mass=60:70 --samples 4 --quantities period,alpha/2
existence --spring cubic --along beta=-0.02:0.1 --across rest_length=6,9 --samples 5
existence --machine leg.toml --along body_mass=60:70 --across rest_length=0.7,0.9 --samples 3
existence --along mass_ratio=1:2 --across rest_length=2:9 --samples 3,4 --colour alpha --plot where.png
uncertainty --spring cubic --over beta=norm(0.3,0.02) --samples 16
uncertainty --over mass_ratio=1:2 --samples 8 --indices
uncertainty --machine leg.toml --over body_mass=norm(60,1) --samples 8 --quantities period
control keep-hopping --damping 0.01 --intervals 8
control recover --short 0.1 --intervals 8
control start-up --pumps 2 --stroke 2 --intervals 8
control keep-hopping --damping 0.01 --intervals 6 --follow damping:0.02
control keep-hopping --damping 0.01 --actuator force:y1-y2 --force 0.5 --intervals 8
control keep-hopping --machine leg.toml --damping 1 --intervals 6
explore --no-browser --port 0
explore --spring cubic --set beta=0.3 --rest-length 8
explore --machine leg.toml
""".strip().splitlines()
COMMANDS = sorted({line.split()[0] for line in LINES})
TOML = {
    "leg.toml": "[si]\nbody_mass = 60\nfoot_mass = 3\nstiffness = 8000\nrest_length = 0.8\n",
    "ground.toml": "[ground]\nmass = 2.0\nstiffness = 50.0\n",
    "wheel.toml": 'machine = "wheel"\n[parameters]\ninertia_ratio = 1.0\ngravity_ratio = 0.5\n',
    "design.toml": 'spring = "cubic"\nrest_length = 30\n[parameters]\nbeta = 0.3\n[design]\nminimise = "alpha"\n'
    "[design.over]\nbeta = [0.1, 0.5]\n",
    "front.toml": 'spring = "cubic"\nrest_length = 30\n[parameters]\nbeta = 0.3\n[design]\nminimise = ["alpha", '
    '"mass_ratio*period"]\npoints = 3\n[design.over]\nbeta = [0.1, 0.5]\nmass_ratio = [0.5, 2]\n',
}
DEEP = "[" * 60_000


def make_files(folder: Path) -> None:
    """The files that calls name: good ones, and ones that are deep, huge, cut, empty, of another kind, or folders."""
    for name, text in TOML.items():
        (folder / name).write_text(text)
    cubic = Hopper("cubic", rest_length=20, parameters={"beta": 0.3})
    orbit = orbits.find(cubic)
    text = orbit.save(folder / "orbit.json").read_text()
    follow(cubic, "beta", 0.2, 0.1, longest=0.5).save(folder / "family.jsonl")
    orbits.find(problems.rimless_wheel(inertia_ratio=1.0, gravity_ratio=0.5)).save(folder / "wheel.json")
    orbits.sweep(cubic, {"beta": [0.1, 0.2]}, store=folder / "store.db", progress=False)
    with suppress(InputError):  # without python-flint
        orbits.prove(orbits.find(Hopper())).save(folder / "proof.json")
    (folder / "rows.csv").write_text(
        "r;f\n" + "\n".join(f"{r / 4};{r / 4 + 0.02 * (r / 4) ** 3}" for r in range(-60, 61))
    )
    (folder / "designs.csv").write_text("beta,mass_ratio\n0.1,1\n0.2,2\n")
    for ending in ("json", "jsonl", "csv", "toml", "db"):
        (folder / f"deep.{ending}").write_text(DEEP)
        (folder / f"empty.{ending}").touch()
        (folder / f"cut.{ending}").write_text(text[: len(text) // 2])
        (folder / f"bytes.{ending}").write_bytes(bytes(range(256)) * 40)
        (folder / f"folder.{ending}").mkdir()
        with open(folder / f"huge.{ending}", "wb") as file:
            file.truncate(1 << 31)
    nested = text
    for value in ("null", DEEP[:900] + "]" * 900, '"x"', "1e400"):
        nested = re.sub(r'"alpha": ?[-\d.e]+', f'"alpha": {value}', text, count=1)
        (folder / f"alpha{len(value)}.json").write_text(nested)
    with closing(sqlite3.connect(folder / "deep_question.db")) as store:
        store.execute("CREATE TABLE question (format TEXT, document TEXT)")
        store.execute("CREATE TABLE members (member INTEGER PRIMARY KEY, digest_of_row TEXT)")
        store.execute("INSERT INTO question VALUES ('persistent-orbits sweep 1', ?)", (DEEP,))
        store.commit()


def restore(folder: Path, whole: dict[Path, tuple[os.stat_result, bytes]]) -> None:
    """Undo what a call has written, so that no call depends on those before."""
    for path in folder.iterdir():
        if path.is_file() and path not in whole and not path.name.startswith("huge"):
            path.unlink()
    for path, (before, content) in whole.items():
        if not path.exists() or path.stat().st_mtime_ns != before.st_mtime_ns:
            path.write_bytes(content)
            os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def paths(folder: Path) -> list[str]:
    """Names of files that are good, bad or cannot be."""
    good = [str(each) for each in sorted(folder.iterdir())]
    names = [f"new.{ending}" for ending in ("json", "csv", "jsonl", "db", "png", "gif", "nc", "pdf", "x")]
    bad = [
        "",
        "\0.json",
        "\ud800.csv",
        "x" * 300,
        *(f"{'x' * 300}.{end}" for end in ("json", "db", "csv", "toml", "png")),
    ]
    bad += ["/", ".", "/dev/full", "/dev/zero", "/proc/x.json", "/sys/x.db", "no/where.json", "no/where.db", "no/a.png"]
    return [*good, *(str(folder / name) for name in names), *bad, "orbit.json/x.json", "d/" * 3000 + "a.json"]


def crafted_toml(rng: random.Random) -> str:
    """A file of a design with a value that no one means."""
    name, text = rng.choice([*TOML.items()])
    lines = text.splitlines()
    at = rng.choice([i for i, line in enumerate(lines) if "=" in line])
    value = rng.choice((rng.choice(NUMBERS), json.dumps(rng.choice(FORMULAS)), "[]", "{}", "[nan, 1]", "[0.1, 0.1]"))
    lines[at] = f"{lines[at].split('=')[0]}= {value}"
    if name == "design.toml" and rng.random() < 0.5:
        extra = (
            "starts = 'global'",
            "subject_to = ['alpha <= nan']",
            "subject_to = ['x <= 1']",
            "seed = -1",
            "starts = 9",
        )
        lines.insert(lines.index("[design]") + 1, rng.choice(extra))
    return "\n".join(lines)


def text_for(option: click.Parameter, folder: Path, rng: random.Random) -> str:
    """A value of an option that no one means: mostly of its kind."""
    name, mark = option.name or "", option.metavar or ""
    if rng.random() < 0.1:
        return rng.choice((*NUMBERS, *RANGES, *NAMES, *FORMULAS))
    if "FILE" in mark or isinstance(option.type, click.Path) or name == "file":
        return rng.choice(paths(folder))
    if name in ("spring", "gravity", "quantities", "actuator", "colour", "quantity", "event"):
        return rng.choice(FORMULAS)
    if "=" in mark or name == "follow":
        mark = ":" if name == "follow" else "="
        ranges = "RANGE" in (option.metavar or "") or ":" in (option.metavar or "")
        value = rng.choice(RANGES if ranges else NUMBERS if rng.random() < 0.3 else EXTREMES)
        return rng.choice((f"{rng.choice(NAMES)}{mark}{value}", f"beta{mark}{value}", value))
    if name in ("along", "goal", "outcome", "sampling", "cost", "method", "machine"):
        return rng.choice((*NAMES, *FORMULAS[:12], "grid", "map", "work", "shooting", "wheel", "runner", "hopper"))
    if mark.startswith("A:B") or mark.startswith("A|") or "," in mark:
        return rng.choice((*RANGES, *NUMBERS))
    parsed = WHOLE if isinstance(option.type, click.types.IntParamType) else EXTREMES
    return rng.choice(NUMBERS if rng.random() < 0.2 else parsed)


def crafted_line(verb: str, folder: Path, rng: random.Random) -> list[str]:
    """A line of a command with some options replaced or added."""
    (folder / "crafted.toml").write_text(crafted_toml(rng), encoding="utf-8", errors="surrogateescape")
    line = rng.choice([line for line in LINES if line.split()[0] == verb])
    stated = re.sub(r"[\w.]+\.(json|jsonl|csv|toml|db|png)\b", lambda found: str(folder / found[0]), line).split()[1:]
    options = [
        each for each in commands.commands[verb].params if isinstance(each, click.Option) and each.name != "limit"
    ]
    for option in rng.sample(options, min(len(options), rng.choice((1, 1, 1, 2, 3)))):
        flag = option.opts[-1]
        if option.is_flag:
            stated.append(flag)
            continue
        value = text_for(option, folder, rng)
        if flag in stated and rng.random() < 0.8:
            stated[stated.index(flag) + 1] = value
        else:
            stated += [flag, value]
    if stated and not stated[0].startswith("-") and rng.random() < 0.15:
        stated[0] = rng.choice((*paths(folder), *NUMBERS))
    return [verb, *stated]


# ---- from Python


FILES = {"Orbit": Orbit, "Family": Family, "Sweep": Sweep}


def odd(value: Any, folder: Path, rng: random.Random, name: str = "") -> Any:
    """A value in place of an argument that no one means: mostly of its kind."""
    if rng.random() < 0.15:
        return rng.choice(ODD)
    if name in ("output", "store", "path", "start"):
        return rng.choice(paths(folder))
    if isinstance(value, bool):
        return rng.random() < 0.5
    if isinstance(value, int | float):
        return rng.choice(FLOATS)
    if isinstance(value, str):
        return rng.choice((*NAMES, *FORMULAS))
    if isinstance(value, dict) and value:
        key = rng.choice(list(value))
        rest = {each: inside for each, inside in value.items() if each != key or rng.random() < 0.3}
        return {**rest, rng.choice((key, rng.choice(NAMES))): odd(value[key], folder, rng)}
    if isinstance(value, tuple | list | np.ndarray) and len(value):
        some = list(value)
        some[rng.randrange(len(some))] = odd(some[0], folder, rng)
        return type(value)(some) if isinstance(value, tuple | list) else rng.choice((some, [], some * 1000))
    return rng.choice((*ODD, *FLOATS, *NAMES, *FORMULAS[:9], {"alpha": np.nan}, {"beta": (0, np.inf)}, [4.0], (4, 5)))


def crafted_arguments(function: Callable, known: dict[str, Any], folder: Path, rng: random.Random) -> dict[str, Any]:
    """The arguments of a call with some replaced or added."""
    kinds = (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)
    stated = {each.name: each.default for each in signature(function).parameters.values() if each.kind in kinds}
    own, known = ("machine", "scene", "limit", "executor", "client", "axes"), {**known}
    some = [name for name in {**stated, **known} if name not in own]
    for name in rng.sample(some, min(len(some), rng.choice((1, 1, 1, 2)))):
        known[name] = odd(known.get(name, stated.get(name)), folder, rng, name)
    return known


# ---- a call and its watch


def clocks() -> tuple[float, float]:
    """The seconds of the processor, which threads use up together, and of the clock, which other programs slow."""
    return time.process_time(), time.perf_counter()


class Terminal(io.StringIO):
    """The error stream of a terminal, which notes when it was last written to."""

    heard = (0.0, 0.0)

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        Terminal.heard = clocks()
        return super().write(text)


class Outcome(NamedTuple):
    """How a call ends, in a word; what it says; and the values that no one means."""

    kind: str
    said: str = ""


class Silence(BaseException):
    """A call that has said nothing for too long, or does not heed an interrupt."""


def by_command(arguments: list[str], said: Terminal) -> Outcome:
    """How a command ends."""
    out = io.StringIO()
    own = mock.patch.multiple("problems.explorer.server", run=mock.DEFAULT)
    with mock.patch.object(sys, "argv", ["orbits", *arguments]), redirect_stdout(out), redirect_stderr(said), own:
        try:
            command()
        except SystemExit as end:
            code = end.code
    text, words = out.getvalue(), said.getvalue()
    if "internal error" in words or "Traceback" in words or code not in (0, 1, 2, 130):
        return Outcome("fault", f"code {code}: {words[-300:]}")
    # A file may be called nan.
    if code == 0 and any(has_nan(each) for each in (text, *(each for each in arguments if not os.path.exists(each)))):
        return Outcome("fault", f"nan in the result or in a value: {text[:300]}")
    return Outcome({0: "result", 1: "no orbit", 2: "refused", 130: "interrupted"}[code], words)


def has_nan(text: str) -> bool:
    return bool(re.search(r"(?<![\w.])nan(?!\w)", text))


def is_table(result: Any) -> bool:
    """Whether a result is columns of numbers, in which NaN stands for what is missing."""
    columns = isinstance(result, dict) and any(isinstance(each, np.ndarray | list) for each in result.values())
    return columns or isinstance(result, np.ndarray) or hasattr(result, "columns")


def by_python(function: Callable, arguments: dict[str, Any], folder: Path) -> Outcome:
    """How a call from Python ends; its result is printed and saved."""
    try:
        result = function(**arguments)
        text = "" if is_table(result) else str(result)
        if hasattr(result, "document") and result.document_is_whole:
            json.dumps(result.save(folder / "saved.json").read_text())
    except InputError as error:
        return Outcome("refused", str(error))
    except (NoOrbit, OrbitsError) as error:
        return Outcome("no orbit", str(error))
    except TypeError as error:
        own = "unexpected keyword" in str(error) or "required" in str(error)
        return Outcome("refused" if own else "fault", f"TypeError: {error}")
    except KeyboardInterrupt:
        return Outcome("interrupted")
    except Exception as error:
        return Outcome("fault", f"{type(error).__name__}: {error}"[:300])
    accepted = any(isinstance(each, float) and each != each for each in arguments.values())
    return (
        Outcome("fault", f"nan in the result or in a value: {text[:300]}")
        if has_nan(text) or accepted
        else Outcome("result")
    )


def watched(call: Callable[[Terminal], Outcome]) -> Outcome:
    """How a call ends that is watched for warnings and silence, and interrupted where it takes long."""
    Terminal.heard = began, _ = clocks()
    said, stopped, pressed = Terminal(), [0.0], [0.0]

    def look(_: int, frame: Any) -> None:
        now, place = time.process_time(), f"{frame.f_code.co_filename}:{frame.f_lineno}"
        if stopped[0] and now - stopped[0] > HEEDED:
            raise Silence(f"an interrupt is not heeded, at {place}")
        silent = min(here - before for here, before in zip(clocks(), Terminal.heard, strict=True))
        if not stopped[0] and silent > SILENT:
            raise Silence(f"silent for {SILENT:g} s, at {place}")
        if now - began > LONGEST and now - pressed[0] > AGAIN:
            stopped[0], pressed[0] = stopped[0] or now, now
            os.kill(os.getpid(), signal.SIGINT)

    class Spoken(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            Terminal.heard = clocks()

    handler, before = Spoken(), signal.signal(signal.SIGPROF, look)
    logging.getLogger("orbits").addHandler(handler)
    signal.setitimer(signal.ITIMER_PROF, 0.5, 0.5)
    faulthandler.dump_traceback_later(900, exit=True)
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            found = call(said)
    except (Silence, KeyboardInterrupt) as error:
        return Outcome("fault", f"{error!r} after {time.process_time() - began:.0f} s")
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        logging.getLogger("orbits").removeHandler(handler)
        faulthandler.cancel_dump_traceback_later()
    if warned and found.kind != "fault":
        first = warned[0]
        return Outcome("fault", f"{first.category.__name__}: {first.message} ({first.filename}:{first.lineno})")
    return found


class Crafted(NamedTuple):
    """A crafted call: its verb, what it is in words, and itself."""

    verb: str
    text: str
    call: Callable[[Terminal], Outcome]


def crafted(number: int, seed: int, folder: Path, only: str | None = None) -> Crafted:
    """The call of a number."""
    rng = random.Random(f"{seed} {number}")
    if rng.random() < 0.5 if only is None else only in COMMANDS:
        verb = only or rng.choice(COMMANDS)
        line = crafted_line(verb, folder, rng)
        return Crafted(f"orbits {verb}", " ".join(line), lambda said: by_command(line, said))
    kind = rng.random() if only is None else 0.5 if only not in (*BUILDERS, *FILES) else float(only in FILES)
    if kind < 0.2:
        verb = only or rng.choice([*BUILDERS])
        build = getattr(problems, verb)
        given = crafted_arguments(build, BUILDERS[verb], folder, rng)
        function: Callable = lambda **a: orbits.find(build(**a), limit=5.0)  # noqa: E731
    elif kind > 0.95:
        verb, given = only or rng.choice([*FILES]), {"path": rng.choice(paths(folder))}
        function = FILES[verb].load
    else:
        name = rng.choice([*MACHINES])
        known_calls = calls(name, rng)
        verb = only or rng.choice([*known_calls])
        function, known = known_calls[verb]()
        given = crafted_arguments(function, known, folder, rng)
    text = f"{verb}({', '.join(f'{key}={value!r}'[:160] for key, value in given.items())})"
    return Crafted(verb, text, lambda said: by_python(function, given, folder))


def main(
    calls: int = 3000, first: int = 0, seed: int = 0, only: str | None = None, unnamed: bool = False
) -> dict[str, Any]:
    """The number of calls of each verb by how they end, and the faults."""
    counts, faults, began = defaultdict[str, Counter](Counter), list[str](), time.process_time()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which shells ignore in the background
    with tempfile.TemporaryDirectory() as name:
        folder, home = Path(name), Path.cwd()
        make_files(folder)
        whole = {
            path: (path.stat(), path.read_bytes())
            for path in folder.iterdir()
            if path.is_file() and not path.name.startswith("huge")
        }
        os.chdir(folder)
        try:
            for number in range(first, first + calls):
                each = crafted(number, seed, folder, only)
                found = watched(each.call)
                counts[each.verb][found.kind] += 1
                if found.kind == "fault":
                    faults.append(f"{number}: {ascii(each.text)[:500]}\n    {found.said}")
                    print(faults[-1], flush=True)
                elif unnamed and found.kind == "refused":
                    print(f"{number}: {ascii(each.text)[:300]}\n    {ascii(found.said)[:300]}", flush=True)
                restore(folder, whole)
                if (number - first + 1) % 100 == 0:
                    print(f"{number - first + 1} calls, {len(faults)} faults", flush=True)
        finally:
            os.chdir(home)
            for verb, count in sorted(counts.items()):
                print(f"  {verb}: {', '.join(f'{n} {kind}' for kind, n in count.most_common())}")
            done, seconds = sum(each.total() for each in counts.values()), time.process_time() - began
            print(f"{done} calls, {len(faults)} faults, {seconds:.0f} s of processor time", flush=True)
    return {"counts": counts, "faults": faults}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--calls", type=int, default=3000)
    parser.add_argument("--first", type=int, default=0, help="number of the first call")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", metavar="VERB", help="a command, a verb, a machine or a kind of file")
    parser.add_argument("--unnamed", action="store_true", help="print what refused calls say, too")
    arguments = parser.parse_args()
    raise SystemExit(bool(main(**vars(arguments))["faults"]))
