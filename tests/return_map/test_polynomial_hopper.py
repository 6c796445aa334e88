"""Enclosed hops of hoppers with polynomial springs against those in closed form and those of the map."""

from fractions import Fraction

import pytest
from conftest import slow_after
from flint import arb, ctx

from orbits import ReturnMap, multiplier
from orbits.balls.programs import ball_of_fraction
from orbits.exact.refusal import Unproved
from orbits.return_map.linear_hopper import LinearHopper
from orbits.return_map.polynomial_hopper import PolynomialHopper
from problems import Hopper


def test_hops_of_polynomials_are_those_in_closed_form():
    half, third = Fraction(1, 8), Fraction(1, 3)
    with ctx.workprec(80):
        closed = LinearHopper(ball_of_fraction(third), ball_of_fraction(half))
        series = PolynomialHopper.of([Fraction(0), Fraction(1)], third, half)
        for alpha in (4.3, 4.46, 4.494, 4.6):
            for radius in (0.0, 1e-6, 1e-4):
                expected, found = closed.hop(arb(alpha, radius)), series.hop(arb(alpha, radius))
                assert all(a.overlaps(b) for a, b in zip(expected, found, strict=True))
                assert float(found[1].rad()) < 1e-9 + 8e3 * radius
                assert found[1].contains(series.hop(arb(alpha + 0.9 * radius))[1])


@pytest.mark.parametrize(
    ("spring", "law", "mass_ratio", "launches"),
    slow_after(
        1,
        [
            ("r + 0.3*r**3", (0, 1, 0, "0.3"), 2.0, (2.93, 2.937)),
            ("r + 0.2*r**2 + 0.1*r**3", (0, 1, "0.2", "0.1"), 0.5, (3.1,)),
        ],
    ),
)
def test_hops_of_polynomials_are_those_of_the_map(spring, law, mass_ratio, launches):
    machine = Hopper(spring, mass_ratio=mass_ratio)
    step = ReturnMap(machine, inject=0.125)
    with ctx.workprec(80):
        hopper = PolynomialHopper.of([*map(Fraction, law)], Fraction(mass_ratio), Fraction(1, 8))
        for alpha in launches:
            following, slope = hopper.hop(arb(alpha))
            assert float(following.rad()) < 1e-13
            assert float(following.mid()) == pytest.approx(float(step(alpha).next), abs=1e-12)
            assert float(slope.mid()) == pytest.approx(multiplier(machine, alpha), rel=1e-7)
            wide, slopes = hopper.hop(arb(alpha, 1e-5))
            assert all(wide.overlaps(arb(float(step(alpha + d).next), 1e-12)) for d in (-1e-5, 3e-6, 1e-5))
            assert slopes.contains(slope)


def test_hops_that_are_not_smooth_are_not_enclosed():
    """A lossless launch, a graze, and launches of several pieces of the enclosures."""
    with ctx.workprec(80):
        hopper = PolynomialHopper.of([Fraction(0), Fraction(1)], Fraction(1), Fraction(1, 8))
        for x in (arb(4.493409457909064, 1e-6), arb(4.5, 0.1)):
            with pytest.raises(Unproved):
                hopper.hop(x)
