"""The friction that an orbit needs, against a formula along motions of another integrator."""

import json
from dataclasses import replace

import numpy as np
import pytest
from plane import friction_by_formula, linear, rocker, wheel
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

from orbits import Orbit, find
from orbits.periodic import friction
from problems import rimless_wheel


def by_formula(orbit, kind, mu, kappa, a, share, law=lambda r: r):
    """The largest |T|/N of the first half of the flight, with the motion and the formula of its own."""

    def torque(theta):
        if a is None:
            return kappa * (theta - 1.0)
        return kappa * (np.sin(theta - a) if kind == "wheel" else np.sin(theta) - np.tan(a) * np.cos(theta))

    def rates(t, x):
        spring = law(x[0] - x[2])
        return [x[1], -spring, x[3], mu * (torque(x[2]) + spring)]

    end = orbit.flight_time / 2
    start = [orbit.liftoff_extension, orbit.alpha, 0.0, 0.0]
    motion = solve_ivp(rates, (0, end), start, "DOP853", rtol=1e-13, atol=1e-14, dense_output=True).sol

    def share_at(t):
        x = motion(t)
        return np.abs(friction_by_formula(kind, mu, kappa, a, share, x[2], x[3], rates(t, x)[3]))

    t = np.linspace(0, end, 1001)
    best = int(share_at(t).argmax())
    around = t[max(best - 1, 0)], t[min(best + 1, 1000)]
    refined = minimize_scalar(lambda t: -share_at(t), bounds=around, method="bounded", options={"xatol": 1e-12})
    return max(-refined.fun, share_at(t).max())


@pytest.mark.parametrize(
    ("kind", "mu", "kappa", "family", "share", "needed"),
    [
        ("wheel", 1.0, 0.5, 1, 1.0, 1.3604), ("wheel", 1.0, 0.5, 2, 1.0, 1.3984), ("wheel", 0.2, 0.5, 1, 1.0, 4.1634),
        ("rocker", 1.0, 0.5, 1, 1.0, 1.4126), ("rocker", 1.0, 0.5, 2, 1.0, 1.4025), ("rocker", 0.2, 0.5, 1, 0.7, None),
    ],
)  # fmt: skip
def test_friction_of_linearised_machines(kind, mu, kappa, family, share, needed):
    """Figures of another program; T/N is share theta'' / (mu kappa)."""
    orbit = find(linear(kind, mu, kappa, share), family)
    own = orbit.certificate
    assert own.friction_needed == pytest.approx(by_formula(orbit, kind, mu, kappa, None, share), abs=1e-9)
    assert needed is None or own.friction_needed == pytest.approx(needed, abs=5e-5)
    assert own.smallest_stance_force == pytest.approx(kappa / share * share, rel=1e-14)  # nothing moves up or down
    assert 0 < own.friction_error < 1e-12


@pytest.mark.parametrize(
    ("kind", "mu", "kappa", "a", "share", "law"),
    [
        ("wheel", 1.0, 0.5, 0.3, 1.0, "r"), ("wheel", 2.0, 0.8, 0.4, 0.6, "r + r**3"),
        ("rocker", 0.7, 0.6, 0.25, 0.8, "r"),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_friction_of_machines_with_the_sine(kind, mu, kappa, a, share, law):
    orbit = find(wheel(mu, kappa, a, share, law) if kind == "wheel" else rocker(mu, kappa, a, share))
    force = (lambda r: r + r**3) if "3" in law else (lambda r: r)
    needed = by_formula(orbit, kind, mu, kappa, a, share, force)
    assert orbit.certificate.friction_needed == pytest.approx(needed, abs=1e-9)
    assert 0 < orbit.certificate.friction_time <= orbit.flight_time / 2


@pytest.mark.slow
def test_an_orbit_that_needs_more_friction_than_there_is_violates_it():
    less = find(wheel(friction=0.385))
    enough = find(wheel(friction="0.385 + 0.001*share"))
    assert enough.admissible
    (words,) = less.violations
    assert words == "it needs the friction coefficient 0.385822 at t = 1.16848, above the stated 0.385: a foot slides"


def test_a_standing_foot_that_lifts_is_named_and_has_no_friction():
    orbit = find(wheel(1.0, 0.1, 0.5))
    assert orbit.violations[0].startswith("the standing foot lifts at t = ")
    assert orbit.certificate.friction_needed is None
    assert orbit.certificate.smallest_stance_force < 0


def test_where_the_ground_would_have_to_pull_no_friction_is_enough(monkeypatch):
    """With less of the force across the ground in contact than there is, and with more."""
    machine, of_ground = wheel(), friction._forces_of_ground
    for less, enough in ((0.1, True), (9.0, False)):

        def forces(phase, *motions, less=less, model=machine.model):
            found = of_ground(phase, *motions)
            found.normal[:, 0] -= less if phase is model.contact else 0.0
            return found

        monkeypatch.setattr(friction, "_forces_of_ground", forces)
        certificate = find(machine).certificate
        assert (certificate.friction_needed is not None) == (certificate.friction_time is not None) == enough


def test_files_have_the_friction_and_files_without_it_are_read(tmp_path):
    orbit = find(wheel())
    orbit.save(tmp_path / "orbit.json")
    assert Orbit.load(tmp_path / "orbit.json") == orbit
    document = json.loads((tmp_path / "orbit.json").read_text())
    assert document["friction_needed"] == orbit.certificate.friction_needed
    for name in ("friction_needed", "friction_error", "friction_time", "smallest_stance_force", "stance_judged"):
        document.pop(name)
    assert Orbit.of_saved(document).certificate.friction_needed is None


def test_a_foot_that_lifts_at_lift_off_needs_no_share():
    """A wheel whose feet are far apart: the standing one would pull at once, and nothing is integrated to time 0."""
    wide = find(replace(rimless_wheel(angle=1.0), bounds={}).with_values(angle=1.9))
    assert wide.certificate.friction_needed is None
    assert wide.alpha == pytest.approx(2.02106205, rel=1e-8)
