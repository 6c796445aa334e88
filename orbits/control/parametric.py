"""The nonlinear program of optimal control as one of a parameter, with its exact first and second derivatives.

Each interval of a stage depends on few unknowns. Its end, its cost and its path expressions z have a function of their
own, with all derivatives of first and second order by these unknowns and by the parameter of the curve, which is mapped
over the intervals. The rest of the program, the conditions at the ends of stages and at exchange points, is linear in
z. So with the constant matrices E = d(unknowns of the intervals)/dx and A = d(constraints)/dz the derivatives of the
whole are those of the rest with A (dz) E, E' (sum of the Hessians of z, weighted) E.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from ..curves import FirstDerivatives, SecondDerivatives, filled
from ..numerics import Array
from ..symbolic import BufferedFunction, cached
from .stage import Stage
from .transcription import Transcription, advance


@cached
def interval_derivatives(
    stage: Stage, fixed: tuple[str, ...], free: tuple[str, ...], substeps: int
) -> tuple[ca.Function, ca.Function]:
    """(what varies (v, N) in each interval of a stage, fixed parameters, their rates, weights (r, N)) -> the results
    (r, N), which are ends, cost and path expressions, and the gradients (v, N) of their weighted sums; the second
    function also their Jacobians (r, v N), and the Hessians (v, v N) of the weighted sums. What varies are the state,
    the duration, the coefficients, the free parameters and the parameter of the curve, which is 0."""
    step, sizes = advance(stage, (*fixed, *free), substeps), (len(stage.phase.states), 1, len(stage.coefficient_names))
    parts = [ca.SX.sym("x", size) for size in (*sizes, len(free), 1)]
    varied, (x, time, w, freed, along) = ca.vertcat(*parts), parts
    p, rates = ca.SX.sym("p", len(fixed)), ca.SX.sym("rates", len(fixed))
    results = ca.vertcat(*step(x, 1.0, ca.vertcat(p + along * rates, freed, time / stage.intervals, w)))
    weights = ca.SX.sym("weights", results.numel())
    hessian, gradient = ca.hessian(ca.dot(results, weights), varied)
    found = [ca.SX(each) for each in (results, gradient, ca.jacobian(results, varied), hessian)]
    outputs = [ca.substitute(each, along, ca.SX(0)) for each in found]

    def mapped(outputs: list[ca.SX]) -> ca.Function:
        options = {"cse": substeps == 1}  # else it takes seconds
        function = ca.Function("interval", [varied, p, rates, weights], outputs, options)
        return function.map("intervals", "serial", stage.intervals, [1, 2], [])

    return mapped(outputs[:2]), mapped(outputs)


class ExchangePoint(NamedTuple):
    """A place within a stage at which a path expression is constrained: the number of the stage, the interval, the
    number of the expression, and the share of the interval. A moving one is where the expression is least, so that its
    share is an unknown."""

    stage: int
    interval: int
    path: int
    share: float
    moving: bool


class ProgramDerivatives(NamedTuple):
    """Functions (what varies (n + 1,), parameters, their rates, multipliers) -> cost, values of the constraints, and
    the gradient of the Lagrangian; the second one also the entries of its Jacobian and of its Hessian by the n
    unknowns, in these patterns, and the derivatives of the constraints and of the gradient by the parameter of the
    curve. What varies are the unknowns, the moving shares and the parameter of the curve, which is 0."""

    first: BufferedFunction
    second: BufferedFunction
    jacobian: sp.csc_matrix
    hessian: sp.csc_matrix


class _WithoutIntervals(NamedTuple):
    """A program with the results of its intervals, of these sizes, in place of these.

    arguments : what varies (n + 1,), parameters, their rates, multipliers, and the results
    derivatives : cost, constraints, gradient of the Lagrangian, Jacobian and Hessian
    linear : the derivatives of the Lagrangian and of the constraints by the results, which depend on multipliers alone
    """

    sizes: list[tuple[int, int]]
    arguments: list[ca.MX]
    derivatives: list[ca.MX]
    linear: list[ca.MX]

    def split(self, results: ca.MX) -> list[ca.MX]:
        """The results of each stage as a matrix, with a column for each interval."""
        parts = ca.vertsplit(results, np.cumsum([0, *(rows * count for rows, count in self.sizes)]).tolist())
        return [ca.reshape(part, *size) for part, size in zip(parts, self.sizes, strict=True)]


def _without_intervals(problem: Transcription, moving: tuple[tuple[int, int], ...]) -> _WithoutIntervals:
    """A program without its intervals; `moving` as in `program_derivatives`."""
    sizes = [(len(stage.phase.states) + 1 + len(stage.path), stage.intervals) for stage in problem.stages]
    results = ca.MX.sym("z", sum(rows * count for rows, count in sizes))
    of_stages = _WithoutIntervals(sizes, [], [], []).split(results)
    ends = [[0, n, n + 1, rows] for (n, _, _), (rows, _) in zip(problem.shapes, sizes, strict=True)]
    (x, p, cost, values), _ = problem.program(lambda i, first, data: ca.vertsplit(of_stages[i], ends[i]))
    fixed = len(problem.fixed)
    tops = [ca.jacobian(values[row], p)[fixed + k] for k, row in moving]  # which vanish where it is least
    stated = ca.Function("stated", [x, p, results], [cost, ca.vertcat(values, *tops)])
    varied, rates = ca.MX.sym("varied", x.numel() + len(moving) + 1), ca.MX.sym("rates", p.numel())
    moved = p + varied[-1] * rates
    for i, (k, _) in enumerate(moving):
        moved[fixed + k] = varied[x.numel() + i]
    cost, values = stated(varied[: x.numel()], moved, results)
    y = ca.MX.sym("y", values.numel())
    lagrangian = cost + ca.dot(y, values)
    hessian, gradient = ca.hessian(lagrangian, varied)
    derivatives = [cost, values, gradient, ca.jacobian(values, varied), hessian]
    linear = [ca.gradient(lagrangian, results), ca.jacobian(values, results)]
    return _WithoutIntervals(sizes, [varied, p, rates, y, results], derivatives, linear)


@cached
def program_derivatives(problem: Transcription, moving: tuple[tuple[int, int], ...]) -> ProgramDerivatives:
    """The derivatives of a program; `moving` are (number, constraint) of each exchange point that moves, at which the
    path expression is least."""
    rest = _without_intervals(problem, moving)
    *arguments, _ = rest.arguments
    varied, p, rates, _ = arguments
    linear, fixed, n = ca.Function("linear", rest.arguments, rest.linear), len(problem.fixed), varied.numel() - 1
    weights, factors = rest.split(linear(*arguments, 0)[0]), linear(*[ca.DM(0)] * 5)[1]
    own = _own_unknowns(problem, varied, n - len(moving))
    by_unknowns = ca.evalf(ca.jacobian(ca.vertcat(*map(ca.vec, own)), varied))

    def assembled(order: int) -> tuple[BufferedFunction, list[ca.MX]]:
        pairs = zip(problem.stages, problem.substeps, own, weights, strict=True)
        parts = [
            interval_derivatives(stage, problem.fixed, problem.free, substeps)[order - 1](
                each, p[:fixed], rates[:fixed], weight
            )
            for stage, substeps, each, weight in pairs
        ]
        results, slopes, *blocks = zip(*parts, strict=True)
        function = ca.Function("rest", rest.arguments, rest.derivatives[: 1 + 2 * order])
        found = function.call([*arguments, ca.vertcat(*map(ca.vec, results))])
        found[2] += by_unknowns.T @ ca.vertcat(*map(ca.vec, slopes))
        if order > 1:
            counts = [count for _, count in rest.sizes]
            jacobian, hessian = (ca.diagcat(*map(_on_diagonal, block, counts)) for block in blocks)
            found[3] += factors @ jacobian @ by_unknowns
            found[4] += by_unknowns.T @ hessian @ by_unknowns
        matrices = [each[:rows, :n] for each, rows in zip(found[3:], (factors.shape[0], n), strict=False)]
        outputs = [*found[:3], *(each.nz[:] for each in matrices), *(each[:, n] for each in found[3:])]
        return BufferedFunction(ca.Function("derivatives", arguments, [ca.densify(each) for each in outputs])), matrices

    (first, _), (second, matrices) = map(assembled, (1, 2))
    return ProgramDerivatives(first, second, *(ca.DM(each.sparsity(), 1.0).sparse() for each in matrices))


def _own_unknowns(problem: Transcription, varied: ca.MX, count: int) -> list[ca.MX]:
    """What varies (v, N) in the intervals of each stage, of all that varies, with the unknowns first."""
    found, start, common = list[ca.MX](), 0, ca.vertcat(varied[count - len(problem.free) : count], varied[-1])
    for n, intervals, m in problem.shapes:
        ends = np.cumsum([start, 1, n * (intervals + 1), m * intervals]).tolist()
        duration, nodes, w = (varied[a:b] for a, b in pairwise(ends))
        states = ca.reshape(nodes, n, intervals + 1)[:, :-1]
        time, others = (ca.repmat(each, 1, intervals) for each in (duration, common))
        found.append(ca.vertcat(states, time, ca.reshape(w, m, intervals), others))
        start = ends[-1]
    return found


def _on_diagonal(blocks: ca.MX, count: int) -> ca.MX:
    """Matrices as blocks on a diagonal."""
    block = ca.horzsplit(blocks, blocks.shape[1] // count)[0].sparsity()
    return ca.MX(ca.diagcat(*[block] * count), blocks.nz[:])


class ParametricTranscription:
    """The program of a problem along a curve of its fixed parameters, as `MinimumCurve` takes it.

    problem : whose exchange points are these `points`; its unknowns are followed by the shares of the moving ones, its
        constraints by the rates of the path expressions there
    values : parameter of the curve -> the fixed parameters, and their derivatives by it
    free : bounds of the free parameters
    """

    def __init__(
        self, problem: Transcription, points: Sequence[ExchangePoint],
        values: Callable[[float], tuple[Array, Array]], free: Mapping[str, tuple[float, float]],
    ):  # fmt: skip
        self.problem, self.points, self.values = problem, tuple(points), values
        self._shares = np.array([point.share for point in points])
        self._moving = [k for k, point in enumerate(points) if point.moving]
        (low, high), (least, most), still = problem.bounds(free), problem.limits, np.zeros(len(self._moving))
        counts = [len(problem.stages[point.stage].path) for point in points]
        first = len(least) - sum(counts)
        self.first_touch, self.moving = first, len(self._moving)
        self.touches = [first + sum(counts[:k]) + point.path for k, point in enumerate(points)]
        least[np.setdiff1d(np.arange(first, len(least)), self.touches)] = -np.inf  # another expression touches there
        self.limits = np.concatenate([low, still, least, still]), np.concatenate([high, still + 1, most, still])
        self.count, self._size = len(low), len(low) + len(self._moving)
        moving = tuple((k, self.touches[k]) for k in self._moving)
        self._derivatives = program_derivatives(problem, moving)

    @property
    def touching_limits(self) -> list[int]:
        """The indices, among the limits of unknowns and constraints, of the constraints at the exchange points."""
        return [self._size + row for row in self.touches]

    def is_share(self, limit: int) -> bool:
        """Whether a limit is of a moving share."""
        return self.count <= limit < self._size

    @property
    def limit_labels(self) -> list[str]:
        """What the limits of unknowns and constraints are of, in words."""
        share = ["the place of an exchange point"] * self.moving
        return [*self.problem.bound_labels, *share, *self.problem.labels, *share]

    def shares(self, x: Array) -> Array:
        """The shares of all exchange points at unknowns."""
        shares = self._shares.copy()
        shares[self._moving] = x[self.count :]
        return shares

    def first(self, x: Array, p: float, y: Array) -> FirstDerivatives:
        """The first derivatives, see `ParametricProgram`."""
        return self._evaluated(self._derivatives.first, x, p, y)[0]

    def second(self, x: Array, p: float, y: Array) -> SecondDerivatives:
        """The first and second derivatives, see `ParametricProgram`."""
        derivatives = self._derivatives
        first, jacobian, hessian, *slopes = self._evaluated(derivatives.second, x, p, y)
        whole = filled(derivatives.jacobian, jacobian), filled(derivatives.hessian, hessian)
        return SecondDerivatives(*whole, slopes[1][:-1], slopes[0], first)

    def _evaluated(self, function: BufferedFunction, x: Array, p: float, y: Array) -> tuple[Any, ...]:
        """First derivatives, and the other results of one of the functions."""
        (fixed, rates), added = self.values(p), np.append(self.shares(x), 1.0)
        found = function(np.append(x, 0.0), np.append(fixed, added), np.append(rates, 0 * added), y)
        cost, values, gradient, *more = (each.ravel() for each in found)
        return FirstDerivatives(float(cost[0]), gradient[:-1], values, float(gradient[-1])), *more
