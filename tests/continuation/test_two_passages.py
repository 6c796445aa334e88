"""Half motions that stay near two unstable equilibria, one after the other, against elliptic integrals in 80 digits;
and sweeps of motions that hang, or are long, where they lead no further."""

import pytest
from hanging import quartic_error

from orbits import find, follow, orbit_at, sweep
from problems import Hopper

CUBIC = Hopper("cubic", rest_length=30.0)


@pytest.mark.slow
@pytest.mark.parametrize(("family", "values"), [(1, [-5e-4, -3.43e-4]), (2, [-1.7e-4])])
def test_flights_between_two_barriers(family, values):
    """Beyond the fold of a cubic spring: small changes grow up to 1e14-fold. Family 2 passes three barriers."""
    found = follow(CUBIC, "beta", -0.02, start=0.0, family=family, at=values)
    assert found.end.kind == "escaped"
    assert abs(found.end.limit) <= found.end.limit_error < 1e-6
    assert {point.family for point in found} == {family}
    for value in values:
        point = found.at(value)[-1]
        assert quartic_error(0.0, value, point.alpha, family, within=2e-11) <= point.error < 1e-11
    orbit = orbit_at(CUBIC, found.at(values[0])[-1], "beta")
    assert orbit.alpha == pytest.approx(found.at(values[0])[-1].alpha, rel=1e-14)
    assert orbit.certificate.energy_drift < 1e-13


@pytest.mark.slow
def test_an_orbit_between_two_barriers_is_found():
    """Small changes grow 2e11-fold, and only 2e6-fold up to the end of the half motion."""
    orbit = find(CUBIC.with_values(beta=-5e-4), start={"liftoff": 1.0005, "alpha": 31.6069493741529, "duration": 31.6})
    assert orbit.family == 1
    assert quartic_error(0.0, -5e-4, orbit.alpha, 1, within=1e-11) <= orbit.error < 1e-11


def test_a_sweep_says_why_it_leads_no_further():
    machine = Hopper("r + c*r**2", parameters={"c": -0.022})
    known = {"liftoff": 1.0230247551647235, "alpha": 26.223545859854912, "duration": 26.223545859854912}
    beyond = sweep(machine, {"c": [-0.018, -0.0155]}, start=find(machine, start=known))
    assert beyond["status"].tolist() == ["certified", "not reached"]
    assert "digits of its launch do not determine it" in beyond["reason"][1]
    twice = CUBIC.with_values(beta=-9e-4)
    start = find(twice, start={"liftoff": 1.0009, "alpha": 23.54897436632286, "duration": 23.54897436632286})
    beyond = sweep(twice, {"beta": [-9e-4, -5e-4]}, start=start)
    assert beyond["alpha"][0] == pytest.approx(start.alpha, rel=1e-14)
    assert "the motion passes two unstable equilibria" in beyond["reason"][1]


@pytest.mark.slow
def test_a_sweep_says_that_motions_are_too_long():
    machine = CUBIC.with_values(beta=0.3)
    beyond = sweep(machine, {"beta": [0.29, 0.31]}, start=find(machine, 700))
    assert "the motion of the start takes 5" in beyond["reason"][0]
    assert "integration steps, but a sweep follows at most 4096" in beyond["reason"][0]
