"""Proofs of orbits: the references, independent digits, wrong claims, interval parameters, exact numbers, errors."""

import dataclasses
import json
import pickle
from decimal import Decimal
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
from conftest import PROVED, REFERENCES, machine_of
from flint import ctx

from orbits import InputError, Orbit, find, prove
from orbits.io import to_json, unsealed
from problems import Hopper, Juggler

SLOW = pytest.mark.slow
CUBIC = REFERENCES[2]
CONDITIONS = {"clearance", "separation", "contact_force", "contact_end"}


def meets(enclosure, value, error="0"):
    """Whether an enclosure meets a decimal that is known to an error."""
    value, error = Fraction(str(value)), Fraction(error)
    return Fraction(enclosure.low) <= value + error and value - error <= Fraction(enclosure.high)


def overlap(first, second):
    return Decimal(first.low) <= Decimal(second.high) and Decimal(second.low) <= Decimal(first.high)


def not_proved(proof):
    return {name for name, verdict in proof.conditions.items() if verdict != "proved"}


def without_violations(orbit):
    return dataclasses.replace(orbit, certificate=dataclasses.replace(orbit.certificate, violations=()))


@pytest.fixture(scope="module")
def cubic():
    return find(machine_of(CUBIC))


@pytest.fixture(scope="module")
def proof(cubic):
    return prove(cubic, loss=True)


class TestReferences:
    def test_what_is_proved(self, reference):
        proof = prove(find(machine_of(reference), reference["family"]))
        assert meets(proof.alpha, reference["alpha"], "1e-18")
        assert meets(proof.flight_time, reference["flight_time"], "1e-17")
        assert proof.alpha.width < 1e-17
        assert proof.family == reference["family"]
        assert meets(proof.enclosures["liftoff_extension"], reference["liftoff_extension"], "1e-18")
        middle = Decimal(reference["y1_mid"]) - Decimal(reference["y2_mid"])
        assert meets(proof.enclosures["mid_flight_extension"], middle, "1e-16")
        assert set(proof.conditions) == CONDITIONS
        assert proof.proved == reference["admissible"]
        assert bool(proof.reasons) != reference["admissible"]
        if reference["admissible"]:
            assert not not_proved(proof)
            assert meets(proof.contact_time, reference["contact_time"], "1e-8")
        else:  # the contact does not end
            assert not_proved(proof) == CONDITIONS - {"clearance"}
            assert proof.contact_time is None

    @pytest.mark.parametrize("reference", [CUBIC, REFERENCES[5]])
    def test_the_loss_coefficient(self, reference):
        """The second has gravity by an inverse square, under which all of the launch and flight change."""
        orbit = find(machine_of(reference))
        certificate, proof = orbit.certificate, prove(orbit, loss=True)
        assert meets(proof.enclosures["loss_coefficient"], certificate.loss_coefficient, str(certificate.loss_error))
        assert proof.enclosures["loss_coefficient"].width < 1e-4 * certificate.loss_coefficient
        assert f"side {certificate.bounce_side} it, where the landing has a bounce" in proof.statement
        assert "attracts" not in proof.statement

    @pytest.mark.parametrize(
        ("spring", "family"),
        [
            ("r/(1 - (r/c)**2)", 1),
            ("c*tan(r/c)", 1),
            pytest.param("c*atanh(r/c)", 1, marks=SLOW),
            pytest.param("r/sqrt(1 - (r/c)**2)", 2, marks=SLOW),
        ],
    )
    def test_a_law_with_poles_beside_the_motion(self, spring, family):
        """A step that is tried may reach into what lies beyond a pole; then it has to be shortened."""
        orbit = find(Hopper(spring, rest_length=60, parameters={"c": 3.0}), family)
        proof = prove(orbit)
        assert proof.proved == orbit.admissible
        assert proof.family == family
        assert meets(proof.alpha, orbit.alpha, str(orbit.error))

    def test_a_juggler(self):
        machine = Juggler(CUBIC["spring"], parameters=CUBIC["parameters"])
        orbit = find(machine)
        proof = prove(orbit, loss=True)
        assert proof.reasons == ()
        assert proof.proved
        assert proof.family == orbit.family
        loss = proof.enclosures["loss_coefficient"]
        assert meets(loss, orbit.certificate.loss_coefficient, str(orbit.certificate.loss_error))


