"""Shared by the tests: the reference values, and machines as they state them."""

import gc
import json
import os
import re
import shlex
import shutil
import signal
import sys
import tempfile
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # each worker has a core of its own

import numpy as np
import pytest
from carts import CART, HALF, SLED
from documents import saved

from orbits import Control, Family, Orbit, Proof, find, follow, prove, steer
from orbits.control import Guess, Input, Stage
from orbits.symbolic import caches
from problems import Driven, Hopper, hopper_in_si, steering
from problems.command.cli import main

DATA = Path(__file__).parent / "data"
REFERENCES = json.loads((DATA / "orbits.json").read_text(encoding="utf-8"))
PROVED = json.loads((DATA / "proved.json").read_text(encoding="utf-8"))
DAMPED_LEG = hopper_in_si(
    60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 1e5}, rest_length=0.8, damping=5.0
)

# Many tests are of the same machines, which a worker would build again and again with the caches of a single session.
caches.CACHE = caches.CACHE._replace(bytes=4 * caches.CACHE.bytes, results=4 * caches.CACHE.results)

# Shells let what they run in the background ignore keyboard interrupts, and so would all that the tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config):
    """Machine code is stored in a folder that all workers share: in one that is named, or one that ends with the
    tests."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        folder = config.getoption("--code", default=None)
        if folder is None:
            temporary = tempfile.TemporaryDirectory()
            config.add_cleanup(temporary.cleanup)
            folder = temporary.name
        os.environ["PERSISTENT_ORBITS_CACHE"] = os.path.abspath(folder)


def pytest_addoption(parser):
    text = "run each test with the first and the last of its parameters alone"
    parser.addoption("--few-of-each", action="store_true", help=text)
    text = "keep machine code in this folder for the next tests; write --code=FOLDER, as pytest takes FOLDER for a test"
    parser.addoption("--code", metavar="FOLDER", help=text)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """After -m and -k have left out what is not asked for, leave out more where that is asked, and order the rest."""
    if config.getoption("--few-of-each", default=False):
        keep_few_of_each(config, items)
    items.sort(key=turn)


# Nothing that is there once the tests are collected ends before they do; looking through it again and again takes long.
OFTEN = gc.get_threshold()
gc.set_threshold(100_000, 20, 100)


def pytest_collection_finish():
    """Garbage is what comes from now on."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(*OFTEN)


def turn(item) -> int:
    """When a test runs: a long one that began as the last would leave the other workers idle. The site is built after
    the studies and the pages, whose figures it shows."""
    if item.get_closest_marker("slow"):
        return 0 if item.path.parent.name == "studies" or item.path.name == "test_documentation.py" else 2
    return 1 if item.get_closest_marker("docs") else 3


def keep_few_of_each(config, items):
    """Keep each test with the first and the last of its parameters."""
    names = [item.nodeid.partition("[")[0] for item in items]
    last = {name: k for k, name in enumerate(names)}
    first = {name: k for k, name in reversed(list(enumerate(names)))}
    kept = {*first.values(), *last.values()}
    config.hook.pytest_deselected(items=[item for k, item in enumerate(items) if k not in kept])
    items[:] = [item for k, item in enumerate(items) if k in kept]


def pytest_runtest_setup(item):
    """Skip a test marked `posix` on other systems, and where a package is missing that its mark `extra` names."""
    if os.name != "posix" and item.get_closest_marker("posix"):
        pytest.skip("needs signals, limits or devices that this system does not have")
    for mark in item.iter_markers("extra"):
        for package in mark.args:
            pytest.importorskip(package)


@pytest.fixture(autouse=True)
def no_figures_left():
    """Close the figures of pyplot, which keeps those of all tests once one of them has loaded it."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture(scope="session")
def figures_of_site(tmp_path_factory) -> Path:
    """Where tests leave what they have drawn for the site, which need not be drawn once more: for a study in a folder
    of its name, for a block of a page in one with its code. All workers share it."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "figures_of_site"
    folder.mkdir(exist_ok=True)
    return folder


