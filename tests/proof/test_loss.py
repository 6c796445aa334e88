"""Enclosures of the loss coefficient, against that of the certificate."""

import pytest
from conftest import REFERENCES, machine_of
from proofs import CUBIC, meets

from orbits import find, prove
from problems import Juggler


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
