"""Linear systems, one or a stack of them, of which a singular one has the solution NaN and raises nothing."""

import numpy as np


def solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The solution of a square system (n, n) or of a stack of them (m, n, n); NaN where one is singular."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        if matrix.ndim == 2:
            return np.full(np.shape(right), np.nan)
        sides = np.broadcast_to(right, (len(matrix), *np.shape(right)[-2:]))
        return np.array([solve(one, side) for one, side in zip(matrix, sides, strict=True)])
