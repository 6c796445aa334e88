"""Proofs with tuned parameters as unknowns, and of runs: motions of a foot that lands at rest and sticks."""

import copy
import json
from dataclasses import replace
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
from conftest import slow_after
from flint import arb
from proofs import CONDITIONS, meets, restated
from runners import FAST, NAMES, fast_runner, rates_by_hand

from orbits import InputError, find, prove
from orbits.balls import BallProgram, Motion
from orbits.check_proof import check
from orbits.exact import ExactMechanics, HalfOrbit, Scale, Unproved, claim_of, stated_machine
from orbits.exact.claim import rounded_up
from orbits.proof.proved_existence import existence_of
from orbits.proof.proved_motion import motion_conditions
from orbits.proof.sticking_friction import needed_friction
from orbits.running import default_limit
from problems import Hopper, runner

SLOW = pytest.mark.slow


@pytest.fixture(scope="module")
def tuned_hop():
    return find(Hopper("k*r", rest_length=20.0, parameters={"k": 2.0}), tune="k", at={"alpha": 3.0})


@pytest.fixture(scope="module")
def tuned(tuned_hop):
    return prove(tuned_hop)


@pytest.fixture(scope="module")
def document(tuned_hop):
    return json.loads(json.dumps(prove(tuned_hop, motion=False).document()))


class TestTunedHop:
    def test_the_stiffness_of_a_launch_speed(self, tuned):
        """The root x of x = tan(x) is the root of the stiffness times the launch speed."""
        with mp.workdps(40):
            root = mp.findroot(lambda x: mp.sin(x) - x * mp.cos(x), mp.mpf("4.4934"))
            assert meets(tuned.enclosures["k"], mp.nstr((root / 3) ** 2, 35), "1e-33")
        assert tuned.proved
        assert tuned.enclosures["k"].width < 1e-17
        assert "3" in tuned.alpha
        assert set(tuned.parts[0].unknowns) == {"liftoff", "alpha", "k", "flight_time", "contact_time"}
        assert "k to be found" in tuned.statement
        said = "There is a number k for which the equations of a lossless orbit with alpha = 3, exactly,"
        assert said in tuned.statement

    @pytest.mark.parametrize(
        ("name", "value"),
        slow_after(1, [("period", "9.5"), ("frequency", "0.1"), ("contact_time", "3.25")]),
    )
    def test_a_time_that_is_not_that_of_the_orbit(self, tuned_hop, name, value):
        proof = prove(tuned_hop, at={name: value}, motion=False)
        assert not proof.proved
        assert f"{name} = " not in proof.statement
        times = "the sum of the flight time and the contact time"
        meaning = {"period": f"; period is {times}.", "frequency": f"; frequency is 1 over {times}."}
        assert meaning.get(name, "") in proof.statement
        assert proof.reasons[0].startswith("existence: ")

    def test_the_numbers_of_the_orbit_without_unknowns(self, tuned_hop):
        proof = prove(tuned_hop, tune=(), at={}, motion=False)
        assert proof.proved
        assert proof.parameters["k"].low == proof.parameters["k"].high == repr(tuned_hop.source.values["k"])

    def test_a_quantity_of_the_whole_motion(self):
        """No equation prescribes the clearance: then the theorem has the number that was tuned."""
        orbit = find(Hopper("r + beta*r**3", parameters={"beta": 0.3}), tune="beta", at={"stroke": 3.0})
        claim = claim_of(orbit, None)
        assert claim.tuned == ()
        assert claim.prescribed == {}

    @pytest.mark.parametrize(
        ("options", "telling"),
        [
            ({"parameters": {"k": "2"}}, "'k' is tuned"),
            ({"tune": "c"}, "'c'"),
            ({"at": 3.0}, "mapping of quantities"),
            ({"at": {"alpha": "three"}}, "not a decimal"),
        ],
    )
    def test_what_cannot_be(self, tuned_hop, options, telling):
        with pytest.raises(InputError, match=telling):
            prove(tuned_hop, **options)

    @pytest.mark.parametrize(
        ("options", "telling"),
        [
            ({"tune": ("k", "rest_length")}, "5 equations for 6 unknowns"),
            ({"at": {"alpha": 3, "period": 9}}, "6 equations for 5 unknowns"),
            ({"at": {"clearance": 1}}, "no equation of half an orbit contains 'clearance'"),
        ],
    )
    def test_what_is_not_proved(self, tuned_hop, options, telling):
        proof = prove(tuned_hop, **options)
        assert not proof.proved
        assert telling in proof.reasons[0]


