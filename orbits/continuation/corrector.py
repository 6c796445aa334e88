"""The corrector: Newton's method back to the curve, at one point or at many.

A point of the curve solves F(X) = 0, row . X = level, where the row says how the length along the curve is measured.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import NoStep
from ..numerics.hermite import around
from ..numerics.roots import Array, solve
from ..shooting.newton_kernel import MOST_NEWTON_STEPS, Solutions
from ..shooting.single_shooting import STALLED_RATIO, Evaluation, settles
from .curve import Curve, CurvePoint, CurvePoints, StepEnd
from .curve_corners import AWAY_FROM_CORNER, CurveCorner

# The bounds of a determinant, which is a product of as many numbers as there are unknowns.
FINITE = -1e300, 1e300
# Points of the curve that the predictor uses for a step; and how far the predicted place may be from the tangent, as a
# share of the step: a curve that is farther from there turns by some 60 degrees.
MEMORY, MOST_BENT = 4, 0.5
# The amplification at points whose equations are not known well enough for a last step. A step there that is smaller
# than the second number is the error of these equations, and sets no bound on the next.
NEVER_SETTLED, STEP_OF_ERRORS = 1e300, 1e-6
# A Newton step that does not shrink is rounding if it is less than this many times its expected rounding error: along
# the springs r + d r**n up to growths of 1e14 it was at most 2.6 times as large.
LARGEST_ROUNDING = 4.0
# After a step that moves the ends of all motions by less than this share, second derivatives are those before it. The
# tangents have an error of this share, which is less than what step-size control aims at.
LARGEST_CHORD_STEP = 1e-6


def correct(curve: Curve, guess: Array, row: Array, level: float, before: Array) -> CurvePoint:
    """The point of the curve where row . X = level, by Newton's method from `guess`; its tangent points onward from the
    tangent `before`. Raises `NoStep` where Newton's method does not converge directly."""
    return correct_all(curve, guess[None], row[None], np.array([level]), before[None])[0]


def correct_all(
    curve: Curve, guesses: Array, rows: Array, levels: Array, before: Array, gaps: Any = 0.0, parts: Any = 0
) -> CurvePoints:
    """`correct` of several guesses (m, n + 1), at levels (m,) of rows (m, n + 1), with tangents `before` (m, n + 1);
    `gaps` (m,) and `parts` (m,) are their `length` and their `parts`."""
    _, xs, tangents, _, evaluation = _solutions(curve, guesses, rows, levels)
    assert evaluation is not None
    tangents = _onward(curve, xs, tangents, before)
    sizes = curve.size(xs)
    bordered = np.concatenate([evaluation.jacobian * sizes[:, None], (tangents / sizes)[:, None]], axis=1)
    others = np.arange(len(xs)), np.broadcast_to(gaps, len(xs)), np.broadcast_to(parts, len(xs))
    with np.errstate(over="ignore"):  # with many nodes, where the sign is what counts
        determinants = np.clip(np.linalg.det(bordered), *FINITE)
    return CurvePoints(xs, tangents, determinants, evaluation, *others)


def _solutions(
    curve: Curve, guesses: Array, rows: Array, levels: Array, least: int = 1, with_motions: bool = True
) -> Solutions:
    """The curve at levels (m,) of rows (m, n + 1) near guesses (m, n + 1), by at least `least` Newton steps; with the
    motions and the equations there if `with_motions`."""
    # Where the level is a value of the parameter, the point must have exactly that value.
    xs, at_value = guesses.copy(), (rows[:, -1] == 1.0) & ~rows[:, :-1].any(axis=1)
    xs[at_value, -1] = levels[at_value]
    if kernel := curve.kernel:
        found = kernel(xs, rows, levels, curve.size(xs), curve.parameters_at(xs), least, with_motions)
        if len(found.which) == len(xs):
            return found
    return _solve_step_by_step(curve, xs, rows, levels, least, with_motions)


