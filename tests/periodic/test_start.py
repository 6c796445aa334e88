"""Starts that are stated by name, by an orbit and by the file of one."""

import pytest

from orbits import InputError, find
from orbits.periodic import stated_unknowns, unknowns_of_start
from problems import Hopper, hopper_in_si


def test_a_start_in_si():
    machine = hopper_in_si(60.0, 3.0, stiffness=2000.0, rest_length=0.8)
    orbit = find(machine)
    start = unknowns_of_start(machine, orbit)
    assert start["alpha"] == pytest.approx(orbit.alpha, rel=1e-14)
    assert start["duration"] == pytest.approx(orbit.flight_time / 2, rel=1e-14)


def test_a_distant_start_leads_to_the_orbit_of_damped_steps():
    """Full Newton steps lead from here to family 3."""
    orbit = find(Hopper("bilinear"), start={"alpha": 2.34, "liftoff": 0.668, "duration": 5.27})
    assert (orbit.family, orbit.alpha) == (1, pytest.approx(find(Hopper("bilinear")).alpha, rel=1e-14))


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (5, "it must be an orbit, or a mapping of unknowns"),
        ({"speed": 1.0}, "start has 'speed'; the unknowns are liftoff, alpha, duration"),
        ({"alpha": 4.5, "duration": 2e4}, "'duration' = 20000; it must lie between 0 and 10000"),
        ({"alpha": float("nan")}, "start 'alpha'"),
    ],
)
def test_starts_that_state_no_motion(start, message):
    with pytest.raises(InputError, match=message):
        stated_unknowns(Hopper().model, start)
