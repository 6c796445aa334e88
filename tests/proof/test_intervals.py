"""Parameters that are known within intervals: proved as a whole, in parts, or left undecided."""

import dataclasses
import json
import re
from decimal import Decimal
from fractions import Fraction

import pytest
from conftest import REFERENCES, machine_of
from proofs import CUBIC, meets, overlap

from orbits import find, prove
from orbits.check_proof import check
from orbits.exact import claim_of
from orbits.proof import intervals
from orbits.proof.orbit_case import whole_proof
from problems import Hopper, inerter_hopper

MACHINE = Hopper("cubic", rest_length=8.0, parameters={"beta": 0.3})


@pytest.mark.slow
def test_a_spring_known_to_half_a_percent():
    """All of it is a motion, and the document has the whole interval."""
    proof = prove(find(MACHINE), parameters={"beta": ("0.2985", "0.3015")})
    assert proof.proved, proof.reasons
    assert "parts of the intervals" in proof.statement
    assert "beta in [0.2985, 0.3015]" in proof.statement
    alphas = [find(MACHINE.with_values(beta=beta)).alpha for beta in (0.2985, 0.2992, 0.3, 0.3007, 0.3015)]
    assert all(float(proof.alpha.low) < alpha < float(proof.alpha.high) for alpha in alphas)
    assert proof.alpha.width < 2 * (alphas[0] - alphas[-1])
    assert proof.uniqueness_radius is None  # it is another one in each part
    document = proof.document()
    assert document["proved"]
    assert document["parameters"]["beta"] == {"low": "0.2985", "high": "0.3015"}
    assert document["uniqueness_radius"] is None


@pytest.mark.slow
def test_an_orbit_of_another_machine_is_not_proved_by_a_part():
    """Its alpha lies outside of what alpha can be."""
    proof = prove(find(MACHINE.with_values(beta=0.31)), machine=MACHINE, parameters={"beta": ("0.297", "0.303")})
    assert not proof.proved


@pytest.mark.slow
def test_too_wide_an_interval_stays_undecided(monkeypatch):
    monkeypatch.setattr(intervals, "HALVINGS_OF_INTERVALS", 1)
    proof = prove(find(MACHINE), parameters={"beta": ("-0.02", "0.3")}, motion=False)
    assert not proof.proved
    assert proof.reasons


@pytest.mark.slow
def test_the_only_solution_near_enclosures_that_are_rounded_outward():
    """Here the first box that holds the solutions is smaller than their decimals, within which others may then lie."""
    proof = prove(find(inerter_hopper()), parameters={"inertance": ("0.198", "0.2")}, motion=False)
    assert proof.proved, proof.reasons
    assert float(proof.uniqueness_radius) > 0
    assert not check(json.loads(json.dumps(proof.document())))


SLOW = pytest.mark.slow


class TestIntervalParameters:
    @pytest.mark.slow
    def test_a_narrow_one(self, cubic_hop):
        low, high = "0.2999999", "0.3000001"
        proof = prove(cubic_hop, parameters={"beta": (low, high)})
        assert proof.proved
        assert f"beta in [{low}, {high}]" in proof.statement
        found = []
        for beta in (low, "0.29999995", "0.30000003", high):
            orbit = find(Hopper(CUBIC["spring"], rest_length=8, parameters={"beta": float(beta)}))
            found.append(orbit.alpha)
            assert meets(proof.alpha, orbit.alpha, str(orbit.error))
            assert meets(proof.flight_time, orbit.flight_time, "1e-14")
            assert meets(proof.contact_time, orbit.contact_time, "1e-13")
            assert overlap(proof.alpha, prove(orbit, motion=False).alpha)
        assert proof.alpha.width <= 10 * abs(found[-1] - found[0])

    @pytest.mark.parametrize("reach", [pytest.param(reach, marks=SLOW) for reach in ("0.001", "1")])
    def test_a_wide_one_is_proved_or_undecided(self, cubic_hop, reach, monkeypatch):
        if reach == "1":  # smaller parts fail like halves, and take long
            monkeypatch.setattr(intervals, "HALVINGS_OF_INTERVALS", 1)
        bounds = Decimal("0.3") - Decimal(reach), Decimal("0.3") + Decimal(reach)
        proof = prove(cubic_hop, parameters={"beta": tuple(map(str, bounds))})
        assert "refuted" not in proof.conditions.values()
        assert proof.proved == (not proof.reasons)
        if proof.alpha is None:
            return
        for beta in bounds:
            machine = Hopper(CUBIC["spring"], rest_length=8, parameters={"beta": float(beta)})
            assert meets(proof.alpha, find(machine).alpha, "1e-13")

    @SLOW
    def test_an_interval_that_holds_a_pole_of_a_law_is_undecided(self, monkeypatch):
        monkeypatch.setattr(intervals, "HALVINGS_OF_INTERVALS", 1)
        proof = prove(find(machine_of(REFERENCES[4])), parameters={"R": ("-60", "160")})
        assert not proof.proved
        assert set(proof.conditions.values()) == {"undecided"}

    @pytest.mark.slow
    def test_two_at_once(self):
        orbit = find(machine_of(REFERENCES[4]))
        proof = prove(orbit, parameters={"beta": ("0.2999999", "0.3000001"), "R": ("49.9999", "50.0001")})
        assert proof.proved
        assert meets(proof.alpha, REFERENCES[4]["alpha"], "1e-18")
        assert proof.alpha.width < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("right", [True, False])
