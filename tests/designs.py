"""Shared by the tests of designs: machines, and ranges of their parameters."""

from problems import Hopper, hopper_in_si

CUBIC = Hopper("r + b*r**3", mass_ratio=0.5, rest_length=20.0, parameters={"b": 0.3})
VARYING = Hopper("r + b*r**3", "1/(1 + z/R)**2", 0.5, 20.0, parameters={"b": 0.3, "R": 150.0})
LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e5}, rest_length=0.8)
RANGE = (0.02, 3.0)
OVER = {"k": (500.0, 5e4), "b": (0.0, 1e7)}
