"""The nonlinear program of optimal control as one of a parameter, with its exact first and second derivatives.

Each interval of a stage depends on few unknowns. Its end, its cost and its path expressions have a function of their
own, with all derivatives of first and second order by these unknowns and by the parameter of the curve, which is mapped
over the intervals. The rest of the program, the conditions at the ends of stages and at exchange points, is linear in
their results. Both are added up in the fixed patterns of the whole.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from ..curves.kkt_conditions import FirstDerivatives, SecondDerivatives, filled
from ..numerics.roots import Array
from ..symbolic.caches import cached
from ..symbolic.calls import BufferedFunction
from .stage import Stage
from .transcription import Transcription, advance

# The inputs of the functions of an interval that all intervals share: duration, parameters, and their rates.
SHARED_INPUTS = [1, 3, 4, 5]


class IntervalFunctions(NamedTuple):
    """Functions of all intervals of a stage: (states (n, N) at their starts, duration, coefficients (m, N), fixed
    parameters, free ones, rates of the fixed ones, weights (r, N)) -> the results (r, N), which are ends, cost and path
    expressions, and the gradients of their weighted sums by (state, duration, coefficients, free parameters, parameter
    of the curve); the second one also their Jacobians and the Hessians of the weighted sums, of which these entries are
    not always 0."""

    first: BufferedFunction
    second: BufferedFunction
    in_jacobian: Array
    in_hessian: Array


@cached
def interval_functions(stage: Stage, fixed: tuple[str, ...], free: tuple[str, ...], substeps: int) -> IntervalFunctions:
    """The derivatives of the results of a stage's intervals."""
    step, count = advance(stage, (*fixed, *free), substeps), len(stage.phase.states) + 1 + len(stage.path)
    sizes = [len(stage.phase.states), 1, len(stage.coefficient_names), len(fixed), len(free), len(fixed), count]
    x, time, w, p, freed, rates, weights = symbols = [ca.SX.sym("x", size) for size in sizes]
    along = ca.SX.sym("along")
    varied = ca.vertcat(x, time, w, freed, along)
    results = ca.vertcat(*step(x, 1.0, ca.vertcat(p + along * rates, freed, time / stage.intervals, w)))
    hessian, gradient = ca.hessian(ca.dot(results, weights), varied)
    found = [ca.SX(each) for each in (results, gradient, ca.jacobian(results, varied), hessian)]
    whole = [ca.densify(ca.substitute(each, along, ca.SX(0))) for each in found]

    def mapped(outputs: list[ca.SX]) -> BufferedFunction:
        function = ca.Function("interval", symbols, outputs, {"cse": substeps == 1})  # else it takes seconds
        return BufferedFunction(function.map("intervals", "serial", stage.intervals, SHARED_INPUTS, []))

    in_jacobian, in_hessian = (ca.DM(each.sparsity(), 1.0).full().T > 0 for each in found[2:])
    return IntervalFunctions(mapped(whole[:2]), mapped(whole), in_jacobian, in_hessian)


class ExchangePoint(NamedTuple):
    """A place within a stage at which a path expression is constrained: the number of the stage, the interval, the
    number of the expression, and the share of the interval. A moving one is where the expression is least, so that its
    share is an unknown."""

    stage: int
    interval: int
    path: int
    share: float
    moving: bool


class RestOfProgram(NamedTuple):
    """A program with the results of its intervals in place of these: functions of (unknowns with the moving shares,
    parameters, their rates, multipliers, results of all intervals, 0) -> cost, values of the constraints and the
    gradient of the Lagrangian by the unknowns and the parameter of the curve; the second one also the entries of its
    Jacobian and of its Hessian, at these rows and columns. The results occur linearly in the values at these places,
    with these factors."""

    first: BufferedFunction
    second: BufferedFunction
    jacobian: tuple[Array, Array]
    hessian: tuple[Array, Array]
    results: tuple[Array, Array]
    factors: Array


@cached
def path_rates(stage: Stage, names: tuple[str, ...], substeps: int) -> ca.Function:
    """(state, share, parameters with length and coefficients) -> the path expressions after that share of an interval,
    and their rates by it."""
    step = advance(stage, names, substeps)
    x, share, p = (ca.SX.sym("x", step.size1_in(i)) for i in range(3))
    path = step(x, share, p)[2]
    return ca.Function("path", [x, share, p], [path, ca.densify(ca.jacobian(path, share))])


