"""Runs along curves in closed form: points, events, ends, pauses."""

import contextlib
import copy
import pickle
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from plane_curves import (
    UNDIVIDED,
    Bounded,
    Formula,
    Values,
    circle,
    corner,
    fixed_point,
    fold_curve,
    found_by,
    lemniscate,
    parabola_constants,
    parabolas,
    pitchfork,
    run_of,
    transcritical,
    two_cycle,
)

from orbits.curves import (
    ASKS,
    BRANCH,
    CHANGES,
    FOLD,
    Border,
    End,
    Event,
    Points,
    Start,
    Steps,
    Test,
    correct,
    follow,
    started,
)
from orbits.errors import InputError

BOTH = pytest.mark.parametrize("options", [Steps(), UNDIVIDED], ids=["divided", "undivided"])
FOLD_ENDS = Test("fold", FOLD.values, CHANGES, bare=True)


def kinds(events):
    return [event.kind for event in events]


def places(events, kind):
    return np.array([event.point.xs[0] for event in events if event.kind == kind])


@BOTH
def test_a_circle_closes_behind_its_folds(options):
    xs, events, ends = found_by(
        run_of(Formula(circle, [FOLD]), (1.0, 0.0), stop=2.0, behind=-2.0, at=[0.5], options=options)
    )
    assert np.linalg.norm(xs, axis=1) == pytest.approx(np.ones(len(xs)), abs=1e-15)
    assert kinds(events) == ["value", "fold", "value", "fold"]
    assert places(events, "fold") == pytest.approx(np.array([[0, 1], [0, -1]]), abs=1e-13)
    values = places(events, "value")
    assert values[:, 1].tolist() == [0.5, 0.5]
    assert values[:, 0] == pytest.approx(np.array([1, -1]) * np.sqrt(0.75), abs=1e-15)
    assert [end.kind for end in ends] == ["closed"]
    assert xs[-1] == pytest.approx(xs[0], abs=1e-12)
    # The points before each event lie before it along the circle.
    angles = np.unwrap(np.arctan2(np.array(xs)[:, 1], np.array(xs)[:, 0]))
    for event in events:
        angle = np.arctan2(event.point.xs[0, 1], event.point.xs[0, 0]) % (2 * np.pi)
        assert angles[event.after] <= angle + 1e-12 < angles[event.after + 1] + 1e-9


@BOTH
def test_a_lemniscate_closes_and_passes_its_node_twice(options):
    _, events, (end,) = found_by(
        run_of(Formula(lemniscate, [FOLD, BRANCH]), (0.3, 0.5), stop=2.0, behind=-2.0, options=options)
    )
    assert kinds(events) == ["fold", "branch point", "fold", "branch point"]
    assert places(events, "branch point") == pytest.approx(np.zeros((2, 2)), abs=1e-10)
    assert places(events, "fold") == pytest.approx(np.array([[0, 1], [0, -1]]), abs=1e-13)
    assert end.kind == "closed"


@BOTH
@pytest.mark.parametrize(("function", "start", "way"), [
    (transcritical, (0.0, -1.03), 1), (transcritical, (-1.03, -1.03), 1), (pitchfork, (0.0, -1.03), 1),
    (pitchfork, (1.01, 1.0201), -1),
])  # fmt: skip
def test_branch_points_are_reported_once(function, start, way, options):
    run = run_of(Formula(function, [BRANCH]), start, stop=way * 1.0, behind=2.0 * -way, way=way, options=options)
    _, events, (end,) = found_by(run)
    assert places(events, "branch point") == pytest.approx(np.zeros((1, 2)), abs=1e-10)
    assert end.kind == "reached"


def test_a_determinant_with_a_pole_or_a_jump_has_no_branch_point():
    def pole(lanes, x, p):
        away = p - 0.3
        return [(x - p) / away], [[1 / away, -1 / away - (x - p) / away**2]]

    def jump(lanes, x, p):
        side = np.where(p > 0.3, 1.0, -1.0)
        return [side * (x - p)], [[side, -side]]

    for function in (pole, jump):
        _, events, (end,) = found_by(run_of(Formula(function, [BRANCH]), (-1.0, -1.0), stop=1.0))
        assert (events, end.kind) == ([], "reached")


