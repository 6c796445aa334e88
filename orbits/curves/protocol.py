"""What a problem states about its curves, and what a run finds on them.

All quantities are arrays for m points X (m, n + 1), each on one of the curves of the problem, its lane.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..errors import InputError, cut_in_the_middle
from .step_options import Steps

Array = np.ndarray
# The purpose of a test: its zeros are events; at its zeros the problem may change; or, at every point where its value
# is negative, the problem may change.
HAPPENS, CHANGES, ASKS = "happens", "changes", "asks"
# The kinds of ends, in four lines: a bound of the parameter, the first point or another range; what a problem of orbits
# knows; an event that ends a curve; and a curve that cannot or need not be followed further.
KINDS_OF_END = (
    "reached", "closed", "left",
    "escaped", "homoclinic", "degenerate", "infeasible", "no launch",
    "fold", "flip", "bifurcation", "jump", "border",
    "stuck", "stopped", "interrupted",
)  # fmt: skip

LONGEST_REASON = 100  # characters in a line that describes an end
# The bounds of a determinant, which is a product of as many numbers as there are unknowns.
FINITE = -1e300, 1e300


class Evaluation(Protocol):
    """The equations at m points.

    residual, jacobian : (m, n), (m, n, n + 1)
    amplification : factors (m,) by which a Newton step has to be smaller to be the last one; infinite where the
        equations are not exact: no step there is the last one, and a small one may be their error
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
        """These points with other fields."""
        return Points(**(vars(self) | known))


