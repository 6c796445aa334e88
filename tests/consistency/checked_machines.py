"""Machines that are held against mechanics, what makes them wrong, and the fields that are named."""

from types import SimpleNamespace

import pytest

from orbits import check, find
from orbits.errors import InconsistentModel
from problems import (
    Actuated,
    Chain,
    HeavyHand,
    Hopper,
    Juggler,
    hopper_in_si,
    inerter_hopper,
    juggler_in_si,
    knee_hopper,
)
from problems.laws import springs

INVERSE_SQUARE = "1/(1 + z/90)**2"
MACHINES = {
    "hopper": Hopper(),
    "cubic": Hopper("r + 0.3*r**3", mass_ratio=2.0, rest_length=20.0, restitution=0.3),
    "varying": Hopper("tanh(r) + r", INVERSE_SQUARE, 0.7, 20.0),
    "in pieces": Hopper(springs.bilinear(ratio=2.0), rest_length=20.0),
    "damped": Hopper("r + 0.1*r**3", damping=0.1, drag=0.03),
    "juggler": Juggler(mass_ratio=3.0, rest_length=9.0),
    "varying juggler": Juggler("r + 0.2*r**3", INVERSE_SQUARE, 2.0, 20.0),
    "damped juggler": Juggler("r", mass_ratio=3.0, damping=0.1, drag=0.05),
    "heavy hand": HeavyHand("cubic"),
    "chain of 2": Chain([1.0, 2.0], "r + r**3"),
    "actuated": Actuated(Hopper("r + 0.1*r**3", mass_ratio=2.0)),
    "actuated juggler": Actuated(Juggler("r", INVERSE_SQUARE, 1.0, 20.0)),
    "in SI": hopper_in_si(10.0, 1.0, stiffness=1e4, rest_length=0.5),
    "juggler in SI": juggler_in_si(1.0, 0.2, force="k*r + b*r**3", parameters={"k": 900.0, "b": 4e4}),
    "inerter": inerter_hopper("r + 0.1*r**3", body_mass=1.3, rest_length=20.0),
    "inerter in SI": inerter_hopper(
        "k*r", body_mass=60.0, foot_mass=3.0, inertance=20.0, surface_gravity=9.81, parameters={"k": 5e3}, in_si=True
    ),
    "knee": knee_hopper(link=0.5),  # its inertia depends on the angle
}


def at(function, place, factor=1.0, add=0.0):
    """A function that gives a list, of which one entry is changed."""

    def changed(*arguments):
        values = list(function(*arguments))
        values[place] = values[place] * factor + add
        return values

    return changed


BROKEN = {
    "hopper": Hopper("r + 0.3*r**3", mass_ratio=2.0, rest_length=20.0),
    "juggler": Juggler("r + 0.2*r**3", INVERSE_SQUARE, 3.0, 20.0),
    "chain": Chain([1.0, 2.0, 0.7], ["r", "r + r**3"]),
}


def with_model(machine, model):
    """A machine of the same numbers and parts with another model."""
    names = ("values", "units", "describe", "with_values", "restitution", "rest_length")
    stranger = SimpleNamespace(**{name: getattr(machine, name) for name in names}, model=model)
    stranger.with_values = lambda **values: stranger
    return stranger


def named(machine, model, start=None) -> tuple[str, ...]:
    """The fields that the error names, which `check` and `find` raise alike."""
    wrong = with_model(machine, model)
    with pytest.raises(InconsistentModel) as by_check:
        check(wrong, start=start)
    with pytest.raises(InconsistentModel) as by_find:
        find(wrong, start=start)
    assert by_find.value.fields == by_check.value.fields
    assert all(name in str(by_find.value) for name in by_find.value.fields)
    return by_find.value.fields
