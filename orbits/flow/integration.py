"""Integration of one motion, step by step and from breakpoint to breakpoint, until its end or until a test stops it."""

from collections.abc import Callable

import numpy as np

from ..errors import BreaksDown, FlowError, RunsAway
from ..symbolic import interrupts
from .breakpoints import ActivePiece
from .dynamics import PhaseDynamics
from .trajectory import Trajectory

# Times that differ by less than this share are equal up to rounding.
SAME_TIME = 1e-15
# (coefficients (m, rows, K + 1), steps (m,)) -> the step and the time in it at which to stop, None to go on.
StopTest = Callable[[np.ndarray, np.ndarray], tuple[int, float] | None]


def integrate(
    dynamics: PhaseDynamics,
    x: np.ndarray,
    p: np.ndarray,
    duration: float,
    seeds: np.ndarray | None,
    parameter_seeds: np.ndarray | None,
    stop: StopTest | None,
) -> tuple[Trajectory, np.ndarray]:
    """The motion from `x`, as `Flow.run` describes it, by the steps of the phase's stepper."""
    check_start(dynamics, x, p, duration)
    variations = np.zeros((len(x), 0)) if seeds is None else seeds
    columns = variations.shape[1]
    piece = ActivePiece(dynamics, p, x, columns, parameter_seeds)
    stepper = dynamics.stepper(columns, piece.varied())
    times: list[float] = [0.0]
    coefficients: list[np.ndarray] = []
    slopes: list[np.ndarray] = []
    h = None
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
            raise _runaway(dynamics, x, times[-1], h)
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


def describe(dynamics: PhaseDynamics, x: np.ndarray) -> str:
    """A state in words."""
    return ", ".join(f"{name} = {value:.6g}" for name, value in zip(dynamics.phase.states, x, strict=False))


def _runaway(dynamics: PhaseDynamics, x, t: float, h: float) -> FlowError:
    """The error of a motion whose state is beyond all bounds after a step of length `h`."""
    kind = RunsAway if h > dynamics.control.singular_step else BreaksDown
    return kind(f"the {dynamics.phase.name} runs away at time {t:.6g}, at {describe(dynamics, x)}")


def _block_size(piece: ActivePiece, stepper, stop: StopTest | None, left: float, h: float | None) -> int:
    """How many steps to take in the next call, after a step of length `h` if there has been one."""
    look_ahead = piece.dynamics.control.look_ahead
    if piece.pieces:
        return 1
    if stop:
        return look_ahead
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
