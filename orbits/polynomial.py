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
# So many roots are quicker found one by one.
FEW = 6


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
    """Roots (piece, time in it) of a continuous piecewise polynomial, coefficients (N, K + 1), steps (N,); in order.

    start, rising : as in `stacked_roots`
    """
    _, pieces, times = stacked_roots(coefficients[None], np.asarray(steps)[None], start, rising)
    return list(zip(pieces.tolist(), times.tolist(), strict=True))


def stacked_roots(coefficients, steps, start: int = 0, rising: bool = False):
    """Roots of several continuous piecewise polynomials: which (m,), the piece (m,), the time in it (m,); in order.

    coefficients (P, N, K + 1), steps (P, N)
    start : the order of a zero known to stand at the very beginning of each, divided out exactly and not reported
    rising : report only where the sign goes from minus to plus
    """
    series = np.array(coefficients)
    if start:
        series[:, 0, :-start] = series[:, 0, start:]
        series[:, 0, -start:] = 0.0
    values = bernstein(series, steps)
    # At a joint both sides must agree on the sign, or rounding would lose a root there or find it twice.
    values[:, :-1, -1] = series[:, 1:, 0]
    positive = values >= 0
    changes = positive[..., 1:] != positive[..., :-1]
    found = []
    for which, piece in np.argwhere(changes.any(-1)):
        brackets: list[tuple] = []
        _isolate(values[which, piece], 0.0, 1.0, MAX_DEPTH, brackets)
        found += [(which, piece, *bracket) for bracket in brackets if bracket[2] or not rising]
    if not found:
        return np.zeros(0, int), np.zeros(0, int), np.zeros(0)
    which, piece = (np.array(column) for column in list(zip(*found, strict=True))[:2])
    c, h = series[which, piece], np.asarray(steps)[which, piece]
    if len(found) > FEW:
        times = _refine_together(c, h, *(np.array(column) for column in list(zip(*found, strict=True))[2:]))
    else:
        times = np.array([_refine(c[k], h[k], *bracket[2:]) for k, bracket in enumerate(found)])
    return which, piece, times


def lowest(coefficients, steps) -> tuple[float, int, float]:
    """Least value of a piecewise polynomial, with the piece and the time in it; shapes as in `piecewise_roots`."""
    least, piece, time = stacked_lowest(coefficients[None], np.asarray(steps)[None])
    return float(least[0]), int(piece[0]), float(time[0])


def stacked_lowest(coefficients, steps):
    """Least values (P,), their pieces (P,) and times in them (P,); shapes as in `stacked_roots`."""
    everywhere = np.stack([coefficients[..., 0], evaluate(coefficients, steps)], axis=-1)
    count = len(everywhere)
    place = everywhere.reshape(count, -1).argmin(1)
    least, piece, at_end = everywhere.reshape(count, -1)[np.arange(count), place], place // 2, place % 2
    time = at_end * steps[np.arange(count), piece]
    which, where = np.nonzero(bernstein(coefficients, steps).min(-1) < least[:, None])
    if len(which):
        slopes, h = derivative(coefficients[which, where]), steps[which, where]
        inside, _, t = stacked_roots(slopes[:, None], h[:, None], rising=True)
        values = evaluate(coefficients[which[inside], where[inside]], t)
        for k in np.argsort(-values, kind="stable"):  # the least last
            if values[k] < least[which[inside[k]]]:
                i = which[inside[k]]
                least[i], piece[i], time[i] = values[k], where[inside[k]], t[k]
    return least, piece, time


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


def _refine_together(c, h, low, high, rising, t) -> np.ndarray:
    """`_refine` of several at once; c (m, K + 1), the others (m,)."""
    low, high, t = low * h, high * h, t * h
    sign, last = np.where(rising, 1.0, -1.0), np.zeros(len(t))
    k = np.arange(c.shape[1])
    slopes = derivative(c)
    for _ in range(200):
        powers = t[:, None] ** k
        value, slope = np.einsum("mk,mk->m", c, powers), np.einsum("mk,mk->m", slopes, powers[:, :-1])
        above = sign * value >= 0
        low, high = np.where(above, low, t), np.where(above, t, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            new = t - value / slope
            step = np.abs(new - t)
            settled = (step <= 4.5e-16 * high) | (step * (step / last) ** 2 <= 1e-17 * high)
        inside = settled | ((low < new) & (new < high))
        if settled.all():
            return np.clip(new, low, high)
        t = np.where(inside, np.clip(new, low, high), 0.5 * (low + high))
        last = np.where(inside, step, 0.0)
    return t
