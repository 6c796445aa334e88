"""Exact places of curves in closed form: requested values, bounds, and the first point."""

import numpy as np
import pytest
from plane_curves import BOTH, Formula, circle, found_by, run_of

from orbits.curves import CHANGES, Start, Test


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


def test_a_bound_beyond_which_the_curve_turns_ends_it():
    xs, _, (end,) = found_by(run_of(Formula(circle), (1.0, 0.0), stop=1 - 1e-7))
    assert end.kind == "reached"
    assert xs[-1] == pytest.approx(np.array([np.sqrt(1 - (1 - 1e-7) ** 2), 1 - 1e-7]), abs=1e-12)


@BOTH
def test_an_event_at_the_end_of_a_curve_is_located(options):
    last = Test("last", lambda _, points: points.values - 0.5, bare=True)
    _, (event,), (end,) = found_by(run_of(Formula(circle, [last]), (1.0, 0.0), stop=0.5, options=options))
    assert (event.point.values[0], end.kind) == (0.5, "reached")


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
