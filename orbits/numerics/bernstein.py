"""Roots of polynomials on an interval by Bernstein exclusion, which cannot skip a grazing pair of roots.

The Bernstein coefficients of a polynomial on [0, h] enclose its values, and their sign changes bound the number of
roots: none means none, one exactly one, and where there are more the interval is halved. Source: Farouki, "The
Bernstein polynomial basis: a centennial retrospective", CAGD 29 (2012).
"""

from collections.abc import Iterator
from functools import cache
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from .roots import CLOSED, MOST_ITERATIONS, Array

_Crossed = list[tuple[int, float]]
_Places = tuple[Array, Array, Array]

# Halving stops here: 2**-40 of a step is less than double precision can tell apart at a grazing pair.
MOST_HALVINGS = 40
# Up to this many roots are found faster one by one: a single root takes 20 microseconds, and 200 with arrays.
FEW = 6
# The size given to a zero that continues negative values, so that it has their sign; it is far below any rounding.
TINY = 1e-300
# From this many numbers on, their powers are computed faster by doubling the number of powers.
MANY = 200
# Newton's method ends where its next step, predicted from the last two, changes no digit of the root.
NEGLIGIBLE = 1e-17


@cache
def _to_bernstein(degree: int) -> np.ndarray:
    matrix, j = np.ones((degree + 1, degree + 1)), np.arange(degree + 1)
    for k in range(1, degree + 1):  # comb(j, k)/comb(degree, k)
        matrix[k] = matrix[k - 1] * np.maximum(j - k + 1, 0) / (degree - k + 1)
    return matrix


@np.errstate(over="ignore")  # a power beyond the largest number is infinite
def powers(t: ArrayLike, count: int) -> np.ndarray:
    """The powers t**0 ... t**(count - 1), (..., count), by multiplication, which is many times faster than `**`."""
    t = np.asarray(t, dtype=float)
    values = np.empty((*t.shape, count))
    if t.size < MANY:
        values[..., 0], values[..., 1:] = 1.0, t[..., None]
        return np.multiply.accumulate(values, axis=-1, out=values)
    values[..., 0], factor, done = 1.0, t[..., None], 1
    while done < count:  # the next powers are the known ones times one of them
        more = min(done, count - done)
        np.multiply(values[..., :more], factor, out=values[..., done : done + more])
        done += more
        factor = factor * factor if done < count else factor
    return values


def bernstein(coefficients: np.ndarray, of_h: np.ndarray) -> np.ndarray:
    """Bernstein coefficients on [0, h]; `coefficients` (..., K + 1) and the powers `of_h` (..., K + 1) broadcast."""
    matrix = _to_bernstein(coefficients.shape[-1] - 1)
    return coefficients @ (of_h[:, None] * matrix) if of_h.ndim == 1 else coefficients * of_h @ matrix


def evaluate(coefficients: np.ndarray, t: ArrayLike) -> np.ndarray:
    """Values at `t`; `coefficients` (..., K + 1) broadcast with `t` (...)."""
    return np.einsum("...k,...k", coefficients, powers(t, coefficients.shape[-1]))


def derivative(coefficients: np.ndarray) -> np.ndarray:
    """Coefficients of the derivative, (..., K)."""
    return coefficients[..., 1:] * np.arange(1, coefficients.shape[-1])


