"""Points of curves at exact places between neighbouring points: values of the parameter, and the first point of a
curve."""

from collections.abc import Iterable

import numpy as np

from .bordered_newton import Border
from .curve_events import Segments, certified, inside, located, solved_at
from .protocol import FOLD, Array, Points, Problem, Test
from .step_options import Steps


def landings(
    problem: Problem, segment: Segments, values: Iterable[float], length: float, options: Steps
) -> tuple[list[tuple[float, Points]], float | None]:
    """The shares and the points of a segment (1) of this length at which the parameter has some values, on both sides
    of a fold, without values at the ends; and the first value that is passed and not found, None without one."""
    rates = np.concatenate([segment.tangents[:, -1], segment.tangents_b[:, -1]])
    lowest, highest = sorted((float(segment.a[0, -1]), float(segment.b[0, -1])))
    turns, reach = rates[0] * rates[1] < 0, float(np.abs(rates).max()) * length
    if turns:  # the farthest that the fold may lie beyond both ends
        lowest, highest = (lowest, highest + reach) if rates[0] > 0 else (lowest - reach, highest)
    values, parts = [value for value in values if lowest < value < highest], [(0.0, 1.0, segment)]
    found = list[tuple[float, Points]]()
    if turns and values:
        folds = located(problem, [(FOLD, 0)], segment, rates[:1, None], rates[1:, None], options)
        for share, fold in ((each.share, each.point) for each in folds if each.point):
            parts = [(0.0, share, segment._replace(b=fold.xs, tangents_b=fold.tangents))]
            parts += [(share, 1.0, segment._replace(a=fold.xs, tangents=fold.tangents))]
    for low, high, part in parts:
        a, b = sorted((float(part.a[0, -1]), float(part.b[0, -1])))
        for value in (value for value in values if a < value < b):
            if (hit := _landing(problem, part, value, options)) is None:
                return found, value
            found.append((low + hit[0] * (high - low), hit[1]))
    return found, None


def _landing(problem: Problem, segment: Segments, value: float, options: Steps) -> tuple[float, Points] | None:
    """The share and the point of a segment (1) with this value of the parameter, which is monotonic along the segment
    and has the value between those at its ends; None where it is not found."""
    a, b, n = segment.a[0, -1], segment.b[0, -1], segment.a.shape[1]
    guess, _ = segment.at(problem, np.array([(value - a) / (b - a)]))
    border = Border.of_component(n - 1, np.array([value]), n)
    point = solved_at(problem, segment.lanes, guess, border, segment.tangents, options)
    if hit := inside(problem, segment, point):
        return hit
    # Beside a fold the value does not determine the point, but its share of the chord does.
    away = Test("value", lambda _, points: points.values - value, bare=True)
    ends = np.array([[a - value]]), np.array([[b - value]])
    for each in located(problem, [(away, 0)], segment, *ends, options):
        if each.point is not None:
            xs = each.point.xs.copy()
            xs[:, -1] = value
            _, point = certified(problem, np.zeros(1, int), each.point.having(xs=xs))
            return (each.share, point) if len(point) else None
    return None


def closing(problem: Problem, segment: Segments, x: Array, row: Array, options: Steps) -> tuple[float, Points] | None:
    """The share and the point at which a segment (1) passes the shared components x (k,) of the first point along a row
    (k,), where this is that point again."""
    shared, whole = problem.shared, np.zeros(segment.a.shape)
    whole[:, shared] = row
    away = (x - segment.a[:, shared]) @ row / ((segment.b - segment.a)[:, shared] @ row)
    guess, _ = segment.at(problem, away)
    border = Border(whole, row[None] @ x)
    point = solved_at(problem, segment.lanes, guess, border, segment.tangents, options)
    if not len(point):
        return None
    away_from_it = np.abs(point.xs[0, shared] - x) / problem.size(segment.lanes, point.xs)[0, shared]
    return inside(problem, segment, point) if (away_from_it < options.same).all() else None
