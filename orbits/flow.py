"""The flow map of a phase with exact derivatives, as a piecewise polynomial that is accurate between its nodes.

Three ways, the first that the phase allows:

- closed form: the phase says what its flow is, nothing is integrated;
- Taylor: jets of the field's graph, order 28, steps from the last two coefficients (Jorba and Zou 2005);
- Runge-Kutta: Cooper and Verner's order 8 with step halving, where the graph has an operation without a Taylor series.

Steps are chosen from the error, never by the caller, and end on the breakpoints of a piecewise field.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from .calls import Call, compile_function, compile_seconds
from .errors import FlowError, OutOfRange
from .jets import covers, jets
from .model import Affine, Phase
from .polynomial import evaluate, piecewise_roots, roots, shifted

ORDER = 28
# Truncation of a step against the state's size: a tenth of the rounding of the sum.
TOLERANCE = 1e-17
# A step whose series misses the equation by more, relative to the state, has gone past what the series knows.
DEFECT = 1e-10
# A step shorter than this, beside the time, is a singularity.
SHORTEST = 1e-15
MAX_STEPS = 200_000
# Beyond this a motion has run away.
RUNAWAY = 1e20
# Steps taken in one call of the interpreter's.
LOOK_AHEAD = 8
SECONDS_PER_INSTRUCTION = 5e-9


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion as Taylor polynomials: on times[i] <= t <= times[i + 1] the rows are sums of
    c[i, :, k] (t - times[i])**k.

    times : (N + 1,)
    coefficients : (N, n + m, K + 1), the n states, then the m watched quantities
    names : of the rows
    """

    times: np.ndarray
    coefficients: np.ndarray
    names: tuple[str, ...]

    def __call__(self, t):
        """Rows (..., n + m) at times `t` (...), which lie within the trajectory's."""
        t = np.asarray(t, dtype=float)
        piece = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        return evaluate(self.coefficients[piece], (t - self.times[piece])[..., None])

    @property
    def steps(self) -> np.ndarray:
        """Lengths (N,) of the polynomials' intervals."""
        return np.diff(self.times)

    @cached_property
    def end(self) -> np.ndarray:
        """Rows (n + m,) at the last time."""
        return evaluate(self.coefficients[-1], self.times[-1] - self.times[-2])

    def split(self, t: float) -> tuple["Trajectory", "Trajectory"]:
        """The motion up to time `t`, and the rest told backwards from its end."""
        i = int(np.clip(np.searchsorted(self.times, t) - 1, 0, len(self.times) - 2))
        h = t - self.times[i]
        first = Trajectory(np.append(self.times[: i + 1], t), self.coefficients[: i + 1], self.names)
        rest = np.concatenate([shifted(self.coefficients[i : i + 1], np.array([h])), self.coefficients[i + 1 :]])
        times = np.append(t, self.times[i + 1 :])
        ends = shifted(rest, np.diff(times)) * (-1.0) ** np.arange(rest.shape[2])
        return first, Trajectory(times[-1] - times[::-1], ends[::-1], self.names)

    def row(self, name: str) -> np.ndarray:
        """Coefficients (N, K + 1) of one row."""
        return self.coefficients[:, self.names.index(name)]


@lru_cache(maxsize=64)
def flow(phase: Phase, parameters: tuple[str, ...]) -> "Flow":
    """The flow of a phase, kept for the next call with the same phase."""
    return Flow(phase, parameters)


