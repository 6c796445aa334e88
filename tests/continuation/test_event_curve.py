"""Curves of events whose motions hang: against elliptic integrals, and the energy of a barrier."""

import pytest
from hanging import excess_over_barrier, mid_flight_rate, quadratic_c

from orbits import NoOrbit, find, follow, follow_event
from problems import Hopper

START = {"liftoff": 1.0230247551647235, "alpha": 26.223545859854912, "duration": 26.223545859854912}


@pytest.fixture(scope="module")
def flights():
    """Orbits whose flight stays near the barrier: small changes grow 6e9 to 1e12-fold."""
    machine = Hopper("r + c*r**2 + d*r**3", parameters={"c": -0.022, "d": 0.0})
    return follow(machine, "c", -0.019, start=find(machine, start=START), longest=0.5)


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


@pytest.mark.slow
def test_a_contact_that_hangs_keeps_its_time():
    """The body comes to rest but for 1e-20 of its energy where the spring can just carry it, as both laws change."""
    machine = Hopper("r + b*r**3 + d*r**5", rest_length=30.0, parameters={"b": -0.005, "d": 0.0})
    family = follow(machine, "contact_time", 60.0, tune="b", longest=0.3)
    curve = follow_event(family, {"contact_time": 50.0}, "d", 1e-5, longest=0.5)
    assert curve.end.kind == "reached"
    for point in curve:
        law = point.alpha, point.liftoff_extension, point.also["b"], point.value
        assert excess_over_barrier(*law) == pytest.approx(0.0, abs=1e-11)
        assert point.contact_time == pytest.approx(50.0, rel=1e-14)
        assert point.error < 1e-12
    assert abs(mid_flight_rate(*law)) < 1e-10
    with pytest.raises(NoOrbit, match="passes 100 along the family 0 times"):
        follow_event(family, {"contact_time": 100.0}, "d", 1e-5)