@BOTH
def test_branch_points_of_lanes_of_different_scale(options):
    """Each lane has one, at a place of its own, whatever the factor of its equation."""
    scales, centres = 10.0 ** np.arange(-9, 10, 3), np.linspace(-0.3, 0.4, 7)

    def lines(lanes, x, p):
        scale, away = scales[lanes], p - centres[lanes]
        return [scale * (away * x - x * x)], [[scale * (away - 2 * x), scale * x]]

    starts = np.column_stack([np.zeros(7), np.full(7, -1.0)])
    run = run_of(Formula(lines, [BRANCH]), *starts, stop=1.0, options=options)
    _, events, ends = found_by(run)
    assert sorted(int(event.point.lanes[0]) for event in events) == list(range(7))
    assert [event.point.values[0] for event in events] == pytest.approx(
        [centres[event.point.lanes[0]] for event in events], abs=1e-10
    )
    assert {end.kind for end in ends} == {"reached"}


def test_an_event_that_its_test_does_not_confirm_is_none():
    doubted = replace(FOLD, confirmed=lambda problem, point, number: "top" if point.values[0] > 0 else None)
    _, events, _ = found_by(run_of(Formula(circle, [doubted]), (1.0, 0.0), stop=2.0, behind=-2.0))
    assert kinds(events) == ["top"]


@BOTH
def test_a_cusp_of_a_curve_of_folds(options):
    cusp = Test("cusp", lambda problem, points: points.xs[:, 0], bare=True)
    xs, events, _ = found_by(run_of(
        Formula(fold_curve, [FOLD, cusp]), (-1.0, -3.0, -2.0), stop=2.0, at=[0.25], options=options
    ))  # fmt: skip
    assert kinds(events) == ["cusp", "value"]
    assert events[0].point.xs[0] == pytest.approx(np.zeros(3), abs=1e-13)
    assert events[1].point.xs[0] == pytest.approx(np.array([0.5, -0.75, 0.25]), abs=1e-14)
    x = np.array(xs)[:, 0]
    assert np.array(xs) == pytest.approx(np.column_stack([x, -3 * x**2, 2 * x**3]), abs=1e-9)


@BOTH
def test_flips_of_the_logistic_map(options):
    """The fixed point flips at 3, the cycle of period two at 1 + sqrt(6)."""
    first = Test("flip", lambda problem, points: points.values * (1 - 2 * points.xs[:, 0]) + 1, bare=True)
    _, events, _ = found_by(run_of(Formula(fixed_point, [FOLD, first]), (0.5, 2.0), stop=4.0, options=options))
    assert places(events, "flip")[:, 1] == pytest.approx([3.0], rel=1e-14)
    second = Test("flip", lambda problem, p: p.values**2 * (1 - 2 * p.xs[:, 0]) * (1 - 2 * p.xs[:, 1]) + 1)
    r = 3.2
    both = (r + 1 + np.array([1, -1]) * np.sqrt((r - 3) * (r + 1))) / (2 * r)
    run = run_of(Formula(two_cycle, [FOLD, second]), (*both, r), stop=4.0, options=options)
    _, events, _ = found_by(run)
    assert places(events, "flip")[:, 2] == pytest.approx([1 + np.sqrt(6)], rel=1e-14)


@BOTH
def test_the_bound_of_a_program_enters_and_leaves(options):
    """The free minimum is (2 sin p, p); the bound x_0 <= 1 holds it between pi/6 and 5 pi/6."""
    xs, events, (end,) = found_by(run_of(Bounded(False), (0.0, 0.0, 0.0), stop=3.0, options=options))
    assert [(event.kind, event.point.values[0]) for event in events] == [
        ("limit", pytest.approx(np.pi / 6, abs=1e-13)), ("limit", pytest.approx(5 * np.pi / 6, abs=1e-13)),
    ]  # fmt: skip
    for x in xs:
        a, p = 2 * np.sin(x[-1]), x[-1]
        expected = [1.0, p - 0.5 * (1 - a), 1.5 * (a - 1), p] if len(x) == 4 else [a, p, p]
        assert x == pytest.approx(np.array(expected), abs=1e-9)
    assert {len(x) for x in xs} == {3, 4}
    assert (end.kind, xs[-1][-1]) == ("reached", 3.0)


def behind_the_corner(problem, lane, passed, error):
    """The other side of the corner at 0.3, up to which the points have come."""
    assert 0 < 0.3 - passed[-1].values[-1] < 1e-3
    return Start(problem, np.array([0.0, 0.3]), np.array([1.0, 1.0]))


