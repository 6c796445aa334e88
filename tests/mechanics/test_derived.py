"""Models that are derived of mechanics hold, and what none is derived of."""

import pytest
from conftest import slow_after
from mechanisms import VALUES, leg, machine

from orbits import Mechanism, OrbitsError, ReturnMap, check, find, simulate
from orbits.mechanics import Damper, Force, Inerter, Mass, Potential, Spring, Weight
from problems.laws import springs

STEPS = springs.table(([-1.0, -0.5, 0.5, 1.0], [-3.0, -1.5, 1.5, 3.0]))
MASSES = [Mass("body", 1.0), Mass("foot", 1.0)]
THREE = {"coordinates": ("body", "foot", "toe"), "gap": "toe", "parameters": {}}
MASSES_OF_THREE = [*MASSES, Mass("toe", 1.0)]
LEGS = [Spring("body - foot", "r"), Spring("foot - toe", "r")]


@pytest.mark.parametrize(
    ("change", "telling"),
    [
        (
            {
                "elements": [*MASSES, Mass("foot + u", 0.1), Spring("body - foot - u", "r")],
                "actuators": {"u": "w"},
                "parameters": {},
            },
            r"'foot \+ u' moves with an actuator, but a mass can move with coordinates only",
        ),
        (
            {"heights": {"body": lambda y, p: y["body"] ** 2}},
            "a height that is not a sum of coordinates must be a formula of coordinates and parameters",
        ),
        (
            {**THREE, "elements": [*MASSES_OF_THREE, Spring("body - foot", STEPS), Spring("foot - toe", STEPS)]},
            "spring 'table.*': a machine may have one law in pieces, along a sum of coordinates",
        ),
        (
            {**THREE, "elements": [*MASSES_OF_THREE, *LEGS, Spring("body*toe", STEPS)]},
            "a machine may have one law in pieces, along a sum of coordinates",
        ),
        (
            {"elements": [*MASSES, Spring("body - foot - 0.1", STEPS)], "parameters": {}},
            "spring .* is in pieces: it must act alone, along the launched coordinate",
        ),
        (
            {"elements": [*MASSES, Spring("body - foot", "r"), Spring("body - foot", STEPS)], "parameters": {}},
            r"spring 'table.*: it must act alone, .* as one law, springs.function\(force, breakpoints=...\)",
        ),
        (
            {"elements": [*MASSES, Spring("body - foot - 0.1", STEPS), Potential("0*body")], "parameters": {}},
            "is in pieces: its extension must be the launched coordinate, counted from its rest",
        ),
        (
            {"elements": MASSES, "parameters": {}},
            "a mechanism without a spring must say what counts its families: counts=",
        ),
        (
            {"elements": MASSES, "parameters": {}, "counts": "body - foot"},
            "'the contact force' does not depend on the extension r: no spring opens the contact",
        ),
        (
            {**THREE, "elements": [*MASSES_OF_THREE, *LEGS, Potential("body*foot*toe")]},
            "no guess of the families of a mechanism is known: give `find` a start",
        ),
    ],
    ids=[
        "mass with actuator", "function of a height", "two tables", "table along no sum", "table with offset",
        "table beside a formula", "table with potential", "no counts", "no spring", "no guess",
    ],
)  # fmt: skip
def test_what_no_model_is_derived_of(change, telling):
    with pytest.raises(OrbitsError, match=telling):
        find(machine(**change))


LEVER = {"counts": "body - foot"}
HEIGHT = "foot + 2*l*sin(knee/2)"
KNEE = Mechanism(
    ("foot", "knee"),
    [Mass(HEIGHT, "m1"), Mass("foot", "m2"), Inerter("knee", "j"), Spring("knee - rest", "k*r")], "foot",
    {"m1": 3.0, "m2": 0.4, "j": 0.1, "l": 0.5, "k": 30.0, "rest": 2.2}, gravity=9.81, rest={"knee": "rest"},
    angles=("knee",), heights={"body": HEIGHT, "foot": "foot"},
)  # fmt: skip
CHECKED = {
    "lever": leg(Spring("2*(body - foot)", "k/4*r"), **LEVER),
    "offset": leg(Spring("body - foot + 0.3", "k*(r - 0.3)"), **LEVER),
    "upside down": leg(Spring("foot - body", "k*r")),
    "potential": leg(Potential("k*(body - foot)**2/2"), **LEVER),
    "side by side": leg(
        Spring("body - foot", "k*r"), Spring("2*(foot - body)", "c*r**3"), parameters={**VALUES, "c": 0.7}
    ),
    "inertia": Mechanism(
        ("body", "foot"), [Weight("body", "m1"), Weight("foot", "m2"), Spring("body - foot", "k*r")], "foot",
        parameters=VALUES, inertia={"body": "m1", "foot": "m2"},
    ),
    "length": Mechanism(
        ("length", "foot"), [Mass("foot + length", "m1"), Mass("foot", "m2"), Spring("length", "k*r")], "foot",
        parameters=VALUES,
    ),
    "varying": Mechanism(
        ("body", "foot"), [Mass("L + body", "m1"), Mass("foot", "m2"), Spring("body - foot", "r")], "foot",
        {"m1": 2.0, "m2": 0.5, "R": 60.0, "L": 9.0}, gravity="1/(1 + z/R)**2",
    ),
    "damped": leg(Spring("body - foot", "k*r"), Damper("body - foot", "d"), parameters={**VALUES, "d": 0.02}),
    "driven": leg(
        Spring("body - foot", "k*r"), Force("body - foot", lambda y, v, p: p["d"] * (v["body"] - v["foot"])),
        parameters={**VALUES, "d": 0.02},
    ),
    "inerter": leg(Spring("body - foot", "k*r"), Inerter("body - foot", "b"), parameters={**VALUES, "b": 0.4}),
    "on the ground": leg(Spring("body - foot", "k*r"), Spring("body", "h*r"), parameters={**VALUES, "h": 0.2}),
    "held up": leg(Spring("body - foot", "k*r"), Potential("-0.2*m2*body")),
    "in SI": leg(Spring("body - foot", "k*r"), in_si=True, gravity="g", parameters={**VALUES, "g": 9.81}),
    "twice the gap": leg(Spring("body - foot", "k*r"), gap="2*foot"),
    "pieces": leg(Spring("body - foot", springs.end_stops(gap=1.5, stop=20.0)), parameters={"m1": 1.0, "m2": 1.0}),
    "knee": KNEE,
}  # fmt: skip


@pytest.mark.parametrize("name", slow_after(len(CHECKED) - 2, CHECKED))
def test_each_of_them_holds(name):
    assert check(CHECKED[name]).largest < 0.1


def test_the_return_map_of_a_knee_whose_liftoff_depends_on_the_speed():
    """A map that took the speed from the energy at one lift-off would be 1 % off at 1.05 of the lossless speed."""
    alpha = 1.05 * find(KNEE).alpha
    run = simulate(KNEE, alpha, hops=1)
    assert ReturnMap(KNEE)([alpha]).next == pytest.approx(run.launches[1:2], rel=1e-9)
