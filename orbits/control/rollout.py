"""Solutions of the nonlinear program of optimal control integrated accurately, open loop, and their errors."""

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from ..flow import Trajectory
from ..numerics import PiecewisePolynomials, powers
from .control import Control, ControlledLeg, WarmStart
from .stage import RUNNING_COST, Stage, stage_flow
from .transcription import StageUnknowns


@dataclass(frozen=True, eq=False)
class StageRollout:
    """A stage integrated accurately from its first state through all its intervals."""

    stage: Stage
    unknowns: StageUnknowns  # those of the stage in the nonlinear program
    path: Trajectory  # the motion: states, path expressions, and the running cost of the stage so far
    nodes: np.ndarray  # states (n, N + 1) at the ends of the intervals
    cost: float  # the running cost
    interval: np.ndarray  # that of each step (steps,) of the motion
    began: np.ndarray  # the share of its interval at which each step begins
    overstepped: float  # the most by which an input leaves its bounds

    @property
    def distance(self) -> float:
        """The largest distance of its states from those at the shooting nodes, relative to their size."""
        nodes = self.unknowns.nodes
        return float((np.abs(self.nodes - nodes) / (1.0 + np.abs(nodes).max(1, keepdims=True))).max())

    @cached_property
    def minima(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Of each path expression the minimum (N,) on each interval, and the share (N,) of it at which that lies."""
        counts, h, found = np.bincount(self.interval), self.path.times[-1] / self.stage.intervals, {}
        first = np.cumsum(counts) - counts
        for name in self.stage.path:
            values, piece, t = PiecewisePolynomials(self.path.row(name), self.path.steps, counts).lowest()
            found[name] = values, np.clip(self.began[first + piece] + t / h, 0.0, 1.0)
        return found

    @property
    def violation(self) -> float:
        """The most by which a path expression falls below zero, or an input leaves its bounds."""
        return max([self.overstepped, 0.0, *(-float(values.min()) for values, _ in self.minima.values())])

    def dips(self, tolerance: float) -> list[tuple[int, float]]:
        """Intervals, and shares of them, where a path expression falls below zero by more than the tolerance."""
        below = ((t, np.flatnonzero(values < -tolerance)) for values, t in self.minima.values())
        return sorted({(int(i), float(t[i])) for t, where in below for i in where})


@dataclass(frozen=True)
class MotionRollout:
    """All stages of a solution integrated accurately; `values` of all parameters, and the rest as in `Control`."""

    values: np.ndarray
    stages: list[StageRollout]
    cost: float
    error: float
    violation: float

    def legs(self) -> tuple[ControlledLeg, ...]:
        """The legs of the accurate motion."""
        ends = np.cumsum([0.0, *(of.unknowns.duration for of in self.stages)]).tolist()
        phases, inputs = [of.stage.phase for of in self.stages], [_input_polynomials(of) for of in self.stages]
        names, states = [phase.name for phase in phases], [phase.states for phase in phases]
        return tuple(map(ControlledLeg, names, ends, [of.path for of in self.stages], inputs, states))

    def control(self, solution: WarmStart, iterations: int, rounds: int, seconds: float = 0.0) -> Control:
        """The motion as the result of a search that ends at a solution."""
        named = dict(zip(solution.problem.names, self.values.tolist(), strict=True))
        work = iterations, rounds, seconds
        return Control(self.legs(), self.cost, named, self.violation, self.error, *work, warm_start=solution)


def roll_out(solution: WarmStart, cost: float, fixed: np.ndarray) -> MotionRollout:
    """Integrate a solution, whose `cost` is that of the nonlinear program, at the fixed parameters' values `fixed`."""
    problem, x = solution.problem, solution.x
    values = np.concatenate([fixed, x[len(x) - len(problem.free) :]])
    pairs = zip(problem.stages, problem.unpack(x), strict=True)
    stages = [_roll_out_stage(stage, problem.names, values, part) for stage, part in pairs]
    ends, durations = [(of.nodes[:, 0], of.nodes[:, -1]) for of in stages], [of.unknowns.duration for of in stages]
    conditions = list(problem.end_conditions(values, ends, durations))
    accurate = float(sum(float(final) for *_, final, _, _ in conditions) + sum(of.cost for of in stages))
    arrays = [[np.array(part) for part in parts[:3]] for parts in conditions]
    missed = [np.concatenate([np.abs(start), np.abs(end), -above], axis=None) for start, end, above in arrays]
    error = max(*(of.distance for of in stages), abs(accurate - cost) / max(solution.unit, abs(cost)))
    violation = max([float(off.max(initial=0.0)) for off in missed] + [of.violation for of in stages])
    return MotionRollout(values, stages, accurate, error, violation)


def _roll_out_stage(stage: Stage, names: tuple[str, ...], values, unknowns: StageUnknowns) -> StageRollout:
    """Integrate a stage of a solution accurately, with parameters `names` of these `values`."""
    flow, (duration, nodes, coefficients) = stage_flow(stage, names), unknowns
    size, h, x, cost = len(stage.phase.states), duration / stage.intervals, nodes[:, 0], 0.0
    paths, blocks, ends = [], [], [x]
    keep = [*range(size), *range(size + 2, len(flow.names)), size + 1]  # all rows but that of the clock
    for i in range(stage.intervals):
        path, _ = flow.run([*x, 0.0, 0.0], np.concatenate([values, [h], coefficients[:, i]]), 1.0)
        rows = path.coefficients[:, keep] / powers(h, path.coefficients.shape[2])
        rows[:, -1, 0] += cost
        x, cost = path.end[:size], cost + path.end[size + 1]
        ends.append(x)
        paths.append(path)
        blocks.append(rows)
    times = np.append(0.0, np.cumsum(np.concatenate([path.steps * h for path in paths])))
    times[-1], interval = duration, np.repeat(np.arange(stage.intervals), [len(path.steps) for path in paths])
    names_of_rows = (*(flow.names[i] for i in keep[:-1]), RUNNING_COST)
    dense = Trajectory(times, np.concatenate(blocks), names_of_rows)
    overstepped = _overstepped(stage, dict(zip(names, values, strict=True)), coefficients)
    states, shares = np.array(ends).T, np.concatenate([path.times[:-1] for path in paths])
    return StageRollout(stage, unknowns, dense, states, cost, interval, shares, overstepped)


def _overstepped(stage: Stage, named: dict[str, float], coefficients: np.ndarray) -> float:
    """The most by which inputs with these coefficients (m, N) leave their bounds, 0 where they do not."""
    most = 0.0
    for name, rows in stage.input_rows().items():
        control, values = stage.inputs[name], coefficients[rows]
        low, high = (float(bound(named)) if callable(bound) else bound for bound in (control.low, control.high))
        most = max(most, float((low - values).max()), float((values - high).max()))
    return most


def _input_polynomials(rollout: StageRollout) -> Trajectory:
    """The inputs of a stage as polynomials of its time."""
    stage, (duration, _, coefficients) = rollout.stage, rollout.unknowns
    n, most = stage.intervals, 1 + max((control.degree for control in stage.inputs.values()), default=0)
    monomial, h = np.zeros((n, len(stage.inputs), most)), duration / n
    for i, rows in enumerate(stage.input_rows().values()):
        bernstein, degree = coefficients[rows], rows.stop - rows.start - 1
        for k in range(degree + 1):  # monomial coefficients are differences of Bernstein coefficients
            difference = sum((-1) ** (k - j) * comb(k, j) * bernstein[j] for j in range(k + 1))
            monomial[:, i, k] = comb(degree, k) * difference / h**k
    return Trajectory(np.linspace(0, duration, n + 1), monomial, tuple(stage.inputs))
