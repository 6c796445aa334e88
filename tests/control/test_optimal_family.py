"""Families of optimal motions: closed forms of a cart's costs, bounds, ends and lost minima, and independent solves."""

import pickle

import numpy as np
import pytest
from carts import STRAIGHT, cart
from legibility import faults

from orbits import InputError, NoOrbit, steer
from orbits.control import Guess, Input, Stage
from orbits.model import Phase

TO_D = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - p["d"], x[1]]}


def to(distance: float, **stage):
    """The cart from rest to rest over a distance d, in a time of 1."""
    return steer([cart(**{**TO_D, **stage})], {"d": distance}, guess=STRAIGHT)


def test_a_cart_to_any_distance():
    """Costs 12 d^2, of which the slope is 24 d."""
    family = to(1.0).follow("d", 3.0, at=[2.0])
    assert family.end.kind == "reached"
    assert not family.events
    assert family.costs == pytest.approx(12 * family.values**2, rel=1e-12)
    assert family.slopes == pytest.approx(24 * family.values, rel=1e-11)
    motion = family.at(1.7)
    assert motion.cost == pytest.approx(12 * 1.7**2, rel=1e-12)
    assert motion.parameters == {"d": 1.7}
    assert max(motion.error, motion.violation) < 1e-12
    assert motion.legs[0].inputs(0.25)[0] == pytest.approx(1.7 * 3, rel=1e-10)


def test_bounds_become_active_until_no_motion_is_left():
    """|f| <= 9 is reached at both ends at d = 1.5, and with f at one bound after the other d is 9/4 at most."""
    family = to(1.0, low=-9.0, high=9.0).follow("d", 3.0)
    first, second = family.events[:2]
    assert [first.kind, second.kind] == ["enters", "enters"]
    assert [first.value, second.value] == pytest.approx([1.5, 1.5], abs=1e-9)
    assert "input 'f' of stage 1 (cart), interval" in first.what
    assert family.end.kind == "infeasible"
    assert family.values[-1] == pytest.approx(2.25, abs=1e-9)
    assert family.costs[-1] == pytest.approx(81, abs=1e-6)
    assert len(family.active[-2]) >= 4
    back = to(2.2, low=-9.0, high=9.0).follow("d", 1.0)
    assert {each.kind for each in back.events} == {"leaves"}
    assert back.costs[-1] == pytest.approx(12, abs=1e-9)
    assert back.at(2.1).cost == pytest.approx(to(2.1, low=-9.0, high=9.0).cost, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("intervals", "shift"), [(3, 0.0), (4, 0.1)])
def test_a_path_condition_is_touched_within_an_interval(intervals, shift):
    """The speed d (6 t - 6 t^2) comes to 2 at d = 4/3. On three intervals it is 2 on all of the middle one from d = 3/2
    on; with the shift the touch moves."""
    path = {"slower": lambda x, p, q: 2.0 + shift * (x[0] - 0.5 * p["d"]) - x[1]}
    family = to(1.0, intervals=intervals, path=path).follow("d", 1.54)
    assert family.end.kind == "reached"
    enters = [each for each in family.events if each.kind == "enters"]
    if not shift:
        assert [each.value for each in enters] == pytest.approx([4 / 3, 3 / 2], abs=1e-9)
    assert len(enters) >= 1
    for distance in (1.4, 1.53):
        own, solved = family.at(distance), to(distance, intervals=intervals, path=path)
        assert max(own.error, own.violation) <= 1e-9
        assert own.cost == pytest.approx(solved.cost, rel=1e-8)


def test_from_rest_at_no_cost():
    """The first point has neither control nor multipliers."""
    family = to(0.0).follow("d", 1.0, at=[1e-3])
    assert family.costs[0] == pytest.approx(0, abs=1e-20)
    assert family.costs[family.values == 1e-3] == pytest.approx(12e-6, rel=1e-9)


def buckled(intervals: int):
    """A path x(t), x(0) = x(1) = 0, of cost x'^2 - k x^2, where x is linear on each interval."""
    rod = Phase("rod", ("x",), lambda x, p, q: [p["f"]])
    ends = {"start": lambda x, before, p: x, "end": lambda x, p: x}
    cost = lambda x, p, q: p["f"] ** 2 - p["k"] * x[0] ** 2  # noqa: E731
    stage = Stage(rod, intervals, (1.0, 1.0), {"f": Input()}, **ends, running=cost)
    return steer([stage], {"k": 1.0}, guess=[Guess(1.0, lambda t: [0.0])])


def test_a_minimum_is_lost_where_the_rod_buckles():
    """At k = 6 N^2 (1 - cos(pi/N)) / (2 + cos(pi/N)), Euler's load for elements of length 1/N."""
    n = 6
    family = buckled(n).follow("k", 12.0)
    load = 6 * n**2 * (1 - np.cos(np.pi / n)) / (2 + np.cos(np.pi / n))
    assert family.end.kind == "bifurcation"
    assert family.values[-1] == pytest.approx(load, rel=1e-6)
    assert family.events[-1].kind == "bifurcation"
    axes = family.plot()
    assert {text.get_text() for text in axes.get_legend().get_texts()} == {event.kind for event in family.events}
    assert axes.lines[-1].get_xdata()[-1] == pytest.approx(load, rel=1e-6)
    assert not faults(axes.figure)


@pytest.mark.parametrize(
    ("follow", "words"),
    [
        (lambda found: found.follow("zzz", 2.0), "'zzz' is not a parameter with a value; choose one of d"),
        (lambda found: found.follow("d", 1.0), "this value of d already"),
        (lambda found: found.follow("d", np.nan), "not a finite number"),
        (lambda found: found.follow("d", 2.0, at=[3.0]), "at = 3 is not reached: d goes from 1 to 2"),
        (lambda found: found.follow("d", 2.0, at=1.5), "it must be a list of values"),
        (lambda found: found.follow("d", 2.0, most=0), "a number of points, at least 1"),
        (lambda found: found.follow("d", 2.0, longest=-1.0), "it must be a share of the way"),
        (lambda found: pickle.loads(pickle.dumps(found)).follow("d", 2.0), "find it again"),
    ],
)
def test_what_cannot_be_followed(follow, words):
    with pytest.raises(InputError, match=words):
        follow(to(1.0))


def test_a_saddle_is_not_followed():
    found = buckled(4)
    found.parameters["k"] = 20.0
    with pytest.raises(NoOrbit, match="second-order"):
        found.follow("k", 21.0)
