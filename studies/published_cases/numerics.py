"""Where a statement begins to hold, and derivatives of simulated maps."""

from collections.abc import Callable

import numpy as np


def least(holds: Callable[[float], bool], low: float, high: float, within: float) -> float:
    """The least number at which a statement holds, between one at which it does not and one at which it does."""
    while high - low > within:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def slopes(image: Callable[[np.ndarray], np.ndarray], start: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """The derivative (m, n) of a map from (n,) to (m,) numbers at a start (n,), by central differences."""
    sides = [[image(start + sign * step * unit) for sign in (1, -1)] for unit in np.eye(len(start))]
    return np.stack([(above - below) / (2 * step) for above, below in sides], axis=1)
