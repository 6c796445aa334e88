"""Claims that are wrong are not proved: another launch speed, family or machine, and motions that are none."""

import dataclasses

import pytest
from conftest import REFERENCES, machine_of
from proofs import CONDITIONS, CUBIC, meets, not_proved

from orbits import InputError, find, prove
from problems import Hopper, Juggler

SLOW = pytest.mark.slow


def without_violations(orbit):
    return dataclasses.replace(orbit, certificate=dataclasses.replace(orbit.certificate, violations=()))


class TestWrongClaims:
    def test_another_alpha(self, reference):
        orbit = find(machine_of(reference), reference["family"])
        proof = prove(dataclasses.replace(orbit, alpha=orbit.alpha + 1e-9), motion=False)
        assert not proof.proved
        assert proof.alpha is None or meets(proof.alpha, reference["alpha"], "1e-18")

    @pytest.mark.parametrize("index", [0, 2, 4])
    def test_another_family(self, index):
        reference = REFERENCES[index]
        orbit = find(machine_of(reference), reference["family"])
        certificate = dataclasses.replace(orbit.certificate, family=orbit.family + 1)
        proof = prove(dataclasses.replace(orbit, certificate=certificate))
        assert not proof.proved
        assert proof.family == reference["family"]
        assert "family" in proof.reasons[0]

    @pytest.mark.parametrize(
        ("machine", "family", "refuted"),
        [
            (Hopper("r", rest_length=5.0), 1, {"separation"}),
            pytest.param(Hopper("r + a*sin(b*r)", mass_ratio=2.0, parameters={"a": 1.8, "b": 5.7}, rest_length=40), 1,
                         {"clearance"}, marks=SLOW),
            pytest.param(Hopper("r + a*sin(b*r)", parameters={"a": 4.5, "b": 2.2}, rest_length=40), 2,
                         {"contact_force"}, marks=SLOW),
        ],
        ids=["separation", "clearance", "contact force"],
    )  # fmt: skip
    def test_no_motion_that_does_not_say_so(self, machine, family, refuted):
        orbit = find(machine, family)
        assert orbit.violations
        proof = prove(without_violations(orbit))
        assert not proof.proved
        assert {name for name, verdict in proof.conditions.items() if verdict == "refuted"} == refuted
        assert not_proved(proof) == refuted
        assert len(prove(orbit).reasons) == len(proof.reasons) + len(orbit.violations)

    def test_a_contact_that_does_not_end(self):
        reference = next(r for r in REFERENCES if not r["admissible"])
        proof = prove(without_violations(find(machine_of(reference), reference["family"])))
        assert not proof.proved
        assert not_proved(proof) == CONDITIONS - {"clearance"}

    @pytest.mark.parametrize("beta", [0.3 + 1e-12, 0.31])
    def test_another_machine(self, cubic_hop, beta):
        machine = Hopper(CUBIC["spring"], rest_length=8, parameters={"beta": beta})
        assert not prove(cubic_hop, machine=machine).proved
        assert not prove(cubic_hop, parameters={"beta": beta}, motion=False).proved

    @pytest.mark.parametrize(
        "machine",
        [
            Hopper(CUBIC["spring"], mass_ratio=1.001, rest_length=8, parameters=CUBIC["parameters"]),
            Hopper(CUBIC["spring"], "1/(1 + z/R)**2", rest_length=8, parameters={"beta": 0.3, "R": 50.0}),
            Hopper(CUBIC["spring"], rest_length=2, parameters=CUBIC["parameters"]),
            Hopper("r", rest_length=8),
        ],
        ids=["mass ratio", "gravity", "rest length", "spring"],
    )
    def test_a_machine_of_another_kind(self, cubic_hop, machine):
        assert not prove(cubic_hop, machine=machine).proved

    def test_an_orbit_of_other_states_is_no_claim(self, cubic_hop):
        with pytest.raises(InputError, match="orbit of another machine"):
            prove(cubic_hop, machine=Juggler(CUBIC["spring"], parameters=CUBIC["parameters"]))

    @pytest.mark.parametrize("spring", ["r + 0.1*abs(r)*r", "r + 0.1*sign(r)*r**2"])
    def test_a_law_with_corners_is_told(self, spring):
        proof = prove(find(Hopper(spring, rest_length=10)))
        assert not proof.proved
        assert proof.alpha is None
        assert set(proof.conditions.values()) == {"undecided"}
        assert "abs" in proof.reasons[0] or "sign" in proof.reasons[0] or "pieces" in proof.reasons[0]
