"""Quantities of a family's orbits that its points do not keep: of many orbits at once, from their motions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..model.machine import Machine
from ..periodic.formulations import equations_of, interpret
from ..periodic.orbits_at_once import Orbits, numbers_of
from ..running.exclusive import exclusive

# Quantities that the motions tell, besides the rises of the heights.
OF_MOTIONS = ("stroke",)
AT_ONCE_IN_TABLE = 500  # orbits whose motions are in memory together


def names_of_motions(machine: Machine) -> tuple[str, ...]:
    """The quantities that are computed from the motions of a machine's orbits."""
    return (*OF_MOTIONS, *machine.model.rises(machine.values))


@exclusive
def numbers_of_motions(
    machine: Machine, method: str, values: Sequence[Mapping[str, float]], points: Sequence[Any]
) -> dict[str, np.ndarray]:
    """The quantities `names_of_motions` (m,) at points of a family, NaN where an orbit does not have one; in the
    machine's units.

    method : by which the family was followed
    values : of the parameters that vary along the family, at each point

    Raises `InputError` for points of another method.
    """
    machine = machine.with_values(**values[0])
    names, wanted = tuple(machine.values), names_of_motions(machine)
    equations = equations_of(machine.model, method, names)
    size = len(equations.statement.unknowns)
    if any(len(point.u) < size for point in points):
        raise InputError("this family was followed by another method than its settings say")
    found: dict[str, list[np.ndarray]] = {name: [] for name in wanted}
    for first in range(0, len(points), AT_ONCE_IN_TABLE):
        some = slice(first, first + AT_ONCE_IN_TABLE)
        us = np.array([point.u[:size] for point in points[some]])  # a curve of folds has further unknowns
        ps = np.array([list({**machine.values, **here}.values()) for here in values[some]])
        errors, everyone = np.array([point.error for point in points[some]]), np.arange(len(us))
        cycles = interpret(machine.model, method, equations, us, ps, equations.evaluate_all(us, ps), errors)
        units = machine.model.units and machine.model.units(cycles.p)
        numbers = numbers_of(machine.model, Orbits(everyone, everyone, cycles, []), units, wanted)
        for name in wanted:
            found[name].append(numbers[name])
    return {name: np.concatenate(parts) for name, parts in found.items()}
