"""Shared by the tests of flows: oscillators by force, smooth, by cases and in pieces."""

import casadi as ca
import numpy as np

from orbits.flow import Flow
from orbits.model import Phase, Pieces

START, TIME = np.array([0.83, 2.93]), 2.9


def oscillator(force, **more) -> Flow:
    return Flow(Phase("flight", ("r", "v"), lambda x, p, q: [x[1], -force(x[0], p, q)], **more), ("b",))


def duffing(r, p, q):
    return r + p["b"] * r**3


def duffing_by_cases(r, p, q):
    """This force by operations that have no Taylor series."""
    return r + p["b"] * r * r * ca.fabs(r) * ca.sign(r)


def bilinear_pieces(p):
    return [-np.inf, 1.0, np.inf], [[1.0], [p["b"]]]


def bilinear(r, p, q):
    return 1.0 + q[0] * (r - 1.0)


BILINEAR = {"pieces": Pieces((1.0, 0.0), 1, bilinear_pieces, "extension")}