class TestSecondProgram:
    @pytest.mark.slow
    def test_it_verifies_a_tuned_hop(self, document):
        assert check(document) == []

    @pytest.mark.parametrize(
        ("path", "value"),
        [
            (("machine", "prescribed"), [["alpha", "3.01"]]),
            (("machine", "prescribed"), [["period", "9.5"]]),
            (("machine", "prescribed"), [["stroke", "3"]]),
            (("machine", "prescribed"), []),
            (("machine", "tuned"), []),
            (("machine", "tuned"), ["rest_length"]),
            (("machine", "sticks"), ["y1"]),
            (("machine", "friction"), "0.5"),
            (("machine", "centre"), "y1"),
            (("enclosures", "k"), ["2.25", "2.26"]),
            (("parts", 0, "unknowns", "k"), ["2.24", "2.2401"]),
        ],
    )
    def test_it_refuses_what_is_false(self, document, path, value):
        false = copy.deepcopy(document)
        inner = false
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = value
        assert check(restated(false))


@pytest.fixture(scope="module")
def stated():
    found = stated_machine(fast_runner(), {})
    return found.with_tuned(("inertia", "hip_stiffness", "step"), {"speed": "0.4"})


class TestMechanics:
    def test_accelerations_and_forces(self):
        """Exact ones at a point, beside those by hand."""
        m = ExactMechanics(stated_machine(fast_runner(), {}), Scale())
        rng, values = np.random.default_rng(3), fast_runner().values
        for standing in (False, True):
            n = 3 if standing else 5
            x = rng.uniform(-0.3, 0.3, 2 * n)
            x[-6] += 3.0
            symbols = [each for pair in zip(*((m.s, m.w) if standing else (m.y, m.v)), strict=True) for each in pair]
            outputs = m.contact_accelerations[0] if standing else m.accelerations[0]
            forces = [m.contact_force[0], *m.holding_forces[0]] if standing else []
            found = [float(each) for each in BallProgram(symbols, [*outputs, *forces])([arb(each) for each in x])]
            rates, holding = rates_by_hand(x, {name: values[name] for name in NAMES}, standing)
            assert np.allclose(found, [*rates[1::2], *(holding if standing else [])], rtol=1e-13, atol=1e-13)

    def test_the_count_of_equations(self, stated):
        half = HalfOrbit(ExactMechanics(stated, Scale()))
        assert len(half.statement(True).unknowns) == 11
        for tuned, prescribed, telling in (
            (("inertia", "step"), {"speed": "0.4"}, "11 equations for 10"),
            (("inertia", "step", "hip_stiffness"), {}, "10 equations for 11"),
            ((), {}, "10 equations for 8"),
        ):
            other = stated_machine(fast_runner(), {}).with_tuned(tuned, prescribed)
            with pytest.raises(Unproved, match=telling):
                HalfOrbit(ExactMechanics(other, Scale())).statement(True)

    @pytest.mark.parametrize(
        ("changes", "telling"),
        [
            ({"potentials": ("x**2/10",)}, "depends on the place"),
            ({"potentials": ("x/10",)}, "does not reverse"),
            ({"separation": "l + x"}, "depends on the place"),
            ({"reversor": (("theta", "-theta"), ("phi", "-phi"))}, "reversor"),
            ({"reversor": (("theta", "-theta"), ("phi", "-phi"), ("x", "1 - x"))}, "where it sticks"),
            ({"symmetry": (("x", "x - 1"),)}, "where it sticks"),
            ({"reversor": (("theta", "-theta"), ("phi", "phi"), ("x", "step - x"))}, "does not reverse"),
        ],
    )
    def test_what_is_no_runner(self, stated, changes, telling):
        with pytest.raises(Unproved, match=telling):
            ExactMechanics(replace(stated, **changes), Scale())

    def test_a_hip_that_is_not_odd(self):
        stated = stated_machine(runner(hip_spring="hip_stiffness*r"), {})
        springs = replace(stated.springs[1], force=("hip_stiffness*r + r**2",))
        with pytest.raises(Unproved, match="odd"):
            ExactMechanics(replace(stated, springs=(stated.springs[0], springs)), Scale())

    @pytest.mark.parametrize("needed", [0.25404979, 0.25, 1.0, 0.09999, 12.3456])
    def test_friction_is_rounded_up(self, needed):
        above = Fraction(rounded_up(needed)) / Fraction(needed)
        assert 1 < above < Fraction(1011, 1000)


@pytest.fixture(scope="module")
def run():
    return find(runner(foot_mass=0.1, rest_length=3.7), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})


@pytest.fixture(scope="module")
def proof(run):
    with default_limit(120):  # of processor time
        return prove(run)


