"""Multipliers of hops: the slope of the map, and the law beside a landing that has none."""

import numpy as np
import pytest
from plane import linear, wheel

from orbits import NoOrbit, ReturnMap, find, multiplier
from problems import Hopper, Juggler

ALPHA = 4.493409457909064


@pytest.mark.parametrize(
    ("machine", "alpha"),
    [
        (Hopper(), 4.6), (Hopper(), 4.0), (Hopper(restitution=0.3), 4.7), (Hopper(damping=0.05), 5.0),
        (Juggler(mass_ratio=2.0), 4.8), (Hopper("r + 0.1*r**3"), 4.6), (Juggler(damping=0.05, drag=0.02), 5.0),
        (Hopper("r", "1 - k*z", rest_length=9.0, parameters={"k": 0.01}), 4.0),
    ],
)  # fmt: skip
def test_multipliers_are_the_slope_of_the_map(machine, alpha):
    h = 2e-5
    x = ReturnMap(machine)(alpha + h * np.array([-2.0, -1.0, 1.0, 2.0])).next
    assert multiplier(machine, alpha) == pytest.approx((x[0] - 8 * x[1] + 8 * x[2] - x[3]) / (12 * h), rel=1e-8)


def test_a_lossless_landing_has_no_multiplier():
    with pytest.raises(NoOrbit, match="tangential"):
        multiplier(Hopper(), ALPHA)
    with pytest.raises(NoOrbit, match="rests"):
        multiplier(Hopper(), 2.0)


@pytest.mark.parametrize("machine", [Hopper(), Hopper(mass_ratio=3.0), Juggler("r + 0.1*r**3")])
def test_the_law_beside_a_tangential_landing_is_told(machine):
    """In place of a multiplier, with the coefficient of the certificate."""
    orbit = find(machine)
    with pytest.raises(NoOrbit, match="tangential") as error:
        multiplier(machine, orbit.alpha)
    c = orbit.certificate.loss_coefficient
    sign = "+" if orbit.certificate.bounce_side == "below" else "-"
    assert f"alpha {sign} d loses {c:.4g} d**(4/3)" in str(error.value)
    assert f"{10 * c:.4g} d**(4/3)" in str(error.value)


def test_the_law_beside_a_lossless_step_is_that_of_its_certificate():
    c = find(wheel()).certificate
    with pytest.raises(NoOrbit, match="tangential") as error:
        multiplier(wheel(), find(wheel()).alpha)
    more = c.loss_coefficient * c.bounce_factor
    text = f"alpha - d loses {c.loss_coefficient:.4g} d**(4/3), a launch at alpha + d {more:.4g} d**(4/3)"
    assert c.bounce_side == "above"
    assert text in str(error.value)
    with pytest.raises(NoOrbit, match="there is no power law either"):  # hand-overs that lose nothing
        multiplier(linear("wheel", 1.0, 0.5), find(linear("wheel", 1.0, 0.5)).alpha)