class Flow:
    """Flow map of one phase; `parameters` names the entries of the parameter vectors (np,) that it takes."""

    def __init__(self, phase: Phase, parameters: tuple[str, ...]):
        self.phase, self.parameters = phase, tuple(parameters)
        self.size = len(phase.states)
        self.names = (*phase.states, *phase.watch)
        self._schemes: dict[int, _Taylor | _RungeKutta] = {}

    @cached_property
    def graph(self) -> tuple[ca.Function, ca.SX, ca.SX]:
        """The field as an SX function (x, (p, q)) -> (x', watched), and its two symbols."""
        count = self.phase.pieces.size if self.phase.pieces else 0
        x, p = ca.SX.sym("x", self.size), ca.SX.sym("p", len(self.parameters) + count)
        arguments = self.symbols(x, p)
        rates = ca.vertcat(*self.phase.field(*arguments))
        watched = ca.vertcat(*[quantity(*arguments) for quantity in self.phase.watch.values()])
        return ca.Function("field", [x, p], [rates, watched]), x, p

    @cached_property
    def series(self) -> ca.SX:
        """Taylor coefficients (n + m, ORDER + 1) of states and watched quantities, in the symbols of `graph`."""
        return jets(*self.graph, ORDER)

    def symbols(self, x: ca.SX, p: ca.SX) -> tuple[list, dict, list]:
        """The arguments (x, p, q) of a phase's expressions from vectors of states and of parameters with piece data."""
        entries = ca.vertsplit(p)
        named = dict(zip(self.parameters, entries, strict=False))
        return ca.vertsplit(x), named, entries[len(self.parameters) :]

    @cached_property
    def method(self) -> str:
        """'closed form', 'Taylor' or 'Runge-Kutta'."""
        if self.phase.closed_form:
            return "closed form"
        return "Taylor" if covers(self.graph[0]) else "Runge-Kutta"

    def scheme(self, columns: int):
        """The stepping scheme that carries so many sensitivities along, built on first use."""
        if columns not in self._schemes:
            self._schemes[columns] = (_Taylor if self.method == "Taylor" else _RungeKutta)(self, columns)
        return self._schemes[columns]

    def run(self, start, p, duration=np.inf, seeds=None, parameter_seeds=None, stop: Callable | None = None):
        """Travel from `start` (n,) for `duration`, or until `stop` says so.

        p : parameter vector (np,)
        seeds : derivatives (n, columns) of the start with respect to whatever the caller varies
        parameter_seeds : derivatives (np, columns) of the parameters with respect to the same
        stop : (coefficients (m, rows, K + 1), steps (m,)) -> (step, time in it) to stop at, or None

        Returns (Trajectory, derivatives (n, columns) of the end at fixed duration, or None without seeds). Raises
        `FlowError` when the motion blows up, leaves the range of a piecewise field or is not a number.
        """
        x = np.array(start, dtype=float)
        p = np.asarray(p, dtype=float)
        if not (np.isfinite(x).all() and np.isfinite(p).all() and duration > 0):
            raise FlowError(f"the {self.phase.name} cannot start from {x} for a time {duration}")
        if self.phase.closed_form:
            return self._closed_form(x, p, duration, seeds, stop)
        columns = 0 if seeds is None else seeds.shape[1]
        scheme = self.scheme(columns)
        track = _Track(self, p, x, columns, parameter_seeds)
        times, pieces, h, variations = [0.0], [], None, seeds
        while times[-1] < duration:
            left = duration - times[-1]
            ahead = 1 if self.phase.pieces else LOOK_AHEAD if stop else _chunk(left, h)
            steps, c, dc = scheme.advance(x, track.data, variations, track.seeds, ahead, left, h)
            steps, c = self._sound(steps, c, times[-1], len(pieces))
            count, cut, crossed, halted = self._cut(c, steps, left, track, stop)
            for i in range(count):
                t = times[-1]
                h = cut if i == count - 1 else steps[i]
                pieces.append(c[i])
                times.append(t + h)
            power = h ** np.arange(1, c.shape[2])
            x = c[i, : self.size, 0] + c[i, : self.size, 1:] @ power
            if columns:
                variations = dc[i, ..., 0] + dc[i, ..., 1:] @ power
            h = steps[i]
            if np.abs(x).max() > RUNAWAY:
                raise FlowError(f"the {self.phase.name} runs away at time {times[-1]:.6g}, at {self._say(x)}")
            if halted:
                break
            if duration - times[-1] <= 1e-15 * duration:
                times[-1] = duration
            if crossed:
                track.enter(crossed, x)
        return Trajectory(np.array(times), np.array(pieces), self.names), variations

    def _sound(self, steps, c, t: float, taken: int):
        """The leading steps that are numbers and not vanishing; raises `FlowError` when there is none."""
        good = (steps > SHORTEST * max(t, 1.0)) & np.isfinite(c).all((1, 2))
        if not good[0] or taken > MAX_STEPS:
            reason = "takes too many steps" if good[0] else "breaks down"
            raise FlowError(f"the {self.phase.name} {reason} at time {t:.6g}, at {self._say(c[0, :, 0])}")
        count = len(steps) if good.all() else int(np.argmin(good))
        return steps[:count], c[:count]

    @staticmethod
    def _cut(c, steps, left: float, track: "_Track", stop):
        """How many steps to take, the length of the last, the end of a piece crossed there, and whether to stop."""
        count, cut, crossed, halted = len(steps), steps[-1], 0, False
        reached = np.cumsum(steps)
        if reached[-1] >= left:
            count = int(np.argmax(reached >= left)) + 1
            cut = left - (reached[count - 2] if count > 1 else 0.0)
        if track.pieces:
            cut, crossed = track.cut(c[0], cut)
        if stop:
            lengths = np.append(steps[: count - 1], cut)
            if halt := stop(c[:count], lengths):
                count, cut, crossed, halted = halt[0] + 1, halt[1], 0, True
        return count, cut, crossed, halted

    def _closed_form(self, start, p, duration, seeds, stop):
        """Polynomials of the exact flow, each from the exact state at its start: no error accumulates."""
        form = self.phase.closed_form(dict(zip(self.parameters, p, strict=True)))
        step = 1.0 / np.sqrt(form.square)  # where the series to ORDER has long converged
        times, pieces = [0.0], []
        while times[-1] < duration:
            c = form.series(form.state(start, times[-1]), ORDER)
            h = min(step, duration - times[-1])
            halt = stop(c[None], np.array([h])) if stop else None
            pieces.append(c)
            times.append(times[-1] + (halt[1] if halt else h))
            if halt:
                break
            if len(pieces) > MAX_STEPS:
                raise FlowError(f"the {self.phase.name} takes too many steps, at {self._say(c[0])}")
        variations = None if seeds is None else form.transition(times[-1]) @ seeds
        names = (*self.phase.states, *form.watch)
        return Trajectory(np.array(times), np.array(pieces), names), variations

    def _say(self, x) -> str:
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.phase.states, x, strict=False))

    def rates(self, x, p) -> np.ndarray:
        """The field at one state (n,), with parameters and piece data (np + nq,)."""
        return self._rates(x, p)[0].ravel()

    @cached_property
    def _rates(self) -> Call:
        field, x, p = self.graph
        return Call(ca.Function("rates", [x, p], [ca.densify(field(x, p)[0])]))

    @cached_property
    def step(self) -> ca.Function:
        """One step of given length, a function (x, h, (p, q)) -> x for equations that other solvers differentiate."""
        field, x, p = self.graph
        h = ca.SX.sym("h")
        taylor = covers(field)
        end = self.series[: self.size, :] @ _powers(h) if taylor else runge_kutta(field, x, p, h)
        return ca.Function("step", [x, h, p], [end])

    def piece_data(self, x, p) -> tuple[np.ndarray, np.ndarray]:
        """Data (nq,) of the piece at state `x` and its derivatives (nq, np)."""
        if self.phase.pieces is None:
            return np.zeros(0), np.zeros((0, len(p)))
        breaks, table, slopes = self.piece_table(p)
        index = self.piece(x, breaks)
        return table[index], slopes[index]

    def mesh_data(self, path: Trajectory, p) -> np.ndarray:
        """Parameters with the data of the piece that each step of a motion lies in, (np + nq, N)."""
        columns = np.tile(np.asarray(p, dtype=float)[:, None], len(path.steps))
        if self.phase.pieces is None:
            return columns
        breaks, table, _ = self.piece_table(p)
        return np.vstack([columns, table[self.mesh_pieces(path, breaks)].T])

    def mesh_pieces(self, path: Trajectory, breaks) -> np.ndarray:
        """Index (N,) of the piece that each step of a motion lies in."""
        middles = path(0.5 * (path.times[1:] + path.times[:-1]))[:, : self.size]
        return np.array([self.piece(x, breaks) for x in middles])

    def piece(self, x, breaks) -> int:
        """Index of the piece that holds state `x`."""
        place = float(np.array(self.phase.pieces.coordinate) @ x)
        return int(np.clip(np.searchsorted(breaks, place, "right") - 1, 0, len(breaks) - 2))

    def piece_table(self, p) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Breaks (m + 1,), data (m, nq) and its derivatives (m, nq, np) at parameters (np,)."""
        breaks, data, slopes = self._piece_function(p)
        return breaks.ravel(), data, slopes.reshape(data.shape[1], data.shape[0], len(p)).swapaxes(0, 1)

    @cached_property
    def _piece_function(self) -> Call:
        p = ca.SX.sym("p", len(self.parameters))
        breaks, data = self.phase.pieces.table(dict(zip(self.parameters, ca.vertsplit(p), strict=True)))
        data = ca.vertcat(*[ca.horzcat(*row) for row in data]) if self.phase.pieces.size else ca.SX(len(data), 0)
        results = [ca.vertcat(*breaks), data, ca.jacobian(ca.vec(data), p)]
        return Call(ca.Function("pieces", [p], [ca.densify(result) for result in results]))


def first_zero(quantity: Affine, skip_start: int = 0) -> Callable:
    """A `stop` at the first sign change of an affine function of the state.

    `skip_start` is the order of a zero known to stand at the very start; it is divided out exactly there.
    """
    skip = skip_start

    def stop(coefficients, steps):
        nonlocal skip
        series = quantity.series(coefficients[:, : len(quantity.weights)])
        found = piecewise_roots(series, steps, start=skip)
        skip = 0
        return found[0] if found else None

    return stop


def _chunk(left: float, h: float | None) -> int:
    """How many steps to take at once: a power of two, about as many as are left."""
    if h is None:
        return 4
    return int(2 ** np.ceil(np.log2(np.clip(left / h, 1, LOOK_AHEAD))))


class _Track:
    """The piece of the field that the motion is on: its data, and where it ends."""

    def __init__(self, flow: "Flow", p, x, columns: int, parameter_seeds):
        self.flow, self.pieces = flow, flow.phase.pieces
        self.data = p
        self.seeds = np.zeros((len(p), columns)) if parameter_seeds is None else parameter_seeds
        if self.pieces is None:
            return
        self.p, self.parameter_seeds = p, self.seeds
        self.breaks, self.table, self.slopes = flow.piece_table(p)
        self.weights = np.array(self.pieces.coordinate)
        place = float(self.weights @ x)
        if not self.breaks[0] <= place <= self.breaks[-1]:
            raise OutOfRange(self._outside(place))
        index = flow.piece(x, self.breaks)
        self._set(index)
        self.level = place if place in self.breaks else None
        if place == self.breaks[index] and index > 0 and self.weights @ flow.rates(x, self.data) < 0:
            self._set(index - 1)

    def _set(self, index: int):
        self.index = index
        self.data = np.concatenate([self.p, self.table[index]])
        self.seeds = np.vstack([self.parameter_seeds, self.slopes[index] @ self.parameter_seeds])

    def cut(self, c, h: float) -> tuple[float, int]:
        """The step shortened to the piece's end, and which end that is: -1 lower, +1 upper, 0 neither."""
        if self.pieces is None:
            return h, 0
        along = self.weights @ c[: self.flow.size]
        crossed = 0
        for side, level in ((-1, self.breaks[self.index]), (1, self.breaks[self.index + 1])):
            if not np.isfinite(level):
                continue
            distance = along.copy()
            distance[0] -= level
            found = roots(distance[1:] if level == self.level else distance, h)
            if found and found[0] < h:
                h, crossed = found[0], side
        self.level = None
        return h, crossed

    def enter(self, side: int, x):
        """Go on in the next piece, above (+1) or below (-1)."""
        index = self.index + side
        if not 0 <= index < len(self.table):
            raise OutOfRange(self._outside(float(self.weights @ x)))
        self.level = self.breaks[max(index, self.index)]
        self._set(index)

    def _outside(self, place: float) -> str:
        low, high = self.breaks[0], self.breaks[-1]
        return f"the {self.pieces.label} reaches {place:.6g}, outside the law's range [{low:.6g}, {high:.6g}]"