def shifted(coefficients: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Coefficients (N, n, K + 1) about t = h (N,) instead of 0."""
    exponents, factors = _binomial(coefficients.shape[-1])
    return np.einsum("nrj,njk->nrk", coefficients, powers(h, coefficients.shape[-1])[:, exponents] * factors)


@cache
def _binomial(count: int) -> tuple[np.ndarray, np.ndarray]:
    """The exponents j - k, or 0, of h and the factors (j over k) in the expansion of (t + h)**j."""
    factors = np.array([[float(comb(j, k)) for k in range(count)] for j in range(count)])
    return np.maximum(np.subtract.outer(np.arange(count), np.arange(count)), 0), factors


def roots(coefficients: np.ndarray, h: float) -> list[float]:
    """All roots in (0, h], ascending; 0 counts as positive, and a double root that rounding cannot separate is none."""
    values = bernstein(coefficients, powers(h, len(coefficients)))
    return [_refine(coefficients, h, *bracket) for bracket in _isolate(values, 0.0, 1.0, MOST_HALVINGS)]


def piecewise_roots(coefficients: Array, steps: Array, start: int = 0, rising: bool = False) -> _Crossed:
    """Roots (piece, time in it) of a continuous piecewise polynomial, in order, as of `PiecewisePolynomials.roots`."""
    return Crossings(start, rising)(coefficients, steps)


class Crossings:
    """Roots of a continuous piecewise polynomial that is given block after block.

    Where two blocks join, as where two pieces do, both sides have one sign, so that no root is lost or found twice.
    """

    def __init__(self, start: int = 0, rising: bool = False):
        self.start, self.rising = start, rising
        self.before: np.ndarray | None = None

    def __call__(self, coefficients: Array, steps: Array) -> _Crossed:
        """The roots (piece, time in it) of the next block, in order."""
        polynomial = PiecewisePolynomials(coefficients, steps, np.array([len(steps)]))
        _, pieces, times = polynomial.roots(self.start, self.rising, self.before)
        self.start, self.before = 0, polynomial.after
        return list(zip(pieces.tolist(), times.tolist(), strict=True))


def lowest(coefficients: np.ndarray, steps: np.ndarray) -> tuple[float, int, float]:
    """The least value of a piecewise polynomial, with the piece and the time in it where it is taken."""
    ((value,), (piece,), (t,)) = PiecewisePolynomials(coefficients, steps, np.array([len(steps)])).lowest()
    return float(value), int(piece), float(t)


class PiecewisePolynomials:
    """Several continuous piecewise polynomials at once, which takes hardly longer for twenty than for one.

    coefficients, steps : (N, K + 1) and (N,), of all pieces in order
    counts : (m,), the number of pieces of each polynomial
    of_steps : powers (N, K + 1) of the steps, or (K + 1,) where all have one length, or more of them, where they are
        known already
    after : the sign (m,) at the end of each, 1 or -1, once `roots` has been called
    """

    def __init__(self, coefficients: Array, steps: Array, counts: Array, of_steps: Array | None = None):
        self.coefficients, self.steps, size = coefficients, steps, coefficients.shape[1]
        self.of_steps = powers(steps, size) if of_steps is None else of_steps[..., :size]
        self.last = np.cumsum(counts) - 1
        self.first = self.last - counts + 1
        self.owner = np.repeat(np.arange(len(counts)), counts)

    def roots(self, start: ArrayLike = 0, rising: bool = False, before: Array | None = None) -> _Places:
        """All roots, in order: the polynomial (r,), the piece of it (r,), and the time in that piece (r,).

        start : the order of the zero at the very beginning of each, for all or (m,), which is divided out exactly
        rising : report only the roots where the sign goes from minus to plus
        before : the sign (m,) with which each is continued from an earlier block, or 0 where it begins here
        """
        orders = np.broadcast_to(start, self.first.shape) if np.any(start) else None
        values = self._control_values(orders, before)
        self.after = np.where(values[self.last, -1] >= 0, 1.0, -1.0)
        if not len(brackets := _brackets(values, rising)):
            return np.zeros(0, int), np.zeros(0, int), np.zeros(0)
        pieces = brackets[0].astype(int)
        owner, series = self.owner[pieces], self.coefficients[pieces]
        piece = pieces - self.first[owner]
        if orders is not None:
            series = _without_first_zero(series, np.where(piece == 0, orders[owner], 0))
        places = (series, self.steps[pieces], *brackets[1:])
        times = _refine_together(*places) if len(pieces) > FEW else np.array([*map(_refine, *places)])
        return owner, piece, times

    def first_roots(self, start: ArrayLike = 0, rising: bool = False, before: Array | None = None) -> _Places:
        """The first root of each polynomial that has one, as `roots` returns it."""
        owner, pieces, times = self.roots(start, rising, before)
        owner, first = np.unique(owner, return_index=True)
        return owner, pieces[first], times[first]

    def _control_values(self, orders: Array | None, before: Array | None) -> np.ndarray:
        """Bernstein coefficients (N, K + 1), of one sign on both sides of a joint: else rounding loses a root there."""
        values = bernstein(self.coefficients, self.of_steps)
        if orders is not None:
            of_steps = self.of_steps if self.of_steps.ndim == 1 else self.of_steps[self.first]
            values[self.first] = bernstein(_without_first_zero(self.coefficients[self.first], orders), of_steps)
        joint = self.owner[1:] == self.owner[:-1]
        values[:-1, -1] = np.where(joint, self.coefficients[1:, 0], values[:-1, -1])
        if before is not None:
            first = values[self.first, 0]
            continued = np.where(before * first < 0, before * np.abs(first), first)
            values[self.first, 0] = np.where((before < 0) & (first == 0), -TINY, continued)
        return values

    def lowest(self) -> _Places:
        """The least value (m,) of each polynomial, the piece (m,) and the time in it (m,) where it is taken."""
        values = bernstein(self.coefficients, self.of_steps)
        ends = np.einsum("Nk,Nk->N", self.coefficients, self.of_steps)
        least = np.minimum.reduceat(np.minimum(self.coefficients[:, 0], ends), self.first)
        lower = np.flatnonzero(values.min(1) < least[self.owner])  # pieces that may have a lower value inside
        slopes = PiecewisePolynomials(derivative(self.coefficients[lower]), self.steps[lower], np.ones(len(lower), int))
        owner, _, t = slopes.roots(rising=True)
        turns = lower[owner]
        pieces = np.concatenate([turns, *[np.arange(len(ends))] * 2])
        times = np.concatenate([t, self.steps, np.zeros(len(ends))])
        values = np.concatenate([evaluate(self.coefficients[turns], t), ends, self.coefficients[:, 0]])
        order = np.lexsort((values, self.owner[pieces]))  # the least of each first
        best = order[np.searchsorted(self.owner[pieces][order], np.arange(len(self.first)))]
        return values[best], pieces[best] - self.first, times[best]


def _without_first_zero(series: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Coefficients (m, K + 1), in place, of polynomials divided by t to the power of their orders (m,)."""
    for order in range(1, orders.max(initial=0) + 1):
        here = orders == order
        if here.any():
            series[here] = np.pad(series[here, order:], ((0, 0), (0, order)))
    return series


def _brackets(values: np.ndarray, rising: bool) -> list[np.ndarray]:
    """The roots of pieces with Bernstein coefficients `values` (N, K + 1), in order: the piece of each, and what
    `_isolate` gives, in columns (r,); no column where there is no root."""
    flat, size = values.ravel(), values.shape[1]
    positive = flat >= 0
    changes = np.flatnonzero(positive[1:] != positive[:-1])
    rows, j = np.divmod(changes, size)
    within = j < size - 1  # what else changes is between two pieces
    if not within.any():
        return []
    changes, rows, j = changes[within], rows[within], j[within]
    begins = np.append(True, rows[1:] != rows[:-1])  # where the changes of a piece begin
    alone = begins & np.append(begins[1:], True)
    several = rows[begins & ~alone]
    alone &= positive[changes + 1] | (not rising)
    changes, single, j = changes[alone], rows[alone], j[alone]
    before, after = flat[changes], flat[changes + 1]
    about = (j + before / (before - after)) / (size - 1)  # where the coefficients' polygon crosses zero
    columns = [single, np.zeros(len(j)), np.ones(len(j)), after >= 0, about]
    isolated: list[tuple] = []
    for i in several:
        found = _isolate(values[i], 0.0, 1.0, MOST_HALVINGS)
        isolated += [(i, *bracket) for bracket in found if bracket[2] or not rising]
    if isolated:
        columns = [np.append(a, b) for a, b in zip(columns, zip(*isolated, strict=True), strict=True)]
        order = np.lexsort((columns[1], columns[0]))
        columns = [column[order] for column in columns]
    return columns


def _isolate(values, low: float, high: float, depth: int) -> Iterator[tuple[float, float, bool, float]]:
    """The bracket (low, high) of each root, whether it rises, and where it is about, in shares of the interval."""
    positive = values >= 0
    changed = np.flatnonzero(positive[1:] != positive[:-1])
    if len(changed) == 1 or (depth == 0 and positive[0] != positive[-1]):
        j = changed[0]
        about = (j + values[j] / (values[j] - values[j + 1])) / (len(values) - 1)
        yield low, high, bool(positive[-1]), low + (high - low) * float(about)
    elif len(changed) and depth > 0:
        left, right = _halve(values)
        middle = 0.5 * (low + high)
        yield from _isolate(left, low, middle, depth - 1)
        yield from _isolate(right, middle, high, depth - 1)


def _halve(values):
    """De Casteljau's split at the middle."""
    left, right = np.empty_like(values), np.empty_like(values)
    for k in range(len(values)):
        left[k], right[-1 - k], values = values[0], values[-1], 0.5 * (values[1:] + values[:-1])
    return left, right


def _refine(coefficients, h, low, high, rising, t) -> float:
    """The root (in time) in a bracket (in shares of h) by Newton's method, or bisection where that leads out of it."""
    c = coefficients.tolist()
    low, high, t = (float(share * h) for share in (low, high, t))
    sign, last = 1.0 if rising else -1.0, 0.0
    for _ in range(MOST_ITERATIONS):
        value = slope = 0.0
        for a in reversed(c):
            slope = slope * t + value
            value = value * t + a
        low, high = (low, t) if sign * value >= 0 else (t, high)
        new = t - value / slope if slope else low
        step = abs(new - t)
        if min(step, high - low) <= CLOSED * high or (last and step * (step / last) ** 2 <= NEGLIGIBLE * high):
            return min(max(new, low), high)
        t, last = (new, step) if low < new < high else (0.5 * (low + high), 0.0)
    return t


def _refine_together(c, h, low, high, rising, t) -> np.ndarray:
    """`_refine` for several roots at once; c (m, K + 1), the others (m,)."""
    low, high, t, c = low * h, high * h, t * h, np.ascontiguousarray(c.T)
    sign, last = np.where(rising, 1.0, -1.0), np.zeros(len(t))
    for _ in range(MOST_ITERATIONS):
        value, slope = c[-1].copy(), np.zeros(len(t))
        for a in c[-2::-1]:
            slope *= t
            slope += value
            value *= t
            value += a
        above = sign * value >= 0
        low, high = np.where(above, low, t), np.where(above, t, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            new = t - value / slope
            step = np.abs(new - t)
            settled = (np.minimum(step, high - low) <= CLOSED * high) | (step * (step / last) ** 2 <= NEGLIGIBLE * high)
        inside = settled | ((low < new) & (new < high))
        if settled.all():
            return np.clip(new, low, high)
        t = np.where(inside, np.clip(new, low, high), 0.5 * (low + high))
        last = np.where(inside, step, 0.0)
    return t
