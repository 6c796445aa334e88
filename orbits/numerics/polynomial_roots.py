"""Roots of polynomials on an interval by Bernstein exclusion, which cannot skip a grazing pair of roots.

The Bernstein coefficients of a polynomial on [0, h] enclose its values, and their sign changes bound the number of
roots: none means none, one exactly one, and where there are more the interval is halved. Source: Farouki, "The
Bernstein polynomial basis: a centennial retrospective", CAGD 29 (2012).
"""

from functools import cache
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .exclusion import NEGLIGIBLE, TINY, refinement, sign_changes
from .roots import ROOTS, Array

_Crossed = list[tuple[int, float]]
_Places = tuple[Array, Array, Array]


class PolynomialOptions(NamedTuple):
    """When roots of polynomials are searched for one by one, and when together."""

    halvings: int = 40  # 2**-40 of a step is less than double precision can resolve at a grazing pair
    few_pieces: int = 100  # up to this many are searched faster without excluding most of them first
    # Up to this many are found faster one by one: one takes 15 microseconds, the call of a kernel 80.
    few_roots: int = 6
    rows_of_product: int = 1000  # of a matrix product
    many_numbers: int = 200  # from this many on, their powers are computed faster by doubling the number of powers


POLYNOMIALS = PolynomialOptions()


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
    if t.size < POLYNOMIALS.many_numbers:
        values = np.empty((*t.shape, count))
        values[..., 0], values[..., 1:] = 1.0, t[..., None]
        return np.multiply.accumulate(values, axis=-1, out=values)
    values, factor, done = np.ones((count, t.size)), t.ravel(), 1
    while done < count:  # the next powers are the known ones times one of them
        more = min(done, count - done)
        np.multiply(values[:more], factor, out=values[done : done + more])
        done += more
        factor = factor * factor if done < count else factor
    return np.ascontiguousarray(values.T).reshape(*t.shape, count)


def bernstein(coefficients: np.ndarray, of_h: np.ndarray) -> np.ndarray:
    """Bernstein coefficients on [0, h]; `coefficients` (..., K + 1) and the powers `of_h` (..., K + 1) broadcast."""
    matrix = _to_bernstein(coefficients.shape[-1] - 1)
    if of_h.ndim == 1:
        return coefficients @ (of_h[:, None] * matrix)
    terms = coefficients * of_h
    found, rows = np.empty_like(terms), POLYNOMIALS.rows_of_product
    # For more rows at a time the linear algebra wakes threads, which wait for the next product without rest.
    for first in range(0, len(terms), rows):
        np.matmul(terms[first : first + rows], matrix, out=found[first : first + rows])
    return found


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


def roots_within(coefficients: np.ndarray, h: float) -> list[float]:
    """All roots in (0, h], ascending; 0 counts as positive, and a double root that rounding cannot separate does not
    count."""
    brackets = _brackets(bernstein(coefficients, powers(h, len(coefficients)))[None], np.array([False]))[1:]
    return [_refine(coefficients, h, *bracket) for bracket in zip(*brackets, strict=True)]


def piecewise_roots(coefficients: Array, steps: Array, start: int = 0, rising: bool = False) -> _Crossed:
    """Roots (piece, time in it) of a continuous piecewise polynomial, in order, as of `PiecewisePolynomials.roots`."""
    return Crossings(start, rising)(coefficients, steps)


