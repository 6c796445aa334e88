"""Families whose lift-off passes a corner of the law, against closed forms of flights with piecewise linear springs."""

from math import asin, inf, pi, sqrt

import casadi as ca
import pytest
from scipy.optimize import brentq

from orbits import find, follow, follow_event
from problems import Hopper, hopper_in_si, springs

# Pieces of a law are (low, high, stiffness k, centre c), where the force is k (r - c).


def bilinear(gap, ratio):
    return [(-inf, gap, 1.0, 0.0), (gap, inf, ratio, gap - gap / ratio)]


def end_stops(gap, stop):
    return [
        (-inf, -gap, stop, -gap + gap / stop),
        (-gap, gap, 1.0, 0.0),
        (gap, inf, stop, gap - gap / stop),
    ]


def turn_times(pieces, alpha, turns):
    """The time to a turn of the extension from lift-off, where the force is 1, by harmonic arcs."""
    i, r = next((i, 1 / k + c) for i, (low, high, k, c) in enumerate(pieces) if low <= 1 / k + c < high)
    square, side, time = alpha**2, 1, 0.0
    while True:
        low, high, k, c = pieces[i]
        reach = sqrt(square / k + (r - c) ** 2)
        end = high if side > 0 else low
        turns_here = reach <= side * (end - c)
        begin = -pi / 2 if square == 0 else asin(side * (r - c) / reach)
        time += ((pi / 2 if turns_here else asin(side * (end - c) / reach)) - begin) / sqrt(k)
        if turns_here:
            square, r, side, turns = 0.0, c + side * reach, -side, turns - 1
            if not turns:
                return time
        else:
            square, r, i = square - k * ((end - c) ** 2 - (r - c) ** 2), end, i + side


def true_alpha(pieces, near, family):
    """The launch speed whose half flight, in units of the launch speed, ends with the turn of a family."""
    return brentq(lambda alpha: turn_times(pieces, alpha, family + 1) - alpha, near - 1e-6, near + 1e-6, xtol=1e-14)


def check(family, pieces, number=1):
    """Every point lies within its error of the closed form, and lift-off passes the corner at r = 1."""
    for point in family:
        assert abs(point.alpha - true_alpha(pieces(point), point.alpha, number)) < point.error + 1e-14
    assert [event.kind for event in family.events] == ["corner"]
    corner = family.events[0].point
    assert corner.liftoff_extension == pytest.approx(1.0, abs=1e-14)
    assert corner.alpha == pytest.approx(true_alpha(pieces(corner), corner.alpha, number), abs=1e-13)
    assert family.end.kind == "reached"


@pytest.mark.parametrize(("ratio", "number"), [(4.0, 1), (0.25, 2), (20.0, 3)])
def test_a_second_spring_engages_before_lift_off_and_after_it(ratio, number):
    machine = Hopper(springs.bilinear(gap=0.5, ratio=ratio), rest_length=60, mass_ratio=1.5)
    family = follow(machine, "gap", 1.5, family=number)
    check(family, lambda point: bilinear(point.value, ratio), number)
    assert family.events[0].point.value == pytest.approx(1.0, abs=1e-14)


def test_end_stops_move_past_lift_off():
    machine = Hopper(springs.end_stops(gap=0.6, stop=20.0), rest_length=30, mass_ratio=1.5)
    check(follow(machine, "gap", 3.0), lambda point: end_stops(point.value, 20.0))


def test_a_gap_that_is_tuned_moves_past_lift_off():
    machine = Hopper(springs.bilinear(gap=1.2, ratio=4.0), rest_length=60)
    family = follow(machine, "alpha", 3.2, tune="gap")
    check(family, lambda point: bilinear(point.also["gap"], 4.0))


@pytest.mark.parametrize("stop", [0.8, 1.25])
def test_a_family_begins_at_a_corner(stop):
    machine = Hopper(springs.bilinear(gap=1.0, ratio=4.0), rest_length=60)
    family = follow(machine, "gap", stop)
    assert (family.end.kind, family.events) == ("reached", ())
    for point in family:
        true = true_alpha(bilinear(point.value, 4.0), point.alpha, 1)
        assert abs(point.alpha - true) < point.error + 1e-14


def test_lift_off_in_si_passes_a_second_spring():
    """The foot's weight reaches the force at 2 mm, of which the formula of a function says nothing but the place."""
    force = springs.function(lambda r: ca.if_else(r < 0.002, 8e3 * r, 16 + 3.8e4 * (r - 0.002)), breakpoints=(0.002,))
    machine = hopper_in_si(60.0, 1.4, force=force, rest_length=0.8)
    family = follow(machine, "foot_mass", 2.0)
    (corner,) = family.events
    assert (corner.kind, corner.point.value) == ("corner", pytest.approx(16 / 9.80665, rel=1e-13))
    assert corner.point.liftoff_extension == pytest.approx(0.002, rel=1e-13)
    assert family.end.kind == "reached"
    beside = find(machine.with_values(foot_mass=2.0))
    assert family[-1].alpha == pytest.approx(beside.alpha, abs=family[-1].error + beside.error)


def test_a_curve_of_events_passes_a_corner():
    """Masses touch where the rest length is the deepest compression d < 0 of the contact r'' = -M f(r) - 1, by its
    energy M d**2/2 + d."""
    ratio = 1.5
    machine = Hopper(springs.bilinear(gap=0.8, ratio=4.0), rest_length=12, mass_ratio=ratio)
    family = follow(machine, "rest_length", 3.0)
    curve = follow_event(family, "masses touch", "gap", 1.3)
    assert [event.kind for event in curve.events] == ["corner"]
    assert curve.events[0].point.value == pytest.approx(1.0, abs=1e-13)
    assert curve.end.kind == "reached"
    for point in curve:
        liftoff = min(1.0, point.value + (1 - point.value) / 4)
        stored = liftoff**2 / 2 + 1.5 * max(liftoff - point.value, 0) ** 2
        energy = point.alpha**2 * (1 + ratio) / 2 + ratio * stored + liftoff
        deepest = -(1 + sqrt(1 + 2 * ratio * energy)) / ratio
        assert point.also["rest_length"] == pytest.approx(-deepest, abs=1e-12)
