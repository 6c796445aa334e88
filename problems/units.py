"""Machines stated in SI: masses in kg, stiffness in N/m, lengths in m, gravity in m/s^2."""

from collections.abc import Mapping
from typing import Any, TypeVar

from orbits.errors import InputError
from orbits.model.model import Units
from orbits.symbolic.formula import suggest

from . import gravity as gravities
from .gravity import as_gravity
from .hopper import Hopper
from .juggler import Juggler
from .laws import Law, number, stated
from .machine import TwoMassMachine
from .springs import as_spring

Kind = TypeVar("Kind", bound=TwoMassMachine)


def hopper_in_si(body_mass: float, foot_mass: float, **statement: Any) -> Hopper:
    """A hopper from the masses of body and foot (kg); the rest as in `machine_in_si`."""
    return machine_in_si(Hopper, {"body_mass": body_mass, "foot_mass": foot_mass}, **statement)


def juggler_in_si(ball_mass: float, hand_mass: float, **statement: Any) -> Juggler:
    """A juggler from the masses of ball and hand (kg); the rest as in `machine_in_si`."""
    return machine_in_si(Juggler, {"ball_mass": ball_mass, "hand_mass": hand_mass}, **statement)


def machine_in_si(
    kind: type[Kind],
    masses: Mapping[str, float],
    *,
    surface_gravity: float = 9.80665,
    stiffness: float | None = None,
    force: Any = None,
    rest_length: float | None = None,
    body_radius: float | None = None,
    gravity: Any = None,
    restitution: float = 0.0,
    damping: float = 0.0,
    drag: float = 0.0,
    parameters: Mapping[str, float] | None = None,
) -> Kind:
    """A dimensionless machine, with the units that bring its results back to SI.

    masses : of the upper and the lower mass, by name, kg
    stiffness : of a linear spring, N/m; beside `force` only where that has no slope at rest to set the units
    force : a spring law in N of the extension in m, stated in any of the ways of `springs.as_spring`; a table's header
        may name other units of length and force
    surface_gravity : m/s^2, where gravity's ratio is 1
    rest_length : of the spring, m
    body_radius : m, of the sphere whose gravity falls off with height
    damping, drag : of the damper beside the spring and on each mass, N s/m
    gravity : instead of body_radius, a ratio as a law of the height in m
    parameters : values of the formulas' other names, in SI

    Lengths are in m2 g/k, forces in m2 g, times in sqrt(m2/k) and, for the hopper, over sqrt(1 + m2/m1) (eq. 2).
    Raises `InputError` that names what cannot be meant.
    """
    upper, lower = (number(name, mass, low=0) for name, mass in masses.items())
    g = number("surface_gravity", surface_gravity, low=0)
    given = {name: number(name, value) for name, value in (parameters or {}).items()}
    spring, k = _spring(force, stiffness, given)
    ratio = number("mass_ratio", lower / upper, low=0)
    weight = number("the weight of the lower mass", lower * g, low=0)
    length = number("the unit of length", weight / k, low=0)
    time = number("the unit of time", (lower / k / (1 + ratio if kind is Hopper else 1)) ** 0.5, low=0)
    law = _gravity_law(gravity, body_radius, given)
    known = [*spring.parameters, *law.parameters]
    if unknown := [name for name in given if name not in known]:
        raise InputError(f"neither formula has a parameter '{unknown[0]}'{suggest(unknown[0], stated(known))}")
    return kind(
        spring=spring.scaled(length, weight) if force is not None else "r",
        gravity=law.scaled(length, 1.0) if law.key.degree() > 0 else law,
        mass_ratio=ratio,
        rest_length=None if rest_length is None else number("rest_length", rest_length, low=0) / length,
        restitution=restitution,
        damping=number("damping", damping) * length / time / weight,
        drag=number("drag", drag) * length / time / weight,
        units=Units(length, time, weight),
    )


def _gravity_law(gravity: Any, body_radius: float | None, given: Mapping[str, float]) -> Law:
    """The law of gravity in SI."""
    if body_radius is None:
        return as_gravity("1" if gravity is None else gravity, given, shared=True)
    if gravity is not None:
        raise InputError("give body_radius or gravity, not both")
    return gravities.formula("1/(1 + z/body_radius)**2", body_radius=number("body_radius", body_radius, low=0))


def _spring(force: Any, stiffness: float | None, given: Mapping[str, float]) -> tuple[Law, float]:
    """The law in SI and the stiffness that sets the units."""
    if force is None:
        if stiffness is None:
            raise InputError("a spring in SI needs its stiffness (N/m) or its force law")
        return as_spring("r"), number("stiffness", stiffness, low=0)
    law = as_spring(force, given, in_si=True, shared=True)
    slope = float(law.with_slope(0.0)[1])
    if stiffness is not None:
        k = number("stiffness", stiffness, low=0)
        if 0 < slope < float("inf") and abs(slope / k - 1) > 1e-6:
            stated = f"the spring '{law.text}' has stiffness {slope:g} N/m at rest, not {k:g}"
            raise InputError(f"{stated}: state it in N of m, and leave stiffness out")
        return law, k
    if not 0 < slope < float("inf"):
        raise InputError(f"the spring '{law.text}' has slope {slope:g} at rest: give the stiffness that sets the units")
    return law, slope
