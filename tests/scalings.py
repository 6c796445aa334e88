"""Shared by tests of machines in other units of length, time and mass."""

import numpy as np

from orbits import Mechanism, find
from orbits.mechanics import Inerter, Mass, Spring
from problems import rimless_wheel

# The units of length, time and mass.
UNITS = [(1.0, 1, 1), (1e3, 1, 1), (1e-3, 1, 1), (1, 1e3, 1), (1, 1e-3, 1), (1, 1, 1e3), (37.0, 0.011, 250.0)]
MASSES = [Mass("body", "m1"), Mass("foot", "m2")]
PAIR = {"m1": 1.0, "m2": 2.0, "k": 1.0, "b": 0.1, "g": 1.0}
POWERS = {
    **dict.fromkeys(("m", "m1", "m2", "m3", "i", "mass"), (0, 0, 1)),
    **dict.fromkeys(("k", "k2"), (0, -2, 1)), "b": (-2, -2, 1), "stiffness": (2, -2, 1),
    **dict.fromkeys(("g", "surface_gravity"), (1, -2, 0)), **dict.fromkeys(("R", "length"), (1, 0, 0)),
    **dict.fromkeys(("inertia", "body_inertia"), (2, 0, 1)), "angle": (0, 0, 0),
}  # fmt: skip


def _leg(*elements, gravity="g", **numbers) -> Mechanism:
    return Mechanism(("body", "foot"), [*MASSES, *elements], gap="foot", parameters=numbers, gravity=gravity)


CUBIC = Spring("body - foot", "k*r + b*r**3")
MACHINES = {
    "leg": (_leg(CUBIC, **PAIR), None),
    "varying gravity": (_leg(CUBIC, gravity="g*(1 + z/R)**(-2)", **PAIR, R=100.0), None),
    "inerter": (_leg(CUBIC, Inerter("body - foot", "i"), **PAIR, i=0.3), None),
    "chain": (
        Mechanism(
            ("x", "y", "z"),
            [*map(Mass, "xyz", ("m1", "m2", "m3")), Spring("x - y", "k*r"), Spring("y - z", "k2*r + b*r**3")],
            gap="z", parameters={**PAIR, "m3": 0.5, "k2": 2.0}, gravity="g",
        ),
        {"liftoff": 0.25, "alpha": 1.93, "x": -1.96, "x'": 11.0, "duration": 4.25, "contact_duration": 1.87},
    ),
    "two feet": (
        Mechanism(
            ("h", "s", "d"),
            [Mass("h", "m1"), Mass("s+d", "m"), Mass("s-d", "m"), Spring("h-s-d", "k*r"), Spring("h-s+d", "k*r")],
            gaps={"left": "s+d", "right": "s-d"}, reversor={"d": "-d"}, symmetry={"d": "-d"}, gravity="g",
            parameters={"m1": 1.0, "m": 2.0, "k": 1.0, "g": 1.0}, launch="h",
        ),
        {"liftoff": 2.0, "alpha": 4.43, "d": -1.22, "d'": -4.08, "duration": 4.15, "contact_duration": 4.24},
    ),
    "wheel": (rimless_wheel(mass=2.0, length=0.4, spokes=8, inertia=0.4, body_inertia=0.4, stiffness=20.0), None),
}  # fmt: skip


def in_units(name: str, units: tuple[float, float, float]):
    """The orbit of a machine whose numbers are in other units."""
    machine, start = MACHINES[name]
    scaled = {key: value * np.prod(np.power(units, POWERS[key])) for key, value in machine.parameters.items()}
    launch = {key: x * unit_of(key, units) for key, x in start.items()} if start else None
    return find(machine.with_values(**scaled), start=launch)


def unit_of(unknown: str, units: tuple[float, float, float]) -> float:
    """The unit of a number of a launch or of a time."""
    length, time, _ = units
    return time if unknown.endswith("duration") else length / time if unknown[-1] in "'a" else length
