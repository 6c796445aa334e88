"""Tubes hold the solutions that a closed form gives, and none beside them is proved."""

import math

import pytest
from flint import arb, arb_mat

from orbits.balls import BallLeg, TaylorModel, coefficients_through, model_arithmetic, places, prove_tube
from orbits.exact import ExactArc, Unproved
from orbits.symbolic import ONE, ZERO, symbol

PLACES = [-1.0, -0.7, -0.2, 0.0, 0.35, 0.9, 1.0]


@pytest.fixture(autouse=True)
def arithmetic():
    with model_arithmetic():
        yield


@pytest.fixture
def oscillator():
    """x'' = -q x from rest at 1, for a time T after which it is at rest again: T = pi/sqrt(q)."""
    x, v, q, duration = (symbol(each) for each in ("x", "v", "q", "T"))
    arc = ExactArc([x, v], [[v, -q * x]], [ONE, ZERO], duration, [[]], [v], [[]])
    return BallLeg(arc, [duration], [q])


def half_period(q):
    return math.pi / math.sqrt(q)


def tube_of(leg, wrong=0.0):
    """The tube about the half period for q from 1.15 to 1.25, through what is off by a share at one end."""
    rows = [[arb(half_period(1.2 + 0.05 * s) * (1 + wrong * s**3))] for s in places()]
    period = TaylorModel.of_curve([each[0] for each in coefficients_through(arb_mat(rows)).tolist()])
    return prove_tube([leg], [period, TaylorModel.of_curve([arb(1.2), arb(0.05)])], [0], [arb(0), arb(0)])


def test_a_tube_about_a_closed_form(oscillator):
    tube = tube_of(oscillator)
    assert tube.radii[0] < 1e-9 < tube.widths[0]
    for s in PLACES:
        q = 1.2 + 0.05 * s
        assert (tube.at(0, arb(s)) + arb(0, 1e-14)).overlaps(arb(half_period(q)))
        slope = tube.slope_at(0, arb(s))
        assert slope.overlaps(arb(-0.5 * half_period(q) / q * 0.05))
        assert slope.rad() < 1e-3


def test_a_tube_beside_the_solutions_is_not_proved(oscillator):
    with pytest.raises(Unproved, match="not proved to stay in a tube"):
        tube_of(oscillator, wrong=1e-3)
