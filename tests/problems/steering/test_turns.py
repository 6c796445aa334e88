"""Turns of the extension: deep ones by hand, and those of hops of which two turns merge as damping grows."""

import numpy as np
import pytest

from orbits import Mechanism, find, find_all, starts
from orbits.mechanics import Damper, Mass, Spring
from problems import Actuator, Hopper, steering
from problems.steering.turns import deep_turns, turns_of_leg, turns_of_orbit


@pytest.mark.parametrize(
    ("values", "turns"),
    [
        ([0.0, 1.0], 0),
        ([0.0, 1.0, 0.0], 1),
        ([0.0, 1.0, 0.97, 1.1, 0.0], 1),
        ([0.0, 1.0, 0.9, 1.1, 0.0], 3),
        ([0.0, 0.01, -1.0, 1.0, 0.99], 1),
        ([1.0, 1.0, 1.0], 0),
    ],
)
def test_turns_that_are_not_shallow(values, turns):
    assert deep_turns(values) == deep_turns(np.negative(values)) == turns


@pytest.mark.parametrize("family", [1, 2, 3])
def test_a_linear_hopper_turns_deeply(family, driven_hopper):
    """Its extension is a cosine, from -1 to 1 of one amplitude."""
    orbit, extension = find(Hopper(), family), driven_hopper.actuated.model.extension
    assert turns_of_orbit(orbit, extension) == (2 * family + 1, 2 * family + 1)
    assert turns_of_leg(driven_hopper.legs[0], extension) == (3, 3)


@pytest.mark.slow
def test_two_turns_may_merge_on_the_way_from_the_lossless_hop():
    """The lossless hop of a leg that carries a pack has two shallow turns, which little damping takes away."""
    springs = [Spring("pack - body", "4000*r"), Spring("body - foot", "6000*r + 3e5*r**3")]
    masses = [Mass("pack", 3.0), Mass("body", 7.5), Mass("foot", 1.5)]
    stated = {"coordinates": ("pack", "body", "foot"), "gap": "foot", "gravity": 9.81, "in_si": True}
    leg = Mechanism(elements=[*masses, *springs], **stated)
    damped = Mechanism(elements=[*masses, *springs, Damper("pack - body", 0.5)], **stated)
    hop = next(hop for hop in find_all(leg, starts(leg)) if hop.admissible)
    held = steering.keep_hopping(damped, actuator=Actuator("body - foot"), start=hop, intervals=12)
    extension = held.actuated.model.extension
    assert turns_of_orbit(hop, extension) == (1, 3)
    assert turns_of_leg(held.legs[0], extension) == (1, 1)
    assert held.legs[0].duration == pytest.approx(hop.flight_time, rel=1e-4)
