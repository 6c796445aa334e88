"""Flows in closed form: an oscillator, alone or beside a coordinate that is thrown up."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

# What holds until a time is only relied on for this share of the time, far from rounding.
CLEARLY = 0.99
# A quantity that bends upward for so long, in radians of the oscillation, is by then far above rounding.
SHORTEST_BEND = 0.5


@dataclass(frozen=True)
class Oscillator:
    """The flow of the phase x' = v, v' = -square (x - centre) with square > 0, in closed form.

    watch : slope and value at x = 0 of each watched quantity, which must be a straight line in x
    """

    square: float
    centre: float
    watch: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def state(self, start: Any, t: Any) -> np.ndarray:
        """States (2, ...) at times `t` (...) after `start`."""
        omega = np.sqrt(self.square)
        c, s = np.cos(omega * t), np.sin(omega * t)
        x, v = start[0] - self.centre, start[1]
        return np.array([self.centre + x * c + v / omega * s, v * c - omega * x * s])

    def transition(self, t: float) -> np.ndarray:
        """Transition matrix (2, 2): the derivative of the state at time `t` with respect to the start."""
        omega = np.sqrt(self.square)
        c, s = np.cos(omega * t), np.sin(omega * t)
        return np.array([[c, s / omega], [-omega * s, c]])

    def along(self, weights: Sequence[float], start: Any, t: Any, order: int) -> np.ndarray:
        """Taylor coefficients (N, order + 1) of weights . (x, v, watched ...) about N times `t` (...) after `start`."""
        at_x, at_v, *others = (*weights, *[0.0] * (2 + len(self.watch) - len(weights)))
        slopes, values = zip(*self.watch.values(), strict=True) if self.watch else ((), ())
        at_x += sum(a * slope for a, slope in zip(others, slopes, strict=True))
        # With every derivative x - centre and v exchange their roles.
        x, v = self.state(start, t).reshape(2, -1)
        x = x - self.centre
        even_odd = np.column_stack([at_x * x + at_v * v, at_x * v - at_v * self.square * x])
        k = np.arange(order + 1)
        factors = (-self.square) ** (k // 2) / np.cumprod(np.maximum(k, 1.0))
        c = even_odd @ (factors * [k % 2 == 0, k % 2 == 1])
        c[:, 0] += at_x * self.centre + sum(a * value for a, value in zip(others, values, strict=True))
        return c

    def series(self, states: np.ndarray, order: int) -> np.ndarray:
        """Taylor coefficients (N, 2 + watched, order + 1) of the motions through `states` (2, N)."""
        k = np.arange(order + 2)
        factors = (-self.square) ** (k // 2) / np.cumprod(np.maximum(k, 1.0))
        c = np.where(k % 2, states[1][:, None], states[0][:, None] - self.centre) * factors
        x, v = c[:, :-1], c[:, 1:] * k[1:]
        x[:, 0] = states[0]
        rows = [x, v]
        for slope, value in self.watch.values():
            rows.append(slope * x)
            rows[-1][:, 0] += value
        return np.stack(rows, axis=1)

    def positive_between(self, quantity: Any, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times (m,), none here, between which an affine quantity is known to be positive from `starts` (2, m)."""
        return np.full(starts.shape[1], np.inf), np.zeros(starts.shape[1])

    def positive_until(self, quantity: Any, starts: np.ndarray, order: int) -> np.ndarray:
        """Times (m,), none here, until which an affine quantity is known to be positive after a zero at the start."""
        return np.zeros(starts.shape[1])


