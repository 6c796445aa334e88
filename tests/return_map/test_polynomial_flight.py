"""Enclosed flights against closed forms: those of a linear spring, and the energy of others."""

import numpy as np
import pytest
from flint import arb, ctx

from orbits.exact.refusal import Unproved
from orbits.return_map.polynomial_flight import flight_of


def test_flights_of_a_linear_spring_are_in_closed_form():
    """r = c cos t + s sin t with c = 1 + d/2 and s = 4.4 + d."""
    with ctx.workprec(80):
        reach, half = arb(0, 0.01), arb(0.5)
        c, s = [arb(1), half, arb(0), arb(0)], [arb("4.4"), arb(1), arb(0), arb(0)]
        flight = flight_of([arb(0), arb(1)], arb("4.4"), reach, c, s)
        for t, d in np.random.default_rng(1).uniform((0.0, -0.009), (8.0, 0.009), (20, 2)).tolist():
            even, odd, time = arb(t).cos(), arb(t).sin(), arb(t)
            for width in (0.0, 1e-3):
                found = flight.at(arb(t, width), arb("4.4") + arb(d, width))
                r = (1 + half * d) * even + (arb("4.4") + d) * odd
                gap = 1 + half * d + (arb("4.4") + d) * time - time * time / 2 - r
                expected = [r, gap, half * even + odd, half + time - half * even - odd]
                own = [found.r, found.gap, found.r_moves, found.gap_moves]
                assert all(a.overlaps(b) for a, b in zip(own, expected, strict=True))
                assert all(float(a.rad()) < 1e-10 + 50 * width for a in own)


def test_the_energy_of_flights_is_constant():
    """r'**2/2 + r**2/2 + 0.075 r**4 of all launches, and its derivative; the gap begins with its third power."""
    with ctx.workprec(80):
        law, x = [arb(0), arb(1), arb(0), arb("0.3")], arb("2.95")
        flight = flight_of(law, x, arb(0, 0.005), [arb("0.8"), *[arb(0)] * 4], [x, arb(1), *[arb(0)] * 3])
        for t, d in np.random.default_rng(2).uniform((0.0, -0.004), (5.5, 0.004), (10, 2)).tolist():
            at = flight.at(arb(t), x + d)
            r, energy = at.r, lambda r, v: v * v / 2 + r * r / 2 + arb("0.075") * r * r * r * r
            left = energy(r, at.rate) - energy(arb("0.8"), x + d)
            assert left.contains(0)
            assert float(left.rad()) < 1e-8
            change = at.rate * at.rate_moves + (r + arb("0.3") * r * r * r) * at.r_moves - (x + d)
            assert change.contains(0)
            assert float(change.rad()) < 1e-5
        with pytest.raises(Unproved, match="not enclosed for so long"):
            flight.at(arb(60), x)
