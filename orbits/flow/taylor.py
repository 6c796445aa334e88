"""Taylor steps of a flow with their sensitivities, of one motion or of many, in kernels."""

from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..numerics.exclusion import HIGHEST_ORDER, bernstein_coefficients
from ..numerics.polynomial_roots import TINY
from ..numerics.roots import Array
from ..symbolic.caches import cached
from ..symbolic.calls import BufferedFunction
from ..symbolic.kernels import Kernel
from ..symbolic.taylor_series import driven_coefficients, tangent, variations
from .vector_field import FLOW_CONTROL, TAYLOR_ORDER, Steps, VectorField, rows_used, symbolic_powers

# Truncation error of a step relative to the state: a tenth of the rounding error of the sum.
TRUNCATION = 1e-17
# A step of larger defect, relative to the state, leads beyond what the series can describe. Rounding is far smaller.
LARGEST_DEFECT = 1e-10
# No step is longer than this. A state at rest needs the bound, since its series has no last terms to choose a step by.
LONGEST_STEP = 1e9
# Where less than this many steps are left of the duration, the last two share it evenly, so that none is tiny.
SHARED_STEPS = 1.5
# Up to this degree the terms of a watched function are bounded together, the others one by one.
BOUND_DEGREE = 6


class Motions(NamedTuple):
    """Motions of stated durations, in N Taylor steps altogether.

    ends, variations : states (m, n) at their ends, and their derivatives (m, n, columns)
    steps, coefficients : (N,) and (N, rows, K + 1) of one motion after the other
    begins : derivatives (N, n, columns) of the states at the beginnings of the steps
    counts : (m,), how many steps each takes
    left : (m,), the time that is left, 0 where a motion has not broken down
    """

    ends: Array
    variations: Array
    steps: Array
    coefficients: Array
    begins: Array
    counts: Array
    left: Array


class Places(NamedTuple):
    """The layout of z, the state of a motion between two steps; without watched functions it ends with the
    longest step to try."""

    state: slice  # (n,)
    sensitivities: slice  # (n columns,), one column after the other
    signs: slice  # (q,) of the functions, 0 where they begin; they come last
    left: int  # the time left
    longest: int  # the longest step to try
    time: int  # the time gone by
    order: int  # of the zero of the first function at this time, which is divided out
    found: int  # whether a function may change its sign in the step before
    changes: int  # how often the second function has changed its sign at the ends of steps


class Watched(NamedTuple):
    """Steps (N,) of motions that are watched, with the times, orders, changes and signs of `Places` before them."""

    coefficients: Array  # (N, rows, K + 1)
    lengths: Array
    times: Array
    orders: Array
    changes: Array
    signs: Array  # (N, q)


