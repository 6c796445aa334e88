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
    powers = np.asarray(t)[..., None] ** _orders(coefficients.shape[-1])
    return np.einsum("...k,...k", coefficients, powers)


@cache
def _orders(count: int) -> np.ndarray:
    return np.arange(count)


def derivative(coefficients):
    """Coefficients of the derivative, (..., K)."""
    return coefficients[..., 1:] * _orders(coefficients.shape[-1])[1:]


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
    """Roots (piece, time in it) of a continuous piecewise polynomial, in order; arguments as in `Pile`."""
    return Pile([coefficients], [steps]).roots(start, rising)[0]


def lowest(coefficients, steps) -> tuple[float, int, float]:
    """Least value of a piecewise polynomial, with the piece and the time in it; arguments as in `Pile`."""
    return Pile([coefficients], [steps]).lowest()[0]


class Pile:
    """Several continuous piecewise polynomials, asked together: one takes hardly less time than twenty.

    coefficients (N, K + 1) and steps (N,) of each; N may differ
    """

    def __init__(self, coefficients: list, steps: list):
        counts = [len(h) for h in steps]
        self.count = len(counts)
        self.coefficients, self.steps = np.concatenate(coefficients), np.concatenate(steps)
        self.first = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(int)
        self.owner = np.repeat(np.arange(self.count), counts)

    def roots(self, start: int = 0, rising: bool = False) -> list[list[tuple[int, float]]]:
        """For each polynomial its roots (piece, time in it), in order.

        start : the order of a zero known to stand at the very beginning of each, divided out exactly and not reported
        rising : report only where the sign goes from minus to plus
        """
        series = self.coefficients.copy()
        if start:
            series[self.first, :-start] = self.coefficients[self.first, start:]
            series[self.first, -start:] = 0.0
        values = bernstein(series, self.steps)
        # At a joint both sides must agree on the sign, or rounding would lose a root there or find it twice.
        joint = self.owner[1:] == self.owner[:-1]
        values[:-1, -1] = np.where(joint, series[1:, 0], values[:-1, -1])
        positive = values >= 0
        found = []
        for i in np.flatnonzero(positive.any(1) & ~positive.all(1)):
            brackets: list[tuple] = []
            _isolate(values[i], 0.0, 1.0, MAX_DEPTH, brackets)
            found += [(i, *bracket) for bracket in brackets if bracket[2] or not rising]
        if len(found) > FEW:
            pieces, low, high, up, about = (np.array(column) for column in zip(*found, strict=True))
            times = _refine_together(series[pieces], self.steps[pieces], low, high, up, about)
        else:
            times = [_refine(series[i], self.steps[i], *bracket) for i, *bracket in found]
        answers: list[list[tuple[int, float]]] = [[] for _ in range(self.count)]
        for (i, *_), t in zip(found, times, strict=True):
            owner = self.owner[i]
            answers[owner].append((int(i - self.first[owner]), float(t)))
        return answers

    def lowest(self) -> list[tuple[float, int, float]]:
        """For each polynomial its least value, with the piece and the time in it."""
        starts, ends = self.coefficients[:, 0], evaluate(self.coefficients, self.steps)
        least = np.minimum(np.minimum.reduceat(starts, self.first), np.minimum.reduceat(ends, self.first))
        where = np.flatnonzero(bernstein(self.coefficients, self.steps).min(1) < least[self.owner])
        best: list = [None] * self.count
        for i in np.flatnonzero((starts == least[self.owner]) | (ends == least[self.owner]))[::-1]:
            owner = self.owner[i]
            at_start = starts[i] == least[owner]
            best[owner] = (float(least[owner]), int(i - self.first[owner]), 0.0 if at_start else float(self.steps[i]))
        if len(where):
            slopes = derivative(self.coefficients[where])
            for i, inside in zip(
                where, Pile(list(slopes[:, None]), list(self.steps[where, None])).roots(rising=True), strict=True
            ):
                for _, t in inside:
                    owner = self.owner[i]
                    best[owner] = min(
                        best[owner], (float(evaluate(self.coefficients[i], t)), int(i - self.first[owner]), t)
                    )
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
