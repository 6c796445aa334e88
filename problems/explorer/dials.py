"""The sliders of a machine's parameters: the ends of each, and whether its scale is logarithmic."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from orbits.errors import OrbitsError
from orbits.model import Machine, free_parameters, machine_in_words

from ..machines import SAME_IN_SI
from .scene import Scene

SPAN = 10.0  # the slider of a scale parameter reaches this factor down and up
LARGE = 20.0  # a larger number is taken for a scale parameter too
# Sliders with ends of their own, and whether they are logarithmic.
# Those of machines that step, and their units.
WAYS_OF_STEPS = {"angle": (0.05, 1.0, False), "spokes": (3.0, 24.0, False), "friction": (0.05, 2.0, False)}
WAYS_OF_STEPS |= {"share": (0.05, 1.0, False), "slope": (-0.1, 0.1, False)}
UNITS_OF_STEPS = {"mass": "kg", "stiffness": "N m/rad", "surface_gravity": "m/s^2", "angle": "rad", "slope": "rad"}
UNITS_OF_STEPS |= dict.fromkeys(("length", "half_width", "half_height"), "m")
UNITS_OF_STEPS |= dict.fromkeys(("inertia", "body_inertia"), "kg m^2")
SPAN_OF_RUNNERS = 3.0  # a runner whose numbers are changed more has no run, or one that is not found
UNITS_OF_RUNNERS = {"stiffness": "N/m", "surface_gravity": "m/s^2", "rest_length": "m", "speed": "m/s"}
UNITS_OF_RUNNERS |= {"body_mass": "kg", "foot_mass": "kg", "inertia": "kg m^2", "hip_stiffness": "N m/rad"}
WAYS = {"mass_ratio": (0.01, 100.0, True), "link": (0.1, 1.0, True), "rest_angle": (0.5, 3.0, False)}


@dataclass(frozen=True)
class Dial:
    """The slider of a parameter.

    name, value, unit : of the parameter; the unit is "" where it is unknown
    low, high : the slider's ends; a number that is typed may lie beyond
    factors : whether equal steps of the slider are equal factors, not equal differences
    whole : whether it is a whole number
    """

    name: str
    value: float
    unit: str
    low: float
    high: float
    factors: bool
    whole: bool = False


def dials_of(machine: Machine, scene: Scene) -> list[Dial]:
    """The sliders of a machine's parameters, with ends at which the machine still exists."""

    def exists(name: str, value: float) -> bool:
        """Whether the machine can have this value of a parameter."""
        try:
            if scene.steps:  # the scene's numbers are others than the machine's parameters
                scene.with_numbers(**{name: value}).build()
            else:
                machine.with_values(**{name: value})
        except OrbitsError:
            return False
        return True

    if scene.steps:
        units = UNITS_OF_STEPS if scene.machine not in SAME_IN_SI else UNITS_OF_RUNNERS if scene.si else {}
        span, ways = (SPAN_OF_RUNNERS, {}) if scene.tuned else (SPAN, WAYS_OF_STEPS)
        numbers = {name: value for name, value in scene.numbers.items() if name not in scene.tuned}
        return [_dial(exists, name, value, units.get(name, ""), ways, span) for name, value in numbers.items()]
    units, values = machine_in_words(machine).get("units", {}), machine.values
    names = [name for name in free_parameters(machine) if name in values]
    dials = [_dial(exists, name, values[name], units.get(name, ""), WAYS) for name in names]
    if scene.fixed_laws:
        return dials
    return [*dials, Dial("restitution", float(scene.numbers.get("restitution", 0.0)), "", 0.0, 1.0, False)]


Exists: TypeAlias = Callable[[str, float], bool]
Ways: TypeAlias = Mapping[str, tuple[float, float, bool]]


def _dial(exists: Exists, name: str, value: float, unit: str, ways: Ways, span: float = SPAN) -> Dial:
    if name in ways:
        low, high, factors = ways[name]
        return Dial(name, value, unit, min(low, value), max(high, value), factors and value > 0, name == "spokes")
    positive = not exists(name, -(abs(value) or 1.0))
    if value > 0 and (positive or value > LARGE):
        low, high = value / span, value * span
        return Dial(name, value, unit, _edge(exists, name, value, low), _edge(exists, name, value, high), True)
    reach = _rounded_up(4 * abs(value)) if value else 1.0
    low, high = (-reach, reach) if value == 0 else (-reach / 4, reach) if value > 0 else (-reach, reach / 4)
    low = _edge(exists, name, value, 0.0 if positive else low)
    return Dial(name, value, unit, low, _edge(exists, name, value, high), False)


def _rounded_up(value: float) -> float:
    """The smallest number of 1, 2, 5, 10, ... that is not less than a value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-12))


def _edge(exists: Exists, name: str, inside: float, end: float) -> float:
    """The end of a slider, or the last value found before it that the machine can have."""
    if exists(name, end):
        return end
    for _ in range(12):
        middle = (inside + end) / 2
        inside, end = (middle, end) if exists(name, middle) else (inside, middle)
    return inside