class TaylorStepper:
    """Takes Taylor steps with the sensitivities of the states.

    `step_function` makes one step: (z, data) -> (z after it, coefficients (K + 1, n + m) of the n states and m watched
    quantities, lengths taken and tried (2,)). Its argument z is as `places` states, and `data` are the parameters and
    their seeds. A rejected step has length 0, and the next one tries half its length or less.

    The sensitivities solve the variational equations dx' = f_x dx + f_p dp. The series of f_x and f_p are found once,
    and with them one column after another; `varied` are the rows of dp that are not zero.
    """

    def __init__(self, graph: VectorField, columns: int, varied: tuple[int, ...] = ()):
        self.graph, self.n, self.columns, self.varied = graph, graph.size, columns, list(varied)
        self.rows, left = graph.size + graph.field.numel_out(1), graph.size * (1 + columns)
        numbers = range(left, left + 6)
        self.places = Places(slice(self.n), slice(self.n, left), slice(numbers.stop, None), *numbers)
        self.step_function = _step_function(graph, self.places, columns, varied)
        self.kernel = Kernel(self.motion_function)
        self._watching: dict[tuple[tuple, int], Kernel] = {}  # of `watch`, by the rows in the functions and turns

    def advance(self, x: Array, p: Array, dx: Array, dp: Array, count: int, left: float, hint: float | None) -> Steps:
        """At most `count` steps of one motion, which last no longer than `left`; the `hint` is not used.

        Returns steps (m,), coefficients (m, rows, K + 1) and the sensitivities (m, n, columns) at their beginnings. A
        single NaN is returned for the steps when none is accepted.
        """
        if count == 1:  # without a kernel's preparations, which take as long as some steps
            length, c = self._one_step(x, p, dx, dp, left)
            return np.array([length]), c[None], dx[None]
        found = self.advance_all(x[None], p[None], np.array([left]), dx, dp, count)
        if not len(found.steps):
            return np.full(1, np.nan), x[None, :, None], dx[None]
        if found.left[0] == 0:  # the time was counted down, with other roundings than those of the sum of the steps
            found.steps[-1] += left - np.cumsum(found.steps)[-1]
        return found.steps, found.coefficients, found.begins

    def sensitivities_after(self, x: Array, p: Array, dx: Array, dp: Array, h: float) -> Array:
        """The sensitivities (n, columns) at the end of a step of length h, not longer than the accepted one."""
        return self._sensitivities(x, p, dx, dp[self.varied], h)[0]

    @cached_property
    def _sensitivities(self) -> BufferedFunction:
        expansion = _expansion(self.graph, self.columns, tuple(self.varied))
        arguments, h, length = expansion.mx_in(), ca.MX.sym("h"), ca.SX.sym("h")
        powers = ca.Function("powers", [length], [symbolic_powers(length)])(h)
        after = ca.reshape(expansion(*arguments)[1].T @ powers, self.n, self.columns)
        return BufferedFunction(ca.Function("sensitivities", [*arguments, h], [after]))

    def _one_step(self, x: Array, p: Array, dx: Array, dp: Array, left: float) -> tuple[float, Array]:
        """The length of the first accepted step, NaN without one, and its coefficients."""
        z = np.concatenate([x, dx.T.ravel(), [left, LONGEST_STEP]])
        data = np.concatenate([p, dp[self.varied].T.ravel()])
        while True:
            after, c, made = self._interpreted_step(z, data)
            z, (taken, tried) = after[:, 0], made[:, 0].tolist()
            if taken > 0:
                return taken, c.T
            if not tried > FLOW_CONTROL.shortest_step:
                return np.nan, x[:, None]

    @cached_property
    def _interpreted_step(self) -> BufferedFunction:
        return BufferedFunction(self.step_function)

    def advance_all(
        self, x: Array, p: Array, durations: Array, dx: Array, dp: Array, count: int = FLOW_CONTROL.max_steps
    ) -> Motions:
        """Motions from states (m, n) with parameters (m, np) or (1, np), each for its duration (m,) or at most `count`
        steps; dx (n, columns) and dp (np, columns) are the seeds of all, or dx (m, n, columns) and dp (m, np, columns)
        those of each."""
        size, n, columns, count_p, at = len(x), self.n, self.columns, p.shape[1], self.places
        dx, dp = dx.swapaxes(-1, -2), dp[..., self.varied, :].swapaxes(-1, -2)
        z = np.empty((size, self.kernel.sizes_in[0]))
        data = np.empty((max(len(p), len(dp) if dp.ndim > 2 else 1), self.kernel.sizes_in[1]))
        z[:, at.state], z[:, at.sensitivities] = x, dx.reshape(*dx.shape[:-2], -1)
        z[:, at.left], z[:, at.longest] = durations, LONGEST_STEP
        data[:, :count_p], data[:, count_p:] = p, dp.reshape(*dp.shape[:-2], -1)
        z, (c, begins, steps), counts, _ = self.kernel(z, data, most=count)
        moving = z[:, at.sensitivities], begins
        variations, begins = (each.reshape(len(each), columns, n).swapaxes(1, 2) for each in moving)
        c = c.reshape(-1, self.rows, TAYLOR_ORDER + 1)
        return Motions(z[:, at.state], variations, steps[:, 0], c, begins, counts, z[:, at.left])

    def watch(
        self, z: Array, p: Array, weights: Array, offsets: Array, limits: Array, turns: int = 0, most: int | None = None
    ) -> tuple[Array, Watched, Array, Array]:
        """Motions until an affine function may change its sign, or until their times reach the `limits` (m,).

        z : (m, n + 6 + q) as `watched_state` makes it; p (m, np) or (1, np)
        weights, offsets : (m, q, rows) and (m, q), of the q functions
        turns : if not 0, the second function ends no motion before its sign at the ends of steps has changed
            this number of times
        most : all steps are recorded, and at most this number is taken; if None, the steps alone are recorded in which
            a function may change its sign, by Bernstein exclusion

        Returns z when each has ended; the steps that are recorded; the number (m,) of these of each motion; and whether
        it would go on (m,), after the last record or after the most steps.
        """
        count = len(offsets)
        if (kind := (tuple(map(rows_used, weights.transpose(1, 2, 0))), turns)) not in self._watching:
            self._watching[kind] = Kernel(_watch_function(self, *kind))
        data = [np.broadcast_to(p, (count, p.shape[1])), weights.reshape(count, -1), offsets, limits[:, None]]
        data.append(np.full((count, 1), float(most is not None)))
        z, (c, begins, signs), counts, going = self._watching[kind](z, np.hstack(data), most=most or 1)
        lengths, times, orders, changes = begins.T
        c = c.reshape(-1, self.rows, TAYLOR_ORDER + 1)
        return z, Watched(c, lengths, times, orders, changes, signs), counts, going

    def watched_state(self, x: Array, times: Array, orders: Array, signs: Array) -> Array:
        """The argument z of `watch`: states (m, n) at times (m,), the orders (m,) of the zeros of the first function
        there, and signs (m, q) of the functions, 0 where they begin; the time left is not limited."""
        z, at = np.zeros((len(x), self.places.signs.start + signs.shape[1])), self.places
        z[:, at.state], z[:, at.left], z[:, at.longest], z[:, at.time] = x, np.inf, LONGEST_STEP, times
        z[:, at.order], z[:, at.signs] = orders, signs
        return z

    @cached_property
    def motion_function(self) -> ca.Function:
        """A step of a motion as a `Kernel` iterates it, (z, data) -> (z after it, coefficients, the sensitivities
        before it, the length, whether it counts, whether to go on); it goes on until no time is left, the state runs
        away or no step is accepted."""
        z, data = (ca.MX.sym(name, self.step_function.numel_in(i)) for i, name in enumerate("zp"))
        (after, c, made), at = self.step_function(z, data), self.places
        taken, goes = _progress(self.n, c.numel())(after[at.state], after[at.left], ca.vec(c), made)
        # A motion whose last step is no number has not come to its end.
        left = ca.if_else(ca.logic_and(made[0] > 0, ca.logic_not(taken)), np.nan, after[at.left])
        after = ca.vertcat(after[: at.left], left, after[at.longest])
        return ca.Function("motion", [z, data], [after, c, z[at.sensitivities], made[0], taken, goes])


