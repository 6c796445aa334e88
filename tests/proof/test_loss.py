"""Enclosures of the loss coefficient, against that of the certificate."""

import pytest
from conftest import REFERENCES, machine_of, slow_after
from proofs import CUBIC, meets

from orbits import find, prove
from orbits.proof import intervals
from problems import Hopper, Juggler


@pytest.mark.parametrize("reference", slow_after(1, [CUBIC, REFERENCES[5]]))
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


@pytest.mark.slow
def test_a_parameter_in_an_interval(monkeypatch):
    """In one piece the coefficient would be enclosed to [3.3, 7.3], and of the wider interval to [0, 27]."""
    hopper = Hopper("r + beta*r**3", rest_length=8.0, parameters={"beta": 0.3})
    proof = prove(find(hopper), loss=True, parameters={"beta": ("0.29999", "0.30001")})
    assert proof.proved, proof.reasons
    loss = proof.enclosures["loss_coefficient"]
    assert f"with C in {loss}, and ten times as much on the side below" in proof.statement
    assert len(proof.parts) == 2
    assert float(loss.high) < 2 * float(loss.low)
    for beta in (0.29999, 0.3, 0.30001):
        certificate = find(hopper.with_values(beta=beta)).certificate
        assert meets(loss, certificate.loss_coefficient, str(certificate.loss_error))
    monkeypatch.setattr(intervals, "HALVINGS_OF_INTERVALS", 1)
    wide = prove(find(hopper), loss=True, parameters={"beta": ("0.2999", "0.3001")})
    assert not wide.proved
    reason, remedy = wide.reasons
    assert reason.startswith("the loss coefficient: ")
    assert remedy.startswith("the intervals as a whole, but smaller ones are: beta in [0.29999")
    assert "loss_coefficient" not in wide.enclosures
