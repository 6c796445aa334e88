"""Several curves of one machine, followed together along a parameter from one value to another.

Each curve takes steps of its own length along its tangent, so that it passes folds. On the way the points are solved
nearly; the points that arrive are solved to rounding.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..curves import ASKS, Border, End, Event, Points, Problem, Run, Start, Steps, Test, correct
from ..errors import FlowError
from ..numerics import Array
from .curve import Curve

# With rougher points on the way, steps become too short at sharp folds. A curve that arrives takes 10 steps, or 100
# round many folds.
STEPS_TO_LAWS = Steps(
    first=0.1, longest=1.0, shortest=5e-5, apart=np.inf, batch=1, memory=2, most=500,
    aim=2e-3, safety=1.0, shorten=0.25, lengthen=3.0, shorter=0.25,
    corrected=np.inf, moved=0.01, turned=float(np.arccos(0.9)), bent=np.inf, corrections=6, least=1, rough=1e-3,
)  # fmt: skip


class EndsOfWays(NamedTuple):
    """When a curve ends on its way to the value 1."""

    # It has returned to the value where it began where it goes back there at less than this value and this share of the
    # furthest one.
    returned: float = 1e-3
    returned_share: float = 0.1
    largest: float = 1e4  # factor by which the unknowns of a curve are larger than at first that grows without bounds
    across_corner: float = 1e-3  # distance of a point behind a corner from the last one before it


ENDS = EndsOfWays()
NOWHERE, RETURNS, GROWS, TOO_SHORT, TOO_MANY = (
    "Newton's method does not find its first point",
    "its family folds and returns to straight springs",
    "its launch speed grows without bound",
    "its steps become too short",
    f"it takes more than {STEPS_TO_LAWS.most} steps",
)


class WayTogether(NamedTuple):
    """How far curves (m) have come: their points (m, n + 1), the furthest values (m,) of the parameter, whether they
    have arrived (m,), and by index how others have ended."""

    xs: Array
    furthest: Array
    arrived: Array
    ended: dict[int, End]

    @property
    def share(self) -> float:
        """The share of the way that is done."""
        done = self.arrived | np.isin(np.arange(len(self.xs)), list(self.ended))
        return float(np.where(done, 1.0, self.furthest.clip(0, 1)).mean()) if len(self.xs) else 1.0


def follow_together(curve: Curve, us: Array, order: Array, most: int = 256) -> Iterator[WayTogether]:
    """The curves from solutions (m, n) at the parameter's value 0 to its value 1, after each step, until each has
    arrived or ended. At most `most` take their steps together, the next ones of an order (m,) after others."""
    count = len(us)
    way = WayTogether(np.column_stack([us, np.zeros(count)]), np.zeros(count), np.zeros(count, bool), {})
    problem = Lanes(curve, ENDS.largest * np.abs(us).max(1), way.furthest)
    yield way
    for lanes in np.split(order, range(most, count, most)):
        for item in _followed_lanes(problem, way.xs, np.sort(lanes)):
            if isinstance(item, Points):
                way.xs[item.lanes] = item.xs
                np.maximum.at(way.furthest, item.lanes, item.values)
            elif isinstance(item, End) and item.kind == "reached":
                way.arrived[item.lane] = True
            elif isinstance(item, End):
                way.ended[item.lane] = End("stopped", TOO_MANY) if item.kind == "stopped" else item
            yield way


def _followed_lanes(problem: "Lanes", xs: Array, lanes: Array) -> Iterator[Points | Event | End]:
    """The items of some lanes (k,) of a problem, which begin near points (m, n + 1)."""
    first, onward = xs[lanes], np.tile(np.eye(xs.shape[1])[-1], (len(lanes), 1))
    border = Border(onward, first[:, -1])
    solved, points = correct(
        problem, lanes, first, border, onward, STEPS_TO_LAWS, rough=STEPS_TO_LAWS.rough, record=False
    )
    yield from (problem.stuck(i, xs[i], NOWHERE) for i in np.delete(lanes, solved).tolist())
    if len(solved):
        first_points = points.having(lengths=np.zeros(len(solved)))
        yield from Run(problem, first_points, 1.0, behind=-np.inf, options=STEPS_TO_LAWS)


class Lanes(Problem):
    """The lanes (m,) of a curve, each followed as far as its unknowns are below some number (m,); the follower updates
    the furthest values (m,) of the parameter."""

    records = False  # points have no certificates

    def __init__(self, curve: Curve, most: Array, furthest: Array):
        self.curve, self.most, self.furthest = curve, most, furthest
        self.tests = (
            Test("fold", lambda _, points: self.left(points), ASKS),
            Test("escaped", lambda _, points: most[points.lanes] - np.abs(points.xs[:, :-1]).max(1), ASKS),
        )

    def left(self, points: Points) -> Array:
        """The distance of points (m,) from where their curves return to; infinite on the way onward."""
        near = np.minimum(ENDS.returned, ENDS.returned_share * self.furthest[points.lanes])
        return np.where(points.tangents[:, -1] < 0, points.values - near, np.inf)

    def evaluate(self, lanes: Array, xs: Array, known: Any = None, moved: Array | None = None) -> tuple[Array, Any]:
        return self.curve.evaluate_lanes(xs)

    def size(self, lanes: Array, xs: Array) -> Array:
        return self.curve.size(xs)

    def rounding(self, evaluation: Any, rows: Array) -> Array:
        return self.curve.rounding_of_steps(evaluation, rows)

    def changed(self, event: Event, passed: Sequence[Points]) -> End:
        return End(event.kind, RETURNS if event.kind == "fold" else GROWS)

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> Start | End:
        """Behind a corner, where a motion grazes one of a law, the curve continues at any angle."""
        last, lanes = passed[-1][-1:], np.array([lane])
        ahead, row = last.xs + ENDS.across_corner * last.tangents, last.tangents / self.size(lanes, last.xs) ** 2
        border = Border(row, np.einsum("mi,mi->m", row, ahead))
        _, behind = correct(self, lanes, ahead, border, last.tangents, STEPS_TO_LAWS, record=False)
        # A curve that has taken no step since its beginning or the last corner is lost.
        if len(behind) and last.lengths is not None and last.lengths[0] > 0:
            return Start(self, behind.xs[0], behind.tangents[0])
        return self.stuck(lane, ahead[0], TOO_SHORT)

    def stuck(self, lane: int, x: Array, otherwise: str) -> End:
        """The end of a lane at a point (n + 1,) whose motions cannot be followed; for another reason where they can."""
        try:
            self.curve.evaluate(x[None])
        except FlowError as error:
            return End("stuck", str(error), lane=lane)
        return End("stuck", otherwise, lane=lane)
