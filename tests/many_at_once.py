"""Shared by the tests of computations for many points in one call."""

import numpy as np

from problems import Hopper
from problems.laws import springs

RANGE = np.linspace(-3, 3, 13)
MACHINES = {
    "cubic": Hopper("cubic", rest_length=30),
    "sinh in gravity": Hopper("sinh", "1/(1 + z/60)**2", rest_length=12),
    "a pole": Hopper("r/(1 - r/4)", rest_length=30),
    "bilinear": Hopper("bilinear", rest_length=30),
    "bilinear where it lifts off": Hopper(springs.bilinear(gap=1.0), rest_length=30),
    "end stops": Hopper("end_stops", rest_length=30),
    "a short table": Hopper(springs.table((RANGE, RANGE + 0.1 * RANGE**3)), rest_length=30),
}
