"""Direct multiple shooting: the nonlinear program of a sequence of stages."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..flow import runge_kutta_step
from ..numerics import GAUSS_PLACES, GAUSS_WEIGHTS
from ..symbolic import Minimiser, Minimum, cached, taylor_coefficients
from .stage import ELAPSED, Stage, stage_flow

# Order of the Taylor steps, half as costly as those of the accurate flow; where it is too low the steps are halved.
CONTROL_ORDER = 12
# Options with which Ipopt ends where it stalls: with large states, rounding prevents it from reaching its tolerances.
STALLS = {
    "ipopt.acceptable_iter": 15,
    "ipopt.acceptable_tol": 1e-6,
    "ipopt.acceptable_constr_viol_tol": 1e-10,
    "ipopt.acceptable_compl_inf_tol": 1e-8,
}

# Multipliers of the bounds of the unknowns, and of the constraints.
Multipliers = tuple[np.ndarray, np.ndarray]


class StageUnknowns(NamedTuple):
    """The unknowns of one stage: its duration, its states (n, N + 1) at the shooting nodes, which are the ends of its
    intervals, and the Bernstein coefficients (m, N) of its inputs."""

    duration: float
    nodes: np.ndarray
    coefficients: np.ndarray


class _Constraint(NamedTuple):
    """Values (k,) that lie between 0 and `most`; `inner` ones are of a path expression at points within a stage."""

    values: ca.MX
    label: str
    most: float
    inner: bool


@cached
def advance(stage: Stage, names: tuple[str, ...], substeps: int) -> ca.Function:
    """(state, share, parameters with length and coefficients) -> state, cost, path expressions after that share.

    A step is taken on the piece of a law on which it begins; where it leads beyond, steps are halved until that does
    not matter.
    """
    flow = stage_flow(stage, names)
    graph, count = flow.vector_field, len(flow.parameters)
    size, share = len(stage.phase.states), ca.SX.sym("share")
    if graph.has_series:
        series = taylor_coefficients(graph.field, graph.x, graph.p, CONTROL_ORDER)[: graph.size, :]
        state_at = lambda t: series @ ca.vertcat(*[t**k for k in range(CONTROL_ORDER + 1)])  # noqa: E731
        end = state_at(share)
        # The series of a cost with near corners converges slowly; Gauss's rule keeps a positive cost positive.
        rates = [graph.field(state_at(share * float(place)), graph.p)[0][size + 1] for place in GAUSS_PLACES]
        end[size + 1] = graph.x[size + 1] + share * ca.dot(ca.vertcat(*rates), ca.DM(GAUSS_WEIGHTS))
    else:
        end = runge_kutta_step(graph, graph.x, share)
    step = ca.Function("step", [graph.x, share, graph.p], [end])
    x, p = ca.SX.sym("x", size), graph.p[:count]
    z, named = ca.vertcat(x, 0, 0), flow.symbols(ca.SX(0, 1), p)[1]

    def with_data(z: ca.SX) -> ca.SX:
        return ca.vertcat(p, *flow.phase.data(ca.vertsplit(z), named))

    for _ in range(substeps):
        z = step(z, share / substeps, with_data(z))
    results = [z[:size], z[size + 1], graph.field(z, with_data(z))[1]]
    return ca.Function("advance", [x, share, p], [ca.densify(result) for result in results])


@cached
def _conditions(stage: Stage, names: tuple[str, ...], size_before: int) -> ca.Function:
    """(first state, last state, last state before, parameters, time at the end) -> zeros at the start, zeros at the
    end, expressions that are not negative there, final cost, and bounds of inputs, infinite where they are numbers."""
    size = len(stage.phase.states)
    first, last, before, p = (ca.SX.sym("x", k) for k in (size, size, size_before, len(names)))
    named, elapsed = dict(zip(names, ca.vertsplit(p), strict=True)), ca.SX.sym("elapsed")
    start, timed = stage.start(ca.vertsplit(first), ca.vertsplit(before), named), {**named, ELAPSED: elapsed}
    end, above, final = (of(ca.vertsplit(last), timed) for of in (stage.end, stage.above, stage.final))
    lows, highs = (
        ca.vertcat(*[of(named) if callable(of := getattr(each, side)) else none for each in stage.inputs.values()])
        for side, none in (("low", -np.inf), ("high", np.inf))
    )
    results = [ca.vertcat(*start), ca.vertcat(*end), ca.vertcat(*above), final, lows, highs]
    return ca.Function(
        "conditions", [first, last, before, p, elapsed], [ca.densify(ca.SX(result)) for result in results]
    )


class Transcription:
    """The nonlinear program of stages; its unknowns are the `StageUnknowns` of each, then the free parameters.

    names : names of the parameters, first the fixed and then the free ones
    substeps : number of steps in an interval, of each stage
    steps : their number in all intervals
    exchange_points : (stage, interval) of further points at which path expressions are constrained; the share of the
        interval at which each point lies is a parameter
    labels : the condition that each constraint belongs to, in words
    inner_paths : indices of the constraints on path expressions at points within stages
    """

    def __init__(
        self, stages: tuple[Stage, ...], fixed: tuple[str, ...], free: tuple[str, ...],
        substeps: tuple[int, ...], exchange_points: tuple[tuple[int, int], ...],
    ):  # fmt: skip
        self.stages, self.fixed, self.free, self.names = stages, fixed, free, (*fixed, *free)
        self.substeps, self.exchange_points = substeps, exchange_points
        self.shapes = [(len(s.phase.states), s.intervals, len(s.coefficient_names)) for s in stages]
        self.steps = sum(stage.intervals * each for stage, each in zip(stages, substeps, strict=True))
        self._minimiser, constraints = self._build()
        rows = [constraint for constraint in constraints for _ in range(constraint.values.numel())]
        self.labels = [row.label for row in rows]
        self.inner_paths = [index for index, row in enumerate(rows) if row.inner]
        self._limits = [(0.0, row.most) for row in rows]

    def _build(self) -> tuple[Minimiser, list[_Constraint]]:
        """The minimiser, and the constraints in order."""
        program, constraints = self.program(self._advanced)
        unknowns, parameters, cost, values = program
        return Minimiser(unknowns, parameters, cost, values, STALLS), constraints

    def _advanced(self, i: int, first: ca.MX, data: ca.MX) -> Sequence[ca.MX]:
        """The states at the ends of all intervals of a stage, their costs, and the path expressions there."""
        n = self.stages[i].intervals
        ends, costs, path = advance(self.stages[i], self.names, self.substeps[i]).map(n)(first, ca.DM.ones(1, n), data)
        return ends, costs, path

    def program(
        self, advanced: Callable[[int, ca.MX, ca.MX], Sequence[ca.MX]]
    ) -> tuple[tuple[ca.MX, ca.MX, ca.MX, ca.MX], list[_Constraint]]:
        """The nonlinear program as its unknowns, its parameters, its cost and the values of its constraints: the
        parameters are the fixed ones, the shares and the cost's unit; and the constraints in order.

        advanced : (stage's number, states (n, N) at the starts of its intervals, their parameters (k, N)) -> the states
            (n, N) at their ends, their costs (1, N) and their path expressions (m, N)
        """
        fixed, freed, shares = (ca.MX.sym("p", len(each)) for each in (self.fixed, self.free, self.exchange_points))
        p, unit, cost, data = ca.vertcat(fixed, freed), ca.MX.sym("unit"), ca.MX(0), []
        parts = [(ca.MX.sym("T"), ca.MX.sym("x", n, N + 1), ca.MX.sym("w", m, N)) for n, N, m in self.shapes]
        constraints = list[_Constraint]()
        elapsed = ca.MX(0)
        for i, part in enumerate(parts):
            elapsed += part[0]
            stage_cost, stage_data, own = self._build_stage(i, part, parts[i - 1][1][:, -1], p, elapsed, advanced)
            cost += stage_cost
            data.append(stage_data)
            constraints += own
        for k, (i, interval) in enumerate(self.exchange_points):
            step = advance(self.stages[i], self.names, self.substeps[i])
            path = step(parts[i][1][:, interval], shares[k], data[i][:, interval])[2]
            for j, name in enumerate(self.stages[i].path):
                constraints.append(self._constraint(path[j], i, f"'{name}'", inner=True))
        unknowns = ca.veccat(*[symbol for part in parts for symbol in part], freed)
        values = ca.vertcat(*[constraint.values for constraint in constraints])
        return (unknowns, ca.vertcat(fixed, shares, unit), cost / unit, values), constraints

    def _build_stage(
        self, i: int, part, before: ca.MX, p: ca.MX, elapsed: ca.MX, advanced: Callable
    ) -> tuple[ca.MX, ca.MX, list[_Constraint]]:
        """Cost, parameters of each interval, and constraints of a stage that follows the state `before` and ends at the
        time `elapsed`."""
        stage, (duration, x, w), n = self.stages[i], part, self.stages[i].intervals
        data = ca.vertcat(ca.repmat(p, 1, n), ca.repmat(duration / n, 1, n), w)
        ends, costs, path = advanced(i, x[:, :-1], data)
        conditions = _conditions(stage, self.names, before.numel())
        start, end, above, final, lows, highs = conditions(x[:, 0], x[:, -1], before, p, elapsed)
        constraints = [
            self._constraint(ca.vec(ends - x[:, 1:]), i, "the motion", 0.0),
            self._constraint(start, i, "the condition at the start", 0.0),
            self._constraint(end, i, "the condition at the end", 0.0),
            self._constraint(above, i, "the bound at the end"),
        ]
        for k, name in enumerate(stage.path):
            constraints.append(self._constraint(path[k, :-1].T, i, f"'{name}'", inner=True))
        for k, (name, rows) in enumerate(stage.input_rows().items()):
            control, values = stage.inputs[name], ca.vec(w[rows, :])
            if callable(control.low):
                constraints.append(self._constraint(values - lows[k], i, f"the lower bound of input '{name}'"))
            if callable(control.high):
                constraints.append(self._constraint(highs[k] - values, i, f"the upper bound of input '{name}'"))
        return ca.sum2(costs) + final, data, constraints

    def _constraint(self, values: ca.MX, i: int, what: str, most: float = np.inf, inner: bool = False) -> _Constraint:
        """A constraint within stage `i`."""
        return _Constraint(values, f"{what} of stage {i + 1} ({self.stages[i].phase.name})", most, inner)

    def bounds(self, free: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the unknowns, (n,) each."""
        sides = []
        for side in (0, 1):
            parts = []
            for stage, (size, n, m) in zip(self.stages, self.shapes, strict=True):
                coefficients = np.zeros((m, n))
                for name, rows in stage.input_rows().items():
                    coefficients[rows] = stage.inputs[name].numbers[side]
                nodes = np.full((size, n + 1), (-np.inf, np.inf)[side])
                parts.append(StageUnknowns(stage.duration[side], nodes, coefficients))
            sides.append(self.pack(parts, [bound[side] for bound in free.values()]))
        return sides[0], sides[1]

    def inner_row(self, i: int, j: int, node: int) -> int:
        """The constraint that a path expression of a stage, number j, is not negative at a node within it."""
        label = f"'{[*self.stages[i].path][j]}' of stage {i + 1} ({self.stages[i].phase.name})"
        return self.labels.index(label) + node - 1

    @property
    def bound_labels(self) -> list[str]:
        """What the bounds of each unknown are of, in words."""
        labels = []
        for i, (stage, (size, n, _)) in enumerate(zip(self.stages, self.shapes, strict=True), start=1):
            where = f"of stage {i} ({stage.phase.name})"
            labels += [f"the duration {where}", *[f"the states {where}"] * (size * (n + 1))]
            names = [name for name, control in stage.inputs.items() for _ in range(control.degree + 1)]
            labels += [f"input '{name}' {where}, interval {k + 1}" for k in range(n) for name in names]
        return labels + [f"parameter '{name}'" for name in self.free]

    def pack(self, parts: Sequence[StageUnknowns], free: Sequence[float]) -> np.ndarray:
        """The unknowns (n,) from those of each stage and the free parameters."""
        arrays = [np.ravel(array, order="F") for part in parts for array in part]
        return np.concatenate([*arrays, np.asarray(free, dtype=float)]).astype(float)

    def unpack(self, x: np.ndarray) -> list[StageUnknowns]:
        """The unknowns of each stage."""
        parts = []
        for size, n, m in self.shapes:
            duration, nodes, coefficients, x = np.split(x, np.cumsum([1, size * (n + 1), m * n]))
            nodes, coefficients = nodes.reshape((n + 1, size)).T, coefficients.reshape((n, m)).T
            parts.append(StageUnknowns(float(duration[0]), nodes, coefficients))
        return parts

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the constraints, (m,) each."""
        least, most = np.array(self._limits).T
        return least, most

    def cost(self, x: np.ndarray, p: np.ndarray) -> float:
        """The cost of unknowns, with `p` as in `minimise`."""
        return float(self._minimiser.conditions(x, p, 0.0)[0])

    def minimise(self, x: np.ndarray, p: np.ndarray, bounds: tuple, multipliers: Multipliers | None) -> Minimum:
        """The minimum near `x`; `p` contains the fixed parameters, the shares of the exchange points, and the cost's
        unit, and the iteration starts from the `multipliers` of a minimum nearby, or cold."""
        return self._minimiser(x, p, bounds, self.limits, multipliers)

    def end_conditions(self, values: np.ndarray, ends: Sequence, durations: Sequence[float]) -> Iterator[tuple]:
        """For each stage, the values of `_conditions` at parameters and at the stages' (first, last) states."""
        for i, (stage, elapsed) in enumerate(zip(self.stages, accumulate(durations), strict=True)):
            before = ends[i - 1][1]
            yield _conditions(stage, self.names, len(before))(*ends[i], before, values, elapsed)


transcription = cached(Transcription)
