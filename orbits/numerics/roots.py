"""Roots of functions of one variable, and of linear systems; importing a library's root finders takes longer."""

from collections.abc import Callable, Generator
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray


class RootOptions(NamedTuple):
    """When searches for roots end, and where grids are refined."""

    refinements: int = 2  # of a grid near each extremum
    rounding: float = 1e-13  # smaller changes between neighbours are rounding and show no extremum
    unit: float = 2.3e-16  # rounding of a number, as a share of it, which a shorter step may not change
    closed: float = 4.5e-16  # share of its ends, two roundings, below which a bracket is closed
    steps_in_kernel: int = 8  # of Newton's method for an event in a step; where it does not settle, others search
    iterations: int = 200  # of a search, at most: bisection alone takes some 60 steps to close a bracket
    settling: float = 1e-6  # size of a last step of Newton's method, as a share of the largest place
    small_step: float = 1e-9  # of Newton's method for a system: a smaller step that no longer shrinks is rounding
    # Ratio of successive steps that no longer shrink: what is left is the rounding of the function, at any scale. Steps
    # towards a distant solution, in a motion that amplifies small changes, shrink by a half each: the ratio is larger.
    stalled_ratio: float = 0.7


ROOTS = RootOptions()
SHARES = np.arange(1, 8) / 8
# Where each call takes long whatever the number of places, an interval is cut at these shares at once.
SHARES_AT_ONCE = np.arange(1, 16) / 16
_Place = TypeVar("_Place")
_Value = TypeVar("_Value")
_Found = TypeVar("_Found")


def run_search(search: Generator[_Place, _Value, _Found], function: Callable[[_Place], _Value]) -> _Found:
    """The result of a search, a generator that yields places and is sent the values of the function there."""
    try:
        place = next(search)
        while True:
            place = search.send(function(place))
    except StopIteration as end:
        return end.value


def newton_root(step: Callable[[float], float], place: float, scale: float = 0.0) -> float | None:
    """The root of a function to which Newton's method, with these steps, leads from a place, up to the rounding of the
    function, which may be that of numbers of this scale; None where it does not settle."""
    largest, before = max(abs(place), scale), np.inf
    for _ in range(ROOTS.iterations):
        move = step(place)
        if not np.isfinite(move):
            return None
        place += move
        largest, size = max(largest, abs(place)), abs(move)
        if size <= ROOTS.unit * largest or ROOTS.settling * largest > size > ROOTS.stalled_ratio * before:
            return place
        before = size
    return None


def bracketed_root(
    function: Callable[[float], float], a: float, b: float, fa: float, fb: float, enough: float = 0, width: float = 0
) -> float:
    """The root of a function between a and b, as `root_search` finds it."""
    return run_search(root_search(a, b, fa, fb, enough, width), function)


def root_search(
    a: float, b: float, fa: float, fb: float, enough: float = 0, width: float = 0
) -> Generator[float, float, float]:
    """A search, as in `run_search`, for the root between a and b, where the function has the values fa, fb of opposite
    sign: bisection and secant.

    It ends one secant step after a value of at most `enough`, with a bracket of this `width`, or at rounding. Source:
    Dekker, "Finding a zero by means of successive linear interpolation" (1969).
    """
    if abs(fa) < abs(fb):
        a, b, fa, fb = b, a, fb, fa
    c, fc, wider = a, fa, 1.0  # b is the best point, a the other end of the bracket, c the previous b
    for _ in range(ROOTS.iterations):
        least = max(ROOTS.unit * max(abs(a), abs(b)), 0.5 * width)
        if fb == 0 or abs(a - b) <= 2 * least:
            break
        middle = 0.5 * (a + b)
        # Equal values at b and c are rounding where the points are close: then b stays, and the middle is not tried.
        same = middle if abs(b - c) > 2 * wider * least else b
        new = b - fb * (b - c) / (fb - fc) if fb != fc else same
        between = min(b, middle) < new < max(b, middle)
        if abs(fb) <= enough:
            return new if between else b
        new = new if between or new == b else middle
        if abs(new - b) < least:
            # The secant has settled: a step across the root closes the bracket. Where rounding hides the root this
            # fails, so that each such step is twice as long as the one before.
            new = b + np.copysign(min(wider * least, abs(middle - b)), a - b)
            wider *= 2
        c, fc, b, fb = b, fb, new, (yield new)
        if (fb > 0) == (fa > 0):
            a, fa = c, fc
        if abs(fa) < abs(fb):
            a, b, fa, fb = b, a, fb, fa
    return b


def resolved(function: Callable[[Array], Array], grid: Array, toward_zero: bool) -> tuple[Array, Array]:
    """A grid (n,) with more points near the local extrema of a function of arrays, and the values there.

    function : may give NaN; no extremum is seen next to one
    toward_zero : refine only where an extremum may cross zero unseen, that is where its value is not farther from zero
        than from a neighbour's value
    """
    values = function(grid)
    for _ in range(ROOTS.refinements):
        change = np.diff(values)
        turns = (change[1:] * change[:-1] < 0) & (np.abs(change[1:]) + np.abs(change[:-1]) > ROOTS.rounding)
        turn = np.flatnonzero(turns) + 1
        if toward_zero:
            reach = np.maximum(np.abs(change[turn - 1]), np.abs(change[turn]))
            turn = turn[(change[turn] * values[turn] > 0) & (np.abs(values[turn]) <= reach)]
        if not len(turn):
            break
        new = np.concatenate([grid[turn, None] + SHARES * (grid[turn + k] - grid[turn])[:, None] for k in (-1, 1)])
        new = np.setdiff1d(new, grid)
        grid, values = np.append(grid, new), np.append(values, function(new))
        order = np.argsort(grid)
        grid, values = grid[order], values[order]
    return grid, values


