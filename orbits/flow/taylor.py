"""Single steps of a flow with their sensitivities: Taylor's, and order-8 Runge-Kutta where there is no series."""

import threading
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ..numerics.bernstein import TINY
from ..symbolic.calls import BufferedFunction, MappedFunction
from ..symbolic.kernels import compile_function, compile_seconds, compiled_before, lengths
from ..symbolic.taylor_series import has_taylor_series, taylor_coefficients, variations

TAYLOR_ORDER = 28
# Truncation of a step against the state's size: a tenth of the rounding of the sum.
TOLERANCE = 1e-17
# A step whose series misses the equation by more, relative to the state, has gone past what the series knows.
DEFECT = 1e-10
# A step shorter than this, beside the time, is a singularity.
SHORTEST_STEP = 1e-15
# No step is longer than this.
LONGEST_STEP = 1e9
SECONDS_PER_INSTRUCTION = 2e-9
# Share of the time to compile after which a library compiled before is looked for.
LOOK = 0.02


@dataclass(frozen=True, eq=False)
class VectorField:
    """A vector field as an SX function (x, p) -> (x', watched quantities), and its two symbols."""

    field: ca.Function
    x: ca.SX
    p: ca.SX

    @property
    def size(self) -> int:
        """Number of states n."""
        return self.x.numel()

    @cached_property
    def has_series(self) -> bool:
        """Whether every operation in it has a Taylor series."""
        return has_taylor_series(self.field)

    @cached_property
    def series(self) -> ca.SX:
        """Taylor coefficients (n + m, ORDER + 1) of states and watched quantities."""
        return taylor_coefficients(self.field, self.x, self.p, TAYLOR_ORDER)

    @cached_property
    def step(self) -> ca.Function:
        """One step of given length, a function (x, h, p) -> x for equations that other solvers differentiate."""
        h = ca.SX.sym("h")
        end = self.series[: self.size, :] @ _powers(h) if self.has_series else runge_kutta(self, self.x, h)
        return ca.Function("step", [self.x, h, self.p], [end])


