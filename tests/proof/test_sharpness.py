"""What proofs state, and how narrow their enclosures are: a wider bound is not wrong, and may soon prove nothing."""

import re
from math import log10

import pytest
from recorded import known

from orbits import orbit_at, prove, prove_absence
from problems import Hopper


def digits(proof) -> dict[str, float]:
    """100 times the decimal digits of all widths and radii of a proof, and its number of parts."""
    widths = {name: each.width for name, each in proof.enclosures.items()}
    radii = {name: getattr(proof, name) for name in ("radius", "uniqueness_radius", "attraction_radius")}
    sizes = widths | {name: float(each) for name, each in radii.items() if each}
    for i, part in enumerate(proof.parts):
        sizes |= {f"{name} in part {i}": each.width for name, each in part.unknowns.items()}
        for within in ("within", "alone_within"):
            sizes |= {f"{name} {within} part {i}": float(x) for name, x in getattr(part, within, {}).items()}
    return {"parts": len(proof.parts)} | {name: round(-100 * log10(size)) for name, size in sizes.items() if size}


@pytest.fixture(scope="module")
def interval_proof(cubic_hop):
    """A hop for all parameters between two decimals."""
    return prove(cubic_hop, parameters={"beta": ("0.3", "0.301")})


CURVE = pytest.param("folded_curve", marks=pytest.mark.slow)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cubic_proof", CURVE, "interval_proof"])
def test_enclosures_are_as_narrow_as_before(name, request):
    proof = request.getfixturevalue(name)
    found = digits(proof[1] if isinstance(proof, tuple) else proof)
    assert found == pytest.approx(known("sharpness", name, found), abs=10)


@pytest.fixture
def flight_proof(cubic_hop):
    """A proof of the flight alone, with digits."""
    return prove(cubic_hop, 30, motion=False)


@pytest.fixture
def refused_proof(cubic_hop):
    """A proof of another machine, which fails."""
    return prove(cubic_hop, parameters={"beta": "0.4"})


@pytest.fixture
def collapse_proof(softening_family):
    """A root that is no motion."""
    machine, point = Hopper("cubic", rest_length=30.0), softening_family[-1]
    return prove(orbit_at(machine, point, "beta"), machine=machine.with_values(beta=point.value))


@pytest.fixture
def absence_proof():
    """Families that have no orbit."""
    return prove_absence(Hopper("tanh", parameters={"b": 0.3}), 2)


@pytest.mark.parametrize(
    "name",
    [
        *("cubic_proof", "flight_proof", "refused_proof", "absence_proof", CURVE),
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("interval_proof", "collapse_proof")),
    ],
)
def test_theorems_are_stated_as_before(name, request):
    """But for the digits of their numbers."""
    proof = request.getfixturevalue(name)
    proof = proof[1] if isinstance(proof, tuple) else proof
    texts = [
        str(proof.proved),
        proof.statement,
        *proof.reasons,
        *map("{0[0]}: {0[1]}".format, proof.conditions.items()),
    ]
    found = [re.sub(r"\d+\.\d+(e[-+]?\d+)?|\d+e[-+]?\d+", "#", text) for text in texts]
    assert found == known("theorems", name, found)
