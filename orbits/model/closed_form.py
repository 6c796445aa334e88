"""Flows in closed form: an oscillator, alone or beside a coordinate that is thrown up."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Oscillator:
    """Closed form of the phase x' = v, v' = -square (x - centre), square > 0.

    watch : watched quantities, (slope, value at x = 0) of each, which must be straight lines in x
    """

    square: float
    centre: float
    watch: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def state(self, start, t):
        """States (2, ...) at times `t` (...) after `start`."""
        omega = np.sqrt(self.square)
        c, s = np.cos(omega * t), np.sin(omega * t)
        x, v = start[0] - self.centre, start[1]
        return np.array([self.centre + x * c + v / omega * s, v * c - omega * x * s])

    def transition(self, t):
        """Derivative (2, 2) of the state at `t` with respect to the start."""
        omega = np.sqrt(self.square)
        c, s = np.cos(omega * t), np.sin(omega * t)
        return np.array([[c, s / omega], [-omega * s, c]])

    def along(self, weights, states, order: int):
        """Taylor coefficients (N, order + 1) of weights . (x, v, watched ...), the motions through `states` (2, N)."""
        at_x, at_v, *others = (*weights, *[0.0] * (2 + len(self.watch) - len(weights)))
        slopes, values = zip(*self.watch.values(), strict=True) if self.watch else ((), ())
        at_x += sum(a * slope for a, slope in zip(others, slopes, strict=True))
        # x - centre and v exchange roles with every derivative
        x, v = states[0] - self.centre, states[1]
        even, odd = at_x * x + at_v * v, at_x * v - at_v * self.square * x
        k = np.arange(order + 1)
        factors = (-self.square) ** (k // 2) / np.cumprod(np.maximum(k, 1.0))
        c = np.where(k % 2, odd[:, None], even[:, None]) * factors
        c[:, 0] += at_x * self.centre + sum(a * value for a, value in zip(others, values, strict=True))
        return c

    def series(self, states, order: int):
        """Taylor coefficients (N, 2 + watched, order + 1) of the motions through `states` (2, N)."""
        k = np.arange(order + 2)
        factors = (-self.square) ** (k // 2) / np.cumprod(np.maximum(k, 1.0))
        c = np.where(k % 2, states[1][:, None], states[0][:, None] - self.centre) * factors
        v = c[:, 1:] * k[1:]
        x = c[:, :-1]
        x[:, 0] = states[0]
        rows = [x, v]
        for slope, value in self.watch.values():
            rows.append(slope * x)
            rows[-1][:, 0] += value
        return np.stack(rows, axis=1)


@dataclass(frozen=True)
class ThrownOscillator:
    """Closed form of an oscillator (x, v) beside a coordinate w thrown up under unit gravity, w'' = -1, both mixed into
    the states: state = mix @ (x, v, w, w').

    mix : (4, 4)
    apart : its inverse, both stated since inverting would round
    """

    oscillator: Oscillator
    mix: np.ndarray
    apart: np.ndarray
    watch: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    square = property(lambda self: self.oscillator.square)

    def state(self, start, t):
        """States (4, ...) at times `t` (...) after `start` (4, ...)."""
        x, v, w, rate = np.tensordot(self.apart, start, 1)
        swung = self.oscillator.state((x, v), t)
        thrown = np.stack(np.broadcast_arrays(w + t * (rate - 0.5 * t), rate - t))
        return np.tensordot(self.mix, np.concatenate([swung, thrown]), 1)

    def transition(self, t):
        """Derivative (4, 4) of the state at `t` with respect to the start."""
        apart = np.eye(4)
        apart[:2, :2], apart[2, 3] = self.oscillator.transition(t), t
        return self.mix @ apart @ self.apart

    def along(self, weights, states, order: int):
        """Taylor coefficients (N, order + 1) of weights . state on the motions through `states` (4, N)."""
        x, v, w, rate = np.tensordot(self.apart, states, 1)
        at_x, at_v, at_w, at_rate = np.asarray(weights) @ self.mix
        form = self.oscillator
        c = form.along((at_x, at_v), np.array([x, v]), order)
        c[:, 0] += at_w * w + at_rate * rate
        c[:, 1] += at_w * rate - at_rate
        c[:, 2] -= 0.5 * at_w
        return c

    def series(self, states, order: int):
        """Taylor coefficients (N, 4, order + 1) of the motions through `states` (4, N)."""
        apart = np.tensordot(self.apart, states, 1)
        rows = np.zeros((apart.shape[1], 4, order + 1))
        rows[:, :2] = self.oscillator.series(apart[:2], order)[:, :2]
        rows[:, 2, 0], rows[:, 2, 1], rows[:, 2, 2] = apart[2], apart[3], -0.5
        rows[:, 3, 0], rows[:, 3, 1] = apart[3], -1.0
        return self.mix @ rows
