"""Signs and turns of functions along motions in closed form: of a clock, whose state is the time."""

from contextlib import suppress

import numpy as np
import pytest
from ball_systems import clock_of, fn
from flint import arb, ctx

from orbits.balls import Motion, Refuted
from orbits.exact import Unproved
from orbits.symbolic import expression, symbol

END = 3.0


@pytest.fixture(autouse=True)
def eighty_bits():
    with ctx.workprec(80):
        yield


def clock(first=0.0, last=END, radius=0.0):
    """The motion of a clock between two times, the second within a radius."""
    equations = clock_of(
        ("duration",), lambda u, p: [p["first"]], lambda u, p: u["duration"], lambda u, x, p: [], first=first
    )
    passage = equations.evaluate([arb(last - first)], [arb(radius)], 80).passages[0]
    return Motion(equations.legs[0], passage)


def chain(motion, function, orders):
    return motion.chain([expression(function(symbol("t")))], orders)


def check(function, zero_at_start=0, zero_at_end=False):
    motion = clock()
    each = chain(motion, function, max(zero_at_start, 1))
    motion.check_positive(each, zero_at_start, zero_at_end)


POSITIVE = {
    "a constant": (lambda t: 1 + 0 * t, {}),
    "a valley": (lambda t: (t - 1) ** 2 + 2.0**-12, {}),
    "a law": (lambda t: fn.exp(-t) - 2.0**-5, {}),
    "a simple zero at the start": (lambda t: t * (4 - t), {"zero_at_start": 1}),
    "a double zero at the start": (lambda t: t**2 * (4 - t), {"zero_at_start": 2}),
    "a triple zero at the start": (lambda t: t**3 * (4 - t), {"zero_at_start": 3}),
    "a sine": (lambda t: t - fn.sin(t), {"zero_at_start": 3}),
    "a simple zero at the end": (lambda t: 3 - t, {"zero_at_end": True}),
    "a valley before the end": (lambda t: (3 - t) * ((t - 1) ** 2 + 2.0**-6), {"zero_at_end": True}),
    "zeros at both ends": (lambda t: t**2 * (3 - t), {"zero_at_start": 2, "zero_at_end": True}),
}
REFUTED = {
    "a constant": (lambda t: -1 + 0 * t, {}),
    "a narrow valley": (lambda t: (t - 1) ** 2 - 3 * 2.0**-13, {}),
    "a fall to the end": (lambda t: 2.875 - t, {}),
    "the wrong sign at the start": (lambda t: -t * (4 - t), {"zero_at_start": 1}),
    "the wrong sign at a triple start": (lambda t: -(t**3) * (4 - t), {"zero_at_start": 3}),
    "a zero after the start": (lambda t: t**3 * (1 - t), {"zero_at_start": 3}),
    "the wrong sign at the end": (lambda t: t - 3, {"zero_at_end": True}),
    "two zeros before the end": (lambda t: (3 - t) * (t - 1) * (t - 2), {"zero_at_end": True}),
}
UNDECIDED = {
    "touching": (lambda t: (t - 1) ** 2, {}),
    "touching at the start": (lambda t: t, {}),
    "touching at the end": (lambda t: 3 - t, {}),
    "a zero of higher order at the start": (lambda t: t**4, {"zero_at_start": 3}),
    "a double zero at the end": (lambda t: (3 - t) ** 2, {"zero_at_end": True}),
    "nothing": (lambda t: 0 * t, {}),
}


@pytest.mark.parametrize("name", POSITIVE)
def test_positive_functions_are_proved(name):
    function, known = POSITIVE[name]
    check(function, **known)


@pytest.mark.parametrize("name", REFUTED)
def test_functions_that_are_not_positive_are_refuted(name):
    function, known = REFUTED[name]
    with pytest.raises(Refuted):
        check(function, **known)


@pytest.mark.parametrize("name", UNDECIDED)
def test_functions_that_touch_0_stay_undecided(name):
    function, known = UNDECIDED[name]
    with pytest.raises(Unproved):
        check(function, **known)


def test_a_set_of_motions_of_which_some_are_positive_stays_undecided():
    """The clocks end within 0.01 of 3, and the function falls to 0 there."""
    motion = clock(radius=0.01)
    with pytest.raises(Unproved):
        motion.check_positive(chain(motion, lambda t: 3 - t, 1))


@pytest.mark.parametrize("turns", range(6))
def test_the_turns_of_a_cosine_are_counted(turns):
    """It turns at the multiples of pi, the last of which is the end."""
    motion = clock(first=1.0, last=(turns + 1) * np.pi, radius=1e-14)
    assert motion.count_turns(chain(motion, fn.cos, 2)) == turns


# Functions by their rates, all of which vanish at 3, with the number of turns before.
RATES = {
    "none": ([3], 0),
    "two": ([1, 2, 3], 2),
    "three": ([0.5, 1, 2, 3], 3),
    "a near pair": ([1, 1.25, 3], 2),
    "one near the end": ([2.75, 3], 1),
    "one near the start": ([2.0**-6, 3], 1),
}
# Here the rates come so near to 0 that they may be told apart or not.
NARROW = {"a pair": ([1, 1 + 2.0**-5, 3], 2), "one beside the end": ([3 - 2.0**-6, 3], 1)}
HANGING = {"touching": [1, 1, 3], "at the start": [0, 3], "double at the end": [3, 3], "triple": [1, 1, 1, 3]}


def integral(zeros):
    """The polynomial whose rate has these zeros, in exact numbers, as a function of the time, 60-fold."""
    powers = np.rint(60 * 2**10 * np.polyint(np.poly(zeros))) / 2**10
    return lambda t: sum(float(power) * t**k for k, power in enumerate(powers[::-1]) if power)


@pytest.mark.parametrize("name", RATES)
def test_the_turns_of_polynomials_are_counted(name):
    zeros, turns = RATES[name]
    motion = clock()
    assert motion.count_turns(chain(motion, integral(zeros), 2)) == turns


@pytest.mark.parametrize("name", NARROW)
def test_narrow_turns_are_not_counted_wrongly(name):
    zeros, turns = NARROW[name]
    motion = clock()
    with suppress(Unproved):
        assert motion.count_turns(chain(motion, integral(zeros), 2)) == turns


@pytest.mark.parametrize("name", HANGING)
def test_turns_that_cannot_be_told_apart_are_not_counted(name):
    motion = clock()
    with pytest.raises(Unproved):
        motion.count_turns(chain(motion, integral(HANGING[name]), 2))


def test_a_function_that_does_not_turn_at_the_end_is_not_counted():
    motion = clock()
    with pytest.raises(Unproved, match="stationary too long"):
        motion.count_turns(chain(motion, lambda t: t, 2))
