"""Is a damaged file ever read as another one, and is an old file ever lost?

Files and stores of every kind that is read again are damaged at random: bits are flipped, digits changed, ends cut,
blocks zeroed. What is then read must be what was written, or a beginning of it that says so; everything else must be
refused. Then files are written over old ones while the disk lets them grow no further, and by processes that are killed
at random times: the old file, or the whole new one, must be there.
Run: python studies/damaged_files.py [--quick] [--count N] [--seed N]; disk faults need a system with fork
"""

import argparse
import logging
import os
import signal
import sqlite3
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from orbits import (
    Control,
    Design,
    Family,
    Front,
    InputError,
    Orbit,
    Sweep,
    bifurcations,
    existence,
    find,
    follow,
    optimize,
    pareto,
    prove,
    sweep,
)
from orbits.io import read_file, read_sealed, to_json
from problems import Driven, Hopper, hopper_in_si, steering

HOPPER = Hopper("cubic", rest_length=9.0, parameters={"beta": 0.3})
LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 1e5}, rest_length=0.8, damping=5.0)
OVER = {"beta": (0.1, 0.5)}
# How often each damage is drawn.
DAMAGES = {"flipped bits": 0.4, "changed digit": 0.3, "cut end": 0.15, "zeroed block": 0.15}
# Outcomes that are faults.
FAULTS = ("read as another", "internal error", "old file lost")


@dataclass(frozen=True)
class Kind:
    """A kind of file: what it holds as text, by the name of the file, and whether what was read is a beginning of it
    that says so."""

    path: Path
    read: Callable[[Path], Any]
    text: Callable[[Any], str] = to_json
    begins: Callable[[Any, Any], bool] = lambda read, whole: False


def made(folder: Path) -> dict[str, Kind]:
    """A file of every kind that is read again, and of documents that are only written."""
    orbit, in_si = find(HOPPER), find(LEG.with_values(damping=0.0))
    family = follow(HOPPER, "beta", stop=0.4, longest=0.1)
    design = optimize(HOPPER, minimise="alpha", over=OVER)
    front = pareto(HOPPER, minimise=("alpha", "-flight_time"), over=OVER, points=2)
    driven = steering.keep_hopping(Hopper(damping=0.01), intervals=20)
    control = Control(**{name: getattr(driven, name) for name in Control.__dataclass_fields__})
    diagram = bifurcations(Hopper(), "inject", (0.0, 0.01), (4.3, 4.7), samples=30)
    where = existence(HOPPER, "beta", (0.0, 0.2), "rest_length", [8.0, 9.0], samples=4)
    swept = sweep(HOPPER, {"beta": (0.0, 1.0)}, samples=64, store=folder / "store.db", progress=False)
    results = {"orbit": orbit, "orbit in SI": in_si, "family": family, "design": design, "front": front}
    results |= {"control": control, "driven": driven, "diagram": diagram, "existence": where, "sweep": swept}
    results["proof"] = prove(orbit, motion=False)
    paths = {
        name: result.save(folder / f"{name}.json{'l' if name == 'family' else ''}") for name, result in results.items()
    }
    read = {
        "orbit": (Orbit.load, lambda found: to_json(found.saved())),
        "orbit in SI": (Orbit.load, lambda found: to_json(found.saved())),
        "family": (Family.load, lambda found: "\n".join(found.records()), begins_family),
        "design": (lambda path: Design.load(path, HOPPER), lambda found: to_json(found.saved())),
        "front": (lambda path: Front.load(path, HOPPER), lambda found: to_json(found.document()) + str(found)),
        "control": (Control.load, lambda found: to_json(found.document())),
        "driven": (Driven.load, lambda found: to_json(found.document())),
        **dict.fromkeys(("diagram", "existence", "sweep", "proof"), (document, to_json)),
    }
    kinds = {name: Kind(path, *read[name]) for name, path in paths.items()}
    kinds["store"] = Kind(folder / "store.db", Sweep.load, members, begins_sweep)
    kinds["store, resumed"] = Kind(folder / "store.db", resumed, members)
    return kinds


def document(path: Path) -> Any:
    """The document of a file that has no reader of its own, as `orbits check-proof` reads it."""
    return read_file(path, f"{path} is not a saved document", read_sealed)


def members(found: Sweep) -> str:
    """The question and the members of a sweep."""
    return to_json([dict(found.about), found.document()])


