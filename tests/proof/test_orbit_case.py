"""Claims that are wrong are not proved: another launch speed, family or machine, and motions that are none."""

import dataclasses
import json
from dataclasses import replace
from fractions import Fraction
from functools import cache

import pytest
from conftest import REFERENCES, machine_of, name_of, slow_after
from proofs import CONDITIONS, CUBIC, meets, not_proved, restated
from steps import SINES, TABLE, closed_form, stepping

from orbits import InputError, find, prove, prove_absence
from orbits.check_proof import check
from orbits.exact import HalfOrbit, claim_of, stated_machine
from orbits.exact.decimals import exact_fraction
from orbits.exact.stated import StatedSpring
from orbits.proof import prove_claims
from orbits.proof.intervals import proof_of
from orbits.proof.orbit_case import whole_proof
from problems import Hopper, Juggler

SLOW = pytest.mark.slow


def without_violations(orbit):
    return dataclasses.replace(orbit, certificate=dataclasses.replace(orbit.certificate, violations=()))


class TestWrongClaims:
    @pytest.mark.parametrize("reference", REFERENCES[::3], ids=name_of)
    def test_another_alpha(self, reference):
        orbit = find(machine_of(reference), reference["family"])
        proof = prove(dataclasses.replace(orbit, alpha=orbit.alpha + 1e-9), motion=False)
        assert not proof.proved
        assert proof.alpha is None or meets(proof.alpha, reference["alpha"], "1e-18")

    @pytest.mark.parametrize("index", slow_after(2, [0, 2, 4]))
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
        if refuted == {"separation"}:
            assert len(prove(orbit).reasons) == len(proof.reasons) + len(orbit.violations)

    def test_a_contact_that_does_not_end(self):
        reference = next(r for r in REFERENCES if not r["admissible"])
        proof = prove(without_violations(find(machine_of(reference), reference["family"])))
        assert not proof.proved
        assert not_proved(proof) == CONDITIONS - {"clearance"}

    @pytest.mark.parametrize("beta", slow_after(1, [0.3 + 1e-12, 0.31]))
    def test_another_machine(self, cubic_hop, beta):
        machine = Hopper(CUBIC["spring"], rest_length=8, parameters={"beta": beta})
        assert not prove(cubic_hop, machine=machine).proved
        assert not prove(cubic_hop, parameters={"beta": beta}, motion=False).proved

    @pytest.mark.parametrize(
        "machine",
        slow_after(
            3,
            [
                Hopper(CUBIC["spring"], mass_ratio=1.001, rest_length=8, parameters=CUBIC["parameters"]),
                Hopper(CUBIC["spring"], rest_length=2, parameters=CUBIC["parameters"]),
                Hopper("r", rest_length=8),
                Hopper(CUBIC["spring"], "1/(1 + z/R)**2", rest_length=8, parameters={"beta": 0.3, "R": 50.0}),
            ],
        ),
        ids=["mass ratio", "rest length", "spring", "gravity"],
    )
    def test_a_machine_of_another_kind(self, cubic_hop, machine):
        assert not prove(cubic_hop, machine=machine).proved

    def test_an_orbit_of_other_states_is_no_claim(self, cubic_hop):
        with pytest.raises(InputError, match="orbit belongs to another machine"):
            prove(cubic_hop, machine=Juggler(CUBIC["spring"], parameters=CUBIC["parameters"]))

    @pytest.mark.parametrize("spring", slow_after(1, ["r + 0.1*abs(r)*r", "r + 0.1*sign(r)*r**2"]))
    def test_a_law_with_corners_is_told(self, spring):
        proof = prove(find(Hopper(spring, rest_length=10)))
        assert not proof.proved
        assert proof.alpha is None
        assert set(proof.conditions.values()) == {"undecided"}
        assert "abs" in proof.reasons[0] or "sign" in proof.reasons[0] or "pieces" in proof.reasons[0]


@cache
def step_of(kind, mu, kappa, angle, law, family):
    return find(stepping(kind, mu, kappa, angle, law), family)


def claim_of_step(kind, *machine, family=1, about=None, **changes):
    """The claim of a wheel, rocker or shuttle, about its own machine or another one."""
    claim = claim_of(step_of(kind, *(*machine, *(1.0, 0.5, 0.3, "r")[len(machine) :]), family), None)
    return replace(claim, machine=about or claim.machine, unknowns={**claim.unknowns, **changes})


PULLING = [
    ("rocker", "r + 0.147*sin(10.79*r)", {"liftoff": 0.45384013711250415, "alpha": 0.3109779861859763,
     "duration": 3.421650925178937, "contact_duration": 1.0049761951964762}),
    ("wheel", "r + 0.142*sin(11.29*r)", {"liftoff": 0.4347904510989461, "alpha": 0.33209990187196925,
     "duration": 1.9787908578078104, "contact_duration": 0.9478364107896803}),
]  # fmt: skip


