"""The linear quadratic regulator of a cycle whose inputs are decided at some of its instants, by its Riccati recursion.

The state z = (x, u) passes through the pieces of a cycle: x (a,) is the change of the state, and u (N,) are all inputs
of the cycle, also those already decided but not yet in force. At the beginning of a piece some inputs are decided, u_i
= -gains . z, and one input acts in it. The gains minimise the sum of |y|^2 of the launches y, of r u_i^2 of the inputs,
and of the squares of the gap and its speed where the foot should land, over all cycles to come.
"""

from typing import NamedTuple

import numpy as np

from ..errors import NoOrbit
from ..running import interrupts


class RegulatorOptions(NamedTuple):
    """When the recursion has settled, and when it does not settle."""

    settled: float = 1e-11  # the cost of a launch changes by this share in a cycle
    cycles: int = 2000  # at most; a cost that grows on and on is that of a direction that the input does not reach
    largest_cost: float = 1e14


REGULATOR = RegulatorOptions()


class Piece(NamedTuple):
    """A part of the cycle.

    carry, effect : the matrix (b, a), and the effect (b,) of the input in force, None where there is none
    acts : the number of that input
    decides : the numbers of the inputs that are decided as it begins
    gap : the derivatives (m, a) of what has to vanish at a landing in it by the state as it begins, as the gap and its
        speed; None where there is none
    """

    carry: np.ndarray
    effect: np.ndarray | None = None
    acts: int = -1
    decides: tuple[int, ...] = ()
    gap: np.ndarray | None = None


def regulator(pieces: list[Piece], count: int, effort: float, landing: float) -> tuple[np.ndarray, np.ndarray]:
    """The gains of `count` inputs, rows (count, a + count), where the rows of a smaller state have zeros between; and
    the matrix (d, d) of a cycle with them.

    effort, landing : weights of the squares of an input and of the gap

    Raises `NoOrbit` where the inputs do not reach what grows.
    """
    size, most = pieces[0].carry.shape[1], max(piece.carry.shape[1] for piece in pieces)
    cost, last = np.eye(size), np.inf
    for _ in range(REGULATOR.cycles):
        interrupts.heed()
        gains = np.zeros((count, most + count))
        weights = np.zeros((size + count, size + count))
        weights[:size, :size] = np.eye(size) + cost
        for piece in reversed(pieces):
            a = piece.carry.shape[1]
            step = _step(piece, count)
            weights = step.T @ weights @ step
            if piece.gap is not None:
                weights[:a, :a] += landing * piece.gap.T @ piece.gap
            for i in reversed(piece.decides):
                place = a + i
                weights[place, place] += effort
                gain = weights[place] / weights[place, place]
                gain[place] = 0.0
                gains[i, :a], gains[i, most:] = gain[:a], gain[a:]
                decision = np.eye(a + count)
                decision[place] = -gain
                weights = decision.T @ weights @ decision
        cost = 0.5 * (weights + weights.T)[:size, :size]
        if abs((largest := np.abs(cost).max()) - last) <= REGULATOR.settled * largest:
            return gains, cycle_with(pieces, gains)
        if largest > REGULATOR.largest_cost:
            break
        last = largest
    raise NoOrbit("the input does not affect every growing change, so no feedback with it holds the cycle")


def cycle_with(pieces: list[Piece], gains: np.ndarray) -> np.ndarray:
    """The matrix (d, d) of a cycle with gains of its inputs, as `regulator` returns them."""
    count, size = len(gains), pieces[0].carry.shape[1]
    most, matrix = gains.shape[1] - count, np.eye(size + count, size)
    for piece in pieces:
        a = piece.carry.shape[1]
        for i in piece.decides:
            matrix[a + i] = -gains[i, :a] @ matrix[:a] - gains[i, most:] @ matrix[a:]
        matrix = _step(piece, count) @ matrix
    return matrix[:size]


def landing_softly(gains: np.ndarray, slopes: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Gains with those of the first inputs changed the least for which what should vanish at a landing does.

    slopes, inputs : (m, n) and (m, k), of that by the state by which k inputs are decided at once, and by these
    """
    count, found, k = len(gains), gains.copy(), inputs.shape[1]
    most, inverse = gains.shape[1] - count, np.linalg.pinv(inputs)
    own = np.linalg.solve(np.eye(k) + gains[:k, most : most + k], gains[:k, :most])
    found[:k, :most] = own - inverse @ (inputs @ own) + inverse @ slopes
    found[:k, most:] = 0.0
    return found


def _step(piece: Piece, count: int) -> np.ndarray:
    """The matrix (b + count, a + count) of a piece on states with inputs."""
    b, a = piece.carry.shape
    step = np.zeros((b + count, a + count))
    step[:b, :a], step[b:, a:] = piece.carry, np.eye(count)
    if piece.effect is not None:
        step[:b, a + piece.acts] = piece.effect
    return step
