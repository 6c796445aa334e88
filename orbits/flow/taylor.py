"""Taylor steps of a flow with their sensitivities, of one motion or of many, in kernels."""

from functools import cached_property
from math import comb
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..numerics.bernstein import TINY
from ..numerics.roots import Array
from ..symbolic.kept import kept
from ..symbolic.kernels import Kernel
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
# The highest order of a zero at the start of a motion that a search divides out.
HIGHEST_ORDER = 3


class Motions(NamedTuple):
    """Motions of given durations, in N Taylor steps altogether.

    ends, variations : states (m, n) at their ends, and their derivatives (m, n, columns)
    steps, coefficients, slopes : (N,), (N, rows, K + 1) and (N, n, columns, K + 1) of one motion after the other
    counts : (m,), how many steps each takes
    left : (m,), the time that is left, 0 where a motion has not broken down
    """

    ends: Array
    variations: Array
    steps: Array
    coefficients: Array
    slopes: Array
    counts: Array
    left: Array


class TaylorStepper:
    """Takes Taylor steps with the sensitivities of the states.

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
        self.step_function = _step_function(graph, columns, varied)
        self.kernel = Kernel(self._recorded_motion())
        self._watching: dict[tuple[int, int], Kernel] = {}  # of `watch`, by the functions and turns

    @property
    def compiled(self) -> bool:
        """Whether motions take their steps in machine code."""
        return any(kernel.compiled for kernel in (self.kernel, *self._watching.values()))

    def advance(self, x: Array, p: Array, dx: Array, dp: Array, count: int, left: float, hint: float | None) -> Steps:
        """At most `count` steps of one motion, which last no longer than `left`; the `hint` is not used.

        Returns steps (m,), coefficients (m, rows, K + 1) and sensitivities (m, n, columns, K + 1). A single NaN is
        returned for the steps when none is accepted.
        """
        found = self.advance_all(x[None], p[None], np.array([left]), dx, dp, count)
        if not len(found.steps):
            return np.full(1, np.nan), x[None, :, None], None
        if found.left[0] == 0:  # the time was counted down, with other roundings than those of the sum of the steps
            found.steps[-1] += left - np.cumsum(found.steps)[-1]
        return found.steps, found.coefficients, found.slopes

    def advance_all(
        self, x: Array, p: Array, durations: Array, dx: Array, dp: Array, record: int | None = FLOW_CONTROL.max_steps
    ) -> Motions:
        """Motions from states (m, n) with parameters (m, np) or (1, np), each for its duration (m,) or as many steps as
        are recorded at most, None for none of any number; dx (n, columns) and dp (np, columns) are their seeds."""
        size, n, columns, count_p = len(x), self.n, self.columns, p.shape[1]
        z, data = np.empty((size, n * (1 + columns) + 2)), np.empty((len(p), self.kernel.sizes_in[1]))
        z[:, :n], z[:, n:-2], z[:, -2], z[:, -1] = x, dx.T.ravel(), durations, LONGEST_STEP
        data[:, :count_p], data[:, count_p:-1], data[:, -1] = p, dp[self.varied].T.ravel(), record is not None
        z, (c, dc, steps), counts, _ = self.kernel(z, data, most=record or 1)
        orders = TAYLOR_ORDER + 1
        variations, slopes = z[:, n:-2].reshape(size, columns, n), dc.reshape(len(c), columns, n, orders)
        c = c.reshape(-1, self.rows, orders)
        return Motions(z[:, :n], variations.swapaxes(1, 2), steps[:, 0], c, slopes.swapaxes(1, 2), counts, z[:, -2])

    def watch(
        self,
        z: Array,
        p: Array,
        weights: Array,
        offsets: Array,
        limits: Array,
        turns: int = 0,
        record: int | None = None,
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Motions until an affine function may change its sign, or until their times reach the `limits` (m,).

        z : (m, n + 5 + q) as `watched_state` makes it; p (m, np) or (1, np)
        weights, offsets : (m, q, rows) and (m, q), of the q functions
        turns : where it is given, the second function ends no motion before its sign at the ends of steps has changed
            so often; the size of its sign in z is one more than the number of changes
        record : how many steps are recorded at most; None for only those in which a function may change its sign, by
            Bernstein exclusion

        Returns z when each has ended; the coefficients (N, rows, K + 1) of the steps that are recorded; what z was
        before each of them beyond the state, with the length in the place of the time left; the number (m,) of these
        steps of each motion; and whether it would go on (m,), after the last record or after the most steps.
        """
        count, size = offsets.shape
        if (kind := (size, turns)) not in self._watching:
            self._watching[kind] = Kernel(_watch_function(self, size, turns))
        data = [np.broadcast_to(p, (count, p.shape[1])), weights.reshape(count, -1), offsets, limits[:, None]]
        data.append(np.full((count, 1), float(record is not None)))
        z, (c, before), counts, going = self._watching[kind](z, np.hstack(data), most=record or 1)
        return z, c.reshape(-1, self.rows, TAYLOR_ORDER + 1), before, counts, going

    def watched_state(self, x: Array, times: Array, orders: Array, signs: Array) -> Array:
        """The argument z of `watch`: states (m, n); the time left, which is not limited; the longest step to try; the
        times (m,); the orders (m,) of the zeros of the first function there, which are divided out; whether a step may
        hold a zero; and signs (m, q) of the functions, 0 where they begin."""
        limits = np.full((len(x), 2), (np.inf, LONGEST_STEP))
        return np.column_stack([x, limits, times, orders, np.zeros(len(x)), signs])

    def _recorded_motion(self) -> ca.Function:
        """The steps of a motion as a `Kernel` iterates them: recorded are coefficients, sensitivities and the length of
        an accepted step, where the last entry of the data is 1."""
        z, data = (ca.MX.sym(name, self.motion_function.numel_in(i) + i) for i, name in enumerate("zp"))
        *results, taken, goes = self.motion_function(z, data[:-1])
        return ca.Function("recorded", [z, data], [*results, ca.logic_and(taken, data[-1]), goes])

    @cached_property
    def motion_function(self) -> ca.Function:
        """A step of a motion, (z, data) -> (z after it, coefficients, those of the sensitivities, the length, whether
        it counts, whether to go on); it goes on until no time is left, the state runs away or no step is accepted."""
        z, data = (ca.MX.sym(name, self.step_function.numel_in(i)) for i, name in enumerate("zp"))
        after, c, dc, made = self.step_function(z, data)
        limits = ca.vertcat(after[: self.n], after[-2:])
        taken, goes = _progress(self.n, c.numel())(limits, ca.vec(c), made)
        # A motion whose last step is no number has not come to its end.
        left = ca.if_else(ca.logic_and(made[0] > 0, ca.logic_not(taken)), np.nan, after[-2])
        after = ca.vertcat(after[:-2], left, after[-1])
        return ca.Function("motion", [z, data], [after, c, dc, made[0], taken, goes])