class Crossings:
    """Roots of a continuous piecewise polynomial that comes block after block.

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
    """Several continuous piecewise polynomials together, which takes hardly longer for twenty than for one.

    coefficients, steps : (N, K + 1) and (N,), of all pieces in order
    counts : (m,), the number of pieces of each polynomial
    """

    def __init__(self, coefficients: Array, steps: Array, counts: Array):
        self.coefficients, self.steps = coefficients, steps
        self.last = counts.cumsum() - 1
        self.first = self.last - counts + 1
        self.owner = np.arange(len(counts)).repeat(counts)
        self._ends = np.zeros(len(counts))
        self.rising = np.zeros(0, bool)  # whether each root (r,) rises, once `roots` has been called

    def roots(
        self,
        start: ArrayLike = 0,
        rising: ArrayLike = False,
        before: Array | None = None,
        stationary: ArrayLike = False,
    ) -> _Places:
        """All roots, in order: the polynomial (r,), the piece of it (r,), and the time in that piece (r,).

        start : the order of the zero at the very beginning of each, for all or (m,), which is divided out exactly
        rising : report only the roots where the sign goes from minus to plus, for all or (m,)
        before : the sign (m,) with which each is continued from an earlier block, or 0 where it begins here
        stationary : report the roots of the rate instead, for all or (m,)
        """
        if not len(self.steps):
            self._ends = self._ends if before is None else before
            return np.zeros(0, int), np.zeros(0, int), np.zeros(0)
        rises, by_rate = (self._of_pieces(each) for each in (rising, stationary))
        orders = np.zeros(len(self.steps))
        orders[self.first] = start
        which = np.arange(len(self.steps))
        if len(which) > POLYNOMIALS.few_pieces:
            which, self._ends = self._doubtful(orders, rises, by_rate, before)
        series, steps = self.series(which), self.steps[which]
        if (rated := by_rate[which]).any():
            series[rated, :-1], series[rated, -1] = derivative(series[rated]), 0.0
        series = _without_first_zero(series, orders[which])
        values = bernstein(series, powers(steps, series.shape[1]))
        self._join(values, which, by_rate, before)
        if not len(brackets := _brackets(values, rises[which])):
            return np.zeros(0, int), np.zeros(0, int), np.zeros(0)
        rows, *places = brackets
        self.rising = places[2]
        places = [series[rows], steps[rows], *places]
        times = _refine_together(*places) if len(rows) > POLYNOMIALS.few_roots else np.array([*map(_refine, *places)])
        pieces = which[rows]
        owner = self.owner[pieces]
        return owner, pieces - self.first[owner], times

    @property
    def after(self) -> Array:
        """The sign (m,) at the end of each, 1 or -1, once `roots` has been called."""
        return np.where(self._ends >= 0, 1.0, -1.0)

    def first_roots(self, start: ArrayLike = 0, rising: bool = False, before: Array | None = None) -> _Places:
        """The first root of each polynomial that has one, as `roots` returns it."""
        owner, pieces, times = self.roots(start, rising, before)
        first = np.append(True, owner[1:] != owner[:-1])[: len(owner)]  # `np.unique` imports masked arrays
        return owner[first], pieces[first], times[first]

    def _doubtful(self, orders: Array, rises: Array, by_rate: Array, before: Array | None) -> tuple[Array, Array]:
        """The pieces (k,) that may have a root, and the values (m,) at the ends."""
        begins, ends, changes = self.signs(orders, by_rate)
        begin, end = begins >= 0, ends >= 0
        start = self._starts(np.arange(len(self.steps)), by_rate + orders) >= 0
        if before is not None:
            start[self.first] = np.where(before == 0, start[self.first], before > 0)
        end[:-1], end[self.last] = start[1:], end[self.last]
        none = (start == begin) & (end == begin) & (changes == 0)
        falls_once = start & begin & ~end & (changes <= 1)
        return (~(none | (rises & falls_once))).nonzero()[0], ends[self.last]

    def series(self, which: Array, orders: slice = slice(None)) -> Array:
        """The coefficients (k, K + 1) of some pieces (k,), or those of some `orders`, as an array of their own."""
        return self.coefficients[:, orders][which]

    def signs(self, orders: Array, by_rate: Array) -> tuple[Array, Array, Array]:
        """Of each piece (N,), or its rate, without zeros of these orders at its start: values with the signs at its
        start and its end, and a bound on the changes of sign between them."""
        rest = (each[:, None] for each in (self.steps, orders, by_rate))
        begins, ends, changes = sign_changes(self.coefficients.shape[1])(self.coefficients, *rest)
        return begins[:, 0], ends[:, 0], changes[:, 0]

    def _join(self, values: Array, which: Array, by_rate: Array, before: Array | None) -> None:
        """Give the Bernstein coefficients (k, K + 1) of some pieces one sign on both sides of a joint: else rounding
        loses a root there."""
        owner = self.owner[which]
        ends = (which == self.last[owner]).nonzero()[0]
        own = values[ends, -1]
        following = np.minimum(which + 1, len(self.steps) - 1)
        values[:, -1] = self._starts(following, by_rate[following])
        values[ends, -1] = self._ends[owner[ends]] = own
        if before is not None:
            begins = which == self.first[owner]
            signs, own = before[owner[begins]], values[begins, 0]
            values[begins, 0] = np.where(signs == 0, own, signs * np.maximum(np.abs(own), TINY))

    def _of_pieces(self, values: ArrayLike) -> Array:
        """Values for all polynomials, or (m,), of each piece (N,)."""
        return values[self.owner] if isinstance(values, np.ndarray) else np.full(len(self.owner), values)

    def _starts(self, which: Array, orders: Array) -> Array:
        """Coefficients (k,) of some pieces (k,), of each that of its order (k,). They are rounded as in `series`, so
        that both sides of a joint have one sign, which machine code may round the other way."""
        values = np.empty(len(which))
        for order in range(int(orders.max(initial=0)) + 1):
            here = orders == order
            if here.any():
                values[here] = self.series(which[here], slice(order, order + 1))[:, 0]
        return values

    def lowest(self) -> _Places:
        """The least value (m,) of each polynomial, the piece (m,) and the time in it (m,) where it is taken."""
        of_steps = powers(self.steps, self.coefficients.shape[1])
        values = bernstein(self.coefficients, of_steps)
        ends = np.einsum("Nk,Nk->N", self.coefficients, of_steps)
        least = np.minimum.reduceat(np.minimum(self.coefficients[:, 0], ends), self.first)
        lower = (values.min(1) < least[self.owner]).nonzero()[0]  # pieces that may have a lower value inside
        alone = PiecewisePolynomials(self.coefficients[lower], self.steps[lower], np.ones(len(lower), int))
        owner, _, t = alone.roots(rising=True, stationary=True)
        turns = lower[owner]
        pieces = np.concatenate([turns, *[np.arange(len(ends))] * 2])
        times = np.concatenate([t, self.steps, np.zeros(len(ends))])
        values = np.concatenate([evaluate(self.coefficients[turns], t), ends, self.coefficients[:, 0]])
        order = np.lexsort((values, self.owner[pieces]))  # the least of each first
        best = order[np.searchsorted(self.owner[pieces][order], np.arange(len(self.first)))]
        return values[best], pieces[best] - self.first, times[best]


def _without_first_zero(series: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Coefficients (m, K + 1), in place, of polynomials divided by t to the power of their orders (m,)."""
    for order in range(1, int(orders.max(initial=0)) + 1):
        here = orders == order
        if here.any():
            series[here, :-order], series[here, -order:] = series[here, order:], 0.0
    return series


