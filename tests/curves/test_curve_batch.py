"""Batches of steps along curves in closed form: rejections, neighbours, barriers, and steps by another method."""

from typing import NamedTuple

import numpy as np
import pytest
from plane_curves import BOTH, Formula, circle, corner, found_by, line, places, run_of

from orbits.curves import ASKS, Border, Start, Steps, Test, correct


def test_steps_go_on_from_the_accepted_ends_before_a_rejected_point():
    """Points beyond 0.5 are refused; the next step is predicted from the ends of steps before them, which are near."""
    problem = Formula(circle)
    problem.certify = lambda points: (points, {i: ValueError() for i in np.flatnonzero(points.values > 0.5).tolist()})
    run = run_of(problem, (1.0, 0.0), stop=2.0)
    run.advance()
    tails, last = run.groups[0].tails, run.blocks[-1].xs[-1]
    assert tails.xs[0, -1].tolist() == last.tolist()
    assert 0.48 < last[1] <= 0.5
    assert tails.known.all()
    # Each is one step of at most 0.2 along the tangent away from the next one; the first point is 0.5 away.
    assert np.linalg.norm(np.diff(tails.xs[0], axis=0), axis=1).max() < 0.21
    assert (run.progress.batch[0], run.progress.rejections[0]) == (1, 1.0)
    _, _, (end,) = found_by(run)
    assert end.kind == "stuck"


class Cornered(Formula):
    """The curve x = |p - 0.3|, whose corner steps come near to; then it goes on just beyond it."""

    NEAR = 1e-9

    def __init__(self):
        super().__init__(
            corner, [Test("judged", lambda _, points: np.where(self.left(points) > 2 * self.NEAR, 1, -1), ASKS)]
        )

    @staticmethod
    def left(points):
        left = 0.3 - points.values
        return np.where(left > 0, left, np.inf)

    def barriers(self, lanes, xs, tangents, lengths):
        left = (0.3 - xs[:, 1]) / tangents[:, 1]
        return {i: self.Barrier(float(left[i])) for i in np.flatnonzero((left > 0) & (left <= lengths)).tolist()}

    class Barrier(NamedTuple):
        left: float

        def border(self, x):
            return np.array([0.0, 1.0]), 0.3 - Cornered.NEAR

    def changed(self, event, passed):
        lane, onward = event.point.lanes, np.array([[1.0, 1.0]])
        at, beyond = (
            correct(self, lane, np.array([[0.0, p]]), Border.of_component(1, np.array([p]), 2), onward, Steps())[1]
            for p in (0.3, 0.3 + self.NEAR)
        )
        return Start.at(self, beyond, ("corner", at))


@BOTH
def test_steps_end_before_a_barrier_and_go_on_behind_it(options):
    problem = Cornered()
    xs, (event,), (end,) = found_by(run_of(problem, (1.3, -1.0), stop=1.0, options=options))
    assert (event.kind, event.point.values.tolist(), end.kind) == ("corner", [0.3], "reached")
    p = np.array(xs)[:, 1]
    assert np.array(xs)[:, 0] == pytest.approx(np.abs(p - 0.3), abs=1e-14)
    assert p[event.after] == 0.3 - Cornered.NEAR
    assert (np.diff(p) > 0).all()


def test_certified_points_that_are_no_neighbours_are_rejected_until_they_are_near():
    """Each rejection halves the step, and none counts."""

    class Numbered(Formula):
        def certify(self, points):
            return points.having(own=np.floor(3 * points.values)), {}

        def accepts(self, before, points):
            if points.own is None:
                return np.ones(len(points), bool)
            return (before.own == points.own) | (points.lengths <= 1e-3)

    number = Test("number", lambda _, points: points.own, places=3)
    xs, events, (end,) = found_by(
        run_of(Numbered(circle, [number]), (1.0, 0.05), stop=0.95, options=Steps(rejections=0))
    )
    assert places(events, "number")[:, 1] == pytest.approx([1 / 3, 2 / 3], abs=1e-12)
    assert end.kind == "reached"
    for event in events:
        a, b = xs[event.after : event.after + 2]
        assert np.linalg.norm(b - a) <= 1e-3


def test_a_curve_is_lost_where_its_neighbours_are_of_another_one():
    class Alone(Formula):
        def accepts(self, before, points):
            return points.values < 0.5

    _, _, (end,) = found_by(run_of(Alone(circle), (1.0, 0.0), stop=0.95))
    assert end.kind == "stuck"


def test_a_step_passes_a_bound_at_which_the_equations_are_singular():
    """F = x**3 - p**3 has no derivatives at p = 0, where the curve x = p ends."""

    def cubes(lanes, x, p):
        return [x**3 - p**3], [[3 * x * x, -3 * p * p]]

    xs, _, (end,) = found_by(run_of(Formula(cubes), (-1.0, -1.0), stop=0.0))
    assert (end.kind, len(xs) < 200) == ("reached", True)


class Gap(Formula):
    """The line x = p, of which no step leads beyond p = 0.5 but another method does."""

    rescues = 0

    def certify(self, points):
        return points.having(own=points.lanes), {}

    def accepts(self, before, points):
        return (points.own is not None) | (before.values > 0.5) | (points.values < 0.5)

    def rescued(self, lane, x, tangent, length):
        self.rescues += 1
        border = Border.of_component(1, x[:, 1] + 1e-3, 2)
        which, points = correct(self, lane, x + 1e-3, border, tangent, Steps())
        return (points, border) if len(which) else None


def test_a_step_by_another_method_passes_no_event_value_or_bound():
    """An event and a requested value lie behind the gap, on the step that it is passed by."""
    options = Steps(first=1e-2, shortest=1e-6, longest=0.02, lengthen=1.0)
    event = Test("event", lambda _, points: points.values - 0.5004, bare=True)
    problem = Gap(line, [event])
    xs, events, (end,) = found_by(run_of(problem, (0.0, 0.0), stop=1.0, at=[0.5003], options=options))
    assert problem.rescues == 1
    assert [(e.kind, e.point.values[0]) for e in events] == [("value", 0.5003), ("event", pytest.approx(0.5004))]
    assert end.kind == "reached"
    bounded = Gap(line)
    xs, _, (end,) = found_by(run_of(bounded, (0.0, 0.0), stop=0.5005, options=options))
    assert (end.kind, xs[-1][1]) == ("reached", 0.5005)
