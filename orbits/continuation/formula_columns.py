"""Formulas of quantities and parameters along a family, from what its points store and from their motions."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ..design import Outputs, known_formula, names_along, values_at_orbits
from ..errors import InputError, NoOrbit
from ..model import Machine
from ..periodic import FRICTION_LEFT, beyond_model, orbit_from
from .motion_columns import names_of_motions, numbers_of_motions
from .point import numbers_at, point_in_units


def formula_along(
    machine: Machine, method: str, values: Sequence[Mapping[str, float]], points: Sequence[Any], text: str
) -> np.ndarray:
    """A formula (m,) of quantities and parameters at points of a family, NaN where an orbit does not have it.

    method, values : as in `numbers_of_motions`

    Raises `InputError` for an unknown name.
    """
    formula = known_formula(text, [*names_along(machine), *beyond_model(machine)], "the quantity", machine)
    if not points:
        return np.zeros(0)
    numbers: dict[str, Any] = {name: [each.get(name, x) for each in values] for name, x in machine.values.items()}
    numbers = {name: np.array(each, dtype=float) for name, each in numbers.items()}
    used = [*Outputs((formula,), ()).quantities(machine.model, machine.values)]
    used += [name for name in beyond_model(machine) if name in formula.names]
    stored, together = points[0].numbers, names_of_motions(machine)
    numbers |= {name: numbers_at(points, name) for name in used if name in stored}
    if FRICTION_LEFT in used and machine.model.planar and machine.model.planar.friction:
        numbers[FRICTION_LEFT] = machine.model.planar.friction(numbers) - numbers_at(points, "friction_needed")
    if wanted := [name for name in used if name in together and name not in stored]:
        numbers |= numbers_of_motions(machine, method, values, points, wanted)
    if (alone := [name for name in used if name not in numbers]) and machine.model.sticks:
        raise InputError(f"'{alone[0]}' cannot be computed for many orbits of a {machine.model.name} together")
    if alone:
        machines = [machine.with_values(**here) for here in values]
        numbers |= dict(zip(alone, _numbers_alone(machines, method, points, alone).T, strict=True))
    return np.broadcast_to(formula(**{name: numbers[name] for name in formula.names}), len(points))


def _numbers_alone(machines: Sequence[Machine], method: str, points: Sequence[Any], names: Sequence[str]) -> np.ndarray:
    """Quantities (m, k) of these names at points of a family that are computed as those of designs are, from whole
    orbits, NaN where a point has none."""
    orbits, found = dict[int, Any](), np.full((len(points), len(names)), np.nan)
    for i, (machine, point) in enumerate(zip(machines, points, strict=True)):
        bare = point_in_units(point, machine.units and machine.units.inverse())
        with suppress(NoOrbit):
            orbits[i] = orbit_from(machine, method, point.u, bare.error)
    if orbits:
        found[[*orbits]] = values_at_orbits([machines[i] for i in orbits], [*orbits.values()], names)
    return found
