"""Orbits against the references, closed forms, and other ways of finding them."""

import numpy as np
import pytest
from conftest import PROVED, REFERENCES, machine_of, middle
from hanging import quadratic_lateness

from orbits import InputError, NoOrbit, find, find_all
from orbits.shooting import METHODS
from problems import Hopper
from problems.laws import springs


def assert_close(value, expected, tolerance):
    """Equal to a relative tolerance, or both None."""
    assert (value is None) == (expected is None)
    if expected is not None:
        assert value == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize("method", [None, "shooting"])
def test_reference_orbits(reference, method):
    orbit = find(machine_of(reference), reference["family"], method=method)
    assert orbit.alpha == pytest.approx(float(reference["alpha"]), rel=1e-12)
    assert orbit.flight_time == pytest.approx(float(reference["flight_time"]), rel=1e-12)
    assert orbit.liftoff_extension == pytest.approx(float(reference["liftoff_extension"]), rel=1e-12)
    mid = [float(reference["y1_mid"]), float(reference["y2_mid"])]
    assert orbit.state_mid_flight[::2] == pytest.approx(mid, rel=1e-11)
    assert orbit.family == reference["family"]
    assert orbit.admissible == reference["admissible"]
    assert_close(orbit.contact_time, reference["contact_time"], 1e-9)
    assert_close(orbit.certificate.smallest_separation, reference["smallest_separation"], 1e-9)
    # The minimum of the reference was sampled, to about 1e-8 of its value.
    assert_close(orbit.certificate.clearance, reference["lowest_interior_minimum"], 3e-8)
    if reference["violation"]:
        assert orbit.violations == (reference["violation"],)


@pytest.mark.parametrize("reference", [r for r in REFERENCES if r["gravity"] == "1"])
def test_every_method_leads_to_the_same_orbit(reference):
    found = {}
    for method in METHODS[1 if "**" in reference["spring"] else 0 :]:
        found[method] = find(machine_of(reference), reference["family"], method=method)
        assert found[method].method == method
    for orbit in found.values():
        assert orbit.alpha == pytest.approx(float(reference["alpha"]), rel=1e-12)
        t = np.linspace(0, orbit.flight_time, 101)
        assert orbit(t) == pytest.approx(found["relative"](t), abs=2e-12 * orbit.alpha**2)


GOLDEN = {
    float(beta): (middle(hop["alpha"]), middle(hop["mid_flight_extension"])) for beta, hop in PROVED["cubic"].items()
}


@pytest.mark.parametrize("beta", GOLDEN)
def test_golden_cubic_values(beta):
    orbit = find(Hopper("cubic", parameters={"beta": beta}))
    body, foot = orbit.state_mid_flight[::2]
    assert (orbit.alpha, body - foot) == pytest.approx(GOLDEN[beta], rel=1e-13)


def test_a_table_too_short_names_its_range():
    with pytest.raises(NoOrbit, match=r"leaves the law's range, \[-2, 2\]"):
        find(Hopper(springs.table((np.linspace(-2, 2, 9), np.linspace(-2, 2, 9)))))


@pytest.mark.parametrize("place", [1.00001, 1.0002])
def test_a_force_that_jumps_just_beyond_lift_off(place):
    """The spring r, with 0.5 more beyond a place that is passed within 5e-5 of the flight: the orbit is a motion whose
    landing jerk is alpha/2, and its extension is at rest in mid-flight by the arcs of circles in its phase plane."""
    orbit = find(Hopper(springs.function(lambda r: r + 0.5 * (r > place), breakpoints=(place,))))
    assert orbit.violations == ()
    assert orbit.certificate.landing_jerk == pytest.approx(-orbit.alpha / 2, rel=1e-12)
    below, beyond = np.hypot(1.0, orbit.alpha), np.hypot(place + 0.5, np.sqrt(1.0 + orbit.alpha**2 - place**2))
    up = np.arccos(1.0 / below) - np.arccos(place / below)
    first, down = up + 2 * np.arccos((place + 0.5) / beyond), np.arccos(-1.0) - np.arccos(place / below)
    assert first + down == pytest.approx(orbit.alpha, rel=1e-12)


def test_an_exponent_may_be_a_parameter():
    orbit = find(Hopper("r + beta*r**n", parameters={"beta": 0.3, "n": 3.0}))
    assert orbit.alpha == pytest.approx(float(REFERENCES[2]["alpha"]), rel=1e-12)


def test_threads_do_not_disturb_each_other():
    from concurrent.futures import ThreadPoolExecutor

    machines = [Hopper("cubic", parameters={"beta": 0.1 + 0.01 * i}) for i in range(16)]
    with ThreadPoolExecutor(4) as pool:
        together = [(orbit.alpha, orbit.error) for orbit in pool.map(find, machines)]
    assert together == [(orbit.alpha, orbit.error) for orbit in map(find, machines)]


@pytest.mark.slow
def test_rounding_near_a_singularity_is_no_leap():
    orbit = find(Hopper(springs.rubber(length=0.5)), 60)
    assert orbit.alpha == pytest.approx(165.944491364, rel=1e-10)


@pytest.mark.slow
def test_an_orbit_that_all_but_escapes():
    """With delta -> 0 the extension goes ever further before it comes back, and amplifies a change of the launch speed
    until no digit is left. The truth is by quadrature of the energy integral in 40 digits."""
    spring = Hopper("r + beta*r**3 + delta*r**5", parameters={"beta": -0.02, "delta": 1e-5})
    for delta, alpha in ((1e-6, 7.7202136718102588765), (1e-7, 7.7175395383673296149)):
        orbit = find(spring.with_values(delta=delta))
        assert orbit.family == 1
        assert abs(orbit.alpha - alpha) < orbit.error < 2e-6
    with pytest.raises(NoOrbit, match="no step reduces the residual"):
        find(spring.with_values(delta=1e-10))


def test_a_landing_that_leaps_far():
    """The leg is pressed over the barrier of the spring, as far as 3e8, from where delta brings it back. The flight is
    the same as without delta, whose quadrature is in 40 digits."""
    p = {"beta": -0.010695, "delta": 1e-19}
    orbit = find(Hopper("r + beta*r**3 + delta*r**5", parameters=p))
    assert abs(orbit.alpha - 5.8222616771127784) < orbit.error


def test_a_flight_that_hangs():
    """Small changes grow 6e9-fold on the way to its middle; the launch speed is known to its last digits, by elliptic
    integrals, whose derivative by the launch speed is 1.7e8."""
    machine = Hopper("r + c*r**2", parameters={"c": -0.022})
    slow, hanging = find_all(machine, family=1)
    assert slow.alpha == pytest.approx(4.583807109887378, rel=1e-14)
    lateness = quadratic_lateness(-0.022, hanging.alpha)
    assert abs(lateness) < 1.7e8 * hanging.error
    assert hanging.error < 1e-12
    again = find(machine, start=hanging)
    assert (again.family, again.alpha) == (1, pytest.approx(hanging.alpha, rel=1e-15))
    assert again.flight_time == pytest.approx(2 * hanging.alpha, rel=1e-15)


def test_all_of_a_family_are_asked_for_as_one_of_it_is():
    machine = Hopper("cubic", parameters={"beta": 0.3})
    (only,) = find_all(machine, 3)
    assert (only.family, only.alpha) == (3, pytest.approx(find(machine, 3).alpha, rel=1e-14))
    with pytest.raises(InputError, match="two families, 3 and 2"):
        find_all(machine, 3, family=2)
    for wrong in (0, True, -1):
        with pytest.raises(InputError, match="family = "):
            find_all(machine, wrong)