def _progress(n: int, size: int) -> ca.Function:
    """(state and limits after a step, its `size` coefficients, lengths taken and tried) -> whether the step counts, and
    whether another one is to be taken."""
    z, c, made = ca.SX.sym("z", n + 2), ca.SX.sym("c", size), ca.SX.sym("made", 2)
    finite = ca.fabs(ca.sum1(c) + ca.sum1(z[:n])) < np.inf
    inside = ca.logic_and(ca.mmax(ca.fabs(z[:n])) < FLOW_CONTROL.runaway, made[1] > FLOW_CONTROL.shortest_step)
    goes = ca.logic_and(ca.logic_and(finite, inside), z[-2] > 0)
    return ca.Function("progress", [z, c, made], [ca.logic_and(finite, made[0] > 0), goes])


def _watch_function(stepper: TaylorStepper, size: int, turns: int) -> ca.Function:
    """A step of `TaylorStepper.watch` with so many functions and turns, as a `Kernel` iterates it."""
    n, rows = stepper.n, stepper.rows
    count = stepper.step_function.numel_in(1)
    z, data = ca.MX.sym("z", n + 5 + size), ca.MX.sym("p", count + size * (rows + 1) + 2)
    p, tests, limit, all_steps = data[:count], data[count:-2], data[-2], data[-1]
    after, c, _, made = stepper.step_function(z[: n + 2], p)
    taken, goes = _progress(n, c.numel())(after, ca.vec(c), made)
    inside = ca.logic_and(taken, ca.mmax(ca.fabs(after[:n])) < FLOW_CONTROL.runaway)
    changes, signs = _may_change_sign(rows, size, turns > 0)(c, made[0], tests, z[n + 3], z[n + 5 :])
    found = ca.logic_and(inside, changes)
    time = z[n + 2] + made[0]
    # A motion that runs away stays where it was, so that it can be followed from there by itself.
    new = ca.if_else(inside, ca.vertcat(after, time, 0, found, signs), ca.vertcat(z[:n], after[n:], z[n + 2 :]))
    goes = ca.logic_and(ca.logic_and(goes, ca.logic_not(found)), new[n + 2] < limit)
    goes = ca.logic_and(goes, made[1] > FLOW_CONTROL.shortest_step * z[n + 2])
    if turns:
        goes = ca.logic_and(goes, ca.fabs(new[n + 6]) <= turns)
    before = ca.vertcat(made[0], z[n + 1 :])
    return ca.Function("watch", [z, data], [new, c, before, ca.logic_and(inside, ca.logic_or(found, all_steps)), goes])


