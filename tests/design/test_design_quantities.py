"""Quantities of orbits against their documents and closed forms."""

import math

import numpy as np
import pytest
from designs import CUBIC, VARYING

from orbits import find, quantities
from problems import Hopper


def test_quantities_are_those_of_the_document():
    for machine, family in ((CUBIC, 2), (VARYING, 1)):
        orbit = find(machine, family)
        values, document = quantities(machine, orbit), orbit.document()
        assert {
            "stroke",
            "landing_sensitivity",
            "largest_spring_force",
            "period",
        } == values.keys() - document.keys() - {f"{name.replace(' ', '_')}_rise" for name in orbit.rises}
        for name in values.keys() & document.keys():
            # the certificate takes C from the motion before Newton's last step
            share = 1e-8 if name == "loss_coefficient" else 1e-11
            assert values[name] == pytest.approx(document[name], rel=share), name
        for name, rise in orbit.rises.items():
            assert values[f"{name.replace(' ', '_')}_rise"] == pytest.approx(rise, rel=1e-11)
        t = np.linspace(0, orbit.period, 20001)
        extension = orbit(t)[:, 0] - orbit(t)[:, 2]
        assert values["stroke"] == pytest.approx(np.ptp(extension), rel=1e-6)


def test_linear_hopper_has_its_closed_forms():
    """Flight time 2 alpha, rise of the centre of mass alpha^2/2/(1 + M), period and stroke by hand."""
    M, alpha = 0.3, 4.493409457909064
    values = quantities(Hopper(mass_ratio=M), find(Hopper(mass_ratio=M)))
    depth = -1 / M - (1 + M) / M * math.sqrt(1 + M / (1 + M) * alpha**2)
    assert values["centre_of_mass_rise"] == pytest.approx(alpha**2 / 2 / (1 + M), rel=1e-12)
    assert values["stroke"] == pytest.approx(math.sqrt(1 + alpha**2) - depth, rel=1e-12)
    assert values["largest_spring_force"] == pytest.approx(-depth, rel=1e-12)
    assert values["landing_sensitivity"] * (1 + M) == pytest.approx(2 * alpha - math.sin(2 * alpha), rel=1e-12)
