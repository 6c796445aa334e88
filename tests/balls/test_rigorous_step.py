"""Rigorous steps against closed forms."""

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from ball_systems import THREE_HALVES, fn, power, system_of
from flint import arb, ctx

from orbits.balls import ball_of_fraction, between
from orbits.balls.crossing import NO_BREAKPOINTS
from orbits.balls.enclosure import follow_centre
from orbits.balls.rigorous_step import SETS, ball_coefficients, picard_coefficients, take_step
from orbits.exact import Unproved

GROWTH = system_of(1, lambda x: [x[0]])
OSCILLATOR = system_of(2, lambda x: [x[1], -x[0]])
SQUARE = system_of(1, lambda x: [x[0] ** 2])


def oscillated(start, t):
    x, v = start
    return [x * t.cos() + v * t.sin(), v * t.cos() - x * t.sin()]


# System, its flow, and a start.
CLOSED_FORMS = {
    "growth": (GROWTH, lambda start, t: [start[0] * t.exp()], [1.0]),
    "oscillator": (OSCILLATOR, oscillated, [0.5, 2.0]),
    "square": (SQUARE, lambda start, t: [start[0] / (1 - start[0] * t)], [1.0]),
}


@pytest.fixture(autouse=True)
def eighty_bits():
    with ctx.workprec(80):
        yield


def stepped(system, centre, spread=0.0, longest=2.0, order=25, accuracy=2.0**-70):
    n = len(centre)
    return take_step(system, [arb(c) for c in centre], [arb(spread)] * n, arb(longest), order, accuracy)


@pytest.mark.parametrize("spread", [0.0, 1e-9, 1e-2])
@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_the_tube_holds_every_solution_from_the_spread(name, spread):
    system, flow, centre = CLOSED_FORMS[name]
    step, rng = stepped(system, centre, spread), np.random.default_rng(1)
    assert 0 < float(step.h) <= 2
    for _ in range(40):
        start = [c + spread * shift for c, shift in zip(centre, rng.uniform(-1, 1, len(centre)), strict=True)]
        t = step.h * arb(float(rng.uniform()))
        with ctx.workprec(300):
            exactly = flow([arb(value) for value in start], t.mid())
        for each, whole, value in zip(step.at(t.mid()), step.at(between(arb(0), step.h)), exactly, strict=True):
            assert each.contains(value)
            assert whole.contains(value)
    with ctx.workprec(300):
        exactly = flow([arb(value) for value in centre], step.h)
    assert all(each.contains(value) for each, value in zip(step.end(), exactly, strict=True))


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_a_step_from_a_point_is_narrow(name):
    system, _, centre = CLOSED_FORMS[name]
    assert all(float(value.rad()) < 1e-18 for value in stepped(system, centre).end())


def test_a_step_is_no_longer_than_the_longest():
    assert stepped(OSCILLATOR, [0.5, 2.0], longest=2.0**-6).h == arb(2) ** -6


def test_the_defect_falls_with_the_order():
    tubes = []
    for order in (4, 8, 12, 16):
        step = stepped(OSCILLATOR, [0.5, 2.0], longest=0.25, order=order, accuracy=1.0)
        assert step.h == arb(0.25)
        tubes.append(max(float(radius) for radius in step.tube))
    assert all(later < 1e-3 * earlier for earlier, later in pairwise(tubes))


def test_steps_do_not_pass_where_the_solution_grows_beyond_all_bounds():
    """x' = x**2 from 1 is 1 / (1 - t)."""
    state, time = arb(1), arb(0)
    for _ in range(60):
        step = stepped(SQUARE, [state.mid()], state.rad(), 2 - time)
        time, (state,) = time + step.h, step.end()
        assert time < 1
        assert state.contains(1 / (1 - time))
    with pytest.raises(Unproved):
        follow_centre([SQUARE], NO_BREAKPOINTS, 0, [arb(1)], arb(2), 60)


def test_a_step_ends_before_any_solution_of_the_spread_grows_beyond_all_bounds():
    step = stepped(SQUARE, [1.0], 0.5, longest=10.0)
    assert float(step.h) < 1 / 1.5
    with pytest.raises(Unproved):
        stepped(SQUARE, [0.0], float("inf"))


@pytest.mark.parametrize(
    ("law", "place"),
    [(lambda x: 1 / x, 0.0), (lambda x: x**-2, 0.0), (lambda x: power(x, THREE_HALVES), 0.0), (fn.sqrt, -1.0),
     (fn.log, 0.0), (fn.atanh, 1.0), (fn.acos, 2.0), (fn.asin, 1.0), (fn.acosh, 1.0), (fn.cosh, 800.0),
     (fn.sinh, -800.0)],
    ids=["1/x", "x**-2", "x**1.5", "sqrt", "log", "atanh", "acos", "asin", "acosh", "cosh", "sinh"],
)  # fmt: skip
def test_a_step_from_where_a_law_has_no_value_is_refused(law, place):
    """What Arb says of a series without a value is no error of its own, but no proof."""
    with pytest.raises(Unproved):
        stepped(system_of(1, lambda x: [law(x[0])]), [place])


