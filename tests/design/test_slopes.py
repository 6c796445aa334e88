"""Sensitivities as a result: a mapping, a table with units, and relative derivatives."""

import numpy as np
import pytest

from orbits import sensitivities
from problems import Hopper, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, stiffness=5000.0, rest_length=0.8)


def test_it_is_a_mapping_that_equals_a_dictionary():
    found = sensitivities(LEG, 1, ["stiffness"], ["alpha", "flight_time"])
    assert [*found] == ["alpha", "flight_time"]
    assert found == {name: dict(found[name]) for name in found}
    assert found != sensitivities(LEG, 1, ["stiffness"], ["alpha"])


def test_relative_derivatives_are_powers():
    """By dimensions: alpha of sqrt(m g^2/k), times of sqrt(m/k), the stroke of m g/k; the masses together are m."""
    found = sensitivities(LEG, 1, None, ["alpha", "flight_time", "stroke"]).relative()
    for quantity, by_mass, by_gravity, by_stiffness in (
        ("alpha", 0.5, 1.0, -0.5), ("flight_time", 0.5, 0.0, -0.5), ("stroke", 1.0, 1.0, -1.0),
    ):  # fmt: skip
        row = found[quantity]
        assert row["body_mass"] + row["foot_mass"] == pytest.approx(by_mass, abs=1e-9)
        assert row["surface_gravity"] == pytest.approx(by_gravity, abs=1e-9)
        assert row["stiffness"] == pytest.approx(by_stiffness, abs=1e-9)


def test_the_table_has_units():
    table = sensitivities(LEG, 1, ["stiffness", "rest_length"], ["alpha"]).table()
    assert table["unit"] == ["m/s per N/m", "m/s per m"]
    assert table["value of parameter"] == [5000.0, 0.8]
    assert table["relative derivative"] == pytest.approx([-0.5, 0.0], abs=1e-9)
    assert sensitivities(Hopper("cubic"), 1, ["beta"], ["alpha"]).table()["unit"] == [""]


def test_a_quantity_of_0_has_no_relative_derivative():
    found = sensitivities(LEG, 1, ["stiffness"], ["alpha - alpha"])
    assert np.isnan(found.relative()["alpha - alpha"]["stiffness"])
