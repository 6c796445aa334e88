"""Whole orbits at points of a family, with their motions, from the unknowns that the points keep."""

import time

import numpy as np

from ..errors import InputError
from ..model.machine import Machine
from ..periodic.find import certified_orbit
from ..periodic.formulations import equations_of
from ..periodic.orbit import Orbit, orbit_of
from ..running.exclusive import exclusive


@exclusive
def orbit_from(machine: Machine, method: str, u: tuple[float, ...], error: float) -> Orbit:
    """The whole orbit of a machine whose unknowns by this method are known, in the machine's units.

    u : without dimensions; further ones after those of an orbit are left out
    error : of its launch speed, without dimensions

    Raises `InputError` for unknowns of another method.
    """
    began, equations = time.perf_counter(), equations_of(machine.model, method, tuple(machine.values))
    size = len(equations.statement.unknowns)
    if len(u) < size:
        raise InputError("this family was followed by another method than its settings say")
    us, ps = np.array([u[:size]]), np.array([list(machine.values.values())])
    return orbit_of(
        machine, certified_orbit(machine, method, us[0], equations.evaluate_all(us, ps), error, began=began)
    )
