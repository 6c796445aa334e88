"""Optimality conditions at a certified orbit: the active constraints, their multipliers, and the residual.

The conditions are those of Karush, Kuhn and Tucker in the parameters alone; the orbit is a function of these by the
implicit function theorem.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..model.machine import Machine
from ..periodic.orbit import Orbit
from .nlp import DesignPoint
from .problem import DesignProblem

# A bound or a constraint is active within this share of its size; the nonlinear program is solved more exactly.
ACTIVE = 1e-7


@dataclass(frozen=True)
class Active:
    """Something that keeps the optimum from being better.

    text : the constraint, bound or demand
    multiplier : by how much the objective would get better per unit by which the constraint is relaxed, to first order;
        for an equation, per unit by which its value is raised
    """

    text: str
    multiplier: float


@dataclass(frozen=True, eq=False)
class LocalOptimum:
    """The optimum that a start leads to.

    objective : value of the objective, with the opposite sign where it is maximised
    active, idle, kkt : as in `optimize.Design`
    """

    machine: Machine
    orbit: Orbit
    objective: float
    quantities: Mapping[str, float]
    active: tuple[Active, ...]
    idle: tuple[str, ...]
    kkt: float


class _ActiveRow(NamedTuple):
    """An active constraint: its gradient (k,), pointing outwards, in scaled units.

    unit : what one scaled unit of the constraint is
    equation : whether its multiplier may be negative
    """

    text: str
    gradient: np.ndarray
    unit: float
    equation: bool


def optimum_at(
    machine: Machine, orbit: Orbit, problem: DesignProblem, point: DesignPoint, scales: np.ndarray, flat: np.ndarray
) -> LocalOptimum:
    """The local optimum with its optimality conditions, all recomputed at the certified orbit.

    point : the objective, the constraints and the demands at that orbit
    scales : of these, as in `DesignPoint.minimise`
    flat : which parameters (k,) none of them depended on at the start
    """
    units, size = problem.units(point.theta), abs(scales[0])
    rows, violation = _active_constraints(problem, point, scales)
    # Where two places have the same extreme, each may be the one that is the larger.
    ties = [
        _ActiveRow("an extreme at two places", row * units / size, size, True)
        for row in point.slopes[point.program.tied]
    ]
    rows = [*_active_bounds(problem, point.theta), *rows, *ties]
    multipliers, rest = _multipliers(problem.sign * point.slopes[0] * units / size, rows)
    return LocalOptimum(
        machine,
        orbit,
        float(problem.sign * point.values[0]),
        point.quantities,
        tuple(Active(row.text, float(x * size / row.unit)) for row, x in zip(rows, multipliers, strict=True) if x),
        _idle(problem, flat & ~point.slopes[: len(scales)].any(0)),
        max(float(np.abs(rest).max()), violation),
    )


def _active_bounds(problem: DesignProblem, theta: np.ndarray) -> list[_ActiveRow]:
    """The bounds that the parameters are on."""
    rows, directions = [], np.eye(len(theta))
    for i, (name, unit) in enumerate(zip(problem.names, problem.units(theta), strict=True)):
        for side, bound, relation in ((-1.0, problem.low[i], ">="), (1.0, problem.high[i], "<=")):
            if abs(theta[i] - bound) <= ACTIVE * unit:
                rows.append(_ActiveRow(f"{name} {relation} {bound:g}", side * directions[i], unit, False))
    return rows


def _active_constraints(
    problem: DesignProblem, point: DesignPoint, scales: np.ndarray
) -> tuple[list[_ActiveRow], float]:
    """The active constraints and demands, and the largest violation, scaled."""
    rows, violation, units = [], 0.0, problem.units(point.theta)
    stated = [(c.text, c.low, c.high) for c in problem.constraints]
    stated += [(f"{name} > 0", 0.0, np.inf) for name in ("-landing_jerk", *point.demands)]
    results = point.scaled_values[1:], point.slopes[1:], scales[1:]
    for (text, low, high), value, slope, scale in zip(stated, *results, strict=False):
        violation = max(violation, max(low - value, value - high, 0.0) / scale)
        for side, bound in ((-1.0, low), (1.0, high)):
            if abs(value - bound) <= ACTIVE * scale:
                rows.append(_ActiveRow(text, side * slope * units / scale, scale, low == high))
                break
    return rows, violation


def _idle(problem: DesignProblem, flat: np.ndarray) -> tuple[str, ...]:
    """The parameters that no formula names and that nothing depends on: the derivatives are zero by structure."""
    named = problem.formula.names.union(*(constraint.formula.names for constraint in problem.constraints))
    idle = tuple(name for name, still in zip(problem.names, flat, strict=True) if still and name not in named)
    if len(idle) == len(problem.names):
        raise InputError(f"'{problem.text}' and the constraints do not depend on {', '.join(idle)}: nothing to design")
    return idle


def _multipliers(slope: np.ndarray, rows: Sequence[_ActiveRow]) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers, not negative for inequalities, that make slope + sum(multiplier * gradient) smallest; and that sum.

    Inequalities are dropped one after another, the most negative multiplier first.
    """
    multipliers, used = np.zeros(len(rows)), list(range(len(rows)))
    while used:
        found = np.linalg.lstsq(np.array([rows[i].gradient for i in used]).T, -slope, rcond=None)[0]
        worst = min(range(len(used)), key=lambda j: 0.0 if rows[used[j]].equation else found[j])
        if rows[used[worst]].equation or found[worst] >= 0:
            multipliers[used] = found
            break
        del used[worst]
    return multipliers, slope + sum((x * row.gradient for x, row in zip(multipliers, rows, strict=True)), 0.0 * slope)
