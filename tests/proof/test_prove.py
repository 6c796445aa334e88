"""Proofs of orbits: the references, independent digits, and errors."""

import sys
from decimal import Decimal

import mpmath as mp
import pytest
from conftest import PROVED, machine_of, slow_after
from proofs import CONDITIONS, CUBIC, meets, not_proved

from orbits import InputError, Orbit, find, prove
from problems import Hopper

SLOW = pytest.mark.slow


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

    @pytest.mark.parametrize(
        ("spring", "family"),
        [
            ("c*tan(r/c)", 1),
            pytest.param("r/(1 - (r/c)**2)", 1, marks=SLOW),
            pytest.param("r/sqrt(1 - (r/c)**2)", 1, marks=SLOW),
        ],
    )
    def test_a_law_with_poles_beside_the_motion(self, spring, family):
        """A step that is tried may reach into what lies beyond a pole; then it has to be shortened."""
        orbit = find(Hopper(spring, rest_length=60, parameters={"c": 3.0}), family)
        proof = prove(orbit)
        assert proof.proved == orbit.admissible
        assert proof.family == family
        assert meets(proof.alpha, orbit.alpha, str(orbit.error))


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

    @pytest.mark.slow
    def test_of_a_cubic_hop(self, cubic_hop):
        """By quadrature: with equal masses the extension r'' = -f(r) begins where f(r) = 1 with speed alpha, and its
        half flight takes the time alpha. It turns at A and then, mid-flight, at -A; with r = A sin(s) the time is an
        integral over s without singularities."""
        proof = prove(cubic_hop, 30, motion=False)
        with mp.workdps(40):
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
            assert meets(proof.alpha, mp.nstr(alpha, 38), "1e-34")
        assert proof.alpha.width < 1e-30

    @SLOW
    def test_as_many_digits_as_may_be_asked_for(self):
        proof = prove(find(Hopper("r", rest_length=20)), 200, motion=False)
        with mp.workdps(210):
            alpha = mp.findroot(lambda a: mp.sin(a) - a * mp.cos(a), mp.mpf("4.4934"))
            assert proof.reasons == ()
            assert meets(proof.alpha, mp.nstr(alpha, 208), "1e-205")


class TestErrors:
    def test_without_python_flint(self, cubic_hop, monkeypatch):
        monkeypatch.setitem(sys.modules, "flint", None)
        with pytest.raises(InputError, match="python-flint"):
            prove(cubic_hop)

    @pytest.mark.parametrize("digits", [0, -1, 1.5, "5", 10**6])
    def test_digits_that_cannot_be(self, cubic_hop, digits):
        with pytest.raises(InputError, match="digits"):
            prove(cubic_hop, digits)

    @pytest.mark.parametrize(
        ("parameters", "telling"),
        [
            ({"gamma": 1}, "no parameter 'gamma'; it has .*beta"),
            ({"beta": (0.31, 0.3)}, "beta = \\(0.31, 0.3\\); low must not be above high"),
            ({"beta": (0.1, 0.2, 0.3)}, "two bounds"),
            ({"beta": "a third"}, "beta = 'a third' is not a decimal"),
            ({"beta": float("nan")}, "not a decimal"),
            ({"beta": "inf"}, "not a decimal"),
            ({"beta": None}, "not a decimal"),
            ({"beta": (0.3, None)}, "not a decimal"),
        ],
    )
    def test_parameters_that_cannot_be(self, cubic_hop, parameters, telling):
        with pytest.raises(InputError, match=telling):
            prove(cubic_hop, parameters=parameters)

    def test_an_orbit_without_its_machine(self, cubic_hop, tmp_path):
        loaded = Orbit.load(cubic_hop.save(tmp_path / "orbit.json"))
        with pytest.raises(InputError, match="machine"):
            prove(loaded)
        assert prove(loaded, machine=machine_of(CUBIC)).proved


@pytest.mark.parametrize("beta", slow_after(2, PROVED["cubic"]))
def test_the_values_that_other_tests_take(beta):
    """They are proved anew, in decimals."""
    orbit = find(Hopper("cubic", parameters={"beta": float(beta)}))
    proof = prove(orbit, 22, parameters={"beta": beta})
    assert proof.proved
    for name, kept in PROVED["cubic"][beta].items():
        assert Decimal(proof.enclosures[name].low) <= Decimal(kept["high"])
        assert Decimal(kept["low"]) <= Decimal(proof.enclosures[name].high)


@pytest.mark.parametrize("room", slow_after(1, ["1e-9", "-1e-9", "1e-14"]))
def test_tubes_that_follow_the_digits(room):
    """The linear hopper is compressed by 1 + sqrt(4 + 2 alpha**2) in contact, where tan(alpha) = alpha."""
    with mp.workdps(50):
        alpha = mp.findroot(lambda x: mp.tan(x) - x, 4.4934)
        length = mp.nstr(1 + mp.sqrt(4 + 2 * alpha**2) + mp.mpf(room), 45)
    proof = prove(find(Hopper("r", rest_length=float(length))), 30, parameters={"rest_length": length})
    assert proof.conditions["separation"] == ("refuted" if room.startswith("-") else "proved")
