"""Exact expressions: what is simplified, derivatives against mpmath's, and what is 0 whatever its symbols are."""

from fractions import Fraction

import mpmath as mp
import pytest
from ball_systems import fn, holds, power
from flint import arb, ctx

from orbits.balls import BallProgram
from orbits.symbolic import (
    ONE,
    PI,
    ZERO,
    along,
    depends_on,
    derivative_by,
    exact_number as number,
    expression,
    substitute,
    symbol,
    vanishes,
)

X, Y = symbol("x"), symbol("y")


def test_equal_expressions_are_one():
    assert (X + 1) * Y is (X + 1) * Y
    assert fn.sin(X) is fn.sin(symbol("x"))
    assert X + Y is not Y + X


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (X + 0, X), (0 * X, ZERO), (1 * X, X), (X - X, ZERO), (X / 1, X), (X**0, ONE), (X**1, X), (0 / X, ZERO),
        (number(Fraction(1, 3)) + Fraction(1, 6), number(Fraction(1, 2))), (2 * (3 * X), 6 * X),
        (number(2) ** -3, number(Fraction(1, 8))), (fn.sqrt(number(Fraction(9, 4))), number(Fraction(3, 2))),
        (fn.exp(ZERO), ONE), (fn.sin(ZERO), ZERO), (fn.log(ONE), ZERO), (power(X, Fraction(1, 2)), fn.sqrt(X)),
        (expression(10**16) + 3 - 10**16, number(3)),
    ],
)  # fmt: skip
def test_what_is_exactly_so_is_simplified(found, expected):
    assert found is expected


@pytest.mark.parametrize("kept", [number(1) / 0, number(0) ** -1, fn.sqrt(number(2)), fn.sqrt(number(-4)), 1 / X])
def test_what_is_not_exactly_so_stays(kept):
    assert not kept.is_number


SMOOTH_FUNCTIONS = {
    "exp": 0.3, "expm1": 0.3, "log": 1.7, "log1p": 0.4, "sqrt": 1.3, "sin": 0.7, "cos": 0.7, "tan": 0.7, "sinh": 0.4,
    "cosh": 0.4, "tanh": 0.4, "asin": 0.3, "acos": 0.3, "atan": 0.8, "asinh": -0.8, "acosh": 1.6, "atanh": 0.25,
}  # fmt: skip


@pytest.mark.parametrize("name", SMOOTH_FUNCTIONS)
def test_derivatives_of_functions(name):
    """First and second ones."""
    place, of = SMOOTH_FUNCTIONS[name], getattr(fn, name)(X)
    slopes = [derivative_by(of, X), derivative_by(derivative_by(of, X), X)]
    with ctx.workprec(120), mp.workdps(60):
        for order, ball in enumerate(BallProgram([X], slopes)([arb(place)]), 1):
            assert holds(ball, mp.diff(getattr(mp, name), mp.mpf(place), order), 1e-20)


def test_derivatives_of_arithmetic():
    of = (X * Y + 2 * X**3) / (1 + Y**2) - power(X, Y) + PI * Y
    exactly = lambda x, y: (x * y + 2 * x**3) / (1 + y**2) - x**y + mp.pi * y  # noqa: E731
    place = 1.25, 0.75
    with ctx.workprec(120), mp.workdps(60):
        found = BallProgram([X, Y], [derivative_by(of, X), derivative_by(of, Y), along(of, [X, Y], [Y, X])])(
            [arb(each) for each in place]
        )
        by_x, by_y = mp.diff(exactly, place, (1, 0)), mp.diff(exactly, place, (0, 1))
        expected = [by_x, by_y, place[1] * by_x + place[0] * by_y]
        assert all(holds(ball, value, 1e-20) for ball, value in zip(found, expected, strict=True))


def test_substitution():
    (found,) = substitute([fn.sin(X) * Y + X], {X: Y + 1, Y: number(2)})
    assert found is fn.sin(Y + 1) * 2 + (Y + 1)
    assert not depends_on([found], [X])
    assert depends_on([found], [Y])


@pytest.mark.parametrize(
    "zero",
    [
        (X + Y) ** 2 - X**2 - 2 * X * Y - Y**2, 1 / (X + 1) + 1 / (X - 1) - 2 * X / (X**2 - 1), X / Y * Y - X,
        fn.sin(X) * Y - Y * fn.sin(X), (X**2 - 1) / (X + 1) - (X - 1), power(X, Y) * 2 - power(X, Y) - power(X, Y),
    ],
)  # fmt: skip
def test_rational_identities_are_seen(zero):
    assert vanishes(zero)
