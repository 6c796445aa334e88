"""Roots of polynomials on an interval by Bernstein exclusion: a grazing pair of roots cannot be skipped.

A polynomial is its coefficients c[0..K] of t**k on 0 <= t <= h. Its Bernstein coefficients on the interval enclose its
values, and their sign changes bound the number of roots: none, no root; one, exactly one; more, the interval is
halved. Source: Farouki, "The Bernstein polynomial basis: a centennial retrospective", CAGD 29 (2012).
"""

from functools import cache
from math import comb

import numpy as np

# Halving stops here: 2**-40 of a step is below what double precision can tell apart at a grazing pair.
MOST_HALVINGS = 40
# So many roots are quicker found one by one.
FEW = 6
# Stands for a zero that is the end of something negative.
TINY = 1e-300
# From so many numbers on their powers are quicker found by doubling.
MANY = 200


@cache
def _to_bernstein(degree: int) -> np.ndarray:
    matrix, j = np.ones((degree + 1, degree + 1)), np.arange(degree + 1)
    for k in range(1, degree + 1):  # comb(j, k)/comb(degree, k)
        matrix[k] = matrix[k - 1] * np.maximum(j - k + 1, 0) / (degree - k + 1)
    return matrix


def powers(t, count: int) -> np.ndarray:
    """t**0 ... t**(count - 1) (..., count) by multiplication, many times faster than by `**`."""
    t = np.asarray(t, dtype=float)
    values = np.empty((*t.shape, count))
    if t.size < MANY:
        values[..., 0], values[..., 1:] = 1.0, t[..., None]
        return np.multiply.accumulate(values, axis=-1, out=values)
    values[..., 0], factor, done = 1.0, t[..., None], 1
    while done < count:  # as many again, times a power
        more = min(done, count - done)
        np.multiply(values[..., :more], factor, out=values[..., done : done + more])
        done += more
        factor = factor * factor if done < count else factor
    return values


def bernstein(coefficients, h):
    """Bernstein coefficients on [0, h]; `coefficients` (..., K + 1) and `h` (...) broadcast."""
    return _bernstein(coefficients, powers(h, coefficients.shape[-1]))


def _bernstein(coefficients, of_h):
    """`bernstein` from the powers (..., K + 1) of h, or more of them."""
    count = coefficients.shape[-1]
    return coefficients * of_h[..., :count] @ _to_bernstein(count - 1)


def evaluate(coefficients, t):
    """Values at `t`; `coefficients` (..., K + 1) broadcast with `t` (...)."""
    return np.einsum("...k,...k", coefficients, powers(t, coefficients.shape[-1]))


@cache
def _orders(count: int) -> np.ndarray:
    return np.arange(count)


def derivative(coefficients):
    """Coefficients of the derivative, (..., K)."""
    return coefficients[..., 1:] * _orders(coefficients.shape[-1])[1:]


def shifted(coefficients, h):
    """Coefficients about t = h instead of 0; `coefficients` (N, n, K + 1), `h` (N,)."""
    degree = coefficients.shape[-1] - 1
    return np.einsum("nrj,njk->nrk", coefficients, powers(h, degree + 1)[:, _lags(degree)] * _pascal(degree))


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
    _isolate(values, 0.0, 1.0, MOST_HALVINGS, found)
    return [_refine(coefficients, h, *bracket) for bracket in found]


def piecewise_roots(coefficients, steps, start: int = 0, rising: bool = False) -> list[tuple[int, float]]:
    """Roots (piece, time in it) of a continuous piecewise polynomial, in order, as of `PiecewisePolynomials`."""
    return Crossings(start, rising)(coefficients, steps)


class Crossings:
    """Roots of a continuous piecewise polynomial that comes in blocks, each asked for in its turn; where two blocks
    join, as where two pieces do, both sides agree on the sign."""

    def __init__(self, start: int = 0, rising: bool = False):
        self.start, self.rising, self.before = start, rising, None

    def __call__(self, coefficients, steps) -> list[tuple[int, float]]:
        """Those (piece, time in it) of the next block, in order."""
        pile = PiecewisePolynomials(coefficients, steps, np.array([len(steps)]))
        _, pieces, times = pile.roots(self.start, self.rising, self.before)
        self.start, self.before = 0, pile.after
        return list(zip(pieces.tolist(), times.tolist(), strict=True))


def lowest(coefficients, steps) -> tuple[float, int, float]:
    """Least value of a piecewise polynomial, with the piece and the time in it."""
    ((value,), (piece,), (t,)) = PiecewisePolynomials(coefficients, steps, np.array([len(steps)])).lowest()
    return float(value), int(piece), float(t)


