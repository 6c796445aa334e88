"""Taylor models hold the functions that they stand for, and tubes the solutions that a closed form gives."""

import math
import random

import pytest
from flint import arb, arb_mat

from orbits.balls.curve_motion import coefficients_through, places
from orbits.balls.equations import BallLeg
from orbits.balls.taylor_model import TaylorModel, model_arithmetic
from orbits.balls.tube import prove_tube
from orbits.exact.expressions import ONE, ZERO, symbol
from orbits.exact.refusal import Unproved
from orbits.exact.statement import ExactArc

PLACES = [-1.0, -0.7, -0.2, 0.0, 0.35, 0.9, 1.0]


@pytest.fixture(autouse=True)
def arithmetic():
    with model_arithmetic():
        yield


def polynomial(seed, degree, shrink=1):
    """Coefficients of a polynomial in s, and its model with a small rest."""
    draw = random.Random(seed)
    coefficients = [draw.uniform(-0.2, 0.2) / shrink**k for k in range(degree + 1)]
    return coefficients, TaylorModel.of_curve([arb(each) for each in coefficients], arb(1e-9))


def value(coefficients, s):
    return sum(each * s**k for k, each in enumerate(coefficients))


@pytest.mark.parametrize("degree", [3, 10])
def test_products_beyond_the_degree(degree):
    (a, first), (b, second) = polynomial(1, degree), polynomial(2, degree)
    found = first * second + 3 * first - second / 7
    assert float(found.rest) < (1e-6 if degree == 3 else 1.0)
    for s in PLACES:
        for off in (-1e-9, 0.0, 1e-9):
            x, y = value(a, s) + off, value(b, s) - off
            assert found.on(arb(s)).overlaps(arb(x * y + 3 * x - y / 7))


FUNCTIONS = {"exp": math.exp, "sin": math.sin, "tanh": math.tanh, "sqrt": math.sqrt, "log": math.log, "sinh": math.sinh}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_and_quotients(name):
    coefficients, model = polynomial(3, 6, shrink=8)
    found = getattr(1.5 + model, name)() / (2 + model)
    for s in PLACES:
        x = value(coefficients, s)
        here = found.on(arb(s))
        assert (here + arb(0, 1e-14)).overlaps(arb(FUNCTIONS[name](1.5 + x) / (2 + x)))
        assert here.rad() < 1e-5


def test_what_has_no_value_is_not_bounded():
    _, model = polynomial(4, 3)
    assert not (1 / model).is_finite()
    assert not (model - 5).log().is_finite()


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