def _brackets(values: np.ndarray, rising: np.ndarray) -> list[np.ndarray]:
    """The roots of pieces with Bernstein coefficients `values` (N, K + 1), in order, in columns (r,): the piece; the
    bracket (low, high) in it, in shares of the interval; whether the root rises; and where it is about. No column is
    returned where there is no root. On pieces that are `rising` (N,), only rising roots count."""
    which, low, share, size, found = np.arange(len(values)), np.zeros(len(values)), 1.0, values.shape[1], []
    for halvings in range(POLYNOMIALS.halvings + 1):
        flat = values.ravel()
        positive = flat >= 0
        changes = (positive[1:] != positive[:-1]).nonzero()[0]
        changes = changes[changes % size < size - 1]  # not those between two pieces
        if not len(changes):
            break
        rows, j = np.divmod(changes, size)
        begins = np.ones(len(rows) + 1, bool)  # whether the changes of a piece begin there
        begins[1:-1] = rows[1:] != rows[:-1]
        here, several = begins[:-1] & begins[1:], rows[begins[:-1] & ~begins[1:]]
        if halvings == POLYNOMIALS.halvings:  # rounding has made several changes of one
            here = begins[:-1] & (positive[rows * size] != positive[rows * size + size - 1])
        here &= positive[changes + 1] | ~rising[which[rows]]
        changes, rows, j = changes[here], rows[here], j[here]
        before, after, begin = flat[changes], flat[changes + 1], low[rows]
        about = (j + before / (before - after)) / (size - 1)  # where the coefficients' polygon crosses zero
        found.append((which[rows], begin, begin + share, after >= 0, begin + share * about))
        if not len(several):
            break
        values, share = np.concatenate(_halve(values[several])), 0.5 * share
        which, low = np.tile(which[several], 2), np.append(low[several], low[several] + share)
    if len(found) < 2:
        return [*found[0]] if found and len(found[0][0]) else []
    columns = [np.concatenate(parts) for parts in zip(*found, strict=True)]
    order = np.lexsort((columns[1], columns[0]))
    return [column[order] for column in columns] if len(order) else []


def _halve(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """De Casteljau's split of Bernstein coefficients (m, K + 1) at the middle."""
    left, right = np.empty_like(values), np.empty_like(values)
    for k in range(values.shape[1]):
        left[:, k], right[:, -1 - k], values = values[:, 0], values[:, -1], 0.5 * (values[:, 1:] + values[:, :-1])
    return left, right


def _refine(coefficients, h, low, high, rising, t) -> float:
    """The root (in time) in a bracket (in shares of h) by Newton's method, or bisection where that leads out of it."""
    c = coefficients.tolist()
    low, high, t = float(low * h), float(high * h), float(t * h)
    sign, last, closed = 1.0 if rising else -1.0, 0.0, ROOTS.closed
    for _ in range(ROOTS.iterations):
        value = slope = 0.0
        for a in reversed(c):
            slope = slope * t + value
            value = value * t + a
        low, high = (low, t) if sign * value >= 0 else (t, high)
        new = t - value / slope if slope else low
        step = abs(new - t)
        if min(step, high - low) <= closed * high or (last and step * (step / last) ** 2 <= NEGLIGIBLE * high):
            return min(max(new, low), high)
        t, last = (new, step) if low < new < high else (0.5 * (low + high), 0.0)
    return t


def _refine_together(c, h, low, high, rising, t) -> np.ndarray:
    """`_refine` for several roots together; c (m, K + 1), the others (m,)."""
    z, data = np.zeros((len(t), 4)), np.empty((len(t), c.shape[1] + 1))
    z[:, 0], z[:, 1], z[:, 2] = t * h, low * h, high * h
    data[:, :-1], data[:, -1] = c, 2.0 * rising - 1.0
    return refinement(c.shape[1])(z, data).z[:, 0]
