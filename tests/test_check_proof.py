"""Saved proofs verified by a second program, which sees false ones."""

import copy
import json
from decimal import Decimal
from fractions import Fraction

import pytest
from conftest import slow_after
from flint import arb
from proofs import restated
from steps import TABLE, stepping

from orbits import find, find_all, prove
from orbits.check_formulas import in_pieces, number, tree
from orbits.check_proof import MAPS, Values, check
from orbits.check_statement import OutOfTime
from orbits.io import write_json
from problems import Chain, Hopper, Juggler, hopper_in_si, inerter_hopper
from problems.laws import springs

SLOW = pytest.mark.slow


def saved(proof):
    return json.loads(json.dumps(proof.document()))


@pytest.fixture(scope="module")
def inerter():
    """The quickest to verify."""
    return saved(prove(find(inerter_hopper())))


ROWS = ([-8.0, -4.5, -1.5, 0.0, 1.25, 4.0, 8.0], [-9.1, -4.8, -1.5, 0.0, 1.3, 4.2, 9.1])


@pytest.fixture(scope="module")
def bilinear():
    return saved(prove(find(Hopper("bilinear", rest_length=20.0)), motion=False))


@pytest.fixture(scope="module")
def table():
    return saved(prove(find(Hopper(springs.table(ROWS, noise=0), rest_length=20.0)), motion=False))


def chain():
    machine = Chain([1, 1, 1])
    return find_all(machine, machine.starts(5, 5))[0]


PROOFS = {
    "juggler": lambda: prove(find(Juggler("r + 0.1*r**3"))),
    "gravity": lambda: prove(find(Hopper("sinh(r)", "1/(1 + z/R)**2", rest_length=8.0, parameters={"R": 50.0}))),
    "SI": lambda: prove(find(hopper_in_si(60.0, 3.0, force="8000*r + 2e6*r**3", rest_length=0.8))),
    "family 2": lambda: prove(find(Hopper("r", rest_length=30.0), 2)),
    "interval": lambda: prove(
        find(Hopper("r + b*r**3", parameters={"b": 0.3})), parameters={"b": ("0.29999", "0.30001")}
    ),
    "many digits": lambda: prove(find(inerter_hopper()), 50),
    "three masses": lambda: prove(chain()),
    "bilinear": lambda: prove(find(Hopper("bilinear", rest_length=20.0))),
    "launch at a breakpoint": lambda: prove(find(Hopper(springs.bilinear(gap=1.0, ratio=2.0), rest_length=20.0))),
    "end stops": lambda: prove(find(Hopper("end_stops", "exp(-z/H)", 1.0, 20.0, parameters={"H": 90.0}))),
    "interval of stiffnesses": lambda: prove(
        find(Hopper(springs.bilinear(gap=0.5, ratio=2.0))), parameters={"ratio": ("1.99999", "2.00001")}
    ),
    "table": lambda: prove(find(Hopper(springs.table(ROWS, noise=0), rest_length=20.0))),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name == "bilinear" else SLOW) for name in PROOFS])
def test_true_theorems_are_verified(name):
    proof = PROOFS[name]()
    assert proof.proved, proof.reasons
    assert check(saved(proof)) == []


def test_a_theorem_of_existence_alone_is_verified():
    assert check(saved(prove(find(inerter_hopper()), motion=False))) == []


def moved(pair, by):
    return [str(Decimal(each) + Decimal(by)) for each in pair]


def change(document, path, value):
    *before, last = path
    for key in before:
        document = document[key]
    document[last] = value(document[last]) if callable(value) else value


def repeated(document):
    """A file that repeats what it says is verified again."""
    shown = [
        {name: {"low": low, "high": high} for name, (low, high) in pairs.items()}
        for pairs in (document["enclosures"], document["machine"]["parameters"])
    ]
    radius = document["parts"][0]["uniqueness_radius"] if len(document["parts"]) == 1 else None
    return restated(document | shown[0] | {"parameters": shown[1], "uniqueness_radius": radius})


