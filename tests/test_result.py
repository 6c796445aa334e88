"""What every result can do, by one table; and machines and results stand in one line, and come back from a pickle as
they were, in another process too."""

import copy
import inspect
import json
import math
import pickle
import typing
from dataclasses import fields, is_dataclass
from functools import cache

import numpy as np
import pytest
from carts import STRAIGHT, cart
from columns import hop_of
from scipy.stats import norm

import orbits
import problems
from orbits import (
    InputError,
    ReturnMap,
    bifurcations,
    check,
    existence,
    find,
    follow,
    multipliers,
    optimize,
    orbit_at,
    pareto,
    period_diagram,
    prove,
    sensitivities,
    simulate,
    steer,
    sweep,
    uncertainty,
)
from orbits.continuation import Family
from orbits.control import hold
from orbits.design.design_curve import SeveralDesigns
from orbits.io import to_json
from orbits.laws import HystereticLaw
from orbits.model import CasadiMachine
from orbits.result import Result
from orbits.sweeps.indices import Indices
from problems import HeavyHand, Hopper, brachiator, gravity, hopper_in_si, springs, steering
from tests import recorded_hops


@cache
def made(kind: str):
    """A result of each kind."""
    cubic = Hopper("r + beta*r**3", mass_ratio=0.5, parameters={"beta": 0.3})
    family = lambda: follow(cubic, "beta", 0.35, at=[0.32])  # noqa: E731
    leg = hopper_in_si(60.0, 3.0, force="k*r", parameters={"k": 5000.0}, rest_length=0.8)
    flips = lambda: bifurcations(  # noqa: E731
        Hopper(), "inject", (0.06, 0.08), (4.5, 4.6), samples=50, sections=2, attractor=0
    )
    over = {"over": {"k": (3e3, 9e3)}, "subject_to": ["stroke <= 0.25"]}
    return {
        "Orbit": lambda: find(cubic),
        "Orbit in SI": lambda: find(leg),
        "Certificate": lambda: find(cubic).certificate,
        "Trajectory": lambda: find(cubic).flight,
        "Family": family,
        "Families": lambda: follow(cubic, "beta", 0.35, families=(1, 2)),
        "Point": lambda: family()[0],
        "Event": lambda: family().events[0],
        "End": lambda: family().end,
        "Orbit of a family": lambda: orbit_at(cubic, "beta", family()[-1], "relative"),
        "Oscillation": lambda: find(cubic, at={"energy": 0.5}),
        "OscillationFamily": lambda: follow(leg, "energy", (1.0, 50.0), longest=0.5),
        "OscillationEvent": lambda: made("OscillationFamily").events[0],
        "Swing": lambda: find(brachiator(), start={"angle": 1.2, "half_swing": 1.9}),
        "SwingFamily": lambda: follow(
            brachiator(), "arm_mass", 0.26, {"angle": 1.2, "half_swing": 1.9}, at=[0.255], longest=0.5
        ),
        "Existence": lambda: existence(cubic, "beta", (0.28, 0.32), "mass_ratio", [0.5, 0.6], samples=3),
        "Hops": lambda: ReturnMap(cubic)([[2.0, 4.0], [4.5, 7.0]]),
        "LaunchHops": lambda: ReturnMap(hop_of()[0])([[6.4, -1.2, 1.1], [-1.0, 0.0, 0.0]]),
        "ReturningHops": lambda: ReturnMap(hop_of()[0]).periodic_hop(hop_of()[1]),
        "HopMultipliers": lambda: multipliers(*hop_of()),
        "ReturnMap": lambda: ReturnMap(cubic, inject=0.03),
        "BifurcationDiagram": lambda: bifurcations(
            Hopper(), "inject", (0.06, 0.065), (4.5, 4.6), samples=50, sections=2, attractor=6
        ),
        "Simulation": lambda: simulate(Hopper(restitution=0.3, damping=0.01), 4.6, hops=2),
        "ContactEvent": lambda: simulate(Hopper(), 4.6, hops=1).events[0],
        "Control": lambda: steer([cart(duration=(1, 1))], guess=STRAIGHT),
        "Driven": lambda: steering.recover(Hopper(), 0.1, intervals=14),
        "Disturbed": lambda: made("Driven").simulate(1, launch_error=0.01),
        "Design": lambda: optimize(leg, minimise="loss_coefficient", **over),
        "DesignCurve": lambda: made("Design").follow("body_mass", 62.0, points=3),
        "Front": lambda: pareto(leg, minimise=("-centre_of_mass_rise", "largest_contact_force"), points=2, **over),
        "Sweep": lambda: sweep(leg, {"k": [3e3, 5e3], "body_mass": [55.0, 60.0]}, quantities=["stroke"]),
        "Proof": lambda: prove(find(cubic), motion=False),
        "Checked": lambda: check(cubic),
        "Uncertainty": lambda: uncertainty(leg, {"k": norm(5e3, 100.0)}, samples=16),
        "Sensitivities": lambda: sensitivities(leg, 1, ["k", "body_mass"], ["alpha", "stroke"]),
        "Indices": lambda: sweep(leg, {"k": (3e3, 5e3), "body_mass": (55.0, 60.0)}, 4).sensitivity("alpha", 16),
        "PeriodicHops": lambda: ReturnMap(Hopper(), inject=0.09).periodic_hops(2, 4.4, 4.7),
        "BifurcationCurve": lambda: flips().follow_event("flip", "mass_ratio", 1.05),
        "PeriodDiagram": lambda: period_diagram(
            Hopper(), {"inject": (0.05, 0.08), "mass_ratio": (0.9, 1.0)}, (4.3, 4.7), samples=(3, 2), longest=4
        ),
        "OptimalFamily": lambda: steer(
            [cart(end=lambda x, p: [x[0] - p["d"], x[1]])], {"d": 1.0}, guess=STRAIGHT
        ).follow("d", 1.2),
        "DrivenFamily": lambda: steering.keep_hopping(Hopper(damping=0.01), intervals=14).follow("damping", 0.02),
        "Basins": lambda: ReturnMap(Hopper(mass_ratio=0.05)).basins(4.4, 4.8, samples=100),
        "HeldLaunches": lambda: hold(find(Hopper()), "y1 - y2", force=1.0).launches([-0.02, 0.02], hops=3),
        "LaunchIntervals": lambda: ReturnMap(Hopper(mass_ratio=0.05)).basin(4.4, 4.8, samples=100),
        "HopFit": recorded_hops.short_fit,
        "SpringFit": lambda: springs.fit(springs.SAMPLE, "k*r + b*r**3", in_si=True),
    }[kind]()