class TestDigits:
    def test_of_a_linear_hop(self):
        """The half flight is alpha, which is its own tangent."""
        proof = prove(find(Hopper("r", rest_length=20)), 50)
        with mp.workdps(60):
            alpha = mp.findroot(lambda a: mp.sin(a) - a * mp.cos(a), mp.mpf("4.4934"))
            assert meets(proof.alpha, mp.nstr(alpha, 58), "1e-56")
            assert meets(proof.flight_time, mp.nstr(2 * alpha, 58), "1e-56")
        assert proof.proved
        assert proof.digits == 50
        assert proof.alpha.width < 1e-50

    def test_of_a_cubic_hop(self, cubic):
        """By quadrature: with equal masses the extension r'' = -f(r) begins where f(r) = 1 with speed alpha, and its
        half flight takes the time alpha. It turns at A and then, mid-flight, at -A; with r = A sin(s) the time is an
        integral over s without singularities."""
        proof = prove(cubic, 50, motion=False)
        with mp.workdps(60):
            beta = mp.mpf(3) / 10
            liftoff = mp.findroot(lambda r: r + beta * r**3 - 1, mp.mpf("0.829"))

            def energy(r):
                return r**2 / 2 + beta * r**4 / 4

            def speed(top):
                return mp.sqrt(2 * (energy(top) - energy(liftoff)))

            def late(top):
                def rate(s):
                    return 1 / mp.sqrt(1 + beta * top**2 * (1 + mp.sin(s) ** 2) / 2)

                places = [mp.asin(liftoff / top), mp.pi / 2, mp.pi, 3 * mp.pi / 2]
                return mp.quad(rate, places) - speed(top)

            alpha = speed(mp.findroot(late, (mp.mpf("2.291"), mp.mpf("2.292"))))
            assert meets(proof.alpha, mp.nstr(alpha, 58), "1e-54")
        assert proof.alpha.width < 1e-50

    @SLOW
    def test_as_many_digits_as_may_be_asked_for(self):
        proof = prove(find(Hopper("r", rest_length=20)), 200, motion=False)
        with mp.workdps(210):
            alpha = mp.findroot(lambda a: mp.sin(a) - a * mp.cos(a), mp.mpf("4.4934"))
            assert proof.reasons == ()
            assert meets(proof.alpha, mp.nstr(alpha, 208), "1e-205")


class TestWrongClaims:
    @pytest.mark.parametrize("shift", [1e-9, -1e-6])
    def test_another_alpha(self, reference, shift):
        orbit = find(machine_of(reference), reference["family"])
        proof = prove(dataclasses.replace(orbit, alpha=orbit.alpha + shift), motion=False)
        assert not proof.proved
        assert proof.alpha is None or meets(proof.alpha, reference["alpha"], "1e-18")

    @pytest.mark.parametrize("index", [0, 1, 2, 3, 4])
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

    @pytest.mark.parametrize("beta", [0.3 + 1e-12, 0.3 - 1e-8, 0.30001, 0.31, 3.0])
    def test_another_machine(self, cubic, beta):
        machine = Hopper(CUBIC["spring"], rest_length=8, parameters={"beta": beta})
        assert not prove(cubic, machine=machine).proved
        assert not prove(cubic, parameters={"beta": beta}, motion=False).proved

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
    def test_a_machine_of_another_kind(self, cubic, machine):
        assert not prove(cubic, machine=machine).proved

    def test_an_orbit_of_other_states_is_no_claim(self, cubic):
        with pytest.raises(InputError, match="orbit of another machine"):
            prove(cubic, machine=Juggler(CUBIC["spring"], parameters=CUBIC["parameters"]))

    @pytest.mark.parametrize("spring", ["r + 0.1*abs(r)*r", "r + 0.1*sign(r)*r**2"])
    def test_a_law_with_corners_is_told(self, spring):
        proof = prove(find(Hopper(spring, rest_length=10)))
        assert not proof.proved
        assert proof.alpha is None
        assert set(proof.conditions.values()) == {"undecided"}
        assert "abs" in proof.reasons[0] or "sign" in proof.reasons[0] or "pieces" in proof.reasons[0]


class TestIntervalParameters:
    def test_a_narrow_one(self, cubic):
        low, high = "0.2999999", "0.3000001"
        proof = prove(cubic, parameters={"beta": (low, high)})
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

    @pytest.mark.parametrize("reach", ["0.001", *(pytest.param(r, marks=SLOW) for r in ("0.1", "1"))])
    def test_a_wide_one_is_proved_or_undecided(self, cubic, reach):
        bounds = Decimal("0.3") - Decimal(reach), Decimal("0.3") + Decimal(reach)
        proof = prove(cubic, parameters={"beta": tuple(map(str, bounds))})
        assert "refuted" not in proof.conditions.values()
        assert proof.proved == (not proof.reasons)
        if proof.alpha is None:
            return
        for beta in bounds:
            machine = Hopper(CUBIC["spring"], rest_length=8, parameters={"beta": float(beta)})
            assert meets(proof.alpha, find(machine).alpha, "1e-13")

    @SLOW
    def test_an_interval_that_holds_a_pole_of_a_law_is_undecided(self):
        proof = prove(find(machine_of(REFERENCES[4])), parameters={"R": ("-60", "160")})
        assert not proof.proved
        assert set(proof.conditions.values()) == {"undecided"}

    def test_two_at_once(self):
        orbit = find(machine_of(REFERENCES[4]))
        proof = prove(orbit, parameters={"beta": ("0.2999999", "0.3000001"), "R": ("49.9999", "50.0001")})
        assert proof.proved
        assert meets(proof.alpha, REFERENCES[4]["alpha"], "1e-18")
        assert proof.alpha.width < 1e-5


