"""Launches of a machine with an actuator at rest: the unknowns of a lift-off at another speed."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from orbits.errors import InputError
from orbits.numerics import newton_root
from orbits.periodic import in_units_of
from orbits.running import exclusive
from orbits.units import LIFTOFF_SPEED, Message, Quantity

from .actuated import Actuated


def is_one_speed(driven: Actuated) -> bool:
    """Whether a speed alone fixes a launch, as it does without the actuator."""
    return driven.model.one_speed and not driven.actuator.is_force


def launch_argument(driven: Actuated, like: Mapping[str, float], alpha: float) -> Any:
    """A launch at a speed as `simulate` takes it, in the units of the machine, with the other unknowns as in a launch
    `like`, which is without units."""
    if is_one_speed(driven):
        return alpha
    speed = alpha / (driven.units.of(LIFTOFF_SPEED) if driven.units else 1.0)
    return in_units_of(driven, launched_at(driven.dimensionless(), like, speed))


@exclusive
def launched_at(driven: Actuated, like: Mapping[str, float], alpha: float) -> dict[str, float]:
    """The unknowns of a launch at a speed, by name: "liftoff" is where the contact force vanishes then, and the others
    are those of the launch `like`. All numbers are without units. Raises `InputError` where the force does not vanish
    nearby."""
    model, p, like = driven.model, driven.values, {**like, "alpha": float(alpha)}
    if is_one_speed(driven):
        return {**like, "liftoff": float(driven.machine.model.release(alpha, driven.machine.values))}
    y = ca.SX.sym("liftoff")
    unknowns = {**like, "liftoff": y}
    state = dict(zip(model.flight.states, model.launch(unknowns, p), strict=True))
    q = model.contact.data([state[name] for name in model.contact.states], p)
    force = ca.SX(model.liftoff(unknowns, p, q)[0])
    step = ca.Function("step", [y], [-force / ca.jacobian(force, y)])
    place = newton_root(lambda y: float(step(y)), like["liftoff"])
    if place is not None:
        return {**like, "liftoff": place}
    text = "at a launch speed of {alpha:.6g} the contact force vanishes nowhere near: take a launch nearer to the hop's"
    raise InputError(Message(text, alpha=Quantity(float(alpha), LIFTOFF_SPEED)))
