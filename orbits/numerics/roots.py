"""Roots of functions of one variable. Our own, because importing a library's takes longer than what is solved."""

from collections.abc import Callable

import numpy as np

# Extrema are looked at so many times closer, each time with points at these shares of the cells beside them.
REFINEMENTS = 2
SHARES = np.arange(1, 8) / 8
# Changes between neighbours that are rounding and no extrema.
ROUNDING = 1e-13


def bracketed_root(
    function: Callable, a: float, b: float, fa: float, fb: float, enough: float = 0.0, width: float = 0.0
) -> float:
    """The root between a and b, where the function goes from fa to fb of opposite sign: bisection and secant (Dekker).

    Ends one secant step after a value of at most `enough`, with a bracket of a `width`, or at rounding.
    """
    if abs(fa) < abs(fb):
        a, b, fa, fb = b, a, fb, fa
    c, fc = a, fa  # a brackets with b, c is the previous b
    wider = 1.0
    for _ in range(200):
        least = max(2.3e-16 * max(abs(a), abs(b)), 0.5 * width)
        if fb == 0 or abs(a - b) <= 2 * least:
            break
        middle = 0.5 * (a + b)
        same = middle if abs(b - c) > 2 * wider * least else b  # so near to each other that it is rounding
        new = b - fb * (b - c) / (fb - fc) if fb != fc else same
        between = min(b, middle) < new < max(b, middle)
        if abs(fb) <= enough:
            return new if between else b
        new = new if between or new == b else middle
        if abs(new - b) < least:  # the secant has settled: step across the root, to close the bracket
            new = b + np.copysign(min(wider * least, abs(middle - b)), a - b)
            wider *= 2  # where rounding hides the root, the next step is longer
        c, fc = b, fb
        b, fb = new, function(new)
        if (fb > 0) == (fa > 0):
            a, fa = c, fc
        if abs(fa) < abs(fb):
            a, b, fa, fb = b, a, fb, fa
    return b


def resolved(function: Callable, grid, toward_zero: bool) -> tuple[np.ndarray, np.ndarray]:
    """A grid (n,) with more points beside the local extrema of a function of arrays, and the values there.

    function : may give NaN, beside which no extremum is looked for
    toward_zero : only where an extremum may pass zero unseen: no farther from it than from a neighbour's value
    """
    values = function(grid)
    for _ in range(REFINEMENTS):
        change = np.diff(values)
        turn = (
            np.flatnonzero((change[1:] * change[:-1] < 0) & (np.abs(change[1:]) + np.abs(change[:-1]) > ROUNDING)) + 1
        )
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


def enclosed_sign_changes(function: Callable, a, b, fa, fb) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Neighbouring numbers between a and b (m,) where functions change their sign, which go from fa to fb (m,), and
    their values there; where one jumps, it is across that.

    function : (places (k,), which of the functions (k,)) -> values (k,), 0 counts as positive
    Source: Chandrupatla, "A new hybrid quadratic/bisection algorithm", Adv. Eng. Software 28 (1997).
    """
    x1, x2, f1, f2 = (np.array(values, dtype=float) for values in (a, b, fa, fb))
    x3, f3, t = x2.copy(), f2.copy(), np.full(len(x1), 0.5)
    going = np.arange(len(x1))
    for _ in range(200):
        going = going[np.abs(x2[going] - x1[going]) > 4.5e-16 * np.abs(x1[going])]
        if not len(going):
            break
        i = going
        new = x1[i] + t[i] * (x2[i] - x1[i])
        value = function(new, i)
        same = (value >= 0) == (f1[i] >= 0)
        x3[i], f3[i] = np.where(same, x1[i], x2[i]), np.where(same, f1[i], f2[i])
        x2[i], f2[i] = np.where(same, x2[i], x1[i]), np.where(same, f2[i], f1[i])
        x1[i], f1[i] = new, value
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            least = 2.3e-16 * np.abs(new) / np.abs(x2[i] - x1[i])
            share, rise = (x1[i] - x2[i]) / (x3[i] - x2[i]), (f1[i] - f2[i]) / (f3[i] - f2[i])
            inverse = f1[i] / (f2[i] - f1[i]) * f3[i] / (f2[i] - f3[i])
            inverse += (x3[i] - x1[i]) / (x2[i] - x1[i]) * f1[i] / (f3[i] - f1[i]) * f2[i] / (f3[i] - f2[i])
        smooth = (rise**2 < share) & ((1 - rise) ** 2 < 1 - share) & np.isfinite(inverse)
        t[i] = np.clip(np.where(smooth, inverse, 0.5), np.minimum(least, 0.5), np.maximum(1 - least, 0.5))
    return x1, x2, f1, f2
