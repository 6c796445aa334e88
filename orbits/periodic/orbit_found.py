"""The orbit of a family, or the orbit that a start leads to."""

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import FlowError, InputError, NoOrbit
from ..model import Machine
from ..result import Progress
from ..shooting import equations_of, iterative, method_of
from ..units import Message, in_own_units
from .certification import Solved, certified_orbit, solve_from
from .family_orbits import lowest_of_family
from .orbit import Orbit, orbit_of
from .range_of_law import with_needed_range
from .start import stated_unknowns


@in_own_units(lambda orbit, machine: orbit_of(machine, orbit), start=())
def found_from(machine: Machine, family: int | None, start: Any, method: str, progress: Progress) -> Orbit:
    """The orbit of a family, or the orbit found from a start."""
    if start is None:
        number = family or 1
        return with_needed_range(machine, number, lambda known: lowest_of_family(known, number, method, progress))
    began = time.perf_counter()
    orbit = certified_orbit(machine, solve_near(machine, start, method), began=began)
    if family not in (None, orbit.family):
        raise NoOrbit(f"the start leads to an orbit of family {orbit.family}, not {family}")
    return orbit


def solve_near(machine: Machine, start: Orbit | Mapping[str, float], method: str) -> Solved:
    """The solution that a method finds from a start, as in `find`."""
    method = iterative(method)
    bare = machine.units.dimensionless("start", start) if machine.units else start
    stated = stated_unknowns(machine.model, bare)
    names = equations_of(machine.model, method, tuple(machine.values)).statement.unknowns
    if missing := [name for name in names if name not in stated]:
        raise InputError(f"start has no '{missing[0]}'; the unknowns are {', '.join(names)}")
    try:
        return solve_from(machine, method, np.array([stated[name] for name in names]))
    except FlowError as error:
        raise NoOrbit(Message("the start cannot be followed: {error}", error=error)) from None


def vertical_hop(upright: Machine, family: int) -> Orbit:
    """The lowest hop of a family of the machine that stays upright; raises `NoOrbit` for a hop that is not a motion,
    since runs do not begin near it."""
    hop = lowest_of_family(upright, family, method_of(upright.model))
    if (least := hop.certificate.smallest_separation) is not None and not least > 0:
        raise NoOrbit(
            f"in the vertical hop of family {family} parts pass through each other ({least:.3g}), so "
            "no run begins there; give a start"
        )
    if hop.contact_time is None:
        raise NoOrbit(f"the contact of the vertical hop of family {family} does not end")
    return hop


def unknowns_of_hop(hop: Orbit) -> dict[str, float]:
    """The unknowns of half a vertical hop by name, without dimensions."""
    assert hop.source is not None
    return {name: value for name, value in stated_unknowns(hop.source.model, hop).items() if name != "unfolding"}