# The results that are more than part of another one, and what each does with nothing but itself.
WHOLE = (
    *("Orbit", "Orbit in SI", "Family", "Families", "Sweep", "Existence", "Uncertainty", "Design", "Front", "Control"),
    "DesignCurve",
    *("Simulation", "Hops", "BifurcationDiagram", "Proof", "Checked", "Driven", "Disturbed", "SpringFit", "HopFit"),
    *(
        "Sensitivities",
        "Indices",
        "Basins",
        "LaunchIntervals",
        "BifurcationCurve",
        "PeriodDiagram",
        "OptimalFamily",
        "DrivenFamily",
    ),
    *("LaunchHops", "ReturningHops", "PeriodicHops", "HopMultipliers"),
    *("HeldLaunches", "Oscillation", "OscillationFamily", "Swing", "SwingFamily"),
)
RESULTS = (
    *WHOLE,
    *("Certificate", "Trajectory", "Point", "Event", "End", "ReturnMap", "ContactEvent", "OscillationEvent"),
)
VERBS = {
    "machine": lambda result: isinstance(result.machine, dict) and "machine" in result.machine,
    "units": lambda result: all(isinstance(each, str | None) for pair in result.units.items() for each in pair),
    "title": lambda result: "\n" not in result.title(),
    "print": lambda result: (
        " ".join(str(result).split()).startswith(result.title()) and max(map(len, str(result).splitlines())) <= 80
    ),
    "summary": lambda result: (
        result.summary()
        and all(isinstance(each, int | float | str | np.bool_ | None) for each in result.summary().values())
    ),
    "rows": lambda result: result.rows() and all(isinstance(text, str) for row in result.rows() for text in row),
    "table": lambda result: len({len(column) for column in result.table().values()}) == 1,
    "document": lambda result: isinstance(json.loads(to_json(result.document())), dict),
    "plot": lambda result: result.plot().figure,
}
FILES = ("json", "csv")
# What is not in the table of results and verbs, with the reason.
WITHOUT = {
    ("Control", "machine"): "a motion is of stages, and of no machine",
    ("OptimalFamily", "machine"): "motions are of stages, and of no machine",
    ("SpringFit", "machine"): "a spring may be that of any machine",
    ("HopFit", "machine"): "it is the machine itself",
    ("Proof", "plot"): "a theorem cannot be drawn",
    ("Checked", "plot"): "relations cannot be drawn",
}
# The machines that files do not hold.
OF_FILES = {
    **dict.fromkeys(("Design", "DesignCurve", "Front"), lambda result: getattr(result, "designs", (result,))[0].source),
    **dict.fromkeys(("Simulation", "DrivenFamily", "HeldLaunches", "HopFit", "Swing"), lambda result: result.source),
    "Disturbed": lambda result: made("Driven").source,
}


