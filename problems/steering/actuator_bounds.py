"""Bounds of an actuator: of the rate of its state, its displacement, its force, its power, and its force by its speed.

A motor at a bounded voltage has a force F that its speed v lowers: -F0 (1 + v/v0) <= F <= F0 (1 - v/v0).
"""

from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from orbits.control import Input
from orbits.errors import InputError, finite_number
from orbits.laws import Algebraic, Scalars
from orbits.model import Affine
from orbits.units import Dimension, Message, Quantity

from .actuated import Actuated, Drive

POWER: Dimension = (0, -1, 0, 1)
# The names of the path constraints of a bound, in both directions.
SIDES_OF_BOUNDS = {
    "stroke": ("room to pull", "room to push"),
    "force": ("force left to push", "force left to pull"),
    "power": ("power left to drive", "power left to brake"),
    "speed_force": ("force left to push at this speed", "force left to pull at this speed"),
}
# The speed at which an actuator has no force left to drive, and its force at rest; None where there is no such bound.
SpeedForce = tuple[float, float] | None


@dataclass(frozen=True)
class Limits:
    """Bounds of the actuator, infinite where there is none, and whether a distance has to stay positive.

    rate : of the rate of its state
    stroke : of its displacement, in both directions
    force, power : of its force and its power on the machine, in both directions
    speed_force : (v0, F0), see the module
    """

    rate: float
    stroke: float
    force: float
    power: float
    separated: bool
    speed_force: SpeedForce = None

    def inputs(self, drive: Drive, cost: str) -> dict[str, Input]:
        """The rate as the stages' input; for the least peak of a rate, the free parameter "peak" bounds it."""
        if cost == "peak" and not drive.actuator.is_force:
            return {drive.actuator.rate: Input(lambda p: -p["peak"], lambda p: p["peak"])}
        return {drive.actuator.rate: Input(-self.rate, self.rate)}

    def path(self, drive: Drive, embed: np.ndarray, cost: str) -> dict[str, Callable]:
        """The path constraints on states that `embed` makes flight states."""
        bounded: dict[str, Callable] = {
            "stroke": lambda x, p, q: drive.travel(product(embed, x), p),
            "force": lambda x, p, q: drive.force(product(embed, x), p, q),
            "power": lambda x, p, q: drive.power(product(embed, x), p, q),
        }
        found: dict[str, Callable] = {}
        for name, of in bounded.items():
            if np.isfinite(bound := getattr(self, name)):
                above, below = SIDES_OF_BOUNDS[name]
                found[above] = lambda x, p, q, of=of, bound=bound: bound - of(x, p, q)
                found[below] = lambda x, p, q, of=of, bound=bound: bound + of(x, p, q)
        if self.speed_force is not None:
            fastest, largest = self.speed_force
            for side, sign in zip(SIDES_OF_BOUNDS["speed_force"], (1.0, -1.0), strict=True):

                def left(x, p, q, sign=sign):
                    flown = product(embed, x)
                    slower = 1.0 - sign * drive.speed(flown, p) / fastest
                    return largest * slower - sign * drive.force(flown, p, q)

                found[side] = left
        if cost == "peak" and drive.actuator.is_force:
            found["peak to push"] = lambda x, p, q: p["peak"] - x[-1]
            found["peak to pull"] = lambda x, p, q: p["peak"] + x[-1]
        if self.separated:
            found["separation"] = lambda x, p, q: drive.model.separation(p).at(product(embed, x))
        return found


def dimensions_of_limits(driven: Actuated) -> dict[str, Dimension]:
    """The dimensions of the bounds by name."""
    own = driven.dimensions
    rate, stroke, force = own[driven.actuator.rate], own["way"], own["actuator force"]
    return {"rate": rate, "stroke": stroke, "force": force, "power": POWER}


def bare_speed_force(driven: Actuated) -> Callable[[SpeedForce, Any], SpeedForce]:
    """What makes the bound of the force by the speed dimensionless, as `in_own_units` takes it."""
    own, units = driven.dimensions, driven.units

    def bare(stated: SpeedForce, machine: Any) -> SpeedForce:
        if stated is None or units is None:
            return stated
        return stated[0] / units.of(own["speed"]), stated[1] / units.of(own["actuator force"])

    return bare


def dimensions_of_rows(driven: Actuated) -> dict[str, Dimension]:
    """The dimensions of the rows of the legs that are not lengths or speeds, by name."""
    bounds = dimensions_of_limits(driven)
    bounds["speed_force"] = bounds["force"]
    sides = {side: bounds[name] for name, both in SIDES_OF_BOUNDS.items() for side in both}
    own = {name: driven.dimensions[name] for name in (driven.actuator.state, driven.actuator.rate)}
    return {**sides, **dict.fromkeys(("peak to push", "peak to pull"), own[driven.actuator.state]), **own}


def actuator_limits(driven: Actuated, speed_force: SpeedForce = None, **bounds: float) -> Limits:
    """The limits of a machine with these bounds; raises `InputError` for bounds that are not above 0."""
    dimensions = dimensions_of_limits(driven)
    for name, bound in bounds.items():
        if not (isinstance(bound, Real) and bound == np.inf) and not finite_number(name, bound) > 0:
            quantity = Quantity(bound, dimensions[name])
            raise InputError(
                Message("{name} = {bound:g}; a bound of the actuator must be above 0", name=name, bound=quantity)
            )
    separated = driven.model.separation(driven.values) is not None
    return Limits(**{n: float(bound) for n, bound in bounds.items()}, separated=separated, speed_force=speed_force)


def product(matrix: np.ndarray, x: Scalars) -> list[Algebraic]:
    """The product of a matrix of numbers with a state's expressions."""
    return [Affine(tuple(row)).at(x) for row in matrix.tolist()]
