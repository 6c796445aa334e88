"""A curve between and beyond its known points: the polynomials through these that touch the curve there.

A point X of a curve lies at the level s = row . X, for a row that measures the way along the curve.
"""

from functools import lru_cache

import casadi as ca
import numpy as np

from ..symbolic.calls import MappedFunction

# A point whose tangent goes by less of this share along the row than that of the nearest is past a bend.
BEND = 0.3


@lru_cache(maxsize=32)
def hermite(size: int, behind: int, ahead: int) -> ca.Function:
    """(points (size, behind + ahead) along a curve, tangents there, which of them count, row (size,), level) -> the
    point at that level, in Lagrange's form, and the number of those that it rests on: as many on either side of the
    place between `behind` and `ahead` as the curve passes without turning round."""
    count = behind + ahead
    xs, tangents, row = ca.SX.sym("x", size, count), ca.SX.sym("t", size, count), ca.SX.sym("row", size)
    counts, level = ca.SX.sym("counts", count), ca.SX.sym("level")
    places, rates = xs.T @ row, tangents.T @ row
    known = [counts[i] for i in range(count)]
    for nearest, farthest, side in ((behind - 1, -1, -1), (behind, count, 1)):
        for i in range(nearest + side, farthest, side):
            straight = rates[nearest] * rates[i] > BEND * rates[nearest] ** 2
            onward = side * rates[nearest] * (places[i] - places[i - side]) > 0
            known[i] = ca.logic_and(ca.logic_and(known[i], known[i - side]), ca.logic_and(straight, onward))
    point = xs[:, 0]  # what does not change along the curve stays as it is
    for i in range(count):
        weight, inverses = 1.0, 0.0
        for j in (j for j in range(count) if j != i):
            inverse = 1 / (places[i] - places[j])
            weight *= ca.if_else(known[j], (level - places[j]) * inverse, 1.0) ** 2
            inverses += ca.if_else(known[j], inverse, 0.0)
        away = level - places[i]
        value = (1 - 2 * away * inverses) * (xs[:, i] - xs[:, 0]) + away / rates[i] * tangents[:, i]
        point += ca.if_else(known[i], weight * value, 0.0)
    return ca.Function("hermite", [xs, tangents, counts, row, level], [point, sum(known)])


@lru_cache(maxsize=32)
def _several(size: int, behind: int, ahead: int) -> MappedFunction:
    return MappedFunction(hermite(size, behind, ahead))


def around(xs, tangents, i, behind: int, ahead: int, rows, levels) -> tuple[np.ndarray, np.ndarray]:
    """Points (q, n) at levels (q,) of rows (q, n) on the polynomials through up to `behind` points of a chain (c, n),
    with its `tangents`, before its places i (q,), and `ahead` from there on; and how many (q,) each rests on."""
    indices = i[:, None] + np.arange(-behind, ahead)
    inside = (indices >= 0) & (indices < len(xs))
    indices = np.clip(indices, 0, len(xs) - 1)
    known = (part[indices].reshape(len(i), -1) for part in (xs, tangents))
    points, rests = _several(xs.shape[1], behind, ahead)(*known, inside, rows, levels[:, None])
    return points[:, :, 0], rests[:, 0, 0]
