"""Rollouts: the solution of the nonlinear program integrated accurately, open loop, with its errors."""

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from ..flow.trajectory import Trajectory
from ..numerics.bernstein import PiecewisePolynomials, powers
from .motion import ControlledLeg, WarmStart
from .stage import Stage, stage_flow
from .transcription import StageUnknowns, Transcription


@dataclass(frozen=True, eq=False)
class StageRollout:
    """A stage integrated accurately from its first state through all its intervals.

    path : the motion, states and then path expressions
    nodes : states (n, N + 1) at the ends of the intervals
    cost : the running cost
    interval, began : of each step of the motion, (steps,), the interval that it is in and the share of it at which it
        begins
    overstepped : the most by which an input leaves its bounds
    """

    stage: Stage
    path: Trajectory
    nodes: np.ndarray
    cost: float
    interval: np.ndarray
    began: np.ndarray
    overstepped: float

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """The first and the last state."""
        return self.nodes[:, 0], self.nodes[:, -1]

    def distance(self, nodes: np.ndarray) -> float:
        """The largest distance of its states from those at the shooting nodes (n, N + 1), relative to their size."""
        return float((np.abs(self.nodes - nodes) / (1.0 + np.abs(nodes).max(1, keepdims=True))).max())

    @cached_property
    def _minima(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Of each path expression the minimum (N,) on each interval, and the share (N,) of it at which that lies."""
        counts, found = np.bincount(self.interval), {}
        first = np.cumsum(counts) - counts
        h = self.path.times[-1] / self.stage.intervals
        for name in self.stage.path:
            values, piece, t = PiecewisePolynomials(self.path.row(name), self.path.steps, counts).lowest()
            found[name] = values, np.clip(self.began[first + piece] + t / h, 0.0, 1.0)
        return found

    @property
    def violation(self) -> float:
        """The most by which a path expression falls below zero, or an input leaves its bounds."""
        return max([self.overstepped, 0.0, *(-float(values.min()) for values, _ in self._minima.values())])

    def low(self, tolerance: float) -> list[str]:
        """Names of the path expressions that fall below zero by more than the tolerance."""
        return [name for name, (values, _) in self._minima.items() if values.min() < -tolerance]

    def dips(self, tolerance: float) -> list[tuple[int, float]]:
        """Intervals, and shares of them, where a path expression falls below zero by more than the tolerance."""
        found = {
            (int(i), float(shares[i]))
            for values, shares in self._minima.values()
            for i in np.flatnonzero(values < -tolerance)
        }
        return sorted(found)


@dataclass(frozen=True)
class MotionRollout:
    """All stages of a solution integrated accurately.

    unknowns : unknowns of each stage in the nonlinear program
    values : values of all parameters
    cost, error, violation : as in `Control`
    """

    unknowns: list[StageUnknowns]
    values: np.ndarray
    stages: list[StageRollout]
    cost: float
    error: float
    violation: float

    def legs(self) -> tuple[ControlledLeg, ...]:
        """The legs of the accurate motion."""
        starts = np.cumsum([0.0, *(part.duration for part in self.unknowns)]).tolist()
        return tuple(
            ControlledLeg(of.stage.phase.name, start, of.path, input_polynomials(of.stage, duration, coefficients))
            for of, (duration, _, coefficients), start in zip(self.stages, self.unknowns, starts, strict=False)
        )


def roll_out(solution: WarmStart, cost: float, fixed: np.ndarray) -> MotionRollout:
    """Integrate a solution, whose cost in the nonlinear program is given, at the given parameters `fixed`."""
    problem = solution.problem
    unknowns, values = problem.unpack(solution.x), np.concatenate([fixed, problem.free_values(solution.x)])
    pairs = zip(problem.stages, unknowns, strict=True)
    stages = [roll_out_stage(stage, problem.names, values, part) for stage, part in pairs]
    accurate, missed = _cost_and_defect(problem, values, stages)
    distance = max(stage.distance(part.nodes) for stage, part in zip(stages, unknowns, strict=True))
    error = max(distance, abs(accurate - cost) / max(solution.unit, abs(cost)))
    violation = max(missed, *(stage.violation for stage in stages))
    return MotionRollout(unknowns, values, stages, accurate, error, violation)


def _cost_and_defect(problem: Transcription, values, stages: list[StageRollout]) -> tuple[float, float]:
    """The cost of the accurate motion, and the most by which it misses a condition at an end of a stage."""
    found = list(problem.end_conditions(values, [stage.ends for stage in stages]))
    cost = float(sum(float(final) for *_, final, _, _ in found) + sum(stage.cost for stage in stages))
    arrays = [[np.array(part) for part in parts[:3]] for parts in found]
    off = [np.concatenate([np.abs(start), np.abs(end), -above], axis=None) for start, end, above in arrays]
    return cost, max(float(part.max(initial=0.0)) for part in off)


def roll_out_stage(stage: Stage, names: tuple[str, ...], values: np.ndarray, unknowns: StageUnknowns) -> StageRollout:
    """Integrate a stage of a solution accurately, open loop, with parameters `names` of the given values."""
    flow, (duration, nodes, coefficients) = stage_flow(stage, names), unknowns
    size, n, h = len(stage.phase.states), stage.intervals, duration / stage.intervals
    x, cost, blocks, lengths, interval, began, ends = nodes[:, 0], 0.0, [], [], [], [], [nodes[:, 0]]
    keep = [*range(size), *range(size + 2, len(flow.names))]  # all rows but those of the clock and the cost
    for i in range(n):
        path, _ = flow.run([*x, 0.0, 0.0], np.concatenate([values, [h], coefficients[:, i]]), 1.0)
        x, cost = path.end[:size], cost + path.end[size + 1]
        ends.append(x)
        blocks.append(path.coefficients[:, keep] / powers(h, path.coefficients.shape[2]))
        lengths.append(path.steps * h)
        interval += [i] * len(path.steps)
        began.append(path.times[:-1])
    times = np.concatenate([[0.0], np.cumsum(np.concatenate(lengths))])
    times[-1] = duration
    dense = Trajectory(times, np.concatenate(blocks), tuple(flow.names[i] for i in keep))
    overstepped = _overstepped(stage, dict(zip(names, values, strict=True)), coefficients)
    return StageRollout(stage, dense, np.array(ends).T, cost, np.array(interval), np.concatenate(began), overstepped)


def _overstepped(stage: Stage, named: dict[str, float], coefficients: np.ndarray) -> float:
    """The most by which inputs with these coefficients (m, N) leave their bounds, 0 where they do not."""
    most = 0.0
    for name, rows in stage.input_rows().items():
        given, values = stage.inputs[name], coefficients[rows]
        low, high = (float(bound(named)) if callable(bound) else bound for bound in (given.low, given.high))
        most = max(most, float((low - values).max()), float((values - high).max()))
    return most


def input_polynomials(stage: Stage, duration: float, coefficients: np.ndarray) -> Trajectory:
    """The inputs of a stage as polynomials of its time, from Bernstein coefficients (m, N) on its intervals."""
    n, most = stage.intervals, 1 + max((given.degree for given in stage.inputs.values()), default=0)
    monomial, h = np.zeros((n, len(stage.inputs), most)), duration / n
    for i, rows in enumerate(stage.input_rows().values()):
        bernstein = coefficients[rows]
        degree = len(bernstein) - 1
        for k in range(degree + 1):  # monomial coefficients are differences of Bernstein coefficients
            difference = sum((-1) ** (k - j) * comb(k, j) * bernstein[j] for j in range(k + 1))
            monomial[:, i, k] = comb(degree, k) * difference / h**k
    return Trajectory(np.linspace(0, duration, n + 1), monomial, tuple(stage.inputs))