def _progress(n: int, size: int) -> ca.Function:
    """(state and time left after a step, its `size` coefficients, lengths taken and tried) -> whether the step counts,
    and whether another one is to be taken."""
    x, left, c, made = ca.SX.sym("x", n), ca.SX.sym("left"), ca.SX.sym("c", size), ca.SX.sym("made", 2)
    finite = ca.fabs(ca.sum1(c) + ca.sum1(x)) < np.inf
    inside = ca.logic_and(ca.mmax(ca.fabs(x)) < FLOW_CONTROL.runaway, made[1] > FLOW_CONTROL.shortest_step)
    goes = ca.logic_and(ca.logic_and(finite, inside), left > 0)
    return ca.Function("progress", [x, left, c, made], [ca.logic_and(finite, made[0] > 0), goes])


def _watch_function(stepper: TaylorStepper, used: tuple[tuple[int, ...], ...], turns: int) -> ca.Function:
    """A step of `TaylorStepper.watch` with functions of the rows `used` and these turns, as a `Kernel` iterates it."""
    at, rows, size, count = stepper.places, stepper.rows, len(used), stepper.step_function.numel_in(1)
    z, data = ca.MX.sym("z", at.signs.start + size), ca.MX.sym("p", count + size * (rows + 1) + 2)
    p, tests, limit, all_steps = data[:count], data[count:-2], data[-2], data[-1]
    after, c, made = stepper.step_function(z[: at.time], p)
    taken, goes = _progress(stepper.n, c.numel())(after[at.state], after[at.left], ca.vec(c), made)
    inside = ca.logic_and(taken, ca.mmax(ca.fabs(after[at.state])) < FLOW_CONTROL.runaway)
    may_change, signs, turned = _may_change_sign(rows, used, turns > 0)(c, made[1], tests, z[at.order], z[at.signs])
    found = ca.logic_and(inside, may_change)
    new = ca.vertcat(after, z[at.time] + made[0], 0, found, z[at.changes] + turned, signs)
    # A motion that runs away stays where it was, so that it can be followed from there alone.
    new = ca.if_else(inside, new, ca.vertcat(z[at.state], after[at.left :], z[at.time :]))
    goes = ca.logic_and(ca.logic_and(goes, ca.logic_not(found)), new[at.time] < limit)
    goes = ca.logic_and(goes, made[1] > FLOW_CONTROL.shortest_step * z[at.time])
    if turns:
        goes = ca.logic_and(goes, new[at.changes] < turns)
    begins = ca.vertcat(made[0], z[at.time], z[at.order], z[at.changes])
    records = c, begins, z[at.signs], ca.logic_and(inside, ca.logic_or(found, all_steps))
    return ca.Function("watch", [z, data], [new, *records, goes])


