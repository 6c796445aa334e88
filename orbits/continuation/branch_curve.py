"""Curves of branch points: where runs begin as a third number of the machine is varied."""

from collections.abc import Sequence

import numpy as np

from ..consistency.accepted import check_parameters
from ..curves import Steps
from ..errors import FlowError, InputError, NoOrbit, finite_number, is_list
from ..numerics.roots import solve
from ..periodic.branch_points import BranchPoint, Lateral, branch_point
from ..periodic.find import unknowns_of_hop
from ..running import interrupts
from ..running.exclusive import exclusive
from ..running.time_limit import check_time
from ..shooting.newton_kernel import MOST_NEWTON_STEPS
from ..shooting.single_shooting import Shooting

# Lengths are shares of the way from one value to the next, and corrections shares of the largest unknown.
BETWEEN_VALUES = Steps(first=1.0, longest=1.0, shortest=0.05, apart=np.inf, moved=0.1, corrections=MOST_NEWTON_STEPS)


@exclusive
def follow_branch_points(point: BranchPoint, along: str, values: Sequence[float]) -> tuple[BranchPoint, ...]:
    """The branch points to which one leads as a further number of its machine goes through some values.

    along : the name of the number, which is none of those of the branch point
    values : in the order in which they are gone through

    Returns the branch points as far as they exist: the curve ends before a value where it folds, or where the vertical
    hop ends or is of another family. Raises `InputError` for an invalid name or value.

    >>> from orbits import find_branch_points, follow_branch_points
    >>> from problems import runner
    >>> (point,) = find_branch_points(runner(), {"inertia": (6.0, 8.0), "hip_stiffness": (5.0, 6.0)}, designs=6)
    >>> [round(each.values["inertia"], 4) for each in follow_branch_points(point, "rest_length", [3.75, 3.8])]
    [6.5445, 6.1238]
    """
    if not isinstance(point, BranchPoint):
        raise InputError(f"point = {point!r}; it is one of find_branch_points")
    if not is_list(values):
        raise InputError(f"values = {values!r}; it is a list of values")
    machine, names = point.machine, tuple(point.values)
    check_parameters(machine, along)
    if along in names:
        raise InputError(f"along = '{along}' is a number of the branch point already; name another one")
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
                u = _led(equations, u, p, place, value)
                p[place] = value
                each = branch_point(machine, lateral, equations, u, p)
            except (NoOrbit, FlowError, InputError):
                break
            if each.hop.family != point.hop.family:
                break
            found.append(each)
    return tuple(found)


def _led(
    equations: Shooting, u: np.ndarray, p: np.ndarray, place: int, value: float, steps: Steps = BETWEEN_VALUES
) -> np.ndarray:
    """The unknowns (n,) to which those with parameters (np,) lead as the one at a place goes to a value."""
    here, along, share = p.copy(), equations.parameters[place], steps.first
    while here[place] != value:
        check_time()
        jacobian = equations.evaluate(u, here, (along,)).jacobian
        tangent = -solve(jacobian[:, :-1], jacobian[:, -1])
        while True:
            ahead = here.copy()
            left = value - here[place]
            step = share * (value - p[place])
            ahead[place] = value if abs(step) >= abs(left) else here[place] + step
            with np.errstate(over="ignore"):  # a far value is gone to in smaller steps, or not at all
                guess = u + (ahead[place] - here[place]) * tangent
            try:
                found, _ = equations.newton(guess, ahead, steps.corrections)
                if np.abs(found - guess).max() > steps.moved * np.abs(found).max():
                    raise NoOrbit("the corrector ends far from the predicted branch point")
                break
            except (NoOrbit, FlowError):
                share *= steps.shorter
                if share < steps.shortest:
                    raise
        u, here, share = found, ahead, steps.lengthen * share
    return u