@cached
def rest_of_program(problem: Transcription, moving: tuple[tuple[int, int], ...]) -> RestOfProgram:
    """What a program has beside the results of its intervals; moving are (number of exchange point, path)."""
    counts = [(len(stage.phase.states), 1, len(stage.path)) for stage in problem.stages]
    sizes = [sum(count) * stage.intervals for count, stage in zip(counts, problem.stages, strict=True)]
    results = ca.MX.sym("results", sum(sizes))
    parts = ca.vertsplit(results, np.cumsum([0, *sizes]).tolist())

    def advanced(i: int, first: ca.MX, data: ca.MX) -> list[ca.MX]:
        whole = ca.reshape(parts[i], sum(counts[i]), problem.stages[i].intervals)
        return ca.vertsplit(whole, np.cumsum([0, *counts[i]]).tolist())

    (x, p, cost, values), _ = problem.program(advanced)
    first_share = len(problem.fixed)
    tops = [_rate_at_exchange_point(problem, x, p, k, j, p[first_share + k]) for k, j in moving]
    values = ca.vertcat(values, *tops)
    whole, rates, along = ca.MX.sym("x", x.numel() + len(moving)), ca.MX.sym("rates", p.numel()), ca.MX.sym("along")
    y, shares = ca.MX.sym("y", values.numel()), ca.MX(p + along * rates)
    for i, (k, _) in enumerate(moving):
        shares[first_share + k] = whole[x.numel() + i]
    cost, values = ca.Function("moved", [x, p, results], [cost, values])(whole[: x.numel()], shares, results)
    x, varied = whole, ca.vertcat(whole, along)
    hessian, gradient = ca.hessian(cost + ca.dot(y, values), varied)
    jacobian, by_results = ca.jacobian(values, varied), ca.jacobian(values, results)
    arguments = [x, p, rates, y, results, along]
    found = [cost, values, gradient, jacobian.nz[:], hessian.nz[:]]
    first, second = (
        BufferedFunction(ca.Function("rest", arguments, [ca.densify(each) for each in found[:count]]))
        for count in (3, 5)
    )
    linear = ca.Function("linear", arguments, [by_results])(*[0] * len(arguments))
    own, square, by_result = (_places(each.sparsity()) for each in (jacobian, hessian, linear))
    return RestOfProgram(first, second, own, square, by_result, np.array(linear.nonzeros()))


def _rate_at_exchange_point(problem: Transcription, x: ca.MX, p: ca.MX, k: int, j: int, share: ca.MX) -> ca.MX:
    """The rate of a path expression by the share at an exchange point, which vanishes where it is least."""
    i, interval = problem.exchange_points[k]
    n, intervals, m = problem.shapes[i]
    start = sum(1 + size * (count + 1) + inputs * count for size, count, inputs in problem.shapes[:i])
    node, w = start + 1 + n * interval, start + 1 + n * (intervals + 1) + m * interval
    freed = x[x.numel() - len(problem.free) :]
    data = ca.vertcat(p[: len(problem.fixed)], freed, x[start] / intervals, x[w : w + m])
    return path_rates(problem.stages[i], problem.names, problem.substeps[i])(x[node : node + n], share, data)[1][j]


def _places(sparsity: ca.Sparsity) -> tuple[Array, Array]:
    """The rows and the columns of the entries of a pattern, in their order."""
    rows, columns = sparsity.get_triplet()
    return np.array(rows, dtype=int), np.array(columns, dtype=int)