class _Taylor:
    """Taylor steps, several in one call: coefficients of the state and its sensitivities, each step as long as its last
    two terms allow."""

    def __init__(self, flow: "Flow", columns: int):
        field, x, p = flow.graph
        self.n, self.columns = flow.size, columns
        c = flow.series
        self.rows = c.shape[0]
        state, longest = c[: self.n, :], ca.SX.sym("h")
        scale, before, last = (ca.norm_inf(ca.vec(part)) for part in (state[:, :2], state[:, -2], state[:, -1]))
        bound = TOLERANCE * scale
        h = ca.fmin(longest, ca.fmin((bound / before) ** (1 / (ORDER - 1)), (bound / last) ** (1 / ORDER)))
        power = _powers(h)
        dx, dp = ca.SX.sym("dx", self.n, columns), ca.SX.sym("dp", p.numel(), columns)
        dc = ca.SX(self.n * (ORDER + 1), 0)
        if columns:
            dc = ca.jtimes(ca.vec(state.T), ca.vertcat(x, p), ca.vertcat(dx, dp))
        terms = state @ ca.diag(power)
        end = ca.sum2(terms)
        dend = ca.reshape(power.T @ ca.reshape(dc, ORDER + 1, self.n * columns), self.n, columns)
        results = [ca.vertcat(end, ca.vec(dend)), c.T, dc, ca.vertcat(h, self._defect(field, terms, p, h) / scale)]
        self.one = ca.Function(
            "taylor", [ca.vertcat(x, ca.vec(dx)), p, ca.vec(dp), longest], [ca.densify(result) for result in results]
        )
        # Once interpreting has taken as long as compiling would, compile: that is never worse than twice the best.
        self.patience = compile_seconds(self.one)
        self.seconds = self.one.n_instructions() * SECONDS_PER_INSTRUCTION
        self._calls: dict[int, Call] = {}

    @staticmethod
    def _defect(field: ca.Function, terms: ca.SX, p: ca.SX, h: ca.SX) -> ca.SX:
        """How far the series is from solving the equation at the middle and the end of the step, times its length.

        Where a law is flat to the last digit, a saturated spring, its series says nothing of what comes after.
        """
        orders, defects = np.arange(ORDER + 1), []
        for part in (0.5, 1.0):
            scale = part**orders
            rate = terms @ ca.DM(orders * scale) / part
            defects.append(ca.norm_inf(rate - h * field(terms @ ca.DM(scale), p)[0]))
        return ca.mmax(ca.vertcat(*defects))

    def advance(self, x, p, dx, dp, count: int, longest: float, hint=None):
        """The trusted ones of `count` steps: steps (m,), coefficients (m, rows, K + 1), sensitivities
        (m, n, columns, K + 1)."""
        self.patience -= count * self.seconds
        if self.patience < 0:
            self._compile()
        if count not in self._calls:
            self._calls[count] = Call(self.one if count == 1 else self.one.mapaccum(count))
        call = self._calls[count]
        start, data, slopes, lengths = call.arguments
        start[: self.n] = x
        data.reshape(count, -1)[:] = p
        if self.columns:
            start[self.n :] = dx.T.ravel()
            slopes.reshape(count, -1)[:] = dp.T.ravel()
        lengths[:] = min(longest, 1e9)
        call.trigger()
        _, c, dc, (steps, defects) = call.results
        c = c.reshape(ORDER + 1, self.rows, count, order="F").T.copy()
        trusted = count if (defects <= DEFECT).all() else int(np.argmin(defects <= DEFECT))
        if trusted == 0:  # halve the first step until its series solves the equation, unless it has no series
            if not (steps[0] > SHORTEST and np.isfinite(c[0]).all()):
                return np.full(1, np.nan), c[:1], None
            return self.advance(x, p, dx, dp, 1, 0.5 * steps[0])
        dc = dc.reshape(ORDER + 1, self.n, self.columns, count, order="F").transpose(3, 1, 2, 0).copy()
        return steps[:trusted].copy(), c[:trusted], dc[:trusted]

    def _compile(self):
        self.patience = np.inf
        faster = compile_function(self.one)
        if faster is not None:
            self.one, self._calls = faster, {}


