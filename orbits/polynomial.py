"""Roots of polynomials on an interval by Bernstein exclusion: a grazing pair of roots cannot be skipped.

A polynomial is its coefficients c[0..K] of t**k on 0 <= t <= h. Its Bernstein coefficients on the interval enclose its
values, and their sign changes bound the number of roots: none, no root; one, exactly one; more, the interval is
halved. Source: Farouki, "The Bernstein polynomial basis: a centennial retrospective", CAGD 29 (2012).
"""

from functools import cache
from math import comb

import numpy as np

# Halving stops here: 2**-40 of a step is below what double precision can tell apart at a grazing pair.
MAX_DEPTH = 40


@cache
def _to_bernstein(degree: int) -> np.ndarray:
    matrix, j = np.ones((degree + 1, degree + 1)), np.arange(degree + 1)
    for k in range(1, degree + 1):  # comb(j, k)/comb(degree, k)
        matrix[k] = matrix[k - 1] * np.maximum(j - k + 1, 0) / (degree - k + 1)
    return matrix


def bernstein(coefficients, h):
    """Bernstein coefficients on [0, h]; `coefficients` (..., K + 1) and `h` (...) broadcast."""
    degree = coefficients.shape[-1] - 1
    return coefficients * np.asarray(h)[..., None] ** np.arange(degree + 1) @ _to_bernstein(degree)


def evaluate(coefficients, t):
    """Values at `t`; `coefficients` (..., K + 1) broadcast with `t` (...)."""
    powers = np.asarray(t)[..., None] ** np.arange(coefficients.shape[-1])
    return np.einsum("...k,...k", coefficients, powers)


def derivative(coefficients):
    """Coefficients of the derivative, (..., K)."""
    return coefficients[..., 1:] * np.arange(1, coefficients.shape[-1])


def shifted(coefficients, h):
    """Coefficients about t = h instead of 0; `coefficients` (N, n, K + 1), `h` (N,)."""
    degree = coefficients.shape[-1] - 1
    powers = np.asarray(h)[:, None, None] ** _lags(degree)
    return np.einsum("nrj,njk->nrk", coefficients, powers * _pascal(degree))


@cache
def _pascal(degree: int) -> np.ndarray:
    return np.array([[float(comb(j, k)) for k in range(degree + 1)] for j in range(degree + 1)])


@cache
def _lags(degree: int) -> np.ndarray:
    return np.maximum(np.subtract.outer(np.arange(degree + 1), np.arange(degree + 1)), 0)


def roots(coefficients, h: float) -> list[float]:
    """All roots in (0, h], ascending; a double root that rounding cannot separate is not reported.

    A value of 0 counts as positive.
    """
    values = bernstein(coefficients, h)
    found: list[tuple] = []
    _isolate(values, 0.0, 1.0, MAX_DEPTH, found)
    return [_refine(coefficients, h, *bracket) for bracket in found]


def piecewise_roots(coefficients, steps, start: int = 0, rising: bool = False) -> list[tuple[int, float]]:
    """Roots (piece, time in it) of a continuous piecewise polynomial; of the rising sign changes only, if asked.

    coefficients (N, K + 1), steps (N,); `start` is the order of a zero known to stand at the very beginning, which is
    divided out exactly and not reported.
    """
    series = np.array(coefficients)
    if start:
        series[0] = np.concatenate([series[0, start:], np.zeros(start)])
    values = bernstein(series, steps)
    # At a joint both sides must agree on the sign, or rounding would lose a root there or find it twice.
    values[:-1, -1] = series[1:, 0]
    positive = values >= 0
    found = []
    for i in np.flatnonzero(positive.any(1) & ~positive.all(1)):
        isolated: list[tuple] = []
        _isolate(values[i], 0.0, 1.0, MAX_DEPTH, isolated)
        found += [(int(i), _refine(series[i], steps[i], *bracket)) for bracket in isolated if bracket[2] or not rising]
    return found


def lowest(coefficients, steps) -> tuple[float, int, float]:
    """Least value of a piecewise polynomial, with the piece and the time in it; shapes as in `piecewise_roots`."""
    starts, ends = coefficients[:, 0], evaluate(coefficients, steps)
    best = min(
        (float(starts.min()), int(starts.argmin()), 0.0),
        (float(ends.min()), int(ends.argmin()), float(steps[ends.argmin()])),
    )
    for i in np.flatnonzero(bernstein(coefficients, steps).min(1) < best[0]):
        for t in roots(derivative(coefficients[i]), steps[i]):
            best = min(best, (float(evaluate(coefficients[i], t)), int(i), t))
    return best


def _isolate(values, low, high, depth, found):
    """Append (low, high, whether it rises, where about) of each root, all as shares of the interval."""
    positive = values >= 0
    changed = np.flatnonzero(positive[1:] != positive[:-1])
    changes, crosses = len(changed), positive[0] != positive[-1]
    if changes == 1 or (depth == 0 and crosses):
        j = changed[0]  # where the control polygon crosses, second order close to where the polynomial does
        about = (j + values[j] / (values[j] - values[j + 1])) / (len(values) - 1)
        found.append((low, high, bool(positive[-1]), low + (high - low) * float(about)))
    elif changes > 1 and depth > 0:
        left, right = _halve(values)
        middle = 0.5 * (low + high)
        _isolate(left, low, middle, depth - 1, found)
        _isolate(right, middle, high, depth - 1, found)


def _halve(values):
    """De Casteljau's split at the middle."""
    left, right = np.empty_like(values), np.empty_like(values)
    for k in range(len(values)):
        left[k], right[-1 - k] = values[0], values[-1]
        values = 0.5 * (values[1:] + values[:-1])
    return left, right


def _refine(coefficients, h, low, high, rising, t) -> float:
    """Newton's method kept inside the bracket, by bisection where it would leave it; all but the answer in shares of h.

    It ends when the next step, by the rate at which the last two have shrunk, is below rounding.
    """
    c = coefficients.tolist()
    low, high, t = (float(share * h) for share in (low, high, t))
    sign, last = 1.0 if rising else -1.0, 0.0
    for _ in range(200):
        value = slope = 0.0
        for a in reversed(c):
            slope = slope * t + value
            value = value * t + a
        if sign * value >= 0:
            high = t
        else:
            low = t
        new = t - value / slope if slope else low
        step = abs(new - t)
        if step <= 4.5e-16 * high or (last and step * (step / last) ** 2 <= 1e-17 * high):
            return min(max(new, low), high)
        if low < new < high:
            t, last = new, step
        else:
            t, last = 0.5 * (low + high), 0.0
    return t
