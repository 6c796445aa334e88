"""Several curves of one machine followed together along a parameter, from solutions at one of its values to another.

Each curve takes steps of its own length along its tangent, so that it passes folds. A step is predicted on the cubic
through the last two points with their tangents, and corrected nearly; the points that arrive are solved to rounding.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..errors import FlowError
from ..numerics.roots import Array
from ..shooting.single_shooting import STALLED_RATIO, settles
from .corrector import newton_steps
from .curve import Curve

# Lengths of steps in units of the curve, whose parameter spans 1: of the first, of one in which the curve may turn by
# any angle, as it does where a motion grazes a corner of a law, of the longest and of the shortest.
FIRST_JOINT_STEP, CORNER_STEP, LONGEST_JOINT_STEP, SHORTEST_JOINT_STEP = 0.1, 1e-3, 1.0, 1e-5
# A step is too long where Newton's method does not converge in this many steps, where it moves the point by more than
# this share of its size away from the prediction, or where the tangent turns by more than an angle with this cosine.
JOINT_NEWTON_STEPS, LARGEST_MOVE, LEAST_JOINT_COSINE = 6, 0.01, 0.9
# The next step is such that it moves the point by about this share, within these ratios to the last one. After a step
# that is too long it is shorter by at least the second ratio, after one that is not solved by the first.
AIMED_MOVE, LEAST_RATIO, SHORTER_RATIO, LARGEST_RATIO = 1e-3, 0.25, 0.5, 3.0
# The first Newton step of a correction that is tried at all is no larger than the first share. On the way a point is
# known well enough after a Newton step below the second; with ten times that, steps become too short at sharp folds.
LARGEST_FIRST_MOVE, NEAR_ENOUGH = 0.3, 1e-3
# A curve is given up after this many steps, some of them repeated; those that arrive take 10, or 100 round many folds.
# It has returned to the value where it began where it goes back there at less than this distance and this share of the
# furthest value, and it grows beyond all bounds where its unknowns are larger than at first by this factor.
MOST_JOINT_STEPS, RETURNED, RETURNED_SHARE, LARGEST_LAUNCH = 500, 1e-3, 0.1, 1e4
# Newton steps to the place of a cubic where the parameter has its last value, from the secant.
STEPS_TO_LAST = 4
NOWHERE, RETURNS, GROWS, TOO_SHORT, TOO_MANY = (
    "Newton's method does not find where it begins",
    "its family folds and returns to straight springs",
    "its launch grows beyond all bounds",
    "its steps become too short",
    f"it takes more than {MOST_JOINT_STEPS} steps",
)


class WayTogether(NamedTuple):
    """How far curves (m) have come: their points (m, n + 1), the furthest values (m,) of the parameter, whether they
    have arrived (m,), and by index why others have ended."""

    xs: Array
    furthest: Array
    arrived: Array
    ended: dict[int, str]

    @property
    def share(self) -> float:
        """The share of the way that is done."""
        done = self.arrived | np.isin(np.arange(len(self.xs)), list(self.ended))
        return float(np.where(done, 1.0, self.furthest.clip(0, 1)).mean()) if len(self.xs) else 1.0


def follow_together(curve: Curve, us: Array, order: Array, most: int = 64) -> Iterator[WayTogether]:
    """The curves from solutions (m, n) at the parameter's value 0 to its value 1, after each step, until each has
    arrived or ended. At most `most` take their steps together, the next ones of an order (m,) after others."""
    lanes = _CurvesTogether(curve, us)
    while True:
        yield WayTogether(lanes.xs, lanes.furthest, lanes.arrived, lanes.ended)
        left = np.array([i for i in order.tolist() if not lanes.arrived[i] and i not in lanes.ended], int)[:most]
        if not len(left):
            return
        lanes.begin(left[lanes.taken[left] < 0])
        lanes.step(np.array([i for i in left.tolist() if i not in lanes.ended], int))


class _CurvesTogether:
    """Curves (m) on their way: their points and tangents (m, n + 1), of length 1 in units of the points' sizes, the
    same one step before, the lengths of the next steps, the numbers of steps taken, -1 before a curve has begun, and
    the rest as in `WayTogether`."""

    def __init__(self, curve: Curve, us: Array):
        self.curve, self.us, self.at_value, count = curve, us, np.eye(us.shape[1] + 1)[-1], len(us)
        self.xs = np.column_stack([us, np.zeros(count)])
        self.tangents, self.before, self.tangents_before = np.full((3, *self.xs.shape), np.nan)
        self.steps, self.taken = np.full(count, FIRST_JOINT_STEP), np.full(count, -1)
        self.furthest, self.arrived, self.ended = np.zeros(count), np.zeros(count, bool), dict[int, str]()

    def begin(self, lanes: Array) -> None:
        """Begin some curves (k,)."""
        xs, rows = self.xs[lanes], np.tile(self.at_value, (len(lanes), 1))
        solved, self.xs[lanes], directions = _near_curve(self.curve, xs, rows, np.zeros(len(lanes)))
        self.tangents[lanes] = directions / self._lengths(directions, self.xs[lanes])
        self.taken[lanes] = 0
        self.ended |= {i: self._why(self.xs[i], NOWHERE) for i in lanes[~solved].tolist()}

    def step(self, lanes: Array) -> None:
        """Take a step of some curves (k,), shorten it where it is too long, and end those that lead nowhere."""
        xs, tangents, steps, sizes = (
            self.xs[lanes],
            self.tangents[lanes],
            self.steps[lanes],
            self.curve.size(self.xs[lanes]),
        )
        rows = tangents / sizes**2
        cubics = _cubics(xs, tangents, self.before[lanes], self.tangents_before[lanes], rows)
        guesses = _on_cubics(cubics, steps[:, None])
        last = guesses[:, -1] >= 1.0
        guesses[last] = _on_cubics(cubics[:, last], _steps_to_last(cubics[:, last, -1], steps[last])[:, None])
        guesses[last, -1], rows[last] = 1.0, self.at_value
        levels = np.einsum("mi,mi->m", rows, guesses)
        solved, found, directions = _near_curve(self.curve, guesses, rows, levels, last)
        with np.errstate(all="ignore"):
            moves = (np.abs(found - guesses) / self.curve.size(found)).max(1)
            directions = directions / self._lengths(directions, found)
            cosines = np.einsum("mi,mi->m", directions / self.curve.size(found), tangents / sizes)
            ratios = np.clip((AIMED_MOVE / moves) ** (1 / 3), LEAST_RATIO, LARGEST_RATIO)
        solved &= (np.abs(cosines) >= LEAST_JOINT_COSINE) | (steps < CORNER_STEP)
        accepted = solved & (moves <= LARGEST_MOVE)
        ratios = np.where(accepted, ratios, np.where(solved, np.minimum(ratios, SHORTER_RATIO), LEAST_RATIO))
        of = lanes[accepted]
        self.before[of], self.tangents_before[of] = xs[accepted], tangents[accepted]
        self.xs[of], self.tangents[of] = found[accepted], (directions * np.sign(cosines)[:, None])[accepted]
        self.furthest[of], self.arrived[of] = np.maximum(self.furthest[of], self.xs[of, -1]), last[accepted]
        self.steps[lanes] = np.minimum(ratios * steps, LONGEST_JOINT_STEP)
        self.taken[lanes] += 1
        self._end(lanes, guesses)

    def _end(self, lanes: Array, guesses: Array) -> None:
        """End those curves (k,) that lead nowhere; the guesses (k, n + 1) are those of their last steps."""
        values, heading, furthest = self.xs[lanes, -1], self.tangents[lanes, -1], self.furthest[lanes]
        near = np.minimum(RETURNED, RETURNED_SHARE * furthest)
        grown = np.abs(self.xs[lanes, :-1]).max(1) / np.abs(self.us[lanes]).max(1)
        for reason, which in (
            (RETURNS, ((heading < 0) & (values < near)) | ((values < 0) & (furthest > RETURNED))),
            (GROWS, grown > LARGEST_LAUNCH),
            (TOO_MANY, self.taken[lanes] >= MOST_JOINT_STEPS),
        ):
            self.ended = dict.fromkeys(lanes[which & ~self.arrived[lanes]].tolist(), reason) | self.ended
        for k in np.flatnonzero(self.steps[lanes] < SHORTEST_JOINT_STEP).tolist():
            self.ended = {int(lanes[k]): self._why(guesses[k], TOO_SHORT)} | self.ended

    def _lengths(self, directions: Array, xs: Array) -> Array:
        """The lengths (m, 1) of directions (m, n + 1) in units of the sizes of points."""
        return np.linalg.norm(directions / self.curve.size(xs), axis=1, keepdims=True)

    def _why(self, x: Array, otherwise: str) -> str:
        """Why the motions at a point (n + 1,) cannot be followed; another reason where they can."""
        try:
            if np.isfinite(x).all():
                self.curve.evaluate(x[None])
        except FlowError as error:
            return str(error)
        return otherwise


def _cubics(xs: Array, tangents: Array, before: Array, tangents_before: Array, rows: Array) -> Array:
    """The coefficients (4, m, n + 1) of the cubics through two points with their tangents, the later point first, by
    the length along rows (m, n + 1); straight lines where there is no point before."""
    gaps = np.einsum("mi,mi->m", rows, xs - before)[:, None]
    slopes = tangents_before / np.einsum("mi,mi->m", rows, tangents_before)[:, None]
    first, second = (before - xs + gaps * tangents) / gaps**2, (slopes - tangents) / gaps
    bends = np.array([second + 3 * first, (second + 2 * first) / gaps])
    known = np.isfinite(bends).all(axis=(0, 2), keepdims=True)
    return np.concatenate([[xs, tangents], np.where(known, bends, 0.0)])


def _on_cubics(cubics: Array, steps: Array) -> Array:
    """The points (m, ...) of cubics (4, m, ...) after some steps."""
    return cubics[0] + steps * (cubics[1] + steps * (cubics[2] + steps * cubics[3]))


def _steps_to_last(cubics: Array, steps: Array) -> Array:
    """The steps (m,) after which cubics (4, m) of the parameter have its value 1, near steps (m,) that go beyond."""
    with np.errstate(all="ignore"):
        steps = steps * (1 - cubics[0]) / (_on_cubics(cubics, steps) - cubics[0])
        for _ in range(STEPS_TO_LAST):
            slopes = cubics[1] + steps * (2 * cubics[2] + 3 * steps * cubics[3])
            steps = steps - (_on_cubics(cubics, steps) - 1) / slopes
    return steps


def _near_curve(
    curve: Curve, guesses: Array, rows: Array, levels: Array, exact: Array | bool = False
) -> tuple[Array, Array, Array]:
    """Which guesses (m, n + 1) Newton's method takes to the curve at levels (m,) of rows (m, n + 1), to rounding where
    `exact`; the points, and the directions (m, n + 1) of the curve."""
    xs, directions, left = guesses.copy(), np.ones(guesses.shape), np.arange(len(guesses))
    exact, last, solved = np.broadcast_to(exact, len(xs)), np.full(len(xs), np.inf), np.zeros(len(xs), bool)
    for _ in range(JOINT_NEWTON_STEPS):
        which, evaluation = curve.evaluate_lanes(xs[left])
        if evaluation is None:
            break
        left = left[which]
        with np.errstate(all="ignore"):
            moves, directions[left] = newton_steps(evaluation, xs[left], rows[left], levels[left])
            xs[left] += moves
            sizes = (np.abs(moves) / curve.size(xs[left])).max(1)
            to_rounding = settles(sizes, last[left], evaluation.amplification) > 0
            settled = np.where(exact[left], to_rounding, sizes < NEAR_ENOUGH)
            shrinks = sizes < np.minimum(LARGEST_FIRST_MOVE, STALLED_RATIO * last[left])
        solved[left[settled]], last[left] = True, sizes
        left = left[~settled & shrinks]
    return solved, xs, directions
