"""Whether a motion belongs to a machine, judged by the machine's equations and not by its name."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ..model import Phase
from ..numerics import derivative, evaluate
from .flow import flow_of
from .trajectory import Trajectory

# In the middle of a step the rates of a motion differ from those of its equations by roundings and the end of a series,
# measured up to 3e-14 of the largest, and from those of other equations by more than this share.
SAME_RATES = 1e-9
# Steps of a smaller share of the motion are not compared: where breakpoints coincide one has a length of roundings, and
# its middle may be on the other side of a jump.
LEAST_COMPARED = 1e-9


def is_motion_of(path: Trajectory, phase: Phase, values: Mapping[str, ArrayLike]) -> bool:
    """Whether a motion, whose first rows are the states of a phase, has the rates that the phase's equations say with
    these values of its parameters, numbers or arrays (N,), in the middle of each of its N steps; in half of them where
    a formula has corners, which steps leap over."""
    flow, middles = flow_of(phase, tuple(values)), path.steps[:, None] / 2
    long = path.steps > LEAST_COMPARED * path.steps.sum()
    rows = path.coefficients[:, : flow.size]
    states, rates = evaluate(rows, middles), evaluate(derivative(rows), middles)
    p = np.stack([np.broadcast_to(np.asarray(x, dtype=float), len(states)) for x in values.values()], axis=1)
    own = flow.field(states, p)[0]
    largest = np.abs(rates).max(0)
    same = (np.abs(own - rates) <= SAME_RATES * np.maximum(largest, SAME_RATES * largest.max())).all(1)[long]
    return bool(same.all() if flow.is_smooth or phase.pieces else same.mean() >= 0.5)
