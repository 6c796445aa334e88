"""What certificates say of real motions, and of orbits that are no motion."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import REFERENCES, machine_of, slow_after
from scalings import MACHINES, UNITS, in_units, unit_of
from steps import stepping
from two_feet import FEET, height_in_contact, slowest_step

from orbits import NoOrbit, find, quantities, sweep
from problems import HeavyHand, Hopper


class TestNoMotion:
    def test_foot_below_ground(self):
        orbit = find(Hopper("r + a*sin(b*r)", mass_ratio=2.0, parameters={"a": 1.8, "b": 5.7}, rest_length=40))
        assert not orbit.admissible
        (violation,) = [v for v in orbit.violations if v.startswith("foot below ground")]
        when = float(violation.split("t = ")[1].split(" ")[0])
        t = np.linspace(0, orbit.flight_time / 2, 20001)
        foot = orbit(t)[:, 2]
        assert foot.min() < 0
        assert t[foot.argmin()] == pytest.approx(when, abs=1e-3)
        assert orbit.certificate.clearance == pytest.approx(foot.min(), rel=1e-5)

    def test_ground_pulls_in_contact(self):
        orbit = find(Hopper("r + a*sin(b*r)", parameters={"a": 4.5, "b": 2.2}, rest_length=40), 2)
        assert any("ground would have to pull" in v for v in orbit.violations)
        t = orbit.flight_time + np.linspace(0, orbit.contact_time, 5001)
        r = orbit(t)[:, 0]
        force = 1 - (r + 4.5 * np.sin(2.2 * r))
        assert force.min() == pytest.approx(orbit.certificate.smallest_contact_force, abs=1e-4)
        assert force.max() == pytest.approx(orbit.certificate.largest_contact_force, abs=1e-4)

    def test_masses_pass_through_each_other(self):
        orbit = find(Hopper("r", rest_length=5.0))
        (violation,) = orbit.violations
        assert "masses pass through each other" in violation
        assert orbit.certificate.smallest_separation == pytest.approx(12.338059058 - 15, rel=1e-9)

    def test_collapse_has_no_contact_time_and_no_period(self):
        orbit = find(machine_of(next(r for r in REFERENCES if not r["admissible"])), 2)
        assert orbit.contact_time is None
        assert orbit.certificate.smallest_separation is None
        with pytest.raises(Exception, match="no period"):
            _ = orbit.period
        assert orbit(0.0)[0] == pytest.approx(orbit.liftoff_extension, rel=1e-15)
        with pytest.raises(Exception, match="never ends"):
            orbit(2 * orbit.flight_time)


def test_energy_drift_is_that_of_the_motion():
    """The potential of the cubic spring is known: energy along flight and contact, to the certificate's figure."""
    M, b = 0.5, 0.3
    orbit = find(Hopper("cubic", mass_ratio=M, parameters={"beta": b}))
    y1, v1, y2, v2 = orbit(np.linspace(0, orbit.period, 2000)).T
    r = y1 - y2
    energy = (1 + M) / 2 * (v1**2 + M * v2**2) + M * (r**2 / 2 + b * r**4 / 4) + y1 + M * y2
    kinetic = (1 + M) / 2 * orbit.alpha**2
    assert np.ptp(energy) < 2e-14 * kinetic
    assert orbit.certificate.energy_drift < 1e-14


def test_an_infinitely_heavy_hand_loses_nothing_on_either_side():
    certificate = find(HeavyHand("cubic")).certificate
    assert certificate.loss_coefficient == 0
    assert certificate.stable_side is certificate.bounce_side is None


def test_a_loss_beyond_all_numbers_is_refused():
    machine = Hopper("cubic")
    object.__setattr__(machine, "model", replace(machine.model, impact_mass=lambda x, p: np.inf))
    with pytest.raises(NoOrbit, match="its numbers overflow"):
        find(machine)


def without_numbers(text):
    return re.sub(r"-?[\d.]+(e[+-]\d+)?", "#", str(text))


@pytest.mark.parametrize("name", slow_after(1, MACHINES))
def test_certificates_in_other_units(name):
    """All numbers are the same in their units, errors as far as rounding is the same, and so are all words."""
    first, known = in_units(name, UNITS[0]), None
    for units in UNITS:
        orbit = in_units(name, units)
        c = orbit.certificate
        speed, length = (unit_of("'", units), units[0]) if name != "wheel" else (1 / units[1], 1.0)
        coefficient = c.loss_coefficient * speed ** (1 / 3)
        numbers = [orbit.alpha / speed, orbit.flight_time / units[1], orbit.contact_time / units[1], coefficient]
        numbers += [each / length for each in (c.clearance, orbit.liftoff_extension) if each is not None]
        words = c.family, c.stable_side, c.bounce_side, [*map(without_numbers, c.violations)]
        known = known or (numbers, words)
        assert numbers == pytest.approx(known[0], rel=1e-12)
        assert words == known[1]
        errors = orbit.error / speed, c.loss_error / abs(c.loss_coefficient)
        own = first.error, first.certificate.loss_error / abs(first.certificate.loss_coefficient)
        assert all(each / 8 < error < 8 * each for error, each in zip(errors, own, strict=True))
        assert c.energy_drift < 1e-12