@BOTH
def test_a_curve_goes_on_behind_a_corner(options):
    problem = Formula(corner, lost_at=behind_the_corner)
    xs, events, (end,) = found_by(run_of(problem, (0.5, -0.2), stop=1.0, at=[0.1, 0.5], options=options))
    values = np.array(xs)
    assert values[:, 0] == pytest.approx(abs(values[:, 1] - 0.3), abs=1e-15)
    assert [0.0, 0.3] in values.tolist()
    assert [event.point.values[0] for event in events] == [0.1, 0.5]
    assert (end.kind, values[-1, 1]) == ("reached", 1.0)


def test_problems_may_have_steps_of_their_own_and_go_on_at_known_points():
    """Each line is lost at its first rejected batch, where the next one, with other steps, goes on from the
    last point."""

    def refused_from(value, steps, follower=None):
        problem = Formula(line)
        problem.steps = steps
        problem.certify = lambda points: (
            points, {i: ValueError("refused") for i in np.flatnonzero(points.values > value)}
        )  # fmt: skip
        problem.lost = lambda lane, passed, error: Start.at(follower, passed[-1][-1:])
        return problem

    last = refused_from(np.inf, Steps(apart=0.125))
    middle = refused_from(0.1, Steps(apart=0.05, rejections=0), last)
    first = refused_from(0.1, Steps(apart=0.025, rejections=0), middle)
    xs, _, (end,) = found_by(run_of(first, (0.0, 0.0), stop=1.0))
    assert end.kind == "reached"
    values = np.array(xs)[:, 1]
    again = np.flatnonzero(np.diff(values) == 0)
    assert len(again) == 2
    assert np.diff(values[: again[0] + 1]).max() <= 0.025 * np.sqrt(2)
    assert 0.06 < np.diff(values[again[1] :]).max() <= 0.125


def line(lanes, x, p):
    """The line x = p."""
    return [x - p], [[np.ones_like(x), -np.ones_like(x)]]


def test_a_curve_that_goes_on_at_its_last_point_for_ever_is_stuck():
    problem = Formula(corner, lost_at=lambda problem, lane, passed, error: Start(
        problem, passed[-1].xs[-1], passed[-1].tangents[-1]
    ))  # fmt: skip
    _, _, (end,) = found_by(run_of(problem, (0.5, -0.2), stop=1.0, options=Steps(apart=np.inf, shortest=1e-3)))
    assert (end.kind, end.lane) == ("stuck", 0)
    assert "does not go on" in end.reason


@BOTH
def test_two_hundred_lanes_of_which_eighty_end_at_folds(options):
    lanes, constants = np.arange(200), parabola_constants(np.arange(200))
    problem = Formula(parabolas, [FOLD_ENDS])
    options = replace(options, longest=0.4, apart=min(0.1, options.apart) if options.divided else np.inf)
    run = run_of(problem, *np.column_stack([np.sqrt(constants), 0.0 * lanes]), stop=0.995, at=[0.15], options=options)
    xs, at, ends = {}, [], {}
    for item in run:
        if isinstance(item, Points):
            xs |= dict(zip(item.lanes.tolist(), item.xs.tolist(), strict=True))
        elif isinstance(item, Event):
            at += [item] if item.kind == "value" else []
        else:
            ends[item.lane] = item
    assert {lane for lane, end in ends.items() if end.kind == "fold"} == set(lanes[:80].tolist())
    assert [ends[lane].limit for lane in range(80)] == pytest.approx(constants[:80], abs=1e-13)
    assert [xs[lane] for lane in range(80, 200)] == pytest.approx(
        np.column_stack([np.sqrt(constants[80:] - 0.995), np.full(120, 0.995)]), abs=1e-14
    )
    assert sorted(int(event.point.lanes[0]) for event in at) == lanes.tolist()
    assert {event.point.values[0] for event in at} == {0.15}


