"""Hermite interpolation of a curve between points with tangents, and extrapolation beyond them.

A point X of a curve lies at the level s = row . X, for a row that measures the length along the curve.
"""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from ..symbolic import BufferedFunction, ElementwiseFunction

# A point lies beyond a bend, and is not used, where the component of its tangent along the row is less than this share
# of the component of the nearest point's tangent.
BEND = 0.3


def through(
    xs: np.ndarray, tangents: np.ndarray, use: np.ndarray, ahead: int, rows: np.ndarray, levels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points (q, n) at levels (q,) of rows (q, n) on interpolants of neighbours (q, c, n) with tangents (q, c, n).

    use : which neighbours are used (q, c); the nearest one on either side always is
    ahead : number of neighbours beyond the place of the level; those before it stand first

    Returns also the numbers (q,) of neighbours that are used: those before a bend of the curve.
    """
    along, rates = (np.matmul(part, rows[:, :, None])[:, :, 0] for part in (xs, tangents))
    of_points, of_tangents, used = _weights_of_places(xs.shape[1] - ahead, ahead)(along, rates, use, levels[:, None])
    # With differences from the first point, components that do not change along the curve stay exact.
    moved = np.matmul(of_points[:, None], xs - xs[:, :1]) + np.matmul(of_tangents[:, None], tangents)
    return xs[:, 0] + moved[:, 0], used[:, 0]


@lru_cache(maxsize=32)
def _weights_of_places(behind: int, ahead: int) -> ElementwiseFunction:
    """`_weights` of many places; one function serves curves of all numbers of unknowns."""
    return ElementwiseFunction(_weights(behind, ahead))


@lru_cache(maxsize=32)
def _weights(behind: int, ahead: int) -> ca.Function:
    """(levels of points (behind + ahead), components of their tangents along the row, which of them to use, level) ->
    the weights of points and of tangents, in Lagrange's form, and the number of points used: on either side of the
    place between `behind` and `ahead`, the points that the curve passes before it turns round."""
    count = behind + ahead
    places, rates, use, level = symbols = [ca.SX.sym("s", size) for size in (count, count, count, 1)]
    used = [use[i] for i in range(count)]
    for nearest, farthest, side in ((behind - 1, -1, -1), (behind, count, 1)):
        for i in range(nearest + side, farthest, side):
            straight = rates[nearest] * rates[i] > BEND * rates[nearest] ** 2
            onward = side * rates[nearest] * (places[i] - places[i - side]) > 0
            used[i] = ca.logic_and(ca.logic_and(used[i], used[i - side]), ca.logic_and(straight, onward))
    of_points, of_tangents = [], []
    for i in range(count):
        weight, inverses = ca.SX(1.0), ca.SX(0.0)
        for j in (j for j in range(count) if j != i):
            inverse = 1 / (places[i] - places[j])
            weight *= ca.if_else(used[j], (level - places[j]) * inverse, 1.0) ** 2
            inverses += ca.if_else(used[j], inverse, 0.0)
        away = level - places[i]
        of_points.append(ca.if_else(used[i], weight * (1 - 2 * away * inverses), 0.0))
        of_tangents.append(ca.if_else(used[i], weight * away / rates[i], 0.0))
    return ca.Function("weights", symbols, [ca.vertcat(*of_points), ca.vertcat(*of_tangents), sum(used)])


def slopes(places: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The derivatives (n,) at the first of some places (k,) of the polynomials through values (k, n) there."""
    away, own = places[0] - places[1:], places[1:]
    # Those of Lagrange's polynomials of the other places; that of the place itself has their sum with the other sign.
    weights = [np.prod(np.delete(away, j)) / np.prod(np.delete(own[j] - own, j)) for j in range(len(own))]
    return -(np.array(weights) / away) @ (values[1:] - values[0])


def at_level(xs: Sequence[np.ndarray], tangents: Sequence[np.ndarray], column: int, level: float) -> np.ndarray:
    """The point at a level of one coordinate on the interpolant of a few points (n,) of a curve, in order, with
    tangents along which the coordinate goes the same way."""
    places, rates = (np.array([each[column] for each in part]) for part in (xs, tangents))
    of_points, of_tangents, _ = _weights_of_chain(len(xs))(places, np.sign(rates), np.ones(len(xs)), level)
    moved = sum((weight * (x - xs[0]) for x, weight in zip(xs, of_points.flat, strict=True)), 0.0 * xs[0])
    chain = zip(tangents, abs(rates), of_tangents.flat, strict=True)
    return xs[0] + moved + sum((weight * (tangent / rate) for tangent, rate, weight in chain), 0.0 * xs[0])


@lru_cache(maxsize=16)
def _weights_of_chain(count: int) -> BufferedFunction:
    """`_weights` of points before a place."""
    return BufferedFunction(_weights(count, 0))
