"""Taylor steps of a flow with their sensitivities, interpreted at first and compiled once there are many."""

import casadi as ca
import numpy as np

from ..numerics.bernstein import TINY
from ..numerics.roots import Array
from ..symbolic.calls import BufferedFunction, MappedFunction
from ..symbolic.exclusive import LOCK
from ..symbolic.kernels import compile_function, compile_seconds, compiled_before, lengths
from ..symbolic.taylor_series import variations
from .vector_field import FLOW_CONTROL, TAYLOR_ORDER, Steps, VectorField, symbolic_powers

# Truncation error of a step relative to the state: a tenth of the rounding error of the sum.
TRUNCATION = 1e-17
# A step of larger defect, relative to the state, leads beyond what the series can describe. Rounding is far smaller.
LARGEST_DEFECT = 1e-10
# No step is longer than this. A state at rest needs the bound, since its series has no last terms to choose a step by.
LONGEST_STEP = 1e9
# Where less than this many steps are left of the duration, the last two share it evenly, so that none is tiny.
SHARED_STEPS = 1.5
# About the time that the CasADi virtual machine takes for one instruction. Interpretation may take this share of the
# time to compile before the cache of compiled functions is searched.
SECONDS_PER_INSTRUCTION, SEARCH_SHARE = 2e-9, 0.02


class TaylorStepper:
    """Takes Taylor steps, several in one call, with the sensitivities of the states.

    `step_function` makes one step: (z, data) -> (z after it, coefficients (K + 1, n + m) of the n states and m watched
    quantities, those of the sensitivities (K + 1, n columns), lengths taken and tried (2,)). Its argument z holds the
    state (n,), its sensitivities, the time left and the longest step to try, and `data` the parameters and their seeds.
    A rejected step has length 0, and the next one tries half its length or less.

    The sensitivities solve the variational equations dx' = f_x dx + f_p dp. The series of f_x and f_p are found once,
    and with them one column after another; `varied` are the rows of dp that are not zero.
    """

    def __init__(self, graph: VectorField, columns: int, varied: tuple[int, ...] = ()):
        self.n, self.columns, self.varied = graph.size, columns, list(varied)
        self.rows = graph.size + graph.field.numel_out(1)
        self.step_function, instructions = _step_function(graph, columns, varied)
        self.seconds_per_step = instructions * SECONDS_PER_INSTRUCTION
        # Compiled once its interpretation took as long as that will, a function costs at most twice the best time.
        self.interpretation_budget = SEARCH_SHARE * compile_seconds(self.step_function)
        self.cache_searched = self.compiled = False
        # Steps in the first block of a motion of given duration. A number learned from earlier motions would change
        # the last digits from call to call, as states are rounded between blocks.
        self.expected_steps = 4
        self._calls, self._batch_calls = dict[int, BufferedFunction](), dict[int, MappedFunction]()

    def advance(self, x: Array, p: Array, dx: Array, dp: Array, count: int, left: float, hint: float | None) -> Steps:
        """The accepted ones of `count` steps, which together last no longer than `left`; the `hint` is not used.

        Returns steps (m,), coefficients (m, rows, K + 1) and sensitivities (m, n, columns, K + 1). A single NaN is
        returned for the steps when none is accepted.
        """
        with LOCK:
            self.count_steps(count)
            if (call := self._calls.get(count)) is None:
                chain = self.step_function if count == 1 else self.step_function.mapaccum(count)
                call = self._calls[count] = BufferedFunction(chain)
        with LOCK:
            start, data = call.arguments[0], call.arguments[1].reshape(count, -1)
            start[: self.n], start[-2], start[-1] = x, left, LONGEST_STEP
            data[:, : len(p)] = p
            if self.columns:
                start[self.n : -2] = dx.T.ravel()
                data[:, len(p) :] = dp[self.varied].T.ravel()
            call.trigger()
            ends, c, dc, (steps, tried) = call.results
            while not steps.any() and tried[-1] > FLOW_CONTROL.shortest_step and np.isfinite(c).all():
                start[-1] = ends[-1, -1]
                call.trigger()
            c, dc = self.unfold(c.copy(order="K"), dc.copy(order="K"))
            taken = steps > 0
            steps = steps[taken]
        if not taken.any():
            return np.full(1, np.nan), c[:1], None
        return (steps, c, dc) if taken.all() else (steps, c[taken], dc[taken])

    def unfold(self, c: Array, dc: Array) -> tuple[Array, Array]:
        """Coefficients (..., count, rows, K + 1) and sensitivities (..., count, n, columns, K + 1) of `count` steps."""
        c = c.swapaxes(-1, -2).reshape(*c.shape[:-2], -1, self.rows, TAYLOR_ORDER + 1)
        dc = dc.swapaxes(-1, -2).reshape(*c.shape[:-2], self.columns, self.n, TAYLOR_ORDER + 1)
        return c, dc.swapaxes(-2, -3)

    def advance_all(self, x: Array, p: Array, count: int) -> tuple[Array, Array, Array]:
        """`count` steps of each of several motions without sensitivities, from states (m, n) with parameters (m, np).

        Returns steps (m, count), 0 where they are rejected; coefficients (m, count, rows, K + 1); and which steps
        (m, count) are numbers and not vanishing.
        """
        with LOCK:
            self.count_steps(count * len(x))
            if (call := self._batch_calls.get(count)) is None:
                call = self._batch_calls[count] = MappedFunction(self.step_function.mapaccum(count))
        limits = np.tile([np.inf, LONGEST_STEP], (len(x), 1))
        _, c, dc, made = call(np.concatenate([x, limits], axis=1), np.tile(p, count))
        steps, tried = made.swapaxes(0, 1)
        c, _ = self.unfold(c, dc)
        return steps, c, np.isfinite(c).all((2, 3)) & (tried > FLOW_CONTROL.shortest_step)

    def count_steps(self, count: int) -> None:
        """Count steps to be taken; after enough of them, search the cache for the compiled function or make it."""
        with LOCK:
            self.interpretation_budget -= count * self.seconds_per_step
            if self.interpretation_budget >= 0:
                return
            faster = (compile_function if self.cache_searched else compiled_before)(self.step_function)
            again = not (faster or self.cache_searched)
            self.interpretation_budget = (1 - SEARCH_SHARE) * compile_seconds(self.step_function) if again else np.inf
            self.cache_searched = True
            if faster is not None:
                self.step_function, self._calls, self._batch_calls, self.compiled = faster, {}, {}, True