@dataclass(frozen=True)
class Event:
    """An event on a curve.

    kind : of what happens there
    after : the index of the last point up to the event, on its curve
    point : the point there: `Points` (1) while a curve is followed, a `CriticalPoint` on a curve of minima, a `Point`
        of a family, or a `PeriodicLaunch`; None on curves of designs and optimal motions, whose events have a value and
        a text
    which : the index of the function, for a test with several, or of the limit
    value, cost : the value of the parameter and the least cost, if the point has them
    text : what happens, in words; `what` is another name of it

    Raises `InputError` for a kind that is not text.
    """

    kind: str
    after: int = 0
    point: Any = None
    _: KW_ONLY
    which: int = field(default=0, compare=False)
    value: float | None = None
    cost: float | None = None
    text: str = ""
    what = property(lambda self: self.text)

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str):
            raise InputError(f"an event cannot have the kind {self.kind!r}; the kind must be text, the first argument")
        for name in ("value", "cost"):
            vars(self)[name] = getattr(self.point, name, getattr(self, name))

    def __repr__(self) -> str:
        names = ("kind", "value", "cost", "text") if self.point is None else ("kind", "after", "point")
        known = (f"{name}={vars(self)[name]!r}" for name in names if vars(self)[name] is not None)
        return f"Event({', '.join(known)})"

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Restore a pickle, which may have `what` in place of `text`, and no value in addition to that of its point."""
        vars(self).update(state, text=state.get("what", state.get("text", "")))
        self.__post_init__()


@dataclass(frozen=True)
class End:
    """The end of a curve.

    kind : one of `KINDS_OF_END`
    reason : in words
    limit, limit_error : where the parameter tends to a value before its bound, this value and an estimate of its error;
        else None
    period_growth : for an orbit that becomes homoclinic, how much its period grows while the distance of the parameter
        from its limit falls by the factor e, measured along the family; else None
    lane : the index of the curve among those followed together

    Raises `InputError` for another kind.
    """

    kind: str
    reason: str = ""
    limit: float | None = None
    limit_error: float | None = None
    period_growth: float | None = None
    lane: int = field(default=0, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.kind not in KINDS_OF_END:
            raise InputError(f"a curve cannot end as '{self.kind}'; the ends are {', '.join(KINDS_OF_END)}")

    def __repr__(self) -> str:
        reason = self.reason if len(self.reason) <= LONGEST_REASON else cut_in_the_middle(self.reason, 70, 25)
        return f"End(kind={self.kind!r}, reason={reason!r}, limit={self.limit!r}, limit_error={self.limit_error!r})"


class Start(NamedTuple):
    """Where a curve continues, as that of another problem or behind a corner: near x (n + 1,), with a tangent (n + 1,)
    that points onward. The certified point (1) there, where it is known; and what is passed on the way, as a corner,
    with its kind and its certified point (1)."""

    problem: "Problem"
    x: Array
    tangent: Array
    passed: tuple[str, Points] | None = None
    point: Points | None = None

    @classmethod
    def at(cls, problem: "Problem", point: Points, passed: tuple[str, Points] | None = None) -> "Start":
        """On a curve of a problem at its certified point (1)."""
        return cls(problem, point.xs[0], point.tangents[0], passed, point)


class Barrier(Protocol):
    """A place ahead of a point at which the equations are not smooth, where a step ends.

    left : its distance along the tangent
    border : X (n + 1,) -> the row (n + 1,) and the level of the barrier, to first order near X
    """

    @property
    def left(self) -> float: ...

    def border(self, x: Array) -> tuple[Array, float]: ...


@dataclass(frozen=True)
class Test:
    """A function that changes its sign where something happens.

    values : (problem, certified points (m,)) -> (m,), or (m, k) for k functions; NaN where a function has no value
    does : `HAPPENS`, `CHANGES` or `ASKS`
    gradient : (problem, X (m, n + 1), evaluation, number of the function) -> values (m,) and derivatives (m, n + 1);
        with it Newton's method finds the event on the curve directly; None is a gradient that is not known
    confirmed : (problem, point (1), number) -> the kind of the event, or None where there is none
    bare : whether X and tangents suffice for the values, so that the points of the search need not be certified
    places : number of places at which the search cuts a segment at once; above 1 for values that are signs or other
        labels, since each change of a label is an event
    beside : share of the chord, above 0 where the equations are singular at the event: it is interpolated from points
        at one and two times this distance on either side
    """

    kind: str
    values: Callable[["Problem", Points], Array]
    does: str = HAPPENS
    gradient: Callable[["Problem", Array, Any, int], tuple[Array, Array] | None] | None = None
    confirmed: Callable[["Problem", Points, int], str | None] | None = None
    bare: bool = False
    places: int = 1
    beside: float = 0.0
    __test__ = False  # no test of pytest's

    def __post_init__(self) -> None:
        if self.does not in (HAPPENS, CHANGES, ASKS):
            raise InputError(f"test '{self.kind}': does = {self.does!r}; it must be {HAPPENS}, {CHANGES} or {ASKS}")


class Problem:
    """The equations of one curve or more. A problem states `evaluate` and `size`; the other methods have defaults."""

    tests: Sequence[Test] = ()
    # Steps along its curves, where these are others than those of a run.
    steps: Steps | None = None
    # Whether derivatives that are known at a point may serve nearby, in `evaluate`.
    chords = False
    # Whether the equations are evaluated at all points, for tests and certificates that use them.
    records = True
    # Whether tangents are exact only if they are computed anew where the equations at points are recorded, as where
    # `chords` serve or the last step of Newton's method is not small.
    renews = False
    # The places of those components that all problems of a run have, by which it is seen whether a curve is closed.
    shared: Any = slice(None)
    # Newton's method in one compiled call: (lanes, xs, rows, levels, least, record) -> the indices of the solved
    # points in order, X, directions, amplifications and evaluation; None where it does not apply.
    solver: Callable[..., tuple | None] | None = None

    def evaluate(self, lanes: Array, xs: Array, known: Any = None, moved: Array | None = None) -> tuple[Array, Any]:
        """The indices (k,), in order, of points X (m, n + 1) that can be evaluated, and their `Evaluation`, or None.

        xs : a view, whose numbers change after the call
        known, moved : the evaluation before the last Newton step, where `chords` may use it, and the lengths (m,) of
            that step; they are 0 for points at which Newton's method has ended
        """
        raise NotImplementedError

    def size(self, lanes: Array, xs: Array) -> Array:
        """The unit (m, n + 1) of each component."""
        raise NotImplementedError

    def steady(self, lanes: Array, xs: Array, tangents: Array) -> Array:
        """The tangents (m, n + 1) from which neighbours are interpolated."""
        return tangents

    def units(self, sizes: Array, evaluation: Any) -> Array:
        """The units (m, n + 1) of Newton steps at points of these sizes, for equations that some components determine
        more sharply than by their sizes."""
        return sizes

    def rounding(self, evaluation: Any, rows: Array) -> Array | float:
        """The sizes (m, n + 1) of Newton steps to levels of rows (m, n + 1) that rounding alone may cause."""
        return 0.0

    def barriers(self, lanes: Array, xs: Array, tangents: Array, lengths: Array) -> Mapping[int, Barrier]:
        """The barriers within these lengths (m,) of points, by index."""
        return {}

    def rescued(self, lane: Array, x: Array, tangent: Array, length: float) -> tuple[Points, Any] | None:
        """The next point (1) of a lane (1,), about this length ahead of X (1, n + 1), by another method where no step
        leads to one, with its border; None where there is none."""
        return None

    def certify(self, points: Points) -> tuple[Points, Mapping[int, Exception]]:
        """The points with their `own`, and the errors of the points that are refused, by index."""
        return points, {}

    def certify_first(self, first: Points, points: Points) -> tuple[Points, Points, Mapping[int, Exception]]:
        """First points and those of the first batch as `certify` certifies them, by default one after the other; raises
        the error of a first point."""
        first, errors = self.certify(first)
        if errors:
            raise errors[min(errors)]
        return first, *(self.certify(points) if len(points) else (points, {}))

    def regular(self, points: Points) -> Points:
        """Points at which the equations are singular, as they can be certified."""
        return points

    def accepts(self, before: Points, points: Points) -> Array:
        """Whether points (m,) may be neighbours of the points (m,) before them: the ends of steps, without `own`, and
        all certified points."""
        return np.ones(len(points), bool)

    def changed(self, event: Event, passed: Sequence[Points]) -> Start | End | None:
        """What follows an event of a test that `CHANGES` or `ASKS`, behind the points passed in its lane; None where
        nothing changes."""
        raise NotImplementedError

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> Start | End:
        """The end of a curve that cannot be followed beyond its last point, or where it continues, as behind a
        corner."""
        return End("stuck", str(error), lane=lane)


def _turning(problem: Problem, points: Points) -> Array:
    """The components (m,) of the tangents along the parameter."""
    return points.tangents[:, -1]


def _bordered_determinants(problem: Problem, points: Points) -> Array:
    """The determinants (m,) of the Jacobians above the tangents, in the problem's units."""
    if points.evaluation is None:
        raise InputError("branch points need the equations at the points: set `records = True` in the problem")
    sizes = problem.size(points.lanes, points.xs)
    jacobians, tangents = points.evaluation.jacobian[points.places] * sizes[:, None], points.tangents / sizes
    with np.errstate(over="ignore"):  # of many unknowns, where the sign counts
        return np.clip(np.linalg.det(np.concatenate([jacobians, tangents[:, None]], axis=1)), *FINITE)


# Two tests that all problems may use: a point at which the parameter turns round, and one at which curves cross.
FOLD = Test("fold", _turning, bare=True)
BRANCH = Test("branch point", _bordered_determinants, beside=0.05)
