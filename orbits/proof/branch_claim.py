"""The claims of a family about a curve of orbits; none is trusted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..exact import Claim
from ..model import Machine

# Points (m, n + 1) of the numerical curve near guesses (m, n + 1) where a coordinate, given by its index, has values
# (m,), with half the times of contact (m,), NaN where none ends; it raises an `OrbitsError` where there are none.
Solver: TypeAlias = Callable[[int, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class BranchClaim:
    """The claims of a family about a curve of orbits along a parameter, of a machine without units.

    first, last : the claims of its ends
    names : of the coordinates of the curve: the unknowns of its equations, and the parameter
    points, tangents : (m, n + 1) along it; none is trusted
    solve : see `Solver`, with the coordinates in the order of `names`
    """

    machine: Machine
    along: str
    first: Claim
    last: Claim
    names: Sequence[str]
    points: np.ndarray
    tangents: np.ndarray
    solve: Solver
