"""Attraction from above: the proved losses against closed forms, simulated hops, limits, and what has to be refused."""

import json

import mpmath as mp
import numpy as np
import pytest
from conftest import DATA
from proofs import within

from orbits import ReturnMap, find, find_all, prove
from orbits.check_proof import check
from orbits.running import default_limit
from problems import Chain, Hopper, Juggler, hopper_in_si, inerter_hopper, knee_hopper

SLOW = pytest.mark.slow
DIGITS = 40
with mp.workdps(DIGITS):
    ALPHA = mp.findroot(lambda a: mp.sin(a) - a * mp.cos(a), mp.mpf("4.4934"))


def next_distance(d):
    """The next d of a linear hopper of equal masses that is launched with alpha + d, by its closed form: in flight the
    extension r and the sum w of the coordinates are r'' = -r and w'' = -1, in contact 2 y1'' = -1 - y1."""
    alpha = ALPHA + d
    t = 2 * ALPHA + mp.cbrt(11.4 * d)
    for _ in range(9):
        sine, cosine = mp.sin(t), mp.cos(t)
        extension, rate = cosine + alpha * sine, alpha * cosine - sine
        t -= (1 + alpha * t - t**2 / 2 - extension) / (alpha - t - rate)
    sine, cosine = mp.sin(t), mp.cos(t)
    body, speed = cosine + alpha * sine, (alpha - t + alpha * cosine - sine) / 2
    squares = speed**2 + ((1 + body) ** 2 - 4) / 2
    return (squares - ALPHA**2) / (mp.sqrt(squares) + ALPHA)


def lost(d, after):
    """c of a hop that takes d to another one."""
    return (d - after) / mp.cbrt(d) ** 4


@pytest.fixture(scope="module")
def orbit():
    return find(Hopper("r", rest_length=20))


@pytest.fixture(scope="module")
def proof(orbit):
    return prove(orbit, attraction=True)


class TestLinear:
    @pytest.fixture(autouse=True)
    def digits(self):
        with mp.workdps(DIGITS):
            yield

    @pytest.mark.slow
    def test_what_is_proved(self, proof):
        assert proof.proved
        assert proof.attraction_radius == "0.01"
        assert "the hop attracts all launches above it within 0.01" in proof.statement
        losses, coefficient = proof.enclosures["attraction_loss"], proof.enclosures["loss_coefficient"]
        assert mp.mpf(losses.low) < mp.mpf(coefficient.low) < mp.mpf(coefficient.high) < mp.mpf(losses.high)

    def test_the_losses_in_closed_form(self, proof):
        for d in [mp.mpf("0.01") / 7**k for k in range(12)]:
            assert mp.nstr(lost(d, next_distance(d)), 20) in proof.enclosures["attraction_loss"]

    def test_stored_hops(self, proof):
        stored = json.loads((DATA / "return_map.json").read_text(encoding="utf-8"))
        (hop,) = [each for each in stored if (each["mass_ratio"], each["alpha"]) == ("1", "4.5")]
        d, after = (mp.mpf(hop[name]) - ALPHA for name in ("alpha", "next"))
        assert 0 < d < mp.mpf(proof.attraction_radius)
        assert mp.nstr(lost(d, after), 15) in proof.enclosures["attraction_loss"]
        assert mp.almosteq(after, next_distance(d), 1e-15)

    def test_hops_fall_as_is_said(self, proof):
        c, first = mp.mpf(proof.enclosures["attraction_loss"].low), mp.mpf(proof.attraction_radius)
        d = first
        for n in range(1, 301):
            before, d = d, next_distance(d)
            assert 0 < d < before
            assert d < (1 / mp.cbrt(first) + n * c / 3) ** -3

    @pytest.mark.slow
    def test_the_bounds_come_to_the_coefficient(self, orbit, monkeypatch):
        """They are apart like the time of the landings, the cube root of the distance."""
        widths = list[float]()
        for distance in ("1e-4", "1e-8"):
            within(monkeypatch, distance)
            proof = prove(orbit, attraction=True)
            losses = proof.enclosures["attraction_loss"]
            assert "3.61694979460214605" in losses
            widths.append(losses.width)
        assert np.log10(widths[0] / widths[1]) == pytest.approx(4 / 3, abs=0.1)


