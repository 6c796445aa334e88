"""Machines of two coordinates: the extension that moves alone, and forces that open no contact."""

import pytest

from orbits import Mechanism, NoOrbit, OrbitsError, ReturnMap, find, simulate
from orbits.mechanics import Inerter, Mass, Potential, Spring, Weight
from problems import hopper_in_si, knee_hopper
from problems.laws import springs


def leg_in_si(law, *elements, **more) -> Mechanism:
    """A body of 60 kg and a foot of 3 kg on a spring, in SI."""
    masses = [Mass("body", 60.0), Mass("foot", 3.0)]
    given = {"elements": [*masses, Spring("body - foot", law), *elements], "gravity": 9.80665, "in_si": True}
    return Mechanism(**{"coordinates": ("body", "foot"), "gap": "foot", **given, **more})


def bent_leg(force) -> Mechanism:
    """A torsional spring in a knee, whose force along the leg is a function of the leg's bend from rest."""
    return knee_hopper().with_springs([force])


class TestForcesThatOpenNoContact:
    """What is told is the largest force of the spring itself, or the least one of the contact, by hand."""

    @pytest.mark.parametrize(
        ("stated", "telling"),
        [
            (leg_in_si("10*tanh(r)"), r"spring '10\*tanh\(r\)' never reaches the force .*\(largest tension 10 N\)"),
            (leg_in_si("5*tanh(r)", Inerter("body - foot", 2.0)), r"\(largest tension 5 N\)"),
            (leg_in_si("10*tanh(r)", words={"liftoff": "the foot's weight"}), "never reaches the foot's weight"),
            (hopper_in_si(60.0, 3.0, force="10*tanh(r)"), r"never reaches the foot's weight \(largest tension 10 N\)"),
            # The force along both springs is that of the one and twice that of the other, whose extension is double.
            (leg_in_si("10*tanh(r)", Spring("2*body - 2*foot", "4*tanh(r)")), r"\(largest tension 18 N\)"),
            # A foot that is heavier than inert falls faster than the body, which is no force of the spring.
            (leg_in_si("10*tanh(r)", Weight("foot", 1.0)), r"\(largest tension 10 N\)"),
            # The spring pulls the foot, of weight 29.41995 N, by 10 N at most.
            (
                leg_in_si("10*tanh(r)", Potential("0*body")),
                r"^the contact force never reaches 0 \(least force 19\.42 N\)",
            ),
            # Where the leg is straight, at pi, the force has a pole.
            (
                bent_leg("-stiffness*r"),
                r"^the contact force only just reaches 0 at extension 3\.14159 rad, with slope \S* N/rad",
            ),
            (bent_leg("log(r)"), r"no force at rest \(r = 0\): 'the contact force' is not a number there"),
        ],
    )
    def test_are_told_in_si(self, stated, telling):
        with pytest.raises(OrbitsError, match=telling):
            find(stated)

    def test_are_told_within_the_bounds_of_a_table(self):
        """The spring ends before it can lift the foot."""
        law = springs.table(([-1.0, -0.02, 0.0, 0.02], [-500.0, -10.0, 0.0, 10.0]))
        with pytest.raises(NoOrbit, match=r"\(largest tension 10 N within \[-1 m, 0\.02 m\]\)"):
            find(leg_in_si(law))

    def test_of_no_launch_at_all(self):
        """A leg that is too soft for its fall collapses."""
        assert ReturnMap(bent_leg("5*tanh(r)"))(5.0).next == pytest.approx(float("nan"), nan_ok=True)


def test_a_spring_that_does_not_move_the_gap_leaves_a_ball_to_its_bounces():
    """A ball falls from 1 with the acceleration 2, and each bounce lasts 0.7 of the one before."""
    masses = [Mass("other", 1.0), Spring("other"), Mass("ball", 1.0)]
    run = simulate(
        Mechanism(("other", "ball"), masses, gap="ball", gravity=2.0, restitution=0.7), state=[0.1, 0, 1, 0], time=9.0
    )
    assert run.events[-1].time == pytest.approx(1 + 2 * 0.7 / 0.3, rel=1e-14)