@dataclass(frozen=True)
class ThrownOscillator:
    """The flow of an oscillator (x, v) beside a coordinate w that is thrown up under unit gravity, w'' = -1.

    The states of the phase are mix @ (x, v, w, w'), with `mix` (4, 4); `apart` is its inverse, stated since a numerical
    inverse would carry rounding errors.
    """

    oscillator: Oscillator
    mix: np.ndarray
    apart: np.ndarray
    watch: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def square(self) -> float:
        """The squared frequency of the oscillator."""
        return self.oscillator.square

    def state(self, start: Any, t: Any) -> np.ndarray:
        """States (4, ...) at times `t` (...) after `start` (4, ...)."""
        x, v, w, rate = np.tensordot(self.apart, start, 1)
        swung = self.oscillator.state((x, v), t)
        thrown = np.stack(np.broadcast_arrays(w + t * (rate - 0.5 * t), rate - t))
        return np.tensordot(self.mix, np.concatenate([swung, thrown]), 1)

    def transition(self, t: float) -> np.ndarray:
        """Transition matrix (4, 4): the derivative of the state at time `t` with respect to the start."""
        apart = np.eye(4)
        apart[:2, :2], apart[2, 3] = self.oscillator.transition(t), t
        return self.mix @ apart @ self.apart

    def along(self, weights: Sequence[float], start: Any, t: Any, order: int) -> np.ndarray:
        """Taylor coefficients (N, order + 1) of weights . state about N times `t` (...) after `start` (4, ...)."""
        x, v, w, rate = np.tensordot(self.apart, start, 1)
        at_x, at_v, at_w, at_rate = np.asarray(weights) @ self.mix
        c = self.oscillator.along((at_x, at_v), (x, v), t, order)
        c[:, 0] += (at_w * (w + t * (rate - 0.5 * t)) + at_rate * (rate - t)).ravel()
        c[:, 1] += (at_w * (rate - t) - at_rate).ravel()
        c[:, 2] -= 0.5 * at_w
        return c

    def series(self, states: np.ndarray, order: int) -> np.ndarray:
        """Taylor coefficients (N, 4, order + 1) of the motions through `states` (4, N)."""
        apart = np.tensordot(self.apart, states, 1)
        rows = np.zeros((apart.shape[1], 4, order + 1))
        rows[:, :2] = self.oscillator.series(apart[:2], order)[:, :2]
        rows[:, 2, 0], rows[:, 2, 1], rows[:, 2, 2] = apart[2], apart[3], -0.5
        rows[:, 3, 0], rows[:, 3, 1] = apart[3], -1.0
        return self.mix @ rows

    def positive_between(self, quantity: Any, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times (m,) between which an affine quantity, of `weights` and `offset`, is positive on motions from `starts`
        (4, m), whatever the oscillator does: its amplitude is less than the height of the thrown part's parabola."""
        x, v, w, rate = np.tensordot(self.apart, starts, 1)
        at_x, at_v, at_w, at_rate = np.asarray(quantity.weights) @ self.mix
        centre, omega = self.oscillator.centre, np.sqrt(self.square)
        with np.errstate(all="ignore"):
            amplitude = np.hypot(at_x, omega * at_v) * np.hypot(x - centre, v / omega)
            base = quantity.offset + at_x * centre + at_w * w + at_rate * rate - amplitude
            slope = at_w * rate - at_rate
            root = np.sqrt(slope**2 + 2 * at_w * base)
            known = np.isfinite(root) & (at_w > 0)
            return np.where(known, (slope - root) / at_w, np.inf), np.where(known, (slope + root) / at_w, 0.0)

    def positive_until(self, quantity: Any, starts: np.ndarray, order: int) -> np.ndarray:
        """Times (m,) until which an affine quantity is known to be positive on motions from `starts` (4, m), where it
        has a zero of this order, at least 1, and is positive at first; 0 where nothing is known.

        While the second derivative stays positive the quantity does, and `positive_between` may go on from there.
        """
        rises, falls = self.positive_between(quantity, starts)
        x, v = self.apart[:2] @ starts
        at_x, at_v, at_w, _ = np.asarray(quantity.weights) @ self.mix
        omega, x = np.sqrt(self.square), x - self.oscillator.centre
        # The second derivative is amplitude * cos(angle + omega t) - at_w.
        cosine, sine = -self.square * (at_x * x + at_v * v), omega * (at_x * v - at_v * self.square * x)
        with np.errstate(all="ignore"):
            bends = np.arccos(at_w / np.hypot(cosine, sine)) - np.arctan2(sine, cosine)
            positive = sine < 0 if order > 2 else cosine >= at_w
            joined = (rises < falls) & (omega * rises < CLEARLY * bends)
            until = np.maximum(bends / omega, np.where(joined, falls, 0.0))
            return np.where(positive & (bends > SHORTEST_BEND), until, 0.0)