@pytest.mark.parametrize(
    ("machine", "radius"),
    [
        pytest.param(Juggler("r + 0.3*r**3"), "0.001", marks=SLOW),
        pytest.param(Hopper("tanh", rest_length=30, parameters={"b": 0.2}), "0.001", marks=SLOW),
        pytest.param(inerter_hopper(), "0.01", marks=SLOW),
        pytest.param(knee_hopper(), "0.01", marks=SLOW),
        pytest.param(
            hopper_in_si(60.0, 3.0, force="8000*r + 2e6*r**3", rest_length=0.8), "0.001", marks=SLOW
        ),
        pytest.param(
            Hopper("r + 0.3*r**3", "1/(1 + z/R)**2", parameters={"R": 100.0}, rest_length=8.0), "0.0005", marks=SLOW
        ),
    ],
)  # fmt: skip
def test_simulated_hops(machine, radius, monkeypatch):
    """Of a knee the inertia depends on the place, and the place of lift-off on the speed. The distance is searched for
    with the first machine alone."""
    orbit = find(machine)
    if not isinstance(machine, Juggler):
        within(monkeypatch, radius)
    with default_limit(120):  # of processor time
        proof = prove(orbit, attraction=True)
    reached, losses = float(proof.attraction_radius), proof.enclosures["attraction_loss"]
    assert reached >= float(radius)
    hop = ReturnMap(machine)
    for d in reached * 0.999 / 8.0 ** np.arange(4):
        after = hop(orbit.alpha + d)
        assert after.impacts == 1
        assert float((orbit.alpha + d - after.next) / d ** (4 / 3)) in losses
    assert str(orbit.certificate.loss_coefficient) in losses


class TestRefusals:
    def test_a_distance_that_is_too_large(self, orbit, monkeypatch):
        """Launches that are 0.1 faster would lose more than that."""
        within(monkeypatch, "0.1")
        proof = prove(orbit, attraction=True)
        assert not proof.proved
        assert "within 0.1 of alpha: " in proof.reasons[0]
        assert proof.attraction_radius is None
        assert "attracts" not in proof.statement

    def test_landings_that_are_not_plastic(self):
        proof = prove(find(Hopper("r", rest_length=20, restitution=0.3)), attraction=True)
        assert proof.reasons == ("attraction: impacts are not plastic, with restitution = 0.3",)
        assert "attracts" not in proof.statement
        proof = prove(find(Hopper("r", rest_length=20, restitution=0.3)), loss=True)
        assert proof.reasons == ("the loss coefficient: impacts are not plastic, with restitution = 0.3",)
        assert "loses" not in proof.statement

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("machine", "parameters", "reason"),
        [
            (Hopper("bilinear", parameters={"ratio": 2.0}), None, "breakpoints"),
            (Hopper("r + b*r**3", parameters={"b": 0.3}), {"b": ("0.2999999", "0.3000001")}, "one value"),
        ],
    )
    def test_other_laws(self, machine, parameters, reason):
        proof = prove(find(machine), attraction=True, parameters=parameters)
        assert not proof.proved
        assert reason in " ".join(proof.reasons)
        assert "attracts" not in proof.statement

    @SLOW
    def test_a_launch_that_is_more_than_a_speed(self):
        machine = Chain([1, 1, 1])
        proof = prove(find_all(machine, machine.starts(5, 5))[0], attraction=True)
        assert "no map of launch speeds" in " ".join(proof.reasons)
        assert proof.attraction_radius is None

    def test_without_the_conditions_of_a_motion(self, orbit):
        proof = prove(orbit, attraction=True, motion=False)
        assert "conditions of a motion" in proof.reasons[0]

    def test_the_second_program_does_not_verify_it(self, proof, tmp_path):
        assert proof.document()["attraction_radius"] == "0.01"
        assert "attraction" in check(json.loads(proof.save(tmp_path / "proof.json").read_text(encoding="utf-8")))[0]
