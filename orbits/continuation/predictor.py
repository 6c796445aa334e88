"""The predictor: Hermite interpolation of a curve between points with tangents, and extrapolation beyond them.

A point X of a curve lies at the level s = row . X, for a row that measures the length along the curve.
"""

from functools import lru_cache

import casadi as ca
import numpy as np

from ..symbolic.calls import MappedFunction

# A point lies beyond a bend, and is not used, where the component of its tangent along the row is less than this share
# of the component of the nearest point's tangent.
BEND = 0.3


@lru_cache(maxsize=32)
def hermite(size: int, behind: int, ahead: int) -> MappedFunction:
    """(points (size, behind + ahead) along a curve, tangents there, which of them to use, row (size,), level) -> the
    point at that level, in Lagrange's form, and the number of points used: on either side of the place between `behind`
    and `ahead`, the points that the curve passes before it turns round."""
    count = behind + ahead
    xs, tangents, row = ca.SX.sym("x", size, count), ca.SX.sym("t", size, count), ca.SX.sym("row", size)
    use, level = ca.SX.sym("use", count), ca.SX.sym("level")
    places, rates = xs.T @ row, tangents.T @ row
    used = [use[i] for i in range(count)]
    for nearest, farthest, side in ((behind - 1, -1, -1), (behind, count, 1)):
        for i in range(nearest + side, farthest, side):
            straight = rates[nearest] * rates[i] > BEND * rates[nearest] ** 2
            onward = side * rates[nearest] * (places[i] - places[i - side]) > 0
            used[i] = ca.logic_and(ca.logic_and(used[i], used[i - side]), ca.logic_and(straight, onward))
    # With differences from the first point, components that do not change along the curve stay exact.
    point = xs[:, 0]
    for i in range(count):
        weight, inverses = ca.SX(1.0), ca.SX(0.0)
        for j in (j for j in range(count) if j != i):
            inverse = 1 / (places[i] - places[j])
            weight *= ca.if_else(used[j], (level - places[j]) * inverse, 1.0) ** 2
            inverses += ca.if_else(used[j], inverse, 0.0)
        away = level - places[i]
        value = (1 - 2 * away * inverses) * (xs[:, i] - xs[:, 0]) + away / rates[i] * tangents[:, i]
        point += ca.if_else(used[i], weight * value, 0.0)
    return MappedFunction(ca.Function("hermite", [xs, tangents, use, row, level], [point, sum(used)]))


def around(
    xs: np.ndarray, tangents: np.ndarray, i: np.ndarray, behind: int, ahead: int, rows: np.ndarray, levels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points (q, n) at levels (q,) of rows (q, n) on interpolants of a chain of points (c, n) with tangents, each of up
    to `behind` points before a place i (q,) of the chain and `ahead` from there on; and the numbers (q,) of points."""
    if not len(i):
        return np.empty((0, xs.shape[1])), np.empty(0)
    indices = i[:, None] + np.arange(-behind, ahead)
    inside = (indices >= 0) & (indices < len(xs))
    within = np.minimum(np.maximum(indices, 0), len(xs) - 1)
    neighbours = (part[within].reshape(len(i), -1) for part in (xs, tangents))
    points, rests = hermite(xs.shape[1], behind, ahead)(*neighbours, inside, rows, levels[:, None])
    return points[:, :, 0], rests[:, 0, 0]