UNKNOWNS = ("parts", 0, "unknowns")
FALSE = {
    "alpha": (*UNKNOWNS, "alpha", lambda pair: moved(pair, "1e-17")),
    "liftoff": (*UNKNOWNS, "liftoff", lambda pair: moved(pair, "-1e-17")),
    "flight time": (*UNKNOWNS, "flight_time", lambda pair: moved(pair, "1e-16")),
    "contact time": (*UNKNOWNS, "contact_time", lambda pair: moved(pair, "1e-16")),
    "not an unknown": ("parts", 0, "unknowns", lambda unknowns: {"alpha": unknowns["alpha"]}),
    "all alphas": ("enclosures", "alpha", lambda pair: moved(pair, "1e-17")),
    "uniqueness": ("parts", 0, "uniqueness_radius", "3"),
    "no uniqueness": ("parts", 0, "uniqueness_radius", "-1e-9"),
    "family": ("family", 2),
    "extension": ("enclosures", "mid_flight_extension", lambda pair: moved(pair, "1e-15")),
    "extension at lift-off": ("enclosures", "liftoff_extension", lambda pair: moved(pair, "1e-17")),
    "a condition is missing": ("conditions", lambda c: {"clearance": "proved"}),
    "mass": ("machine", "masses", 0, 1, "body_mass + 1e-18"),
    "a cancelled mass": ("machine", "masses", 1, 1, "foot_mass + 1e16 - 1e16 + 1e-17"),
    "parameter": ("machine", "parameters", "inertance", ["0.2000000000000000001", "0.2000000000000000001"]),
    "parameter and part": ("parts", 0, "parameters", "inertance", ["0.2000000000000000001"] * 2),
    "spring": ("machine", "springs", 0, "force", ["r + 1e-18*r**3"]),
    "domain": ("machine", "springs", 0, "force", ["r*((r - 0.5)/(r - 0.5))"]),
    "root": ("machine", "springs", 0, "force", ["sqrt(r)**2"]),
    "logarithm": ("machine", "springs", 0, "force", ["r*log(r + 2)**0"]),
    "corner": ("machine", "springs", 0, "force", ["r + 0*abs(r)"]),
    "exponent": ("machine", "springs", 0, "force", ["r**1.0000000000000000000001"]),
    "gravity": ("machine", "gravity", "1 + 1e-18*z"),
    "counts": ("machine", "counts", "body"),
    "gap": ("machine", "gap", "foot + 1e-20*body"),
    "eliminated": ("machine", "eliminated", "body"),
    "unread": ("machine", "springs", 0, "force", ["r +"]),
    "unknown name": ("machine", "gravity", "1 + q"),
    "not proved": ("proved", False),
    "no format": ("format", "persistent-orbits proof 1"),
    "loss": ("enclosures", "loss_coefficient", ["1", "2"]),
    "pieces": ("machine", "springs", 0, lambda spring: {**spring, "breaks": ["1"], "force": ["r", "2*r - 1"]}),
    "a second part": ("parts", lambda parts: [*parts, {**parts[0], "uniqueness_radius": "3"}]),
    "no motion": ("motion", False),
    "no pushes": ("conditions", "contact_force", "undecided"),
}


# What is seen to be false only after the whole motion has been enclosed.
LONG = ("spring", "domain", "gravity", "exponent", "a cancelled mass", "gap")


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW if name in LONG else ()) for name in FALSE])
@pytest.mark.slow
def test_false_theorems_are_not_verified(inerter, name):
    document, (*path, value) = copy.deepcopy(inerter), FALSE[name]
    change(document, path, value)
    assert check(repeated(document))


# Of the first spring, of which the bilinear one is the law "r" below 0.5 and "gap + ratio*(r - gap)" above.
FALSE_PIECES = {
    "another gap": {"breaks": ["gap + 1e-15"], "force": ["r", "gap + 1e-15 + ratio*(r - gap - 1e-15)"]},
    "a jump": {"force": ["r", "gap + 1e-30 + ratio*(r - gap)"]},
    "a breakpoint less": {"force": ["r"], "breaks": []},
    "a breakpoint more": {"breaks": ["gap", "9"]},
    "an order": {"force": ["r", "gap + ratio*(r - gap)", "r"], "breaks": ["gap", "0.4"]},
    "no order": {"force": ["r", *["gap + ratio*(r - gap)"] * 2], "breaks": ["gap", "gap - 0.1"]},
    "a potential": {"potential": True},
    "rows too": {"rows": [["-9", "-9", "1", "0"], ["9", "9", "1", "0"]]},
}


@pytest.mark.parametrize("name", FALSE_PIECES)
def test_false_laws_in_pieces_are_not_verified(bilinear, name):
    document = copy.deepcopy(bilinear)
    assert document["machine"]["springs"][0]["breaks"] == ["gap"]
    document["machine"]["springs"][0] |= FALSE_PIECES[name]
    assert check(restated(document))


FALSE_ROWS = {
    "value": (3, 1, "1e-13"),
    "slope": (2, 2, "1.0000001"),
    "curvature": (4, 3, "0.3"),
    "order": (2, 0, "-4.6"),
    "reach": (0, 0, ""),
    "scale": (0, 0, ""),
}