class TaylorStepper:
    """Taylor steps, several in one call: coefficients of the state and its sensitivities, each step as long as their
    last two terms allow, and all of them no longer than a given time.

    `one` makes a step: from the state (n,), its sensitivities, the time that is left and the longest step to try, and
    from the parameters with their seeds, to the first four after it, the coefficients, and the lengths taken and tried.
    A step that is tried in vain has no length, and one half as long, or less, is tried next.

    The sensitivities' series come from the variational equations dx' = f_x dx + f_p dp: first those of f_x and f_p,
    then with them one column after another; `varied` are the rows of dp that are not zero.
    """

    def __init__(self, graph: VectorField, columns: int, varied: tuple[int, ...] = ()):
        n, size = graph.size, graph.p.numel()
        self.n, self.columns, self.varied = n, columns, list(varied)
        self.rows = n + graph.field.numel_out(1)
        z, data = ca.MX.sym("z", n * (1 + columns) + 2), ca.MX.sym("p", size + len(varied) * columns)
        x, dx = z[:n], ca.reshape(z[n:-2], n, columns)
        p, dp = data[:size], ca.reshape(data[size:], len(varied), columns)
        if columns:
            series, column = variations(graph.field, varied, TAYLOR_ORDER)
            c, slopes = series(x, p)
            dc = ca.horzcat(*[column(slopes, dx[:, j], dp[:, j]) for j in range(columns)])
            again = (columns - 1) * column.n_instructions()
        else:
            c = ca.Function("series", [graph.x, graph.p], [ca.densify(graph.series.T)])(x, p)
            dc, again = ca.MX(TAYLOR_ORDER + 1, 0), 0
        powers, limits, made = self._measure(graph)(c[:, :n], dc, p, ca.vec(dp), z[-2:])
        ends = (powers.T @ ca.horzcat(c[:, :n], dc)).T
        self.one = ca.Function("taylor", [z, data], [ca.vertcat(ends, limits), c, dc, made])
        # Once interpreting has taken as long as compiling would, compile: that is never worse than twice the best. A
        # little earlier see whether it has been compiled before.
        self.patience, self.asked = LOOK * compile_seconds(self.one), False
        self.seconds = (sum(lengths(self.one)) + again) * SECONDS_PER_INSTRUCTION
        self.lock = threading.RLock()  # a thread may compile while others step
        self.compiled = False
        self.usual = 4  # steps of a motion, about
        self._calls: dict[int, BufferedFunction] = {}
        self._all: dict[int, MappedFunction] = {}

    def _measure(self, graph: VectorField) -> ca.Function:
        """(coefficients of the states (K + 1, n), of the sensitivities (K + 1, n * columns), p, dp, time left with the
        longest step to try) -> the powers (K + 1,) of the step's length, what is left then and the longest to try next,
        the lengths taken and tried."""
        c, dc = ca.SX.sym("c", TAYLOR_ORDER + 1, self.n), ca.SX.sym("dc", TAYLOR_ORDER + 1, self.n * self.columns)
        dp, limits = ca.SX.sym("dp", len(self.varied) * self.columns), ca.SX.sym("l", 2)
        left, longest = ca.vertsplit(limits)
        trusted = _trusted_length(c, 0)
        if self.varied:  # the series of f_p may end sooner than that of f
            trusted = ca.fmin(trusted, _trusted_length(dc, ca.norm_inf(dp)))
        h = ca.fmin(longest, trusted)
        h = ca.if_else(h >= left, left, ca.if_else(1.5 * h >= left, 0.5 * left, h))  # the last two share what is left
        size = ca.fmax(ca.norm_inf(ca.vec(c[:2, :])), TINY)  # a motion at rest at the origin has none
        solves = self._defect(graph, ca.diag(_powers(h)) @ c, h) <= DEFECT * size
        # One that is far too long for how fast the state changes is not halved again and again.
        shorter = 0.5 * ca.fmin(h, ca.sqrt(h * size / ca.norm_inf(c[1, :])))
        taken, after = ca.if_else(solves, h, 0), ca.if_else(solves, LONGEST_STEP, shorter)
        results = [_powers(taken), ca.vertcat(left - taken, after), ca.vertcat(taken, h)]
        return ca.Function("measure", [c, dc, graph.p, dp, limits], results)

    @staticmethod
    def _defect(graph: VectorField, terms: ca.SX, h: ca.SX) -> ca.SX:
        """How far the series is from solving the equation at the quarters of the step, times its length.

        Where a law is flat to the last digit, a saturated spring, its series says nothing of what comes after. A state
        whose rate is another state obeys by construction.
        """
        orders, defects = np.arange(TAYLOR_ORDER + 1), [ca.SX(0)]
        rows = [i for i, rate in enumerate(ca.vertsplit(graph.field(graph.x, graph.p)[0])) if not rate.is_symbolic()]
        for part in (0.25, 0.5, 0.75, 1.0):
            scale = part**orders
            for i, rate in enumerate(ca.vertsplit(graph.field(terms.T @ ca.DM(scale), graph.p)[0])):
                if i in rows:
                    defects.append(ca.fabs(terms[:, i].T @ ca.DM(orders * scale) / part - h * rate))
        return ca.mmax(ca.vertcat(*defects))

    def advance(self, x, p, dx, dp, count: int, longest: float, hint=None):
        """Those of `count` steps that can be trusted, all together no longer than `longest`.

        Returns steps (m,), coefficients (m, rows, K + 1), sensitivities (m, n, columns, K + 1).
        """
        with self.lock:
            self.spend(count)
            if count not in self._calls:
                self._calls[count] = BufferedFunction(self.one if count == 1 else self.one.mapaccum(count))
            call = self._calls[count]
        with call.lock:
            start, data = call.arguments
            start[: self.n], start[-2], start[-1] = x, longest, LONGEST_STEP
            data = data.reshape(count, -1)
            data[:, : len(p)] = p
            if self.columns:
                start[self.n : -2] = dx.T.ravel()
                data[:, len(p) :] = dp[self.varied].T.ravel()
            call.trigger()
            ends, c, dc, (steps, tried) = call.results
            while not steps.any() and tried[-1] > SHORTEST_STEP and np.isfinite(c).all():
                start[-1] = ends[-1, -1]
                call.trigger()
            c, dc = self.unfold(c.copy(order="K"), dc.copy(order="K"))
            taken = steps > 0
            steps = steps[taken]
        if not taken.any():
            return np.full(1, np.nan), c[:1], None
        return (steps, c, dc) if taken.all() else (steps, c[taken], dc[taken])

    def unfold(self, c, dc):
        """Coefficients (..., count, rows, K + 1) and sensitivities (..., count, n, columns, K + 1) from the results
        (..., K + 1, rows * count) and (..., K + 1, n * columns * count) of that many steps."""
        c = c.swapaxes(-1, -2).reshape(*c.shape[:-2], -1, self.rows, TAYLOR_ORDER + 1)
        dc = dc.swapaxes(-1, -2).reshape(*c.shape[:-2], self.columns, self.n, TAYLOR_ORDER + 1)
        return c, dc.swapaxes(-2, -3)

    def advance_all(self, x, p, count: int):
        """`count` steps of several motions without sensitivities, from states (m, n) with parameters (m, np).

        Returns steps (m, count), of no length where they are tried in vain, coefficients (m, count, rows, K + 1), and
        which steps can be trusted (m, count).
        """
        with self.lock:
            self.spend(count * len(x))
            if count not in self._all:
                self._all[count] = MappedFunction(self.one.mapaccum(count))
            call = self._all[count]
        limits = np.tile([np.inf, LONGEST_STEP], (len(x), 1))
        _, c, dc, made = call(np.concatenate([x, limits], axis=1), np.tile(p, count))
        steps, tried = made.swapaxes(0, 1)
        c, _ = self.unfold(c, dc)
        return steps, c, np.isfinite(c).all((2, 3)) & (tried > SHORTEST_STEP)

    def spend(self, count: int):
        """Count steps to be taken; once there have been enough, compile them."""
        with self.lock:
            self.patience -= count * self.seconds
            if self.patience < 0:
                self._compile()

    def _compile(self):
        if not self.asked:
            self.asked, faster = True, compiled_before(self.one)
            self.patience = np.inf if faster else (1 - LOOK) * compile_seconds(self.one)
        else:
            self.patience, faster = np.inf, compile_function(self.one)
        if faster is not None:
            self.one, self._calls, self._all, self.compiled = faster, {}, {}, True


