"""Starts from linear hops, against the same machine in other words and against DOP853."""

from functools import cache
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import solve_ivp

from orbits import InputError, Mechanism, find, starts
from orbits.mechanics import Damper, Force, Mass, Spring
from problems import Hopper
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
    """Two machines in other words have equal starts."""
    assert len(one) == len(other) > 1
    for a, b in zip(one, other, strict=True):
        assert a == pytest.approx(b, rel=1e-8)


@pytest.mark.parametrize("law", slow_after(1, ["k*r", CUBIC]))
def test_a_law_with_a_length_at_rest(law):
    """k (r - 0.8) is k r of an extension that is less by 0.8."""
    moved = law.replace("r", "(r - 0.8)")
    same(
        starts(plate(Spring("body - foot", moved)), *LONGEST), starts(plate(Spring("body - foot - 0.8", law)), *LONGEST)
    )


def rates_of(leg):
    """The flight of `plate` with a leg of this law, for SciPy."""

    def rates(t, x):
        body = leg(x[0] - x[2])
        return [x[1], -body / 2.0 - 1, x[3], body / 0.5 - 1, x[5], -20.0 * x[4] / 3.0 - 1]

    return rates


ROWS = np.linspace(-9.0, 9.0, 97)
TABLE = springs.table((ROWS, 3.0 * ROWS + 0.01 * ROWS**3), noise=0)


@cache
def of_a_table():
    machine = plate(Spring("body - foot", TABLE))
    return machine, starts(machine, 2.0, 2.0)


@cache
def of_end_stops():
    machine = plate(Spring("body - foot", springs.end_stops(gap=1.5, stop=2.0)))
    return machine, starts(machine, 4.0, 6.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "leg"),
    [
        (of_a_table, lambda r: 3 * r + 0.01 * r**3),
        (of_end_stops, lambda r: r + (max(r - 1.5, 0) + min(r + 1.5, 0))),
    ],
    ids=["table", "end stops"],
)
def test_hops_of_own_laws_come_to_rest_in_mid_flight_by_dop853(case, leg):
    machine, found = case()
    assert len(found) + len(found.ended) == found.linear >= len(found) > 1
    for start in found[:2]:
        orbit = find(machine, start=start)
        assert orbit.flight_time / 2 == pytest.approx(start["duration"], rel=1e-9)
        run = solve_ivp(rates_of(leg), (0, orbit.flight_time / 2), orbit(0.0), "DOP853", rtol=1e-13, atol=1e-13)
        assert run.y[1::2, -1] == pytest.approx(np.zeros(3), abs=1e-7)


def test_a_table_of_a_formula_has_its_hops():
    same(starts(plate(Spring("body - foot", CUBIC)), 2.0, 2.0), of_a_table()[1])


@pytest.mark.parametrize("law", ["cubic", "tanh"])
def test_two_masses_have_the_hop_that_find_has(law):
    """Which solves for a launch speed with the equations of their distance alone."""
    machine = Hopper(law, parameters={"beta": 0.3} if law == "cubic" else {"b": 0.2})
    (start,), orbit = starts(machine), find(machine)
    assert [start["liftoff"], start["alpha"], 2 * start["duration"]] == pytest.approx(
        [orbit.liftoff_extension, orbit.alpha, orbit.flight_time], rel=1e-9
    )


def test_a_search_that_is_stopped_says_so(caplog, monkeypatch):
    """At its limit it has found some of the hops, or none; by a clock that the calls of `progress` put forward."""
    machine, shares = plate(Spring("body - foot", CUBIC)), list[float]()
    every = starts(machine, *LONGEST, progress=shares.append)
    assert every.stopped == ""
    assert shares == sorted(shares)
    assert shares[-1] == 1.0

    now = [0.0]
    monkeypatch.setattr(import_module("orbits.running.time_limit"), "time", SimpleNamespace(monotonic=lambda: now[0]))

    def slow(seconds: float) -> None:
        now[0] += seconds

    some = starts(machine, *LONGEST, progress=lambda share: slow(0.3 * (share > 0.1)), limit=0.25)
    assert "not all: " in repr(some)
    assert "some hops are not yet continued to the springs' own laws: it takes more than 0.25 s" in some.stopped
    assert len(some) < len(every)
    none = starts(machine, *LONGEST, progress=lambda share: slow(0.3), limit=0.1)
    assert len(none) == 0
    assert "search for hops with linear springs is not finished" in none.stopped
    assert "it takes more than 0.1 s" in caplog.text
    half = starts(machine, *LONGEST, progress=lambda share: slow(0.6 * (share <= 0.1)), limit=2.0)
    assert "is not finished in half of the time: raise limit=" in half.stopped
    assert half.linear > 0


def test_the_usual_times_are_natural_periods():
    """Of the plain hopper, whose contact has the squared frequency k/m1, its flight k/m1 + k/m2, and whose first hop is
    found in them."""
    elements = [*MASSES[:2], Spring("body - foot", "k*r")]
    found = starts(Mechanism(("body", "foot"), elements, "foot", {"k": 3.0}))
    slowest = 2 * np.pi / np.sqrt([3.0 / 2.0, 3.0 / 2.0 + 3.0 / 0.5])
    assert found.periods == pytest.approx(slowest, rel=1e-14)
    assert (found.half_contact, found.half_flight) == pytest.approx(slowest * (0.5, 1.0), rel=1e-14)
    assert [start["duration"] for start in found] == pytest.approx([4.493409457909064 / np.sqrt(7.5)], rel=1e-12)


@pytest.mark.parametrize(
    ("elements", "more", "telling"),
    [
        ([Spring("body - foot", "k*r"), Damper("body - foot", 0.1)], {}, "has a Damper, so it has no lossless hops"),
        ([Spring("body - foot", "k*r"), Force("body", lambda y, v, p: 0.1)], {}, "has a Force"),
        ([Spring("body - foot", "k*r")], {"gravity": "1/(1 + z/60)**2"}, "gravity .* varies: starts are"),
        ([Spring("body - foot", "exp(r)")], {}, "has the force 1 at rest, and its force vanishes nowhere nearby"),
        ([Spring("body - foot", "-k*r - c*r**3")], {}, "has the slope -3 where it is unloaded, not above 0"),
    ],
)
def test_machines_without_linear_hops_are_refused_by_name(elements, more, telling):
    with pytest.raises(InputError, match=telling):
        starts(plate(*elements, **more), *LONGEST)
