"""The active constraints of a design, their multipliers, and the demands of its orbit on a motion.

The conditions of optimality are those of Karush, Kuhn and Tucker in the parameters alone; the orbit is a function of
these by the implicit function theorem.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..model.machine import Machine
from ..periodic.orbit import Orbit
from .design_point import DEMAND_MARGIN, DesignPoint
from .design_quantities import FRICTION_LEFT
from .problem import DesignProblem

ACTIVE = 1e-7  # a bound or a constraint is active within this share of its size; solutions are more exact than that
AT_TWO_PLACES = "an extreme at two places"


@dataclass(frozen=True)
class Active:
    """A constraint, bound or condition of a motion that is active at the optimum.

    text : the constraint, bound or condition
    multiplier : improvement of the objective per unit by which the constraint is relaxed, to first order; for an
        equality constraint, per unit by which its value is raised; None in files of searches without derivatives
    """

    text: str
    multiplier: float | None


class ActiveRow(NamedTuple):
    """An active constraint: its gradient (k,), pointing outwards, in scaled units; the size of its scaled unit; and
    whether it is an equation, so that its multiplier may be negative."""

    text: str
    gradient: np.ndarray
    unit: float
    equation: bool


def constraint_sizes(problem: DesignProblem, point: DesignPoint) -> np.ndarray:
    """The unit of each constraint: the largest of its bounds and of the terms that it compares; where that is zero, its
    value, or its change by the parameters. The units stay fixed: with shrinking units it would never count as met."""
    known, theta, sizes = point.machine.values | point.quantities, point.theta, []
    ranges = np.where(theta, np.abs(theta), np.subtract(problem.high, problem.low))
    for constraint, value, slope in zip(problem.constraints, point.values[1:], point.slopes[1:], strict=False):
        terms = constraint.formula.terms
        magnitudes = [abs(bound) for bound in (constraint.low, constraint.high) if np.isfinite(bound)]
        if len(terms) > 1:
            magnitudes += [abs(float(term(**{name: known[name] for name in term.names}))) for term in terms]
        sizes.append(max(magnitudes) or max(abs(value), (np.abs(slope) * ranges).max()) or 1.0)
    return np.array(sizes)


def demands_of(machine: Machine, orbit: Orbit, known: Sequence[str]) -> tuple[str, ...]:
    """The known demands, and the quantities of an orbit that are too small, or nearly so, for a motion."""
    model, names = machine.model, ["clearance", "smallest_separation", "smallest_contact_force"]
    names += ["smallest_stance_force"] if model.violations.get("stance") else []
    margins = {name: getattr(orbit.certificate, name) for name in names}
    if (needed := orbit.certificate.friction_needed) is not None and model.planar and model.planar.friction:
        margins[FRICTION_LEFT] = model.planar.friction(machine.values) - needed
    small = [name for name, margin in margins.items() if margin is not None and margin < 2 * DEMAND_MARGIN]
    return (*known, *(name for name in small if name not in known))


def active_bounds(problem: DesignProblem, theta: np.ndarray) -> list[ActiveRow]:
    """The active bounds of the parameters."""
    rows, directions = [], np.eye(len(theta))
    for i, (name, unit) in enumerate(zip(problem.names, problem.units(theta), strict=True)):
        for side, bound, relation in ((-1.0, problem.low[i], ">="), (1.0, problem.high[i], "<=")):
            if abs(theta[i] - bound) <= ACTIVE * unit:
                rows.append(ActiveRow(f"{name} {relation} {bound:g}", side * directions[i], unit, False))
    return rows


def active_constraints(problem: DesignProblem, point: DesignPoint, scales: np.ndarray) -> tuple[list[ActiveRow], float]:
    """The active constraints and demands, and the largest violation, scaled."""
    rows, violation, units = list[ActiveRow](), 0.0, problem.units(point.theta)
    stated = [(c.text, c.low, c.high) for c in problem.constraints]
    stated += [(f"{name} > 0", 0.0, np.inf) for name in ("-landing_jerk", *point.demands)]
    sizes = [*(1.0 for _ in problem.constraints), *point.sizes]
    results = zip(stated, point.values[1:], point.slopes[1:], scales[1:], sizes, strict=False)
    for (text, low, high), value, slope, scale, size in results:
        violation = max(violation, max(low - value, value - high, 0.0) / scale)
        for side, bound in ((-1.0, low), (1.0, high)):
            if abs(value - bound) <= ACTIVE * scale:
                rows.append(ActiveRow(text, side * slope * units / scale, scale * size, low == high))
                break
    return rows, violation


def multipliers_of(slope: np.ndarray, rows: Sequence[ActiveRow]) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers, not negative for inequalities, that make slope + sum(multiplier * gradient) least; and that sum."""
    # Inequalities are dropped one after another, the most negative multiplier first.
    multipliers, used = np.zeros(len(rows)), list(range(len(rows)))
    while used:
        found = np.linalg.lstsq(np.array([rows[i].gradient for i in used]).T, -slope, rcond=None)[0]
        worst = min(range(len(used)), key=lambda j: 0.0 if rows[used[j]].equation else found[j])
        if rows[used[worst]].equation or found[worst] >= 0:
            multipliers[used] = found
            break
        del used[worst]
    return multipliers, slope + sum((x * row.gradient for x, row in zip(multipliers, rows, strict=True)), 0.0 * slope)


def active_at(problem: DesignProblem, point: DesignPoint, scales: np.ndarray) -> tuple[tuple[Active, ...], float]:
    """What is active at a design, with the multipliers, and the largest violation of the optimality conditions.

    scales : of the objective, the constraints, the landing jerk, the demands and the ties
    """
    units, size = problem.units(point.theta), abs(scales[0])
    rows, violation = active_constraints(problem, point, scales)
    # Where two places have the same extreme, either one may be the larger.
    tied = point.slopes[point.tied] * units / size
    ties = [ActiveRow(AT_TWO_PLACES, row, size, True) for row in tied]
    rows = [*active_bounds(problem, point.theta), *rows, *ties]
    multipliers, rest = multipliers_of(problem.sign * point.slopes[0] * units / size, rows)
    active = tuple(Active(r.text, float(x * size / r.unit)) for r, x in zip(rows, multipliers, strict=True) if x)
    return active, max(float(np.abs(rest).max()), violation)