@cached
def _may_change_sign(rows: int, used: tuple[tuple[int, ...], ...], counts: bool) -> ca.Function:
    """(coefficients (K + 1, rows), step, weights (rows, size) and offsets (size,), order of the first function's zero,
    signs (size,) before) -> whether an affine function may change its sign in the step, the signs after it, and whether
    that of the second has changed. With `counts` the second function may change it, else this is not checked.
    `used` are the rows of each function whose weights are not 0.

    A polynomial has no zero where the Bernstein coefficients of its first terms have one sign and are larger than the
    sum of the other terms; the sign at the start is that at the end of the step before. The first of these coefficients
    may be smaller: the other terms are at most their sum times t, and the first terms at least that much, if the value
    at the start has the same sign.
    """
    c, h, order, size = ca.SX.sym("c", TAYLOR_ORDER + 1, rows), ca.SX.sym("h"), ca.SX.sym("order"), len(used)
    tests, before = ca.SX.sym("w", size * (rows + 1)), ca.SX.sym("s", size)
    terms, change, after, turned = ca.diag(symbolic_powers(h)) @ c, ca.SX(0), [], ca.SX(0)
    for i, own in enumerate(used):
        series = sum((terms[:, row] * tests[i * rows + row] for row in own), ca.SX.zeros(TAYLOR_ORDER + 1))
        series[0] += tests[size * rows + i]
        rest = ca.sum1(ca.fabs(series[BOUND_DEGREE + 1 :]))
        first = [series[: BOUND_DEGREE + 1]]
        for skipped in range(1, HIGHEST_ORDER + 1) if i == 0 else ():
            first.append(series[skipped : skipped + BOUND_DEGREE + 1])
            series[skipped - 1] = ca.if_else(order >= skipped, 0, series[skipped - 1])
        start, ends = first[0], ca.sum1(series)
        for skipped, shifted in enumerate(first[1:], start=1):
            start = ca.if_else(order >= skipped, shifted, start)
        begins = ca.if_else(before[i] == 0, start[0], before[i]) >= 0
        after.append(ca.if_else(ends >= 0, 1.0, -1.0))
        if counts and i == 1:
            turned = begins != (ends >= 0)
            continue
        bounds = ca.vertcat(*bernstein_coefficients(start, ca.SX.ones(start.numel()))[1:], ends)
        same = ca.if_else(begins, ca.mmin(bounds) >= rest, ca.mmax(bounds) < -rest)
        change = ca.logic_or(change, ca.logic_not(ca.logic_and(same, ca.fabs(ends) < np.inf)))
    return ca.Function("signs", [c, h, tests, order, before], [change, ca.vertcat(*after), turned])


