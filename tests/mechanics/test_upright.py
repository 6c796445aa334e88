"""The vertical hop of a machine that moves along the ground, against a hopper."""

from dataclasses import replace

import pytest

from orbits import Mechanism, NoOrbit, find
from orbits.mechanics import Mass, Spring
from orbits.mechanics.upright import lateral_coordinates
from problems import runner


def test_the_upright_runner_hops_as_two_masses_do():
    machine = runner(foot_mass=0.2, rest_length=3.0)
    assert lateral_coordinates(machine) == ("x", "theta", "phi")
    masses = [Mass("body", "m1"), Mass("foot", "m2")]
    numbers = {"m1": 1.0, "m2": 0.2, "k": 1.0}
    hopper = Mechanism(("body", "foot"), [*masses, Spring("body - foot", "k*r")], gap="foot", parameters=numbers)
    upright, known = find(machine.upright(), family=2), find(hopper, family=2)
    assert upright.flight_time == pytest.approx(known.flight_time, rel=1e-12)
    assert upright.contact_time == pytest.approx(known.contact_time, rel=1e-12)
    assert upright.source.coordinates == ("z", "l")


def test_what_has_no_vertical_hop_is_refused():
    machine = runner()
    function = replace(machine, separation=lambda y, p: y["l"])
    with pytest.raises(NoOrbit, match="stated by Python functions"):
        function.upright()
