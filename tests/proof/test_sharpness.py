"""How narrow proved enclosures are: a bound that has become wider is not wrong, and may soon prove nothing."""

from math import log10

import pytest
from recorded import known

from orbits import prove


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


@pytest.fixture
def interval_proof(cubic_hop):
    """A hop for all parameters between two decimals."""
    return prove(cubic_hop, parameters={"beta": ("0.3", "0.301")})


@pytest.mark.parametrize("name", ["cubic_proof", "folded_curve", "interval_proof"])
def test_enclosures_are_as_narrow_as_before(name, request):
    proof = request.getfixturevalue(name)
    found = digits(proof[1] if isinstance(proof, tuple) else proof)
    assert found == pytest.approx(known("sharpness", name, found), abs=5)