def resumed(path: Path) -> Sweep:
    """The sweep that goes on with a store."""
    return sweep(HOPPER, {"beta": (0.0, 1.0)}, samples=64, store=path, progress=False)


def begins_family(read: Family, whole: Family) -> bool:
    """Whether a family says that it is not whole, and is the beginning of the other one."""
    same = read.points == whole.points[: len(read.points)] and read.events == whole.events[: len(read.events)]
    return same and read.end.kind == "interrupted" and replace(whole, points=(), events=(), end=read.end) == replace(
        read, points=(), events=()
    )  # fmt: skip


def begins_sweep(read: Sweep, whole: Sweep) -> bool:
    """Whether a sweep has fewer members than were asked for, each as in the whole one."""
    same = all(np.array_equal(read[name], whole[name][read.index], equal_nan=False) for name in ("alpha", "beta"))
    return same and len(read) < read.count and dict(read.about) == dict(whole.about)


def damaged(data: bytes, rng: np.random.Generator) -> tuple[str, bytes]:
    """A damage, and the data with it."""
    kind, new = str(rng.choice(list(DAMAGES), p=list(DAMAGES.values()))), bytearray(data)
    if kind == "flipped bits":
        for place in rng.integers(len(data), size=rng.integers(1, 4)):
            new[place] ^= 1 << int(rng.integers(8))
    elif kind == "changed digit":
        digits = [i for i, byte in enumerate(data) if 48 <= byte < 58]
        new[int(rng.choice(digits))] = 48 + int(rng.integers(10))
    elif kind == "cut end":
        del new[int(rng.integers(len(data))) :]
    else:
        first = int(rng.integers(len(data)))
        last = min(first + int(rng.choice([1, 64, 512, 4096])), len(data))
        new[first:last] = bytes(last - first)
    return kind, bytes(new)


def outcome_of(kind: Kind, path: Path, whole: Any, text: str, said: list[str]) -> str:
    """What becomes of reading a damaged file."""
    said.clear()
    try:
        read = kind.read(path)
    except InputError:
        return "refused"
    except Exception as error:  # what no caller expects is the fault that is looked for
        return f"internal error: {type(error).__name__}: {error}"
    if kind.text(read) == text:
        return "the same"
    if kind.begins(read, whole):
        return "a beginning, and said so"
    return "said to be unchecked" if said else "read as another"