def enclosed_ends(holds: Callable[[Array, Array], Array], a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    """Neighbouring numbers (m,) from a to b, a < b: conditions hold at the first one, as at a, and not at the second
    one, as at b. In each step the first such part of an interval is taken.

    holds : (places (k,), which of the conditions (k,)) -> whether they hold (k,)
    """
    a, b = (np.array(ends, dtype=float) for ends in (a, b))
    going = np.arange(len(a))
    for _ in range(ROOTS.iterations):
        going = going[b[going] - a[going] > ROOTS.closed * np.abs(a[going])]
        if not len(going):
            break
        low, high = a[going, None], b[going, None]
        inside = low + SHARES_AT_ONCE * (high - low)
        held = holds(inside.ravel(), np.repeat(going, len(SHARES_AT_ONCE))).reshape(inside.shape)
        last = np.where(held.all(1), held.shape[1], np.argmin(held, axis=1))[:, None]
        places = np.hstack([low, inside, high])
        a[going], b[going] = (np.take_along_axis(places, last + side, 1)[:, 0] for side in (0, 1))
    return a, b


def enclosed_sign_changes(
    function: Callable[[Array, Array], Array], a: ArrayLike, b: ArrayLike, fa: ArrayLike, fb: ArrayLike
) -> tuple[Array, Array, Array, Array]:
    """Neighbouring numbers x1, x2 (m,) between a and b at which functions change sign, and their values f1, f2 there.

    Each function goes from fa to fb (m,), of opposite sign; where it jumps, the two numbers lie on both sides.

    function : (places (k,), which of the functions (k,)) -> values (k,); a value of 0 counts as positive
    Source: Chandrupatla, "A new hybrid quadratic/bisection algorithm", Adv. Eng. Software 28 (1997).
    """
    (x1, x2, _), (f1, f2, _) = _brackets_of_roots(function, a, b, fa, fb)
    return x1, x2, f1, f2


def estimated_roots(
    function: Callable[[Array, Array], Array], a: ArrayLike, b: ArrayLike, fa: ArrayLike, fb: ArrayLike,
    enough: ArrayLike,
) -> Array:  # fmt: skip
    """The roots (m,) of functions, as in `enclosed_sign_changes`, interpolated from values of at most `enough` (m,)."""
    places, values = _brackets_of_roots(function, a, b, fa, fb, enough)
    share, curved = _inverse_quadratic(places, values)
    with np.errstate(invalid="ignore"):  # the value at the other end may be infinite
        secant = np.where(np.isfinite(values[1]), values[0] / (values[0] - values[1]), 0.0)
    return places[0] + np.where(curved, share, secant) * (places[1] - places[0])


def _brackets_of_roots(
    function: Callable[[Array, Array], Array], a: ArrayLike, b: ArrayLike, fa: ArrayLike, fb: ArrayLike,
    enough: ArrayLike | None = None,
) -> tuple[Array, Array]:  # fmt: skip
    """Places and values (3, m): on both sides of the sign changes of functions, the first of them the latest, and the
    place before; once these are neighbouring numbers, or the latest value is at most `enough` (m,)."""
    x, f = (np.array([first, last, last], dtype=float) for first, last in ((a, b), (fa, fb)))
    t, small = np.full(x.shape[1], 0.5), np.full(x.shape[1], -1.0)  # a value of 0 ends no search for neighbours
    if enough is not None:
        small[:], t[:] = enough, np.where(np.isfinite(f[:2]).all(0), f[0] / (f[0] - f[1]), 0.5)
    going = np.arange(x.shape[1])
    for turn in range(ROOTS.iterations):
        going = going[np.abs(x[1, going] - x[0, going]) > ROOTS.closed * np.abs(x[0, going])]
        going = going[~(np.abs(f[0, going]) <= small[going])]
        if not len(going):
            break
        (x1, x2, _), (f1, f2, _) = x[:, going], f[:, going]
        if turn:
            share, curved = _inverse_quadratic(x[:, going], f[:, going])
            least = np.minimum(ROOTS.unit * np.abs(x1) / np.abs(x2 - x1), 0.5)
            t[going] = np.clip(np.where(curved, share, 0.5), least, 1 - least)
        new = x1 + t[going] * (x2 - x1)
        value = function(new, going)
        same = (value >= 0) == (f1 >= 0)
        x[:, going] = new, np.where(same, x2, x1), np.where(same, x1, x2)
        f[:, going] = value, np.where(same, f2, f1), np.where(same, f1, f2)
    return x, f


def _inverse_quadratic(x: Array, f: Array) -> tuple[Array, Array]:
    """The share (m,) of the way from the first places of x (3, m) to the second ones at which the inverse parabola
    through values f (3, m) vanishes, and whether it is monotonic between these (m,)."""
    (x1, x2, x3), (f1, f2, f3) = x, f
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        along, rise = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
        share = f1 / (f2 - f1) * f3 / (f2 - f3)
        share += (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        return share, (rise**2 < along) & ((1 - rise) ** 2 < 1 - along) & np.isfinite(share)


def solve(matrix: Array, right: Array) -> Array:
    """The solution of a square system (n, n) or of a stack of them (m, n, n); NaN, and no error, for a singular one.

    right : (n,) or (n, k); for a stack (m, n, k), or (1, n, k) where all have the same
    """
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        if matrix.ndim == 2:
            return np.full(np.shape(right), np.nan)
        sides = np.broadcast_to(right, (len(matrix), *np.shape(right)[-2:]))
        return np.array([solve(one, side) for one, side in zip(matrix, sides, strict=True)])
