"""Decimals that are rounded outward, against exact fractions."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from orbits.exact import enclosure_of, lower_decimal, upper_decimal


@pytest.fixture(autouse=True)
def many_bits():
    with ctx.workprec(200):
        yield


def random_balls(count):
    """Middles and radii of many sizes, both floats, with balls."""
    rng = np.random.default_rng(4)
    for _ in range(count):
        middle = float(rng.normal() * 10.0 ** rng.integers(-20, 20))
        radius = float(abs(middle) * 10.0 ** rng.integers(-30, 2) * rng.uniform())
        yield middle, radius, arb(middle, radius)


@pytest.mark.parametrize("digits", [None, 1, 5, 40])
def test_an_enclosure_holds_the_ball_and_little_more(digits):
    for middle, radius, ball in random_balls(200):
        found = enclosure_of(ball, digits)
        low, high = Fraction(found.low), Fraction(found.high)
        assert low <= Fraction(middle) - Fraction(radius)
        assert Fraction(middle) + Fraction(radius) <= high
        assert high - low <= Fraction(211, 100) * Fraction(radius) + Fraction(1, 10**39)
        assert Decimal(middle) in found


def test_enclosures_of_numbers():
    # Radii of balls are rounded up.
    assert str(enclosure_of(arb(0.5, 0.25))) in ("[0.250, 0.750]", "[0.249, 0.751]")
    assert str(enclosure_of(arb(-0.5, 0.25))) in ("[-0.750, -0.250]", "[-0.751, -0.249]")
    assert Fraction(enclosure_of(arb(3)).low) == 3 == Fraction(enclosure_of(arb(3)).high)
    assert Fraction(enclosure_of(arb(0)).low) == 0 == Fraction(enclosure_of(arb(0)).high)
    assert "12344678" in enclosure_of(arb(12345678, 1000))
    assert enclosure_of(arb(12345678, 1000)).low.isdigit()


def test_a_number_that_is_no_decimal_of_so_many_places_lies_between_two():
    third = arb(1) / 3
    found = enclosure_of(third, 10)
    assert Fraction(found.low) < Fraction(1, 3) < Fraction(found.high)


@pytest.mark.parametrize("digits", [3, 20, 50])
def test_so_many_digits_are_told_as_are_asked_for(digits):
    found = enclosure_of(arb(2).sqrt(), digits)
    assert len(found.low) >= digits + 2
    assert found.low[: digits + 1] == found.high[: digits + 1]


def test_radii_are_rounded_to_their_sides():
    for _, radius, _ in random_balls(300):
        exact = Fraction(radius)
        upper, lower = Fraction(Decimal(upper_decimal(arb(radius)))), Fraction(Decimal(lower_decimal(arb(radius))))
        assert lower <= exact <= upper
        assert upper - lower <= exact / 50
    assert upper_decimal(arb(0)) == lower_decimal(arb(0)) == "0"
    third = arb(1) / 3
    assert Fraction(Decimal(lower_decimal(third))) < Fraction(1, 3) < Fraction(Decimal(upper_decimal(third)))
