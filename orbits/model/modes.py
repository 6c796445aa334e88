"""The exact flow of a linear mechanism by its vibration modes, with nothing integrated.

The n coordinates y of M y'' = -K y + f, with M, K and f constant, are sums of n modes that move independently. A mode
of squared frequency omega^2 > 0 swings about a centre; one that no spring resists, with omega = 0, is thrown with a
constant acceleration; and one with omega^2 < 0, as a pendulum upside down, is pushed away from its centre. States are
(y1, y1', y2, y2', ...).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..io import one_line


class ModeOptions(NamedTuple):
    """What is 0 among modes, and how far they are followed."""

    # A squared frequency below this share of the largest one is 0: eigenvalues come with an error of a few roundings,
    # 2e-16, of the largest one. One period of a mode as slow as that is 3e6 of the fastest.
    slowest_square: float = 1e-13
    clearly: float = 0.99  # a bound that holds until a time is only used for this share of it, far from rounding
    # A quantity that rises from a zero for so long, in radians of the fastest mode, is by then far above rounding.
    shortest_rise: float = 0.5
    # When a mode that is pushed away has grown by the exponential of this, its motion has run away from any start.
    farthest_pushed: float = 300.0


MODES = ModeOptions()


@dataclass(frozen=True, eq=False)
class Modes:
    """The flow of a linear mechanism as modes q, with y = shapes @ q and q'' = loads - squares * q.

    squares : (n,) squared angular frequencies: first the zeros, of modes without a restoring force ("thrown"), then the
        others, ascending; below 0 for unstable modes
    shapes : (n, n), the modes as columns
    apart : (n, n), the inverse of `shapes`, given because a numerical inverse would have rounding errors
    loads : (n,) the accelerations of the modes at q = 0
    watch : for each watched quantity, which is affine, the weights (2n,) of the states and its value where these are 0
    """

    squares: np.ndarray
    shapes: np.ndarray
    apart: np.ndarray
    loads: np.ndarray
    watch: Mapping[str, tuple[ArrayLike, float]] = field(default_factory=dict)

    def __repr__(self) -> str:
        return one_line(self, {"squares": self.squares.tolist(), "watch": tuple(self.watch)})

    @property
    def square(self) -> float:
        """The largest squared frequency of a mode, or squared rate of growth."""
        return float(np.abs(self.squares).max())

    @cached_property
    def thrown(self) -> int:
        """The number of thrown modes."""
        return int(np.count_nonzero(self.squares == 0.0))

    @cached_property
    def rates(self) -> np.ndarray:
        """Rates of growth of the unstable modes, then angular frequencies of the oscillating modes."""
        return np.sqrt(np.abs(self.squares[self.thrown :]))

    @cached_property
    def pushed(self) -> int:
        """The number of unstable modes."""
        return int(np.count_nonzero(self.squares < 0.0))

    def _circular(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """cos and sin of rates times times (s, ...), of the modes that are pushed away cosh and sinh."""
        c, s, k = np.cos(angles), np.sin(angles), self.pushed
        if k:
            grown = np.clip(angles[:k], -MODES.farthest_pushed, MODES.farthest_pushed)
            c[:k], s[:k] = np.cosh(grown), np.sinh(grown)
        return c, s

    @cached_property
    def centres(self) -> np.ndarray:
        """Mode coordinates about which the modes oscillate, or from which they move away."""
        return self.loads[self.thrown :] / self.squares[self.thrown :]

    def state(self, start: ArrayLike, t: float | np.ndarray) -> np.ndarray:
        """States (2n, ...) at times `t` (...) after `start`, (2n,) or (2n, ...)."""
        w, rise, x, v = self._moved(start, t)
        states = np.empty((2 * len(self.squares), x.shape[1]))
        states[::2] = self.shapes[:, self.thrown :] @ (x + self.centres[:, None])
        states[1::2] = self.shapes[:, self.thrown :] @ v
        if self.thrown:
            states[::2] += self.shapes[:, : self.thrown] @ w
            states[1::2] += self.shapes[:, : self.thrown] @ rise
        return states.reshape(len(states), *(np.shape(t) or np.shape(start)[1:]))

    def transition(self, t: float) -> np.ndarray:
        """Transition matrix (2n, 2n): the derivative of the state at time `t` with respect to the start."""
        angles, k, n = self.rates * t, self.thrown, len(self.squares)
        c, s = self._circular(angles)
        s = s / self.rates
        if k:
            c, s = np.append(np.ones(k), c), np.append(np.full(k, t), s)
        matrix = np.empty((2 * n, 2 * n))
        matrix[::2, ::2] = matrix[1::2, 1::2] = self.shapes * c @ self.apart
        matrix[::2, 1::2] = self.shapes * s @ self.apart
        matrix[1::2, ::2] = self.shapes * (-self.squares * s) @ self.apart
        return matrix

    def along(self, weights: ArrayLike, start: ArrayLike, t: float | np.ndarray, order: int) -> np.ndarray:
        """Taylor coefficients (N, order + 1) of weights . (state, watched ...) about N times `t` (...) after `start`,
        (2n,) or (2n, ...)."""
        output = self._output(weights, start, t)
        c = np.concatenate([output.even, output.odd]).T @ np.concatenate(self._alternating(order))
        c[:, 0] += output.base
        c[:, 1] += output.slope
        c[:, 2] -= 0.5 * output.fall
        return c

    def series(self, start: ArrayLike, t: float | np.ndarray, order: int) -> np.ndarray:
        """Taylor coefficients (N, 2n + watched, order + 1) of (state, watched ...) about N times `t` (...) after
        `start`, (2n,) or (2n, ...)."""
        size, k, (even, odd) = 2 * len(self.squares), self.thrown, self._alternating(order + 1)
        w, rise, x, v = self._moved(start, t)
        q = np.empty((x.shape[1], len(self.squares), order + 2))
        q[:, k:] = x.T[:, :, None] * even + v.T[:, :, None] * odd
        q[:, k:, 0] += self.centres
        if k:
            q[:, :k, 0], q[:, :k, 1], q[:, :k, 2], q[:, :k, 3:] = w.T, rise.T, 0.5 * self.loads[:k], 0.0
        y = self.shapes @ q
        rows = np.empty((len(q), size + len(self.watch), order + 1))
        rows[:, :size:2], rows[:, 1:size:2] = y[:, :, :-1], y[:, :, 1:] * np.arange(1, order + 2)
        for i, (slopes, value) in enumerate(self.watch.values(), start=size):
            rows[:, i] = np.asarray(slopes) @ rows[:, :size]
            rows[:, i, 0] += value
        return rows

    def positive_between(self, quantity: Any, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times (m,) between which an affine quantity, of `weights` and `offset`, is positive on motions from `starts`
        (2n, m), for any phases of the modes: the sum of their amplitudes is less than the height of the thrown part's
        parabola. The times are infinity and 0 where nothing is known, for example with an unstable mode."""
        if self.pushed:
            return np.full(starts.shape[1], np.inf), np.zeros(starts.shape[1])
        output = self._output(quantity.weights, starts)
        return output.above(self._amplitudes(output).sum(0) - quantity.offset)

    def positive_until(self, quantity: Any, starts: np.ndarray, order: int) -> np.ndarray:
        """Times (m,) until which an affine quantity is known to be positive on motions from `starts` (2n, m), where it
        has a zero of this order, from 1 to 3, and is positive at first; 0 where nothing is known.

        With d its derivative of this order at the start, and -bound a lower bound of the next one, the quantity is at
        least t^order (d - bound t / (order + 1)) / order!. `positive_between` may continue from there.
        """
        if self.pushed:
            return np.zeros(starts.shape[1])
        output = self._output(quantity.weights, starts)
        amplitudes = self._amplitudes(output)
        rises, falls = output.above(amplitudes.sum(0) - quantity.offset)
        d = (-self.squares[self.thrown :]) ** (order // 2) @ (output.odd if order % 2 else output.even)
        d += (output.slope, -output.fall, 0.0)[order - 1]
        bound = self.rates ** (order + 1) @ amplitudes + (max(output.fall, 0.0) if order == 1 else 0.0)
        with np.errstate(all="ignore"):
            until = (order + 1) * d / bound
            until = np.where((rises < falls) & (rises < MODES.clearly * until), np.maximum(until, falls), until)
        return np.where(until > MODES.shortest_rise / np.sqrt(self.square), until, 0.0)

    def _modes(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates and speeds (k, N) of the thrown modes, and of the others, counted from their centres, in states
        (2n, N)."""
        q, u, k = self.apart @ states[::2], self.apart @ states[1::2], self.thrown
        return q[:k], u[:k], q[k:] - self.centres[:, None], u[k:]

    def _moved(self, start: ArrayLike, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The modes as from `_modes` at N times `t` (...) after `start`, (2n,) or (2n, ...)."""
        start, k = np.asarray(start), self.thrown
        flat, tail = start.reshape(len(start), math.prod(start.shape[1:])), start.shape[1:]
        w, rise, x, v = self._modes(flat)
        pull, omega = self.loads[:k, None], self.rates[:, None]
        if many := len(tail) > 1:  # one column for each motion, whose times are further axes
            w, rise, x, v = (values.reshape(len(values), *tail) for values in (w, rise, x, v))
            pull, omega = (values.reshape(len(values), *(1,) * len(tail)) for values in (pull, omega))
        angles, own = omega * t, slice(None, self.pushed)
        c, s = self._circular(angles)
        turned = x * (omega * s)
        turned[own] = -turned[own]
        x, v = x * c + v * (s / omega), v * c - turned
        if k:
            w, rise = w + t * (rise + 0.5 * t * pull), rise + t * pull
        if many:
            w, rise, x, v = (values.reshape(len(values), math.prod(x.shape[1:])) for values in (w, rise, x, v))
        return w, rise, x, v

    def _output(self, weights: ArrayLike, start: ArrayLike, t: float | np.ndarray | None = None) -> "_Output":
        """weights . (state, watched ...) at N times `t` (...) after `start`, (2n,) or (2n, ...)."""
        size, k, weights = 2 * len(self.squares), self.thrown, np.asarray(weights, dtype=float)
        own, offset = weights[:size], 0.0
        for share, (slopes, value) in zip(weights[size:], self.watch.values(), strict=False):
            own, offset = own + share * np.asarray(slopes), offset + share * value
        at_q, at_u = own[::2] @ self.shapes, own[1::2] @ self.shapes
        w, rise, x, v = self._modes(np.asarray(start)) if t is None else self._moved(start, t)
        pull, at_x, at_v = self.loads[:k], at_q[k:, None], at_u[k:, None]
        return _Output(
            even=at_x * x + at_v * v,
            odd=at_x * v - at_v * self.squares[k:, None] * x,
            base=at_q[:k] @ w + at_u[:k] @ rise + (at_q[k:] @ self.centres + offset),
            slope=at_q[:k] @ rise + at_u[:k] @ pull,
            fall=-float(at_q[:k] @ pull),
        )

    def _amplitudes(self, output: "_Output") -> np.ndarray:
        """Amplitudes (s, N) of the modes that swing in an output."""
        return np.hypot(output.even, output.odd / self.rates[:, None])

    def _alternating(self, order: int) -> np.ndarray:
        """Taylor coefficients (2, s, order + 1) of cos(omega t) and sin(omega t) / omega, or cosh and sinh."""
        halves, factors = _even_and_odd(order)
        return (-self.squares[self.thrown :, None]) ** halves * factors


@cache
def _even_and_odd(order: int) -> tuple[np.ndarray, np.ndarray]:
    """The halves (order + 1,) of the exponents, rounded down, and 1/k! (2, 1, order + 1) of the even and of the odd."""
    k = np.arange(order + 1)
    return k // 2, np.stack([k % 2 == 0, k % 2 == 1])[:, None] / np.cumprod(np.maximum(k, 1.0))


class _Output(NamedTuple):
    """A linear function of the motion about N times, split up by the modes.

    even, odd : (s, N), the shares of the modes that swing in the value and in the derivative
    base, slope, fall : (N,), (N,) and a number, of the others together: base + slope t - fall t^2 / 2
    """

    even: np.ndarray
    odd: np.ndarray
    base: np.ndarray
    slope: np.ndarray
    fall: float

    def above(self, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times (N,) between which base + slope t - fall t^2 / 2 is above a level (N,); infinity and 0 for none."""
        base, slope, fall = self.base - level, self.slope, self.fall
        with np.errstate(all="ignore"):
            # The roots are computed without a difference of two like numbers.
            root = np.sqrt(slope**2 + 2 * fall * base)
            first = np.where(slope > 0, -2 * base / (slope + root), (slope - root) / fall)
            last = np.where(slope > 0, (slope + root) / fall, -2 * base / (slope - root))
        if fall > 0:
            known = np.isfinite(root)
            return np.where(known, first, np.inf), np.where(known, last, 0.0)
        for_ever = (slope > 0) | ((slope == 0) & (base > 0))
        return np.where(for_ever, np.where(base > 0, 0.0, first), np.inf), np.where(for_ever, np.inf, 0.0)


def single_mode(square: float, load: float, watch: Mapping[str, tuple[ArrayLike, float]] | None = None) -> Modes:
    """The mode of y'' = load - square * y, with `watch` as in `Modes`; raises `InputError` where it does not swing."""
    if not square > 0:
        raise InputError("the stiffness is positive in no direction: without a spring no mode oscillates")
    return Modes(np.array([square]), np.eye(1), np.eye(1), np.array([load]), watch or {})


def linear_modes(
    inertia: ArrayLike,
    stiffness: ArrayLike,
    load: ArrayLike,
    watch: Mapping[str, tuple[ArrayLike, float]] | None = None,
) -> Modes:
    """The modes of M y'' = -K y + f.

    inertia : M (n, n), symmetric and positive definite
    stiffness : K (n, n), symmetric
    load : f (n,)
    watch : as in `Modes`

    Unstable modes are allowed. Raises `InputError` for matrices without these properties, and where no mode oscillates.

    >>> from orbits.model import linear_modes
    >>> modes = linear_modes([[1.0]], [[4.0]], [0.0])
    >>> modes.rates.tolist()  # of one mass on a spring
    [2.0]
    """
    m, k, f = (np.array(values, dtype=float) for values in (inertia, stiffness, load))
    if f.ndim != 1 or not f.size or m.shape != k.shape or m.shape != 2 * f.shape:
        shapes = f"{m.shape}, {k.shape} and {f.shape}"
        raise InputError(f"inertia, stiffness and load have shapes {shapes}; they must be (n, n), (n, n) and (n,)")
    if not np.isfinite(f).all():
        raise InputError(f"the load is not finite: {f.tolist()}")
    for name, matrix in (("inertia", m), ("stiffness", k)):
        if not np.abs(matrix - matrix.T).max() <= MODES.slowest_square * np.abs(matrix).max():
            raise InputError(f"the {name} is not a symmetric matrix of finite numbers")
    if f.size == 1 and m[0, 0] > 0:
        return single_mode(k[0, 0] / m[0, 0], f[0] / m[0, 0], watch)
    try:
        root = np.linalg.cholesky(m)
    except np.linalg.LinAlgError:
        raise InputError("the inertia is not positive definite: some motion has no kinetic energy") from None
    inverse = np.linalg.inv(root)
    # SciPy solves the generalised problem in the same way, but takes long to import.
    squares, turned = np.linalg.eigh(inverse @ k @ inverse.T)
    if not squares[-1] > 0:
        raise InputError("the stiffness is positive in no direction: without a spring no mode oscillates")
    squares = np.where(np.abs(squares) > MODES.slowest_square * np.abs(squares).max(), squares, 0.0)
    if squares[0] < 0:
        thrown_first = np.argsort(squares != 0.0, kind="stable")
        squares, turned = squares[thrown_first], turned[:, thrown_first]
    shapes = inverse.T @ turned
    return Modes(squares, shapes, turned.T @ root.T, f @ shapes, watch or {})
