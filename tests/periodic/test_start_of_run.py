"""Where the search for runs begins, against the runs that it leads to."""

import numpy as np
import pytest
from runners import rates_by_hand
from scipy.integrate import solve_ivp

from orbits import NoOrbit, find
from problems import runner

TUNE = ("inertia", "hip_stiffness")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "at", "speed"),
    [
        (runner(0.1, 3.7, 5.7, 5.4), {"flight_time": 2.65}, 0.8122225),
        (runner(0.1, 3.7, 5.7, 5.4), {"alpha": 1.6}, 0.876178),
        (runner(0.25, 4.5, 5.7, 5.4), {"flight_time": 3.95}, 0.8730898),
        (runner(0.25, 4.2, 5.7, 5.4), {"period": 7.9}, None),
        (runner(0.25, 4.2, 5.7, 5.4), {"step": 2.3}, None),
        (runner(8.0, 1.0, 33.0, 1144.0, body_mass=80.0, stiffness=2903.0, in_si=True), {"flight_time": 0.44}, None),
    ],
)
def test_a_run_with_a_prescribed_time_is_found_along_the_speed(machine, at, speed):
    """Far from the vertical hop; another integrator returns to its launch after the flight and the contact."""
    run = find(machine, tune=TUNE, at=at)
    (name, value), p = next(iter(at.items())), run.source.values
    assert getattr(run, name) == pytest.approx(value, rel=1e-12)
    assert speed is None or run.speed == pytest.approx(speed, abs=1e-7)
    begun, accurate = run(0.0), {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
    flight = solve_ivp(lambda t, x: rates_by_hand(x, p, False)[0], (0, run.flight_time), begun, **accurate).y[:, -1]
    assert flight[1:4] == pytest.approx([0.0, 0.0, 0.0], abs=1e-10)
    contact = solve_ivp(lambda t, x: rates_by_hand(x, p, True)[0], (0, run.contact_time), flight[4:], **accurate)
    assert contact.y[:, -1] == pytest.approx(begun[4:], abs=1e-9)


@pytest.mark.slow
def test_a_flight_that_no_run_has_is_refused_with_those_that_they_have():
    """The flight of the vertical hop lasts 2.70963, and those of its runs are shorter."""
    with pytest.raises(NoOrbit, match=r"no run with flight_time = 3.5 .* goes from 2.70963 to "):
        find(runner(0.1, 3.7, 5.7, 5.4), tune=TUNE, at={"flight_time": 3.5})


@pytest.mark.slow
def test_runs_forward_and_back_are_mirror_images():
    forward, back = (find(runner(), tune=TUNE, at={"speed": speed}) for speed in (0.3, -0.3))
    assert back.step == pytest.approx(-forward.step, rel=1e-11)
    t = np.linspace(0, forward.period, 7)
    signs = np.where([name[0] in "xtp" for name in forward.source.model.flight.states], -1, 1)
    assert back(t) == pytest.approx(forward(t) * signs, abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rest_length", "speed", "inertia", "hip_stiffness"),
    [
        (4.0, 0.4, 4.31715, 4.37482),
        (4.5, 0.1, 1.61114, 2.93148),
        (4.5, 0.4, 1.56999, 2.90164),
        (5.0, 0.4, 1.43043, 2.88311),
    ],
)
def test_runs_with_a_heavy_foot_are_found_from_far_away(rest_length, speed, inertia, hip_stiffness):
    """The truth is followed in the foot mass from 0.1, by Newton's method of a script of its own."""
    run = find(runner(0.25, rest_length, 5.7, 5.4), tune=TUNE, at={"speed": speed})
    assert [run.tuned[name] for name in TUNE] == pytest.approx([inertia, hip_stiffness], abs=6e-6)
    assert run.admissible


@pytest.mark.slow
def test_a_design_far_from_where_runs_begin_is_no_lack_of_dependence():
    """The inertia of these runs grows without bound as their speed falls to 0.23."""
    with pytest.raises(
        NoOrbit, match="does not converge where it begins: begin near a design found by find_branch_points"
    ):
        find(runner(0.25, 4.0, 5.7, 5.4), tune=TUNE, at={"speed": 0.1})


@pytest.mark.parametrize("speed", [1e-201, -1e-300])
def test_a_speed_below_the_range_of_doubles_is_refused_as_such(speed):
    with pytest.raises(NoOrbit, match=rf"speed = {speed:g} is too small .* farther from 0"):
        find(runner(), tune=TUNE, at={"speed": speed})