@cached
def _expansion(graph: VectorField, columns: int, varied: tuple[int, ...]) -> ca.Function:
    """(x, p, dx, dp) -> the coefficients of a step and those of its sensitivities."""
    if columns == 1:
        return tangent(graph.field, varied, TAYLOR_ORDER)
    return variations(graph.field, varied, columns, TAYLOR_ORDER)


def _step_function(graph: VectorField, at: Places, columns: int, varied: tuple[int, ...]) -> ca.Function:
    """The `step_function` of a `TaylorStepper`."""
    n, size = graph.size, graph.p.numel()
    z, data = ca.MX.sym("z", at.time), ca.MX.sym("p", size + len(varied) * columns)
    x, dx = z[at.state], ca.reshape(z[at.sensitivities], n, columns)
    p, dp = data[:size], ca.reshape(data[size:], len(varied), columns)
    base, shares = ca.SX(n, TAYLOR_ORDER + 1), ca.SX.eye(n)
    if columns:
        c, dc = _expansion(graph, columns, varied)(x, p, dx, dp)
        series = c[:, :n]
    else:
        base, shares, driven = driven_coefficients(graph.field, graph.x, graph.p, TAYLOR_ORDER)
        series, dc = ca.Function("series", [graph.x, graph.p], [ca.densify(driven.T)])(x, p), ca.MX(TAYLOR_ORDER + 1, 0)
        symbols = graph.x, graph.p, ca.SX.sym("series", *series.shape)
        c = ca.Function("rows", symbols, [ca.densify((base + shares @ symbols[-1].T).T)])(x, p, series)
        base, shares = base[:n, :], shares[:n, :]
    choice = _length_function(graph, base, shares, columns, len(varied))
    numbers = x, p, ca.vec(dp), z[at.left], z[at.longest]
    ends, powers, left, longest, made = choice(series, c[:, :n], dc, *numbers)
    ends = ca.vertcat(ends, (powers.T @ dc).T)
    # A choice between ends costs less than powers of a chosen length, into which CasADi draws the choice.
    after = ca.vertcat(ca.if_else(made[0] > 0, ends, z[: at.left]), left, longest)
    return ca.Function("taylor", [z, data], [after, c, made])