class Assembly:
    """A sparse matrix of this shape, and a further column, to which blocks of entries at these rows and columns add up.
    Entries in further rows are dropped."""

    def __init__(self, blocks: Sequence[tuple[Array, Array]], shape: tuple[int, int]):
        rows, columns = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
        self.shape, (m, n) = shape, shape
        self._inside, self._last = (np.flatnonzero((rows < m) & which) for which in (columns < n, columns == n))
        keys, self._places = np.unique(columns[self._inside] * m + rows[self._inside], return_inverse=True)
        self._rows_of_last = rows[self._last]
        form = np.zeros(len(keys)), (keys % m).astype(np.int32), np.searchsorted(keys, np.arange(n + 1) * m)
        self._pattern = sp.csc_matrix(form, shape)

    def __call__(self, entries: Array) -> tuple[sp.csc_matrix, Array]:
        """The matrix and the column of these entries."""
        data = np.bincount(self._places, entries[self._inside], self._pattern.nnz)
        column = np.bincount(self._rows_of_last, entries[self._last], self.shape[0])
        return filled(self._pattern, data), column


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
        moving = tuple((k, point.path) for k, point in enumerate(points) if point.moving)
        self._moving = [k for k, _ in moving]
        (low, high), (least, most), still = problem.bounds(free), problem.limits, np.zeros(len(moving))
        counts = [len(problem.stages[point.stage].path) for point in points]
        first = len(least) - sum(counts)
        self.first_touch, self.moving = first, len(moving)
        self.touches = [first + sum(counts[:k]) + point.path for k, point in enumerate(points)]
        least[np.setdiff1d(np.arange(first, len(least)), self.touches)] = -np.inf  # another expression touches there
        self.limits = np.concatenate([low, still, least, still]), np.concatenate([high, still + 1, most, still])
        self.count, self._size, names = len(low), len(low) + len(moving), (problem.fixed, problem.free)
        self._rest = rest_of_program(problem, moving)
        pairs = zip(problem.stages, problem.substeps, strict=True)
        self._functions = [interval_functions(stage, *names, substeps) for stage, substeps in pairs]
        self._order()

    def _order(self) -> None:
        """The places of the intervals' unknowns and results among all, and the patterns of the whole derivatives."""
        problem, rest, n_x, n_g = self.problem, self._rest, self._size, len(self.problem.labels) + len(self._moving)
        freed = np.append(np.arange(self.count - len(problem.free), self.count), n_x)
        # The values to which all results of intervals belong, with the factors; n_g where there is none.
        counts = [len(stage.phase.states) + 1 + len(stage.path) for stage in problem.stages]
        ends = np.cumsum([0, *(count * s.intervals for count, s in zip(counts, problem.stages, strict=True))])
        row, factor = np.full(ends[-1], n_g), np.zeros(ends[-1])
        row[rest.results[1]], factor[rest.results[1]] = rest.results[0], rest.factors
        self._own, self._rows, self._factors, start = list[Array](), list[Array](), list[Array](), 0
        jacobian, hessian = [rest.jacobian], [rest.hessian]
        whole = zip(problem.shapes, counts, ends, ends[1:], self._functions, strict=False)
        for (n, N, m), count, a, b, functions in whole:
            k = np.arange(N)[:, None]
            states, inputs = start + 1 + k * n + np.arange(n), start + 1 + n * (N + 1) + k * m + np.arange(m)
            last = np.broadcast_to(freed, (N, len(freed)))
            own = np.concatenate([states, np.full((N, 1), start), inputs, last], axis=1)
            rows = row[a:b].reshape(N, count)
            self._own.append(own)
            self._rows.append(rows)
            self._factors.append(factor[a:b].reshape(N, count))
            # The functions store matrices by columns.
            for blocks, rows_of, there, none in (
                (jacobian, rows, functions.in_jacobian, n_g), (hessian, own, functions.in_hessian, n_x),
            ):  # fmt: skip
                own_rows = np.where(there, rows_of[:, None, :], none)
                blocks.append((own_rows.ravel(), np.broadcast_to(own[:, :, None], own_rows.shape).ravel()))
            start += 1 + n * (N + 1) + m * N
        self._jacobian, self._hessian = Assembly(jacobian, (n_g, n_x)), Assembly(hessian, (n_x, n_x))

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

    def of_stages(self, x: Array) -> Iterator[tuple[Array, float, Array]]:
        """Of each stage the states (N, n) at the starts of its intervals, its duration, and the coefficients (N, m) of
        its inputs, at unknowns."""
        for own, (n, _, m) in zip(self._own, self.problem.shapes, strict=True):
            yield x[own[:, :n]], x[own[0, n]], x[own[:, n + 1 : n + 1 + m]]

    def _evaluated(self, x: Array, p: float, y: Array, order: int) -> tuple[FirstDerivatives, list[Array], list[Array]]:
        """First derivatives, and for order 2 the entries of the Jacobian and of the Hessian, part by part."""
        fixed, rates = self.values(p)
        longer, freed = np.append(y, 0.0), x[self.count - len(self.problem.free) : self.count]
        results, gradient = list[Array](), np.zeros(self._size + 1)
        jacobians, hessians = list[Array](), list[Array]()
        parts = zip(self._functions, self._own, self._rows, self._factors, self.of_stages(x), strict=True)
        for functions, own, rows, factors, (state, duration, w) in parts:
            weights = longer[rows] * factors
            weights[:, state.shape[1]] = 1.0
            arguments = state.ravel(), duration, w.ravel(), fixed, freed, rates, weights.ravel()
            found = (functions.first if order == 1 else functions.second)(*arguments)
            result, by_own, *more = (each.ravel(order="F") for each in found)
            results.append(result)
            gradient += np.bincount(own.ravel(), by_own, len(gradient))
            if more:
                shaped = more[0].reshape(len(own), own.shape[1], factors.shape[1])
                jacobians.append((shaped * factors[:, None, :]).ravel())
                hessians.append(more[1])
        added = np.append(self.shares(x), 1.0)
        rest = self._rest.first if order == 1 else self._rest.second
        whole = rest(x, np.append(fixed, added), np.append(rates, 0 * added), y, np.concatenate(results), 0.0)
        cost, values, by_all, *more = (each.ravel() for each in whole)
        gradient += by_all
        first = FirstDerivatives(float(cost[0]), gradient[:-1], values, float(gradient[-1]))
        return first, [*more[:1], *jacobians], [*more[1:], *hessians]

    def first(self, x: Array, p: float, y: Array) -> FirstDerivatives:
        """As in `ParametricProgram`."""
        return self._evaluated(x, p, y, 1)[0]

    def second(self, x: Array, p: float, y: Array) -> SecondDerivatives:
        """As in `ParametricProgram`."""
        first, jacobian, hessian = self._evaluated(x, p, y, 2)
        whole, values_slope = self._jacobian(np.concatenate(jacobian))
        square, gradient_slope = self._hessian(np.concatenate(hessian))
        return SecondDerivatives(whole, square, gradient_slope, values_slope, first)
