"""Quantities of a family's orbits that its points do not store, computed for many orbits together from their
motions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..model import Machine
from ..periodic import PLANAR, known_solutions, names_of_many, numbers_of
from ..running import exclusive
from .point import KNOWN

AT_ONCE_IN_TABLE = 500  # orbits whose motions are in memory together


def names_of_motions(machine: Machine) -> tuple[str, ...]:
    """The quantities that are computed from the motions of a machine's orbits."""
    model = machine.model
    names = (name for name in names_of_many(model) if name not in (*KNOWN, *PLANAR))
    return (*names, *model.of_heights(machine.values))


@exclusive
def numbers_of_motions(
    machine: Machine, method: str, values: Sequence[Mapping[str, float]], points: Sequence[Any],
    wanted: Sequence[str] | None = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Quantities (m,) at points of a family, NaN where an orbit does not have one; in the machine's units.

    method : the method by which the family was followed
    values : the parameters that vary along the family, at each point
    wanted : names of the quantities, of `names_of_motions`; None for all of these

    Raises `InputError` for points of another method.
    """
    machine = machine.with_values(**values[0])
    names, model = tuple(machine.values), machine.model
    wanted = names_of_motions(machine) if wanted is None else wanted
    found: dict[str, list[np.ndarray]] = {name: [] for name in wanted}
    for first in range(0, len(points), AT_ONCE_IN_TABLE):
        some = slice(first, first + AT_ONCE_IN_TABLE)
        us, errors = np.array([point.u for point in points[some]]), np.array([point.error for point in points[some]])
        ps = np.array([list({**machine.values, **here}.values()) for here in values[some]])
        cycles = known_solutions(model, method, names, us, ps, errors).cycles
        numbers = numbers_of(model, cycles, None, model.units and model.units(cycles.p), wanted)
        for name in wanted:
            found[name].append(numbers[name])
    return {name: np.concatenate(parts) for name, parts in found.items()}