class TestExactNumbers:
    def test_a_numeral_is_the_decimal_that_is_written(self):
        by_name = find(Hopper("r + b*r**3", rest_length=10, parameters={"b": 0.1}))
        written = prove(find(Hopper("r + 0.1*r**3", rest_length=10)), 40, motion=False)
        stated = prove(by_name, 40, motion=False, parameters={"b": "0.1"})
        binary = prove(by_name, 40, motion=False, parameters={"b": "0.1000000000000000055511151231257827"})
        assert all(each.proved and each.alpha.width < 1e-40 for each in (written, stated, binary))
        assert overlap(written.alpha, stated.alpha)
        assert overlap(written.alpha, prove(by_name, 40, motion=False).alpha)
        assert not overlap(written.alpha, binary.alpha)

    def test_numbers_of_numpy_are_numbers(self, cubic):
        exactly, numpy = (prove(cubic, parameters={"beta": kind(0.3)}, motion=False) for kind in (float, np.float64))
        assert numpy.alpha == exactly.alpha


class TestErrors:
    def test_without_python_flint(self, cubic, monkeypatch):
        monkeypatch.setattr("orbits.proof.prove.find_spec", lambda name: None)
        with pytest.raises(InputError, match="python-flint"):
            prove(cubic)

    @pytest.mark.parametrize("digits", [0, -1, 1.5, "5", 10**6])
    def test_digits_that_cannot_be(self, cubic, digits):
        with pytest.raises(InputError, match="digits"):
            prove(cubic, digits)

    @pytest.mark.parametrize(
        ("parameters", "telling"),
        [
            ({"gamma": 1}, "no parameter 'gamma' to follow; it has .*beta"),
            ({"beta": (0.31, 0.3)}, "beta lies between 0.31 and 0.3"),
            ({"beta": (0.1, 0.2, 0.3)}, "two bounds"),
            ({"beta": "a third"}, "beta = 'a third' is no decimal"),
            ({"beta": float("nan")}, "no decimal"),
            ({"beta": "inf"}, "no decimal"),
            ({"beta": None}, "no decimal"),
            ({"beta": (0.3, None)}, "no decimal"),
        ],
    )
    def test_parameters_that_cannot_be(self, cubic, parameters, telling):
        with pytest.raises(InputError, match=telling):
            prove(cubic, parameters=parameters)

    def test_an_orbit_without_its_machine(self, cubic, tmp_path):
        loaded = Orbit.load(cubic.save(tmp_path / "orbit.json"))
        with pytest.raises(InputError, match="machine"):
            prove(loaded)
        assert prove(loaded, machine=machine_of(CUBIC)).proved


class TestDocuments:
    def test_the_document(self, proof, tmp_path):
        document = json.loads(to_json(proof.document()))
        assert document["proved"] is True
        assert document["alpha"] == {"low": proof.alpha.low, "high": proof.alpha.high}
        assert document["conditions"] == dict.fromkeys(document["conditions"], "proved")
        assert set(document["conditions"]) == CONDITIONS
        assert Decimal(document["radius"]) < Decimal("1e-18") < Decimal(document["uniqueness_radius"])
        assert unsealed(json.loads(proof.save(tmp_path / "proof.json").read_text(encoding="utf-8"))) == document

    def test_a_document_of_nothing(self, cubic):
        proof = prove(cubic, parameters={"beta": 3})
        document = json.loads(to_json(proof.document()))
        assert document["proved"] is False
        assert document["alpha"] is document["flight_time"] is document["contact_time"] is None
        assert "Nothing is proved" in proof.statement
        assert str(proof).startswith("NOT PROVED")

    def test_what_is_printed(self, proof):
        text = str(proof)
        assert text.startswith("proved\n")
        assert proof.alpha.low in text
        assert "beta = 0.3" in text
        assert "family 1" in text
        assert all(len(line) <= 120 for line in text.splitlines())
        assert "family=1" in repr(proof)

    def test_pickling(self, proof):
        assert pickle.loads(pickle.dumps(proof)) == proof

    def test_a_proof_that_is_asked_for_less_says_less(self, cubic):
        proof = prove(cubic, motion=False)
        assert proof.proved
        assert proof.family is None
        assert proof.contact_time is None
        assert not proof.conditions
        assert "motion" not in proof.statement

    def test_the_precision_of_arb_is_as_it_was(self, cubic):
        before = ctx.prec, ctx.cap
        prove(cubic, 30, motion=False)
        prove(cubic, parameters={"beta": 3})
        assert (ctx.prec, ctx.cap) == before


@pytest.mark.parametrize("beta", PROVED["cubic"])
def test_the_values_that_other_tests_take(beta):
    """They are proved anew, in decimals."""
    orbit = find(Hopper("cubic", parameters={"beta": float(beta)}))
    proof = prove(orbit, 22, parameters={"beta": beta})
    assert proof.proved
    for name, kept in PROVED["cubic"][beta].items():
        assert Decimal(proof.enclosures[name].low) <= Decimal(kept["high"])
        assert Decimal(kept["low"]) <= Decimal(proof.enclosures[name].high)