@pytest.mark.parametrize("name", FALSE_ROWS)
@pytest.mark.slow
def test_false_rows_are_not_verified(table, name):
    document = copy.deepcopy(table)
    spring, (row, column, value) = document["machine"]["springs"][0], FALSE_ROWS[name]
    if name == "scale":
        spring["force"] = ["1.001"]
    elif name == "reach":
        del spring["rows"][:2]
    else:
        spring["rows"][row][column] = value
    assert check(restated(document))


def test_states_that_may_be_on_three_pieces():
    """Their hull holds the function on each of them."""
    r = tree("name", value="r")
    law = in_pieces([r, r + number(1), r + number(3)])
    for pieces, width in (((0,), 0), ((0, 1), 0.5), ((0, 1, 2), 1.5)):
        value = Values({r: arb(1)}, pieces)[law]
        assert all(value.contains(each) for each in (1, 2, 4)[: len(pieces)])
        assert abs(float(value.rad()) - width) < 1e-6


def step(kind, angle=None, law="r", family=1):
    """The proof of a wheel, rocker or shuttle."""
    return prove(find(stepping(kind, 1.0, 0.5, angle, law), family))


@pytest.mark.parametrize("case", [
    *((kind,) for kind in TABLE), *(pytest.param(case, marks=SLOW)
        for case in (("wheel", 0.3, "r + r**3"), ("wheel", 0.3, "tanh(3*r)/3"), ("rocker", 0.3, "r + asinh(r)"),
        ("shuttle", 0.3),
        ("rocker", 0.3, springs.end_stops(gap=0.2, stop=2.0)), ("wheel", None, "r", 2))),
])  # fmt: skip
def test_true_theorems_about_steps_are_verified(case):
    proof = step(*case)
    assert proof.proved, proof.reasons
    assert check(saved(proof)) == []


@pytest.fixture(scope="module", params=["wheel", "shuttle"])
def stepped(request):
    return saved(step(request.param, 0.3))


BACK = [["theta", "2*angle - theta"], ["phi", "2*angle - phi"]]
FALSE_STEPS = {
    "reversor": ("reversor", [BACK[0], ["phi", "2*angle - phi + 1e-30"]]),
    "no reversor": ("reversor", []),
    "another reversor": ("reversor", [["theta", "theta"], BACK[1]]),
    "a square": ("reversor", [["theta", "2*angle - theta + theta**2"], BACK[1]]),
    "symmetry": ("symmetry", 1, 1, lambda text: f"{text} + 1e-30"),
    "symmetry of the gap": ("symmetry", 0, 1, lambda text: f"{text} + 1e-30"),
    "no symmetry": ("symmetry", []),
    "no coordinate": ("symmetry", 1, 0, "ph"),
    "gap that opens": ("gaps", 0, 1, "2*theta"),
    "gap that lands": ("gaps", 1, 1, "2*angle - theta + 1e-30"),
    "a third gap": ("gaps", lambda gaps: [*gaps, gaps[0]]),
    "spring": ("springs", 0, "force", ["r + 1e-30*r**2"]),
    "offset": ("springs", 0, "force", ["r + 1e-30"]),
    "slope": ("potentials", 0, lambda text: f"{text} + 1e-30*theta"),
    "inertia": ("inertia", [["1", "1e-30*theta"], ["1e-30*theta", "1/mu"]]),
}


@pytest.mark.parametrize("name", FALSE_STEPS)
def test_maps_that_do_not_turn_the_motion_back_are_not_verified(stepped, name):
    document, (*path, value) = copy.deepcopy(stepped), FALSE_STEPS[name]
    change(document["machine"], path, value)
    (reason,) = check(restated(document))
    assert any(text in reason for text in ("do not reverse", "must be mapped", "are not mapped", "not a coordinate"))


def test_other_false_theorems_about_steps_are_not_verified(stepped):
    assert check(restated(stepped | {"family": 2})) == ["the family is wrong"]
    machine = stepped["machine"]
    assert check(restated(stepped | {"machine": {name: each for name, each in machine.items() if name not in MAPS}}))
    document = copy.deepcopy(stepped)
    change(document, (*UNKNOWNS, "contact_time"), lambda pair: moved(pair, "1e-16"))
    assert check(repeated(document))


