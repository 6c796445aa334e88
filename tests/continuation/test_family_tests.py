"""Events along a curve of orbits: located where closed forms say, the user's own among them, and each once."""

import numpy as np
import pytest
from families import FOLD, FOLD_ALPHA, events

from orbits import find, follow
from problems import Hopper
from problems.laws import springs


def test_the_collapse_in_contact_is_where_the_energy_is_that_of_the_barrier(softening_family):
    """Just above it the contact takes ever longer, below it there is none: energy equals that of the unstable rest."""
    (point,) = events(softening_family, "collapse")
    b, rho = point.value, point.liftoff_extension
    total = lambda r: r**2 / 2 + b * r**4 / 4 + r  # noqa: E731 - M = 1: kinetic energy v^2 beside it
    roots = np.roots([b, 0, 1, 1])
    top = min(root.real for root in roots if abs(root.imag) < 1e-12)
    assert point.alpha**2 + total(rho) == pytest.approx(total(top), rel=1e-10)
    before = softening_family[softening_family.events[1].after]
    assert before.admissible
    assert not softening_family[softening_family.events[1].after + 1].admissible


def test_masses_that_touch_are_located_and_the_curve_goes_on():
    machine = Hopper("toda", rest_length=30.0)
    family = follow(machine, "b", -0.6, -0.01)
    (touch,) = events(family, "masses touch")
    assert abs(touch.certificate.smallest_separation) < 1e-12
    assert family[-1].value == -0.6
    assert "masses pass" in family[-1].certificate.violations[0]
    short = follow(machine, "b", -0.6, -0.01, stop_inadmissible=True)
    assert short.end.kind == "stopped"
    assert "masses pass" in short.end.reason
    assert [point.admissible for point in short] == [True] * (len(short) - 1) + [False]


@pytest.mark.slow
def test_a_table_that_ends_is_no_collapse():
    """In contact the hop of a light foot leaves the table."""
    rows = np.linspace(-6.0, 5.0, 12)
    table = Hopper(springs.table((rows, rows), noise=0), mass_ratio=1.0, rest_length=9.0)
    (event,) = follow(table, "mass_ratio", 4.0).events
    assert event.kind == "law ends"
    (reason,) = find(table.with_values(mass_ratio=event.point.value - 1e-9)).violations
    assert "leaves the law's range, [-6, 5]" in reason
    assert find(table.with_values(mass_ratio=event.point.value + 1e-9)).admissible


@pytest.mark.slow
def test_values_beside_a_fold_are_hit_twice():
    value = FOLD + 1e-12
    family = follow(Hopper("cubic"), "beta", -0.02, -0.009, at=[value])
    first, second = family.at(value)
    assert first.alpha < FOLD_ALPHA < second.alpha
    assert family.end.reason.endswith("on another sheet")


@pytest.mark.slow
def test_the_users_own_numbers_truths_and_poles_and_orbits_without_what_is_watched():
    watch = {
        "three": lambda orbit: orbit.alpha - 3.0,
        "fast": lambda orbit: orbit.alpha > 3.1,
        "pole": lambda orbit: 1.0 / (orbit.alpha - 3.5),
        "period": lambda orbit: orbit.period - 1000.0,  # none beyond the collapse
    }
    family = follow(Hopper("cubic"), "beta", 0.5, 0.1, watch=watch)
    assert [event.kind for event in family.events] == ["fast", "three"]
    fast, three = (event.point for event in family.events)
    assert fast.alpha == pytest.approx(3.1, rel=1e-11)
    assert three.alpha == pytest.approx(3.0, rel=1e-14)
    assert find(Hopper("cubic", parameters={"beta": three.value})).alpha == pytest.approx(3.0, rel=1e-12)
    machine = Hopper("cubic", rest_length=30.0)
    beyond = follow(machine, "beta", -0.02, -0.006, watch={"period": watch["period"]}, most=60)
    assert [event.kind for event in beyond.events if event.kind != "period"] == ["collapse", "fold"]


def test_every_asked_value_is_an_event_once():
    """Values on which a step happens to end are found too."""
    asked = 1 + np.arange(1, 101) / 100  # the last is where the curve ends
    family = follow(Hopper("r"), "mass_ratio", 2.0, at=asked)
    assert [point.value for point in events(family, "value")] == asked[:-1].tolist()
    assert all(family[event.after].value == event.point.value for event in family.events)
