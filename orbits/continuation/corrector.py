"""The corrector: Newton's method back to the curve, at one point or at many.

A point of the curve solves F(X) = 0, row . X = level, where the row says how the length along the curve is measured.
"""

from collections.abc import Sequence

import numpy as np

from ..errors import NoOrbit
from ..numerics.roots import Array
from ..periodic.single_shooting import STALLED_RATIO, Evaluation, joined, settles
from .curve import Curve, CurvePoint
from .predictor import around

# Points of the curve that the predictor uses for a step.
MEMORY = 4
# Newton steps of a corrector that converges, with some to spare.
MOST_NEWTON_STEPS = 8


def correct(curve: Curve, guess: Array, row: Array, level: float, before: Array, least: int = 1) -> CurvePoint:
    """The point of the curve where row . X = level, by at least so many of Newton's steps from `guess`; its tangent
    points onward from the tangent `before`. Raises `NoOrbit` where Newton's method does not converge at once."""
    return correct_all(curve, guess[None], row[None], np.array([level]), before[None], least=least)[0]


def correct_all(
    curve: Curve, guesses: Array, rows: Array, levels: Array, before: Array, gaps: Sequence = (), least: int = 1
) -> list[CurvePoint]:
    """`correct` of several guesses (m, n + 1), at levels (m,) of rows (m, n + 1), with tangents `before` (m, n + 1) and
    `gaps` (m,), lengths of the curve from the point before."""
    left, xs, sizes, last, solved = np.arange(len(guesses)), guesses, curve.size(guesses), np.inf, list[tuple]()
    for taken in range(1, MOST_NEWTON_STEPS + 1):
        evaluation = (curve.evaluate if taken >= least else curve.linearize)(xs)
        steps, tangents = curve.equations.newton_steps(evaluation, xs, rows[left], levels[left])
        xs, moved = xs + steps, (np.abs(steps) / sizes).max(1)
        if not np.isfinite(moved).all():
            raise NoOrbit("the corrector does not converge")
        if taken < least:
            last = moved
            continue
        settled = settles(moved, last, evaluation.amplification)
        if settled.all():
            solved.append((left, xs, tangents, steps, evaluation))
            break
        if len(done := np.flatnonzero(settled)):
            solved.append(tuple(part[done] for part in (left, xs, tangents, steps, evaluation)))
        if not (moved < STALLED_RATIO * last)[~settled].all():
            raise NoOrbit("the corrector does not converge")
        left, xs, sizes, last = (part[~settled] for part in (left, xs, sizes, moved))
    else:
        raise NoOrbit("the corrector converges too slowly")
    whole = joined([curve.equations.moved(e, x[:, :-1], curve.parameters_at(x), step) for _, x, _, step, e in solved])
    if len(solved) > 1:
        left, xs, tangents = (np.concatenate(parts) for parts in list(zip(*solved, strict=True))[:3])
        order = np.argsort(left)
        xs, tangents, whole = xs[order], tangents[order], whole[order]
    # Where the level is a value of the parameter, the point has exactly that value.
    at_value = (rows[:, -1] == 1.0) & ~rows[:, :-1].any(axis=1)
    xs[at_value, -1] = levels[at_value]
    return _points(curve, xs, tangents, whole, before, gaps)


def _points(curve: Curve, xs, tangents, evaluation: Evaluation, before, lengths=()):
    """Solved points (m, n + 1) with the directions of the curve there, turned to point onward from those `before`."""
    scaled = tangents / (sizes := curve.size(xs))
    sides = np.sign(np.einsum("mi,mi->m", scaled / sizes, before))
    with np.errstate(divide="ignore", invalid="ignore"):
        tangents = tangents / (sides * np.linalg.norm(scaled, axis=1))[:, None]
    if not np.isfinite(tangents).all():
        raise NoOrbit("the curve has no direction here")
    bordered = np.concatenate([evaluation.jacobian * sizes[:, None], (tangents / sizes)[:, None]], axis=1)
    each = zip(xs, tangents, np.linalg.det(bordered).tolist(), lengths or [0.0] * len(xs), strict=True)
    return [CurvePoint(x, t, test, evaluation, i, length) for i, (x, t, test, length) in enumerate(each)]


def predict_and_correct(
    curve: Curve, ends: Sequence[CurvePoint], length: float, value: float | None = None
) -> tuple[CurvePoint, Array, int]:
    """A step of given length from the last of some points, or of about that length to a given value of the parameter:
    its end, its prediction (n + 1,), and how many of the points that is interpolated from. Raises `NoOrbit`."""
    last = ends[-1]
    row = last.tangent / curve.size(last.x) ** 2
    level = np.array([row @ last.x + length])
    closing, target = (row, level[0]) if value is None else (np.eye(len(row))[-1], value)
    xs, tangents = np.array([point.x for point in ends]), np.array([point.tangent for point in ends])
    places = np.array([len(ends)]), MEMORY, 0, row[None], level
    (guess,), (rests,) = around(xs, tangents, *places)
    guess += last.tangent * (target - closing @ guess) / (closing @ last.tangent)
    # The second step makes the tangent, from which the next ones are predicted, as exact as the point.
    return correct(curve, guess, closing, target, last.tangent, least=2), guess, rests