# What a result does not take along into a file or another process.
NOT_KEPT = ("warm_start", "source", "trail")


def same(a, b) -> bool:
    """Whether two results are equal in all that they hold, arrays to the last bit."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f") and a.flags.writeable == b.flags.writeable
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[name], b[name]) for name in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same, a, b))
    if hasattr(a, "ppf"):
        return (a.dist.name, a.args, a.kwds) == (b.dist.name, b.args, b.kwds)
    if isinstance(a, ReturnMap):
        return (a.machine, a.inject, a.cap) == (b.machine, b.inject, b.cap)
    if is_dataclass(a) and not hasattr(a, "model"):
        names = [each.name for each in fields(a) if each.name not in NOT_KEPT]
        return all(same(getattr(a, name), getattr(b, name)) for name in names)
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


# The tests of a result stand together in the order in which tests run, so that one process makes it.
each_result = pytest.mark.parametrize("kind", RESULTS, scope="module")
each_whole_result = pytest.mark.parametrize("kind", WHOLE, scope="module")


@each_result
def test_results(kind):
    result = made(kind)
    again = pickle.loads(pickle.dumps(result))
    assert same(again, result)
    assert str(again) == str(result)
    assert repr(again) == repr(result)
    assert "\n" not in repr(result)
    assert "0x" not in repr(result)
    assert len(repr(result)) < 200
    assert repr(result).startswith(type(result).__name__ + "(")


def test_the_table_of_results_has_all():
    """A class of results that is missing here is found by its base, which may be that of several."""
    for name in orbits.__all__:
        getattr(orbits, name)  # modules are loaded when their names are used
    found = {each.__name__ for each in (*Result.__subclasses__(), *SeveralDesigns.__subclasses__())}
    found = found - {"SeveralDesigns"} | {"Driven", "DrivenFamily", "HopFit"}
    assert found == {kind.removesuffix(" in SI") for kind in WHOLE}


# Names that modules import for type checkers alone.
IMPORTED_FOR_TYPES = {"Indices": Indices, "Proof": orbits.Proof, "HystereticLaw": HystereticLaw}
IMPORTED_FOR_TYPES |= {"CasadiMachine": CasadiMachine}
IMPORTED_FOR_TYPES |= {each.__name__: each for each in (orbits.DesignCurve, orbits.OptimalFamily)}
IMPORTED_FOR_TYPES |= {"DrivenFamily": problems.DrivenFamily}


def returned(module):
    """The classes in the annotations of what the public functions of a module return, and the methods of its classes,
    by the names of these."""
    here = [name for name, each in vars(module).items() if getattr(each, "__module__", "") == module.__name__]
    own = [name for name in here if not name.startswith("_")]
    for name in getattr(module, "__all__", own):
        each = getattr(module, name)
        functions = {name: each} if inspect.isfunction(each) else {}
        if inspect.isclass(each):
            members = inspect.getmembers(each, inspect.isfunction)
            functions = {f"{name}.{own}": member for own, member in members if not own.startswith("_")}
        for own, function in functions.items():
            yield own, set(classes_in(typing.get_type_hints(function, localns=IMPORTED_FOR_TYPES).get("return")))


def classes_in(hint):
    if isinstance(hint, type) and not typing.get_args(hint):
        yield hint
    for inner in typing.get_args(hint):
        yield from classes_in(inner)


# What is returned and is no result, with what it is.
NO_RESULTS = {
    "part of a result": {"Certificate", "Trajectory", "Point", "Event", "End", "Stretch", "Upkeep"},
    "a machine": {"Mechanism", "MachineInSI", "Chain", "Actuated", "ReturnMap", "CasadiMachine"},
    "a law": {"Law", "HystereticLaw"},
    "of the mechanics": {"LinearEquations", "Affine", "StateFormula", "Units", "Quantity"},
    "a page that is open": {"Exploration"},
    "an argument of other functions": {"Starts", "BranchPoint", "Hold"},
    "a tuple of parts": {"FixedPoints"},
}


@pytest.mark.parametrize("module", [orbits, problems, steering, springs, gravity], ids=lambda each: each.__name__)
def test_all_that_is_returned_is_in_the_table(module):
    """Each class that a public function or method returns is a result of the table, or is named as none."""
    named = {kind.removesuffix(" in SI") for kind in WHOLE} | set().union(*NO_RESULTS.values())
    ours = {
        f"{name}: {each.__name__}"
        for name, classes in returned(module)
        for each in classes
        if each.__module__.startswith(("orbits", "problems")) and each.__name__ not in named
    }
    assert not ours


@each_whole_result
def test_every_result_has_every_verb(kind, tmp_path):
    result = made(kind)
    lacking = {verb for verb, holds in VERBS.items() if (kind, verb) not in WITHOUT and not holds(result)}
    assert not lacking
    if (kind, "plot") in WITHOUT:
        with pytest.raises(InputError, match="cannot be drawn"):
            result.plot()
    for ending in FILES:
        path = tmp_path / f"result.{ending}"
        assert result.save(path) == path
        assert path.stat().st_size > 0
    json.loads((tmp_path / "result.json").read_text())
    head = (tmp_path / "result.csv").read_text().splitlines()[0]
    assert all(name in head for name in result.table())
    if kind in OF_FILES:
        with pytest.raises(InputError, match="machine"):
            type(result).load(tmp_path / "result.json")
    machines = (each(result) for key, each in OF_FILES.items() if key == kind)
    again = type(result).load(tmp_path / "result.json", *machines)
    assert type(again) is type(result)
    assert to_json(again.saved()) == to_json(result.saved())
    assert str(again) == str(result)
    assert repr(again) == repr(result)
    text = (tmp_path / "result.json").read_text()
    (tmp_path / "result.json").write_text(text.replace("1", "2", 1) if "1" in text[:40] else text[:-9])
    with pytest.raises(InputError, match="is not a saved"):
        type(result).load(tmp_path / "result.json")


@pytest.mark.extra("bokeh")
@each_whole_result
def test_every_result_has_a_page(kind, tmp_path):
    """It holds the table that a notebook shows, and what its plot draws as figures with zoom."""
    result = made(kind)
    page = result.page(tmp_path / "result.html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>")
    assert "<table" in page
    assert "No figure" not in page
    assert ("data-root-id" in page) == (not result.undrawn)


@pytest.mark.extra("xarray", "pandas")
@each_whole_result
def test_every_table_is_one_of_the_usual_kinds(kind, tmp_path):
    import pandas
    import xarray

    result = made(kind)
    frame = result.dataframe()
    assert set(result.table()) <= {*frame.columns, frame.index.name}
    assert all(name in frame and isinstance(unit, str) for name, unit in frame.attrs["units"].items())
    assert isinstance(result.dataset, xarray.Dataset)
    with xarray.open_dataset(result.save(tmp_path / "result.nc")) as data:
        assert len(data.variables) >= 1
    assert len(pandas.read_parquet(result.save(tmp_path / "result.parquet"))) == len(frame)


@pytest.mark.parametrize("kind", ["Orbit", "Orbit in SI", "Family"])
def test_the_machine_of_a_loaded_result_is_its_source(kind, tmp_path):
    result = made(kind)
    path, own = result.save(tmp_path / "result.json"), result.source
    again = type(result).load(path, own)
    assert again.source.describe() == own.describe()
    assert again == result
    with pytest.raises(InputError, match="is not a saved"):
        type(result).load(path, HeavyHand())


def test_a_family_in_one_document_and_in_lines(tmp_path):
    family, path = made("Family"), tmp_path / "family.json"
    assert json.loads(family.save(path).read_text())["along"] == "beta"
    assert Family.load(path) == family
    path.write_text(family.save(tmp_path / "family.jsonl").read_text())  # as earlier versions wrote under that name
    assert Family.load(path) == family


@pytest.mark.parametrize("kind", ["Orbit", "Family", "BifurcationDiagram"])
def test_copies_have_the_machine(kind):
    result = made(kind)
    for again in (copy.copy(result), copy.deepcopy(result), pickle.loads(pickle.dumps(result))):
        assert again.source.describe() == result.source.describe()
    motion = copy.deepcopy(made("Orbit"))
    assert np.array_equal(motion.spring_forces(1.0)["spring force"], made("Orbit").spring_forces(1.0)["spring force"])
