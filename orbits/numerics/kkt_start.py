"""The first point of a curve of minima: which limits are active there, and which lead on."""

from itertools import combinations

import numpy as np

from ..errors import NoOrbit
from .kkt_limits import (
    EQUAL,
    FREE,
    LOWER,
    UPPER,
    CriticalPoint,
    ExclusiveLimits,
    dependence,
    limits_changed,
    projected,
    rooms_at,
)
from .kkt_points import LostCurve, PointsOfCurve
from .roots import Array

# A limit is reached, and a multiplier has passed 0, at this distance beyond it; within the second one both a limit and
# its multiplier may be 0 at the first point.
TOLERATED, WEAK = 1e-10, 1e-6
MOST_WEAK = 8  # limits at whose directions a first point is examined: the sets of active ones are tried in turn
# Active limits that change at the first point, and the distance by which a limit is passed there.
MOST_CHANGES_AT_START, TOLERATED_AT_START = 30, 1e-9


def first_minimum(
    points: PointsOfCurve, x: Array, multipliers: Array, start: float, way: float, sides: Array | None
) -> CriticalPoint:
    """The minimum near x (n,) and multipliers (n + m,) at the value `start` of the parameter, from where the curve is
    followed upwards or downwards, by the sign of `way`.

    sides : (n + m,) of the active limits; by default those that the multipliers show. Limits that may be active with
        multipliers 0 become so where the curve needs them

    Raises `NoOrbit` where there is no minimum nearby that can be followed.
    """
    lower, upper = points.limits
    values = np.concatenate([x, points.program.first(x, start, multipliers[points.n :]).values])
    below, above = values - lower, upper - values
    if sides is None:
        sides = np.where(multipliers < 0, LOWER, UPPER).astype(np.int8)
        room = np.where(sides == LOWER, below, above)
        sides = np.where(np.abs(multipliers) / points.dual_size > room, sides, FREE).astype(np.int8)
    sides = np.where(lower == upper, EQUAL, sides).astype(np.int8)
    sides, multipliers = _independent(points, x, multipliers, start, sides)
    weak = (np.minimum(below, above) < WEAK) & (np.abs(multipliers) < WEAK * max(points.dual_size, 1.0))
    unsure = np.flatnonzero(weak & (sides != EQUAL))[:MOST_WEAK]
    nearest = np.where(below[unsure] < above[unsure], LOWER, UPPER)
    z, along = np.concatenate([x, multipliers, [start]]), np.zeros(len(x) + len(multipliers) + 1)
    along[-1] = np.sign(way) or 1.0
    likely = [i for i in range(len(unsure)) if sides[unsure[i]]]
    choices = [likely, *(list(c) for r in range(len(unsure) + 1) for c in combinations(range(len(unsure)), r))]
    for chosen in choices:
        trial = sides.copy()
        trial[unsure] = FREE
        trial[unsure[chosen]] = nearest[chosen]
        try:
            point = _with_right_signs(points, z, trial, along)
        except (LostCurve, NoOrbit):
            continue
        if point.negative == 0 and not _leads_out(points, point, unsure, nearest):
            return point
    raise NoOrbit(
        f"no minimum that can be followed is at {start:.10g}: the second-order condition or the independence of the "
        "active limits is lost there; begin at another value, or change the limits that coincide"
    )


def _independent(
    points: PointsOfCurve, x: Array, multipliers: Array, start: float, sides: Array
) -> tuple[Array, Array]:
    """The active limits without those whose gradients depend on others' before them, and the multipliers of the others,
    which a solver shares out among all of them as it likes."""
    inequalities = np.flatnonzero(np.abs(sides) == 1).tolist()
    if not inequalities:
        return sides, multipliers
    second, independent = points.second(x, start, multipliers), np.where(sides == EQUAL, sides, FREE).astype(np.int8)
    for i in inequalities:
        if dependence(second, independent, i) is None:
            independent[i] = sides[i]
    if (independent == sides).all():
        return independent, multipliers
    gradient = points.program.first(x, start, 0 * multipliers[points.n :]).gradient
    own = np.zeros(len(multipliers))
    own[np.flatnonzero(independent)] = -projected(second, independent, gradient)[1]
    points.dual_size = points.size_of_duals(own, points.second(x, start, own))
    return independent, own


def _with_right_signs(points: PointsOfCurve, z: Array, sides: Array, along: Array) -> CriticalPoint:
    """The first point with these active limits, of which those change that are passed or have multipliers of the wrong
    sign."""
    for _ in range(MOST_CHANGES_AT_START):
        point = points.at_parameter(z, sides, z[-1], along, exact=True)
        left = rooms_at(point, points.limits, points.dual_size)
        i = int(np.argmin(left))
        if left[i] >= -TOLERATED_AT_START:
            return point
        try:
            sides, _ = limits_changed(points.program, point, i)
        except ExclusiveLimits:
            break
        z = point.z
    raise LostCurve


def _leads_out(points: PointsOfCurve, point: CriticalPoint, unsure: Array, nearest: Array) -> bool:
    """Whether a limit is passed, or a multiplier changes its sign, from a point at which both may be 0."""
    if len(unsure) == 0:
        return False
    n, second = points.n, points.second(point.x, point.value, point.multipliers)
    along, (lower, upper) = point.tangent[:n], points.limits
    rates = np.concatenate([along, second.jacobian @ along + second.values_slope * point.tangent[-1]])
    multiplier = point.multipliers[unsure] * nearest, point.tangent[n:-1][unsure] * nearest
    room = np.minimum(point.values - lower, upper - point.values)[unsure], -nearest * rates[unsure]
    active = point.sides[unsure] != FREE
    size, rate = (np.where(active, one, other) for one, other in zip(multiplier, room, strict=True))
    scale = np.where(active, points.dual_size, 1.0)
    return bool(((size < -TOLERATED * scale) | ((size < WEAK * scale) & (rate < -TOLERATED * scale))).any())