class _Noted(logging.Handler):
    """What the logger says, in a list."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())


@contextmanager
def noted():
    """The list of what the logger says in the block, and nowhere else."""
    handler, logger = _Noted(), logging.getLogger("orbits")
    logger.addHandler(handler)
    before, logger.propagate = logger.propagate, False
    try:
        yield handler.said
    finally:
        logger.removeHandler(handler)
        logger.propagate = before


def damage_files(kinds: dict[str, Kind], count: int, folder: Path, rng: np.random.Generator) -> dict[str, Counter]:
    """The outcomes of so many damages, by kind of file."""
    found: dict[str, Counter] = {name: Counter() for name in kinds}
    with noted() as said:
        wholes = {name: kind.read(kind.path) for name, kind in kinds.items()}
        texts = {name: kind.text(wholes[name]) for name, kind in kinds.items()}
        for i in range(count):
            name = list(kinds)[i % len(kinds)]
            kind = kinds[name]
            damage, data = damaged(kind.path.read_bytes(), rng)
            path = folder / f"damaged{kind.path.suffix}"
            for each in folder.glob("damaged*"):  # also what SQLite has left beside it
                each.unlink()
            path.write_bytes(data)
            outcome = outcome_of(kind, path, wholes[name], texts[name], said)
            found[name][outcome.partition(":")[0]] += 1
            if outcome.startswith(FAULTS):
                print(f"  {name}, {damage}, damage {i}: {outcome}")
    return found


def writers() -> dict[str, Callable[[Path], object]]:
    """What writes a file whose bytes are the same each time, by its name."""
    from matplotlib import pyplot

    from orbits.show import save_figure

    os.environ["SOURCE_DATE_EPOCH"] = "0"  # the date in a figure
    orbit, family = find(HOPPER), follow(HOPPER, "beta", stop=0.4, longest=0.05)
    swept = sweep(HOPPER, {"beta": (0.0, 1.0)}, samples=64, progress=False)

    def figure(path: Path) -> None:
        save_figure(axes := orbit.plot(), path)
        pyplot.close(axes.figure)

    written = {"orbit.json": orbit.save, "family.jsonl": family.save, "family.csv": family.save}
    written |= {"sweep.json": swept.save, "sweep.csv": swept.save, "figure.png": figure, "figure.pdf": figure}
    try:
        import xarray  # noqa: F401
    except ImportError:
        pass
    else:
        written |= {"family.nc": family.save, "sweep.nc": swept.save}
    grows = {"grown.jsonl": lambda path: follow(HOPPER, "beta", stop=0.4, longest=0.05, output=path)}
    return written | grows | {"motion.gif": lambda path: orbit.animate(path, frames=3)}


def limit_growth(written: dict, count: int, folder: Path, rng: np.random.Generator) -> Counter:
    """The outcomes of writing over an old file where files may not grow beyond a random size."""
    import resource

    found, before = Counter[str](), resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    sizes = {name: _size_of(write, folder / name) for name, write in written.items()}
    try:
        for i in range(count):
            name = list(written)[i % len(written)]
            path = folder / name
            path.write_bytes(b"old")
            limit = int(rng.integers(sizes[name]))
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
            try:
                written[name](path)
                outcome = "written"
            except InputError:
                outcome = "refused"
            except Exception as error:  # as in `outcome_of`
                outcome = f"internal error: {type(error).__name__}: {error}"
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, before)
            if outcome == "refused" and path.read_bytes() != b"old":
                outcome = "old file lost"
            found[outcome.partition(":")[0]] += 1
            if outcome.startswith(FAULTS):
                print(f"  {name}, at most {limit} bytes: {outcome}")
    finally:
        signal.signal(signal.SIGXFSZ, handler)
    return found


def _size_of(write: Callable[[Path], object], path: Path) -> int:
    write(path)
    return path.stat().st_size


def kill_writers(written: dict, count: int, folder: Path, rng: np.random.Generator) -> Counter:
    """The outcomes of killing a process at a random time while it writes over an old file."""
    found, whole, seconds = Counter[str](), dict[str, bytes](), dict[str, float]()
    for name, write in written.items():
        began = time.perf_counter()
        write(folder / name)
        whole[name], seconds[name] = (folder / name).read_bytes(), time.perf_counter() - began
    for i in range(count):
        name = list(written)[i % len(written)]
        path = folder / name
        path.write_bytes(b"old")
        if not (child := os.fork()):
            try:
                written[name](path)
            finally:
                os._exit(0)
        time.sleep(rng.uniform(0, 2 * seconds[name]))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        content = path.read_bytes()
        # A family tells the time that it took nowhere, so that its lines are the same each time.
        outcome = {b"old": "the old file", whole[name]: "the new file"}.get(content, "old file lost")
        found[outcome] += 1
        if outcome in FAULTS:
            print(f"  {name}: {len(content)} bytes of {len(whole[name])}")
    return found


def told(counts: Counter) -> str:
    return ", ".join(f"{number} {outcome}" for outcome, number in counts.most_common())


def main(quick: bool = False, count: int | None = None, seed: int = 0) -> dict[str, Any]:
    """The outcomes of all damages and disk faults, and how many of them are faults."""
    rng, count = np.random.default_rng(seed), count or (26 if quick else 2600)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kinds = made(folder)
        with closing(sqlite3.connect(folder / "store.db")) as store:
            store.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        found: dict[str, Any] = {"files": damage_files(kinds, count, folder, rng)}
        for kind, counts in found["files"].items():
            print(f"  {kind}: {told(counts)}")
        if hasattr(os, "fork"):
            written = writers()
            found["full"] = limit_growth(written, count // 13, folder, rng)
            found["kills"] = kill_writers(written, count // 13, folder, rng)
            print(f"  files that may not grow: {told(found['full'])}\n  kills: {told(found['kills'])}")
    everything = sum((*found["files"].values(), *(found[key] for key in ("full", "kills") if key in found)), Counter())
    found["faults"] = sum(everything[fault] for fault in FAULTS)
    print(f"  {everything.total()} in all, faults: {found['faults']}")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a hundredth of the damages")
    parser.add_argument("--count", type=int, help="damages of files")
    parser.add_argument("--seed", type=int, default=0, help="of the random damages")
    arguments = parser.parse_args()
    raise SystemExit(bool(main(arguments.quick, arguments.count, arguments.seed)["faults"]))