def test_lanes_together_evaluate_no_more_points_than_alone():
    """A lane whose first steps are rejected does not make the others solve theirs again."""

    def curves(lanes, x, p):
        steep = np.tanh(40 * (p - 0.1))
        on = np.where(lanes == 1, steep, p)
        return [x - on], [[np.ones_like(x), -np.where(lanes == 1, 40 * (1 - steep**2), 1.0)]]

    options, counts = Steps(apart=np.inf, first=0.1, longest=1.0, moved=0.01), []
    for starts in ([0, 1], [0], [1]):
        problem = Formula(curves)
        first = run_of(problem, (0.0, 0.0), (np.tanh(-4.0), 0.0), stop=1.0, options=options).blocks[0]
        problem.points = 0
        ends = [item for item in follow(problem, first[starts], 1.0, options=options) if hasattr(item, "reason")]
        assert [end.kind for end in ends] == ["reached"] * len(starts)
        counts.append(problem.points)
    assert counts[0] == counts[1] + counts[2]


def test_a_test_that_asks_is_asked_at_each_point_and_ends_a_curve():
    test = Test("escaped", lambda problem, points: 0.5 - points.xs[:, 0], ASKS, bare=True)
    xs, events, (end,) = found_by(run_of(Formula(parabolas, [test]), (np.sqrt(0.2), 0.0), stop=-1.0, way=-1))
    assert (events, end.kind) == ([], "escaped")
    assert [x[0] > 0.5 for x in xs] == [False] * (len(xs) - 1) + [True]


@pytest.mark.parametrize("at", [(), (-3.0, 9.0)])
def test_folds_far_from_requested_values_are_not_located(at):
    """p = x/10 + sin(2 x)/2 folds twice in each wave; an accepted point takes about three evaluations."""

    def waves(lanes, x, p):
        return [0.1 * x + 0.5 * np.sin(2 * x) - p], [[0.1 + np.cos(2 * x), -1.0]]

    problem = Formula(waves)
    xs, _, (end,) = found_by(run_of(problem, (0.0, 0.0), stop=2.0, behind=-9.0, at=at, options=UNDIVIDED))
    assert end.kind == "reached"
    assert xs[-1][0] > 14
    assert problem.points < 3.5 * len(xs)


@BOTH
def test_values_and_bounds_are_met_on_both_sides_of_a_fold(options):
    """The circle passes 0.999999 twice, within a step round its top, and leaves downwards at the bound."""
    xs, events, (end,) = found_by(
        run_of(Formula(circle), (1.0, 0.0), stop=2.0, behind=-0.5, at=[0.999999, 0.2], options=options)
    )
    assert [event.point.values[0] for event in events] == [0.2, 0.999999, 0.999999, 0.2]
    for event in events:
        assert abs(event.point.xs[0, 0]) == pytest.approx(np.sqrt(1 - event.point.values[0] ** 2), abs=1e-13)
    assert end.kind == "reached"
    assert xs[-1] == pytest.approx(np.array([-np.sqrt(0.75), -0.5]), abs=1e-15)


@BOTH
def test_folds_far_from_bounds_and_requested_values_cost_nothing(options):
    counts = []
    for bound in (2.0, np.inf):
        problem = Formula(circle)
        found_by(run_of(problem, (1.0, 0.0), stop=bound, behind=-bound, at=[-7.0], options=options))
        counts.append(problem.points)
    assert counts[0] == counts[1]


def test_a_bound_beyond_which_the_curve_turns_ends_it():
    xs, _, (end,) = found_by(run_of(Formula(circle), (1.0, 0.0), stop=1 - 1e-7))
    assert end.kind == "reached"
    assert xs[-1] == pytest.approx(np.array([np.sqrt(1 - (1 - 1e-7) ** 2), 1 - 1e-7]), abs=1e-12)


def paused(run, pause):
    """The items of a run that is paused by a function after every batch."""
    items = list[object](run.blocks)
    while run.groups:
        items += run.advance()
        run = pause(run)
    return items


def bits(items):
    """All numbers of some items."""
    return [
        (item.lanes.tolist(), item.xs.tolist(), item.tangents.tolist()) if isinstance(item, Points)
        else (item.kind, item.point.xs.tolist(), item.after) if isinstance(item, Event)
        else (item.kind, item.reason, item.lane)
        for item in items
    ]  # fmt: skip


