"""Dimensions of the parameters of a mechanism in SI, as far as its statement determines them."""

import math
from collections import defaultdict
from collections.abc import Iterator
from functools import lru_cache
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from ..laws import Key
from ..running import exclusive
from ..units import ACCELERATION, ANGLE, FORCE, INERTIA, LENGTH, MASS, Dimension, unit_text
from .elements import Damper, Inerter, Mass, Spring, Weight, names_in, paths_of, value_of


def dimensions_of_parameters(mechanism: Any) -> dict[str, Dimension]:
    """Dimensions of the parameters of a `Mechanism` that alone are a mass, an inertia, a length, an angle, a
    coefficient or gravity, or that multiply a function of angles in a length, or a power of an extension in a spring's
    law; none of a parameter with two different dimensions."""
    found = defaultdict[object, dict[str, Dimension]](dict)
    for name, dimension in _stated_dimensions(mechanism):
        found[name][unit_text(dimension)] = dimension
    return {name: next(iter(found[name].values())) for name in mechanism.parameters if len(found[name]) == 1}


def _stated_dimensions(mechanism: Any) -> Iterator[tuple[object, Dimension]]:
    """Each parameter's name, or other expression, that has a dimension, with the dimension, once for each place."""
    angles = {*mechanism.angles}
    coordinates = {*mechanism.coordinates, *mechanism.actuators}
    for element in mechanism.elements:
        kind = None
        if isinstance(element, Inerter | Damper | Spring):
            kind = length_or_angle(element.extension, coordinates, angles)
            if kind is LENGTH:
                yield from _lengths(element.extension, coordinates).items()
        match element:
            case Mass() | Weight():
                yield element.mass, MASS
                for place in paths_of(element) if isinstance(element, Mass) else [element.height]:
                    yield from _lengths(place, coordinates).items()
                    yield from _turned(place, frozenset(angles)).items()
            case Inerter(_, inertance) if kind is LENGTH:
                yield inertance, MASS
            case Damper(_, coefficient) if kind is LENGTH:
                yield coefficient, (-1, 1, 1)
            case Spring(_, law) if kind is not None:
                turned = kind is ANGLE
                yield from ((name, _of_power(power, turned)) for name, power in powers_of_coefficients(law).items())
    yield from ((place, ANGLE if name in angles else LENGTH) for name, place in mechanism.rest.items())
    for name, image in [*(mechanism.reversor or {}).items(), *mechanism.symmetry.items()]:
        yield from ((amount, ANGLE if name in angles else LENGTH) for amount in names_in(image) - coordinates)
    for (i, one), (j, other) in product(enumerate(mechanism.coordinates), repeat=2):
        if mechanism.inertia and len({one, other} & angles) in (0, len({one, other})):
            unit = INERTIA if one in angles else MASS
            yield from ((name, unit) for name in _lengths(mechanism.inertia[i][j], coordinates))
    yield from ((length, LENGTH) for *_, length in mechanism.knees)
    yield mechanism.surface_gravity, ACCELERATION
    if mechanism.gravity.text in mechanism.gravity.names:
        yield mechanism.gravity.text, ACCELERATION
    if mechanism.separation is not None:
        yield from _lengths(mechanism.separation, coordinates).items()


def length_or_angle(extension: object, coordinates: set[str], angles: set[str]) -> Dimension | None:
    """The dimension of an extension, a length or an angle, from the coordinates to which it is proportional; None where
    they do not determine it."""
    used = names_in(extension) & coordinates
    if not used & angles:
        return LENGTH
    plain = {name for name in used if plain_slope(extension, name)}
    if plain - angles:
        return LENGTH
    return ANGLE if plain else None


def coefficient_dimensions(law: Key) -> dict[str, Dimension]:
    """Dimensions of the parameters of a spring's law that are coefficients of powers of the extension."""
    return {name: _of_power(power, turned=False) for name, power in powers_of_coefficients(law).items()}


def _of_power(power: float, turned: bool) -> Dimension:
    """The dimension of the coefficient of this power of a length in a force, or if `turned` of an angle in a torque."""
    return (1, 0, 1, 0, 0, -power) if turned else (-power, *FORCE[1:])


def _lengths(height: object, coordinates: set[str]) -> dict[str, Dimension]:
    """The parameters that are added to coordinates in a formula of a height."""
    if not isinstance(height, str):
        return {}
    names = sorted(names_in(height) - coordinates)
    return {name: LENGTH for name in names if abs(plain_slope(height, name)) == 1.0}


@exclusive
@lru_cache(maxsize=256)
def _turned(place: object, angles: frozenset[str]) -> dict[str, Dimension]:
    """The parameters in the formula of a length that are added to angles, and those that are lengths since a function
    of angles alone multiplies them."""
    if not isinstance(place, str) or not names_in(place) & angles:
        return {}
    symbols = {name: ca.SX.sym(name) for name in sorted(names_in(place))}
    slopes = ca.jacobian(ca.SX(value_of(place, symbols, {})), ca.vertcat(*symbols.values()))
    at = ca.Function("slopes", [*symbols.values()], [slopes])
    values = np.array([at(*point).full()[0] for point in np.random.default_rng(0).uniform(0.3, 1.7, (3, len(symbols)))])
    sizes = dict(zip(symbols, np.abs(values).T, strict=True))
    found: dict[str, Dimension] = {
        name: ANGLE for name in symbols.keys() - angles
        if any(sizes[name].any() and np.allclose(sizes[name], sizes[each]) for each in symbols.keys() & angles)
    }  # fmt: skip
    others = [symbols[name] for name in symbols.keys() - angles - found.keys()]
    turning = [symbols[name] for name in symbols.keys() & angles]
    for name, slope in zip(symbols, ca.horzsplit(slopes), strict=True):
        by_angles = ca.depends_on(slope, ca.vertcat(*turning)) and not ca.depends_on(slope, ca.vertcat(*others))
        if by_angles and name not in angles | found.keys():
            found[name] = LENGTH
    return found


@exclusive
@lru_cache(maxsize=256)
def plain_slope(formula: str, name: str) -> float:
    """The derivative of a formula by a name, where it is a number; else 0."""
    symbols = {each: ca.SX.sym(each) for each in names_in(formula)}
    slope = ca.jacobian(ca.SX(value_of(formula, symbols, {})), symbols[name])
    return 0.0 if ca.depends_on(slope, ca.vertcat(*symbols.values())) else float(ca.evalf(slope))


@exclusive
@lru_cache(maxsize=256)
def powers_of_coefficients(law: Key) -> dict[str, float]:
    """The parameters of a spring's law that are coefficients of powers of the extension, with the powers."""
    x, p = ca.SX.sym("x"), {name: ca.SX.sym(name) for name in law.names}
    found: dict[str, float] = {}
    if law.pieces is None:
        for name, symbol in p.items():
            power = ca.jacobian(ca.SX(law.expression(x, p, [])), symbol)
            if ca.depends_on(power, ca.vertcat(*p.values())):
                continue
            low, middle, high = (float(ca.evalf(ca.substitute(power, x, place))) for place in (0.5, 1.0, 2.0))
            if low > 0 and middle > 0 and abs(high * low / middle**2 - 1) < 1e-12:
                found[name] = round(math.log2(high / middle), 9)
    return found
