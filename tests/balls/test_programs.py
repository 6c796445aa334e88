"""Programs on balls and on series of balls against closed forms of mpmath."""

from fractions import Fraction

import mpmath as mp
import pytest
from ball_systems import fn, holds, power
from flint import arb, arb_series, ctx

from orbits.balls import BallProgram
from orbits.balls.programs import coefficient
from orbits.exact import Unproved
from orbits.symbolic import PI, ZERO, derivative_by, exact_number, symbol

ORDER = 10
# In CasADi, in mpmath, and a place.
SMOOTH_FUNCTIONS = {
    **{name: (getattr(fn, name), getattr(mp, name), 0.625) for name in ("sin", "cos", "tan", "asin", "acos", "atan")},
    **{name: (getattr(fn, name), getattr(mp, name), -0.375) for name in ("sinh", "cosh", "tanh", "asinh", "atanh")},
    **{name: (getattr(fn, name), getattr(mp, name), 1.75) for name in ("acosh", "exp", "log", "sqrt")},
    "expm1": (fn.expm1, mp.expm1, 0.0625),
    "log1p": (fn.log1p, mp.log1p, 0.0625),
    "power 0": (lambda x: x**0, lambda x: mp.mpf(1), 0.75),
    "power 1": (lambda x: x**1, lambda x: x, 0.75),
    "power 2": (lambda x: x**2, lambda x: x**2, 0.75),
    "power 7": (lambda x: x**7, lambda x: x**7, -1.25),
    "power 100": (lambda x: x**100, lambda x: x**100, 1.25),
    "power -1": (lambda x: x**-1, lambda x: x**-1, -1.25),
    "power -3": (lambda x: x**-3, lambda x: x**-3, -1.25),
    "power 1/2": (lambda x: power(x, 0.5), mp.sqrt, 1.25),
    "power 5/2": (lambda x: power(x, 2.5), lambda x: x ** mp.mpf("2.5"), 1.25),
    "power -3/2": (lambda x: power(x, -1.5), lambda x: x ** mp.mpf("-1.5"), 1.25),
    "power 3/4": (lambda x: power(x, 0.75), lambda x: x ** mp.mpf("0.75"), 1.25),
    "power x": (lambda x: power(x, x), lambda x: x**x, 1.25),
    "base 2": (lambda x: power(2, x), lambda x: mp.mpf(2) ** x, 1.25),
    "quotient": (lambda x: (1 - x) / (3 + x * x), lambda x: (1 - x) / (3 + x * x), 1.25),
}


@pytest.fixture(autouse=True)
def eighty_bits():
    with ctx.workprec(80):
        yield


def program_of(function):
    x = symbol("x")
    return BallProgram([x], [function(x)])


@pytest.mark.parametrize("name", SMOOTH_FUNCTIONS)
def test_a_ball_holds_the_values_at_its_points(name):
    function, exactly, place = SMOOTH_FUNCTIONS[name]
    program = program_of(function)
    (narrow,), (wide,) = program([arb(place)]), program([arb(place, 2.0**-6)])
    with mp.workdps(60):
        assert holds(narrow, exactly(mp.mpf(place)))
        assert float(narrow.rad()) < 1e-18 * max(1.0, abs(float(narrow)))
        for share in range(-4, 5):
            assert holds(wide, exactly(mp.mpf(place) + mp.mpf(share) / 256))


@pytest.mark.parametrize("name", SMOOTH_FUNCTIONS)
def test_a_series_holds_the_taylor_coefficients(name):
    function, exactly, place = SMOOTH_FUNCTIONS[name]
    cap = ctx.cap
    try:
        ctx.cap = ORDER + 1
        (series,) = program_of(function)([arb_series([place, 1], ORDER + 1)])
        found = [coefficient(series, k) for k in range(ORDER + 1)]
    finally:
        ctx.cap = cap
    with mp.workdps(80):
        for ball, expected in zip(found, mp.taylor(exactly, mp.mpf(place), ORDER), strict=True):
            size = max(1.0, abs(float(expected)))
            assert holds(ball, expected, 1e-28 * size)
            assert float(ball.rad()) < 1e-15 * size


@pytest.mark.parametrize("exponent", [1, 2, 3, 5])
def test_derivatives_of_powers_are_balls_at_0(exponent):
    x = symbol("x")
    (slope,) = BallProgram([x], [derivative_by(x**exponent, x)])([arb(0, 0.25)])
    assert slope.is_finite()
    for place in (-0.25, -0.125, 0, 0.125, 0.25):
        assert slope.contains(exponent * arb(place) ** (exponent - 1))


def test_several_results_of_several_inputs():
    x, y = symbol("x"), symbol("y")
    results = BallProgram([x, y], [x * y, x, exact_number(3), ZERO, x * y])([arb(2), arb(5)])
    assert [int(value.unique_fmpz()) for value in results] == [10, 2, 3, 0, 10]


def test_constants_are_enclosed_at_the_precision_of_the_context():
    program = program_of(lambda x: x + PI * fn.exp(exact_number(Fraction(1, 3))))
    for bits in (60, 200, 80):
        with ctx.workprec(bits), mp.workdps(80):
            (value,) = program([arb(0)])
            assert holds(value, mp.pi * mp.exp(mp.mpf(1) / 3), 1e-70)
            assert value.rad() < arb(2) ** (6 - bits)


def test_a_symbol_without_a_value_is_refused():
    with pytest.raises(ValueError, match="no value for y"):
        program_of(lambda x: x + symbol("y"))


def test_a_power_that_is_too_large_is_refused():
    with pytest.raises(Unproved, match="too large"):
        program_of(lambda x: x ** (2**20 + 1))


@pytest.mark.parametrize("name", ["sin", "cos", "tanh"])
@pytest.mark.parametrize("ball", [arb(0, float("inf")), arb("inf")])
def test_bounded_functions_are_bounded_on_balls_that_are_not_finite(name, ball):
    (value,) = program_of(getattr(fn, name))([ball])
    assert value.contains(arb(-1))
    assert value.contains(arb(1))
    assert abs(value) < 1.1
    (value,) = program_of(getattr(fn, name))([arb("nan")])  # what is no number has no value
    assert value.is_nan()


@pytest.mark.parametrize(
    ("name", "ball"), [("sqrt", arb(0, 1)), ("log", arb(0, 1)), ("asin", arb(1, 1)), ("acosh", arb(1, 1)),
                       ("atanh", arb(1, 1)), ("tan", arb(1.5, 1))],
)  # fmt: skip
def test_a_function_that_is_not_defined_on_all_of_a_ball_has_no_finite_value(name, ball):
    (value,) = program_of(getattr(fn, name))([ball])
    assert not value.is_finite()
