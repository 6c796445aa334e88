"""Integration of motions on smooth pieces of their vector fields, from breakpoint to breakpoint, until a test."""

from collections.abc import Callable

import numpy as np

from ..errors import BreaksDown, FlowError, OutOfRange, RunsAway
from ..numerics.bernstein import PiecewisePolynomials, roots
from ..numerics.roots import Array
from ..symbolic import interrupts
from .dynamics import PhaseDynamics
from .trajectory import Trajectory

# How far from a breakpoint the limits of the field on its two sides are evaluated, relative to the breakpoint. They are
# extrapolated to it from this distance and its double, so that an error of second order, 1e-12, remains.
SIDE_DISTANCE = 1e-6
# Times that differ by less than this share are equal up to rounding.
SAME_TIME = 1e-15
# (coefficients (m, rows, K + 1), steps (m,)) -> the step and the time in it at which to stop, None to go on.
StopTest = Callable[[Array, Array], tuple[int, float] | None]
Seeds = Array | None


class ActivePiece:
    """The smooth piece that one motion with sensitivities is on: its data, their seeds, and its two breakpoints."""

    def __init__(self, dynamics: PhaseDynamics, p: Array, x: Array, columns: int, parameter_seeds: Seeds):
        self.dynamics, self.pieces, self.p, self.data = dynamics, dynamics.phase.pieces, p, p
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
        coordinate, crossed = self.weights @ c[: self.dynamics.size], 0
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
        self.level, before = self.breaks[max(index, self.index)], self.data
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
        room, level = np.diff(self.breaks).min(), self.breaks[self.index + (side < 0)]
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
    place = float((weights := dynamics.coordinate) @ x)
    if not breaks[0] <= place <= breaks[-1]:
        return -1
    index = int(dynamics.piece(x, breaks))
    if place in breaks:
        data = np.concatenate([p, table[index]])
        rates = dynamics.rates(x, data)
        heading = weights @ rates or weights @ (dynamics.rates(x + rates, data) - rates)
        if place == breaks[index] and heading < 0:
            index -= 1
        elif place == breaks[index + 1] and heading > 0:
            index += 1
    return index if index < len(table) else -1


def out_of_range(dynamics: PhaseDynamics, p: np.ndarray, x: np.ndarray) -> OutOfRange:
    """The error of a motion that leaves the range of its law at the state `x`."""
    breaks, place, pieces = dynamics.piece_table(p)[0], float(dynamics.coordinate @ x), dynamics.phase.pieces
    assert pieces is not None
    bounds = f"[{breaks[0]:.6g}, {breaks[-1]:.6g}]"
    return OutOfRange(f"the {pieces.label} reaches {place:.6g}, outside the law's range {bounds}")


def integrate(
    dynamics: PhaseDynamics, x: Array, p: Array, duration: float, seeds: Seeds, dp: Seeds, stop: StopTest | None
) -> tuple[Trajectory, Array]:
    """The motion from `x`, as `Flow.run` describes it, by the steps of the phase's stepper."""
    check_start(dynamics, x, p, duration)
    variations = np.zeros((len(x), 0)) if seeds is None else seeds
    columns = variations.shape[1]
    piece = ActivePiece(dynamics, p, x, columns, dp)
    stepper = dynamics.stepper(columns, piece.varied())
    coefficients: list[Array] = []
    slopes: list[Array] = []
    times, h = [0.0], None
    while times[-1] < duration:
        interrupts.check()
        left = duration - times[-1]
        block = _block_size(piece, stepper, stop, left, h)
        steps, c, dc = stepper.advance(x, piece.data, variations, piece.seeds, block, left, h)
        steps, c = _accepted_steps(dynamics, steps, c, times[-1], len(coefficients))
        count, last, side, stopped = _block_end(piece, c, steps, left, stop)
        for step in (*steps[: count - 1], last):
            times.append(times[-1] + step)
        coefficients.extend(c[:count])
        power = last ** np.arange(1, c.shape[2])
        x = c[count - 1, : dynamics.size, 0] + c[count - 1, : dynamics.size, 1:] @ power
        if dc is not None and columns:
            slopes.extend(dc[:count])
            variations = dc[count - 1, ..., 0] + dc[count - 1, ..., 1:] @ power
        h = steps[count - 1]
        if np.abs(x).max() > dynamics.control.runaway:
            kind = RunsAway if h > dynamics.control.singular_step else BreaksDown
            raise kind(f"the {dynamics.phase.name} runs away at time {times[-1]:.6g}, at {describe(dynamics, x)}")
        if stopped:
            break
        if duration - times[-1] < SAME_TIME * duration:
            times[-1] = duration
        if side:
            variations = piece.enter(side, x, variations)
    if not stop:
        stepper.expected_steps = min(len(coefficients), dynamics.control.max_block)
    path = Trajectory(np.array(times), np.array(coefficients), dynamics.names, np.array(slopes) if columns else None)
    return path, variations


def check_start(dynamics: PhaseDynamics, x: np.ndarray, p: np.ndarray, duration: float) -> None:
    """Raise `FlowError` for a motion without a finite start or a positive duration."""
    if not (np.isfinite(x).all() and np.isfinite(p).all() and duration > 0):
        raise FlowError(f"the {dynamics.phase.name} cannot start from {x} for a time {duration}")


def describe(dynamics: PhaseDynamics, x: Array) -> str:
    """A state in words."""
    return ", ".join(f"{name} = {value:.6g}" for name, value in zip(dynamics.phase.states, x, strict=False))


def _block_size(piece: ActivePiece, stepper, stop: StopTest | None, left: float, h: float | None) -> int:
    """How many steps to take in the next call, after a step of length `h` if there has been one."""
    look_ahead = piece.dynamics.control.look_ahead
    if piece.pieces or stop:
        return 1 if piece.pieces else look_ahead
    # A power of two, about as many steps as are left, since each number of steps has a function of its own.
    return int(2 ** np.ceil(np.log2(np.clip(left / h, 1, look_ahead)))) if h else stepper.expected_steps


def _accepted_steps(dynamics: PhaseDynamics, steps, c, t: float, taken: int) -> tuple[np.ndarray, np.ndarray]:
    """The leading steps that are numbers and not vanishing; raises `FlowError` when there is none."""
    accepted = (steps > dynamics.control.shortest_step * max(t, 1.0)) & np.isfinite(c).all((1, 2))
    if not accepted[0] or taken > dynamics.control.max_steps:
        reason, kind = ("takes too many steps", FlowError) if accepted[0] else ("breaks down", BreaksDown)
        raise kind(f"the {dynamics.phase.name} {reason} at time {t:.6g}, at {describe(dynamics, c[0, :, 0])}")
    count = len(steps) if accepted.all() else int(np.argmin(accepted))
    return steps[:count], c[:count]


def _block_end(piece: ActivePiece, c, steps, left: float, stop: StopTest | None) -> tuple[int, float, int, bool]:
    """Where a block of steps ends: how many steps are kept, the length of the last, which end of the smooth piece it
    reaches (-1 lower, +1 upper, 0 neither), and whether the motion stops there."""
    count, last, side = len(steps), steps[-1], 0
    reached = np.cumsum(steps)
    almost = left * (1 - piece.dynamics.control.rounding)
    if reached[-1] >= almost:
        count = int(np.argmax(reached >= almost)) + 1
        last = left - (reached[count - 2] if count > 1 else 0.0)
    if piece.pieces:
        last, side = piece.cut(c[0], last)
    if stop and (halt := stop(c[:count], np.append(steps[: count - 1], last))):
        return halt[0] + 1, halt[1], 0, True
    return count, last, side, False
