"""That no hops of a period are missing, on the linear hopper: against the map, and with hops that are left out."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from orbits import InputError, ReturnMap, multiplier, prove_all_hops
from orbits.balls.programs import ball_of_fraction
from orbits.return_map.all_hops import LinearHopper
from problems import Hopper, hopper_in_si


@pytest.mark.parametrize("mass_ratio", [0.5, 1.0, 3.0])
def test_hops_in_closed_form_are_those_of_the_map(mass_ratio):
    machine, checked = Hopper(mass_ratio=mass_ratio), 0
    step = ReturnMap(machine, inject=0.125)
    with ctx.workprec(80):
        hopper = LinearHopper(*(ball_of_fraction(Fraction(each)) for each in (mass_ratio, 0.125, 4.0, 5.5)))
        for alpha in np.random.default_rng(3).uniform(4.2, 5.2, 12).tolist():
            following, slope = hopper.hop(arb(alpha))
            assert float(following.mid()) == pytest.approx(float(step(alpha).next), abs=1e-11)
            assert float(slope.mid()) == pytest.approx(multiplier(machine, alpha), rel=1e-7)
            wide, slopes = hopper.hop(arb(alpha, 1e-6))
            for each in (-1e-6, 0.3e-6, 1e-6):
                checked += wide.overlaps(arb(float(step(alpha + each).next), 1e-12))
            assert slopes.contains(slope)
    assert checked == 36


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
    proof = prove_all_hops(Hopper(), found, "0.135", limit=300)
    assert proof.proved
    assert len(proof.enclosures) == 10


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
    for machine in (Hopper("cubic"), Hopper(rest_length=8.0), hopper_in_si(30.0, 30.0, stiffness=8000.0)):
        found = ReturnMap(machine, inject=0.12).periodic_hops(1, 4.5, 4.6)
        with pytest.raises(InputError, match="spring 'r'"):
            prove_all_hops(machine, found, "0.12")
