"""The first point of a curve of minima: which limits are active there, and which lead on."""

from itertools import combinations

import numpy as np

from ..errors import NoOrbit
from ..numerics import Array
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


def first_minimum(points: PointsOfCurve, x: Array, multipliers: Array, start: float, way: float) -> CriticalPoint:
    """The minimum near x (n,) and multipliers (n + m,) at the value `start` of the parameter, from where the curve is
    followed upwards or downwards, by the sign of `way`.

    Raises `NoOrbit` where there is no minimum nearby that can be followed.
    """
    (lower, upper), options = points.limits, points.options
    values = np.concatenate([x, points.program.first(x, start, multipliers[points.n :]).values])
    below, above = values - lower, upper - values
    sides = np.where(multipliers < 0, LOWER, UPPER)
    sides = np.where(np.abs(multipliers) / points.dual_size > np.where(sides == LOWER, below, above), sides, FREE)
    sides = np.where(lower == upper, EQUAL, sides).astype(np.int8)
    sides, multipliers = _independent(points, x, multipliers, start, sides)
    weak = np.abs(multipliers) < options.weak * max(points.dual_size, 1.0)
    weak &= np.minimum(below, above) < options.weak
    unsure = np.flatnonzero(weak & (sides != EQUAL))[: options.most_weak]
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
        f"there is no minimum to follow at {start:.10g}: the second-order condition or the independence of the "
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
        if dependence(second, independent, i, points.options.dependent) is None:
            independent[i] = sides[i]
    if (independent == sides).all():
        return independent, multipliers
    gradient = points.program.first(x, start, 0 * multipliers[points.n :]).gradient
    own = np.zeros(len(multipliers))
    own[np.flatnonzero(independent)] = -projected(second, independent, gradient)[1]
    points.dual_size = points.size_of_duals(own, points.second(x, start, own))
    return independent, own


def _with_right_signs(points: PointsOfCurve, z: Array, sides: Array, along: Array) -> CriticalPoint:
    """The first point with these active limits, except that limits change if they are passed or have multipliers of the
    wrong sign."""
    options = points.options
    for _ in range(options.changes_at_start):
        point = points.at_parameter(z, sides, z[-1], along)
        left = rooms_at(point, points.limits, points.dual_size)
        i = int(np.argmin(left))
        if left[i] >= -options.tolerated_at_start:
            return point
        try:
            sides, _ = limits_changed(points.program, point, i, options.dependent)
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
    least, weak = -points.options.tolerated * scale, points.options.weak * scale
    return bool(((size < least) | ((size < weak) & (rate < least))).any())
