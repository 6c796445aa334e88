"""Shared by the tests of optimal control: a cart that is pushed, and its conditions, cost and guess."""

import numpy as np

from orbits.control import Guess, Input, Stage
from orbits.model import Phase

CART = Phase("cart", ("x", "v"), lambda x, p, q: [x[1], p["f"]])
SLED = Phase("sled", ("v", "x", "heat"), lambda x, p, q: [p["f"], x[0], p["g"] ** 2])
HALF = 0.5
EFFORT = {"running": lambda x, p, q: p["f"] ** 2}
AT_REST = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - 1, x[1]]}
STRAIGHT = [Guess(1.0, lambda t: [t, 1.0])]


def cart(intervals=4, duration=(1.0, 1.0), degree=1, low=-np.inf, high=np.inf, **stage) -> Stage:
    return Stage(CART, intervals, duration, {"f": Input(low, high, degree)}, **{**AT_REST, **EFFORT, **stage})