# What the file says a second time, or says of which nothing is verified.
SAID = {
    "alpha": ("alpha", "low", "1"),
    "flight time": ("flight_time", {"low": "9", "high": "9.1"}),
    "no contact time": ("contact_time", None),
    "uniqueness": ("uniqueness_radius", "1e9"),
    "radius": ("radius", "1e-30"),
    "parameters": ("parameters", "inertance", "low", "0.1"),
    "units": ("units", "SI"),
    "reasons": ("reasons", ["one"]),
    "bounce": ("bounce_side", "above"),
    "attraction": ("attraction_radius", "0.1"),
    "loss": ("loss_coefficient", {"low": "1", "high": "2"}),
    "injection": ("machine", "injection", ["0.1", "0.1"]),
    "restitution": ("machine", "restitution", "1.5"),
    "a damper": ("machine", "springs", 0, "damping", "1"),
    "a second piece": ("machine", "springs", 0, "force", ["r", "r**3"]),
    "a name twice": ("machine", "coordinates", ["body", "foot", "inertance"]),
}


@pytest.mark.parametrize("name", SAID)
def test_what_the_file_says_again_or_beside_is_held_against_the_rest(inerter, name):
    document, (*path, value) = copy.deepcopy(inerter), SAID[name]
    change(document, path, value)
    assert check(restated(document))


def test_the_radius_is_no_less_than_that_of_the_enclosure(inerter):
    low, high = map(Fraction, inerter["enclosures"]["alpha"])
    assert (high - low) / 2 <= Fraction(inerter["radius"]) <= (high - low) * Fraction(51, 100)


def test_what_cannot_be_read_is_not_verified(inerter):
    for key in ("machine", "parts", "enclosures", "conditions"):
        assert check({name: value for name, value in inerter.items() if name != key})


@pytest.mark.parametrize(
    "name", slow_after(3, ["r", "pi", "alpha", "liftoff", "flight_time", "mid_flight_extension", "foot"])
)
def test_a_name_that_stands_for_two_things_is_not_verified(inerter, name):
    """A parameter of the theorem, which is true of it with any other name."""
    renamed = [restated(json.loads(json.dumps(inerter).replace("inertance", each))) for each in (name, "other")]
    assert [check(each) for each in renamed] == [["a name stands for two things, or is not a name"], []]


def test_the_command(orbits, tmp_path):
    path = tmp_path / "proof.json"
    assert orbits(f"prove --spring r --set x=1 --save {path}").code == 2
    proof = saved(prove(find(inerter_hopper()), motion=False))
    write_json(proof, path, "proof")
    assert orbits(f"check-proof {path}").out.startswith("verified")
    assert orbits(f"check-proof {path} --json").document["verified"] is True
    write_json(proof | {"proved": False}, path, "proof")
    done = orbits(f"check-proof {path} --json")
    assert done.code == 1
    assert done.document["reasons"]
    path.write_text("{", encoding="utf-8")
    assert orbits(f"check-proof {path}").code == 2


@pytest.mark.parametrize("hostile", ["a force that turns 10000 times", "parts that are cut in many cells"])
def test_a_hostile_file_is_out_of_time(inerter, orbits, tmp_path, hostile):
    """Both would take much longer than any theorem."""
    document = copy.deepcopy(inerter)
    if hostile.startswith("a force"):
        document["machine"]["springs"][0]["force"] = ["r + 1e-30*sin(10000*r)"]
    else:
        parts, names = document["parts"], [f"c{i}" for i in range(12)]
        document["machine"]["masses"][0][1] = " + ".join([document["machine"]["masses"][0][1], *names])
        whole = {name: ["0", "1"] for name in names}
        cut = {name: ["0.25", "0.75"] for name in names}
        document["machine"]["parameters"] |= whole
        document["parameters"] |= {name: {"low": "0", "high": "1"} for name in names}
        document["parts"] = [parts[0] | {"parameters": parts[0]["parameters"] | each} for each in (whole, cut)]
        document["uniqueness_radius"] = None
    with pytest.raises(OutOfTime):
        check(restated(document), limit=0.2)
    write_json(restated(document), path := tmp_path / "proof.json", "proof")
    done = orbits(f"check-proof {path} --limit 0.2")
    assert done.code == 2
    assert "within 0.2 s of processor time" in done.err


@pytest.mark.parametrize(
    ("module", "lines"),
    [("check_proof", 1000), ("check_formulas", 300), ("check_returns", 350), ("check_statement", 500)],
)
def test_it_is_small_and_needs_nothing_of_what_proves(module, lines):
    import ast
    from pathlib import Path

    import orbits

    text = Path(orbits.__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    assert text.count("\n") <= lines
    tree = ast.parse(text)
    imported = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    imported |= {alias.name for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names}
    own = {
        "contextlib",
        "contextvars",
        "dataclasses",
        "math",
        "time",
        "check_formulas",
        "check_proof",
        "check_statement",
    }
    standard = {"ast", "re", "collections.abc", "fractions", "functools", "itertools", "operator", "typing"}
    assert imported <= own | standard | {"flint"}
