"""Hops at which an actuator keeps a machine, held by feedback: against simulations."""

import numpy as np
import pytest

from orbits import InputError, find_all, simulate
from problems import Actuator, Chain, Hopper, hopper_in_si, steering
from problems.steering.actuated_launch import launched_at

FORCE = Actuator("y1 - y2", kind="force")


def disturbed(kept, held, error, hops=8):
    """The motion from a launch whose speed is off by a share, without units."""
    bare = kept.dimensionless()
    like = bare.actuated.model.launch_at(bare.legs[0].path(0.0))
    launch = launched_at(bare.actuated, like, like["alpha"] * (1 + error))
    return simulate(bare.actuated, launch, hops=hops, feedback=held), like["alpha"]


@pytest.fixture(scope="module", params=[None, FORCE], ids=["displacement", "force"])
def kept(request):
    return steering.keep_hopping(Hopper(damping=0.01), actuator=request.param, intervals=20)


@pytest.mark.parametrize("when", ["continuous", "lift-off"])
def test_a_damped_hop_is_held(kept, when):
    """Driven open loop it is lost; held, launches come back at the rate of the largest multiplier."""
    held = kept.hold(when=when)
    late = kept.simulate(hops=8, launch_error=-0.01 * kept.launch)
    assert len(late.launch_errors) < 9 or abs(late.launch_errors[-1]) > 0.02 * kept.launch
    motion, alpha = disturbed(kept, held, -0.01)
    assert abs(motion.launches[-1] / alpha - 1) < 1e-6
    near, _ = disturbed(kept, held, 1e-4, hops=4)
    off = near.launches - alpha
    assert off[4] / off[3] == pytest.approx(held.held_multipliers[0].real, abs=1e-3)
    assert len(held.names) == 2  # the actuator's state is a number of a launch


def test_limits_of_a_displacement():
    kept = steering.keep_hopping(Hopper(damping=0.01), intervals=20)
    held = kept.hold(rate=0.3, stroke=0.35)
    motion, alpha = disturbed(kept, held, 0.02, hops=10)
    assert abs(motion.launches[-1] / alpha - 1) < 1e-6
    states = motion(np.linspace(0.0, motion.end, 50_001))
    assert 0.3 < np.abs(states[:, 4]).max() <= 0.35 + 1e-9
    assert np.abs(motion.schedule[1]["w"]).max() <= 0.3 + 1e-12


@pytest.mark.parametrize("when", ["lift-off", "apex"])
def test_limits_of_what_is_decided_once(when):
    """On a fine grid of motions: the force and the displacement are states, and stay within their limits."""
    pushed = steering.keep_hopping(Hopper(damping=0.02), actuator=FORCE, intervals=20)
    moved = steering.keep_hopping(Hopper(damping=0.01), intervals=20)
    for kept, bound, limits in ((pushed, 0.2, {"force": 0.2}), (moved, 0.32, {"stroke": 0.32})):
        motion, alpha = disturbed(kept, kept.hold(when=when, **limits), 0.01)
        assert np.abs(motion(np.linspace(0.0, motion.end, 50_001))[:, 4]).max() <= bound + 1e-9
        assert abs(motion.launches[-1] / alpha - 1) < 1e-4


def test_a_landing_with_an_impact_is_not_decided_once():
    kept = steering.keep_hopping(Hopper(damping=0.02), actuator=FORCE, intervals=20, lossless=False)
    with pytest.raises(InputError, match="this hop lands with an impact; pass when='continuous'"):
        kept.hold(when="lift-off")


@pytest.mark.slow
def test_a_hopper_of_14_kg_with_a_motor():
    """In SI, with a motor of 400 N and 300 W: launches off by 5 % come back within its limits."""
    leg = hopper_in_si(12.0, 2.0, stiffness=4000.0, rest_length=0.6, damping=5.0)
    limits = {"force": 400.0, "power": 300.0, "speed_force": (4.0, 600.0)}
    kept = steering.keep_hopping(leg, actuator=FORCE, intervals=20, **limits)
    held = kept.hold(**limits)
    launch = kept.actuated.model.launch_at(kept.dimensionless().legs[0].path(0.0))
    assert "limits: force 400.0, power 300.0, speed_force (4.0, 600.0)" in str(held)
    for error in (0.05, -0.05, 0.01, -0.01):
        motion, alpha = disturbed(kept, held, error)
        assert abs(motion.launches[-1] / alpha - 1) < 1e-6
        own = kept.actuated.units
        x = motion(np.linspace(0.0, motion.end, 50_001))
        force, speed = x[:, 4] * own.force, (x[:, 1] - x[:, 3]) * own.length / own.time
        assert np.abs(force).max() <= 400.0
        assert np.abs(force * speed).max() <= 300.0
        drives = force * speed > 0
        assert (np.abs(force) <= 600.0 * (1 - np.abs(speed) / 4.0))[drives].all()
    assert launch["alpha"] == pytest.approx(alpha)
    late = kept.hold(delay=0.005, **limits)
    assert "0.005 s after the measurement" in str(late)
    assert late.held_multipliers == pytest.approx(held.held_multipliers, rel=1e-6)


@pytest.mark.slow
def test_a_chain_is_held_by_a_spring_whose_end_moves():
    chain = Chain((1, 1, 1))
    hop = find_all(chain, chain.starts(3.2, 4.6))[0]
    kept = steering.keep_hopping(chain, actuator=Actuator("y1 - y2"), start=hop, intervals=20)
    held = kept.hold()
    assert np.abs(held.held_multipliers).max() < 0.8
    motion, alpha = disturbed(kept, held, 0.01, hops=12)
    assert abs(motion.launches[-1] / alpha - 1) < 1e-4


def test_what_is_not_held():
    with pytest.raises(InputError, match="hold needs a periodic hop, such as keep_hopping returns"):
        steering.recover(Hopper(), 0.1, intervals=14).hold()
    with pytest.raises(InputError, match="stroke = -1; a bound of the actuator must be above 0"):
        steering.keep_hopping(Hopper(), intervals=14).hold(stroke=-1.0)
