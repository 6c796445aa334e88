"""Starts from linear hops, against the same machine in other words and against DOP853."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import orbits.continuation.starts as room
from orbits import InputError, Mechanism, NoOrbit, find, starts
from orbits.mechanics import Damper, Force, Mass, Spring
from problems.laws import springs

MASSES = [Mass("body", 2.0), Mass("foot", 0.5), Mass("plate", 3.0)]
VALUES = {"k": 3.0, "h": 20.0, "c": 0.01}
CUBIC = "k*r + c*r**3"
LONGEST = 2.0, 3.5  # half times of contact and of flight


def plate(*elements, **more) -> Mechanism:
    """A body, a foot and a plate with these elements beside their masses and the plate's spring."""
    laws = [each.force for each in elements if isinstance(each, Spring) and isinstance(each.force, str)]
    asked = {name: value for name, value in VALUES.items() if name in "".join([*laws, "h"])}
    elements = [*MASSES, Spring("plate", "h*r"), *elements]
    return Mechanism(("body", "foot", "plate"), elements, "foot - plate", asked, counts="body - foot", **more)


def same(one: list, other: list) -> None:
    """The same starts, of a machine in other words."""
    assert len(one) == len(other) > 1
    for a, b in zip(one, other, strict=True):
        assert a == pytest.approx(b, rel=1e-8)


@pytest.mark.parametrize("law", ["k*r", CUBIC])
def test_a_law_with_a_length_at_rest(law):
    """k (r - 0.8) is k r of an extension that is less by 0.8."""
    moved = law.replace("r", "(r - 0.8)")
    same(
        starts(plate(Spring("body - foot", moved)), *LONGEST), starts(plate(Spring("body - foot - 0.8", law)), *LONGEST)
    )


def test_hops_of_own_laws_are_found_at_once_where_they_are_near(monkeypatch):
    machine = plate(Spring("body - foot", CUBIC))
    at_once = starts(machine, *LONGEST)
    monkeypatch.setattr(room, "_found_directly", lambda *given: None)
    same(at_once, starts(machine, *LONGEST))
    for start in at_once:
        orbit = find(machine, start=start)

        def rates(t, x):
            body, foot = 3.0 * (pull := x[0] - x[2]) + 0.01 * pull**3, -20.0 * x[4]
            return [x[1], -body / 2.0 - 1, x[3], body / 0.5 - 1, x[5], foot / 3.0 - 1]

        run = solve_ivp(rates, (0, orbit.flight_time / 2), orbit(0.0), "DOP853", rtol=1e-13, atol=1e-13)
        assert run.y[1::2, -1] == pytest.approx(np.zeros(3), abs=1e-8)


def test_runs_that_crawl_are_given_up(monkeypatch):
    """A hop that has come no further than the least share after the first points is left out then."""
    asked, follow = [], room.follow

    def counted(*given, most, **more):
        asked.append(most)
        return follow(*given, most=most, **more)

    monkeypatch.setattr(room, "follow", counted)
    monkeypatch.setattr(room, "FIRST_LAW_POINTS", 3)
    monkeypatch.setattr(room, "_found_directly", lambda *given: None)
    monkeypatch.setattr(room, "LEAST_LAW_SHARE", 1.1)
    assert starts(plate(Spring("body - foot", CUBIC)), *LONGEST) == []
    assert {*asked} == {3}


@pytest.mark.parametrize(
    ("elements", "more", "telling"),
    [
        ([Spring("body - foot", springs.end_stops(gap=1.5, stop=20.0))], {}, "is in pieces: starts are led there"),
        ([Spring("body - foot", "k*r"), Damper("body - foot", 0.1)], {}, "has a Damper: it has no lossless hops"),
        ([Spring("body - foot", "k*r"), Force("body", lambda y, v, p: 0.1)], {}, "has a Force"),
        ([Spring("body - foot", "k*r")], {"gravity": "1/(1 + z/60)**2"}, "gravity .* varies: starts are led there"),
        ([Spring("body - foot", "exp(r)")], {}, "has the force 1 at rest, and none near it where it vanishes"),
        ([Spring("body - foot", "-k*r - c*r**3")], {}, "has the slope -3 where it is unloaded, not above 0"),
    ],
)
def test_machines_without_linear_hops_are_refused_by_name(elements, more, telling):
    with pytest.raises(InputError, match=telling):
        starts(plate(*elements, **more), *LONGEST)


def test_the_zero_of_a_force_with_another_one():
    """(r - 0.3)(r + 4) vanishes at 0.3, near rest, with the slope 4.3, and elsewhere."""
    law = room.from_formula("(r - 0.3)*(r + 4)", "r")
    assert room._straight_line(law) == pytest.approx((4.3, 0.3), rel=1e-12)


def test_a_hop_that_cannot_be_found_is_left_out(monkeypatch):
    def none(*given, **more):
        raise NoOrbit("no")

    monkeypatch.setattr(room, "find", none)
    assert starts(plate(Spring("body - foot", CUBIC)), *LONGEST) == []
