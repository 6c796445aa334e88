"""Machines stated in SI: their units, and the numbers that they are stated by."""

from problems import hopper_in_si


def test_a_body_radius_is_a_parameter_in_metres_beside_a_force_law_of_any_names():
    machine = hopper_in_si(
        60, 3, force="k*r + R*r**3", rest_length=0.8, body_radius=250.0, parameters={"k": 8e3, "R": 2e6}
    )
    assert machine.parameters == {"k": 8e3, "R": 2e6, "body_radius": 250.0}
    assert machine.describe()["laws_in"] == "SI"