class PiecewisePolynomials:
    """Several continuous piecewise polynomials, asked together: one takes hardly less time than twenty.

    coefficients (N, K + 1) and steps (N,) of all pieces, `counts` (m,) of which belong to each in turn
    of_steps : powers (N, K + 1) of the steps or more, where they are known
    after : once its roots have been asked for, the sign (m,) at the end of each, 1 or -1
    """

    def __init__(self, coefficients, steps, counts, of_steps=None):
        self.coefficients, self.steps = coefficients, steps
        size = coefficients.shape[1]
        self.of_steps = powers(steps, size) if of_steps is None else of_steps[:, :size]
        self.last = np.cumsum(counts) - 1
        self.first = self.last - counts + 1
        self.owner = np.repeat(np.arange(len(counts)), counts)

    def roots(self, start=0, rising: bool = False, before=None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All roots, in order: which polynomial's (r,), the piece of it (r,), the time in that (r,).

        start : the order of a zero known to stand at the very beginning of each, divided out exactly and not reported;
            one for all or (m,)
        rising : report only where the sign goes from minus to plus
        before : the sign (m,) that each ended with, where it goes on from an earlier one; 0 where it begins
        """
        series = self.coefficients
        if np.any(start):
            series = series.copy()
            orders = np.broadcast_to(start, self.first.shape)
            for order in np.unique(orders[orders > 0]):
                first = self.first[orders == order]
                series[first, :-order] = self.coefficients[first, order:]
                series[first, -order:] = 0.0
        values = _bernstein(series, self.of_steps)
        # At a joint both sides must agree on the sign, or rounding would lose a root there or find it twice.
        joint = self.owner[1:] == self.owner[:-1]
        values[:-1, -1] = np.where(joint, series[1:, 0], values[:-1, -1])
        if before is not None:
            first = values[self.first, 0]
            values[self.first, 0] = np.where(before * first < 0, before * np.abs(first), first)
            values[self.first, 0] = np.where((before < 0) & (first == 0), -TINY, values[self.first, 0])
        self.after = np.where(values[self.last, -1] >= 0, 1.0, -1.0)
        positive = values >= 0
        changes = positive[:, 1:] != positive[:, :-1]
        several = np.count_nonzero(changes, axis=1)
        if not several.any():
            return np.zeros(0, int), np.zeros(0, int), np.zeros(0)
        single = np.flatnonzero((several == 1) & (positive[:, -1] | (not rising)))
        j = changes[single].argmax(1)  # where the control polygon crosses, second order close to the polynomial
        before, after = values[single, j], values[single, j + 1]
        about = (j + before / (before - after)) / (values.shape[1] - 1)
        columns = [single, np.zeros(len(j)), np.ones(len(j)), after >= 0, about]
        brackets: list[tuple] = []
        for i in np.flatnonzero(several > 1):
            found: list[tuple] = []
            _isolate(values[i], 0.0, 1.0, MOST_HALVINGS, found)
            brackets += [(i, *bracket) for bracket in found if bracket[2] or not rising]
        if brackets:
            columns = [np.append(a, b) for a, b in zip(columns, zip(*brackets, strict=True), strict=True)]
            order = np.lexsort((columns[1], columns[0]))
            columns = [column[order] for column in columns]
        pieces = columns[0].astype(int)
        if len(pieces) > FEW:
            times = _refine_together(series[pieces], self.steps[pieces], *columns[1:])
        else:
            each = zip(pieces, *columns[1:], strict=True)
            times = np.array([_refine(series[i], self.steps[i], *bracket) for i, *bracket in each])
        owner = self.owner[pieces]
        return owner, pieces - self.first[owner], times

    def lowest(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of each polynomial the least value (m,), the piece (m,) and the time in it (m,)."""
        pieces = np.arange(len(self.steps))
        values = _bernstein(self.coefficients, self.of_steps)
        ends = np.einsum("Nk,Nk->N", self.coefficients, self.of_steps)
        least = np.minimum.reduceat(np.minimum(self.coefficients[:, 0], ends), self.first)
        where = np.flatnonzero(values.min(1) < least[self.owner])
        inside = PiecewisePolynomials(derivative(self.coefficients[where]), self.steps[where], np.ones(len(where), int))
        owner, _, t = inside.roots(rising=True)
        turns = where[owner]
        pieces = np.concatenate([turns, pieces, pieces])
        times = np.concatenate([t, self.steps, np.zeros(len(ends))])
        values = np.concatenate([evaluate(self.coefficients[turns], t), ends, self.coefficients[:, 0]])
        order = np.lexsort((values, self.owner[pieces]))  # the least of each first
        best = order[np.searchsorted(self.owner[pieces][order], np.arange(len(self.first)))]
        return values[best], pieces[best] - self.first, times[best]


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

    It ends when the next step, by the rate at which the last two have shrunk, is below rounding, or the bracket is.
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
        if min(step, high - low) <= 4.5e-16 * high or (last and step * (step / last) ** 2 <= 1e-17 * high):
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
    slopes = derivative(c)
    for _ in range(200):
        places = powers(t, c.shape[1])
        value, slope = np.einsum("mk,mk->m", c, places), np.einsum("mk,mk->m", slopes, places[:, :-1])
        above = sign * value >= 0
        low, high = np.where(above, low, t), np.where(above, t, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            new = t - value / slope
            step = np.abs(new - t)
            settled = (np.minimum(step, high - low) <= 4.5e-16 * high) | (step * (step / last) ** 2 <= 1e-17 * high)
        inside = settled | ((low < new) & (new < high))
        if settled.all():
            return np.clip(new, low, high)
        t = np.where(inside, np.clip(new, low, high), 0.5 * (low + high))
        last = np.where(inside, step, 0.0)
    return t
