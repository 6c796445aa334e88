"""Saved proofs that all hops are known, verified by a second program, which sees false ones."""

import json

import pytest
from flint import arb, ctx
from proofs import restated

from orbits import ReturnMap, check_hops, multiplier, prove_all_hops
from orbits.check_hops import BITS, Hops, check_saved as check
from problems import Hopper

SLOW = pytest.mark.slow


def saved(machine, half):
    """The proof that the fixed point without a bounce is alone within half a length of launch speeds."""
    step = ReturnMap(machine, inject=0.12)
    alpha, *_ = (each.alpha for each in step.fixed_points(2.5, 5.0) if each.multiplier < 0)
    hops = step.periodic_hops(1, alpha - half, alpha + half)
    return json.loads(json.dumps(prove_all_hops(machine, hops, "0.12").document()))


@pytest.fixture(scope="module")
def linear():
    return saved(Hopper(mass_ratio=0.5), 1e-3)


def changed(document, *path, to):
    """A copy with another value at a place."""
    copy = json.loads(json.dumps(document))
    *places, last = path
    inner = copy
    for each in places:
        inner = inner[each]
    inner[last] = to
    return restated(copy)


def with_launch(document, name, low, high):
    """A copy with another enclosure, said in both places."""
    return restated(changed(document, "enclosures", name, to=[low, high]) | {name: {"low": low, "high": high}})


@pytest.mark.slow
def test_hops_are_those_of_the_map(linear):
    """One with a bounce, and one without it."""
    machine = Hopper(mass_ratio=0.5)
    step = ReturnMap(machine, inject=0.12)
    with ctx.workprec(BITS):
        hops = Hops(linear["machine"])
        for alpha in (4.48, 4.55):
            following, slope = hops.hop(arb(alpha), arb(alpha, 1e-6))
            assert float(following.rad()) < 1e-17
            assert float(following.mid()) == pytest.approx(float(step(alpha).next), abs=1e-14)
            assert (slope + arb(0, 1e-8)).contains(arb(multiplier(machine, alpha)))
            assert float(slope.rad()) < 1e-2


def test_what_the_file_says_besides(linear):
    launch, (low, high) = linear["enclosures"]["alpha_1"], linear["machine"]["range"]
    for path, value, why in (
        (("proved",), False, "'proved'"),
        (("alpha_1", "low"), "4.5", "'alpha_1'"),
        (("more",), 1, "more than this program verifies"),
        (("machine", "more"), 1, "more than this program verifies"),
        (("machine", "range"), ["4.6", "4.5"], "the range is empty"),
        (("machine", "undecided"), [linear["machine"]["range"]], "too much of it is undecided"),
        (("machine", "undecided"), [launch], "common launches"),
        (("machine", "range"), [launch[1], high], "leave the range"),
        (("machine", "injection"), ["0.12", "0.13"], "has intervals"),
        (("machine", "period"), 0, "no number of hops"),
        (("machine", "liftoff"), ["1.1", "1.2"], "place of the launch"),
        (("machine", "separation"), "y1 + 8", "one smooth law"),
    ):
        assert why in check(changed(linear, *path, to=value))[0]
    # Also where each has one that comes back.
    assert "common launches" in check(with_launch(linear, "alpha_2", low, high))[0]
    assert "'name' of machine of the file" in check(changed(linear, "machine", to={}))[0]


@SLOW
def test_hops_with_a_launch_or_a_number_that_is_wrong(linear, monkeypatch):
    assert check(linear) == []
    monkeypatch.setattr(check_hops, "PARTS", 1)  # so short a range needs no parts
    assert check(linear) == []
    pair, low = linear["enclosures"]["alpha_1"], linear["machine"]["range"][0]
    moved = with_launch(linear, "alpha_1", *(f"{float(each) + 1e-9:.17g}" for each in pair))
    none = changed(linear, "enclosures", to={})
    del none["alpha_1"]
    other = changed(linear, "machine", "injection", to=["0.1200001"] * 2)
    for false in (moved, none, other):
        assert "comes back, and no enclosure has it" in check(false)[0]
    force = changed(linear, "machine", "springs", 0, "force", to=["r + r**3/10**7"])
    assert "place of the launch" in check(force)[0]
    more = with_launch(linear, "alpha_2", low, f"{float(pair[0]) - 1e-9:.17g}")
    assert "no launch that comes back is shown to lie in the enclosure of alpha_2" in check(more)[0]
    assert "may come back after 1 hops" in check(changed(linear, "machine", "period", to=2))[0]


@SLOW
def test_hops_of_polynomials_are_verified():
    document = saved(Hopper("r + 0.2*r**2 + 0.1*r**3"), 2e-4)
    assert document["proved"]
    assert check(document) == []
