"""The smooth piece of a vector field on which a motion by Runge-Kutta steps lies; it enters and leaves pieces at
breakpoints.

Taylor steps find these themselves, see `taylor.PieceRows`.
"""

import numpy as np

from ..numerics import Array, roots_within
from .vector_field import TAYLOR

# How far from a breakpoint the limits of the field on its two sides are evaluated, relative to the breakpoint. They are
# extrapolated to it from this distance and its double, so that an error of second order, 1e-12, remains.
SIDE_DISTANCE = 1e-6
# A place that differs from a breakpoint by less, relative to its size and to one, is on it: the rest is rounding.
BREAKPOINT_ROUNDING = 1e-14


def same_place(breaks: Array, places: Array | float) -> Array:
    """Which breakpoints are at places, up to rounding."""
    return np.abs(breaks - places) <= BREAKPOINT_ROUNDING * (1 + np.abs(places))


class ActivePiece:
    """The smooth piece that one motion with sensitivities is on: its data, their seeds, and its two breakpoints."""

    def __init__(self, flow, p: Array, x: Array, seeds: Array):
        self.flow, self.p, self.data, self.seeds, self.parameter_seeds = flow, p, p, seeds, seeds
        if flow.phase.pieces is None:
            return
        (self.breaks, self.table, self.slopes), self.weights = flow.piece_table(p), flow.coordinate
        index = int(flow.first_pieces(x[None], p[None])[0]) - 1
        if not 0 <= index < len(self.table):
            raise flow.out_of_range(p, x)
        self.index, (self.data, self.seeds) = index, self._on(index)
        place = float(self.weights @ x)
        # The breakpoint that the state is on, whose zero at the start of the next step is divided out.
        on = self.breaks[same_place(self.breaks, place)]
        self.level = on[0] if len(on) else None

    def cut(self, c: Array, h: float) -> tuple[float, int]:
        """The step shortened to the end of the piece, and the end it reaches: -1 lower, +1 upper, 0 neither."""
        coordinate, crossed = self.weights @ c[: self.flow.size], 0
        for side, level in ((-1, self.breaks[self.index]), (1, self.breaks[self.index + 1])):
            if not np.isfinite(level):
                continue
            distance = coordinate.copy()
            distance[0] -= level
            order = int(np.argmax(distance[1:] != 0)) + 1 if level == self.level else 0
            found = roots_within(distance[order:], h)
            if found and found[0] < h:
                h, crossed = max(found[0], TAYLOR.shortest_cut * h), side
        self.level = None
        return h, crossed

    def enter(self, side: int, x: Array, variations: Array) -> Array:
        """Enter the next piece, above (+1) or below (-1), and return the variations (n, columns) beyond the breakpoint.

        Where the field jumps there, a change of the time of crossing changes the state by the jump (saltation), also
        where the breakpoint moves with a parameter.
        """
        index = self.index + side
        if not 0 <= index < len(self.table):
            raise self.flow.out_of_range(self.p, x)
        self.level, before = self.breaks[max(index, self.index)], self.data
        self.index, (self.data, self.seeds) = index, self._on(index)
        if not variations.size:
            return variations
        by_x, by_p = self.flow.approach(x, self.p, max(index - side, index))
        earlier = (by_x @ variations + by_p @ self.parameter_seeds) / (by_x @ self.flow.rates(x, before))
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
