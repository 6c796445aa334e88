"""Designs at corners, where two places of the motion have the same extreme: closed forms, searches, and jumps."""

import pytest

from orbits import optimize
from problems import Hopper

AT_CORNER = 10.103246341180  # where peaks of contact and flight are the same, by SciPy's brentq over single orbits
KINKED = Hopper("r + a*r**2 + b*r**3", mass_ratio=5.0, rest_length=96.0, parameters={"a": 0.1, "b": 0.1})


@pytest.mark.slow
def test_a_bound_that_passes_a_corner():
    """The peak force in contact falls with the mass ratio to that in flight, as in a search without the bound."""
    text = "largest_spring_force + 0.05*mass_ratio"
    corner = optimize(KINKED, minimise=text, over={"mass_ratio": (1.0, 100.0)})
    curve = optimize(KINKED, minimise=text, over={"mass_ratio": (1.0, 10.0)}).follow("mass_ratio <= 10", 60.0, points=3)
    assert not curve.end
    (event,) = curve.events
    assert (event.kind, event.text) == ("enters", "an extreme at two places")
    assert event.value == pytest.approx(corner.parameters["mass_ratio"], rel=1e-11)
    assert curve.objectives[1:] == pytest.approx(corner.objective, rel=1e-12)
    moved = corner.follow("a", 0.12, points=2).designs[-1]
    alone = optimize(KINKED.with_values(a=0.12), minimise=text, over={"mass_ratio": (1.0, 100.0)})
    assert moved.objective == pytest.approx(alone.objective, rel=1e-10)
    assert moved.parameters == pytest.approx(alone.parameters, rel=1e-9)


@pytest.mark.slow
def test_a_corner_is_entered_and_left():
    """An objective whose free minimum passes the corner: the force in flight does not depend on the mass ratio, so that
    the corner is left, or entered, where the minimum of the other term is at it; both multipliers are shares of 1."""
    text, over = "largest_spring_force + 0.05*(mass_ratio - 0.1*rest_length)**2", {"mass_ratio": (1.0, 30.0)}
    best = optimize(KINKED.with_values(rest_length=102.0), minimise=text, over=over)
    curve = best.follow("rest_length", 94.0, points=3)
    assert not curve.end
    assert [event.kind for event in curve.events] == ["enters", "leaves"]
    in_flight, in_contact = (event.value for event in curve.events)
    at = 0.1 * in_flight
    assert at == pytest.approx(AT_CORNER, rel=1e-10)
    for i, design in enumerate(curve.designs):
        length = curve.values[i]
        multiplier = sum(each.multiplier for each in design.active if each.text == "an extreme at two places")
        share = (length - in_contact) / (in_flight - in_contact)
        assert multiplier == pytest.approx(share - 1 if -1e-12 < share < 1 else 0.0, abs=1e-8)
        if 0 <= share <= 1:
            assert design.parameters["mass_ratio"] == pytest.approx(at, rel=1e-10)
            assert curve.slopes[i] == pytest.approx(0.01 * (0.1 * length - at), abs=1e-9)
        elif share > 1:
            assert design.parameters["mass_ratio"] == pytest.approx(0.1 * length, rel=1e-11)
