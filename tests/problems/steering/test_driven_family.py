"""Hops of least effort along the numbers of a machine: the law of small damping, bounds, and independent solves."""

import numpy as np
import pytest

from orbits import InputError, NoOrbit
from problems import Hopper, springs, steering
from problems.steering.driven_family import _differenced


@pytest.fixture(scope="module")
def from_lossless():
    return steering.keep_hopping(Hopper()).follow("damping", 0.2, at=[1e-5, 1e-3, *np.linspace(0.004, 0.2, 50)])


@pytest.mark.slow
def test_the_law_of_small_damping_is_the_limit_of_the_family(from_lossless):
    """125.81085 c^2, from the lossless orbit with no control and no multipliers."""
    assert from_lossless.end.kind == "reached"
    assert not from_lossless.events
    assert from_lossless.values[0] == 0
    assert from_lossless.costs[0] == pytest.approx(0, abs=1e-20)
    c, cost, slope = from_lossless.values[1:], from_lossless.costs[1:], from_lossless.slopes[1:]
    first = c <= 1e-3
    assert (cost / c**2)[c == 1e-5] == pytest.approx(125.81085, abs=1e-5)
    assert (slope / c)[c == 1e-5] == pytest.approx(2 * 125.81085, abs=2e-5)
    assert (cost / c**2)[first] == pytest.approx(125.81085, abs=3e-4)
    assert np.abs(np.diff(cost) - np.diff(c) * (slope[1:] + slope[:-1]) / 2).max() < 1e-3  # the trapezium rule


@pytest.mark.slow
def test_a_landing_that_is_free_costs_111_9():
    """The contact force at the landing is above 0 below a damping of 0.003, and 0 from there on."""
    family = steering.keep_hopping(Hopper(damping=0.02), lossless=False).follow("damping", 1e-5)
    assert family.costs[-1] / 1e-10 == pytest.approx(111.9, abs=0.05)
    (leaves,) = family.events
    assert leaves.kind == "leaves"
    assert leaves.what == "'contact force' of stage 2 (contact)"
    for c, touches in ((leaves.value * 0.8, False), (leaves.value * 1.2, True)):
        hop = family.at(c)
        force = hop.motion.contact_force(hop.legs[1].start + 1e-12)
        assert (abs(force) < 1e-9) == touches
    below = family.values[-1]
    assert family.at(below).cost == pytest.approx(family.costs[-1], rel=1e-9)


def test_a_hop_of_the_family_is_one_of_its_machine(from_lossless):
    hop = from_lossless.at(0.1)
    assert hop.source == Hopper(damping=0.1)
    assert hop.periodic
    assert steering.missed(hop.source, hop) < 1e-12
    assert max(hop.error, hop.violation) < 1e-12
    assert hop.cost == pytest.approx(steering.keep_hopping(Hopper(damping=0.1)).cost, rel=1e-12)


@pytest.mark.slow
def test_a_stroke_bounds_the_damping():
    """Ever more bounds are active until no motion is left, as a solve beyond says too."""
    family = steering.keep_hopping(Hopper(damping=0.0965), stroke=0.4).follow("damping", 0.12)
    assert family.end.kind == "infeasible"
    assert family.values[-1] == pytest.approx(0.0978201886, abs=1e-9)
    assert {each.kind for each in family.events} == {"enters"}
    with pytest.raises(NoOrbit, match="no motion meets the conditions"):
        steering.keep_hopping(Hopper(damping=0.1), stroke=0.4)


def test_recoveries_are_what_independent_solves_find():
    """From a launch that is too slow to one that is too fast, through the lossless orbit, and into damping."""
    back = steering.recover(Hopper(), short=0.1, intervals=20)
    family = back.follow("short", -0.2, at=[0.0])
    assert family.costs[family.values == 0] == pytest.approx(0, abs=1e-20)
    for hop, found in (
        (Hopper(), family.at(-0.2)),
        (Hopper(damping=0.02), back.follow("damping", 0.02).at(0.02)),
    ):
        short = found.parameters["aim"] - found.parameters["launch"]
        assert found.cost == pytest.approx(steering.recover(hop, short=short, intervals=20).cost, rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("follow", "words"),
    [
        (lambda: steering.keep_hopping(Hopper()).follow("zeta", 1.0), "'zeta' is not a number of this motion"),
        (lambda: steering.recover(Hopper(), short=0.1).follow("mass_ratio", 0.9), "the target orbit changes"),
        (lambda: steering.recover(Hopper(), short=0.1).follow("short", 5.0), "leaves no launch speed"),
        (
            lambda: steering.keep_hopping(Hopper(damping=0.02), lossless=False).follow("damping", 0.0),
            "the landing is lossless: follow to a number above 0",
        ),
        (
            lambda: steering.keep_hopping(
                Hopper(springs.bilinear(ratio=2.0, gap=0.5), damping=0.01), intervals=14
            ).follow("damping", 0.02),
            "the law of the spring has corners",
        ),
    ],
)
def test_what_is_not_followed(follow, words):
    with pytest.raises(InputError, match=words):
        follow()


@pytest.mark.parametrize("width", [1.0, 1e-6, 1e-9])
def test_differences_of_numbers_in_ranges_of_all_widths(width):
    """The cube of a number from 2 on, whose slope is 3 x^2."""
    at = _differenced(lambda x: np.array([x**3]), 2.0, 2.0 + width)
    for value in 2.0 + width * np.array([0.0, 0.3, 1.0]):
        numbers, slopes = at(value)
        assert numbers == pytest.approx([value**3], rel=1e-15)
        assert slopes == pytest.approx([3 * value**2], rel=1e-6)
