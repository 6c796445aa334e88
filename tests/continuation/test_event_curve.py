"""Curves of events against closed forms: of motions that hang, of a contact that pulls, and a cusp."""

import numpy as np
import pytest
from hanging import mid_flight_rate, quadratic_c
from scipy.optimize import brentq, minimize_scalar

from orbits import find, follow, follow_event
from problems import Hopper

START = {"liftoff": 1.0230247551647235, "alpha": 26.223545859854912, "duration": 26.223545859854912}


@pytest.fixture(scope="module")
def flights():
    """Orbits whose flight stays near the barrier: small changes grow 6e9 to 1e12-fold."""
    machine = Hopper("r + c*r**2 + d*r**3", parameters={"c": -0.022, "d": 0.0})
    return follow(machine, "c", -0.018, start=find(machine, start=START), longest=0.5)


@pytest.mark.parametrize(
    "event", [{"alpha": 30.0}, pytest.param("extremum of (alpha - 30)**2", marks=pytest.mark.slow)]
)
def test_events_of_flights_that_hang(flights, event):
    """One curve by an equation of first derivatives, and by one of second ones."""
    curve = follow_event(flights, event, "d", 2e-6, longest=0.5)
    assert curve.end.kind == "reached"
    first, last = curve[0], curve[-1]
    assert abs(first.also["c"] - quadratic_c(30.0, first.also["c"])) < 1e-17
    assert {point.family for point in curve} == {1}
    assert max(point.error for point in curve) < 2e-13
    there = find(flights.source.with_values(c=last.also["c"], d=2e-6), start=dict(zip(START, last.u, strict=False)) | {
        "alpha": last.alpha, "duration": last.alpha})  # fmt: skip
    assert there.alpha == pytest.approx(30.0, rel=1e-14)
    assert len(first.u) == len(flights[0].u) + 1


def test_a_contact_that_pulls_where_the_law_has_a_bump():
    """In contact the body passes a bump of the law on the way down and up; the ground would have to pull where the
    bump's top is the foot's weight, whatever the orbit."""
    machine = Hopper("r + a*exp(-((r + 4)/w)**2)", rest_length=30.0, parameters={"a": 4.0, "w": 1.0})
    curve = follow_event(follow(machine, "a", 6.0, longest=0.3), "contact pulls", "w", 1.2, longest=0.3)

    def top(a, w):
        law = lambda r: -r - a * np.exp(-(((r + 4) / w) ** 2))  # noqa: E731
        return -minimize_scalar(law, bounds=(-4.5, -3.2), method="bounded", options={"xatol": 1e-12}).fun

    for point in curve:
        at_weight = brentq(lambda a, w=point.value: top(a, w) - 1, 4.0, 7.0, xtol=1e-14)
        assert point.also["a"] == pytest.approx(at_weight, rel=2e-15)
        assert point.admissible
    assert curve.end.kind == "reached"


@pytest.mark.slow
def test_two_folds_meet_in_a_cusp():
    """There b, as a function of the launch speed along a family, has a slope and a curvature of 0: by another
    integrator and differences of order 4."""
    machine = Hopper("r + b*r**3 + d*r**5", parameters={"b": 0.0, "d": 6e-5})
    family = follow(machine, "b", -0.0135, start=-0.0125, longest=0.1)
    folds = follow_event(family, "fold", "d", 1e-4, longest=0.2, most=40)
    (cusp,) = [event.point for event in folds.events if event.kind == "fold"]
    assert cusp.value == pytest.approx(7.132438068e-5, rel=1e-9)
    step, places = 0.05, np.arange(-2, 3)
    values = [law_of(cusp.alpha + step * i, cusp.value, cusp.also["b"]) for i in places]
    assert values[2] == pytest.approx(cusp.also["b"], rel=1e-11)
    assert np.dot([1, -8, 0, 8, -1], values) / (12 * step) == pytest.approx(0.0, abs=1e-8)
    assert np.dot([-1, 16, -30, 16, -1], values) / (12 * step**2) == pytest.approx(0.0, abs=1e-6)


def law_of(alpha: float, d: float, about: float) -> float:
    """The b of the orbit with a launch speed."""

    def rate(b):
        liftoff = brentq(lambda r: r + b * r**3 + d * r**5 - 1, 0.5, 1.5, xtol=1e-15)
        return mid_flight_rate(alpha, liftoff, b, d)

    return brentq(rate, about - 2e-5, about + 2e-5, xtol=1e-16)
