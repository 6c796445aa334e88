"""Bounds of an actuator hold along the whole motion, and what they cost."""

import numpy as np
import pytest

from orbits import InputError, NoOrbit
from problems import Actuator, Hopper, hopper_in_si, steering

MACHINE = Hopper(damping=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "bound", "share"),
    [("force", "force", 0.9), ("force", "rate", 0.9), ("force", "power", 0.8), ("displacement", "power", 0.9)],
)
def test_a_bound_holds_and_costs(kind, bound, share):
    """A bound below what the free motion takes: it holds on the dense motion, and less effort is impossible."""
    actuator = Actuator(kind=kind)
    free = steering.keep_hopping(MACHINE, actuator=actuator, intervals=20)
    most = {
        "force": free.largest[0],
        "power": free.largest[1],
        "rate": np.abs(free.schedule(actuator.rate)[1][actuator.rate]).max(),
    }
    found = steering.keep_hopping(MACHINE, actuator=actuator, intervals=20, **{bound: share * most[bound]})
    assert found.cost > free.cost
    t = np.linspace(0, found.end, 20001)
    size = {"force": found.force, "power": found.power, "rate": lambda t: found.inputs_at(t)[..., 0]}[bound]
    assert np.abs(size(t)).max() <= share * most[bound] * (1 + 1e-7)
    assert steering.missed(MACHINE, found) <= 1e-8


@pytest.mark.parametrize(("actuator", "share"), [(Actuator(kind="force"), 0.85), (Actuator("y1 - y2"), 0.97)])
def test_a_force_that_falls_with_the_speed(actuator, share):
    """Between the two lines of a motor at every instant, by the law of the spring and the motion of the masses; in SI
    as without units."""
    m, k = {"damping": 4.0}, 3000.0
    leg = hopper_in_si(12.0, 1.8, stiffness=k, rest_length=0.6, **m)
    free = steering.keep_hopping(leg, actuator=actuator, intervals=20)

    def moved(found):
        t = np.linspace(0.0, found.end, 20001)
        x, rates = found(t), found.inputs_at(t)[..., 0]
        if actuator.kind == "force":
            return x[:, 4], x[:, 1] - x[:, 3]
        return -k * (x[:, 0] - x[:, 2] - x[:, 4]), rates

    force, speed = moved(free)
    v0 = 1.5 * np.abs(speed).max()
    largest = share * np.max(np.abs(force) / (1 - np.sign(force) * speed / v0))
    found = steering.keep_hopping(leg, actuator=actuator, intervals=20, speed_force=(v0, largest), guess=free)
    force, speed = moved(found)
    left = np.array([largest * (1 - speed / v0) - force, largest * (1 + speed / v0) + force])
    assert -1e-7 * largest < left.min() < 1e-3 * largest
    drives = force * speed > 0
    assert (np.abs(force) <= largest * (1 - np.abs(speed) / v0) + 1e-7 * largest)[drives].all()
    assert found.cost > free.cost
    assert steering.missed(leg, found) <= 1e-8


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        (3.0, "speed_force = 3.0; it must be two numbers, the speed at which the driving force vanishes"),
        ((1.0, -2.0), r"speed_force = \(1, -2\): both numbers must be above 0"),
        ((1.0, np.inf), "speed_force = inf"),
    ],
)
def test_a_force_by_the_speed_is_two_numbers(stated, words):
    with pytest.raises(InputError, match=words):
        steering.keep_hopping(MACHINE, speed_force=stated)


@pytest.mark.parametrize("bound", ["rate", "stroke", "force", "power"])
def test_a_bound_is_above_zero(bound):
    with pytest.raises(InputError, match=f"{bound} = -1; a bound of the actuator must be above 0"):
        steering.keep_hopping(MACHINE, **{bound: -1.0})
    with pytest.raises(InputError, match=f"{bound} = .* is not a finite number"):
        steering.keep_hopping(MACHINE, **{bound: np.zeros(0)})


def test_a_bound_that_no_motion_meets_is_named():
    with pytest.raises(NoOrbit, match="force left to"):
        steering.keep_hopping(MACHINE, actuator=Actuator(kind="force"), intervals=20, force=1e-3)
