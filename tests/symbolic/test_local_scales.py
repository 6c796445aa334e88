"""How far a state may go until a function in a field varies by more than a series shows, against sampled functions."""

import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import kinks_of, reaches_of
from orbits.symbolic.local_scales import SCALES


def reach_of(function, waves=False):
    """(r, parameter) -> how far a step may lead from r, and the value of a function of both."""
    x, p = ca.SX.sym("x", 1), ca.SX.sym("p", 1)
    value = function(x, p)
    found = reaches_of(ca.Function("field", [x, p], [value]), x, p, waves)
    distance = ca.SX(np.inf)
    for weights, change in found:
        distance = ca.fmin(distance, change.least / ca.fabs(weights))
    return ca.Function("reach", [x, p], [distance, value])


INNER = {
    "square": lambda r, p: -(((r - 2) / p) ** 2),
    "product": lambda r, p: (r - 2) * ca.cosh((r - 2) / p),
    "quotient": lambda r, p: 5 * (r - 2) / (p + r**2),
    "inverse": lambda r, p: 1 / (p + r**2),
    "powers": lambda r, p: ((r - 2) / p) ** 6 - (1 + r**2) ** 1.7,
    "exponent": lambda r, p: (1 + r**2) ** (p * ca.sin(r)),
    "logarithms": lambda r, p: 9 * ca.log(p + r**2) + ca.log1p(r**2) * ca.expm1(r),
    "roots": lambda r, p: ca.sqrt((r - 2) ** 2 + p) / p,
    "saturated": lambda r, p: 30 * ca.tanh((r - 2) / p) + 20 * ca.erf(r / p) + 25 * ca.atan(r / p) - ca.asinh(r / p),
    "singular": lambda r, p: 20 * ca.asin(r / 20) - 20 * ca.acos(r / 20) + 3 * ca.atanh(r / 20) + ca.acosh(r + 30),
    "waves": lambda r, p: 20 * ca.sin(r / p) + 3 * ca.tan(r / 20) + ca.sinh(r) - ca.fabs(r),
}


@pytest.mark.parametrize("name", INNER)
def test_an_exponent_changes_by_no_more_than_a_series_shows(name):
    """Sampled at all places up to the distance, on both sides."""
    inner, rng = INNER[name], np.random.default_rng(4)
    reach = reach_of(lambda r, p: ca.exp(inner(r, p)))
    exponent = reach_of(inner)
    for p in (1.0, 0.05):
        for r in rng.uniform(-9, 9, 9):
            distance, value = float(reach(r, p)[0]), float(exponent(r, p)[1])
            assert distance > 0
            places = r + min(distance, 1e3) * np.linspace(-1, 1, 401)
            values = exponent(places[None], p)[1].full()[0]
            allowed = max(SCALES.visible + max(value, 0), -SCALES.hidden - value)
            assert np.nanmax(np.abs(values - value)) <= allowed * (1 + 1e-9)


@pytest.mark.parametrize("scale", [1.0, 1e-9])
@pytest.mark.parametrize(
    ("feature", "least"),
    [
        (lambda s: ca.exp(-(s**2)), 0.4),
        (lambda s: 1 / (1 + s**2), 0.4),
        (ca.tanh, 0.3),
        (ca.erf, 0.3),
        (ca.atan, 0.4),
        (lambda s: ca.sqrt(1 + s**2), 0.4),
        (lambda s: (1 + s**2) ** -1.5, 0.4),
        (lambda s: ca.log(1 + s**2), 0.4),
        (lambda s: 1 / (1 + s**40), 0.005),
    ],
)
def test_a_step_leads_to_a_feature_and_not_across(feature, least, scale):
    """Distances shrink in proportion to that from the feature, and are of its width in it, whatever its width is."""
    reach = reach_of(lambda r, p: r + feature((r - 2) / p))
    for s in (-1e6, -1e3, -50.0, 50.0, 1e3):
        assert least * abs(s) < float(reach(2 + scale * s, scale)[0]) / scale < abs(s)
    assert 0.01 < float(reach(2.0, scale)[0]) / scale < 7


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_away_from_a_feature_there_is_no_bound(turned):
    """A coordinate may fall and rise as far as the feature allows, also where a factor turns its direction."""
    x, p = ca.SX.sym("x", 1), ca.SX.sym("p", 1)
    for function, places in ((ca.tanh, (50.0, -50.0)), (ca.erf, (50.0, -50.0)), (ca.exp, (-100.0,))):
        law = 3 - 2 * function((2 - x) / -p) if turned > 0 else function((4 * (2 - x)) / (4 * p)) - 1
        ((_, change),) = reaches_of(ca.Function("field", [x, p], [law]), x, p)
        changes = ca.Function("changes", [x, p], [*change])
        for s in places:
            down, up = map(float, changes(2 + turned * s, 1.0))
            away, towards = (down, up) if turned * s < 0 else (up, down)
            assert away == np.inf
            assert 0.3 * abs(s) < towards < abs(s)


def test_polynomials_and_straight_lines_hide_nothing():
    for function in (lambda r, p: r + p * r**3, lambda r, p: (r - p) / 7, lambda r, p: r**p, ca.sin):
        call = (lambda r, p: ca.sin(r)) if function is ca.sin else function
        assert float(reach_of(call)(0.0, 3.0)[0]) == np.inf
    assert float(reach_of(lambda r, p: ca.sin(r / p), waves=True)(0.0, 0.1)[0]) == pytest.approx(0.6)
    assert float(reach_of(lambda r, p: r**p)(0.5, 1.5)[0]) < 0.5


def test_kinks_of_absolute_values_and_comparisons():
    x, p = ca.SX.sym("x", 1), ca.SX.sym("p", 1)
    field = ca.Function(
        "field", [x, p], [ca.fabs(x - p) + ca.fmax(2 * x, p) + ca.if_else(x < 3, 0, x - 3) + ca.fabs(p)]
    )
    kinks = ca.Function("kinks", [x, p], [kinks_of(field, x, p)])
    assert sorted(np.abs(kinks(1.0, 0.25).full()[:, 0])) == [0.75, 1.75, 2.0]
