"""How curves of orbits end: at a bound, closed, lost, or escaped to a limit that is known."""

import numpy as np
import pytest
from conftest import slow_after
from families import FOLD, FOLD_ALPHA, events

from orbits import InputError, NoOrbit, follow
from problems import Hopper


@pytest.mark.parametrize("family", slow_after(2, [1, 4, 2, 3]))
def test_the_saturating_spring_runs_off_to_its_limit(family):
    curve = follow(Hopper("tanh"), "b", 0.9, 0.05, family)
    assert curve.end.kind == "escaped"
    assert curve.end.limit == pytest.approx(1 / (2 * family + 1), abs=1e-6)
    assert {point.family for point in curve} == {family}


def test_no_first_orbit_is_said_and_a_lost_curve_keeps_what_it_has():
    with pytest.raises(NoOrbit, match="does not come back"):
        follow(Hopper("cubic"), "beta", 0.0, -0.1)
    family = follow(Hopper("r"), "mass_ratio", -1.0)
    assert family.end.kind == "degenerate"
    assert family.end.reason.startswith("there is no such machine any more at mass_ratio = ")
    assert len(family.end.reason) <= 300
    assert len(family) > 10


def test_an_isola_closes():
    """With b = fold + d - q**2 the two sheets are joined at both ends of q**2 = d: fold, fold, and the start again."""
    machine = Hopper("r + (b - q**2)*r**3", rest_length=30.0, parameters={"b": FOLD + 4e-4, "q": 0.0})
    family = follow(machine, "q", (-0.1, 0.1))
    assert family.end.kind == "closed"
    assert [fold.value for fold in events(family, "fold")] == pytest.approx([0.02, -0.02], abs=1e-9)
    assert [fold.alpha for fold in events(family, "fold")] == pytest.approx([FOLD_ALPHA] * 2, abs=1e-6)
    assert family[-1].u == pytest.approx(family[0].u, rel=1e-9)
    assert follow(machine, "q", 0.1).end.reason == "q = 0 again, on another sheet"
    for start, bounds in ((0.0, (0.05, 0.1)), (0.5, (-1.0, -0.2)), (0.5, (-0.2, -1.0)), (-0.5, (0.2, 1.0))):
        with pytest.raises(InputError, match="does not lie between"):
            follow(machine, "q", bounds, start=start)


@pytest.mark.parametrize(
    ("before", "longest"),
    slow_after(3, [(1e-3, 0.02), (1e-9, 0.02), (1e-7, 0.011), (1e-3, 0.011), (1e-7, 0.02), (1e-9, 0.011)]),
)
def test_a_stop_beside_a_fold_is_not_passed_over(before, longest):
    stop = FOLD + before * abs(FOLD)
    family = follow(Hopper("cubic"), "beta", stop, 0.0, longest=longest)
    assert family.end.kind == "reached"
    assert family[-1].value == stop
    assert family[-1].alpha < FOLD_ALPHA
    assert not events(family, "fold")


@pytest.mark.parametrize(
    ("machine", "along", "stop", "limit"),
    [  # the tide's frequencies as 3 to 1; the barrier of r + c r^2 at -1/c; the softening cubic's family ends at 0
        (Hopper("r", "1 + a*z", rest_length=2.0, parameters={"a": 0.0}), "a", 3.0, 0.25),
        (Hopper("r + c*r**2", parameters={"c": 0.0}), "c", 1.0, 0.0),
        (Hopper("cubic", rest_length=30.0, parameters={"beta": 0.0}), "beta", -0.02, 0.0),
        (Hopper("toda", parameters={"b": 0.01}), "b", 0.9, 0.5),
    ],
)
def test_a_limit_is_as_good_as_it_says(machine, along, stop, limit):
    family = follow(machine, along, stop)
    end = family.end
    assert end.kind == "escaped"
    assert abs(end.limit - limit) <= 2 * end.limit_error
    assert end.limit_error < 2e-3
    # Rounding moves mid-flight, and no stationary point of the extension appears beside it.
    assert "family" not in [event.kind for event in family.events]


def test_what_only_scales_the_orbit_is_followed_to_the_end():
    family = follow(Hopper("k*r", parameters={"k": 1.0}), "k", 1e-3)
    assert family.end.kind == "reached"
    assert family[-1].alpha == pytest.approx(4.493409457909064 / np.sqrt(1e-3), rel=1e-12)


@pytest.mark.parametrize("beside", [1e-4, 1e-6, 1e-8, 1e-9])
def test_a_start_beside_a_fold_comes_back_on_the_other_sheet(beside):
    family = follow(Hopper("cubic", rest_length=30.0), "beta", -0.02, FOLD + beside)
    assert family[0].alpha < FOLD_ALPHA < family[-1].alpha
    assert family[-1].value == FOLD + beside
    assert [event.kind for event in family.events] == ["fold"]
    assert family.end.reason.endswith("on another sheet")


def test_a_stop_at_the_edge_of_a_law_is_reached():
    family = follow(Hopper("r + c**1.5*r**3", parameters={"c": 1.0}), "c", 0.0)
    assert family.end.kind == "reached"
    assert family[-1].alpha == pytest.approx(4.493409457909064, rel=1e-13)


def test_asked_values_on_a_closed_curve():
    """The start among them, which is none to come to; the others on both sheets."""
    isola = Hopper("r + (b - q**2)*r**3", rest_length=30.0, parameters={"b": FOLD + 4e-4, "q": 0.0})
    family = follow(isola, "q", (-0.1, 0.1), at=[0.0, 0.01, -0.01], most=600)
    assert family.end.kind == "closed"
    assert sorted(point.value for point in events(family, "asked")) == [-0.01, -0.01, 0.0, 0.01, 0.01]
