"""Bounds of an actuator: of the rate of its state, its displacement, its force and its power."""

from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real

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
}


@dataclass(frozen=True)
class Limits:
    """Bounds of the actuator, infinite where there is none, and whether a distance has to stay positive.

    rate : of the rate of its state
    stroke : of its displacement, in both directions
    force, power : of its force and its power on the machine, in both directions
    """

    rate: float
    stroke: float
    force: float
    power: float
    separated: bool

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


def dimensions_of_rows(driven: Actuated) -> dict[str, Dimension]:
    """The dimensions of the rows of the legs that are no lengths or speeds, by name."""
    bounds = dimensions_of_limits(driven)
    sides = {side: bounds[name] for name, both in SIDES_OF_BOUNDS.items() for side in both}
    own = {name: driven.dimensions[name] for name in (driven.actuator.state, driven.actuator.rate)}
    return {**sides, **dict.fromkeys(("peak to push", "peak to pull"), own[driven.actuator.state]), **own}


def actuator_limits(driven: Actuated, **bounds: float) -> Limits:
    """The limits of a machine with these bounds; raises `InputError` for bounds that are not above 0."""
    dimensions = dimensions_of_limits(driven)
    for name, bound in bounds.items():
        if not (isinstance(bound, Real) and bound == np.inf) and not finite_number(name, bound) > 0:
            quantity = Quantity(bound, dimensions[name])
            raise InputError(Message("{name} = {bound:g}: the actuator's bound is above 0", name=name, bound=quantity))
    separated = driven.model.separation(driven.values) is not None
    return Limits(**{name: float(bound) for name, bound in bounds.items()}, separated=separated)


def product(matrix: np.ndarray, x: Scalars) -> list[Algebraic]:
    """The product of a matrix of numbers with a state's expressions."""
    return [Affine(tuple(row)).at(x) for row in matrix.tolist()]
