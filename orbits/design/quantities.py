"""The quantities of an orbit that a design may ask for, as expressions of what the design statement solves for.

Their names are those of an orbit's JSON document. A quantity at one place of the motion (its middle, its start) is read
there; one that is made of extremes is read at the ends of the arcs that lead to them.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca

from ..model.model import Model
from .extremes import Place, affine, extreme_values, height_that_rises, rise_name
from .statement import base_statement, landing_jerk, landing_sensitivity, loss

# Quantities of every orbit and the powers of length, time and force in their units. The loss coefficient is a loss of
# speed per speed to the power 4/3.
DIMENSIONS = {
    "alpha": (1, -1, 0),
    "flight_time": (0, 1, 0),
    "contact_time": (0, 1, 0),
    "period": (0, 1, 0),
    "liftoff_extension": (1, 0, 0),
    "stroke": (1, 0, 0),
    "clearance": (1, 0, 0),
    "smallest_separation": (1, 0, 0),
    "smallest_contact_force": (0, 0, 1),
    "largest_contact_force": (0, 0, 1),
    "largest_spring_force": (0, 0, 1),
    "landing_jerk": (1, -3, 0),
    "landing_sensitivity": (0, 1, 0),
    "loss_coefficient": (-1 / 3, 1 / 3, 0),
}
# Quantities that need the variation of the flight with respect to alpha.
VARIATIONAL = ("landing_sensitivity", "loss_coefficient")
# The extremes that a quantity is the sum of, each with its sign; a rise has one of its own name.
COMPOSITION = {
    "stroke": {"longest": 1, "shortest": 1},
    "clearance": {"gap": -1},
    "smallest_separation": {"separation": -1},
    "smallest_contact_force": {"force": -1},
    "largest_contact_force": {"peak": 1},
    "largest_spring_force": {"tension": 1},
}


def quantity_names(model: Model, p: Mapping) -> list[str]:
    """The quantities of a model's orbits."""
    missing = [] if model.tension else ["largest_spring_force"]
    missing += [] if model.separation(p) is not None else ["smallest_separation"]
    return [name for name in DIMENSIONS if name not in missing] + [rise_name(height) for height in model.heights(p)]


def unit_of(name: str, length: ca.SX, time: ca.SX, force: ca.SX) -> ca.SX:
    """The unit of a quantity, from those of length, time and force."""
    a, b, c = DIMENSIONS.get(name, (1, 0, 0))
    return length**a * time**b * force**c


def extremes_of(name: str) -> tuple[str, ...]:
    """The names of the extremes that a quantity is made of."""
    return (name,) if name.endswith("_rise") else tuple(COMPOSITION.get(name, ()))


def expressions(
    model: Model, names: Iterable[str], places: Sequence[Place], u: Mapping, ends: Sequence[Sequence], p: Mapping
) -> dict[str, Any]:
    """The quantities of these names as expressions.

    places : of the extremes that they are made of
    u, p : the unknowns of the design statement and the parameters, scalar symbols by name
    ends : the states at the ends of the design statement's arcs, lists of scalar symbols
    """
    names = tuple(names)
    extremes = {name: values[0] for name, values in extreme_values(model, places, u, ends, p).items()}
    half, contact = base_statement(model).arcs[0].duration(u, p), u["contact"]
    jerk = landing_jerk(model, u, p)
    values = {
        "alpha": u["alpha"],
        "flight_time": 2 * half,
        "contact_time": 2 * contact,
        "period": 2 * (half + contact),
        "liftoff_extension": u["liftoff"],
        "landing_jerk": jerk,
    }
    if any(name in VARIATIONAL for name in names):
        slope = landing_sensitivity(model, half, ends[0], p)
        values |= {"landing_sensitivity": slope, "loss_coefficient": loss(model, jerk, slope, u, p)}
    for name in names:
        if name in COMPOSITION:
            values[name] = sum(sign * extremes[extreme] for extreme, sign in COMPOSITION[name].items())
        elif name not in values:
            values[name] = extremes[name] - affine(height_that_rises(model, name, p), model.launch(u, p))
    return {name: values[name] for name in names}