@kept
def _may_change_sign(rows: int, size: int, counts: bool) -> ca.Function:
    """(coefficients (K + 1, rows), step, weights (rows, size) and offsets (size,), order of the first function's zero,
    signs (size,) before) -> whether an affine function may change its sign in the step, and the signs after it. With
    `counts` the second function is not asked; its sign grows by one where it is another after the step.

    As in `numerics.bernstein`: a polynomial has no zero where its Bernstein coefficients have one sign, and the sign at
    the start is that at the end of the step before.
    """
    c, h, order = ca.SX.sym("c", TAYLOR_ORDER + 1, rows), ca.SX.sym("h"), ca.SX.sym("order")
    tests, before = ca.SX.sym("w", size * (rows + 1)), ca.SX.sym("s", size)
    powers, change, after = symbolic_powers(h), ca.SX(0), []
    binomials = ca.DM([comb(TAYLOR_ORDER, k) for k in range(TAYLOR_ORDER + 1)])
    for i in range(size):
        series = c @ tests[i * rows : (i + 1) * rows]
        series[0] += tests[size * rows + i]
        if counts and i == 1:
            was = ca.if_else(before[i] == 0, series[0], before[i]) >= 0
            ends = ca.dot(series, powers) >= 0
            size_before = ca.fmax(ca.fabs(before[i]), 1.0)
            after.append(ca.if_else(ends, 1.0, -1.0) * (size_before + ca.if_else(was == ends, 0.0, 1.0)))
            continue
        for skipped in range(1, HIGHEST_ORDER + 1) if i == 0 else ():
            series = ca.if_else(order >= skipped, ca.vertcat(series[1:], 0), series)
        rise, values = series * powers / binomials, []
        while rise.numel():  # differences of the Bernstein coefficients, added up
            values.append(rise[0])
            rise = rise[:-1] + rise[1:]
        begins = ca.if_else(before[i] == 0, values[0], before[i]) >= 0
        rest = ca.vertcat(*values[1:])
        same = ca.if_else(begins, ca.mmin(rest) >= 0, ca.mmax(rest) < 0)
        same = ca.logic_and(same, ca.fabs(values[-1]) < np.inf)
        change = ca.logic_or(change, ca.logic_not(same))
        after.append(ca.if_else(values[-1] >= 0, 1.0, -1.0))
    return ca.Function("signs", [c, h, tests, order, before], [change, ca.vertcat(*after)])


def _step_function(graph: VectorField, columns: int, varied: tuple[int, ...]) -> ca.Function:
    """The `step_function` of a `TaylorStepper`."""
    n, size = graph.size, graph.p.numel()
    z, data = ca.MX.sym("z", n * (1 + columns) + 2), ca.MX.sym("p", size + len(varied) * columns)
    x, dx = z[:n], ca.reshape(z[n:-2], n, columns)
    p, dp = data[:size], ca.reshape(data[size:], len(varied), columns)
    if columns:
        c, dc = variations(graph.field, varied, columns, TAYLOR_ORDER)(x, p, dx, dp)
    else:
        c = ca.Function("series", [graph.x, graph.p], [ca.densify(graph.series.T)])(x, p)
        dc = ca.MX(TAYLOR_ORDER + 1, 0)
    powers, limits, made = _length_function(graph, columns, len(varied))(c[:, :n], dc, p, ca.vec(dp), z[-2:])
    ends = (powers.T @ ca.horzcat(c[:, :n], dc)).T
    # A choice between ends costs less than powers of a chosen length, into which CasADi draws the choice.
    after = ca.vertcat(ca.if_else(made[0] > 0, ends, z[:-2]), limits)
    return ca.Function("taylor", [z, data], [after, c, dc, made])


def _length_function(graph: VectorField, columns: int, varied: int) -> ca.Function:
    """The choice of a step's length: coefficients of a step, p, dp, and limits (2,), which are the time left and the
    longest step to try -> the powers (K + 1,) of the length tried, the next limits, the lengths taken and tried."""
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
    powers = symbolic_powers(h)
    accepted = _defect(graph, ca.diag(powers) @ c, h) <= LARGEST_DEFECT * size
    # A step that is far too long for the rate of the state is shortened at once instead of halved many times.
    shorter = 0.5 * ca.fmin(h, ca.sqrt(h * size / ca.norm_inf(c[1, :])))
    taken, next_longest = ca.if_else(accepted, h, 0), ca.if_else(accepted, LONGEST_STEP, shorter)
    results = [powers, ca.vertcat(left - taken, next_longest), ca.vertcat(taken, h)]
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
