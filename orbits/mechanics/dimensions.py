"""Dimensions of the parameters of a mechanism in SI, as far as its statement determines them."""

import math
from collections import defaultdict
from collections.abc import Iterator
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..laws import Key
from ..running import exclusive
from ..units import ACCELERATION, ANGLE, INERTIA, LENGTH, MASS, Dimension, unit_text
from .elements import Damper, Inerter, Mass, Spring, Weight, names_in, paths_of, value_of


def dimensions_of_parameters(mechanism: Any) -> dict[str, Dimension]:
    """Dimensions of the parameters of a `Mechanism` that alone are a mass, an inertia, a length, an angle, a
    coefficient or gravity, or that multiply a function of angles in a length, and of parameters that a spring's law
    determines; none of a parameter with two different dimensions."""
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
                yield from ((name, MASS) for name in _summed(element.mass))
                for place in paths_of(element) if isinstance(element, Mass) else [element.height]:
                    yield from _lengths(place, coordinates).items()
                    yield from _turned(place, frozenset(angles)).items()
            case Inerter(_, inertance) if kind is LENGTH:
                yield inertance, MASS
            case Damper(_, coefficient) if kind is LENGTH:
                yield coefficient, (-1, 1, 1)
            case Spring(_, law) if kind is not None:
                yield from ((name, _of_powers(*each, kind is ANGLE)) for name, each in powers_in_law(law).items())
    yield from ((place, ANGLE if name in angles else LENGTH) for name, place in mechanism.rest.items())
    for name, image in [*(mechanism.reversor or {}).items(), *mechanism.symmetry.items()]:
        yield from ((amount, ANGLE if name in angles else LENGTH) for amount in names_in(image) - coordinates)
    for (i, one), (j, other) in product(enumerate(mechanism.coordinates), repeat=2):
        if mechanism.inertia and len({one, other} & angles) in (0, len({one, other})):
            unit = INERTIA if one in angles else MASS
            yield from ((name, unit) for name in _summed(mechanism.inertia[i][j]))
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


def law_dimensions(law: Key) -> dict[str, Dimension]:
    """Dimensions of the parameters of a spring's law, as far as the law determines them."""
    return {name: _of_powers(*each, turned=False) for name, each in powers_in_law(law).items()}


def _of_powers(length: float, force: float, turned: bool) -> Dimension:
    """The dimension of these powers of a length and a force, or if `turned` of an angle and a torque."""
    return (force, 0, force, 0, 0, length) if turned else (length, 0, force)


def _lengths(height: object, coordinates: set[str]) -> dict[str, Dimension]:
    """The parameters that are added to coordinates in a formula of a height."""
    if not isinstance(height, str):
        return {}
    names = sorted(names_in(height) - coordinates)
    return {name: LENGTH for name in names if abs(plain_slope(height, name)) == 1.0}


def _summed(expression: object) -> list[str]:
    """The names that a formula adds, each times a number."""
    return [name for name in sorted(names_in(expression)) if plain_slope(str(expression), name)]


@exclusive
@lru_cache(maxsize=256)
def _turned(place: object, angles: frozenset[str]) -> dict[str, Dimension]:
    """The parameters in the formula of a length that are added to angles, and the parameters that are lengths since a
    function of angles alone multiplies them."""
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
def powers_in_law(law: Key) -> dict[str, tuple[float, float]]:
    """The powers of an extension and of a force that are the units of the parameters of a spring's law.

    A coefficient of a power of the extension is a force over that power. The units of the others follow where the law
    is homogeneous; units that it leaves open, and units of numbers without a unit, are left out.
    """
    x, p = ca.SX.sym("x"), {name: ca.SX.sym(name) for name in law.names}
    if law.pieces is None:
        forces = [law.expression(x, p, [])]
    elif law.written and not (law.written.rows or law.written.potential):
        forces = [value_of(text, {"r": x}, p) for text in law.written.formulas]
    else:
        return {}
    value, found = ca.SX(ca.vertcat(*forces)), dict[str, tuple[float, float]]()
    for name, symbol in p.items() if law.pieces is None else ():
        power = ca.jacobian(value, symbol)
        if ca.depends_on(power, ca.vertcat(*p.values())):
            continue
        low, middle, high = (float(ca.evalf(ca.substitute(power, x, place))) for place in (0.5, 1.0, 2.0))
        if low > 0 and middle > 0 and abs(high * low / middle**2 - 1) < EULER.tolerance:
            found[name] = -round(math.log2(high / middle), 9), 1.0
    if found.keys() < p.keys():
        found = _by_euler(value, x, p, found)
    return {name: powers for name, powers in found.items() if any(powers)}


class Euler(NamedTuple):
    """How units follow from a homogeneous law.

    places : number of random places and parameters
    sizes : of these
    tolerance : the largest share of a residual, and of a direction in which powers are open, that counts as rounding
    """

    places: int = 60
    sizes: tuple[float, float] = (0.3, 1.7)
    tolerance: float = 1e-9


EULER = Euler()


def _by_euler(
    value: ca.SX, x: ca.SX, p: dict[str, ca.SX], known: dict[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """The powers a and b of the parameters p in a law f(x, p), from Euler's theorem of homogeneous functions,
    sum a p df/dp = -x df/dx and sum b p df/dp = f, at random places; those known before where it is not homogeneous."""
    symbols, rng = ca.vertcat(*p.values()), np.random.default_rng(0)
    parts = ca.horzcat(value, x * ca.jacobian(value, x), ca.jacobian(value, symbols) @ ca.diag(symbols))
    at = ca.Function("parts", [x, symbols], [ca.densify(parts)])
    rows = np.vstack([at(*np.split(rng.uniform(*EULER.sizes, 1 + len(p)), [1])).full() for _ in range(EULER.places)])
    rows = rows[np.isfinite(rows).all(1)]
    stated = np.array([known.get(name, (np.nan, np.nan)) for name in p])
    free, slopes = np.isnan(stated[:, 0]), rows[:, 2:]
    targets = np.column_stack([-rows[:, 1], rows[:, 0]]) - slopes[:, ~free] @ stated[~free]
    powers, *_ = np.linalg.lstsq(slopes[:, free], targets, rcond=EULER.tolerance)
    if not len(rows) or np.abs(slopes[:, free] @ powers - targets).max() > EULER.tolerance * np.abs(rows).max():
        return known
    _, sizes, directions = np.linalg.svd(slopes[:, free])
    rank = int((sizes > EULER.tolerance * sizes[0]).sum())
    open_ones = np.abs(directions[rank:]).max(axis=0, initial=0.0) > EULER.tolerance
    stated[free] = np.where(open_ones[:, None], np.nan, np.round(powers, 6) + 0.0)
    return {name: (float(a), float(b)) for name, (a, b) in zip(p, stated, strict=True) if np.isfinite(a)}