def leave(drawn: Path, place: Path, name: str) -> None:
    """Leave what has been drawn in a folder at another place, all at once."""
    shutil.copytree(drawn, place.with_name(f"{place.name} {name}")).rename(place / name)


def slow_after(count: int, cases) -> list:
    """The parameters of a test, with the mark `slow` on all but so many of the first."""
    rows = [case if isinstance(case, tuple) else (case,) for case in cases]
    marks = [[*getattr(row, "marks", ()), *[pytest.mark.slow][k < count :]] for k, row in enumerate(rows)]
    return [pytest.param(*getattr(row, "values", row), marks=each) for row, each in zip(rows, marks, strict=True)]


def middle(enclosure: dict) -> float:
    """The middle of a proved enclosure."""
    return float((Decimal(enclosure["low"]) + Decimal(enclosure["high"])) / 2)


def machine_of(reference: dict) -> Hopper:
    """The hopper of a reference orbit."""
    return Hopper(
        reference["spring"],
        reference["gravity"],
        reference["mass_ratio"],
        reference["rest_length"],
        parameters=reference["parameters"],
    )


def name_of(reference: dict) -> str:
    return f"{reference['spring']}, {reference['gravity']}, family {reference['family']}".replace(" ", "")


@pytest.fixture(params=REFERENCES, ids=name_of)
def reference(request) -> dict:
    """Each orbit of the reference file in turn."""
    return request.param


@pytest.fixture(scope="session")
def softening_family() -> Family:
    """The family of the cubic spring from linear to its fold, and back on the second sheet."""
    return follow(Hopper("cubic", rest_length=30.0), "beta", -0.02, 0.0, at=[-0.005])


@pytest.fixture(scope="session")
def saved_documents(tmp_path_factory) -> dict[str, str]:
    """Saved orbits, one of them in SI, and a saved family, as texts."""
    return saved(tmp_path_factory.mktemp("saved"))


@pytest.fixture(scope="session")
def leg_hop() -> Orbit:
    """The hop of a leg in SI."""
    return find(hopper_in_si(70, 5, stiffness=20_000, rest_length=1.0))


@pytest.fixture(scope="session")
def folded_curve() -> tuple[Family, Proof]:
    """The points of a family about its fold, and the proof that they are on one curve."""
    machine = Hopper("cubic", rest_length=30.0)
    family = follow(machine, "beta", stop=-0.02, start=0.0, most=60)
    first = next(i for i, point in enumerate(family) if point.alpha > 5.69)
    last = next(i for i, point in enumerate(family) if point.alpha > 5.98)
    whole = replace(family, points=family.points[first : last + 1], events=())
    return whole, whole.prove(machine, continuous=True, motion=False)


@pytest.fixture(scope="session")
def cubic_hop() -> Orbit:
    """The hop of a cubic spring."""
    return find(machine_of(REFERENCES[2]))


@pytest.fixture(scope="session")
def cubic_proof(cubic_hop) -> Proof:
    """What is proved of `cubic_hop`."""
    return prove(cubic_hop, loss=True)


@pytest.fixture(scope="session")
def driven_hopper() -> Driven:
    """The damped hopper driven so that it goes on hopping, whose inputs repeat."""
    return steering.keep_hopping(Hopper(damping=0.01))


@pytest.fixture(scope="session")
def started_hopper() -> Driven:
    """A start from rest, after which the machine hops on without inputs."""
    return steering.start_up(Hopper(), 2, stroke=2.0)


@pytest.fixture(scope="session")
def driven_leg() -> Driven:
    """A damped leg in SI that is driven to go on hopping."""
    return steering.keep_hopping(DAMPED_LEG, intervals=20)


