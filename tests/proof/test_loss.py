"""Enclosures of the loss coefficient, against that of the certificate."""

import pytest
from conftest import REFERENCES, machine_of
from proofs import CUBIC, meets

from orbits import find, prove
from problems import Hopper, Juggler


@pytest.mark.parametrize("reference", [CUBIC, REFERENCES[5]])
def test_the_loss_coefficient(reference):
    """The second has gravity by an inverse square, under which all of the launch and flight change."""
    orbit = find(machine_of(reference))
    certificate, proof = orbit.certificate, prove(orbit, loss=True)
    assert meets(proof.enclosures["loss_coefficient"], certificate.loss_coefficient, str(certificate.loss_error))
    assert proof.enclosures["loss_coefficient"].width < 1e-4 * certificate.loss_coefficient
    assert f"side {certificate.bounce_side} it, where the landing has a bounce" in proof.statement
    assert "attracts" not in proof.statement


def test_a_juggler():
    machine = Juggler(CUBIC["spring"], parameters=CUBIC["parameters"])
    orbit = find(machine)
    proof = prove(orbit, loss=True)
    assert proof.reasons == ()
    assert proof.proved
    assert proof.family == orbit.family
    loss = proof.enclosures["loss_coefficient"]
    assert meets(loss, orbit.certificate.loss_coefficient, str(orbit.certificate.loss_error))


def test_an_orbit_that_is_no_motion_has_no_hops_beside_it():
    """The masses of this hopper pass through each other: with the rest length 4 the extension falls to -4.6."""
    orbit = find(Hopper("r", rest_length=4.0))
    assert orbit.violations
    for motion in (True, False):
        proof = prove(orbit, motion=motion, loss=True)
        assert not proof.proved
        assert "it needs the conditions of a motion" in proof.reasons[-1]
        assert "loss_coefficient" not in proof.enclosures
        assert proof.bounce_side is None
