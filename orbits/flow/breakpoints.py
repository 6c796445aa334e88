"""The smooth piece of a piecewise vector field that a motion is on, its breakpoints, and the piece that follows."""

import numpy as np

from ..errors import OutOfRange
from ..numerics.bernstein import PiecewisePolynomials, roots
from .dynamics import PhaseDynamics

# How far from a breakpoint the limits of the field on its two sides are evaluated, relative to the breakpoint. They are
# extrapolated to it from this distance and its double, so that an error of second order, 1e-12, remains.
SIDE_DISTANCE = 1e-6


class ActivePiece:
    """The smooth piece that one motion with sensitivities is on: its data, their seeds, and its two breakpoints."""

    def __init__(
        self, dynamics: PhaseDynamics, p: np.ndarray, x: np.ndarray, columns: int, parameter_seeds: np.ndarray | None
    ):
        self.dynamics, self.pieces = dynamics, dynamics.phase.pieces
        self.p, self.data = p, p
        self.parameter_seeds = np.zeros((len(p), columns)) if parameter_seeds is None else parameter_seeds
        self.seeds = self.parameter_seeds
        if self.pieces is None:
            return
        self.breaks, self.table, self.slopes = dynamics.piece_table(p)
        self.weights = dynamics.coordinate
        if (index := first_piece(dynamics, p, x)) < 0:
            raise out_of_range(self.dynamics, self.p, x)
        self._set(index)
        place = float(self.weights @ x)
        # The breakpoint that the state is on, whose exact zero at the start of the next step is divided out.
        self.level = place if place in self.breaks else None

    def varied(self) -> tuple[int, ...]:
        """Rows of the seeds that are not zero on some piece."""
        rows = np.flatnonzero(self.parameter_seeds.any(1))
        data = range(len(self.parameter_seeds), len(self.seeds)) if len(rows) else ()
        return (*map(int, rows), *data)

    def cut(self, c: np.ndarray, h: float) -> tuple[float, int]:
        """The step shortened to the end of the piece, and the end it reaches: -1 lower, +1 upper, 0 neither."""
        if self.pieces is None:
            return h, 0
        coordinate = self.weights @ c[: self.dynamics.size]
        crossed = 0
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

    def enter(self, side: int, x: np.ndarray, variations: np.ndarray) -> np.ndarray:
        """Enter the next piece, above (+1) or below (-1), and return the variations (n, columns) beyond the breakpoint.

        Where the field jumps there, a change of the time of crossing changes the state by the jump (saltation).
        """
        index = self.index + side
        if not 0 <= index < len(self.table):
            raise out_of_range(self.dynamics, self.p, x)
        self.level = self.breaks[max(index, self.index)]
        before = self.data
        self._set(index)
        if not variations.size:
            return variations
        earlier = self.weights @ variations / (self.weights @ self.dynamics.rates(x, before))
        return variations + np.outer(self._jump(x, before, side), earlier)

    def _set(self, index: int) -> None:
        self.index = index
        self.data = np.concatenate([self.p, self.table[index]])
        self.seeds = np.vstack([self.parameter_seeds, self.slopes[index] @ self.parameter_seeds])

    def _jump(self, x: np.ndarray, before: np.ndarray, side: int) -> np.ndarray:
        """How much the field (n,) changes across the breakpoint at `x`.

        Without data of its pieces a law does not know on which side of the breakpoint it is evaluated, so that the
        limits are extrapolated from both sides.
        """
        rates = self.dynamics.rates
        if len(self.data) > len(self.p):
            return rates(x, self.data) - rates(x, before)
        room = np.diff(self.breaks).min()
        level = self.breaks[self.index + (side < 0)]
        away = side * SIDE_DISTANCE * min(1 + abs(level), room) * self.weights / (self.weights @ self.weights)
        near, far = (rates(x + k * away, self.data) - rates(x - k * away, before) for k in (1.0, 2.0))
        return 2 * near - far


