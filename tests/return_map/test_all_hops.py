"""That no hops of a period are missing: enclosed hops against the map, and proofs with hops that are left out."""

import re
from dataclasses import replace
from decimal import Decimal

import pytest

from orbits import InputError, ReturnMap, prove_all_hops
from orbits.model.machine import machine_in_words
from orbits.running.time_limit import default_limit
from problems import Hopper, hopper_in_si, springs


@pytest.fixture(scope="module")
def hops():
    return ReturnMap(Hopper(), inject=0.12).periodic_hops(2, 4.48, 4.63)


@pytest.mark.slow
def test_the_hops_of_period_two_are_all(hops):
    proof = prove_all_hops(Hopper(), hops, "0.12")
    assert proof.proved
    assert proof.kind == "all hops"
    for own, alpha in zip(proof.enclosures.values(), hops[0].launches, strict=True):
        assert own.width < 1e-12
        assert float(own.low) - 1e-13 <= alpha <= float(own.high) + 1e-13
    undecided = [(float(a), float(b)) for a, b in proof.stated["undecided"]]
    assert any(a <= 4.493409457909064 <= b for a, b in undecided)  # the lossless launch
    assert sum(b - a for a, b in undecided) < 2e-4
    assert f"but for {len(undecided)} intervals" in proof.statement
    assert Decimal(re.search(r"together (\S+)", proof.statement)[1]) >= sum(
        Decimal(b) - Decimal(a) for a, b in proof.stated["undecided"]
    )


@pytest.mark.slow
def test_hops_that_are_missing_or_elsewhere(hops):
    moved = replace(hops[0], launches=(hops[0].alpha, hops[0].launches[1] + 1e-9))
    proof = prove_all_hops(Hopper(), replace(hops, cycles=(moved,)), "0.12")
    assert not proof.proved
    assert [each.partition(" ")[0] for each in proof.reasons] == ["launch:", "launch:"]
    assert "are not proved to come back to 4.6116" in proof.reasons[0]
    assert "does not have the one in [4.6116" in proof.reasons[1]


@pytest.mark.slow
def test_longer_hops_are_all():
    """Of the hops of period five one lands next to the lossless launch, closer than other intervals are halved."""
    found = ReturnMap(Hopper(), inject=0.135).periodic_hops(5, 4.46, 4.64)
    with default_limit(300):  # of processor time
        proof = prove_all_hops(Hopper(), found, "0.135")
    assert proof.proved
    assert len(proof.enclosures) == 10


@pytest.mark.slow
def test_the_hops_of_a_cubic_hopper_are_all():
    """Beside the lossless launch, at 2.9364591881944968, a hop with a bounce and one without it alternate."""
    machine = Hopper(springs.cubic(beta=0.3))
    found = ReturnMap(machine, inject=0.08).periodic_hops(2, 2.93, 3.0)
    proof = prove_all_hops(machine, found, "0.08")
    assert proof.proved
    assert [float(each.low) for each in proof.enclosures.values()] == pytest.approx(found[0].launches, abs=1e-13)
    undecided = [(float(a), float(b)) for a, b in proof.stated["undecided"]]
    assert any(a <= 2.936459188194497 <= b for a, b in undecided)
    assert sum(b - a for a, b in undecided) < 1e-4


def test_what_is_not_proved_complete():
    hops = ReturnMap(Hopper(), inject=0.12).periodic_hops(1, 4.5, 4.6)
    with pytest.raises(InputError, match="another injection"):
        prove_all_hops(Hopper(), hops, "0.13")
    with pytest.raises(InputError, match="another machine"):
        prove_all_hops(Hopper(mass_ratio=2.0), hops, "0.12")
    with pytest.raises(InputError, match="above 0"):
        prove_all_hops(Hopper(), hops, "0")
    with pytest.raises(InputError, match="shortest = 0"):
        prove_all_hops(Hopper(), hops, "0.12", shortest=0.0)
    with pytest.raises(InputError, match="it is less than the range"):
        prove_all_hops(Hopper(), hops, "0.12", shortest=0.2)
    slow = ReturnMap(Hopper(), inject=0.1).periodic_hops(1, 3.0, 3.6)  # many bounces are not decided
    proof = prove_all_hops(Hopper(), slow, "0.1", shortest=1e-3)
    assert not proof.proved
    assert "take a smaller shortest= than 0.001, or a narrower range" in proof.reasons[0]
    assert "but for one interval of length" in proof.statement
    quotient, longer = Hopper("r*(r - 5)/(r - 5)"), Hopper(rest_length=8.0)
    for machine in (Hopper("tanh"), quotient, longer, hopper_in_si(30.0, 30.0, stiffness=8000.0)):
        found = replace(hops, machine=machine_in_words(machine))
        with pytest.raises(InputError, match="a polynomial in r"):
            prove_all_hops(machine, found, "0.12")
    for spring, at in (("r - 0.004*r**3", "1"), ("r + 0.1*r**2", "1"), ("r + 2*r**2 + r**3", "-1/M")):
        machine = Hopper(spring, mass_ratio=10.0)
        with pytest.raises(InputError, match=f"a polynomial of an odd degree that is {at} at one extension only"):
            prove_all_hops(machine, replace(hops, machine=machine_in_words(machine)), "0.12")