CASES = {
    "circle": lambda: run_of(
        Formula(circle, [FOLD, BRANCH]), (1.0, 0.0), stop=2.0, behind=-2.0, at=[0.5], options=Steps(batch=7)
    ),
    "program": lambda: run_of(Bounded(False), (0.0, 0.0, 0.0), stop=3.0, options=UNDIVIDED),
    "corner": lambda: run_of(Formula(corner, lost_at=behind_the_corner), (0.5, -0.2), stop=1.0),
    "lanes": lambda: run_of(
        Formula(parabolas, [FOLD_ENDS]), (np.sqrt(0.2), 0.0), (np.sqrt(0.21), 0.0), stop=0.205, options=UNDIVIDED
    ),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("pause", [copy.deepcopy, lambda run: pickle.loads(pickle.dumps(run))], ids=["copy", "pickle"])
def test_a_paused_run_goes_on_bit_for_bit(case, pause):
    assert bits(paused(CASES[case](), pause)) == bits(CASES[case]())


@pytest.mark.parametrize("case", CASES)
def test_a_run_that_is_interrupted_within_a_batch_goes_on_bit_for_bit(case, monkeypatch):
    class Interrupted(Exception):
        pass

    run, whole, count = CASES[case](), bits(CASES[case]()), 0
    kind, items = type(run.groups[0].problem), [*run.blocks]
    own = kind.evaluate

    def evaluate(self, *args):
        nonlocal count
        count += 1
        if count in (3, 20, 50, 51):
            raise Interrupted
        return own(self, *args)

    monkeypatch.setattr(kind, "evaluate", evaluate)
    while run.groups:
        with contextlib.suppress(Interrupted):
            items += run.advance()
    assert count > 51
    assert bits(items) == whole


def test_a_run_is_resumed_from_its_points():
    """With the points before and the length of the next step it goes on as it would have, and it knows its
    beginning."""
    options = UNDIVIDED
    whole = run_of(Formula(circle, [FOLD]), (1.0, 0.0), stop=2.0, behind=-2.0, options=options)
    for _ in range(30):
        whole.advance()
    blocks, length = [*whole.blocks], whole.progress.length.copy()
    resumed = type(whole)(
        Formula(circle, [FOLD]), blocks[-1], 2.0, behind=-2.0, earlier=blocks[:-1], lengths=length, options=options
    )
    (first, *others), (begun, *rest) = list(resumed), whole
    assert first is blocks[-1]
    assert begun is blocks[0]
    assert bits(others) == bits(rest)
    assert others[-1].kind == "closed"


def test_a_run_heeds_the_time_limit():
    from orbits.errors import NoOrbit
    from orbits.running.time_limit import time_limit

    run = run_of(Formula(circle), (1.0, 0.0), stop=2.0, behind=-2.0)
    with pytest.raises(NoOrbit, match="it takes more than"), time_limit(1e-9):
        list(run)
    assert bits(run) == bits(run_of(Formula(circle), (1.0, 0.0), stop=2.0, behind=-2.0))[1:]


def test_a_curve_ends_after_its_largest_number_of_points_and_where_it_is_lost():
    _, _, (end,) = found_by(run_of(Formula(circle), (1.0, 0.0), stop=2.0, options=Steps(most=20, batch=5)))
    assert end.kind == "stopped"
    xs, _, (end,) = found_by(run_of(Formula(circle), (1.0, 0.0), stop=0.5, options=Steps(most=20)))
    assert (len(xs), end.kind) == (20, "stopped")  # although its batch has got to the bound
    xs, _, (end,) = found_by(run_of(Formula(corner), (0.5, -0.2), stop=1.0))
    assert (end.kind, end.reason[:30]) == ("stuck", "no point is found in a step of")
    assert 0 < 0.3 - xs[-1][1] < 1e-3


def test_what_cannot_be_run_is_refused():
    first = run_of(Formula(circle), (1.0, 0.0), (1.0, 0.0), stop=2.0).blocks[0]
    with pytest.raises(InputError, match="in their order"):
        follow(Formula(circle), first[[1, 0]], 2.0)
    with pytest.raises(InputError, match="different numbers"):
        follow(Formula(circle), first, 0.0)
    with pytest.raises(InputError, match="different numbers"):
        follow(Formula(circle), first, np.nan)
    with pytest.raises(InputError, match="at = nan is not a finite number"):
        follow(Formula(circle), first, 2.0, at=[np.nan])
    with pytest.raises(InputError, match="finite numbers"):
        run_of(Formula(circle), (np.nan, 0.0), stop=1.0)
    assert found_by(run_of(Formula(circle), (0.0, 3.0), stop=4.0)) == ([], [], [])


def test_a_run_is_resumed_behind_a_change_of_its_problem():
    """The points before the bound entered have fewer unknowns, and give no predictions behind it."""
    whole, problem = run_of(Bounded(False), (0.0, 0.0, 0.0), stop=3.0, options=UNDIVIDED), Bounded(True)
    while whole.groups[-1].problem.active is False:
        whole.advance()
    for _ in range(5):
        whole.advance()
    *earlier, last = whole.blocks
    resumed = follow(problem, last, 3.0, behind=0.0, earlier=earlier, options=UNDIVIDED)
    events = [item.point.values[0] for item in resumed if isinstance(item, Event)]
    assert events == [pytest.approx(5 * np.pi / 6, abs=1e-13)]


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


@BOTH
def test_each_change_of_a_label_is_an_event(options):
    number = Test("number", lambda _, points: np.floor(5 * points.values), bare=True, places=15)
    _, events, _ = found_by(run_of(Formula(circle, [number]), (1.0, 0.05), stop=0.95, options=options))
    assert places(events, "number")[:, 1] == pytest.approx([0.2, 0.4, 0.6, 0.8], abs=1e-12)


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


def test_rounding_that_a_problem_expects_ends_newtons_method():
    class Noisy(Formula):
        rounded = 0.0

        def rounding(self, evaluation, rows):
            return np.full(rows.shape, self.rounded)

    def noisy(lanes, x, p):
        return [x - p + 3e-8 * np.sin(1e12 * x)], [[np.ones_like(x), -1.0]]

    lanes, places_, border = (
        np.zeros(5, int),
        np.linspace(0.1, 0.9, 5),
        Border.of_component(1, np.linspace(0.1, 0.9, 5), 2),
    )
    guesses = np.column_stack([places_ + 1e-3, places_])
    exact, expected = Noisy(noisy), Noisy(noisy)
    expected.rounded = 1e-8
    assert len(correct(exact, lanes, guesses, border, border.rows, Steps())[0]) < 5
    which, points = correct(expected, lanes, guesses, border, border.rows, Steps())
    assert which.tolist() == [0, 1, 2, 3, 4]
    assert points.xs[:, 0] == pytest.approx(places_, abs=1e-7)


def test_a_curve_closes_behind_a_change_of_its_problem():
    """A circle whose problem has another unknown from a point on; by the two that both have it is seen to close."""

    class Lifted(Formula):
        shared = np.array([0, 2])

    def lifted(lanes, x, y, p):
        return [x * x + p * p - 1, y - 2 * x], [[2 * x, 0.0, 2 * p], [-2.0, 1.0, 0.0]]

    class Flat(Formula):
        shared = np.array([0, 1])

        def changed(self, event, passed):
            (x, p), (u, q) = event.point.xs[0], event.point.tangents[0]
            return Start(Lifted(lifted), np.array([x, 2 * x, p]), np.array([u, 2 * u, q]))

    half = Test("half", lambda _, points: points.xs[:, 0] - 0.5, CHANGES, bare=True)
    xs, _, (end,) = found_by(run_of(Flat(circle, [half]), (1.0, 0.0), stop=2.0, behind=-2.0))
    assert end.kind == "closed"
    assert len(xs[-1]) == 3
    assert xs[-1][[0, 2]] == pytest.approx([1.0, 0.0], abs=1e-9)


def test_no_batch_goes_far_beyond_a_bound():
    """A step that ends beyond it is the last of its batch, however many more this may have."""
    bent = lambda lanes, x, p: ([x - p + 1e-3 * p * p], [[np.ones_like(x), -1.0 + 2e-3 * p]])  # noqa: E731
    problem = Formula(bent)
    found_by(run_of(problem, (-1.0, -1.0), stop=1.0))
    assert problem.points < 1000


def test_a_batch_ends_where_small_changes_grow():
    """Beyond p = 0.2 they grow much, and no point is certified."""

    class Grown(Values):
        @property
        def amplification(self):
            return np.where(self.jacobian[:, 0, 1] < 0.4, 1.0, 1e6)  # 2 p

    class Growing(Formula):
        def evaluate(self, *arguments):
            which, found = super().evaluate(*arguments)
            return which, Grown(found.residual, found.jacobian)

        def certify(self, points):
            return points, {i: ValueError("unknown") for i in np.flatnonzero(points.values > 0.2).tolist()}

    sizes = []
    for grown in (10.0, np.inf):
        problem = Growing(circle)
        _, _, (end,) = found_by(run_of(problem, (1.0, 0.0), stop=0.95, options=Steps(grown=grown)))
        assert (end.kind, end.reason) == ("stuck", "unknown")
        sizes.append(problem.points)
    assert sizes[0] < 0.8 * sizes[1]


def test_a_step_passes_a_bound_at_which_the_equations_are_singular():
    """F = x**3 - p**3 has no derivatives at p = 0, where the curve x = p ends."""

    def cubes(lanes, x, p):
        return [x**3 - p**3], [[3 * x * x, -3 * p * p]]

    xs, _, (end,) = found_by(run_of(Formula(cubes), (-1.0, -1.0), stop=0.0))
    assert (end.kind, len(xs) < 200) == ("reached", True)


@BOTH
def test_an_event_at_the_end_of_a_curve_is_located(options):
    last = Test("last", lambda _, points: points.values - 0.5, bare=True)
    _, (event,), (end,) = found_by(run_of(Formula(circle, [last]), (1.0, 0.0), stop=0.5, options=options))
    assert (event.point.values[0], end.kind) == (0.5, "reached")


def test_a_curve_that_begins_at_a_bound_and_leaves_it_has_ended():
    problem = Formula(circle)
    first = started(problem, np.array([[0.6, 0.8]]), Steps())
    items = [*follow(problem, first, 0.8, behind=-2.0)]
    assert [type(item) for item in items] == [Points, End]
    assert items[-1].kind == "reached"


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


def test_points_before_a_bound_that_is_not_found_stay():
    """The reason is that of the problem, as for any curve that is lost."""

    class Open(Formula):
        def certify(self, points):
            return points, {i: ValueError("a gap") for i in np.flatnonzero(abs(points.values - 0.504) < 2e-3).tolist()}

    xs, _, (end,) = found_by(run_of(Open(line), (0.0, 0.0), stop=0.504))
    assert (end.kind, end.reason) == ("stuck", "a gap")
    assert xs[-1][1] > 0.5


def test_a_lane_that_goes_on_outlives_a_later_point_of_its_batch_that_is_refused():
    """Lane 0 goes on at 0.3 with the other half of the line, and its point beyond 0.4 in the same batch is refused."""

    class Half(Formula):
        changed_at = 0.3

        def certify(self, points):
            wrong = (points.lanes == 0) & (points.values > 0.4) & (points.values < 0.6) & (self.changed_at < 1)
            return points, {i: ValueError("refused") for i in np.flatnonzero(wrong).tolist()}

        def changed(self, event, passed):
            self.changed_at = 1.0
            return Start.at(self, event.point)

    half = Test("half", lambda problem, points: points.values - 0.3, CHANGES, bare=True)
    problem = Half(line, [half])
    _, _, ends = found_by(run_of(problem, (0.0, 0.0), (0.1, 0.1), stop=1.0))
    assert [end.kind for end in ends] == ["reached", "reached"]


def test_what_is_known_of_other_points_does_not_serve():
    """Lane 0 settles at once, lane 1 later, and lane 2 never: the equations known last are those of lanes 1 and 2."""

    class Chords(Formula):
        chords = True

        def evaluate(self, lanes, xs, known=None, moved=None):
            assert known is None or len(known.residual) == len(xs)
            if known is not None and (moved == 0).all():
                assert known.residual[:, 0] == pytest.approx(self.function(lanes, *xs.T)[0][0], abs=1e-6)
            return super().evaluate(lanes, xs)

    def lanes_of(lanes, x, p):
        power = np.where(lanes == 2, 0.3, 1.0) + np.where(lanes == 1, 1.0, 0.0)
        return [np.abs(x) ** power - p**power + 0 * lanes], [
            [power * np.abs(x) ** (power - 1), -power * p ** (power - 1)]
        ]

    p = np.array([0.5, 0.5, 0.5])
    guesses = np.column_stack([[0.5, 0.52, 30.0], p])
    border = Border.of_component(1, p, 2)
    which, points = correct(Chords(lanes_of), np.arange(3), guesses, border, border.rows, Steps())
    assert points.xs[:, 0] == pytest.approx(np.full(len(which), 0.5), abs=1e-12)
    assert {0, 1} <= {*which.tolist()}
