"""Disturbed launches of machines that are held: what comes back, and what it costs."""

import numpy as np
import pytest

from orbits import InputError, find, simulate
from orbits.control import HeldLaunches, hold
from orbits.control.held_launches import effects_along
from orbits.hops import Impacts
from problems import Actuator, Hopper, hopper_in_si, steering
from problems.steering.actuated_launch import launched_at


@pytest.fixture(scope="module")
def held():
    return hold(find(Hopper()), "y1 - y2", force=1.0)


def test_launches_that_come_back(held):
    found = held.launches([-0.02, 0.02, 0.0], hops=5)
    assert found.returned.all()
    assert found.share == 1.0
    assert found.off[:, 0] == pytest.approx([0.02, 0.02, 0.0], abs=1e-12)
    assert found.hops[2] == 0
    assert found.work[2] == pytest.approx(0.0, abs=1e-9)  # on the cycle itself the feedback costs nothing
    assert found.off[2].max() < 1e-9
    assert "multipliers with the feedback: modulus 0.06945" in str(found)


def test_the_work_is_what_the_energy_gains(held):
    """Of a launch that is too fast and one too slow: the work of the force is the energy gained and that of impacts."""
    orbit = find(Hopper())
    for error in (-0.02, 0.02):
        launch = {"alpha": orbit.alpha * (1 + error), "liftoff": orbit.liftoff_extension}
        motion = simulate(held.machine, launch, hops=3, feedback=held)
        force, speed, weights = effects_along(held, motion)
        rules = Impacts(Hopper())
        gained = rules.energy(motion(motion.end)) - rules.energy(motion(0.0))
        lost = sum(event.loss for event in motion.events if event.kind != "lift-off")
        # The energy of the model is in units of the foot's weight over the mass ratio, 1 here.
        assert weights @ (force * speed) == pytest.approx(gained + lost, rel=1e-6, abs=1e-9)


def test_the_largest_force_is_that_at_the_ends_of_ramps():
    """A force that is a state changes linearly: its largest is at one of its corners, and was measured between."""
    kept = steering.keep_hopping(Hopper(damping=0.02), actuator=Actuator("y1 - y2", kind="force"), intervals=20)
    held = kept.hold()
    launch = launched_at(kept.actuated, (like := kept.actuated.model.launch_at(kept(0.0))), like["alpha"])
    motion = simulate(kept.actuated, launch, hops=3, feedback=held)
    corners = motion(np.clip(motion.schedule[0], 0.0, motion.end))[:, 4]
    assert np.abs(effects_along(held, motion)[0]).max() == pytest.approx(np.abs(corners).max(), rel=1e-12)


def test_noise_leaves_launches_near(held):
    found = held.launches([0.01, -0.01], hops=12, noise=1e-4, seed=3, within=0.02)
    assert found.returned.all()
    assert 1e-6 < found.off[:, -1].max() < 0.02
    again = held.launches([0.01, -0.01], hops=12, noise=1e-4, seed=3, within=0.02)
    assert (again.off == found.off).all()  # by the seed


def test_launches_that_are_lost():
    """A force that is too weak holds none that is too slow by 5 %."""
    found = hold(find(Hopper()), "y1 - y2", force=0.02).launches([-0.05], hops=6)
    assert not found.returned.any()
    assert found.share == 0.0
    assert np.isnan(found.hops).all()
    assert found.force[0] <= 0.02


def test_simulated_multipliers_with_an_actuator():
    """The actuator's state is a number of the launch."""
    for actuator in (None, Actuator("y1 - y2", kind="force")):
        held = steering.keep_hopping(Hopper(damping=0.01), actuator=actuator, intervals=20).hold()
        assert held.simulated_multipliers() == pytest.approx(held.held_multipliers, abs=1e-4)


@pytest.mark.slow
def test_launches_in_si(tmp_path):
    leg = hopper_in_si(12.0, 2.0, stiffness=4000.0, rest_length=0.6, damping=5.0)
    limits = {"force": 15.0, "power": 300.0}
    kept = steering.keep_hopping(leg, actuator=Actuator("y1 - y2", kind="force"), intervals=20, **limits)
    found = kept.hold(**limits).launches([-0.02, 0.02], hops=8)
    assert found.returned.all()
    assert found.force.max() <= 15.0
    assert found.speeds[:, -1] == pytest.approx(kept.launch, rel=1e-4)
    assert kept.work[1] < found.work.max() < 1.5 * kept.work[1]
    assert "work per hop (J)" in str(found)
    again = HeldLaunches.load(found.save(tmp_path / "held.json"), kept.actuated)
    assert str(again) == str(found)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"errors": [-1.5]}, "errors = .* they must be shares of the launch speed above -1"),
        ({"noise": -0.1}, "noise = -0.1, within = 0.001:"),
        ({"hops": 0}, "hops = 0"),
    ],
)
def test_invalid_launches(held, options, words):
    with pytest.raises(InputError, match=words):
        held.launches(**{"errors": [0.01], **options})
