"""Where a followed curve passes values of one of its components, between its points."""

import numpy as np

from ..errors import OrbitsError
from .corrector import correct_all
from .curve import Curve

# Between two points of a curve its interpolant is sampled at this many places.
PIECES = 8
# A solution further from the interpolant than this share of the points' distance may lie on another curve.
FARTHEST_SOLUTION = 0.3


def passings(
    curve: Curve, xs: np.ndarray, tangents: np.ndarray, place: int, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where a curve through points (m, n + 1) with tangents passes values (k,) of the component `place`: how far along
    the chain of points, from 0 to m - 1, the points there (q, n + 1), exact, and their tangents.

    The cubics between neighbours say about where. Where Newton's method does not lead from there to a point nearby, as
    where the curve touches a value, there is none.
    """
    at, _ = np.nonzero(xs[:, place, None] == values)
    found = [(at.astype(float), xs[at], tangents[at])]
    if len(xs) > 1:
        chords = np.linalg.norm(np.diff(xs, axis=0) / curve.size(xs[:-1]), axis=1)
        shares = (np.arange((len(xs) - 1) * PIECES + 1) / PIECES)[:-1]
        levels = np.append(_along_cubics(xs, tangents, chords, shares)[:, place], xs[-1, place])
        away = levels[:, None] - values
        pieces, which = np.nonzero(away[:-1] * away[1:] < 0)
        near = away[pieces, which]
        shares = (pieces + near / (near - away[pieces + 1, which])) / PIECES
        guesses = _along_cubics(xs, tangents, chords, shares)
        segments = shares.astype(int)
        found += _solved_in_halves(curve, guesses, place, values[which], tangents[segments], chords[segments], shares)
    where, points, directions = map(np.concatenate, zip(*found, strict=True))
    order = np.argsort(where, kind="stable")
    return where[order], points[order], directions[order]


def _along_cubics(xs: np.ndarray, tangents: np.ndarray, chords: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Points (q, n + 1) on the cubics between neighbours of a chain (m, n + 1), at shares (q,) from 0 to m - 1."""
    i = shares.astype(int)
    t, length = (shares - i)[:, None], chords[i, None]
    step = xs[i + 1] - xs[i]
    bend = t * (1 - t) * length * (tangents[i] * (1 - t) - tangents[i + 1] * t)
    return xs[i] + step * t**2 * (3 - 2 * t) + bend


def _solved_in_halves(
    curve: Curve, guesses: np.ndarray, place: int, values: np.ndarray, before: np.ndarray, chords: np.ndarray,
    shares: np.ndarray,
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:  # fmt: skip
    """The solutions near guesses (q, n + 1), in parts: their shares, points and tangents; halves are solved apart where
    the whole does not converge."""
    if not len(guesses):
        return []
    rows = np.zeros(guesses.shape)
    rows[:, place] = 1.0
    try:
        points = correct_all(curve, guesses, rows, values, before)
    except OrbitsError:
        if len(guesses) == 1:
            return []
        halves = [slice(0, len(guesses) // 2), slice(len(guesses) // 2, None)]
        own = guesses, values, before, chords, shares
        parts = [[each[half] for each in own] for half in halves]
        return [each for part in parts for each in _solved_in_halves(curve, part[0], place, *part[1:])]
    xs = points.xs.copy()
    xs[:, place] = values
    near = (np.abs(xs - guesses) / curve.size(guesses)).max(1) < FARTHEST_SOLUTION * chords
    return [(shares[near], xs[near], points.tangents[near])]
