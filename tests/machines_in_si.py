"""Shared by the tests of units: machines stated in SI."""

from problems import hopper_in_si, juggler_in_si

LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e5}, rest_length=0.8)
THROWER = juggler_in_si(0.3, 0.2, stiffness=40.0, rest_length=0.5, surface_gravity=3.7)
ROVER = hopper_in_si(
    2.5, 0.5, force="k*r + b*r**3", parameters={"k": 0.05, "b": 0.1}, rest_length=0.6, surface_gravity=1e-4,
    body_radius=250.0,
)  # fmt: skip