def _step_function(graph: VectorField, columns: int, varied: tuple[int, ...]) -> tuple[ca.Function, int]:
    """The `step_function` of a `TaylorStepper`, and how many instructions a step takes."""
    n, size = graph.size, graph.p.numel()
    z, data = ca.MX.sym("z", n * (1 + columns) + 2), ca.MX.sym("p", size + len(varied) * columns)
    x, dx = z[:n], ca.reshape(z[n:-2], n, columns)
    p, dp = data[:size], ca.reshape(data[size:], len(varied), columns)
    if columns:
        series, column = variations(graph.field, varied, TAYLOR_ORDER)
        c, slopes = series(x, p)
        dc = ca.horzcat(*[column(slopes, dx[:, j], dp[:, j]) for j in range(columns)])
        repeated = (columns - 1) * column.n_instructions()
    else:
        c = ca.Function("series", [graph.x, graph.p], [ca.densify(graph.series.T)])(x, p)
        dc, repeated = ca.MX(TAYLOR_ORDER + 1, 0), 0
    powers, limits, made = _length_function(graph, columns, len(varied))(c[:, :n], dc, p, ca.vec(dp), z[-2:])
    ends = (powers.T @ ca.horzcat(c[:, :n], dc)).T
    function = ca.Function("taylor", [z, data], [ca.vertcat(ends, limits), c, dc, made])
    return function, sum(lengths(function)) + repeated


