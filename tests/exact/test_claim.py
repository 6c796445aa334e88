"""What an orbit claims is measured anew, and held to its digits."""

import dataclasses

import pytest

from orbits import Orbit, find, prove
from orbits.exact.claim import claim_of
from problems import hopper_in_si


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("loss_coefficient", lambda value: 1.001 * value), ("landing_jerk", lambda value: 1.001 * value),
        ("largest_contact_force", lambda value: 1.001 * value), ("smallest_separation", lambda value: 1.001 * value),
        ("clearance", lambda value: 0.1), ("bounce_side", lambda value: "above"), ("stable_side", lambda value: None),
    ],
)  # fmt: skip
def test_numbers_of_a_certificate_are_measured_anew(cubic_hop, name, change):
    certificate = dataclasses.replace(cubic_hop.certificate, **{name: change(getattr(cubic_hop.certificate, name))})
    (said,) = claim_of(dataclasses.replace(cubic_hop, certificate=certificate), cubic_hop.source).contradictions
    assert said.startswith(f"{name}: the orbit says")
    assert not claim_of(cubic_hop, cubic_hop.source).contradictions


@pytest.mark.parametrize("name", ["flight_time", "contact_time", "liftoff_extension"])
def test_times_and_places_are_held_to_their_digits(cubic_hop, name):
    moved = dataclasses.replace(cubic_hop, **{name: getattr(cubic_hop, name) * (1 + 1e-9)})
    proof = prove(moved)
    assert not proof.proved
    assert any(reason.startswith(f"{name}: the orbit says") for reason in proof.reasons)


def test_an_unchanged_file_says_the_same(cubic_hop, tmp_path):
    assert prove(Orbit.load(cubic_hop.save(tmp_path / "hop.json")), machine=cubic_hop.source, motion=False).proved


def test_masses_in_si_are_told():
    orbit = find(hopper_in_si(3.0, 2.0, stiffness=500.0))
    assert not claim_of(orbit, orbit.source).contradictions
    said = dataclasses.replace(orbit, machine={**orbit.machine, "body_mass": 4.0})
    assert claim_of(said, orbit.source).contradictions[0].startswith("body_mass: the orbit says 4.0")