class ActivePieces:
    """The smooth pieces that several motions without sensitivities are on, one for each motion."""

    def __init__(self, dynamics: PhaseDynamics, p: np.ndarray, x: np.ndarray):
        self.dynamics, self.pieces, self.p = dynamics, dynamics.phase.pieces, p
        self.index = self.crossed = np.zeros(len(x), int)
        if self.pieces is None:
            return
        self.breaks, self.table, _ = dynamics.piece_table(p)
        places = x @ dynamics.coordinate
        self.index = np.searchsorted(self.breaks, places, "right") - 1
        on = np.isin(places, self.breaks)
        self.index[on] = [first_piece(dynamics, p, one) for one in x[on]]
        self.level = np.where(on, places, np.nan)

    @property
    def inside(self) -> np.ndarray:
        """Which motions (m,) are on a piece."""
        return np.ones(len(self.index), bool) if self.pieces is None else self._nearest == self.index

    @property
    def _nearest(self) -> np.ndarray:
        return np.clip(self.index, 0, len(self.table) - 1)

    @property
    def data(self) -> np.ndarray:
        """Parameters with the data of the pieces, (m, np + nq)."""
        data = np.tile(self.p, (len(self.index), 1))
        return data if self.pieces is None else np.hstack([data, self.table[self._nearest]])

    def cut(self, c: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Steps (m, 1) with coefficients (m, 1, rows, K + 1), shortened to the ends of their pieces."""
        self.crossed = np.zeros(len(steps), int)
        if self.pieces is None:
            return steps
        lengths, weights = steps[:, 0].copy(), self.dynamics.coordinate
        coordinate = np.einsum("i,mik->mk", weights, c[:, 0, : len(weights)])
        for side in (0, 1):
            level = self.breaks[self._nearest + side]
            distance = coordinate.copy()
            distance[:, 0] -= level
            distance[~np.isfinite(level)] = 1.0
            orders = np.where(level == self.level, (distance[:, 1:] != 0).argmax(1) + 1, 0)
            owner, _, t = PiecewisePolynomials(distance, lengths, np.ones(len(lengths), int)).roots(orders)
            owner, first = np.unique(owner, return_index=True)
            hit = t[first] < lengths[owner]
            lengths[owner[hit]], self.crossed[owner[hit]] = t[first][hit], 2 * side - 1
        return lengths[:, None]

    def enter(self, which: np.ndarray) -> None:
        """Keep the motions `which`, on the next pieces where they have crossed a breakpoint."""
        if self.pieces is not None:
            ahead = self.index + self.crossed
            passed = self.breaks[np.maximum(self.index, ahead)]
            self.index, self.level = ahead, np.where(self.crossed != 0, passed, np.nan)
        self.keep(which)

    def keep(self, which: np.ndarray) -> None:
        """Keep the motions `which` alone."""
        self.index, self.crossed = self.index[which], self.crossed[which]
        if self.pieces is not None:
            self.level = self.level[which]


def first_piece(dynamics: PhaseDynamics, p: np.ndarray, x: np.ndarray) -> int:
    """Index of the piece on which the motion from a state begins, -1 where there is none.

    From a breakpoint it is the piece that the motion enters: by the rate of the coordinate or, where that vanishes, by
    the rate of the rate, since positions change by speeds.
    """
    breaks, table, _ = dynamics.piece_table(p)
    weights = dynamics.coordinate
    place = float(weights @ x)
    if not breaks[0] <= place <= breaks[-1]:
        return -1
    index = dynamics.piece(x, breaks)
    if place in breaks:
        data = np.concatenate([p, table[index]])
        rates = dynamics.rates(x, data)
        heading = weights @ rates or weights @ (dynamics.rates(x + rates, data) - rates)
        if place == breaks[index] and heading < 0:
            index -= 1
        elif place == breaks[index + 1] and heading > 0:
            index += 1
    return index if 0 <= index < len(table) else -1


def out_of_range(dynamics: PhaseDynamics, p: np.ndarray, x: np.ndarray) -> OutOfRange:
    """The error of a motion that leaves the range of its law at the state `x`."""
    breaks, place, pieces = dynamics.piece_table(p)[0], float(dynamics.coordinate @ x), dynamics.phase.pieces
    assert pieces is not None
    bounds = f"[{breaks[0]:.6g}, {breaks[-1]:.6g}]"
    return OutOfRange(f"the {pieces.label} reaches {place:.6g}, outside the law's range {bounds}")
