"""Elements of a mechanism in other words, side by side, and with losses."""

import pytest
from mechanisms import VALUES, leg, machine

from orbits import InputError, NoOrbit, ReturnMap, find
from orbits.mechanics import Damper, Force, Inerter, Mass, Spring, Weight
from problems import hopper_in_si


class TestTheSameMachine:
    def test_with_losses(self):
        damped = leg(Spring("body - foot", "k*r"), Damper("body - foot", "d"), parameters={**VALUES, "d": 0.02})
        forced = leg(
            Spring("body - foot", "k*r"), Force("body - foot", lambda y, v, p: -p["d"] * (v["body"] - v["foot"])),
            parameters={**VALUES, "d": 0.02},
        )  # fmt: skip
        stated = hopper_in_si(2.0, 0.5, stiffness=3.0, surface_gravity=1.0, damping=0.02)
        speeds = [2.0, 3.0, 4.0]
        assert ReturnMap(damped)(speeds).next == pytest.approx(ReturnMap(stated)(speeds).next, rel=1e-10)
        assert ReturnMap(forced)(speeds).next == pytest.approx(ReturnMap(stated)(speeds).next, rel=1e-10)
        with pytest.raises(NoOrbit, match="loses energy"):
            find(damped)


@pytest.mark.parametrize(
    ("element", "telling"),
    [
        (Mass("body", "m1*foot"), "the mass 'm1\\*foot' depends on the coordinate 'foot': .* inertia="),
        (Weight("body", "body"), "the mass 'body' depends on the coordinate"),
        (Inerter("body - foot", "k*body"), "the inertance 'k\\*body' depends on the coordinate"),
        (Damper("body - foot", "k*body**2"), "the coefficient .* depends on the coordinate 'body': .* a Force"),
    ],
)
def test_what_depends_on_parameters_alone(element, telling):
    with pytest.raises(InputError, match=telling):
        machine(element)


class TestWhatFindDoesWithElements:
    def test_that_lose_energy(self):
        for element in (Damper("body - foot", 0.02), Force("body", lambda y, v, p: 0.0)):
            with pytest.raises(NoOrbit, match="loses energy"):
                find(machine(element))
            assert ReturnMap(machine(element))([3.0]).next[0] > 0
