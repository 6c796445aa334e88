"""A point of a branch of hops that return."""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

# The multipliers of bifurcations, by their kind.
MULTIPLIER_AT = {"fold": 1.0, "flip": -1.0}


@dataclass(frozen=True, eq=False)
class PeriodicLaunch:
    """A point of a branch of hops that return.

    value : of the parameter
    alphas : the launch speeds (period,), in the machine's units
    multiplier : of the hops, that of largest modulus, of a complex one the modulus; NaN where there is none
    impacts : in each hop
    place, tangent : (2,), of the first launch speed and the parameter, as shares of the ranges
    border, sides : where a launch is at a border of the map, the kind of the border, and the multipliers on both sides
        of it, that before it first
    rates : (period,), of the launch speeds along the tangent; None where they are not known
    launches, matrix : of launches of d numbers these (period, d), without units, and the derivative (d, d) of the last
        one by the first; None where they are not known, as what follows
    slacks : (k,), of the word of the hops
    x, direction : (n + 1,), the point of their curve and its tangent there
    """

    value: float
    alphas: tuple[float, ...]
    multiplier: float
    impacts: tuple[int, ...]
    place: np.ndarray
    tangent: np.ndarray
    border: str = ""
    sides: tuple[float, ...] = ()
    rates: np.ndarray | None = None
    launches: Any = None
    matrix: Any = None
    slacks: np.ndarray | None = None
    x: Any = None
    direction: Any = None

    @property
    def alpha(self) -> float:
        """The first of the launch speeds."""
        return self.alphas[0]

    @property
    def spectrum(self) -> np.ndarray:
        """The multipliers (d,), those of largest modulus first."""
        return spectrum_of(self.matrix)


def spectrum_of(matrix: np.ndarray) -> np.ndarray:
    """The eigenvalues (d,) of a derivative (d, d), those of largest modulus first; NaN where it has none."""
    if not np.isfinite(matrix).all():
        return np.full(len(matrix), np.nan, complex)
    values = np.linalg.eigvals(matrix).astype(complex)
    return np.array(values[np.lexsort((-values.imag, -np.abs(values).round(12)))])


def dominant(matrix: np.ndarray) -> float:
    """The multiplier of largest modulus of a derivative (d, d), of a complex one the modulus."""
    first = matrix[0, 0] if len(matrix) == 1 else spectrum_of(matrix)[0]
    return float(first.real if first.imag == 0 else abs(first))


def crossings(matrix: np.ndarray) -> tuple[float, float, float]:
    """Functions of a derivative (d, d) that vanish at a flip, at a multiplier 1 and at a Neimark-Sacker bifurcation."""
    if len(matrix) == 1 or not np.isfinite(matrix).all():
        return float(matrix[0, 0] + 1), float(matrix[0, 0] - 1), 1.0
    one, values = np.eye(len(matrix)), np.linalg.eigvals(matrix)
    pairs = np.prod([a * b - 1 for a, b in combinations(values, 2)]).real
    return float(np.linalg.det(matrix + one)), float(np.linalg.det(matrix - one)), float(pairs)
