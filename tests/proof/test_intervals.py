"""Intervals of parameters that are too wide for one proof, proved in parts."""

import json

import pytest

from orbits import find, prove
from orbits.check_proof import check
from problems import Hopper, inerter_hopper

CUBIC = Hopper("cubic", rest_length=8.0, parameters={"beta": 0.3})


@pytest.mark.slow
def test_a_spring_known_to_one_percent():
    """All of it is a motion, and the document has the whole interval."""
    proof = prove(find(CUBIC), parameters={"beta": ("0.297", "0.303")})
    assert proof.proved, proof.reasons
    assert "parts of the intervals" in proof.statement
    assert "beta in [0.297, 0.303]" in proof.statement
    alphas = [find(CUBIC.with_values(beta=beta)).alpha for beta in (0.297, 0.2985, 0.3, 0.3017, 0.303)]
    assert all(float(proof.alpha.low) < alpha < float(proof.alpha.high) for alpha in alphas)
    assert proof.alpha.width < 2 * (alphas[0] - alphas[-1])
    assert proof.uniqueness_radius is None  # it is another one in each part
    document = proof.document()
    assert document["proved"]
    assert document["parameters"]["beta"] == {"low": "0.297", "high": "0.303"}
    assert document["uniqueness_radius"] is None


@pytest.mark.slow
def test_an_orbit_of_another_machine_is_not_proved_by_a_part():
    """Its alpha lies outside of what alpha can be."""
    proof = prove(find(CUBIC.with_values(beta=0.31)), machine=CUBIC, parameters={"beta": ("0.297", "0.303")})
    assert not proof.proved


@pytest.mark.slow
@pytest.mark.parametrize("bounds", [("-0.02", "0.3"), ("0.1", "5")])
def test_too_wide_an_interval_stays_undecided(bounds):
    proof = prove(find(CUBIC), parameters={"beta": bounds}, motion=False)
    assert not proof.proved
    assert proof.reasons


def test_the_only_solution_near_enclosures_that_are_rounded_outward():
    """Here the first box that holds the solutions is smaller than their decimals, within which others may then lie."""
    proof = prove(find(inerter_hopper()), parameters={"inertance": ("0.198", "0.2")}, motion=False)
    assert proof.proved, proof.reasons
    assert float(proof.uniqueness_radius) > 0
    assert not check(json.loads(json.dumps(proof.document())))


def test_a_proof_in_parts_that_runs_out_of_time_says_so():
    proof = prove(find(CUBIC), parameters={"beta": ("0.29", "0.31")}, limit=2.5)
    assert not proof.proved
    assert any("it takes more than 2.5 s" in reason for reason in proof.reasons)