@pytest.fixture(scope="session")
def steered_cart() -> Control:
    """A cart from rest to rest over the way 1 in the time 1 at least effort: f = 6 - 12 t."""
    ends = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - 1, x[1]]}
    stage = Stage(CART, 4, (1.0, 1.0), {"f": Input(degree=1)}, **ends, running=lambda x, p, q: p["f"] ** 2)
    return steer([stage], guess=[Guess(1.0, lambda t: [t, 1.0])])


@pytest.fixture(scope="session")
def steered_relay() -> Control:
    """The motion of `steered_cart` in two stages: a cart hands over to a sled, whose states and inputs are others."""
    effort = {"running": lambda x, p, q: p["f"] ** 2}
    first = Stage(CART, 2, (HALF, HALF), {"f": Input(degree=1)}, lambda x, before, p: x, **effort)
    second = Stage(
        SLED, 2, (HALF, HALF), {"f": Input(degree=1), "g": Input(1.0, 1.0)},
        lambda x, before, p: [x[1] - before[0], x[0] - before[1], x[2]], lambda x, p: [x[1] - 1, x[0]], **effort,
    )  # fmt: skip
    return steer([first, second], guess=[Guess(HALF, lambda t: [t, 1.0]), Guess(HALF, lambda t: [1.0, HALF + t, 0.0])])


def grazing_flights(count: int, seed: int):
    """Flight states (m, 4) of the linear hopper of equal masses, about `count`, whose gap has a lowest interior point
    1e-8 to 1e-1 above the ground or below it; when that comes (m,); and whether it is below (m,)."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(1.5, 6.0, count)
    depth = 10.0 ** rng.uniform(-8, -1, count) * rng.choice([-1, 1], count)
    # gap (1 + M) = w + u t - t^2/2 - size cos t bends up while cos t > 1/size; it is lowest at some time in between,
    # and the flight starts before that on the same arc, so that the gap falls all the way
    half = np.arccos(1 / size)
    lowest = rng.uniform(-0.5, 0.9, count) * half
    start = lowest - rng.uniform(0.3, 1.0, count) * (lowest + half)
    u = lowest - size * np.sin(lowest)
    w = 2 * depth - (u * lowest - lowest**2 / 2 - size * np.cos(lowest))
    r, v = size * np.cos(start), -size * np.sin(start)
    w, u = w + u * start - start**2 / 2, u - start
    states = np.column_stack([(w + r) / 2, (u + v) / 2, (w - r) / 2, (u - v) / 2])
    above = states[:, 2] > 0
    return states[above], (lowest - start)[above], depth[above] < 0


@dataclass(frozen=True)
class Result:
    """How a run ended."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> dict:
        """Standard output as JSON; fails where there is anything beside one document."""
        return json.loads(self.out)

    @property
    def answer(self) -> dict:
        """The document without what differs between two runs."""
        return {name: value for name, value in self.document.items() if name != "seconds"}


@pytest.fixture
def orbits(monkeypatch, capsys):
    """Run the command in this process: a command line, and further arguments as they are."""
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)  # of a notebook that another test ran here

    def run(line: str, *arguments) -> Result:
        monkeypatch.setattr(sys, "argv", ["orbits", *shlex.split(line), *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capsys.readouterr()
        printed = err if "--json" in sys.argv else out + err
        ours = printed.partition("Traceback (most recent call last)")[0]  # Python prints that in lines of its own
        assert max(map(len, ours.splitlines()), default=0) <= 80, "a line is wider than a terminal"
        return Result(end.value.code, out, re.sub("\n  (?=[^ ])", " ", err))

    return run


@pytest.fixture
def any_digest(monkeypatch):
    """Files whose content was changed pass for whole, as whoever crafts one can give it the right digest."""

    def without_digest(document, before=""):
        plain = isinstance(document, dict)
        return {name: value for name, value in document.items() if name != "digest"} if plain else document

    for module in ("orbits.io", "orbits.continuation.family", "orbits.periodic.orbit"):
        monkeypatch.setattr(f"{module}.unsealed", without_digest)
