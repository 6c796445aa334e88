"""The location of events on curves in closed form."""

import numpy as np
import pytest
from plane_curves import Formula, circle, found_by, run_of

from orbits.curves import CHANGES, Border, Steps, Test, solved_at

DEFAULT = Steps()
LINE = ((0.0, -1.0), {"stop": 1.0})


def line(lanes, x, p):
    """The line x = p."""
    return [x - p], [[np.ones_like(x), -1.0]]


def events_of(*tests, options=DEFAULT, certify=None, function=line, start=LINE[0], **bounds):
    problem = Formula(function, tests)
    if certify:
        problem.certify = certify
    _, events, _ = found_by(run_of(problem, start, options=options, **(bounds or LINE[1])))
    return [(event.kind, event.which, event.point.values[0]) for event in events], problem


START = (-1.0, -1.0)


def test_functions_of_a_test_are_located_one_by_one_in_order():
    test = Test("zero", lambda problem, p: np.exp(p.values)[:, None] - np.exp([0.3, -0.5, 0.301]), bare=True)
    events, _ = events_of(test, start=START)
    assert events == [("zero", i, pytest.approx(value, abs=1e-13)) for i, value in ((1, -0.5), (0, 0.3), (2, 0.301))]


def test_functions_without_a_value_and_poles_are_no_events():
    nowhere = Test("none", lambda problem, p: np.where(p.values < 0.1, np.nan, p.values - 0.1), bare=True)
    pole = Test("pole", lambda problem, p: 1 / (p.values - 0.123), bare=True)
    assert events_of(nowhere, pole, start=START)[0] == []


def test_the_gradient_of_a_test_saves_the_search():
    def value(problem, points):
        return points.xs[:, 0] - 0.25

    def gradient(problem, xs, evaluation, number):
        return xs[:, 0] - 0.25, np.tile([1.0, 0.0], (len(xs), 1))

    circles = {"function": circle, "start": (1.0, 0.0), "stop": 2.0, "behind": -2.0}
    expected = [("low", 0, pytest.approx(sign * np.sqrt(15) / 4, abs=1e-14)) for sign in (1, -1)]
    events, at_once = events_of(Test("low", value, gradient=gradient), **circles)
    assert events == expected
    events, searched = events_of(Test("low", value), **circles)
    assert events == expected
    events, unknown = events_of(Test("low", value, gradient=lambda *args: None), **circles)
    assert events == expected
    assert at_once.calls < searched.calls <= unknown.calls


def test_a_curve_is_lost_before_an_event_that_cannot_be_located():
    """No point between 0.203 and 0.207 is certified: the event at 0.205 is none at another place."""

    def certify(points):
        return points, {i: ValueError() for i, value in enumerate(points.values) if 0.203 < value < 0.207}

    options = Steps(apart=np.inf, longest=0.02, first=0.02, lengthen=1.0, safety=1.0)
    problem = Formula(line, [Test("zero", lambda problem, p: p.values - 0.205)])
    problem.certify = certify
    xs, events, (end,) = found_by(run_of(problem, START, stop=1.0, options=options))
    assert (events, end.kind) == ([], "stuck")
    assert 0.2 < xs[-1][1] < 0.203


def test_a_change_that_leads_nowhere_leaves_the_curve_as_it_was():
    problem = Formula(line, [Test("change", lambda problem, p: p.values - 0.25, CHANGES, bare=True)])
    problem.changed = lambda event, passed: None
    xs, events, (end,) = found_by(run_of(problem, START, stop=1.0))
    assert (len(events), end.kind) == (1, "reached")
    assert [x[1] for x in xs].count(events[0].point.values[0]) == 1


def test_points_are_solved_at_a_component_and_certified():
    """Of the circle at x = 0.6 and 0.8 and at 1.2, where there is none; the second one is refused."""
    problem = Formula(circle)
    problem.certify = lambda points: (points.having(own=points.lanes), {1: ValueError("refused")})
    border = Border.of_component(0, np.array([0.6, 0.8, 1.2]), 2)
    xs, onward = np.array([[0.5, 0.5]] * 3), np.array([[-1.0, 0.0]] * 3)
    points = solved_at(problem, np.arange(3), xs, border, onward, DEFAULT)
    assert points.own.tolist() == [0]
    assert points.xs[0] == pytest.approx([0.6, 0.8], abs=1e-15)
    assert points.tangents[0] == pytest.approx([-0.8, 0.6], abs=1e-8)