def _trusted_length(c: ca.SX, size) -> ca.SX:
    """The step at which the last two terms of series (ORDER + 1, rows) vanish beside the first two and `size`."""
    scale, before, last = (ca.norm_inf(ca.vec(part)) for part in (c[:2, :], c[-2, :], c[-1, :]))
    bound = TOLERANCE * (scale + size)
    return ca.fmin((bound / before) ** (1 / (TAYLOR_ORDER - 1)), (bound / last) ** (1 / TAYLOR_ORDER))


def _powers(h: ca.SX) -> ca.SX:
    powers = [ca.SX(1), h]
    while len(powers) <= TAYLOR_ORDER:
        powers.append(h * powers[-1])
    return ca.vertcat(*powers)


def _cooper_verner() -> tuple[np.ndarray, np.ndarray]:
    """Stage matrix (11, 11) and weights (11,) of the explicit order-8 method.

    Cooper and Verner, "Some explicit Runge-Kutta methods of high order", SIAM J. Numer. Anal. 9 (1972).
    """
    s = np.sqrt(21.0)
    a = np.zeros((11, 11))
    a[1, :1] = 1 / 2
    a[2, :2] = 1 / 4, 1 / 4
    a[3, :3] = 1 / 7, -(7 + 3 * s) / 98, (21 + 5 * s) / 49
    a[4, :4] = (11 + s) / 84, 0, (18 + 4 * s) / 63, (21 - s) / 252
    a[5, :5] = (5 + s) / 48, 0, (9 + s) / 36, (-231 + 14 * s) / 360, (63 - 7 * s) / 80
    a[6, :6] = (10 - s) / 42, 0, (-432 + 92 * s) / 315, (633 - 145 * s) / 90, (-504 + 115 * s) / 70, (63 - 13 * s) / 35
    a[7, :7] = 1 / 14, 0, 0, 0, (14 - 3 * s) / 126, (13 - 3 * s) / 63, 1 / 9
    a[8, :8] = 1 / 32, 0, 0, 0, (91 - 21 * s) / 576, 11 / 72, -(385 + 75 * s) / 1152, (63 + 13 * s) / 128
    a[9, :9] = (
        1 / 14,
        0,
        0,
        0,
        1 / 9,
        -(733 + 147 * s) / 2205,
        (515 + 111 * s) / 504,
        -(51 + 11 * s) / 56,
        (132 + 28 * s) / 245,
    )
    a[10, 4:10] = (
        (-42 + 7 * s) / 18,
        (-18 + 28 * s) / 45,
        -(273 + 53 * s) / 72,
        (301 + 53 * s) / 72,
        (28 - 28 * s) / 45,
        (49 - 7 * s) / 18,
    )
    return a, np.array([9, 0, 0, 0, 0, 0, 0, 49, 64, 49, 9]) / 180