def _solve_step_by_step(
    curve: Curve, xs: Array, rows: Array, levels: Array, least: int, with_motions: bool
) -> Solutions:
    """`_solutions` by one Newton step at a time, for motions of any kind; raises the errors of the motions."""
    sizes, last = curve.size(xs), np.full(len(xs), np.inf)
    moved, evaluation = last, curve.evaluate(xs)
    for taken in range(1, MOST_NEWTON_STEPS + 1):
        if taken > 1:
            near = (moved * evaluation.amplification < LARGEST_CHORD_STEP).all()
            evaluation = curve.evaluate_beside(xs, evaluation) if near else curve.evaluate(xs)
        steps, directions = newton_steps(evaluation, xs, rows, levels)
        units = curve.units_of_changes(sizes, evaluation)
        xs, moved = xs + steps, (np.abs(steps) / units).max(1)
        settled, shrinks = settles(moved, last, evaluation.amplification), moved < STALLED_RATIO * last
        if not (settled | shrinks).all() and (moved < STEP_OF_ERRORS).all():
            settled |= moved < LARGEST_ROUNDING * (curve.rounding_of_steps(evaluation, rows) / units).max(1)
        if taken >= least and settled.all():
            evaluation = curve.evaluate_exactly(xs, evaluation) if with_motions else evaluation
            solved = np.arange(len(xs)), xs, directions, evaluation.amplification
            return Solutions(*solved, evaluation if with_motions else None)
        if not (np.isfinite(moved) & (settled | shrinks | (taken < least))).all():
            raise NoStep("the corrector does not converge")
        inexact = (evaluation.amplification >= NEVER_SETTLED) & (moved < STEP_OF_ERRORS)
        last = np.where(inexact, np.inf, moved)
    raise NoStep("the corrector converges too slowly")


def newton_steps(evaluation: Evaluation, xs: Array, rows: Array, levels: Array) -> tuple[Array, Array]:
    """Newton steps (m, n + 1) from points (m, n + 1), where the equations are the `evaluation`, to levels (m,) of rows
    (m, n + 1), and the directions (m, n + 1) of the curve."""
    right = np.zeros((*xs.shape, 2))
    right[:, :-1, 0], right[:, -1, 0] = -evaluation.residual, levels - np.einsum("mi,mi->m", xs, rows)
    right[:, -1, 1] = 1.0
    found = solve(np.concatenate([evaluation.jacobian, rows[:, None]], axis=1), right)
    return found[:, :, 0], found[:, :, 1]


def _onward(curve: Curve, xs: Array, directions: Array, before: Array) -> Array:
    """Directions (m, n + 1) of the curve as tangents of length 1, oriented onward from the tangents `before`."""
    scaled = directions / (sizes := curve.size(xs))
    sides = np.sign(np.einsum("mi,mi->m", scaled / sizes, before))
    with np.errstate(divide="ignore", invalid="ignore"):
        tangents = directions / (sides * np.linalg.norm(scaled, axis=1))[:, None]
    if not np.isfinite(tangents).all():
        raise NoStep("the curve has no direction here")
    return tangents


def predict_and_correct(
    curve: Curve, ends: Sequence[CurvePoint | StepEnd], length: float, to: float | CurveCorner | None = None
) -> tuple[StepEnd, Array, int]:
    """A step of length `length` from the last of some points, or of about that length `to` a value of the parameter or
    to just before a corner: its end, its prediction (n + 1,), and the number of points that the predictor uses. Raises
    `NoStep`."""
    last = ends[-1]
    row = last.tangent / curve.size(last.x) ** 2
    level = np.array([row @ last.x + length])
    xs, tangents = np.array([point.x for point in ends]), np.array([point.tangent for point in ends])
    tangents = curve.steady(xs, tangents)
    places = np.array([len(ends)]), MEMORY, 0, row[None], level
    (guess,), (rests,) = around(xs, tangents, *places)
    straight = last.x + length * last.tangent
    if not np.linalg.norm((guess - straight) / curve.size(last.x)) <= MOST_BENT * length:
        raise NoStep(f"the points before do not predict the curve over a step of {length:.1e}")
    if isinstance(to, CurveCorner):
        closing, target = to.border(guess, -AWAY_FROM_CORNER)
    else:
        closing, target = (row, float(level[0])) if to is None else (np.eye(len(row))[-1], to)
    guess += last.tangent * (target - closing @ guess) / (closing @ last.tangent)
    found = _end_of_step(curve, guess, closing, target, last.tangent)
    steps = MOST_NEWTON_STEPS
    while isinstance(to, CurveCorner) and steps:  # the place of lift-off bends along the curve
        closing, target = to.border(found.x, -AWAY_FROM_CORNER)
        if abs(target - closing @ found.x) < 0.5 * AWAY_FROM_CORNER * abs(to.rate):
            break
        found, steps = _end_of_step(curve, found.x, closing, target, last.tangent), steps - 1
    return found, guess, rests


def _end_of_step(curve: Curve, guess: Array, closing: Array, target: float, before: Array) -> StepEnd:
    """The curve near a guess (n + 1,) at a level of a row (n + 1,), with a tangent onward from `before` (n + 1,)."""
    # The second Newton step makes the tangent, from which the next points are predicted, as exact as the point.
    targets = closing[None], np.array([target])
    _, xs, directions, growths, _ = _solutions(curve, guess[None], *targets, least=2, with_motions=False)
    (tangent,) = _onward(curve, xs, directions, before[None])
    return StepEnd(xs[0], tangent, float(growths[0]), closing)