def _powers(h: ca.SX) -> ca.SX:
    powers = [ca.SX(1), h]
    while len(powers) <= ORDER:
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


class _RungeKutta:
    """One order-8 step, fitted by the polynomial through nine points of it; the length from step halving."""

    # Chebyshev points of (0, 1]: the start is kept exactly and divided out.
    NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 11) / 10)

    def __init__(self, flow: "Flow", columns: int):
        field, x, p = flow.graph
        self.n, self.columns = flow.size, columns
        h = ca.SX.sym("h")
        dx, dp = ca.SX.sym("dx", self.n, columns), ca.SX.sym("dp", p.numel(), columns)
        end = runge_kutta(field, x, p, h)
        slope = ca.jtimes(end, ca.vertcat(x, p), ca.vertcat(dx, dp)) if columns else ca.SX(self.n, 0)
        self.step = ca.Function("step", [x, h, p, dx, dp], [end, ca.densify(slope), field(end, p)[1]])
        self.powers = np.vander(self.NODES, increasing=True)
        self.watched = ca.Function("watched", [x, p], [field(x, p)[1]])

    def advance(self, x, p, dx, dp, count: int, longest: float, hint: float | None):
        """(steps (1,), coefficients (1, rows, K + 1), sensitivities (1, n, columns, K + 1) or None): one at a time."""
        dx = np.zeros((self.n, 0)) if dx is None else dx
        dp = np.zeros((len(p), 0)) if dp is None else dp
        h = self._length(x, p, dx, dp, 4 * hint if hint else 0.1)
        ends, slopes, watched = (np.array(out) for out in self.step(x, (h * self.NODES)[None], p, dx, dp))
        start = np.concatenate([x, np.array(self.watched(x, p)).ravel()])
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
        while h > SHORTEST:
            whole = self.step(x, 2 * h, p, dx, dp)[0]
            half = self.step(x, h, p, dx, dp)[0]
            error = float(ca.norm_inf(whole - self.step(half, h, p, dx, dp)[0]))
            bound = 2e-14 * max(1e-3, np.abs(x).max())  # of the double step: that of a single one is 500 times less
            if error <= bound:
                return h
            h *= min(0.5, max(0.1, 0.9 * (bound / error) ** (1 / 9))) if np.isfinite(error) else 0.1
        return np.nan


def runge_kutta(field: ca.Function, x: ca.SX, p: ca.SX, h: ca.SX) -> ca.SX:
    """The state after one order-8 step of length `h`."""
    stages, weights = _cooper_verner()
    rates = []
    for row in stages:
        rates.append(field(x + h * sum((a * k for a, k in zip(row, rates, strict=False) if a), ca.SX(0)), p)[0])
    return x + h * sum(b * k for b, k in zip(weights, rates, strict=True) if b)
