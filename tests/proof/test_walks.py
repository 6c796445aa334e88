"""Proofs of a walker, which stands on one foot in flight and on both in contact."""

import copy
import json
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from flint import arb
from proofs import CONDITIONS, meets, restated

from orbits import find, prove
from orbits.balls import BallProgram, Motion
from orbits.check_proof import Machine, Unverified, bounds_of, check
from orbits.exact import ExactMechanics, HalfOrbit, Scale, Unproved, claim_of, stated_machine, unknown
from orbits.model import NORMAL_FORCE, TANGENTIAL_FORCE
from orbits.proof.proved_existence import existence_of
from orbits.proof.proved_motion import motion_conditions
from orbits.proof.sticking_friction import ground_forces
from orbits.running import default_limit
from problems import walker

TUNE = ("torso_inertia", "hip_stiffness")
# Of the walk with the step angle 0.3, the numbers of two programs in other coordinates.
KNOWN = {"liftoff": 0.375, "alpha": 0.83, "angle": -0.3, "duration": 2.3901085903795560, "contact_duration": 0.4044357}
TUNED = {"torso_inertia": 0.41824193818688386, "hip_stiffness": 0.39402694221511943}
OTHER = {"leg_mass": 0.15, "leg_centre": 0.6, "leg_inertia": 0.02, "torso_height": 0.3, "leg_spring": 0.05}


@pytest.fixture(scope="module")
def walk():
    return find(walker(**TUNED), start=KNOWN, tune=TUNE, at={"angle": 0.3})


@pytest.fixture(scope="module")
def stated():
    return replace(stated_machine(walker(), {}).with_tuned(TUNE, {"angle": "0.3"}), friction="0.1906")


class TestMechanics:
    def test_the_forces_on_both_feet_move_the_torso(self):
        """In contact only the torso swings, and the forces on both feet together carry and move it."""
        m = ExactMechanics(stated_machine(walker(**OTHER), {}), Scale())
        (force, (along,)), p = (m.contact_force[0], m.holding_forces[0]), walker(**OTHER).values
        images = m.contact_reversor.turned([force, along], m.s, m.w)
        program = BallProgram([*m.s, *m.w, unknown("angle")], [*m.contact_accelerations[0], force, along, *images])
        mass, lever = 1 - 2 * p["leg_mass"], p["torso_height"]
        for torso, rate, angle in np.random.default_rng(5).uniform(-0.4, 0.4, (5, 3)):
            bend, across, forward, other, mirrored = map(float, program([arb(x) for x in (torso, rate, angle)]))
            swing = mass * lever * np.sin(torso) - 2 * p["hip_stiffness"] * torso
            assert bend == pytest.approx(swing / (mass * lever**2 + p["torso_inertia"]), rel=1e-13)
            moved = (
                mass
                * lever
                * np.array(
                    [-np.sin(torso) * bend - np.cos(torso) * rate**2, np.cos(torso) * bend - np.sin(torso) * rate**2]
                )
            )
            assert across + other == pytest.approx(1 + moved[0], rel=1e-12)
            assert forward - mirrored == pytest.approx(moved[1], rel=1e-11)

    def test_the_forces_on_the_foot_that_stands(self):
        """In flight they are those that a certificate watches."""
        machine = walker(**OTHER)
        m, model = ExactMechanics(stated_machine(machine, {}), Scale()), machine.model
        states = [each for pair in zip(m.y, m.v, strict=True) for each in pair]
        x = np.random.default_rng(6).uniform(-0.5, 0.5, 6)
        found = BallProgram(states, ground_forces(m)[0])([arb(each) for each in x])
        watched = [model.flight.watch[name](list(x), machine.values, []) for name in (NORMAL_FORCE, TANGENTIAL_FORCE)]
        assert [*map(float, found)] == pytest.approx([*map(float, watched)], rel=1e-12)

    def test_the_count_of_equations(self, stated):
        assert [*HalfOrbit(ExactMechanics(stated, Scale())).statement(True).unknowns] == [
            *("liftoff", "alpha", "angle", "duration", "contact_duration", *TUNE)
        ]
        for prescribed, telling in (({}, "6 equations for 7"), ({"angle": "0.3", "period": "5"}, "8 equations for 7")):
            other = stated_machine(walker(), {}).with_tuned(TUNE, prescribed)
            with pytest.raises(Unproved, match=telling):
                HalfOrbit(ExactMechanics(other, Scale())).statement(True)

    @pytest.mark.parametrize(
        ("changes", "telling"),
        [
            ({"gap": "-2*leg_length*sin(lean + torso)*sin(angle)"}, "no formula that vanishes with one of them alone"),
            ({"gap": "-sin(lean)*cos(angle)"}, "do not vanish wherever the reversor"),
            ({"places": ()}, "sticks at 0 under the gap"),
            ({"symmetry": ()}, "where it sticks"),
            ({"symmetry": (("angle", "0.1 - angle"),)}, "its own inverse|where it sticks|closed gap"),
            ({"reversor": (("lean", "-lean"), ("angle", "-angle"))}, "does not"),
            ({"potentials": ("torso",)}, "does not reverse"),
        ],
    )
    def test_what_is_no_walker(self, stated, changes, telling):
        with pytest.raises(Unproved, match=telling):
            ExactMechanics(replace(stated, **changes), Scale())


