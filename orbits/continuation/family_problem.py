"""The orbits of a machine along a parameter, as a problem of curves.

It states how they are solved and certified, and what happens where motions amplify small changes, at corners, and where
the curve is lost.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..curves import ANOTHER, ASKS, Barrier, Border, End, Event, Points, Problem, Start, Steps, Test, correct
from ..errors import FlowError, NoOrbit, NoStep, OrbitsError
from ..numerics import Array, through
from ..shooting import DIVISION, Evaluation, joined
from .curve import Curve, evaluation_at
from .curve_corners import AWAY_FROM_CORNER, CurveCorner, CurveCorners
from .curve_ends import Endings
from .step_control import Options


class BatchOptions(NamedTuple):
    """The points of a family that are solved together, and when their derivatives are computed again."""

    resolved: float = 10  # shortest steps: the family may change between points that are nearer
    # After a step that moves the ends of all motions by less than this share, second derivatives are those before it.
    # The tangents have an error of this share, which is less than what step-size control aims at.
    chord_step: float = 1e-6
    # With such derivatives each step is a share of the one before, not its square: the last one is smaller than usual.
    last_chord_step: float = 1e-9
    steps: int = 12_000  # of integration of all motions in one batch, whose arrays then fit into the cache
    small: int = 8  # points of a small batch


BATCH = BatchOptions()
# The kind of the test by which it is judged what follows a point.
JUDGED = "judged"


class FamilyProblem(Problem):
    """The curve of a family, one lane.

    tests : of the events between its points
    endings : the tests for its end, which are known once it has a first point
    steps : those of the options, with as many points in a batch as fit
    """

    steps: Steps

    def __init__(
        self, curve: Curve, options: Options, tests: Sequence[Test] = (), endings: Endings | None = None,
        steps: Steps | None = None,
    ):  # fmt: skip
        self.curve, self.options, self._events, self._endings = curve, options, tests, endings
        self.tests = (*tests, *(endings.tests() if endings else ()), Test(JUDGED, _judged, ASKS)) if endings else tests
        self.chords = type(curve).evaluate_beside is not Curve.evaluate_beside
        self.steps = steps or options.steps(options.step_control.largest_batch)
        if self.chords:
            self.steps = replace(self.steps, last=min(self.steps.last, BATCH.last_chord_step))
        self.kernel = curve.kernel
        self.solver = self._compiled if self.kernel else None
        self.renews = self.solver is None
        if curve.division:
            nodes = curve.division.nodes
            self.shared = np.delete(np.arange(curve.equations.size + 1), np.arange(nodes.start, nodes.stop))

    @cached_property
    def corners(self) -> CurveCorners | None:
        """The corners of the curve; None where there are none."""
        curve = self.curve
        corners = CurveCorners(curve.equations, curve.along, curve.parameters_at, curve.size)
        return None if corners.switching is None else corners

    @property
    def endings(self) -> Endings:
        """The tests for the end."""
        assert self._endings is not None
        return self._endings

    def with_curve(self, curve: Curve) -> "FamilyProblem":
        """The problem for another curve, such as one whose motions are divided at nodes."""
        endings = self._endings and self._endings.with_curve(curve)
        return FamilyProblem(curve, self.options, self._events, endings, self.steps)

    def evaluate(self, lanes: Array, xs: Array, known: Any = None, moved: Any = None) -> tuple[Array, Any]:
        try:
            if known is not None and moved is not None and (moved * known.amplification < BATCH.chord_step).all():
                return np.arange(len(xs)), self.curve.evaluate_beside(xs, known)
            return np.arange(len(xs)), self.curve.evaluate(xs)
        except FlowError:
            return (np.arange(0), None) if len(xs) == 1 else self.curve.evaluate_lanes(xs)

    def _compiled(self, lanes: Array, xs: Array, rows: Array, levels: Array, least: int, record: bool) -> Any:
        """Newton's method in one call; None where it does not converge for all points."""
        curve = self.curve
        assert self.kernel is not None
        found = self.kernel(xs, rows, levels, curve.size(xs), curve.parameters_at(xs), least, record)
        return found if len(found.which) == len(xs) else None

    def size(self, lanes: Array, xs: Array) -> Array:
        return self.curve.size(xs)

    def units(self, sizes: Array, evaluation: Evaluation) -> Array:
        return self.curve.units_of_changes(sizes, evaluation)

    def rounding(self, evaluation: Evaluation, rows: Array) -> Array:
        return self.curve.rounding_of_steps(evaluation, rows)

    def steady(self, lanes: Array, xs: Array, tangents: Array) -> Array:
        return self.curve.steady(xs, tangents)

    def barriers(self, lanes: Array, xs: Array, tangents: Array, lengths: Array) -> Mapping[int, Barrier]:
        if self.corners is None:
            return {}
        near = ((i, self.corner_ahead(xs[i], tangents[i], lengths[i])) for i in range(len(xs)))
        return {i: corner for i, corner in near if corner}

    def corner_ahead(self, x: Array, tangent: Array, longest: float) -> CurveCorner | None:
        """The next corner of the curve within a length of a point (n + 1,)."""
        return self.corners.ahead(x, tangent, longest) if self.corners else None

    def certify(self, points: Points) -> tuple[Points, dict[int, OrbitsError]]:
        found, errors = self.curve.certified(points)
        if found is None:
            return points, errors
        own = found[np.minimum(np.arange(len(points)), len(found) - 1)] if errors else found
        return points.having(own=own), errors

    def certify_first(self, first: Points, points: Points) -> tuple[Points, Points, dict[int, OrbitsError]]:
        parts = [first, points] if len(points) else [first]
        names = ("lanes", "xs", "tangents", "growths", "lengths")
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        evaluation, places = joined([evaluation_at(part) for part in parts]), np.arange(1 + len(points))
        certified, errors = self.certify(Points(**arrays, evaluation=evaluation, places=places))
        if 0 in errors:
            raise errors[0]
        self.endings.origin = certified.own[0]
        return certified[:1], certified[1:], {i - 1: error for i, error in errors.items()}

    def regular(self, points: Points) -> Points:
        """With the largest singular value of the Jacobian in place of the one that vanishes."""
        own, sizes = evaluation_at(points), self.curve.size(points.xs)[:, None]
        u, s, v = np.linalg.svd(own.jacobian * sizes)
        s[:, -1] = s[:, 0]
        jacobian = ((u * s[:, None]) @ v[:, : s.shape[1]]) / sizes
        return points.having(evaluation=replace(own, jacobian=jacobian), places=np.arange(len(points)))

    def accepts(self, before: Points, points: Points) -> Array:
        """No corner lies between the ends of a step. Certified points are of one family, or are so near to each other
        that another one begins between them."""
        if points.own is None:
            pairs, corners = zip(before.xs, points.xs, strict=True), self.corners
            return ~np.array([corners is not None and corners.between(a, b) for a, b in pairs], bool)
        # Where the extension moves alone, turns neither begin nor end along a curve: another number is another curve.
        reduced = self.curve.machine.model.reduction
        resolved = 0.0 if reduced else BATCH.resolved * self.options.step_control.shortest_step
        same = before.own.column("family") == points.own.column("family")
        return same | (points.lengths <= resolved)

    def changed(self, event: Event, passed: Sequence[Points]) -> Start | End | None:
        point, endings = event.point, self.endings
        if event.kind != JUDGED:
            return endings.at(event)
        if end := endings.after(point, passed):
            return end
        if self.curve.largest_growths(point)[0] > DIVISION.growth and self.curve.asks_for_nodes(point)[0]:
            try:
                if divided := self._divided(point):
                    return divided
            except OrbitsError as error:
                return endings.lost(error, point, passed)
        corner = self.corner_ahead(point.xs[0], point.tangents[0], 2 * AWAY_FROM_CORNER)
        try:
            return self.beyond(point, corner) if corner else None
        except OrbitsError as error:
            return endings.lost(error, point, passed)

    def beyond(self, last: Points, corner: CurveCorner) -> Start:
        """The curve just beyond the corner ahead of a point (1), with that corner, certified."""
        (x,), (tangent,) = last.xs, last.tangents
        at = self.solved(x, *corner.border(x, 0.0), tangent)
        row, level = corner.border(at.xs[0], AWAY_FROM_CORNER)
        outward = self.curve.size(at.xs[0]) ** 2 * row * np.sign(corner.rate)
        begin = at.xs[0] + outward * (level - row @ at.xs[0]) / (row @ outward)
        return Start.at(self, self.certified(self.solved(begin, row, level, outward)), ("corner", self.certified(at)))

    def _divided(self, last: Points) -> Start | None:
        """The last point (1) on the same curve, whose motions are divided at nodes from now on; None where they can do
        without, and nodes do not make the error smaller, as where small changes grow within a short time."""
        needed = self.curve.largest_growths(last)[0] > DIVISION.arc_growth
        try:
            curve, x, tangent = self.curve.divided(last.xs[0], last.tangents[0], evaluation_at(last))
            problem, row = self.with_curve(curve), tangent / curve.size(x) ** 2
            first = problem.certified_at(problem.solved(x, row, float(row @ x), tangent), last.values[0])
            is_of_use = needed or first.own[0].error < last.own[0].error
        except OrbitsError:
            if needed:
                raise
            is_of_use = False
        if not is_of_use:
            self.curve.takes_nodes_early = False
            return None
        return Start.at(problem, first)

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> End:
        last = passed[-1][-1:]
        if error == ANOTHER:
            return self.endings.lost(NoOrbit("the next orbit belongs to another family"), last, passed)
        return self.endings.lost(error if isinstance(error, OrbitsError) else self._reason(last, error), last, passed)

    def _reason(self, last: Points, error: object) -> OrbitsError:
        """Why the curve cannot be followed beyond a point (1): the error of the motion near it, if it has one."""
        try:
            self.curve.evaluate(self._ahead(last.xs, last.tangents, self.options.step_control.shortest_step))
        except FlowError as beside:
            return beside
        return NoStep(str(error))

    def _ahead(self, x: Array, tangent: Array, length: float) -> Array:
        """The place (1, n + 1) that a point and its tangent (1, n + 1) predict at a length ahead."""
        row = tangent / self.curve.size(x) ** 2
        return through(x[:, None], tangent[:, None], np.ones((1, 1), bool), 0, row, (row * x).sum(1) + length)[0]

    def rescued(self, lane: Array, x: Array, tangent: Array, length: float) -> tuple[Points, Border] | None:
        """The point solved by Ipopt at a fixed value of the parameter, as a last resort."""
        control, size = self.options.step_control, self.curve.size(x)
        if abs(tangent[0, -1]) < control.steepest_rate * self.curve.span:
            return None  # the parameter's value does not fix the orbit here
        guess = self._ahead(x, tangent, length)  # from this point alone: earlier ones may lie too close
        try:
            by_ipopt, row = self.curve.rescued(guess[0]), np.eye(guess.shape[1])[-1]
            point = self.solved(by_ipopt, row, by_ipopt[-1], tangent[0])
        except OrbitsError:
            return None
        a, b = tangent / size, point.tangents / size
        cosine = float((a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum()))
        moved = np.linalg.norm((point.xs - guess) / size)
        near = moved <= control.largest_correction * length and cosine >= np.cos(control.largest_turn)
        before = point.having(xs=x, tangents=tangent)
        return (point, Border(row[None], point.values)) if near and self.accepts(before, point)[0] else None

    def solved(self, x: Array, row: Array, level: float, before: Array) -> Points:
        """The point (1) of the curve near a place (n + 1,), where row . X = level, with a tangent onward from the
        vector `before` (n + 1,). Raises the error of its motion, and `NoStep` where Newton's method does not
        converge."""
        border = Border(row[None], np.array([level], float))
        which, points = correct(self, np.zeros(1, int), x[None], border, before[None], self.steps)
        if not len(which):
            self.curve.evaluate(border.met(x[None]))
            raise NoStep("the corrector does not converge")
        return points.having(lengths=np.zeros(1))

    def certified(self, point: Points) -> Points:
        """A point (1), certified; raises the error where it cannot be certified."""
        point, errors = self.certify(point)
        if errors:
            raise errors[0]
        return point

    def certified_at(self, point: Points, value: float) -> Points:
        """A point (1) whose parameter is `value` up to rounding, certified with exactly that value."""
        xs = point.xs.copy()
        xs[:, -1] = value
        return self.certified(point.having(xs=xs))

    def known(self, x: Array, row: Array, tangent: Array) -> tuple["FamilyProblem", Points]:
        """The point (1) near a place (n + 1,) of the curve, at its level of a row (n + 1,), with a tangent onward from
        the one stated; and the problem, divided at nodes where the motion amplifies small changes."""
        try:
            found = self.solved(x, row, row @ x, tangent)
            if self.curve.largest_growths(found)[0] <= DIVISION.arc_growth:
                return self, found
            evaluation = self.curve.evaluate(x[None])
        except NoOrbit:
            evaluation = self.curve.evaluate(x[None])
            if evaluation.largest_growth[0] <= DIVISION.arc_growth:
                raise
        curve, x, tangent = self.curve.divided(x, tangent, evaluation)
        row = np.insert(row, self.curve.equations.own, np.zeros(len(x) - len(row)))
        problem = self.with_curve(curve)
        return problem, problem.solved(x, row, row @ x, tangent)


def largest_batch(point: Points) -> int:
    """The largest number of points in a batch whose motions are about as long as that of a point (1)."""
    steps = sum(int(motions.counts[point.places[0]]) for motions in point.evaluation.trajectories)
    return max(BATCH.small, BATCH.steps // max(steps, 1))


def _judged(problem: Any, points: Points) -> Array:
    """Negative at certified points (m,) behind which the curve may end or continue otherwise."""
    asks = problem.endings.asks(points) | problem.endings.hangs(points) | problem.curve.asks_for_nodes(points)
    if problem.corners:
        near = (
            problem.corner_ahead(x, t, 2 * AWAY_FROM_CORNER) for x, t in zip(points.xs, points.tangents, strict=True)
        )
        asks |= np.array([corner is not None for corner in near])
    return np.where(asks, -1.0, 1.0)
