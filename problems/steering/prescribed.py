"""The hop that repeats itself, prescribed by the speed of its launch or by its height, and by its period.

The height is the rise of the centre of mass in flight above its place at lift-off, as orbits have it. Where no force
but gravity acts on the machine in flight, the centre of mass moves on a parabola whatever the actuator does, and rises
by v^2/(2 g) with its speed v at lift-off and its constant deceleration g.
"""

from collections.abc import Iterable, Mapping

import casadi as ca
import numpy as np

from orbits import InputError, Orbit
from orbits.errors import finite_number
from orbits.laws import Algebraic, Parameters, Scalars
from orbits.model import Affine, Model, weighted_sum
from orbits.running import exclusive
from orbits.units import LENGTH, LIFTOFF_SPEED, TIME, Dimension, Message, Quantity

from ..machines import refuse_taken
from .actuated import Actuated, Drive

# What may be prescribed, which is a parameter of the program by this name, with its dimension.
LAUNCH_CONDITIONS: Mapping[str, Dimension] = {"speed": LIFTOFF_SPEED, "height": LENGTH, "period": TIME}
RISING = "centre of mass"
# Relative difference of decelerations along a flight, and of a launch from that of the lossless orbit, by rounding.
FREE_FALL, OF_THE_ORBIT = 1e-9, 1e-12


def launch_number(drive: Drive, name: str, x: Scalars, p: Parameters) -> Algebraic:
    """The speed or the height of a hop that is launched in the flight state `x`."""
    model = drive.model
    if name == "speed":
        return x[model.flight.states.index(model.launched[1])]
    speed, acceleration = _motion_of_centre(model, x, {**p, drive.actuator.rate: 0.0})
    return -(speed**2) / (2 * acceleration)


def of_lossless(driven: Actuated, orbit: Orbit, name: str) -> float:
    """The speed, the height or the period of the lossless orbit."""
    if name == "period":
        return float(orbit.period)
    return float(launch_number(driven.drive, name, np.append(orbit(0.0), 0.0).tolist(), driven.values))


def prescribed_hop(driven: Actuated, orbit: Orbit, **stated: float | None) -> dict[str, float]:
    """What is prescribed, by name, of checked arguments; raises `InputError` for invalid ones."""
    wanted = {name: finite_number(name, value) for name, value in stated.items() if value is not None}
    if {"speed", "height"} <= wanted.keys():
        raise InputError(
            "speed and height both prescribe the launch, which has one free number: give one of them; to follow one "
            "after the other, begin keep_hopping(machine, height=..., guess=family.at(...)) where the family along the "
            "speed ends"
        )
    refuse_taken(wanted, driven.still, "what is prescribed of a hop")
    for name, value in wanted.items():
        if not value > 0:
            text = "{name} = {value:g}; the {name} of a hop must be above 0"
            raise InputError(Message(text, name=name, value=Quantity(value, LAUNCH_CONDITIONS[name])))
        if name == "height":
            check_free_fall(driven, [orbit(t) for t in np.linspace(0.0, float(orbit.flight_time), 5)])
    return wanted


@exclusive
def check_free_fall(driven: Actuated, states: Iterable[np.ndarray]) -> None:
    """Raise `InputError` for a machine whose centre of mass does not fall freely in flight, at these states of its
    lossless orbit and with its actuator displaced."""
    model = driven.model
    if not isinstance(model.heights(driven.values).get(RISING), Affine):
        raise InputError(
            f"a {model.name} has no height '{RISING}' that is a sum of its coordinates: prescribe speed= instead, or "
            "state this height in heights= of the mechanism"
        )
    x = ca.SX.sym("x", len(model.flight.states))
    deceleration = ca.Function("deceleration", [x], [-_motion_of_centre(model, ca.vertsplit(x), driven.values)[1]])
    found = np.array([float(deceleration(np.append(y, moved))) for y in states for moved in (0.0, 1.0)])
    if not found.min() > 0 or np.ptp(found) > FREE_FALL * found.max():
        raise InputError(
            "in flight other forces than gravity act on the centre of mass, so the launch does not fix its rise: "
            "prescribe speed= instead"
        )


def _motion_of_centre(model: Model, x: Scalars, p: Parameters) -> tuple[Algebraic, Algebraic]:
    """The speed and the acceleration of the centre of mass in a flight state."""
    height = model.heights(p)[RISING]
    assert isinstance(height, Affine)
    rates = model.flight.field(x, p, model.flight.data(x, p))
    by_name = dict(zip(model.flight.states, rates, strict=True))
    accelerations = [by_name.get(f"{name}'", 0.0) for name in by_name]
    return weighted_sum(height.weights, rates), weighted_sum(height.weights, accelerations)
