"""Shared by the tests of designs: machines, ranges of their parameters, and whether two designs are the same."""

import numpy as np

from orbits import Design
from problems import Hopper, hopper_in_si

CUBIC = Hopper("r + b*r**3", mass_ratio=0.5, rest_length=20.0, parameters={"b": 0.3})
VARYING = Hopper("r + b*r**3", "1/(1 + z/R)**2", 0.5, 20.0, parameters={"b": 0.3, "R": 150.0})
LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e5}, rest_length=0.8)
RANGE = (0.02, 3.0)
OVER = {"k": (500.0, 5e4), "b": (0.0, 1e7)}
ANOTHER = Hopper("r + beta*r**3", parameters={"beta": 0.3}, rest_length=10.0)


def same_design(one: Design, other: Design) -> bool:
    names = ("source", "parameters", "verb", "text", "objective", "quantities", "active", "idle", "kkt", "starts")
    equal = all(getattr(one, name) == getattr(other, name) for name in (*names, "pair", "share", "seconds"))
    return equal and str(one) == str(other) and np.array_equal(one.orbit([0.0, 0.1]), other.orbit([0.0, 0.1]))
