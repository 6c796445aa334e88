"""The motion of the extension alone: straight lines in closed form against laws that are integrated."""

import numpy as np
import pytest

from orbits import InputError, find
from orbits.laws import from_formula
from orbits.model import half_angle, straight_line
from problems import Hopper, Juggler, inerter_hopper


@pytest.mark.parametrize("family", [1, 2, 7, 40])
def test_half_angles_are_roots_of_the_tangent(family):
    b = half_angle(family)
    assert np.sin(b) == pytest.approx(b * np.cos(b), abs=1e-14 * b**2)
    assert family * np.pi < b < (family + 0.5) * np.pi


@pytest.mark.parametrize(
    ("text", "words"),
    [("-r", "stiffness -1"), ("1e-300*r", "stiffness 1e-300: it never"), ("1e300*r", "stiffness 1e\\+300: it never")],
)
def test_lines_that_are_no_springs(text, words):
    law = from_formula(text, "r")
    with pytest.raises(InputError, match=words):
        straight_line(law.key, law.parameters)


@pytest.mark.parametrize(
    "machine",
    [
        lambda spring: Hopper(spring, mass_ratio=0.4),
        lambda spring: Juggler(spring, mass_ratio=3.0),
        lambda spring: inerter_hopper(spring, inertance=0.7),
        lambda spring: Hopper(spring, mass_ratio=2.0, rest_length=7.0),
    ],
)
@pytest.mark.parametrize("family", [1, 3])
def test_closed_forms_are_what_integration_finds(machine, family):
    """Of a spring at rest beside 0, whose line is bent by less than rounding in the other machine."""
    exact, integrated = (find(machine(spring), family) for spring in ("2.5*(r - 0.3)", "2.5*(r - 0.3) + 1e-30*sin(r)"))
    assert (exact.method, integrated.method) == ("closed form", "relative")
    for name in ("alpha", "liftoff_extension", "flight_time", "contact_time"):
        assert getattr(exact, name) == pytest.approx(getattr(integrated, name), rel=1e-12)
    times = np.linspace(0.0, exact.period, 30)
    assert exact(times) == pytest.approx(integrated(times), rel=1e-10, abs=1e-10)
    assert exact.error < 1e-13 * exact.alpha
    for name in ("landing_jerk", "loss_coefficient", "largest_contact_force", "smallest_separation", "clearance"):
        own, other = (getattr(each.certificate, name) for each in (exact, integrated))
        assert own == (other and pytest.approx(other, rel=1e-9, abs=1e-9))
