"""Linear systems, one or a stack of them, in which a singular one is an answer and not an error."""

import numpy as np


def solve(matrix, right) -> np.ndarray:
    """The solution of a square system, or of a stack of them, NaN where one is singular."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        if matrix.ndim == 2:
            return np.full(np.shape(right), np.nan)
        right = np.broadcast_to(right, (len(matrix), *np.shape(right)[-2:]))
        return np.array([solve(one, side) for one, side in zip(matrix, right, strict=True)])
