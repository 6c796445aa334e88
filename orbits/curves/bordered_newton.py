"""The corrector: Newton's method back to curves, from many places at once, closed by a border.

A point solves F(X) = 0 and row . X = level. The row measures the length along a curve, or is that of one component,
which then gets exactly this value, or is the gradient of an event.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..numerics import ROOTS, solve
from .protocol import Array, Points, Problem
from .step_options import Steps

# A Newton step that no longer shrinks is rounding below this multiple of the rounding that the problem expects.
LARGEST_ROUNDING = 4.0
# Steps above this are neither rounding nor errors of equations that are not exact.
NO_ROUNDING = 1e-6


class Border(NamedTuple):
    """The equations that close the problem's.

    rows, levels : (m, n + 1) and (m,)
    bends : (indices (k,), X (k, n + 1), evaluation) -> rows and levels there, for equations that are not linear
    """

    rows: Array
    levels: Array
    bends: Callable[[Array, Array, Any], tuple[Array, Array]] | None = None

    @classmethod
    def of_component(cls, place: int, values: Array, size: int) -> "Border":
        """A component of X, of `size` components, has these values (m,)."""
        rows = np.zeros((len(values), size))
        rows[:, place] = 1.0
        return cls(rows, values)

    def met(self, xs: Array) -> Array:
        """Copies of places (m, n + 1) that have exactly the prescribed values of components."""
        xs, ones = np.array(xs), self.rows == 1.0
        if self.bends is None and ones.any():
            i, j = np.nonzero(ones & ((self.rows != 0).sum(1) == 1)[:, None])
            xs[i, j] = self.levels[i]
        return xs


def correct(
    problem: Problem, lanes: Array, guesses: Array, border: Border, before: Array, options: Steps, *, least: int = 1,
    rough: Array | float = 0.0, reach: Array | float = np.inf, record: bool | None = None,
) -> tuple[Array, Points]:  # fmt: skip
    """The points of curves to which Newton's method leads from guesses (m, n + 1).

    before : vectors (m, n + 1); the tangents of the points have acute angles with these
    least : least number of Newton steps
    rough : Newton step (m,) below which a point is accepted; where the equations are recorded, another step follows,
        the only one from places where it is infinite
    reach : Newton step (m,) above which a correction ends without a point
    record : whether the equations are evaluated at the points; by default where the problem records them

    Returns the indices (k,), in order, of the guesses that lead to points, and these. A guess without one raises no
    error.
    """
    m, found, xs = len(guesses), None, border.met(guesses)
    record = problem.records if record is None else record
    limits = np.empty((2, m))
    limits[0], limits[1] = rough, reach
    with np.errstate(all="ignore"):
        if problem.solver and m and border.bends is None and not limits[0].any():
            found = problem.solver(lanes, xs, border.rows, border.levels, least, record)
        if found is None:
            found = _newton(problem, lanes, xs, border, limits, least, options, record)
        which, xs, directions, growths, evaluation = found
        own = some(which, m)
        return _pointed(problem, which, lanes[own], xs, directions, before[own], growths, evaluation)


def some(which: Array, count: int) -> Array | slice:
    """Different indices of points in order; those of all the points, of this number, as a slice, which makes no
    copies."""
    return which if len(which) < count else slice(None)


_Solved = tuple[Array, Array, Array, Array, Any]


def _newton(
    problem: Problem, lanes: Array, xs: Array, border: Border, limits: Array, least: int, options: Steps, record: bool
) -> _Solved:
    """The indices (k,), in order, of the places X (m, n + 1) from which Newton's method converges, the points and
    directions (k, n + 1), the amplifications (k,), and the equations if recorded; `limits` are (rough, reach) (2, m),
    `least` is the least number of steps."""
    final, m, evaluation, moved = options.last, len(xs), None, None
    sizes = problem.size(lanes, xs) if m else xs
    directions, growths, solved = np.zeros(xs.shape), np.ones(m), np.isinf(limits[0]) & record
    owners = left = (~solved).nonzero()[0]
    begun = some(left, m)
    # What belongs to the points that are left.
    own = [each[begun] for each in (lanes, xs, sizes, border.rows, border.levels, *limits, np.full(m, np.inf))]
    for taken in range(1, options.corrections + 1):
        if not len(left):
            break
        of, places, *_ = own
        able, evaluation = problem.evaluate(of, places, evaluation if problem.chords else None, moved)
        if len(able) < len(left):
            left, own = left[able], [each[able] for each in own]
        owners, (_, places, size, rows, levels, rough, reach, last) = left, own
        if evaluation is None or not len(left):
            break
        if border.bends:
            rows, levels = border.bends(left, places, evaluation)
        moves, directions[left] = newton_steps(evaluation, places, rows, levels)
        xs[left] = own[1] = places + moves
        growths[left] = grown = evaluation.amplification
        units = problem.units(size, evaluation)
        moved = (np.abs(moves) / units).max(1)
        shrinks, finite = moved < ROOTS.stalled_ratio * last, np.isfinite(moved)
        done = (moved * np.maximum(grown, 1.0) < final) | (moved < rough)
        if (stalls := ~shrinks).any():
            done |= stalls & (moved < ROOTS.small_step)
            if (stalls := stalls & ~done & (moved < NO_ROUNDING)).any():
                done |= stalls & (moved < LARGEST_ROUNDING * (problem.rounding(evaluation, rows) / units).max(1))
        done &= finite & (taken >= least)
        goes = (moved <= reach) & (shrinks | (taken < least)) & finite & ~done
        solved[left[done]] = True
        left = left[goes]
        if len(left):
            own[-1] = np.where(np.isinf(grown) & (moved < NO_ROUNDING), np.inf, moved)
            if len(left) < len(goes):
                moved, own = moved[goes], [each[goes] for each in own]
                evaluation, owners = evaluation[goes.nonzero()[0]] if problem.chords else None, left
    which = solved.nonzero()[0]
    xs = border.met(xs)
    if record and len(which):
        known = evaluation if problem.chords and np.array_equal(owners, which) else None
        return _evaluated(problem, lanes, border, (which, xs, directions, growths, known), bool(limits[0].any()))
    chosen = some(which, m)
    return which, xs[chosen], directions[chosen], growths[chosen], None


def _evaluated(problem: Problem, lanes: Array, border: Border, found: _Solved, moves_on: bool) -> _Solved:
    """The solved points of indices (k,) among X (m, n + 1) with the equations there, and with the directions there
    where the problem renews them; from rough points it moves on by another step."""
    which, xs, directions, growths, known = found
    able, evaluation = problem.evaluate(lanes[which], xs[which], known, np.zeros(len(which)))
    which = which[able]
    if (problem.renews or moves_on) and len(which) and evaluation is not known:
        bends, places = border.bends, xs[which]
        closed = bends(which, places, evaluation) if bends else (border.rows[which], border.levels[which])
        moves, directions[which] = newton_steps(evaluation, places, *closed)
        if moves_on:
            xs[which] += moves
            xs = border.met(xs)
    return which, xs[which], directions[which], growths[which], evaluation


def newton_steps(evaluation: Any, xs: Array, rows: Array, levels: Array) -> tuple[Array, Array]:
    """Newton steps (m, n + 1) from places X (m, n + 1), and directions (m, n + 1) along the curves."""
    right = np.zeros((*xs.shape, 2))
    right[:, :-1, 0], right[:, -1, 0], right[:, -1, 1] = -evaluation.residual, levels - (xs * rows).sum(1), 1.0
    matrices = np.empty((*xs.shape, xs.shape[1]))
    matrices[:, :-1], matrices[:, -1] = evaluation.jacobian, rows
    found = solve(matrices, right)
    return found[:, :, 0], found[:, :, 1]


def _pointed(
    problem: Problem, which: Array, lanes: Array, xs: Array, directions: Array, before: Array, growths: Array,
    found: Any,
) -> tuple[Array, Points]:  # fmt: skip
    """The points with tangents of length 1 that point onward, where the curve has a direction; with their indices."""
    if not len(which):
        return which, Points(lanes, xs, xs, growths, found, which)
    scaled = directions / (sizes := problem.size(lanes, xs))
    sides = np.sign((scaled / sizes * before).sum(1))
    tangents = directions / (sides * np.sqrt((scaled * scaled).sum(1)))[:, None]
    points = Points(lanes, xs, tangents, growths, found, np.arange(len(which)))
    if np.isfinite(tangents).all():
        return which, points
    sound = np.isfinite(tangents).all(1)
    return which[sound], points[sound]