class RungeKuttaStepper:
    """One order-8 step, fitted by the polynomial through ten points of it; the length from step halving."""

    # Chebyshev points of (0, 1]: the start is kept exactly and divided out.
    NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 11) / 10)

    def __init__(self, graph: VectorField, columns: int, varied: tuple[int, ...] = ()):
        field, x, p = graph.field, graph.x, graph.p
        self.n, self.columns, self.varied = graph.size, columns, list(varied)
        h = ca.SX.sym("h")
        dx, dp = ca.SX.sym("dx", self.n, columns), ca.SX.sym("dp", len(varied), columns)
        end = runge_kutta(graph, x, h)
        moving = ca.vertcat(x, *[p[i] for i in varied])
        slope = ca.jtimes(end, moving, ca.vertcat(dx, dp)) if columns else ca.SX(self.n, 0)
        step = ca.Function("step", [x, h, p, dx, dp], [end, ca.densify(slope), ca.densify(field(end, p)[1])])
        self.step = BufferedFunction(step)
        self.nodes = BufferedFunction(step.map("nodes", "serial", len(self.NODES), [0, 2, 3, 4], []))
        self.usual = 1
        self.powers = np.vander(self.NODES, increasing=True)
        self.watched = BufferedFunction(ca.Function("watched", [x, p], [ca.densify(field(x, p)[1])]))

    def advance(self, x, p, dx, dp, count: int, longest: float, hint: float | None):
        """(steps (1,), coefficients (1, rows, K + 1), sensitivities (1, n, columns, K + 1) or None): one at a time."""
        dx = np.zeros((self.n, 0)) if dx is None else dx
        dp = dp[self.varied]
        h = self._length(x, p, dx, dp, 4 * hint if hint else 0.1)
        ends, slopes, watched = self.nodes(x, h * self.NODES, p, dx, dp)
        start = np.concatenate([x, self.watched(x, p)[0].ravel()])
        c = self._polynomial(start, np.vstack([ends, watched]), h)
        if not self.columns:
            return np.array([h]), c[None], None
        count = len(self.NODES)
        slopes = slopes.reshape(self.n, count, self.columns).transpose(0, 2, 1).reshape(-1, count)
        dc = self._polynomial(dx.ravel(), slopes, h).reshape(1, self.n, self.columns, -1)
        return np.array([h]), c[None], dc

    def _polynomial(self, start, values, h: float):
        """Coefficients (rows, K + 1) through `start` and the values (rows, nodes)."""
        rising = np.linalg.solve(self.powers, (values.T - start) / self.NODES[:, None])
        return np.column_stack([start, (rising / h ** np.arange(1, len(self.NODES) + 1)[:, None]).T])

    def _length(self, x, p, dx, dp, h: float) -> float:
        """Longest step up to `h` whose error, by halving twice its length, is below rounding."""
        while h > SHORTEST_STEP:
            whole = self.step(x, 2 * h, p, dx, dp)[0]
            half = self.step(x, h, p, dx, dp)[0]
            error = np.abs(whole - self.step(half, h, p, dx, dp)[0]).max()
            bound = 2e-14 * max(1e-3, np.abs(x).max())  # of the double step: that of a single one is 500 times less
            if error <= bound:
                return h
            h *= min(0.5, max(0.1, 0.9 * (bound / error) ** (1 / 9))) if np.isfinite(error) else 0.1
        return np.nan


def runge_kutta(graph: VectorField, x: ca.SX, h: ca.SX) -> ca.SX:
    """The state after one order-8 step of length `h` from `x`."""
    stages, weights = _cooper_verner()
    rates = []
    for row in stages:
        rates.append(
            graph.field(x + h * sum((a * k for a, k in zip(row, rates, strict=False) if a), ca.SX(0)), graph.p)[0]
        )
    return x + h * sum(b * k for b, k in zip(weights, rates, strict=True) if b)