class TestSecondProgram:
    """What it reads of the stated machine, before it follows a motion."""

    @staticmethod
    def read(stated, **changes):
        machine = json.loads(json.dumps(stated.document() | {"eliminated": "lean"})) | changes
        return Machine(machine, bounds_of(machine["parameters"]))

    def test_it_reads_a_walker(self, stated):
        found = self.read(stated)
        assert [*found.unknowns.values()] == [("liftoff", "alpha")]
        assert [found.names[i] for i in found.along] == ["angle"]

    @pytest.mark.parametrize(
        ("changes", "telling"),
        [
            ({"gap": "-2*leg_length*sin(lean + torso)*sin(angle)"}, "nor vanishes with a single one"),
            ({"gap": "-sin(lean)*cos(angle)"}, "middle of the flight"),
            ({"eliminated": "angle"}, "is the gap"),
            ({"places": []}, "a place along the ground"),
            ({"places": [["torso", "0"]]}, "a place along the ground"),
            ({"symmetry": []}, "where it sticks"),
            ({"reversor": [["lean", "-lean"], ["angle", "-angle"]]}, "do not reverse"),
            ({"potentials": ["torso"]}, "do not reverse"),
            ({"prescribed": [["angle", "0.3"]]}, "does not verify that 'angle' is prescribed"),
            ({"prescribed": [["torso_at_landing", "0.3"]]}, "does not verify"),
        ],
    )
    def test_it_refuses_what_is_no_walker(self, stated, changes, telling):
        with pytest.raises(Unverified, match=telling):
            self.read(stated, **changes)


@pytest.fixture(scope="module")
def proof(walk):
    with default_limit(120):  # of processor time
        return prove(walk)


@pytest.fixture(scope="module")
def found(walk):
    claim = claim_of(walk, None)
    return existence_of(claim, claim.stated({}), True, None)


@pytest.mark.slow
class TestWalk:
    """The walk with the step angle 0.3, and what is false of it."""

    def test_all_is_proved(self, proof):
        """Where the torso's centre of mass is the hip, some numbers have closed forms."""
        assert proof.reasons == ()
        assert set(proof.conditions) == (CONDITIONS - {"separation"}) | {"heights", "friction", "stance"}
        assert set(proof.conditions.values()) == {"proved"}
        unknowns = proof.parts[0].unknowns
        with mp.workdps(40):
            stiffness, inertia = mp.mpf("0.4") * mp.sin("0.3") / mp.mpf("0.3"), mp.mpf(unknowns["torso_inertia"].low)
            frequency, alpha = mp.sqrt(2 * stiffness / inertia), mp.mpf(unknowns["alpha"].low)
            contact = 2 * mp.atan(frequency * mp.mpf("0.375") / alpha) / frequency
            assert meets(proof.enclosures["hip_stiffness"], mp.nstr(stiffness, 35), "1e-30")
            assert meets(proof.contact_time, mp.nstr(contact, 35), "1e-18")
        assert meets(unknowns["liftoff"], "0.375")
        assert meets(unknowns["angle"], "-0.3")
        assert meets(proof.flight_time, 2 * KNOWN["duration"], 1e-15)
        assert meets(proof.enclosures["torso_inertia"], TUNED["torso_inertia"], 1e-15)
        assert proof.enclosures["torso_inertia"].width < 1e-18
        assert proof.stated["friction"] == "0.1906"
        assert "with angle at landing = 0.3, exactly, have a solution" in proof.statement
        assert "there the point passes the ground tangentially and without a force" in proof.statement

    def test_the_second_program(self, proof):
        document = json.loads(json.dumps(proof.document()))
        assert check(document) == []
        false = copy.deepcopy(document)
        del false["conditions"]["stance"]
        assert "fewer conditions" in check(restated(false))[0]
        false = copy.deepcopy(document)
        for pairs in (false["enclosures"], false["parts"][0]["unknowns"]):
            pairs["torso_inertia"] = ["0.4182419382", "0.4182419383"]
        assert "the solution is not shown" in check(restated(false))[0]

    @pytest.mark.parametrize(
        ("condition", "changes", "verdict"),
        [
            ("stance", {"friction": "0.19058"}, "proved"),
            ("stance", {"friction": "0.19057"}, "refuted"),
            ("stance", {"friction": "-0.2"}, "refuted"),
            ("friction", {"friction": "-0.2"}, "refuted"),
            ("clearance", {"grazes": False}, "undecided"),
            ("clearance", {"height": -1}, "refuted"),
            ("contact_force", {"contact_force": -1}, "refuted"),
            ("heights", {"heights": -1}, "refuted"),
        ],
    )
    def test_false_conditions(self, found, condition, changes, verdict):
        half = copy.copy(found.half)
        half.mechanics = m = copy.copy(half.mechanics)
        ((name, value),) = changes.items()
        if name in ("friction", "grazes"):
            m.stated = replace(m.stated, **changes)
        elif name == "heights":
            m.heights = [(each, height + value) for each, height in m.heights]
        else:
            setattr(m, name, [value * each for each in m.contact_force] if name == "contact_force" else -m.height)
        flight, contact = map(Motion, found.equations.legs, found.root.evaluated.passages)
        assert motion_conditions(half, flight, contact, [condition]).conditions == {condition: verdict}