def _length_function(graph: VectorField, columns: int, varied: int) -> ca.Function:
    """The choice of a step's length: coefficients of a step, p, dp, and limits (2,), which are the time left and the
    longest step to try -> the powers (K + 1,) of the length, the next limits, the lengths taken and tried."""
    n, orders = graph.size, TAYLOR_ORDER + 1
    c, dc = ca.SX.sym("c", orders, n), ca.SX.sym("dc", orders, n * columns)
    dp, limits = ca.SX.sym("dp", varied * columns), ca.SX.sym("l", 2)
    left, longest = ca.vertsplit(limits)
    length = _truncated_length(c, 0)
    if varied:  # The series of f_p may have a smaller radius of convergence than that of f.
        length = ca.fmin(length, _truncated_length(dc, ca.norm_inf(dp)))
    for weights, reach in graph.reaches:
        length = ca.fmin(length, _time_within(c, weights, reach))
    h = ca.fmin(longest, length)
    h = ca.if_else(h >= left, left, ca.if_else(SHARED_STEPS * h >= left, 0.5 * left, h))
    size = ca.fmax(ca.norm_inf(ca.vec(c[:2, :])), TINY)  # The size of a motion at rest at the origin would be 0.
    accepted = _defect(graph, ca.diag(symbolic_powers(h)) @ c, h) <= LARGEST_DEFECT * size
    # A step that is far too long for the rate of the state is shortened at once instead of halved many times.
    shorter = 0.5 * ca.fmin(h, ca.sqrt(h * size / ca.norm_inf(c[1, :])))
    taken, next_longest = ca.if_else(accepted, h, 0), ca.if_else(accepted, LONGEST_STEP, shorter)
    results = [symbolic_powers(taken), ca.vertcat(left - taken, next_longest), ca.vertcat(taken, h)]
    return ca.Function("measure", [c, dc, graph.p, dp, limits], results)


def _truncated_length(c: ca.SX, size: ca.SX | float) -> ca.SX:
    """The step at which the last two terms of series (K + 1, rows) vanish beside the first two and `size`, by Jorba and
    Zou (2005), the source of `taylor_series`."""
    scale, before, last = (ca.norm_inf(ca.vec(part)) for part in (c[:2, :], c[-2, :], c[-1, :]))
    bound = TRUNCATION * (scale + size)
    return ca.fmin((bound / before) ** (1 / (TAYLOR_ORDER - 1)), (bound / last) ** (1 / TAYLOR_ORDER))


def _time_within(c: ca.SX, weights: tuple[float, ...], reach: float) -> ca.SX:
    """The time in which the speed and the acceleration at the start of series (K + 1, rows) lead as far as `reach`."""
    speed, half_rate = (ca.fabs(c[order, : len(weights)] @ ca.DM(list(weights))) for order in (1, 2))
    return 2 * reach / (speed + ca.sqrt(speed**2 + 4 * half_rate * reach))


def _defect(graph: VectorField, terms: ca.SX, h: ca.SX) -> ca.SX:
    """The largest defect of the polynomial in the differential equation at the quarters of the step, times its length.

    It shows what a series cannot know where a law is flat to the last digit, as a saturated spring is.
    """
    orders, defects = np.arange(TAYLOR_ORDER + 1), [ca.SX(0)]  # A state whose rate is another state has no defect.
    rows = [i for i, rate in enumerate(ca.vertsplit(graph.field(graph.x, graph.p)[0])) if not rate.is_symbolic()]
    for part in (0.25, 0.5, 0.75, 1.0):
        scale = part**orders
        for i, rate in enumerate(ca.vertsplit(graph.field(terms.T @ ca.DM(scale), graph.p)[0])):
            if i in rows:
                defects.append(ca.fabs(terms[:, i].T @ ca.DM(orders * scale) / part - h * rate))
    return ca.mmax(ca.vertcat(*defects))
