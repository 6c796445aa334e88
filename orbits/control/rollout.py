"""Motions found by optimal control: solutions of the nonlinear program integrated accurately, open loop, and errors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import comb
from typing import Any

import numpy as np

from ..errors import InputError
from ..flow.trajectory import Trajectory
from ..hybrid.simulation import Leg
from ..io import fields_in_line
from ..model.units import Dimension, Units, unit_text
from ..numerics.bernstein import PiecewisePolynomials, powers
from ..pages.cells import cell
from .stage import Stage, stage_flow
from .transcription import Multipliers, StageUnknowns, Transcription


@dataclass(frozen=True)
class ControlledLeg(Leg):
    """One stage of a motion, whose rows are the states, then the path expressions; and its inputs as polynomials of the
    time since its start."""

    inputs: Trajectory

    @property
    def duration(self) -> float:
        """Duration of the stage."""
        return float(self.path.times[-1])

    def input_of(self, name: str) -> Callable[[float], float]:
        """An input as a function of the time in the stage."""
        row = self.inputs.names.index(name)
        return lambda t: self.inputs(t)[row]

    def input_column(self, name: str) -> np.ndarray:
        """Coefficients (N, K + 1) of an input on each interval, 0 where the stage does not have it."""
        return self.inputs.row(name) if name in self.inputs.names else np.zeros((len(self.inputs.steps), 1))


@dataclass(frozen=True)
class WarmStart:
    """The point from which the next solve starts: a problem with its unknowns and multipliers."""

    problem: Transcription
    x: np.ndarray
    multipliers: Multipliers | None
    shares: np.ndarray  # of its interval at which each exchange point of the problem lies
    unit: float = 1.0  # of the cost, which it brings to order one, since Ipopt's tolerances are absolute


@dataclass(frozen=True)
class Control:
    """A motion of locally least cost. Another guess may lead to one that costs less.

    legs : the stages in order
    cost : cost of the accurate motion
    parameters : all parameters by name, those left free with the values found
    violation : the most by which the accurate motion misses a condition, leaves a bound, or falls below zero in a path
        expression
    error : the most by which the states of the accurate motion, relative to their size, or its cost differ from those
        of the nonlinear program
    coarseness : the share of the cost by which the last halving of the intervals changed it, NaN if they were kept.
        Violation and error are those of this motion and do not say what finer inputs would save
    iterations, rounds : Ipopt's iterations, and the solves in which they were taken
    seconds : time taken in all
    status : "optimal"; anything else is raised as an error
    units : of "cost", "time" and the inputs, by name, where the numbers are in SI; violation and error have none
    bare : the same motion without units, None where there are none
    """

    legs: tuple[ControlledLeg, ...]
    cost: float
    parameters: Mapping[str, float]
    violation: float
    error: float
    iterations: int
    rounds: int
    seconds: float
    status: str = "optimal"
    coarseness: float = np.nan
    answer: WarmStart | None = field(default=None, repr=False)
    units: Mapping[str, str] | None = None
    bare: "Control | None" = field(default=None, repr=False)

    def dimensionless(self) -> "Control":
        """The motion in its machine's own dimensionless units; itself where it has no others."""
        return self.bare or self

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: all but the nonlinear program. As a guess the copy starts a solve from its motion."""
        return {**vars(self), "answer": None}

    def __repr__(self) -> str:
        return fields_in_line(self, "status", "cost", "violation", "error", "end")

    @property
    def durations(self) -> np.ndarray:
        """Durations of the stages."""
        return np.array([leg.duration for leg in self.legs])

    @property
    def end(self) -> float:
        """The time at which the last stage ends."""
        return self.legs[-1].start + self.legs[-1].duration

    def schedule(self, *names: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The times (k + 1,) at which piecewise constant inputs change, and their values (k,) in between, 0 where a
        stage does not have them, as `simulate` takes them.

        Raises `InputError` for a name that is no input, and for an input that varies within an interval.
        """
        if strange := set(names).difference(*(leg.inputs.names for leg in self.legs)):
            raise InputError(f"there is no input '{min(strange)}'")
        rows = {name: [leg.input_column(name) for leg in self.legs] for name in names}
        if varying := [name for name, columns in rows.items() if any(c[:, 1:].any() for c in columns)]:
            raise InputError(f"input '{varying[0]}' varies within an interval: it is no schedule; give it degree 0")
        times = np.concatenate([*(leg.start + leg.inputs.times[:-1] for leg in self.legs), [self.end]])
        return times, {name: np.concatenate([c[:, 0] for c in columns]) for name, columns in rows.items()}

    def rows(self) -> list[tuple[str, str]]:
        """The motion as rows of a table, (name, text): its stages, its cost and errors, how it was found."""
        second, unit = (" s", f" {self.units['cost']}") if self.units else ("", "")
        rows = [(leg.phase, f"from {leg.start:<12.8g}for {leg.duration:.10g}{second}") for leg in self.legs]
        rows.append(("cost", f"{self.cost:.12g}{unit}, violation {self.violation:.1e}, error {self.error:.1e}"))
        return [*rows, ("found in", f"{self.iterations} iterations, {self.rounds} rounds, {self.seconds:.2f} s")]

    def __str__(self) -> str:
        return "\n".join(f"  {name:<12}{text}" for name, text in self.rows())

    def _repr_html_(self) -> str:
        return cell("motion of locally least cost", self.rows(), getattr(self, "plot", None))


