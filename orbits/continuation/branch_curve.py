"""Curves of branch points: where runs begin as a third number of the machine is varied."""

from collections.abc import Sequence

import numpy as np

from ..errors import InputError, NoOrbit, finite_number, is_list
from ..model import check_parameters
from ..periodic import BranchPoint, Lateral, along_ways, branch_point, unknowns_of_hop
from ..running import exclusive, interrupts


@exclusive
def follow_branch_points(point: BranchPoint, along: str, values: Sequence[float]) -> tuple[BranchPoint, ...]:
    """Continue a branch point as another parameter of its machine goes through some values.

    point : from `find_branch_points` along : the name of the parameter, not one of the two of the branch point
    values : of the parameter, in order

    Returns a branch point for each value, as far as they exist: the curve ends where it folds, or where the vertical
    hop ends or changes its family. Raises `InputError` for an invalid name or value.

    >>> from orbits import find_branch_points, follow_branch_points
    >>> from problems import runner
    >>> (point,) = find_branch_points(runner(), {"inertia": (6.0, 8.0), "hip_stiffness": (5.0, 6.0)}, designs=6)
    >>> [round(each.values["inertia"], 4) for each in follow_branch_points(point, "rest_length", [3.75, 3.8])]
    [6.5445, 6.1238]
    """
    if not isinstance(point, BranchPoint):
        raise InputError(f"point = {point!r}; it must be a point that find_branch_points returns")
    if point.hop is None:
        raise InputError("a walk begins at this point: find_branch_points of a machine with other values finds others")
    if not is_list(values):
        raise InputError(f"values = {values!r}; it must be a list of values")
    machine, names = point.machine, tuple(point.values)
    check_parameters(machine, along)
    if along in names:
        raise InputError(f"along = '{along}' is a parameter of the branch point already; name another one")
    lateral, found = Lateral(machine, names, point.hop.family), list[BranchPoint]()
    equations, place, p = lateral.branch, lateral.parameters.index(along), lateral.own.copy()
    size = float(np.linalg.norm([*point.direction.values()]))
    first = {**unknowns_of_hop(point.hop), **point.values}
    first |= {name: value / size for name, value in point.direction.items()}
    u = np.array([first[name] for name in equations.statement.unknowns])
    with interrupts.deferred():
        for value in values:
            value = finite_number(along, value)
            try:
                there = p.copy()
                there[place] = value
                with np.errstate(over="ignore"):  # a far value is gone to in shorter steps, or not at all
                    reached = along_ways(equations, u[None], p[None], there[None], (along,))
                if np.isnan(reached.us).any():
                    break
                u, p = equations.newton(reached.us[0], there)[0], there
                each = branch_point(machine, lateral, equations, u, p)
            except (NoOrbit, InputError):
                break
            if not each.hop or each.hop.family != point.hop.family:
                break
            found.append(each)
    return tuple(found)
