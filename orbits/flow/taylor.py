"""Motions in Taylor steps with their sensitivities, one of them or many, in kernels that iterate a step."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..model import Affine
from ..numerics import HIGHEST_ORDER, Array, bernstein_coefficients, first_root, without_first_zero
from ..running import exclusive_property
from ..symbolic import (
    BufferedFunction,
    ElementwiseFunction,
    InLoops,
    Kernel,
    VariationsInLoops,
    cached,
    with_common_parts,
)
from .phase_field import PhaseField
from .taylor_step import NO_PIECES, PieceRows, Places, after_step, length_function, step_expansion, step_function_of
from .vector_field import FLOW_CONTROL, TAYLOR, VectorField, rows_used, symbolic_powers


class Motions(NamedTuple):
    """Motions of stated durations, in N Taylor steps altogether.

    ends, variations : states (m, n) at their ends, and their derivatives (m, n, columns)
    steps, coefficients : (N,) and (N, rows, K + 1) of one motion after the other
    begins : derivatives (N, n, columns) of the states at the beginnings of the steps
    on : (N,), the pieces of the steps
    counts : (m,), how many steps each takes
    left : (m,), the time that is left, 0 where a motion has not broken down
    pieces : (m,), the pieces at their ends
    """

    ends: Array
    variations: Array
    steps: Array
    coefficients: Array
    begins: Array
    on: Array
    counts: Array
    left: Array
    pieces: Array


class OnPieces(NamedTuple):
    """The pieces that m motions are on: the tables of `PieceRows`, (m, size) or (1, size), the numbers (m,) of the
    pieces, which are 0 and k + 1 outside, and the breakpoints (m, k + 1) or (1, k + 1)."""

    tables: Array
    numbers: Array
    breaks: Array

    def of(self, which: Array) -> Array:
        """The tables of some motions."""
        return self.tables[which] if len(self.tables) > 1 else self.tables


class Watched(NamedTuple):
    """Steps (N,) of motions that are watched, with the lengths, whether they are the first, and the times and changes
    of `Places` before them, and the signs there."""

    coefficients: Array  # (N, rows (K + 1))
    begins: Array  # (N, 4)
    signs: Array  # (N, q)


class Watch:
    """What the motions of a flow are watched for: the zeros of affine functions of the rows.

    functions : those whose zeros are events
    opening : the first functions of this number may have zeros at the start of a motion
    turns : another function and a number: a motion on which that function has changed its sign so often has no event
    rising : only the changes from minus to plus are events
    """

    def __init__(
        self, flow: PhaseField, functions: Sequence[Affine], opening: int = 1, turns: tuple[Affine, int] | None = None,
        rising: bool = False,
    ):  # fmt: skip
        self.functions, self.turns, self.rising = functions, turns, rising
        own = [*functions, turns[0]] if turns else functions
        self.size, self.most_turns = len(own), turns[1] if turns else 0
        self.weights, self.offsets = np.zeros((len(own), len(flow.names))), np.zeros(len(own))
        for i, each in enumerate(own):
            self.weights[i, : len(each.weights)], self.offsets[i] = each.weights, each.offset
        self.kind = tuple(rows_used(row[:, None]) for row in self.weights), opening, self.most_turns
        self._tests = np.concatenate([self.weights.ravel(), self.offsets])

    def event(self, steps: Watched, data: Array) -> tuple[Array, Array, Array]:
        """The first events in steps (k,) of motions with these data: times since the start, infinite where there is
        none, numbers of the functions, and whether neither is known, in columns (k, 3); the rows (k, rows) there; and
        the signs (k, q) of the functions at the ends of the steps."""
        used, opening, _ = self.kind
        rows, size = self.weights.shape[1], len(self.functions)
        search = event_in_step(rows, used[:size], opening, self.size)
        found, there, signs = search(*steps, data[:, -2 - opening - len(self._tests) : -2])
        return found, there, signs

    def data(self, p: Array, limits: Array, orders: Array, all_steps: bool = False) -> Array:
        """The data of motions with parameters (m, np) or (1, np), to time limits (m,), at whose starts the functions
        that open have zeros of these orders (m, opening)."""
        count, end = p.shape[1], p.shape[1] + len(self._tests)
        found = np.empty((len(limits), end + self.kind[1] + 2))
        found[:, :count], found[:, count:end], found[:, end:-2] = p, self._tests, orders
        found[:, -2], found[:, -1] = limits, all_steps
        return found


class TaylorStepper:
    """Takes Taylor steps with the sensitivities of the states.

    `step_function` makes one step: (z, data, row) -> (z after it, coefficients (K + 1, n + m) of the n states and m
    watched quantities, lengths taken and tried (2,)). Its argument z is as `places` states, `data` are the parameters
    and their seeds, and `row` is that of the piece, as in `PieceRows`. A rejected step has length 0, and the next one
    tries half its length or less.

    The sensitivities solve the variational equations dx' = f_x dx + f_p dp. The series of f_x and f_p are found once,
    and with them one column after another; `varied` are the rows of dp that are not zero, among them all or none of the
    data of a piece. Where the field jumps at the end of a piece, a change of the time at which it is reached changes
    the state by the jump (saltation).
    """

    def __init__(self, graph: VectorField, columns: int, varied: tuple[int, ...] = ()):
        self.graph, self.n, self.columns = graph, graph.size, columns
        count_p = graph.p.numel() - graph.data  # the number of parameters
        self.varied, self.varied_parameters = varied, [row for row in varied if row < count_p]
        moves = columns * (len(self.varied_parameters) < len(varied))
        self.piece_rows = PieceRows(graph.data, moves) if graph.coordinate else NO_PIECES
        self.rows, left = graph.size + graph.field.numel_out(1), graph.size * (1 + columns)
        numbers = range(left, left + 7)
        self.places = Places(slice(self.n), slice(self.n, left), slice(numbers.stop, None), *numbers)
        self._watching: dict[tuple, Kernel] = {}  # of `follow`, by the kinds of `Watch`

    @exclusive_property
    def kernel(self) -> Kernel:
        """Takes the steps of motions; a motion that is only watched needs none."""
        return self.kernel_of(self._in_loops() or self.motion_function)

    @property
    def compiled(self) -> bool:
        """Whether motions take their steps in machine code."""
        return "kernel" in vars(self) and self.kernel.compiled

    def _in_loops(self) -> InLoops | None:
        """The `motion_function` with loops; None where its graph is not long, or has operations without a loop."""
        if self.columns < 2 or not self.graph.in_loops:
            return None
        loops = VariationsInLoops(self.graph.field, self.varied, self.columns, TAYLOR.order)
        if not loops.able:
            return None
        graph, at, orders, count_p = self.graph, self.places, TAYLOR.order + 1, self.graph.p.numel()
        z, data = ca.MX.sym("z", at.time), ca.MX.sym("p", count_p + len(self.varied) * self.columns)
        c, ends_of_columns = ca.MX.sym("c", orders, self.rows), ca.MX.sym("dc", 4, self.n * self.columns)
        x, p, dx, dp = z[at.state], data[:count_p], z[at.sensitivities], data[count_p:]
        choice = length_function(graph, ca.SX(self.n, orders), ca.SX.eye(self.n), self.columns, len(self.varied), 4)
        numbers = x, p, dp, z[at.left], z[at.longest], NO_PIECES.split(z)[0]
        chosen = choice(c[:, : self.n], c[:, : self.n], ends_of_columns, *numbers)
        results = chosen[0], chosen[2], chosen[3], chosen[4], chosen[4][1]
        choose = ca.Function("choose", [z, data, c, ends_of_columns], results)
        known = [ca.MX.sym("known", *result.shape) for result in results]
        moved = ca.MX.sym("moved", self.n * self.columns)
        ends, left, longest, made, _ = known
        after = after_step(at, z, ca.vertcat(ends, moved), left, longest, made, ca.MX(0))
        step = ca.Function("taylor", [z, data, c, *known, moved], [after, c, made])
        before = ca.Function("before", [z, data], [x, p, dx, dp])
        parts = (with_common_parts(part.expand()) for part in (before, choose, _motion(step, at)))
        first, second, third = parts
        return InLoops(first, loops, second, third, lambda: self.motion_function)

    @cached_property
    def step_function(self) -> ca.Function:
        """One step, as above."""
        return step_function_of(self.graph, self.places, self.columns, self.varied, self.piece_rows)

    def kernel_of(self, function: ca.Function | InLoops) -> Kernel:
        """The kernel that iterates a step, which takes the row of its piece."""
        return Kernel(function, self.places.piece if self.graph.coordinate else None)

    def sensitivities_after(self, x: Array, p: Array, dx: Array, dp: Array, h: float) -> Array:
        """The sensitivities (n, columns) at the end of a step of length h, not longer than the accepted one."""
        return self._sensitivities(x, p, dx, dp, h)[0]

    @cached_property
    def _sensitivities(self) -> BufferedFunction:
        expansion = step_expansion(self.graph, self.columns, self.varied)
        arguments, h, length = expansion.mx_in(), ca.MX.sym("h"), ca.SX.sym("h")
        powers = ca.Function("powers", [length], [symbolic_powers(length)])(h)
        after = ca.reshape(expansion(*arguments)[1].T @ powers, self.n, self.columns)
        return BufferedFunction(ca.Function("sensitivities", [*arguments, h], [after]))

    def advance_all(
        self, x: Array, p: Array, durations: Array, dx: Array, dp: Array, count: int = FLOW_CONTROL.max_steps,
        on: OnPieces | None = None,
    ) -> Motions:  # fmt: skip
        """Motions from states (m, n) with parameters (m, np) or (1, np), each for its duration (m,) or at most `count`
        steps; dx (n, columns) and dp (np, columns) are the seeds of all, or dx (m, n, columns) and dp (m, np, columns)
        those of each. They begin `on` pieces of a piecewise field."""
        size, n, columns, count_p, at = len(x), self.n, self.columns, p.shape[1], self.places
        dx, dp = dx.swapaxes(-1, -2), dp[..., self.varied_parameters, :].swapaxes(-1, -2)
        z = np.empty((size, self.kernel.sizes_in[0]))
        data = np.empty((max(len(p), len(dp) if dp.ndim > 2 else 1), self.kernel.sizes_in[1]))
        z[:, at.state], z[:, at.sensitivities] = x, dx.reshape(*dx.shape[:-2], -1)
        z[:, at.left], z[:, at.longest], z[:, at.piece] = durations, TAYLOR.longest_step, on.numbers if on else 0.0
        data[:, :count_p], data[:, count_p:] = p, dp.reshape(*dp.shape[:-2], -1)
        z, (c, begins, made), counts, _ = self.kernel(z, data, *(on[:1] if on else ()), most=count)
        moving = z[:, at.sensitivities], begins
        variations, begins = (each.reshape(len(each), columns, n).swapaxes(1, 2) for each in moving)
        c = c.reshape(-1, self.rows, TAYLOR.order + 1)
        ends, left, numbers = z[:, at.state], z[:, at.left], z[:, at.piece]
        return Motions(ends, variations, made[:, 0], c, begins, made[:, 1], counts, left, numbers)

    def follow(
        self, z: Array, data: Array, watch: Watch, tables: Array | None, most: int = 1
    ) -> tuple[Array, Watched, Array, Array]:
        """Motions until an affine function may change its sign, or until their times reach their limits.

        z, data : of each motion, as `watched_state` and `Watch.data` make them
        tables : of `OnPieces`, None for a smooth field
        most : number of steps, where all are recorded; else the steps alone are recorded in which a function may change
            its sign, by Bernstein exclusion, and the first ends the motion

        Returns z when each has ended; the steps that are recorded; the number (m,) of these of each motion; and whether
        it would go on (m,), after the last record or after the most steps.
        """
        if (kind := watch.kind) not in self._watching:
            self._watching[kind] = self.kernel_of(_watch_function(self, *kind))
        own = () if tables is None else (tables,)
        z, (c, begins, signs), counts, going = self._watching[kind](z, data, *own, most=most)
        return z, Watched(c, begins, signs), counts, going

    def watched_state(self, x: Array, count: int, numbers: Array | float) -> Array:
        """The argument z of `follow` with `count` functions: states (m, n) and the numbers (m,) of pieces; the time
        left is not limited."""
        z, at = np.zeros((len(x), self.places.signs.start + count)), self.places
        z[:, at.state], z[:, at.left], z[:, at.longest], z[:, at.piece] = x, np.inf, TAYLOR.longest_step, numbers
        z[:, at.fresh] = 1.0
        return z

    @cached_property
    def motion_function(self) -> ca.Function:
        """A step of a motion as a `Kernel` iterates it, (z, data, row of the piece) -> (z after it, coefficients, the
        sensitivities before it, the length and the piece, whether it counts, whether to go on); it goes on until no
        time is left, the state runs away or no step is accepted."""
        return _motion(self.step_function, self.places)


def _motion(step_function: ca.Function, at: Places) -> ca.Function:
    """The `motion_function` of a step; its further arguments are those of the step."""
    arguments = z, *_ = step_function.mx_in()
    after, c, made = step_function(*arguments)
    taken, goes = _progress(after[at.state].numel(), c.numel())(after[at.state], after[at.left], ca.vec(c), made)
    # A motion whose last step is no number has not come to its end.
    left = ca.if_else(ca.logic_and(made[0] > 0, ca.logic_not(taken)), np.nan, after[at.left])
    after = ca.vertcat(after[: at.left], left, after[at.longest :])
    step = ca.vertcat(made[0], z[at.piece])
    return ca.Function("motion", arguments, [after, c, z[at.sensitivities], step, taken, goes])


def _progress(n: int, size: int) -> ca.Function:
    """(state and time left after a step, its `size` coefficients, lengths taken and tried) -> whether the step counts,
    and whether another one is to be taken."""
    x, left, c, made = ca.SX.sym("x", n), ca.SX.sym("left"), ca.SX.sym("c", size), ca.SX.sym("made", 2)
    finite = ca.fabs(ca.sum1(c) + ca.sum1(x)) < np.inf
    inside = ca.logic_and(ca.mmax(ca.fabs(x)) < FLOW_CONTROL.runaway, made[1] > FLOW_CONTROL.shortest_step)
    goes = ca.logic_and(ca.logic_and(finite, inside), left > 0)
    return ca.Function("progress", [x, left, c, made], [ca.logic_and(finite, made[0] > 0), goes])


def _watch_function(stepper: TaylorStepper, used: tuple[tuple[int, ...], ...], opening: int, turns: int) -> ca.Function:
    """A step of `TaylorStepper.follow` with functions of the rows `used`, as a `Kernel` iterates it; see `Watch`."""
    at, rows, size, count = stepper.places, stepper.rows, len(used), stepper.step_function.numel_in(1)
    z, data = ca.MX.sym("z", at.signs.start + size), ca.MX.sym("p", count + size * (rows + 1) + opening + 2)
    p, tests, limit, all_steps = data[:count], data[count:-2], data[-2], data[-1]
    row = [ca.MX.sym("row", stepper.piece_rows.width)] if stepper.graph.coordinate else []
    after, c, made = stepper.step_function(z[: at.time], p, *row)
    taken, goes = _progress(stepper.n, c.numel())(after[at.state], after[at.left], ca.vec(c), made)
    inside = ca.logic_and(taken, ca.mmax(ca.fabs(after[at.state])) < FLOW_CONTROL.runaway)
    may_change, signs, turned = _may_change_sign(rows, used, opening, turns > 0)(
        c, made[1], tests, z[at.fresh], z[at.signs]
    )
    found = ca.logic_and(inside, may_change)
    new = ca.vertcat(after, z[at.time] + made[0], 0, found, z[at.changes] + turned, signs)
    # A motion that runs away stays where it was, so that it can be followed from there alone.
    new = ca.if_else(inside, new, ca.vertcat(z[at.state], after[at.left : at.piece], z[at.piece :]))
    goes = ca.logic_and(ca.logic_and(goes, ca.logic_not(found)), new[at.time] < limit)
    goes = ca.logic_and(goes, made[1] > FLOW_CONTROL.shortest_step * z[at.time])
    if turns:
        goes = ca.logic_and(goes, new[at.changes] < turns)
    begins = ca.vertcat(made[0], z[at.fresh], z[at.time], z[at.changes])
    records = c, begins, z[at.signs], ca.logic_and(inside, ca.logic_or(found, all_steps))
    return ca.Function("watch", [z, data, *row], [new, *records, goes])


@cached
def _may_change_sign(rows: int, used: tuple[tuple[int, ...], ...], opening: int, counts: bool) -> ca.Function:
    """(coefficients (K + 1, rows), step, the tests of `Watch.data` with the orders of zeros at the start, whether it is
    there, signs (size,) before) -> whether an affine function may change its sign in the step, the signs after it, and
    whether that of the last has changed. With `counts` the last function may change it, else this is not checked.
    `used` are the rows of each function whose weights are not 0.

    A polynomial has no zero where the Bernstein coefficients of its first terms have one sign and are larger than the
    sum of the other terms; the sign at the start is that at the end of the step before. The first of these coefficients
    may be smaller: the other terms are at most their sum times t, and the first terms at least that much, if the value
    at the start has the same sign.
    """
    c, size = ca.SX.sym("c", TAYLOR.order + 1, rows), len(used)
    h, fresh = ca.SX.sym("h"), ca.SX.sym("fresh")
    tests, before = ca.SX.sym("w", size * (rows + 1) + opening), ca.SX.sym("s", size)
    terms, change, after, turned = ca.diag(symbolic_powers(h)) @ c, ca.SX(0), [], ca.SX(0)
    for i, own in enumerate(used):
        series = sum((terms[:, row] * tests[i * rows + row] for row in own), ca.SX.zeros(TAYLOR.order + 1))
        series[0] += tests[size * rows + i]
        rest, first = ca.sum1(ca.fabs(series[TAYLOR.bound_degree + 1 :])), [series[: TAYLOR.bound_degree + 1]]
        order = fresh * tests[size * (rows + 1) + i] if i < opening else 0
        for skipped in range(1, HIGHEST_ORDER + 1) if i < opening else ():
            first.append(series[skipped : skipped + TAYLOR.bound_degree + 1])
            series[skipped - 1] = ca.if_else(order >= skipped, 0, series[skipped - 1])
        start, ends = first[0], ca.sum1(series)
        for skipped, shifted in enumerate(first[1:], start=1):
            start = ca.if_else(order >= skipped, shifted, start)
        begins = ca.if_else(before[i] == 0, start[0], before[i]) >= 0
        after.append(ca.if_else(ends >= 0, 1.0, -1.0))
        if counts and i == size - 1:
            turned = begins != (ends >= 0)
            continue
        bounds = ca.vertcat(*bernstein_coefficients(start, ca.SX.ones(start.numel()))[1:], ends)
        same = ca.if_else(begins, ca.mmin(bounds) >= rest, ca.mmax(bounds) < -rest)
        change = ca.logic_or(change, ca.logic_not(ca.logic_and(same, ca.fabs(ends) < np.inf)))
    return ca.Function("signs", [c, h, tests, fresh, before], [change, ca.vertcat(*after), turned])


@cached
def event_in_step(rows: int, used: tuple[tuple[int, ...], ...], opening: int, size: int) -> ElementwiseFunction:
    """(coefficients (rows (K + 1),) of a step; its length, whether it is the first, the time and changes before it; the
    signs (size,) before it; the tests of `Watch.data` and the orders of zeros) -> as `Watch.event` returns it."""
    c, begins, before = ca.SX.sym("c", rows * (TAYLOR.order + 1)), ca.SX.sym("b", 4), ca.SX.sym("s", size)
    tests, coefficients = ca.SX.sym("w", size * (rows + 1) + opening), ca.reshape(c, TAYLOR.order + 1, rows)
    h, fresh, begun, _ = ca.vertsplit(begins)
    first, which, unknown, ends = ca.SX(np.inf), ca.SX(-1), ca.SX(0), list[ca.SX]()
    for i, own in enumerate(used):
        series = sum((coefficients[:, row] * tests[i * rows + row] for row in own), ca.SX.zeros(TAYLOR.order + 1))
        series[0] += tests[size * rows + i]
        if i < opening:
            series = without_first_zero(series, fresh * tests[size * (rows + 1) + i])
        root, end, several = first_root(TAYLOR.order + 1)(series, h, before[i])
        which, first = ca.if_else(root < first, i, which), ca.fmin(root, first)
        unknown = ca.logic_or(unknown, several)
        ends.append(end)
    there = coefficients.T @ symbolic_powers(ca.if_else(first < np.inf, first, 0))
    results = [ca.vertcat(begun + first, which, unknown), there, ca.vertcat(*ends)]
    return ElementwiseFunction(ca.Function("event", [c, begins, before, tests], results))


class TaylorMotion(NamedTuple):
    """One motion: its flow and stepper, parameters (np,) and their seeds (np, columns), its state (n,) with
    sensitivities (n, columns), and the piece that it is on."""

    flow: Any
    stepper: TaylorStepper
    p: Array
    seeds: Array
    x: Array
    variations: Array
    on: OnPieces | None

    def advance(self, count: int, left: float) -> Motions:
        """At most `count` steps, which last no longer than `left`; a single NaN stands for the steps when none is
        accepted. Raises `OutOfRange` where no piece is left."""
        if not self.flow.inside(self.on, self.on.numbers if self.on else self.x)[0]:
            raise self.flow.out_of_range(self.p, self.x)
        own = self.x[None], self.p[None], np.array([left]), self.variations, self.seeds
        found = self.stepper.advance_all(*own, count, self.on)
        if not len(found.steps):
            return found._replace(steps=np.full(1, np.nan), coefficients=self.x[None, :, None])
        if found.left[0] == 0:  # the time was counted down, with other roundings than those of the sum of the steps
            found.steps[-1] += left - np.cumsum(found.steps)[-1]
        return found

    def after(self, found: Motions, count: int, h: float) -> "TaylorMotion":
        """The motion after so many of the steps found, the last of them with the length h, not longer than found."""
        if count == len(found.steps) and h >= found.steps[-1] * (1 - FLOW_CONTROL.rounding):
            x, variations, numbers = found.ends[0], found.variations[0], found.pieces
        else:
            c, before, numbers = found.coefficients[count - 1], found.begins[count - 1], found.on[count - 1 : count]
            x, variations = c[: self.stepper.n] @ h ** np.arange(c.shape[1]), before
            if before.shape[1]:
                p, seeds = self._data(int(numbers[0]))
                variations = self.stepper.sensitivities_after(c[: self.stepper.n, 0], p, before, seeds, h)
        return self._replace(x=x, variations=variations, on=self.on and self.on._replace(numbers=numbers))

    def _data(self, number: int) -> tuple[Array, Array]:
        """Parameters and data of a piece, and the rows of their seeds that are varied."""
        seeds, layout = self.seeds[self.stepper.varied_parameters], self.stepper.piece_rows
        if self.on is None:
            return self.p, seeds
        row = self.on.tables.reshape(-1, layout.width)[number]
        moves = row[2 + 3 * layout.data :].reshape(layout.columns, 2 + layout.data)[:, 2:]
        return np.append(self.p, row[2 : 2 + layout.data]), np.vstack([seeds, moves.T]) if layout.varied else seeds
