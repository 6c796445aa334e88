"""Several curves of one machine followed together along a parameter, from solutions at one of its values to another.

Each curve takes steps of its own length along its tangent, so that it passes folds; the steps of all are corrected
together.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ..errors import FlowError, OutOfRange
from ..numerics.roots import Array
from ..shooting.single_shooting import STALLED_RATIO, Evaluation, settles
from .corrector import newton_steps
from .curve import Curve

# Lengths of steps in units of the curve, whose parameter spans 1: of the first, of one in which the curve may turn by
# any angle, as it does where a motion grazes a corner of a law, and of the shortest. An accepted step is followed by a
# longer one, another one is repeated shorter.
FIRST_JOINT_STEP, CORNER_STEP, SHORTEST_JOINT_STEP, STEP_GROWS, STEP_SHRINKS = 1.0, 1e-3, 1e-5, 2.0, 0.25
# A step is too long where Newton's method does not converge in this many steps, where it moves the point by more than
# this share of its size away from the tangent, or where the tangent turns by more than an angle with this cosine.
JOINT_NEWTON_STEPS, LARGEST_MOVE, LEAST_JOINT_COSINE = 6, 0.03, 0.9
# The first Newton step of a correction that is tried at all is no larger than this.
LARGEST_FIRST_MOVE = 0.3
# A curve is given up after this many steps, some of them repeated; smooth ones that arrive take at most 40. It has
# returned to the value where it began where it goes back there at less than this distance, and it grows beyond all
# bounds where its unknowns are larger than at first by this factor.
MOST_JOINT_STEPS, RETURNED, LARGEST_LAUNCH = 500, 1e-3, 1e4
NOWHERE, MOTION_ENDS, RETURNS, GROWS, TOO_SHORT, TOO_MANY = (
    "Newton's method does not find where it begins",
    "its motions cannot be followed",
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
    at_value, count = np.eye(us.shape[1] + 1)[-1], len(us)
    xs, tangents = np.column_stack([us, np.zeros(count)]), np.zeros((count, us.shape[1] + 1))
    furthest, arrived, ended = np.zeros(count), np.zeros(count, bool), dict[int, str]()
    steps, taken = np.full(count, FIRST_JOINT_STEP), np.full(count, -1)
    while True:
        yield WayTogether(xs, furthest, arrived, ended)
        left = np.array([i for i in order.tolist() if not arrived[i] and i not in ended], int)[:most]
        if not len(left):
            return
        if len(new := left[taken[left] < 0]):
            rows = np.tile(at_value, (len(new), 1))
            solved, xs[new], directions, failures = _back_on_curves(curve, xs[new], rows, np.zeros(len(new)))
            tangents[new] = directions / np.linalg.norm(directions / curve.size(xs[new]), axis=1)[:, None]
            taken[new] = 0
            ended |= {i: failures.get(k, NOWHERE) for k, i in enumerate(new.tolist()) if not solved[k]}
        going = np.array([i for i in left.tolist() if i not in ended], int)
        before, along, sizes = xs[going], tangents[going], curve.size(xs[going])
        rows = along / sizes**2
        levels = np.einsum("mi,mi->m", rows, before) + steps[going]
        guesses = before + along * steps[going, None]
        last = guesses[:, -1] >= 1.0
        lengths = (1.0 - before[last, -1]) / along[last, -1]
        guesses[last] = before[last] + along[last] * lengths[:, None]
        rows[last], levels[last], guesses[last, -1] = at_value, 1.0, 1.0
        solved, found, directions, failures = _back_on_curves(curve, guesses, rows, levels)
        scales = curve.size(found)
        with np.errstate(all="ignore"):
            moves = (np.abs(found - guesses) / scales).max(1)
            directions = directions / np.linalg.norm(directions / scales, axis=1)[:, None]
            cosines = np.einsum("mi,mi->m", directions / scales, along / sizes)
        straight = (np.abs(cosines) >= LEAST_JOINT_COSINE) | (steps[going] < CORNER_STEP)
        accepted = solved & (moves <= LARGEST_MOVE) & straight
        of = going[accepted]
        xs[of], tangents[of] = found[accepted], directions[accepted] * np.sign(cosines[accepted])[:, None]
        furthest[of], arrived[of] = np.maximum(furthest[of], xs[of, -1]), last[accepted]
        steps[going] *= np.where(accepted, STEP_GROWS, STEP_SHRINKS)
        taken[going] += 1
        why = {i: failures.get(k, TOO_SHORT) for k, i in enumerate(going.tolist()) if steps[i] < SHORTEST_JOINT_STEP}
        returns = (tangents[going, -1] < 0) & (xs[going, -1] < RETURNED)
        grows = np.abs(xs[going, :-1]).max(1) > LARGEST_LAUNCH * np.abs(us[going]).max(1)
        for reason, which in ((RETURNS, returns), (GROWS, grows), (TOO_MANY, taken[going] >= MOST_JOINT_STEPS)):
            why = dict.fromkeys(going[which & ~arrived[going]].tolist(), reason) | why
        ended |= why


def _back_on_curves(
    curve: Curve, guesses: Array, rows: Array, levels: Array
) -> tuple[Array, Array, Array, dict[int, str]]:
    """Which guesses (m, n + 1) Newton's method takes to the curve at levels (m,) of rows (m, n + 1), the points, the
    directions (m, n + 1) of the curve, and by index the reasons of motions that cannot be followed."""
    xs, directions, left = guesses.copy(), np.ones(guesses.shape), np.arange(len(guesses))
    last, solved, failures = np.full(len(xs), np.inf), np.zeros(len(xs), bool), dict[int, str]()
    for _ in range(JOINT_NEWTON_STEPS):
        left, evaluation = followed_motions(lambda i: curve.evaluate(xs[i]), left, failures)
        if evaluation is None:
            break
        with np.errstate(all="ignore"):
            moves, directions[left] = newton_steps(evaluation, xs[left], rows[left], levels[left])
            xs[left] += moves
            sizes = (np.abs(moves) / curve.size(xs[left])).max(1)
            settled = settles(sizes, last[left], evaluation.amplification) > 0
            shrinks = sizes < np.minimum(LARGEST_FIRST_MOVE, STALLED_RATIO * last[left])
        solved[left[settled]], last[left] = True, sizes
        positive = (xs[left][:, curve.equations.durations] > 0).all(1)
        left = left[~settled & shrinks & positive]
    return solved, xs, directions, failures


def followed_motions(
    evaluate: Callable[[Array], Evaluation], left: Array, failures: dict[int, str]
) -> tuple[Array, Evaluation | None]:
    """The points (k,) of those `left` whose motions can be followed, and the equations there; None without any. The
    reasons of the other points are added to `failures`."""
    while len(left):
        try:
            return left, evaluate(left)
        except FlowError as error:
            own = error.broken.sum() == 1 or isinstance(error, OutOfRange)
            failures |= dict.fromkeys(left[error.broken].tolist(), str(error) if own else MOTION_ENDS)
            left = left[~error.broken]
    return left, None