@pytest.mark.parametrize("spread", [0.5, 1.0, 2.0])
def test_a_spread_that_holds_a_pole_is_refused(spread):
    with pytest.raises(Unproved):
        stepped(system_of(1, lambda x: [1 / x[0]]), [0.5], spread)


# Systems by the states that are in one part, with their Taylor coefficients from a start by hand.
FACTORIALS = [math.factorial(k) for k in range(9)]
PARTS = {
    # x = cos t, v = -sin t; positions and speeds take turns.
    "undamped": (
        lambda x: [x[1], -x[0]], [1, 0], [{0}, {1}],
        [[(-1) ** (k // 2) * Fraction(1 - k % 2, f) for k, f in enumerate(FACTORIALS)],
         [(-1) ** (k // 2 + 1) * Fraction(k % 2, f) for k, f in enumerate(FACTORIALS)]],
    ),
    # Critical damping: x = t exp(-t), v = (1 - t) exp(-t).
    "damped": (
        lambda x: [x[1], -x[0] - 2 * x[1]], [0, 1], [{0, 1}],
        [[(-1) ** (k + 1) * Fraction(k, f) for k, f in enumerate(FACTORIALS)],
         [(-1) ** k * Fraction(k + 1, f) for k, f in enumerate(FACTORIALS)]],
    ),
    # A constant factor, and two oscillations that do not depend on each other.
    "factor": (
        lambda x: [x[2] * x[1], -x[2] * x[0], 0, x[2]], [1, 0, 2, 5], [{0, 3}, {1}],
        [[(-1) ** (k // 2) * Fraction((1 - k % 2) * 2**k, f) for k, f in enumerate(FACTORIALS)],
         [(-1) ** (k // 2 + 1) * Fraction(k % 2 * 2**k, f) for k, f in enumerate(FACTORIALS)],
         [2, *[0] * 8],
         [5, 2, *[0] * 7]],
    ),
    # The second rate contains a state that cancels.
    "cancelled": (
        lambda x: [x[1] + x[0] + -1 * x[0], -1 * x[0]], [1, 0], [{0, 1}],
        [[(-1) ** (k // 2) * Fraction(1 - k % 2, f) for k, f in enumerate(FACTORIALS)],
         [(-1) ** (k // 2 + 1) * Fraction(k % 2, f) for k, f in enumerate(FACTORIALS)]],
    ),
    "ring": (lambda x: [x[1], x[2], x[0]], [1, 1, 1], [{0, 1, 2}], [[Fraction(1, f) for f in FACTORIALS]] * 3),
}  # fmt: skip


@pytest.mark.parametrize("name", PARTS)
def test_coefficients_of_states_in_parts_are_those_of_the_solution(name):
    rates, start, parts, exactly = PARTS[name]
    system = system_of(len(start), rates)
    assert [{*part.states} for part in system.parts] == parts
    found = picard_coefficients(system, [arb(value) for value in start], 8)
    for row, values in zip(found, exactly, strict=True):
        assert len(row) == 9
        for ball, value in zip(row, values, strict=True):
            with ctx.workprec(300):
                assert ball.contains(ball_of_fraction(Fraction(value)))
            assert float(ball.rad()) < 1e-20


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_coefficients_beyond_those_of_picard(name):
    """Newton's iteration doubles their number, more than once; the exact ones are rational."""
    system, _, start = CLOSED_FORMS[name]
    order = 4 * SETS.most_by_picard + 3
    found = ball_coefficients(system, [arb(value) for value in start], order)
    x, *speed = map(Fraction, start)
    for k in range(order + 1):
        exact = {"square": x, "growth": x / math.factorial(k)}.get(name)
        if exact is None:
            exact = (-1) ** (k // 2) * (speed[0] if k % 2 else x) / math.factorial(k)
        assert len(found[0]) == order + 1
        with ctx.workprec(2000):
            assert found[0][k].contains(ball_of_fraction(exact))
        assert float(found[0][k].rad() / abs(found[0][k].mid())) < 1e-18


def test_the_step_does_not_shrink_where_coefficients_exceed_floats():
    """The coefficients of x' = 10 x**2 from 1 are 10**k."""
    with ctx.workprec(1045):
        step = stepped(system_of(1, lambda x: [10 * x[0] ** 2]), [1.0], order=376, accuracy=2.0**-1045)
    assert 0.005 < float(step.h) < 0.1


def test_a_division_by_a_constant_that_may_be_0_has_no_coefficients():
    system = system_of(2, lambda x: [1 / x[1], 0])
    with pytest.raises(Unproved, match="no value"):
        take_step(system, [arb(1), arb(0, 1)], [arb(0)] * 2, arb(1), 10, 1e-10)
