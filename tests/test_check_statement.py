"""The form of saved proofs, whose numbers are text, and their statements in words, which follow from their data."""

import json
from copy import deepcopy
from fractions import Fraction

import pytest
from proofs import restated
from steps import stepping

from orbits import InputError, Proof, check_returns, find, prove
from orbits.check_proof import check
from orbits.check_statement import Unverified, check_document, decimal, statement_of
from orbits.io import write_json
from problems import Hopper, inerter_hopper, springs

SLOW = pytest.mark.slow


@pytest.fixture(scope="module")
def document():
    """The quickest to verify."""
    return json.loads(json.dumps(prove(find(inerter_hopper()), motion=False).document()))


def tuned(name, value):
    orbit = find(Hopper("k*r", rest_length=60.0, parameters={"k": 2.0}), tune="k", at={name: value})
    return prove(orbit, at={name: str(value)})


def with_interval(machine, **intervals):
    return prove(find(machine), parameters=intervals, motion=False)


CUBIC = Hopper("r + b*r**3", mass_ratio=0.5, rest_length=12, parameters={"b": 0.3}, restitution=0.1)
ROWS = [-8, -4, 0, 4, 8], [-9, -4.2, 0, 4, 8]
PROOFS = {
    "restitution": lambda: prove(find(CUBIC)),
    "interval": lambda: with_interval(CUBIC, b=("0.2999", "0.3001")),
    "two parts": lambda: with_interval(inerter_hopper(), inertance=("0.198", "0.202")),
    "many digits": lambda: prove(find(CUBIC), 40, motion=False),
    "pieces": lambda: prove(find(Hopper(springs.bilinear(gap=0.5, ratio=2.0))), motion=False),
    "energy": lambda: prove(find(Hopper(springs.potential("r**2/2 + r**4/20"))), motion=False),
    "table": lambda: prove(find(Hopper(springs.table(ROWS, noise=0))), motion=False),
    "wheel": lambda: prove(find(stepping("wheel", 1.0, 0.5, 0.3, "r"))),
    "shuttle": lambda: prove(find(stepping("shuttle", 1.0, 0.5, 0.3, "r")), motion=False),
    **{name: lambda name=name, value=value: tuned(name, value)
       for name, value in (("frequency", 0.05), ("period", 20.0), ("liftoff_extension", 0.3), ("contact_time", 3.0))},
}  # fmt: skip


@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name == "wheel" else SLOW) for name in PROOFS])
def test_both_programs_say_the_same(name):
    """However the file is laid out, but for lists."""
    proof = PROOFS[name]()
    assert proof.proved, proof.reasons
    saved = json.loads(json.dumps(proof.document(), sort_keys=True))
    check_document(saved)
    assert statement_of(saved) == proof.statement


@pytest.mark.parametrize(
    ("said", "other"),
    [
        ("plastically", "elastically"),
        (".", ". It is stable."),
        ("flight time in [", "flight time in [0"),
        ("No other", ""),
    ],
)
def test_a_file_whose_printed_statement_differs_is_refused(document, said, other):
    false = document | {"statement": document["statement"].replace(said, other)}
    assert "the printed statement has " in check(false)[0]


def leaves(value, path=()):
    """The paths to all that is no list and no mapping."""
    if not isinstance(value, dict | list):
        return [path]
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    return [each for key, inner in pairs for each in leaves(inner, (*path, key))]


def changed(document, path, value):
    found = inner = deepcopy(document)
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return restated(found)


NOT_READ = ("about", "digits", "seconds", "statement")
HOSTILE = (0.3, ["0.3"], "1e-20000000", "(")


def test_hostile_values_are_refused_with_a_reason(document):
    """In the place of each number and text; a false value of its own type is in `test_check_proof`."""
    for path in [each for each in leaves(document) if each[0] not in NOT_READ and each != ("machine", "name")]:
        for value in HOSTILE:
            assert len(check(changed(document, path, value))) == 1, (path, value)


@pytest.mark.parametrize("value", [*HOSTILE, 1, 10**400, None, True, {}, "", "nan", "inf", "1/3", "0x1p3", "1_0",
                                   "1e2001", "1" * 4001, "\u0663", " 1", "--1", "1e", "e1", "-", "."])  # fmt: skip
def test_what_is_no_decimal(value):
    with pytest.raises(Unverified, match="not a text of decimal digits"):
        decimal(value)


def test_decimals():
    for text in ("0.3", "-1.25e-3", ".5", "5.", "007", "1E+2", "1e-1500"):
        assert decimal(text) == Fraction(text)


@pytest.mark.parametrize("name", ["hopper: all of what follows is true", "hopper. It is stable", "", "a" * 81, "a\nb"])
def test_a_name_that_reads_like_a_statement_is_refused(document, name):
    assert "might be read as a part" in check(changed(document, ("machine", "name"), name))[0]


def test_a_parameter_of_no_formula_is_refused(document):
    """Nothing is proved for its value."""
    false = deepcopy(document)
    false["machine"]["parameters"]["friction"] = false["parts"][0]["parameters"]["friction"] = ["0.05", "0.05"]
    false["parameters"]["friction"] = {"low": "0.05", "high": "0.05"}
    assert check(false) == ["no formula has the parameter 'friction'"]


@pytest.mark.parametrize("saved", [None, [], 3, "proof", {}, {"enclosures": {"machine": []}}])
def test_what_is_no_proof_is_refused(saved):
    assert len(check(saved)) == 1


def test_a_theorem_about_all_hops_of_a_period_is_refused_by_name(orbits, document, tmp_path):
    path = tmp_path / "proof.json"
    write_json(document | {"kind": "all hops"}, path, "proof")
    assert "prove_all_hops, which was removed" in check({"kind": "all hops"})[0]
    with pytest.raises(InputError, match="prove_all_hops, which was removed"):
        Proof.load(path)
    done = orbits(f"check-proof {path}")
    assert done.code == 1
    assert "prove_all_hops, which was removed" in done.out


def test_the_command_prints_what_it_verified(orbits, document, tmp_path, monkeypatch):
    path = tmp_path / "proof.json"
    write_json(document, path, "proof")
    done = orbits(f"check-proof {path}")
    assert " ".join(done.out.split()) == f"verified {document['statement']}"
    assert orbits(f"check-proof {path} --json").document["statement"] == document["statement"]
    monkeypatch.setattr(check_returns, "check", lambda *arguments: 1 / 0)
    done = orbits(f"check-proof {path}")
    assert (done.code, done.out) == (3, "")
    assert done.err.startswith("Traceback")
    assert "ZeroDivisionError: division by zero" in done.err