def control_in_units(
    control: Control, units: Units, cost: Dimension, parameters: Mapping[str, float], own: Mapping[str, Dimension]
) -> Control:
    """A dimensionless motion in these units, with the parameters given.

    cost : its dimension; own : those of inputs and path expressions, by name
    """
    legs = tuple(
        replace(
            leg,
            start=leg.start * units.time,
            path=units.convert_motion(leg.path, own),
            inputs=units.convert_motion(leg.inputs, own),
        )
        for leg in control.legs
    )
    inputs = {name: unit_text(own[name]) for leg in control.legs for name in leg.inputs.names if name in own}
    texts = {"cost": unit_text(cost), "time": "s", **inputs}
    return replace(
        control, legs=legs, cost=control.cost * units.of(cost), parameters=parameters, units=texts, bare=control
    )


@dataclass(frozen=True, eq=False)
class StageRollout:
    """A stage integrated accurately from its first state through all its intervals."""

    stage: Stage
    unknowns: StageUnknowns  # those of the stage in the nonlinear program
    path: Trajectory  # the motion, states and then path expressions
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
        names, inputs = [of.stage.phase.name for of in self.stages], [_input_polynomials(of) for of in self.stages]
        return tuple(map(ControlledLeg, names, ends, [of.path for of in self.stages], inputs))


def roll_out(solution: WarmStart, cost: float, fixed: np.ndarray) -> MotionRollout:
    """Integrate a solution, whose cost in the nonlinear program is given, at the given parameters `fixed`."""
    problem, x = solution.problem, solution.x
    values = np.concatenate([fixed, x[len(x) - len(problem.free) :]])
    pairs = zip(problem.stages, problem.unpack(x), strict=True)
    stages = [_roll_out_stage(stage, problem.names, values, part) for stage, part in pairs]
    conditions = list(problem.end_conditions(values, [(of.nodes[:, 0], of.nodes[:, -1]) for of in stages]))
    accurate = float(sum(float(final) for *_, final, _, _ in conditions) + sum(of.cost for of in stages))
    arrays = [[np.array(part) for part in parts[:3]] for parts in conditions]
    missed = [np.concatenate([np.abs(start), np.abs(end), -above], axis=None) for start, end, above in arrays]
    error = max(*(of.distance for of in stages), abs(accurate - cost) / max(solution.unit, abs(cost)))
    violation = max([float(off.max(initial=0.0)) for off in missed] + [of.violation for of in stages])
    return MotionRollout(values, stages, accurate, error, violation)


def _roll_out_stage(stage: Stage, names: tuple[str, ...], values, unknowns: StageUnknowns) -> StageRollout:
    """Integrate a stage of a solution accurately, with parameters `names` of the given values."""
    flow, (duration, nodes, coefficients) = stage_flow(stage, names), unknowns
    size, h, x, cost = len(stage.phase.states), duration / stage.intervals, nodes[:, 0], 0.0
    paths, ends = [], [x]
    keep = [*range(size), *range(size + 2, len(flow.names))]  # all rows but those of the clock and the cost
    for i in range(stage.intervals):
        path, _ = flow.run([*x, 0.0, 0.0], np.concatenate([values, [h], coefficients[:, i]]), 1.0)
        x, cost = path.end[:size], cost + path.end[size + 1]
        ends.append(x)
        paths.append(path)
    blocks = [path.coefficients[:, keep] / powers(h, path.coefficients.shape[2]) for path in paths]
    times = np.append(0.0, np.cumsum(np.concatenate([path.steps * h for path in paths])))
    times[-1], interval = duration, np.repeat(np.arange(stage.intervals), [len(path.steps) for path in paths])
    dense = Trajectory(times, np.concatenate(blocks), tuple(flow.names[i] for i in keep))
    overstepped = _overstepped(stage, dict(zip(names, values, strict=True)), coefficients)
    states, shares = np.array(ends).T, np.concatenate([path.times[:-1] for path in paths])
    return StageRollout(stage, unknowns, dense, states, cost, interval, shares, overstepped)


def _overstepped(stage: Stage, named: dict[str, float], coefficients: np.ndarray) -> float:
    """The most by which inputs with these coefficients (m, N) leave their bounds, 0 where they do not."""
    most = 0.0
    for name, rows in stage.input_rows().items():
        given, values = stage.inputs[name], coefficients[rows]
        low, high = (float(bound(named)) if callable(bound) else bound for bound in (given.low, given.high))
        most = max(most, float((low - values).max()), float((values - high).max()))
    return most


def _input_polynomials(rollout: StageRollout) -> Trajectory:
    """The inputs of a stage as polynomials of its time."""
    stage, (duration, _, coefficients) = rollout.stage, rollout.unknowns
    n, most = stage.intervals, 1 + max((given.degree for given in stage.inputs.values()), default=0)
    monomial, h = np.zeros((n, len(stage.inputs), most)), duration / n
    for i, rows in enumerate(stage.input_rows().values()):
        bernstein, degree = coefficients[rows], rows.stop - rows.start - 1
        for k in range(degree + 1):  # monomial coefficients are differences of Bernstein coefficients
            difference = sum((-1) ** (k - j) * comb(k, j) * bernstein[j] for j in range(k + 1))
            monomial[:, i, k] = comb(degree, k) * difference / h**k
    return Trajectory(np.linspace(0, duration, n + 1), monomial, tuple(stage.inputs))
