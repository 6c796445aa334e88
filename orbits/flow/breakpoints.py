"""The smooth pieces of a vector field that motions are on, entered and left at breakpoints."""

import numpy as np

from ..numerics.polynomial_roots import PiecewisePolynomials, roots
from ..numerics.roots import Array
from .vector_field import rows_used

# How far from a breakpoint the limits of the field on its two sides are evaluated, relative to the breakpoint. They are
# extrapolated to it from this distance and its double, so that an error of second order, 1e-12, remains.
SIDE_DISTANCE = 1e-6


class ActivePiece:
    """The smooth piece that one motion with sensitivities is on: its data, their seeds, and its two breakpoints."""

    def __init__(self, flow, p, x, columns: int, parameter_seeds):
        self.flow, self.p, self.data = flow, p, p
        self.seeds = self.parameter_seeds = np.zeros((len(p), columns)) if parameter_seeds is None else parameter_seeds
        if flow.phase.pieces is None:
            return
        (self.breaks, self.table, self.slopes), self.weights = flow.piece_table(p), flow.coordinate
        if (index := flow.first_piece(p, x)) < 0:
            raise flow.out_of_range(p, x)
        self.index, (self.data, self.seeds) = index, self._on(index)
        place = float(self.weights @ x)
        # The breakpoint that the state is on, whose exact zero at the start of the next step is divided out.
        self.level = place if place in self.breaks else None

    def varied(self) -> tuple[int, ...]:
        """Rows of the seeds that are not zero on some piece."""
        rows = rows_used(self.parameter_seeds)
        return (*rows, *(range(len(self.parameter_seeds), len(self.seeds)) if rows else ()))

    def cut(self, c: Array, h: float) -> tuple[float, int]:
        """The step shortened to the end of the piece, and the end it reaches: -1 lower, +1 upper, 0 neither."""
        coordinate, crossed = self.weights @ c[: self.flow.size], 0
        for side, level in ((-1, self.breaks[self.index]), (1, self.breaks[self.index + 1])):
            if not np.isfinite(level):
                continue
            distance = coordinate.copy()
            distance[0] -= level
            order = int(np.argmax(distance[1:] != 0)) + 1 if level == self.level else 0
            found = roots(distance[order:], h)
            if found and found[0] < h:
                h, crossed = found[0], side
        self.level = None
        return h, crossed

    def enter(self, side: int, x: Array, variations: Array) -> Array:
        """Enter the next piece, above (+1) or below (-1), and return the variations (n, columns) beyond the breakpoint.

        Where the field jumps there, a change of the time of crossing changes the state by the jump (saltation).
        """
        index = self.index + side
        if not 0 <= index < len(self.table):
            raise self.flow.out_of_range(self.p, x)
        self.level, before = self.breaks[max(index, self.index)], self.data
        self.index, (self.data, self.seeds) = index, self._on(index)
        if not variations.size:
            return variations
        earlier = self.weights @ variations / (self.weights @ self.flow.rates(x, before))
        return variations + np.outer(self._jump(x, before, side), earlier)

    def _on(self, index: int) -> tuple[Array, Array]:
        """The data on a piece, and their seeds."""
        seeds = np.vstack([self.parameter_seeds, self.slopes[index] @ self.parameter_seeds])
        return np.concatenate([self.p, self.table[index]]), seeds

    def _jump(self, x: Array, before: Array, side: int) -> Array:
        """How much the field (n,) changes across the breakpoint at `x`; without data of its pieces a law does not know
        on which side it is evaluated, so that the limits are extrapolated."""
        rates = self.flow.rates
        if len(self.data) > len(self.p):
            return rates(x, self.data) - rates(x, before)
        room, level = np.diff(self.breaks).min(), self.breaks[self.index + (side < 0)]
        away = side * SIDE_DISTANCE * min(1 + abs(level), room) * self.weights / (self.weights @ self.weights)
        near, far = (rates(x + k * away, self.data) - rates(x - k * away, before) for k in (1.0, 2.0))
        return 2 * near - far


class ActivePieces:
    """The smooth pieces that several motions without sensitivities are on, one for each motion."""

    def __init__(self, flow, p, x):
        self.pieces, self.p = flow.phase.pieces, p
        self.index = self.crossed = np.zeros(len(x), int)
        if self.pieces is None:
            return
        (self.breaks, self.table, _), self.weights = flow.piece_table(p), flow.coordinate
        places = x @ self.weights
        self.index = np.searchsorted(self.breaks, places, "right") - 1
        on = np.isin(places, self.breaks)
        self.index[on] = [flow.first_piece(p, one) for one in x[on]]
        self.level = np.where(on, places, np.nan)

    @property
    def inside(self) -> Array:
        """Which motions (m,) are on a piece."""
        return np.ones(len(self.index), bool) if self.pieces is None else self._nearest == self.index

    @property
    def ends(self) -> Array:
        """The two breakpoints (m, 2) of the piece that each motion is on."""
        return self.breaks[self._nearest[:, None] + [0, 1]]

    @property
    def _nearest(self) -> Array:
        return np.clip(self.index, 0, len(self.table) - 1)

    @property
    def data(self) -> Array:
        """Parameters with the data of the pieces, (m, np + nq)."""
        data = np.tile(self.p, (len(self.index), 1))
        return data if self.pieces is None else np.hstack([data, self.table[self._nearest]])

    def cut(self, c: Array, steps: Array, entering: Array, signs: Array) -> Array:
        """Steps (m,) with coefficients (m, rows, K + 1), shortened to the ends of their pieces; some (m,) begin where
        their pieces are entered. `signs` (m, 2) are those of the distances from both ends before the steps, and are
        changed to those after them."""
        self.crossed = np.zeros(len(steps), int)
        if self.pieces is None:
            return steps
        lengths = steps.copy()
        coordinate = np.einsum("i,mik->mk", self.weights, c[:, : len(self.weights)])
        for side in (0, 1):
            level = self.breaks[self._nearest + side]
            distance = coordinate.copy()
            distance[:, 0] -= level
            distance[~np.isfinite(level)] = 1.0
            orders = np.where(entering & (level == self.level), (distance[:, 1:] != 0).argmax(1) + 1, 0)
            polynomials = PiecewisePolynomials(distance, lengths, np.ones(len(lengths), int))
            owner, _, t = polynomials.first_roots(orders, before=signs[:, side])
            signs[:, side] = polynomials.after
            hit = t < lengths[owner]
            lengths[owner[hit]], self.crossed[owner[hit]] = t[hit], 2 * side - 1
        return lengths

    def enter(self, which: Array) -> None:
        """Keep the motions `which`, on the next pieces where they have crossed a breakpoint."""
        if self.pieces is not None:
            ahead = self.index + self.crossed
            passed = self.breaks[np.maximum(self.index, ahead)]
            self.index, self.level = ahead, np.where(self.crossed != 0, passed, np.nan)
        self.keep(which)

    def keep(self, which: Array) -> None:
        """Keep the motions `which` alone."""
        self.index, self.crossed = self.index[which], self.crossed[which]
        if self.pieces is not None:
            self.level = self.level[which]
