"""Machines stated in SI: their units, and the numbers that they are stated by."""

import copy
import json
import pickle
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from machines_in_si import LEG, ROVER, THROWER

from orbits import InputError, find, follow, simulate
from problems import Hopper, hopper_in_si
from problems.laws import gravity, springs
from problems.machines import MachineInSI


@pytest.mark.parametrize("kind", [int, np.float32, np.int64, Decimal, Fraction])
def test_numbers_of_any_kind_are_floats(kind):
    """All stated numbers are whole, which every kind holds exactly."""
    numbers = {"body_mass": 60, "foot_mass": 3, "stiffness": 8000, "rest_length": 2, "body_radius": 4096, "damping": 0}
    machine = hopper_in_si(**{name: kind(value) for name, value in numbers.items()}, surface_gravity=kind(10))
    plain = hopper_in_si(**{name: float(value) for name, value in numbers.items()}, surface_gravity=10.0)
    assert machine == plain
    assert {type(value) for value in machine.values.values()} == {float}
    assert json.dumps(machine.describe()) == json.dumps(plain.describe())
    assert find(machine).alpha == find(plain).alpha
    bare = Hopper("r + b*r**3", mass_ratio=kind(2), rest_length=kind(9), parameters={"b": kind(1)})
    assert json.dumps(bare.describe()) == json.dumps(bare.with_values(mass_ratio=2.0).describe())
    assert type(bare.mass_ratio) is type(bare.parameters["b"]) is float


def test_a_machine_cannot_be_changed():
    masses = {"body_mass": 60.0, "foot_mass": 3.0}
    machine = MachineInSI(Hopper, masses, None, 8e3, gravity.constant(), 9.81)
    masses["body_mass"] = 99.0
    for each in (machine, pickle.loads(pickle.dumps(machine)), copy.deepcopy(machine)):
        assert each == machine
        assert each.values["body_mass"] == 60.0
        with pytest.raises(TypeError):
            each.masses["body_mass"] = 99.0
    bare = pickle.loads(pickle.dumps(Hopper("cubic")))
    for laws in (bare, bare.spring):
        with pytest.raises(TypeError):
            laws.parameters["beta"] = 1.0


def test_a_table_that_does_not_contain_rest():
    """Preloaded rows of 8 N/mm from 1 mm on; the units are set by the slope at the nearest row, or as stated."""
    r = np.linspace(1e-3, 0.05, 20)
    law = springs.table((r, 8e3 * r), in_si=True)
    for stiffness in (None, 8e3):
        machine = hopper_in_si(60.0, 3.0, force=law, stiffness=stiffness)
        assert machine.stiffness == pytest.approx(8e3, rel=1e-12)
    with pytest.raises(InputError, match="has stiffness 8000 N/m at rest, not 5000"):
        hopper_in_si(60.0, 3.0, force=law, stiffness=5e3)


def test_the_text_shows_what_was_stated():
    machine = hopper_in_si(60.0, 3.0, stiffness=8e3, rest_length=0.8, body_radius=250.0, restitution=0.5)
    assert repr(machine).endswith("body_radius = 250 m, restitution = 0.5")
    assert "gravity_share" not in machine.stated_values


def test_changes_and_refusals():
    heavier = LEG.with_values(body_mass=70.0, rest_length=0.9, k=6000.0)
    assert heavier.values == LEG.values | {"body_mass": 70.0, "rest_length": 0.9, "k": 6000.0}
    for values, message in (
        ({"mass": 1.0}, "no parameter 'mass'"),
        ({"body_mass": -1.0}, "body_mass = -1"),
        ({"foot_mass": 1e-13}, "mass_ratio"),
        ({"rest_length": 0.0}, "rest_length = 0"),
    ):
        with pytest.raises(InputError, match=message):
            LEG.with_values(**values)
    for machine, name in ((ROVER, "body_radius"), (THROWER, "stiffness"), (THROWER, "surface_gravity")):
        with pytest.raises(InputError, match=f"{name} = -5 is out of bounds"):
            machine.with_values(**{name: -5.0})
    for stiffness in (1e-300, 1e300):
        with pytest.raises(InputError, match=r"the unit of length = .* is out of bounds"):
            THROWER.with_values(stiffness=stiffness)
    with pytest.raises(InputError, match="'foot_mass' is the machine's own name"):
        hopper_in_si(1.0, 1.0, force="foot_mass*r", parameters={"foot_mass": 1.0})
    with pytest.raises(InputError, match="damping = -5 is below 0"):
        hopper_in_si(1.0, 1.0, stiffness=1.0, damping=-5.0)
    assert repr(LEG) == (
        "hopper in SI, spring k*r + b*r**3, gravity 9.80665 m/s^2: body_mass = 60 kg, foot_mass = 3 kg, "
        "rest_length = 0.8 m, b = 100000 N/m^3, k = 5000 N/m"
    )
    with pytest.raises(TypeError):
        hopper_in_si(1.0, 1.0, stifness=1.0)
    with pytest.raises(InputError, match="sets the units"):
        simulate(LEG, 0.9, hops=1, schedule=([0.0, 1.0], {"foot_mass": [4.0]}))
    with pytest.raises(InputError, match="no parameter 'unit_stiffness'"):
        follow(LEG, "unit_stiffness", 1e4)