def _length_function(graph: VectorField, base: ca.SX, shares: ca.SX, columns: int, varied: int) -> ca.Function:
    """The choice of a step's length: the series of a step, its coefficients, those of the sensitivities, x, p, dp, the
    time left and the longest step to try -> the state after the length tried, the powers (K + 1,) of this length, the
    time left then and the next longest step, the lengths taken and tried. The coefficients are those of `base` (n, K +
    1) and of the series in these `shares` (n, s)."""
    n, orders = graph.size, TAYLOR_ORDER + 1
    series, c, dc = (ca.SX.sym("c", orders, count) for count in (shares.shape[1], n, n * columns))
    dp, left, longest = ca.SX.sym("dp", varied * columns), ca.SX.sym("left"), ca.SX.sym("longest")
    length = _truncated_length(c, 0)
    if varied:  # The series of f_p may have a smaller radius of convergence than that of f.
        length = ca.fmin(length, _truncated_length(dc, ca.norm_inf(dp)))
    for weights, reach in graph.reaches:
        length = ca.fmin(length, _time_within(c, weights, reach))
    h = ca.fmin(longest, length)
    h = ca.if_else(h >= left, left, ca.if_else(SHARED_STEPS * h >= left, 0.5 * left, h))
    size = ca.fmax(ca.norm_inf(ca.vec(c[:2, :])), TINY)  # The size of a motion at rest at the origin would be 0.
    powers = symbolic_powers(h)
    terms, free = ca.diag(powers) @ series, ca.diag(powers) @ base.T
    ends = ca.sum1(free).T + shares @ ca.sum1(terms).T
    accepted = _defect(graph, ends, free, terms, shares, h) <= LARGEST_DEFECT * size
    # A step that is far too long for the rate of the state is shortened in one go instead of halved many times.
    shorter = 0.5 * ca.fmin(h, ca.sqrt(h * size / ca.norm_inf(c[1, :])))
    taken, next_longest = ca.if_else(accepted, h, 0), ca.if_else(accepted, LONGEST_STEP, shorter)
    results = [ends, powers, left - taken, next_longest, ca.vertcat(taken, h)]
    return ca.Function("measure", [series, c, dc, graph.x, graph.p, dp, left, longest], results)


def _truncated_length(c: ca.SX, size: ca.SX | float) -> ca.SX:
    """The step at which the last two terms of series (K + 1, rows) vanish beside the first two and `size`, by Jorba and
    Zou (2005), the source of `taylor_series`."""
    scale, before, last = (ca.norm_inf(ca.vec(part)) for part in (c[:2, :], c[-2, :], c[-1, :]))
    bound, order = TRUNCATION * (scale + size), TAYLOR_ORDER
    # The lesser one of two roots, chosen before it is taken, since a root takes as long as a hundred products.
    sooner = bound / before <= (before / last) ** (order - 1)
    return (bound / ca.if_else(sooner, before, last)) ** ca.if_else(sooner, 1 / (order - 1), 1 / order)


def _time_within(c: ca.SX, weights: tuple[float, ...], reach: float) -> ca.SX:
    """The time in which the speed and the acceleration at the start of series (K + 1, rows) lead as far as `reach`."""
    speed, half_rate = (ca.fabs(c[order, : len(weights)] @ ca.DM(list(weights))) for order in (1, 2))
    return 2 * reach / (speed + ca.sqrt(speed**2 + 4 * half_rate * reach))


def _defect(graph: VectorField, ends: ca.SX, free: ca.SX, terms: ca.SX, shares: ca.SX, h: ca.SX) -> ca.SX:
    """The largest defect of the polynomial in the differential equation at the quarters of the step, times its length.
    The polynomial has the terms `free` (K + 1, n) and shares (n, s) in others (K + 1, s), and is `ends` at the end.

    It shows what a series cannot show where a law is flat to the last digit, as a saturated spring is.
    """
    orders, defects = ca.DM(range(TAYLOR_ORDER + 1)), [ca.SX(0)]  # A state whose rate is another state has no defect.
    rows = [i for i, rate in enumerate(ca.vertsplit(graph.field(graph.x, graph.p)[0])) if not rate.is_symbolic()]
    rates = [(ca.diag(orders) @ part)[1:, :] for part in (free, terms)]
    for part in (0.25, 0.5, 0.75, 1.0):
        # Horner's rule, as the powers of the part would be as many constants.
        value = lambda a, b, part=part: _at(a, part).T + shares @ _at(b, part).T  # noqa: E731
        state = value(free, terms) if part < 1 else ends
        difference = value(*rates) - h * graph.field(state, graph.p)[0]
        defects += [ca.fabs(difference[i]) for i in rows]
    return ca.mmax(ca.vertcat(*defects))


def _at(terms: ca.SX, part: float) -> ca.SX:
    """The polynomials with these terms (K + 1, s) in a step at a part of it, (1, s)."""
    return ca.horzcat(*(ca.polyval(each[::-1], part) for each in ca.horzsplit(ca.densify(terms))))
