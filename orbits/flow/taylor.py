"""Motions in Taylor steps with their sensitivities, one of them or many, in kernels that iterate a step."""

from collections.abc import Callable, Sequence
from functools import reduce
from operator import add
from typing import Any, NamedTuple

import numpy as np

from ..numerics import Array
from ..running import exclusive_property
from ..symbolic import (
    Block,
    CodedFunction,
    Kernel,
    Mask,
    Number,
    VectorCode,
    room_of_series,
)
from .taylor_step import PieceRows, Places, StepSeries, TaylorStep
from .vector_field import FLOW_CONTROL, TAYLOR, VectorField


def coefficients_of(records: Array, rows: int, order: int) -> Array:
    """The coefficients (N, rows, order + 1) of steps in the records (N, size) of a kernel."""
    stride = order + 2
    return records[:, : rows * stride].reshape(len(records), rows, stride)[:, :, :-1]


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


class Moved(NamedTuple):
    """A step of a motion in the code of a kernel: z after it, the coefficients of states and watched quantities, the
    sensitivities before it, its length and piece, the length tried, whether it counts, and whether to continue."""

    after: list[str]
    rows: Block
    series: StepSeries
    begins: Sequence[str]
    length: list[str]
    tried: Number
    counts: Mask
    goes: Mask


class TaylorStepper:
    """Takes Taylor steps with the sensitivities of the states.

    The argument z of a step is as `places` states, its data are the parameters and their seeds, and further arguments
    the row of the piece, as in `PieceRows`. A rejected step has length 0, and the next one tries half its length or
    less.

    The sensitivities solve the variational equations dx' = f_x dx + f_p dp. The series of f_x and f_p are found once,
    and with them all columns; `varied` are the rows of dp that are not zero, among them all or none of the data of a
    piece. Where the field jumps at the end of a piece, a change of the time at which it is reached changes the state by
    the jump (saltation).
    """

    def __init__(self, graph: VectorField, columns: int, varied: tuple[int, ...] = ()):
        self.graph, self.n, self.columns = graph, graph.size, columns
        count_p = graph.p.numel() - graph.data  # the number of parameters
        self.varied, self.varied_parameters = varied, [row for row in varied if row < count_p]
        self.piece_rows = PieceRows(graph.data, columns * (len(self.varied_parameters) < len(varied)))
        self.rows, left = graph.size + graph.field.numel_out(1), graph.size * (1 + columns)
        numbers = range(left, left + 7)
        self.places = Places(slice(self.n), slice(self.n, left), slice(numbers.stop, None), *numbers)
        self.step = TaylorStep(graph, self.places, columns, varied, self.piece_rows)
        self.sizes = [self.places.time, count_p + len(self.varied_parameters) * columns]
        if graph.coordinate:
            self.sizes.append(self.piece_rows.width)

    @exclusive_property
    def kernel(self) -> Kernel:
        """Takes the steps of motions: (z, data, row of the piece) -> (z after it, coefficients, the sensitivities
        before it, the length and the piece, whether it counts, whether to continue)."""

        def append(code: VectorCode, arguments: Sequence) -> list:
            moved = self.motion(code, *arguments)
            flags = [moved.counts.value()], [moved.goes.value()]
            return [moved.after, moved.rows, moved.begins, moved.length, *flags]

        return self.kernel_of(append, self.sizes, [self.places.time, self.recorded, self.n * self.columns, 2, 1, 1])

    def kernel_of(
        self, append: Callable, sizes_in: list[int], sizes_out: list[int], blocks: tuple[int, ...] = ()
    ) -> Kernel:
        """The kernel that iterates a step with such arguments, which takes the row of its piece."""
        function = CodedFunction(sizes_in, sizes_out, append, blocks)
        return Kernel(function, self.places.piece if self.graph.coordinate else None)

    @property
    def recorded(self) -> int:
        """The size of the records of the coefficients of a step."""
        return room_of_series(self.rows, self.graph.order)

    def motion(self, code: VectorCode, z: Sequence[str], data: Sequence[str], row: Sequence[str] = ()) -> Moved:
        """Append the code of a step of a motion, which continues until no time is left, the state runs away or no step
        is accepted."""
        at, step = self.places, self.step.append(code, z, data, row)
        states, left = [Number(code, each) for each in step.after[at.state]], Number(code, step.after[at.left])
        largest = abs(states[0]).largest(*map(abs, states[1:]))
        finite = step.finite & (abs(reduce(add, states)) < np.inf)
        inside = (largest < FLOW_CONTROL.runaway) & (step.tried > FLOW_CONTROL.shortest_step)
        counts = finite & (step.taken > 0.0)
        # A motion whose last step is not a number has not come to its end.
        left = ((step.taken > 0.0) & ~counts).choose(np.nan, left)
        after = [*step.after[: at.left], left.name, *step.after[at.longest :]]
        goes = finite & inside & (left > 0.0)
        return Moved(
            after, step.rows, step.series, z[at.sensitivities], [step.taken.name, z[at.piece]], step.tried, counts, goes
        )

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
        c = coefficients_of(c, self.rows, self.graph.order)
        ends, left, numbers = z[:, at.state], z[:, at.left], z[:, at.piece]
        return Motions(ends, variations, made[:, 0], c, begins, made[:, 1], counts, left, numbers)

    def watched_state(self, x: Array, count: int, numbers: Array | float) -> Array:
        """The argument z of `Watch.follow` with `count` functions: states (m, n) and the numbers (m,) of pieces; the
        time left is not limited."""
        z, at = np.zeros((len(x), self.places.signs.start + count)), self.places
        z[:, at.state], z[:, at.left], z[:, at.longest], z[:, at.piece] = x, np.inf, TAYLOR.longest_step, numbers
        z[:, at.fresh] = 1.0
        return z


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
        """The motion after some of the steps found, the last of them with the length h, not longer than found."""
        if count == len(found.steps) and h >= found.steps[-1] * (1 - FLOW_CONTROL.rounding):
            x, variations, numbers = found.ends[0], found.variations[0], found.pieces
        else:
            c, variations, numbers = found.coefficients[count - 1], found.begins[count - 1], found.on[count - 1 : count]
            x = c[: self.stepper.n] @ h ** np.arange(c.shape[1])
            if variations.shape[1]:
                start, on = c[None, : self.stepper.n, 0], self.on and self.on._replace(numbers=numbers)
                own = start, self.p[None], np.array([h]), variations, self.seeds
                variations = self.stepper.advance_all(*own, on=on).variations[0]
        return self._replace(x=x, variations=variations, on=self.on and self.on._replace(numbers=numbers))
