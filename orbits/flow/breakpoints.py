"""On which piece of a piecewise field a motion is, where that ends, and what comes after."""

import numpy as np

from ..errors import OutOfRange
from ..numerics.bernstein import PiecewisePolynomials, roots

# How near to a break the field is asked for its limits there, which are extrapolated to second order.
SIDE_DISTANCE = 1e-6


class ActivePiece:
    """The piece of the field that the motion is on: its data, and where it ends."""

    def __init__(self, flow, p, x, columns: int, parameter_seeds):
        self.flow, self.pieces = flow, flow.phase.pieces
        self.data = p
        self.seeds = np.zeros((len(p), columns)) if parameter_seeds is None else parameter_seeds
        self.p, self.parameter_seeds = p, self.seeds
        if self.pieces is None:
            return
        self.breaks, self.table, self.slopes = flow.piece_table(p)
        self.weights = np.array(self.pieces.coordinate)
        place = float(self.weights @ x)
        if (index := first_piece(flow, p, x)) < 0:
            raise OutOfRange(_outside(self.pieces, self.breaks, place))
        self._set(index)
        self.level = place if place in self.breaks else None

    def varied(self) -> tuple[int, ...]:
        """Rows of the seeds that are not zero, on whatever piece."""
        rows = np.flatnonzero(self.parameter_seeds.any(1))
        data = range(len(self.parameter_seeds), len(self.seeds)) if len(rows) else ()
        return (*map(int, rows), *data)

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
            order = int(np.argmax(distance[1:] != 0)) + 1 if level == self.level else 0
            found = roots(distance[order:], h)
            if found and found[0] < h:
                h, crossed = found[0], side
        self.level = None
        return h, crossed

    def enter(self, side: int, x, variations):
        """Go on in the next piece, above (+1) or below (-1); returns the variations (n, columns) beyond the break.

        Where the field jumps there, a change of the time of crossing changes the state by the jump (saltation).
        """
        index = self.index + side
        if not 0 <= index < len(self.table):
            raise OutOfRange(_outside(self.pieces, self.breaks, float(self.weights @ x)))
        self.level = self.breaks[max(index, self.index)]
        before = self.data
        self._set(index)
        if variations is None:
            return None
        earlier = self.weights @ variations / (self.weights @ self.flow.rates(x, before))
        return variations + np.outer(self._jump(x, before, side), earlier)

    def _jump(self, x, before, side: int) -> np.ndarray:
        """How much the field (n,) changes across the break at `x`. Without data of the pieces a law does not know on
        which side of the break it is: then extrapolated from both sides."""
        if self.pieces.size:
            return self.flow.rates(x, self.data) - self.flow.rates(x, before)
        room = np.diff(self.breaks).min()
        away = side * SIDE_DISTANCE * min(1 + abs(self.level), room) * self.weights / (self.weights @ self.weights)
        near, far = (
            self.flow.rates(x + k * away, self.data) - self.flow.rates(x - k * away, before) for k in (1.0, 2.0)
        )
        return 2 * near - far


class ActivePieces:
    """The pieces of the field that several motions are on, as `ActivePiece` of one."""

    def __init__(self, flow, p, x):
        self.pieces, self.p = flow.phase.pieces, p
        self.index = self.crossed = np.zeros(len(x), int)
        if self.pieces is None:
            return
        self.breaks, self.table, _ = flow.piece_table(p)
        self.weights = np.array(self.pieces.coordinate)
        places = x @ self.weights
        self.index = np.searchsorted(self.breaks, places, "right") - 1
        on = np.isin(places, self.breaks)
        self.index[on] = [first_piece(flow, p, one) for one in x[on]]
        self.level = np.where(on, places, np.nan)

    def outside(self, x) -> str:
        """What to say of a state (n,) that is on no piece."""
        return _outside(self.pieces, self.breaks, float(self.weights @ x))

    @property
    def inside(self) -> np.ndarray:
        """Which of them (m,) have a piece."""
        return np.ones(len(self.index), bool) if self.pieces is None else self._known == self.index

    @property
    def _known(self) -> np.ndarray:
        return np.clip(self.index, 0, len(self.table) - 1)

    @property
    def data(self) -> np.ndarray:
        """Parameters with the data of the pieces, (m, np + nq)."""
        data = np.tile(self.p, (len(self.index), 1))
        return data if self.pieces is None else np.hstack([data, self.table[self._known]])

    def cut(self, c, steps) -> np.ndarray:
        """Steps (m, 1) with coefficients (m, 1, rows, K + 1) shortened to where they come to an end of their pieces."""
        self.crossed = np.zeros(len(steps), int)
        if self.pieces is None:
            return steps
        lengths = steps[:, 0].copy()
        along = np.einsum("i,mik->mk", self.weights, c[:, 0, : len(self.weights)])
        for side in (0, 1):
            level = self.breaks[self._known + side]
            distance = along.copy()
            distance[:, 0] -= level
            distance[~np.isfinite(level)] = 1.0
            orders = np.where(level == self.level, (distance[:, 1:] != 0).argmax(1) + 1, 0)
            owner, _, t = PiecewisePolynomials(distance, lengths, np.ones(len(lengths), int)).roots(orders)
            owner, first = np.unique(owner, return_index=True)
            hit = t[first] < lengths[owner]
            lengths[owner[hit]], self.crossed[owner[hit]] = t[first][hit], 2 * side - 1
        return lengths[:, None]

    def enter(self, which):
        """Go on with some of them, in the next pieces where an end has been crossed."""
        if self.pieces is not None:
            ahead = self.index + self.crossed
            passed = self.breaks[np.maximum(self.index, ahead)]
            self.index, self.level = ahead, np.where(self.crossed != 0, passed, np.nan)
        self.keep(which)

    def keep(self, which):
        """Go on with some of them."""
        self.index, self.crossed = self.index[which], self.crossed[which]
        if self.pieces is not None:
            self.level = self.level[which]


def first_piece(flow, p, x) -> int:
    """Index of the piece that the motion from a state begins on, -1 where there is none. On a break it is the one that
    the motion goes to: by its rate or, where that vanishes, by the rate's own, since positions change by speeds."""
    breaks, table, _ = flow.piece_table(p)
    weights = np.array(flow.phase.pieces.coordinate)
    place = float(weights @ x)
    if not breaks[0] <= place <= breaks[-1]:
        return -1
    index = flow.piece(x, breaks)
    if place in breaks:
        data = np.concatenate([p, table[index]])
        rates = flow.rates(x, data)
        heading = weights @ rates or weights @ (flow.rates(x + rates, data) - rates)
        if place == breaks[index] and heading < 0:
            index -= 1
        elif place == breaks[index + 1] and heading > 0:
            index += 1
    return index if 0 <= index < len(table) else -1


def _outside(pieces, breaks, place: float) -> str:
    return f"the {pieces.label} reaches {place:.6g}, outside the law's range [{breaks[0]:.6g}, {breaks[-1]:.6g}]"
