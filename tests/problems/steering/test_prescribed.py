"""Hops at a prescribed launch speed or height: independent solves, slopes, and the lossless orbits on the way."""

import pytest
from conftest import DAMPED_LEG

from orbits import InputError, find
from problems import Hopper, Juggler, steering

ALPHA = 4.493409457909064  # tan(alpha) = alpha


@pytest.fixture(scope="module")
def along_speed():
    at = [ALPHA + 1e-4, 4.6, 4.7, 4.8, 4.9]
    return steering.keep_hopping(Hopper(), speed=ALPHA).follow("speed", 5.0, at=at)


def test_without_damping_the_cost_grows_with_the_square_of_the_distance_from_the_lossless_speed(along_speed):
    assert along_speed.end.kind == "reached"
    assert along_speed.costs[0] == pytest.approx(0, abs=1e-20)
    near = along_speed.values == ALPHA + 1e-4
    (factor,), (half_slope,) = along_speed.costs[near] / 1e-8, along_speed.slopes[near] / 2e-4
    assert half_slope == pytest.approx(factor, rel=1e-5)
    below = steering.keep_hopping(Hopper(), speed=ALPHA).follow("speed", 4.4, at=[ALPHA - 1e-4])
    assert below.costs[below.values == ALPHA - 1e-4] / 1e-8 == pytest.approx(factor, rel=2e-4)


def test_the_cost_along_the_speed_is_what_independent_solves_find(along_speed):
    for speed in (4.6, 4.7, 4.8, 4.9, 5.0):
        solved = steering.keep_hopping(Hopper(), speed=speed)
        assert solved.launch == pytest.approx(speed, rel=1e-14)
        assert along_speed.costs[along_speed.values == speed] == pytest.approx(solved.cost, rel=1e-8)
    h = 1e-3
    slope = (along_speed.at(4.7 + h).cost - along_speed.at(4.7 - h).cost) / (2 * h)
    assert along_speed.slopes[along_speed.values == 4.7] == pytest.approx(slope, rel=1e-6)
    assert (along_speed.at(4.7).launch, along_speed.at(4.7).source) == (pytest.approx(4.7, rel=1e-14), Hopper())


def test_the_best_speed_of_a_damped_hop_is_that_which_is_left_free(driven_hopper):
    family = steering.keep_hopping(driven_hopper.source, speed=driven_hopper.launch).follow("speed", 4.55)
    assert family.costs[0] == pytest.approx(driven_hopper.cost, rel=1e-10)
    assert family.slopes[0] == pytest.approx(0, abs=1e-8)
    assert (family.costs[1:] > driven_hopper.cost).all()


def test_damping_is_followed_at_a_speed():
    family = steering.keep_hopping(Hopper(), speed=4.6, intervals=20).follow("damping", 0.05)
    solved = steering.keep_hopping(Hopper(damping=0.05), speed=4.6, intervals=20)
    assert family.costs[-1] == pytest.approx(solved.cost, rel=1e-8)
    assert family.at(0.05).launch == pytest.approx(4.6, rel=1e-14)


def test_a_period_is_prescribed_beside_the_speed(driven_hopper):
    """The best period is that which is left free; others cost more, and are followed."""
    machine, free = driven_hopper.source, driven_hopper.end
    same = steering.keep_hopping(machine, period=free)
    assert same.cost == pytest.approx(driven_hopper.cost, rel=1e-9)
    family = steering.keep_hopping(Hopper(), period=find(Hopper()).period, intervals=20).follow("period", 14.5)
    slower = steering.keep_hopping(Hopper(), period=14.5, intervals=20)
    assert family.costs[-1] == pytest.approx(slower.cost, rel=1e-8)
    run = steering.rerun(Hopper(), slower, hops=0)
    assert run.end == pytest.approx(14.5, rel=1e-12)
    assert steering.missed(Hopper(), slower) < 1e-8
    both = steering.keep_hopping(Hopper(), period=14.5, speed=4.6, intervals=20, guess=slower)
    assert (both.end, both.launch) == pytest.approx((14.5, 4.6), rel=1e-12)
    assert both.cost > slower.cost


def test_a_period_in_si():
    hop = steering.keep_hopping(DAMPED_LEG, intervals=20)
    longer = steering.keep_hopping(DAMPED_LEG, intervals=20, period=1.01 * hop.end, guess=hop)
    assert longer.end == pytest.approx(1.01 * hop.end, rel=1e-12)


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (
            lambda: steering.keep_hopping(Hopper(), speed=4.6, height=5.0),
            "give one of them; to follow one after",
        ),
        (lambda: steering.keep_hopping(Hopper(), speed=-4.6), "speed = -4.6; the speed of a hop must be above 0"),
        (lambda: steering.keep_hopping(DAMPED_LEG, period=-1.0), "period = -1 s; the period of a hop must be above 0"),
        (lambda: steering.keep_hopping(DAMPED_LEG, height=-0.1), "height = -0.1 m; the height of a hop must be"),
        (lambda: steering.keep_hopping(Juggler(), height=5.0), "no height 'centre of mass'"),
        (lambda: steering.keep_hopping(Hopper(drag=0.01), height=5.0), "other forces than gravity act"),
        (
            lambda: steering.keep_hopping(Hopper(), height=5.1, intervals=20).follow("drag", 0.01),
            "other forces than gravity act",
        ),
        (
            lambda: steering.keep_hopping(Hopper(), intervals=20).follow("speed", 5.0),
            r"the speed is not prescribed: take keep_hopping\(machine, speed=...\)",
        ),
        (
            lambda: steering.keep_hopping(Hopper(), speed=4.6, intervals=20).follow("speed", -1.0),
            "the speed of a hop must be above 0",
        ),
    ],
)
def test_launches_that_are_not_prescribed(wanted, words):
    with pytest.raises(InputError, match=words):
        wanted()