@pytest.fixture(scope="module")
def found(run):
    claim = claim_of(run, None)
    return existence_of(claim, claim.stated({}), True, None)


@SLOW
class TestRun:
    """The run with speed 0.4, and what is false of it."""

    def test_all_is_proved(self, proof):
        assert proof.reasons == ()
        assert set(proof.conditions) == {*CONDITIONS, "heights", "friction"}
        assert set(proof.conditions.values()) == {"proved"}
        assert proof.proved
        for name in ("inertia", "hip_stiffness", "step"):
            assert meets(proof.enclosures[name], FAST[name], 1e-15 * FAST[name])
            assert proof.enclosures[name].width < 1e-16
        assert meets(proof.flight_time, 2 * FAST["half flight"], 1e-15)
        assert meets(proof.contact_time, 2 * FAST["half contact"], 1e-15)
        assert proof.stated["friction"] == "0.2541"
        assert proof.stated["prescribed"] == [["speed", "0.4"]]
        assert "There are numbers inertia, hip stiffness, step for which" in proof.statement
        assert "with speed = 0.4, exactly, have a solution" in proof.statement

    def test_the_second_program(self, proof):
        """It takes long, and is the one proof of a run that the second program verifies."""
        assert check(json.loads(json.dumps(proof.document()))) == []

    @pytest.mark.parametrize(
        ("name", "value"),
        [
            ("symmetry", [["x", "x - 1.5"]]),
            ("sticks", []),
            ("tuned", ["inertia", "step"]),
            ("inertia", [["0"] * 5] * 4 + [["0"] * 4 + ["inertia + theta/10"]]),
        ],
    )
    def test_the_second_program_refuses(self, proof, name, value):
        document = json.loads(json.dumps(proof.document()))
        document["machine"][name] = value
        assert check(restated(document))

    @pytest.mark.parametrize(
        ("condition", "changes", "verdict"),
        [
            ("friction", {"friction": "0.25406"}, "proved"),  # that of the theorem, 0.2541, is proved above
            ("friction", {"friction": "0.254"}, "refuted"),
            ("friction", {"friction": "0.248"}, "refuted"),  # below the limit at landing
            ("friction", {"friction": "-0.3"}, "refuted"),
            ("friction", {"friction": ("0.2541", "0.3")}, "proved"),
            ("friction", {"friction": ("0.2540", "0.3")}, "refuted"),
            ("clearance", {"gap": [Fraction(0), Fraction(-1), *[Fraction(0)] * 3]}, "refuted"),
            ("contact_force", {"contact_force": -1}, "refuted"),
            ("friction", {"holding_forces": 2}, "refuted"),
            ("friction", {"holding_forces": -1}, "proved"),
            ("separation", {"separation": -1}, "refuted"),
            ("heights", {"heights": Fraction(-1, 2)}, "proved"),
            ("heights", {"heights": -4}, "refuted"),
        ],
    )
    def test_false_conditions(self, found, condition, changes, verdict):
        half = copy.copy(found.half)
        half.mechanics = m = copy.copy(half.mechanics)
        (name, value), *_ = changes.items()
        if name == "friction" and isinstance(value, tuple):
            bounds = {"mu": tuple(map(Fraction, value))}
            m.stated = replace(m.stated, friction="mu", parameters={**m.stated.parameters, **bounds})
        elif name == "friction":
            m.stated = replace(m.stated, friction=value)
        elif name == "gap":
            m.gap = value
        elif name == "separation":
            m.separation = value * m.separation
        elif name == "heights":  # the body's, raised
            m.heights = [(each, height + value if each == "body" else height) for each, height in m.heights]
        elif name == "contact_force":
            m.contact_force = [value * each for each in m.contact_force]
        else:
            m.holding_forces = [[value * each for each in law] for law in m.holding_forces]
        flight, contact = map(Motion, found.equations.legs, found.root.evaluated.passages)
        verdicts = motion_conditions(half, flight, contact, [condition])
        assert verdicts.conditions == {condition: verdict}
        if name == "friction" and verdict == "refuted":
            assert "x needs a coefficient in [0.2540" in verdicts.reasons[0]

    def test_the_needed_friction(self, found):
        """It is that of SciPy's integration."""
        m, contact = found.half.mechanics, Motion(found.equations.legs[1], found.root.evaluated.passages[1])
        along = [held[0] for held in m.holding_forces]
        needed = needed_friction(contact, contact.chain(m.contact_force, 1), contact.chain(along, 1))
        assert needed.contains(arb(FAST["friction"]))
        assert needed.rad() < 2e-4
