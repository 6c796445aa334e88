"""Dimensions of parameters in SI, as far as the elements determine them."""

import pytest
from mechanisms import VALUES, machine

from orbits import Mechanism
from orbits.mechanics import Damper, Mass, Spring
from orbits.symbolic import parse


class TestDimensions:
    @pytest.mark.parametrize("element", [Spring("body - foot - r0", "k*r"), Damper("body - foot - r0", 0.1)])
    def test_of_what_is_added_in_an_extension_are_lengths(self, element):
        stated = machine(element, parameters={**VALUES, "r0": 0.3}, in_si=True)
        assert stated.units_of_parameters() == {"m1": "kg", "m2": "kg", "k": "N/m", "r0": "m"}

    @pytest.mark.parametrize(
        ("extension", "unit"),
        [("foot + a*body", "N/m"), ("2*body", "N m/rad"), ("body", "N m/rad"), ("a*(1 - cos(body))", None)],
    )
    def test_an_extension_is_what_its_coordinates_are(self, extension, unit):
        given = {**VALUES, "c": 1.0, **({"a": 0.3} if "a*" in extension else {})}
        stated = machine(Spring(extension, "c*r"), parameters=given, angles=("body",), in_si=True)
        assert stated.units_of_parameters().get("c") == unit

    @pytest.mark.parametrize(
        ("law", "units"),
        [
            ("k*d*tanh(r/d)", {"k": "N/m", "d": "m"}),
            ("k*h/n*(1 - (1 + r/h)**(-n))", {"k": "N/m", "h": "m"}),  # n has no unit
            ("F*sin(r/d + n)", {"F": "N", "d": "m"}),
            ("k*r + b*sqrt(abs(r))", {"k": "N/m", "b": "N/m^(1/2)"}),
            ("k*r + b*tanh(c*r)", {"k": "N/m", "b": "N", "c": "1/m"}),
            ("s*b*r + c*r**3", {"c": "N/m^3"}),  # one of two factors
            ("r + b*r**3", {"b": "N/m^3"}),  # the 1 has a unit
            ("r + b*tanh(c*r)", {}),
            ("s*r**n", {}),  # the unit depends on n
        ],
    )
    def test_of_a_law_follow_from_how_it_scales(self, law, units):
        own = dict.fromkeys(parse(law).names - {"r"}, 0.3)
        stated = machine(Spring("body - foot", law), parameters={**VALUES, **own}, in_si=True)
        assert {name: unit for name, unit in stated.units_of_parameters().items() if name in own} == units

    def test_of_what_is_added_to_an_angle_are_none(self):
        turned = machine(Spring("body - r0", "c*r"), parameters={**VALUES, "c": 1.0, "r0": 0.3}, angles=("body",))
        assert "r0" not in turned.units_of_parameters()

    @pytest.mark.parametrize(
        ("across", "units"),
        [
            ("a*sin(turn + tilt)", {"a": "m", "tilt": "rad"}),
            ("a*tilt*sin(turn)", {}),  # one of two factors is a length
            ("a*turn + tilt", {"a": "m", "tilt": "m"}),
            ("a*(1 - cos(turn))**2 + y*tilt", {"a": "m"}),
        ],
    )
    def test_of_lengths_that_turn_and_of_inertias(self, across, units):
        masses = [Mass("y", "m"), Mass("y + 1", "m", across=across), Spring("turn", "k*r")]
        values = {"a": 0.3, "tilt": 0.1, "m": 2.0, "k": 3.0, "J": 0.5, "I": 0.1}
        turned = Mechanism(
            ("y", "turn"), masses, gap="y", parameters=values, angles=("turn",), in_si=True,
            inertia={"y": "I", "turn": "J - m*a**2/9"}, launch="turn",
        )  # fmt: skip
        known = {"m": "kg", "k": "N m/rad", "J": "kg m^2", "I": "kg"}
        assert turned.units_of_parameters() == known | units
