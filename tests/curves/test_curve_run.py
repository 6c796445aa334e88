"""Runs along curves in closed form: points, events, ends, pauses."""

import contextlib
import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from plane_curves import (
    BOTH,
    UNDIVIDED,
    Bounded,
    Formula,
    circle,
    corner,
    fixed_point,
    fold_curve,
    found_by,
    kinds,
    lemniscate,
    parabola_constants,
    parabolas,
    pitchfork,
    places,
    run_of,
    transcritical,
    two_cycle,
)

from orbits.curves import ASKS, BRANCH, CHANGES, FOLD, End, Event, Points, Run, Start, Steps, Test, started
from orbits.errors import InputError

FOLD_ENDS = Test("fold", FOLD.values, CHANGES, bare=True)


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


def test_a_curve_that_goes_on_at_its_last_point_for_ever_is_stuck():
    problem = Formula(corner, lost_at=lambda problem, lane, passed, error: Start(
        problem, passed[-1].xs[-1], passed[-1].tangents[-1]
    ))  # fmt: skip
    _, _, (end,) = found_by(run_of(problem, (0.5, -0.2), stop=1.0, options=Steps(apart=np.inf, shortest=1e-3)))
    assert (end.kind, end.lane) == ("stuck", 0)
    assert "does not continue" in end.reason


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


def test_a_test_that_asks_is_asked_at_each_point_and_ends_a_curve():
    test = Test("escaped", lambda problem, points: 0.5 - points.xs[:, 0], ASKS, bare=True)
    xs, events, (end,) = found_by(run_of(Formula(parabolas, [test]), (np.sqrt(0.2), 0.0), stop=-1.0, way=-1))
    assert (events, end.kind) == ([], "escaped")
    assert [x[0] > 0.5 for x in xs] == [False] * (len(xs) - 1) + [True]


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
    from orbits.running import time_limit

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
    assert (end.kind, end.reason[:31]) == ("stuck", "no point of the curve is found ")
    assert 0 < 0.3 - xs[-1][1] < 1e-3


def test_what_cannot_be_run_is_refused():
    first = run_of(Formula(circle), (1.0, 0.0), (1.0, 0.0), stop=2.0).blocks[0]
    with pytest.raises(InputError, match="in their order"):
        Run(Formula(circle), first[[1, 0]], 2.0)
    with pytest.raises(InputError, match="its bounds must differ"):
        Run(Formula(circle), first, 0.0)
    with pytest.raises(InputError, match="its bounds must differ"):
        Run(Formula(circle), first, np.nan)
    with pytest.raises(InputError, match="at = nan is not a finite number"):
        Run(Formula(circle), first, 2.0, at=[np.nan])
    with pytest.raises(InputError, match="finite numbers"):
        run_of(Formula(circle), (np.nan, 0.0), stop=1.0)
    assert found_by(run_of(Formula(circle), (0.0, 3.0), stop=4.0)) == ([], [], [])


@BOTH
def test_each_change_of_a_label_is_an_event(options):
    number = Test("number", lambda _, points: np.floor(5 * points.values), bare=True, places=15)
    _, events, _ = found_by(run_of(Formula(circle, [number]), (1.0, 0.05), stop=0.95, options=options))
    assert places(events, "number")[:, 1] == pytest.approx([0.2, 0.4, 0.6, 0.8], abs=1e-12)


def test_a_curve_that_begins_at_a_bound_and_leaves_it_has_ended():
    problem = Formula(circle)
    first = started(problem, np.array([[0.6, 0.8]]), Steps())
    items = [*Run(problem, first, 0.8, behind=-2.0)]
    assert [type(item) for item in items] == [Points, End]
    assert items[-1].kind == "reached"