def test_what_an_orbit_says_is_held_against_parts_of_intervals(cubic_hop, right, monkeypatch):
    def reluctant(claim, stated, *asked, **options):
        proof = whole_proof(claim, stated, *asked, **options)
        low, high = stated.parameters["beta"]
        return proof if high - low < Fraction(1, 5000) else dataclasses.replace(proof, proved=False)

    monkeypatch.setattr(intervals, "whole_proof", reluctant)
    monkeypatch.setattr(intervals, "HALVINGS_OF_INTERVALS", 1)
    family = cubic_hop.family if right else cubic_hop.family + 1
    orbit = dataclasses.replace(cubic_hop, certificate=dataclasses.replace(cubic_hop.certificate, family=family))
    proof = prove(orbit, parameters={"beta": ("0.29985", "0.30015")})
    assert proof.proved == right
    assert len(proof.parts) == (2 if right else 1)


@pytest.mark.slow
def test_a_proof_in_parts_has_the_reasons_of_the_part_that_fails(cubic_hop, monkeypatch):
    """Words that the whole has too, with more words between, are not repeated."""
    spreads, late = "the set spreads too far", "it takes more than 30 s"

    def failing(claim, stated, *requested, **options):
        low, high = stated.parameters["beta"]
        part = high - low < Fraction(1, 5000)
        reasons = (f"existence: {spreads}", f"clearance: {late}") if part else (f"existence: no box: {spreads}",)
        return dataclasses.replace(whole_proof(claim, stated, *requested, **options), proved=False, reasons=reasons)

    monkeypatch.setattr(intervals, "whole_proof", failing)
    monkeypatch.setattr(intervals, "HALVINGS_OF_INTERVALS", 1)
    proof = prove(cubic_hop, parameters={"beta": ("0.29985", "0.30015")}, motion=False)
    assert not proof.proved
    assert proof.reasons == (f"existence: no box: {spreads}", f"in a part of the intervals: clearance: {late}")


@pytest.mark.slow
def test_a_box_that_is_too_large_comes_with_one_that_is_proved(cubic_hop):
    """About the machine's own value, with bounds of few digits; four times as large it is not proved as a whole."""
    proof = prove(cubic_hop, parameters={"beta": ("0.2", "0.5")}, motion=False)
    assert not proof.proved
    found = re.fullmatch(
        r"the intervals as a whole, but smaller ones are: beta in \[(0\.\d{1,5}), (0\.\d{1,5})\]", proof.reasons[-1]
    )
    low, high = map(float, found.groups())
    assert low < 0.3 < high
    assert prove(cubic_hop, parameters={"beta": found.groups()}, motion=False).proved
    wider = {"beta": (f"{0.3 + 4 * (low - 0.3):.6f}", f"{0.3 + 4 * (high - 0.3):.6f}")}
    claim = claim_of(cubic_hop, None)
    assert not whole_proof(claim, claim.stated(wider), None, False, False).proved


@pytest.mark.slow
def test_parts_with_bounces_on_opposite_sides(cubic_hop):
    """Where parts are of the two sheets of a fold, no sentence on the losses holds for all of them."""
    claim = claim_of(cubic_hop, None)
    stated = claim.stated({})
    part = whole_proof(claim, stated, None, True, True)
    assert part.bounce_side == "below"
    whole = intervals._joined([part, part], stated)
    assert (whole.proved, whole.bounce_side) == (True, "below")
    assert "where the landing has a bounce" in whole.statement
    whole = intervals._joined([part, dataclasses.replace(part, bounce_side="above")], stated)
    assert (whole.proved, whole.bounce_side) == (False, None)
    assert whole.reasons == (
        "the loss coefficient: landings have a bounce above alpha in some parts, and below it in others",
    )
    assert "where the landing has a bounce" not in whole.statement
