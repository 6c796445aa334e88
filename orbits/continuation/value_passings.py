"""Where a followed curve passes values of one of its components, between its points."""

import numpy as np

from ..curves import Border, correct
from .curve import Curve
from .family_problem import FamilyProblem
from .step_control import Options

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
        excess = levels[:, None] - values
        pieces, which = np.nonzero(excess[:-1] * excess[1:] < 0)
        low, high = excess[pieces, which], excess[pieces + 1, which]
        shares = (pieces + low / (low - high)) / PIECES
        guesses = _along_cubics(xs, tangents, chords, shares)
        before, border = shares.astype(int), Border.of_component(place % xs.shape[1], values[which], xs.shape[1])
        problem, lanes = FamilyProblem(curve, Options()), np.zeros(len(guesses), int)
        solved, exact = correct(problem, lanes, guesses, border, tangents[before], problem.steps, record=False)
        away = (np.abs(exact.xs - guesses[solved]) / curve.size(guesses[solved])).max(1, initial=0.0)
        near = away < FARTHEST_SOLUTION * chords[before[solved]]
        found.append((shares[solved][near], exact.xs[near], exact.tangents[near]))
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