class TestSteps:
    @pytest.mark.parametrize(
        ("kind", "case"), slow_after(3, [(kind, case) for kind, cases in TABLE.items() for case in cases])
    )
    def test_straight_lines_have_the_closed_form(self, kind, case):
        mu, kappa, family = case
        half, speed, contact = closed_form(kind, mu, kappa, family)
        proof = prove(step_of(kind, mu, kappa, None, "r", family))
        assert proof.proved, proof.reasons
        assert proof.family == family
        for enclosure, value in ((proof.alpha, speed), (proof.flight_time, 2 * half), (proof.contact_time, contact)):
            assert meets(enclosure, value, "5e-15")
            assert Fraction(enclosure.high) - Fraction(enclosure.low) < Fraction("1e-20")

    @pytest.mark.parametrize(("kind", "law", "family"), slow_after(2, SINES))
    def test_the_sine_and_a_cubic_spring(self, kind, law, family):
        speed, half, contact = SINES[kind, law, family]
        proof = prove(step_of(kind, 1.0, 0.5, 0.3, law, family))
        assert proof.proved, proof.reasons
        assert meets(proof.alpha, speed, "1e-16")
        assert meets(proof.contact_time, contact, "1e-14")
        assert half is None or meets(proof.flight_time, 2 * half, "1e-13")
        assert "each point that stands in contact pushes" in proof.statement

    @pytest.mark.parametrize("kind", slow_after(1, TABLE))
    def test_wrong_numbers(self, kind):
        own = claim_of_step(kind)
        proof = prove_claims([replace(own, family=2)])[0]
        assert not proof.proved
        assert proof.reasons == ("family: the extension turns as in family 1, but the orbit states 2",)
        assert not prove_claims([replace(own, alpha=own.alpha * (1 + 1e-9))], motion=False)[0].proved
        wrong = prove_claims([claim_of_step(kind, contact_duration=own.unknowns["contact_duration"] * (1 + 1e-8))])[0]
        assert not wrong.proved
        assert "contact_time: the orbit states" in wrong.reasons[0]

    @pytest.mark.parametrize("kind", slow_after(1, TABLE))
    def test_another_machine(self, kind):
        others = stepping(kind, 1.0, 0.5, 0.3 + 1e-9), stepping(kind, 1.0 + 1e-9, 0.5, 0.3)
        for other in (*others, stepping(kind, 1.0, 0.5, 0.3, "r + 1e-8*r**3")):
            assert not prove_claims([claim_of_step(kind, about=other)], motion=False)[0].proved
        uneven = dataclasses.replace(stepping(kind, 1.0, 0.5, 0.3), reversor=None).with_springs(["r + 1e-30*r**2"])
        with pytest.raises(InputError, match="not symmetric in time"):
            prove_claims([claim_of_step(kind, about=uneven)])

    def test_what_has_no_proof_is_refused(self):
        claim = claim_of_step("wheel")
        proof = proof_of(claim, None, {}, True, True, 30.0, attraction=True)
        assert proof.conditions == dict.fromkeys(["clearance", "contact_force", "contact_end"], "proved")
        assert [each.partition(":")[0] for each in proof.reasons] == ["the loss coefficient", "attraction"]
        assert all("for machines that state no reversor, symmetry or further gap" in each for each in proof.reasons)
        assert not prove_absence(claim.machine).proved

    def test_an_interval_of_angles(self):
        claim = claim_of_step("wheel")
        proof = proof_of(claim, None, {"angle": ("0.29999", "0.30001")}, True, False, 30.0)
        assert proof.proved, proof.reasons
        assert meets(proof.alpha, claim.alpha)
        assert Fraction(proof.alpha.high) - Fraction(proof.alpha.low) > Fraction("1e-5")

    @pytest.mark.parametrize("hole", ["0.2", "-0.2"])
    def test_formulas_have_values_in_both_halves(self, hole):
        """The first half of a wheel's flight has extensions above 0 alone, and that of its contact below 0."""
        claim = claim_of_step("wheel")
        springs = (StatedSpring("phi - theta", (f"r + 0/(r - ({hole}))",)),)
        proof = whole_proof(claim, replace(stated_machine(claim.machine, {}), springs=springs), None, True, False)
        assert not proof.proved
        assert "has no value" in proof.reasons[0]

    @pytest.mark.slow
    @pytest.mark.parametrize(("kind", "law", "start"), PULLING)
    def test_a_foot_that_would_have_to_pull(self, kind, law, start):
        """By integration with SciPy the least force on the landed foot is -0.010 and -0.024 of that at lift-off."""
        orbit = find(stepping(kind, 1.0, 1.0, 0.3, law), start=start)
        assert orbit.alpha == pytest.approx(start["alpha"], rel=1e-9)
        assert orbit.violations
        proof = prove(without_violations(orbit))
        assert proof.conditions == {"clearance": "proved", "contact_force": "refuted", "contact_end": "proved"}
        foot = "front foot" if kind == "wheel" else "point that lands"
        assert f"contact_force: the {foot}: it is proved to be negative" in proof.reasons

    @SLOW
    def test_the_second_program_sees_a_foot_that_would_have_to_pull(self):
        kind, law, start = PULLING[1]
        proof = prove(find(stepping(kind, 1.0, 1.0, 0.3, law), start=start))
        proved = {"proved": True, "reasons": [], "conditions": dict.fromkeys(proof.conditions, "proved")}
        document = json.loads(json.dumps(proof.document())) | proved
        assert check(restated(document)) == ["a sign along the motion cannot be decided"]

    def test_a_foot_that_strikes(self, monkeypatch):
        """The foot in front seems a third as far away."""
        near = property(lambda half: exact_fraction("0.2", "0.2") / half.mechanics.scale.length - half.mechanics.y[1])
        monkeypatch.setattr(HalfOrbit, "landing_gap", near)
        proof = prove_claims([claim_of_step("wheel")])[0]
        assert proof.conditions["clearance"] == "refuted"
        assert "clearance: the front foot: it is proved to be negative" in proof.reasons
