"""The active limits of a program at its critical points: how far they are from changing, and what changes with them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..numerics import Array
from .kkt_conditions import ParametricProgram, SecondDerivatives, sparse_columns

# Marks of the limits: not active, at the lower or upper limit, or an equality.
FREE, LOWER, UPPER, EQUAL = 0, -1, 1, 2


@dataclass(frozen=True, eq=False)
class CriticalPoint:
    """A point of a curve of minima.

    value : of the parameter
    x : (n,)
    multipliers : (n + m,), of the limits of the unknowns and then of the constraints
    sides : (n + m,), which limits are active: -1 lower, 1 upper, 2 an equality, 0 none
    values : (n + m,), x and the constraints
    cost, slope : of the value function V, and dV/dp
    negative : number of negative eigenvalues of the Hessian of L on the null space of the active gradients, 0 for a
        minimum
    tangent : (2n + m + 1,), direction of the curve in (x, multipliers, p)
    """

    value: float
    x: Array
    multipliers: Array
    sides: Array
    values: Array
    cost: float
    slope: float
    negative: int
    tangent: Array

    @cached_property
    def z(self) -> Array:
        """x, the multipliers and the parameter."""
        return np.concatenate([self.x, self.multipliers, [self.value]])

    @property
    def rates(self) -> tuple[Array, Array]:
        """The derivatives of x and of the multipliers by the parameter."""
        rates = self.tangent[:-1] / self.tangent[-1]
        return rates[: len(self.x)], rates[len(self.x) :]

    @property
    def active(self) -> tuple[int, ...]:
        """The indices of the active limits that are not equalities, of unknowns and then of constraints."""
        return tuple(np.flatnonzero(np.abs(self.sides) == 1).tolist())


class ExclusiveLimits(Exception):
    """No point near this one satisfies all limits."""


def rooms_at(point: CriticalPoint, limits: tuple[Array, Array], dual_size: float) -> Array:
    """Of each limit how far it is from changing, negative once it should have: the distance of a value to it, or the
    size of its multiplier compared with that of others."""
    values, size, (lower, upper) = point.values, point.sides * point.multipliers / dual_size, limits
    distance = np.minimum(values - lower, upper - values)
    return np.where(point.sides == EQUAL, np.inf, np.where(point.sides == FREE, distance, size))


def limits_changed(program: ParametricProgram, point: CriticalPoint, i: int, dependent: float) -> tuple[Array, Array]:
    """The active limits and the multipliers at a point after one of the limits has entered or left; raises
    `ExclusiveLimits`.

    dependent : a gradient depends on others if a smaller share of it is independent of them
    """
    sides, multipliers, (lower, upper) = point.sides.copy(), point.multipliers.copy(), program.limits
    if sides[i]:
        sides[i], multipliers[i] = FREE, 0.0
        return sides, multipliers
    sides[i] = LOWER if point.values[i] - lower[i] < upper[i] - point.values[i] else UPPER
    second = program.second(point.x, point.value, multipliers[len(point.x) :])
    shares = dependence(second, point.sides, i, dependent)
    if shares is not None:  # the gradients are dependent: a limit leaves for the one that enters
        j, size = _leaving(multipliers, point.sides, shares, sides[i])
        multipliers -= shares * size * sides[i]
        multipliers[i], multipliers[j], sides[j] = size * sides[i], 0.0, FREE
    return sides, multipliers


def dependence(second: SecondDerivatives, sides: Array, i: int, dependent: float) -> Array | None:
    """The combination (n + m,) of the active gradients that a limit's gradient is; None if it is independent."""
    n = len(second.gradient_slope)
    mine = np.eye(1, n, i)[0] if i < n else np.asarray(sparse_columns(second.jacobian)[[i - n]].todense()).ravel()
    left, combined = projected(second, sides, mine)
    if np.linalg.norm(left) > dependent * np.linalg.norm(mine):
        return None
    shares = np.zeros(len(sides))
    shares[np.flatnonzero(sides)] = combined
    return shares


def projected(second: SecondDerivatives, sides: Array, gradient: Array) -> tuple[Array, Array]:
    """What is left (n,) of a gradient besides the active gradients, and the nearest combination of these."""
    jacobian, active = sparse_columns(second.jacobian), np.flatnonzero(sides)
    n = jacobian.shape[1]
    rows = sp.vstack([sp.identity(n), jacobian]).tocsr()[active]
    if not len(active):
        return gradient, np.zeros(0)
    matrix = sp.bmat([[sp.identity(n), rows.T], [rows, None]], format="csc")
    return tuple(np.split(splu(matrix).solve(np.append(gradient, np.zeros(len(active)))), [n]))  # type: ignore


def _leaving(multipliers: Array, sides: Array, shares: Array, side: int) -> tuple[int, float]:
    """The active limit whose multiplier is the first to become 0 as that of an entering limit at this side, whose
    gradient is a combination of theirs, grows; and its size then. Raises `ExclusiveLimits` where none becomes 0."""
    falls = np.where(np.abs(sides) == 1, sides * shares * side, 0.0)
    sizes = np.where(falls > 1e-12, sides * multipliers / np.where(falls > 1e-12, falls, 1.0), np.inf)
    j = int(np.argmin(sizes))
    if not np.isfinite(sizes[j]):
        raise ExclusiveLimits
    return j, float(max(sizes[j], 0.0))
