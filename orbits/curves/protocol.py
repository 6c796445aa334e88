"""What a problem states about its curves, and what is found on them.

All is in arrays of m points X (m, n + 1), each on one of the curves of the problem, its lane.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..errors import InputError

Array = np.ndarray
# The purpose of a test: its zeros are events; at its zeros the problem may change; or, at every point where its value
# is negative, the problem may change.
HAPPENS, CHANGES, ASKS = "happens", "changes", "asks"
# How a curve may end: as it should, at something that its problem knows, or because it cannot be followed.
KINDS_OF_END = (
    "reached", "closed", "left", "escaped", "homoclinic", "degenerate", "infeasible", "fold", "bifurcation", "jump",
    "border", "stuck", "stopped", "interrupted",
)  # fmt: skip


class Evaluation(Protocol):
    """The equations at m points.

    residual, jacobian : (m, n), (m, n, n + 1)
    amplification : factors (m,) by which a Newton step has to be smaller to be the last one

    Where the Jacobian is not dense, a method `bordered(rows (m, n + 1), right (m, n + 1, k))` returns the solutions
    (m, n + 1, k) of the systems of the Jacobians above the rows.
    """

    residual: Array
    jacobian: Array
    amplification: Array

    def __getitem__(self, which: Any) -> "Evaluation": ...


@dataclass(frozen=True, eq=False)
class Points:
    """Points (m,) of curves, in order along each curve.

    lanes : (m,)
    xs, tangents : (m, n + 1); the tangents have length 1 in the problem's units
    growths : factors (m,) by which each point amplifies small changes
    evaluation, places : equations, and the place (m,) of each point among those at which they were evaluated
    lengths : distances (m,) from the points before them, or None
    own : what the problem's `certify` adds, which is indexed as an array is
    """

    lanes: Array
    xs: Array
    tangents: Array
    growths: Array
    evaluation: Any
    places: Array
    lengths: Any = None
    own: Any = None

    def __len__(self) -> int:
        return len(self.xs)

    def __getitem__(self, which: Any) -> "Points":
        own, lengths = (None if each is None else each[which] for each in (self.own, self.lengths))
        xs, tangents, places = self.xs[which], self.tangents[which], self.places[which]
        return Points(self.lanes[which], xs, tangents, self.growths[which], self.evaluation, places, lengths, own)

    @property
    def values(self) -> Array:
        """The values (m,) of the parameter."""
        return self.xs[:, -1]

    def having(self, **known: Any) -> "Points":
        """The same points with other fields."""
        return Points(**(vars(self) | known))


class Event(NamedTuple):
    """An event on a curve: its kind, its point (1), the place in its lane of the last point up to it, and the number of
    the function of a test with several."""

    kind: str
    point: Points
    after: int
    which: int = 0


@dataclass(frozen=True)
class End:
    """The end of a curve: one of `KINDS_OF_END`, the reason in words, the lane, and what its problem knows, as a limit.

    Raises `InputError` for another kind.
    """

    kind: str
    reason: str = ""
    lane: int = 0
    known: Any = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS_OF_END:
            raise InputError(f"a curve cannot end as '{self.kind}'; the ends are {', '.join(KINDS_OF_END)}")


class Start(NamedTuple):
    """Where a curve goes on, as that of another problem or behind a corner: near x (n + 1,), with a tangent (n + 1,)
    that points onward, at a border; the row of the tangent at x by default."""

    problem: "Problem"
    x: Array
    tangent: Array
    border: Any = None


@dataclass(frozen=True)
class Test:
    """A function that changes its sign where something happens.

    values : (problem, certified points (m,)) -> (m,), or (m, k) for k functions; NaN where a function has no value
    does : `HAPPENS`, `CHANGES` or `ASKS`
    gradient : (problem, X (m, n + 1), evaluation, number of the function) -> values (m,) and derivatives (m, n + 1);
        with it Newton's method finds the event on the curve directly; None is a gradient that is not known
    confirmed : (problem, point (1), number) -> the kind of the event, or None where there is none
    width : share of the chord to which the place is located; the option `width` by default
    bare : whether X and tangents suffice for the values, so that the points of the search need not be certified
    places : number of places at which the search cuts a segment at once; above 1 for values that are signs alone
    beside : share of the chord, above 0 where the equations are singular at the event: it is interpolated from points
        at one and two times this distance on either side
    """

    kind: str
    values: Callable[["Problem", Points], Array]
    does: str = HAPPENS
    gradient: Callable[["Problem", Array, Any, int], tuple[Array, Array] | None] | None = None
    confirmed: Callable[["Problem", Points, int], str | None] | None = None
    width: float | None = None
    bare: bool = False
    places: int = 1
    beside: float = 0.0
    __test__ = False  # no test of pytest's

    def __post_init__(self) -> None:
        if self.does not in (HAPPENS, CHANGES, ASKS):
            raise InputError(f"test '{self.kind}': does = {self.does!r}; it is {HAPPENS}, {CHANGES} or {ASKS}")


class Problem:
    """The equations of one curve or more. A problem states `evaluate` and `size`; the other methods have defaults."""

    tests: Sequence[Test] = ()
    # Whether derivatives that are known at a point may serve nearby, in `evaluate`.
    chords = False
    # Whether the equations are evaluated at all points, for tests and certificates that use them.
    records = True
    # Whether tangents are exact only if they are computed at the points, as where `chords` serve.
    renews = False
    # Newton's method in one compiled call: (lanes, xs, rows, levels, least, record) -> the indices of the solved
    # points, X, directions, amplifications and evaluation; None where it does not apply.
    solver: Callable[..., tuple | None] | None = None

    def evaluate(self, lanes: Array, xs: Array, known: Any = None, moved: Array | None = None) -> tuple[Array, Any]:
        """The indices (k,) of the points X (m, n + 1) that can be evaluated, and the `Evaluation` of these, or None.

        known, moved : the evaluation before the last Newton step, where `chords` may use it, and the lengths (m,) of
            that step; they are 0 for points at which Newton's method has ended
        """
        raise NotImplementedError

    def size(self, lanes: Array, xs: Array) -> Array:
        """The unit (m, n + 1) of each component."""
        raise NotImplementedError

    def rows(self, lanes: Array, xs: Array, tangents: Array) -> Array:
        """The rows (m, n + 1) that measure lengths along the curves; those of arclength by default."""
        return tangents / self.size(lanes, xs) ** 2

    def steady(self, lanes: Array, xs: Array, tangents: Array) -> Array:
        """The tangents (m, n + 1) from which neighbours are interpolated."""
        return tangents

    def certify(self, points: Points) -> tuple[Points, Mapping[int, Exception]]:
        """The points with their `own`, and the errors of the points that are refused, by index."""
        return points, {}

    def accepts(self, before: Points, points: Points) -> Array:
        """Whether points (m,) may be neighbours of the points (m,) before them."""
        return np.ones(len(points), bool)

    def changed(self, event: Event, passed: Sequence[Points]) -> Start | End | None:
        """What follows an event of a test that `CHANGES` or `ASKS`, behind the points passed in its lane; None where
        nothing changes."""
        raise NotImplementedError

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> Start | End:
        """The end of a curve that cannot be followed beyond its last point, or where it goes on, as behind a corner."""
        return End("stuck", str(error), lane)


def _turning(problem: Problem, points: Points) -> Array:
    """The components (m,) of the tangents along the parameter."""
    return points.tangents[:, -1]


def _bordered_determinants(problem: Problem, points: Points) -> Array:
    """The determinants (m,) of the Jacobians above the tangents, in the problem's units."""
    if points.evaluation is None:
        raise InputError("branch points need the equations at the points: set `records = True` of the problem")
    sizes = problem.size(points.lanes, points.xs)
    jacobians, tangents = points.evaluation.jacobian[points.places] * sizes[:, None], points.tangents / sizes
    return np.linalg.det(np.concatenate([jacobians, tangents[:, None]], axis=1))


# Two tests that all problems may use: a point at which the parameter turns round, and one at which curves cross.
FOLD = Test("fold", _turning, bare=True)
BRANCH = Test("branch point", _bordered_determinants, beside=0.05)