class TestSteps:
    """Machines that step: each point of contact is checked, and named."""

    def test_both_feet_press_and_stay_above_the_ground(self):
        for kind in ("wheel", "rocker"):
            orbit = find(stepping(kind, 1.0, 0.5, 0.3))
            assert orbit.violations == ()
            lift = 0.5 * (np.sin(0.3) if kind == "wheel" else np.tan(0.3))
            assert orbit.certificate.largest_contact_force == pytest.approx(2 * lift, rel=1e-12)
            assert orbit.certificate.loss_coefficient is None

    def test_the_other_foot_touches_while_one_stands(self):
        """Flight and contact force satisfy all conditions, and the other foot comes to -24 in contact."""
        orbit = slowest_step()
        t = np.linspace(0, orbit.contact_time, 2001)
        height = height_in_contact(orbit, t)
        when, lowest = t[height.argmin()], height.min()
        assert lowest == pytest.approx(-24.15082812703635, rel=1e-6)
        text = f"the right touches in contact at t = {when:.6g} of the contact (height {lowest:.3g})"
        assert orbit.violations == (text,)
        assert orbit.certificate.clearance == pytest.approx(lowest, rel=1e-6)
        assert quantities(FEET, orbit, "clearance")["clearance"] == pytest.approx(orbit.certificate.clearance, rel=1e-9)
        assert sweep(FEET, {"m": (1.9, 2.1)}, samples=3, start=orbit).statuses() == {"inadmissible": 3}

    @pytest.mark.parametrize(
        ("numbers", "law", "start", "telling"),
        [
            (("wheel", 0.26, 1.19, 0.52), "r - 1.01*sin(8*r)", (0.41467, 1.49911, 2.36794), "the rear foot would have"),
            (("rocker", 0.34, 1.22, 0.6), "r - 1.25*sin(4*r)", (0.79361, 1.15800, 3.27153), "the foot would have"),
            (
                ("rocker", 0.28, 2.22, 0.54),
                "r - 0.87*sin(8*r)",
                (0.53650, 2.23962, 3.94169),
                "the foot touches in flight",
            ),
        ],
    )
    def test_feet_are_named(self, numbers, law, start, telling):
        names = ("liftoff", "alpha", "duration")
        orbit = find(stepping(*numbers, law), start=dict(zip(names, start, strict=True)))
        (violation,) = [each for each in orbit.violations if each.startswith(telling)]
        when, names = float(violation.split("t = ")[1].split(" ")[0]), orbit.machine["parameters"]
        t = np.linspace(0, 0.5 * (orbit.contact_time if "have" in telling else orbit.flight_time), 20001)
        if "touches" in telling:
            assert t[orbit(t)[:, 2].argmin()] == pytest.approx(when, abs=1e-3)
            assert orbit(t)[:, 2].min() == pytest.approx(orbit.certificate.clearance, abs=1e-6)
            return
        lift = names["kappa"] * (np.sin if numbers[0] == "wheel" else np.tan)(names["angle"])
        r = orbit(orbit.flight_time + t[1:])[:, 0]
        force = lift - (r + float(law[4:8]) * -np.sin(float(law[13]) * r))
        assert force == pytest.approx(orbit.contact_force(orbit.flight_time + t[1:]), abs=1e-9)
        assert t[1:][force < 0][0] == pytest.approx(when, abs=1e-3)

    @pytest.mark.slow
    def test_masses_meet_in_the_second_halves_too(self):
        """The extension has its largest value in one half of the flight, and its least in the other."""
        usual = stepping("wheel", 1.0, 0.5, 0.3)
        orbit = find(usual)
        states = orbit(np.linspace(0, orbit.flight_time, 20001))
        extension = states[:, 0] - states[:, 2]
        largest = np.abs(extension).max()
        assert extension.max() == pytest.approx(-extension.min(), rel=1e-6)
        for sign in "+", "-":
            near = find(replace(usual, separation=f"0.5 {sign} (phi - theta)"))
            assert near.certificate.smallest_separation == pytest.approx(0.5 - largest, abs=1e-7)
        meeting = find(replace(usual, separation=f"{0.99 * largest} + phi - theta"))
        (violation,) = meeting.violations
        when = float(violation.split("t = ")[1].split(" ")[0])
        assert orbit(when)[0] - orbit(when)[2] == pytest.approx(extension.min(), rel=1e-6)
        assert when > 0.5 * orbit.flight_time
