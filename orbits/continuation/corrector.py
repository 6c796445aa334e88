"""The corrector: Newton's method back to the curve, at one point or at many.

A point of the curve solves F(X) = 0, row . X = level, where the row says how the length along the curve is measured.
The `counts` of Taylor steps that suffice at one point are tried first at its neighbours.
"""

from collections.abc import Sequence

import numpy as np

from ..errors import NoOrbit
from ..numerics.roots import Array
from ..periodic.single_shooting import STALLED_RATIO, Evaluation, settles
from ..symbolic.calls import room_for
from .curve import Curve, CurvePoint
from .predictor import around

# Motions of more Taylor steps are evaluated one by one: to build a function of so many takes longer than it saves.
MOST_STEPS = 512
# A neighbour is given this many Taylor steps more, and where these do not suffice, once more by this factor.
SPARE_STEPS, MORE = 1, 1.5
# Points of the curve that the predictor uses for a step.
MEMORY = 4
# Newton steps of a corrector that converges, with some to spare.
MOST_NEWTON_STEPS = 8

Counts = tuple[int, ...] | None


def newton_steps(curve: Curve, xs: Array, rows: Array, targets: Array, counts: Counts = None) -> tuple:
    """Newton steps, directions and evaluation as `Shooting.newton_steps`, and numbers of Taylor steps to try at the
    next points; those of `counts` are tried at all points in one call, None evaluates motions one by one."""
    ps, left, retry = curve.parameters_at(xs), np.arange(len(xs)), True
    found: list = []
    while len(left):
        points = xs[left], ps[left], rows[left], targets[left]
        if counts and curve.batch:
            *results, enough, _ = curve.batch.newton_steps(counts, *points)
            if not enough.all():
                counts, retry = _room(curve, [MORE * count for count in counts]) if retry else None, False
        else:
            evaluation, enough = curve.evaluate(xs[left]), np.ones(len(left), bool)
            results = [*curve.equations.newton_steps(curve.along, evaluation, *points)]
            counts = _room(curve, [motions.counts.max() + SPARE_STEPS for motions in evaluation.trajectories])
        if found:
            found[0][left], found[1][left], found[2] = results[0], results[1], found[2].replaced(left, results[2])
        found, left = found or results, left[~enough]
    return *found, counts


def _room(curve: Curve, counts) -> Counts:
    """Numbers of Taylor steps rounded up, since a function is built for each; None where it is not worth building."""
    counts = tuple(room_for(int(count)) for count in counts)
    return counts if curve.batch and max(counts) <= MOST_STEPS else None


def larger_counts(a: Counts, b: Counts) -> Counts:
    """Numbers of Taylor steps that suffice at both of two points."""
    return tuple(map(max, a, b)) if a and b else None


def correct(curve: Curve, guess: Array, row: Array, level: float, before: Array, counts: Counts = None) -> CurvePoint:
    """The point of the curve where row . X = level, by Newton's method from `guess`; its tangent points onward from the
    tangent `before`. Raises `NoOrbit` where Newton's method does not converge at once."""
    return correct_all(curve, guess[None], row[None], np.array([level]), before[None], counts)[0]


def correct_all(
    curve: Curve, guesses: Array, rows: Array, levels: Array, before: Array, counts: Counts = None, gaps: Sequence = ()
) -> list[CurvePoint]:
    """`correct` of several guesses (m, n + 1), at levels (m,) of rows (m, n + 1), with tangents `before` (m, n + 1) and
    `gaps` (m,), lengths of the curve from the point before."""
    xs, sizes, whole = guesses.copy(), curve.size(guesses), None
    left, last, tangents = np.arange(len(xs)), np.full(len(xs), np.inf), np.empty_like(xs)
    for _ in range(MOST_NEWTON_STEPS):
        steps, tangents[left], evaluation, counts = newton_steps(curve, xs[left], rows[left], levels[left], counts)
        whole = whole.replaced(left, evaluation) if whole else evaluation
        xs[left] += steps
        moved = np.max(np.abs(steps) / sizes[left], axis=1)
        unsettled = ~settles(moved, last[left], evaluation.amplification)
        if not unsettled.any():
            break
        if not (moved < STALLED_RATIO * last[left])[unsettled].all():
            raise NoOrbit("the corrector does not converge")
        last[left] = moved
        left = left[unsettled]
    else:
        raise NoOrbit("the corrector converges too slowly")
    # Where the level is a value of the parameter, the point has exactly that value.
    at_value = (rows[:, -1] == 1.0) & ~rows[:, :-1].any(axis=1)
    xs[at_value, -1] = levels[at_value]
    return _points(curve, xs, tangents, whole, before, counts, gaps)


def _points(curve: Curve, xs, tangents, evaluation: Evaluation, before, counts: Counts, lengths=()):
    """Solved points (m, n + 1) with the directions of the curve there, turned to point onward from those `before`."""
    scaled = tangents / (sizes := curve.size(xs))
    sides = np.sign(np.einsum("mi,mi->m", scaled / sizes, before))
    with np.errstate(divide="ignore", invalid="ignore"):
        tangents = tangents / (sides * np.linalg.norm(scaled, axis=1))[:, None]
    if not np.isfinite(tangents).all():
        raise NoOrbit("the curve has no direction here")
    bordered = np.concatenate([evaluation.jacobian * sizes[:, None], (tangents / sizes)[:, None]], axis=1)
    each = zip(xs, tangents, np.linalg.det(bordered).tolist(), lengths or [0.0] * len(xs), strict=True)
    return [CurvePoint(x, t, test, evaluation, i, counts, length) for i, (x, t, test, length) in enumerate(each)]


def predict_and_correct(
    curve: Curve, ends: Sequence[CurvePoint], length: float, value: float | None = None
) -> tuple[CurvePoint, Array, int]:
    """A step of given length from the last of some points, or of about that length to a given value of the parameter:
    its end, its prediction (n + 1,), and how many of the points that is interpolated from. Raises `NoOrbit`."""
    last, missing, size = ends[-1], MEMORY - len(ends), curve.size(ends[-1].x)
    row = last.tangent / size**2
    level = np.array([row @ last.x + length])
    closing, target = (row, level[0]) if value is None else (np.eye(len(row))[-1], value)
    padded = [*[ends[0]] * missing, *ends]
    xs, tangents = np.array([point.x for point in padded]), np.array([point.tangent for point in padded])
    if enough := (counts := last.counts) and _room(curve, [count + SPARE_STEPS for count in counts]):
        points, p = (xs, tangents, np.arange(MEMORY) >= missing, row, level), curve.parameters_at(xs[-1:])
        if curve.batch and (found := curve.batch.step(enough, *points, closing, target, size, p)):
            guess, x, tangent, evaluation, used, (rests, before, moved) = found
            counts = _room(curve, [count[0] for count in used])
            if not settles(moved, before, float(evaluation.amplification[0])):
                return correct(curve, x, closing, target, last.tangent, counts), guess, rests
            if value is not None:
                x[-1] = value
            (end,) = _points(curve, x[None], tangent[None], evaluation, last.tangent[None], counts)
            return end, guess, rests
        counts = _room(curve, [MORE * count for count in enough])
    places = np.array([MEMORY - missing]), MEMORY, 0, row[None], level
    (guess,), (rests,) = around(xs[missing:], tangents[missing:], *places)
    guess += last.tangent * (target - closing @ guess) / (closing @ last.tangent)
    return correct(curve, guess, closing, target, last.tangent, counts), guess, rests
