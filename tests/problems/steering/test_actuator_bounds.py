"""Bounds of an actuator hold along the whole motion, and what they cost."""

import numpy as np
import pytest

from orbits import InputError, NoOrbit
from problems import Actuator, Hopper, steering

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


@pytest.mark.parametrize("bound", ["rate", "stroke", "force", "power"])
def test_a_bound_is_above_zero(bound):
    with pytest.raises(InputError, match=f"{bound} = -1: the actuator's bound is above 0"):
        steering.keep_hopping(MACHINE, **{bound: -1.0})
    with pytest.raises(InputError, match=f"{bound} = .* is not a finite number"):
        steering.keep_hopping(MACHINE, **{bound: np.zeros(0)})


def test_a_bound_that_no_motion_meets_is_named():
    with pytest.raises(NoOrbit, match="force left to"):
        steering.keep_hopping(MACHINE, actuator=Actuator(kind="force"), intervals=20, force=1e-3)
