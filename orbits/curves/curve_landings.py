"""Points of curves at exact places between neighbouring points: values of the parameter, and the first point of a
curve."""

from collections.abc import Iterable

import numpy as np

from .bordered_newton import Border, correct
from .curve_events import Segments, certified, inside, located
from .protocol import FOLD, Array, Points, Problem
from .step_options import Steps


def landings(
    problem: Problem, segment: Segments, values: Iterable[float], length: float, options: Steps
) -> list[tuple[float, Points]]:
    """The shares and the points of a segment (1) of this length at which the parameter has some values, on both sides
    of a fold. A value at an end, and one that is not found, is left out."""
    rates = np.concatenate([segment.tangents[:, -1], segment.tangents_b[:, -1]])
    lowest, highest = sorted((float(segment.a[0, -1]), float(segment.b[0, -1])))
    turns, reach = rates[0] * rates[1] < 0, float(np.abs(rates).max()) * length
    if turns:  # the farthest that the fold may lie beyond both ends
        lowest, highest = (lowest, highest + reach) if rates[0] > 0 else (lowest - reach, highest)
    values, parts, found = [value for value in values if lowest < value < highest], [(0.0, 1.0, segment)], []
    if turns and values:
        folds = located(problem, [(FOLD, 0)], segment, rates[:1, None], rates[1:, None], options)
        for share, fold in ((each.share, each.point) for each in folds if each.point):
            parts = [(0.0, share, segment._replace(b=fold.xs, tangents_b=fold.tangents))]
            parts += [(share, 1.0, segment._replace(a=fold.xs, tangents=fold.tangents))]
    for low, high, part in parts:
        a, b = sorted((float(part.a[0, -1]), float(part.b[0, -1])))
        hits = (_landing(problem, part, value, options) for value in values if a < value < b)
        found += [(low + hit[0] * (high - low), hit[1]) for hit in hits if hit]
    return found


def _landing(problem: Problem, segment: Segments, value: float, options: Steps) -> tuple[float, Points] | None:
    """The share and the point of a segment (1) with this value of the parameter, which is monotonic along the segment
    and has the value between those at its ends; None where it is not found."""
    a, b, n = segment.a[0, -1], segment.b[0, -1], segment.a.shape[1]
    guess, _ = segment.at(problem, np.array([(value - a) / (b - a)]))
    border = Border.of_component(n - 1, np.array([value]), n)
    found = correct(problem, segment.lanes, guess, border, segment.tangents, options)
    return inside(problem, segment, certified(problem, *found)[1])


def closing(problem: Problem, segment: Segments, x: Array, row: Array, options: Steps) -> tuple[float, Points] | None:
    """The share and the point at which a segment (1) passes x (n + 1,) along a row (n + 1,), where this is x again."""
    away = (x - segment.a) @ row / ((segment.b - segment.a) @ row)
    guess, _ = segment.at(problem, away)
    found = correct(problem, segment.lanes, guess, Border(row[None], row[None] @ x), segment.tangents, options)
    point = certified(problem, *found)[1]
    if not len(point) or not (np.abs(point.xs[0] - x) / problem.size(segment.lanes, x[None])[0] < options.same).all():
        return None
    return inside(problem, segment, point)
