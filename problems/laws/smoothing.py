"""Measured rows to a smooth curve: branches of a loop, repeated extensions, noise."""

from typing import NamedTuple

import numpy as np

from orbits.errors import InputError

from .measured import FEWEST_ROWS

# The fewest rows on each branch of a detected loop.
FEWEST_ON_BRANCH = 3
# Each row between which a spline runs ends an integration step: more would cost minutes and add no digit.
MOST_ROWS = 500
# A smoothing spline is found from at most this number of means of neighbouring rows, by an eigendecomposition.
MOST_MEANS = 256
# An extension that comes back by this share of its range has turned.
TURN = 0.02
# Rows on the way up and on the way down differ where their mean difference is this many times its standard error and
# this share of the forces' range; a narrower loop is noise.
LOOP_SIGNIFICANCE, LOOP_WIDTH = 6.0, 5e-3
# Rows are noisy where a smoothing spline with fewer degrees of freedom than this share of the rows is likelier than
# the interpolating one, twice the logarithm by this much; noise below the last share of the range is rounding.
FREEDOM, LIKELIER, EXACT_ROWS = 0.8, 15.0, 1e-9
# Extensions that differ by this share of their range or less are the same.
SAME_EXTENSION = 1e-9
# Below this number of rows noise and shape cannot be distinguished.
FEWEST_NOISY = 12
# The number of nodes of a smoothed curve per degree of freedom, and its bounds.
NODES_PER_FREEDOM, NODES = 2, (16, 128)
# Directions of the noise in the curve, the smoothest first: all later ones add a tenth to the change of an orbit.
MOST_DIRECTIONS = 24


class MeasuredRows(NamedTuple):
    """Ascending, different extensions (n,) and the mean force (n,) of the rows at each.

    weights : (n,), of how many different rows each force is the mean; copies of a row count as one
    squares : sum of the squared differences of rows from the mean at their extension
    spare : how many differences of these are independent, the number of repeated rows that are no copies
    """

    extensions: np.ndarray
    forces: np.ndarray
    weights: np.ndarray
    squares: float
    spare: int


class SmoothCurve(NamedTuple):
    """A smooth curve through rows: forces (n,) at ascending extensions (n,), and the effect of noise on them.

    changes : (k, n), independent changes of the forces by one standard deviation each
    note : what was done to the rows, in words
    """

    extensions: np.ndarray
    forces: np.ndarray
    changes: np.ndarray
    note: str


def branch_of(r: np.ndarray, force: np.ndarray, sense: float, branch: str | None, label: str) -> MeasuredRows:
    """The rows on a branch of a loop: "loading", where the travel grows, "unloading", or "mean", half way between both.

    sense : -1.0 where the travel is a compression
    Raises `InputError` for a loop without a named branch, and for a branch of too few rows.
    """
    direction = _directions(r)
    if branch in ("loading", "unloading"):
        # A table of one side alone is loaded away from rest, whichever sign it gives that side.
        travel = sense * r
        away = -1.0 if travel.max(initial=0.0) <= TURN * np.ptp(travel) else 1.0
        on = direction * sense * away == (1 if branch == "loading" else -1)
        if np.count_nonzero(on) < FEWEST_ROWS:
            found = f"{np.count_nonzero(on)} rows on the branch '{branch}'"
            raise InputError(f"{label}: {found}; a table needs {FEWEST_ROWS}")
        return _rows(r[on], force[on], label)
    if branch not in (None, "mean"):
        raise InputError(f"branch = {branch!r}; it is 'loading', 'unloading' or 'mean'")
    up, down = ((r[direction == side], force[direction == side]) for side in (1, -1))
    if branch == "mean" and min(len(up[0]), len(down[0])) >= FEWEST_ROWS:
        return _mean(_rows(*up, label), _rows(*down, label), label)
    width = _loop_width(up, down)
    if branch is None and abs(width) > LOOP_WIDTH * np.ptp(force):
        named = 'name one, branch="loading" or branch="unloading", or both, branch="mean"'
        raise InputError(
            f"{label} is a loop: loading and unloading differ by {abs(width):.3g}, "
            f"{100 * abs(width) / np.ptp(force):.2g}% of the forces' range; {named} (table:FILE?branch=loading)"
        )
    return _rows(r, force, label)


def _rows(r: np.ndarray, force: np.ndarray, label: str) -> MeasuredRows:
    """Measured rows (N,) in order; raises `InputError` where no law goes through them."""
    order = np.argsort(r, kind="stable")
    r, force = r[order], force[order]
    place = np.cumsum(np.diff(r, prepend=r[:1]) > SAME_EXTENSION * np.ptp(r)) if len(r) else np.zeros(0, int)
    counts = np.bincount(place)
    lowest, highest = np.full(len(counts), np.inf), np.full(len(counts), -np.inf)
    np.minimum.at(lowest, place, force)
    np.maximum.at(highest, place, force)
    if len(counts) < FEWEST_ROWS:
        raise InputError(f"{label}: {len(counts)} different extensions; a table needs at least {FEWEST_ROWS}")
    means = np.bincount(place, force) / counts
    squares = float(np.sum((force - means[place]) ** 2))
    # Rows of one force to the last bit are copies, or too coarse to show their noise: they count as one measurement.
    measured = np.where(lowest == highest, 1, counts)
    spare = int(measured.sum()) - len(counts)
    return MeasuredRows(np.bincount(place, r) / counts, means, measured.astype(float), squares, spare)


def _mean(up: MeasuredRows, down: MeasuredRows, label: str) -> MeasuredRows:
    """Half way between two branches, at the extensions of that with fewer, where there is the other one too."""
    own, other = sorted((up, down), key=lambda rows: len(rows.extensions))
    inside = (own.extensions >= other.extensions[0]) & (own.extensions <= other.extensions[-1])
    if np.count_nonzero(inside) < FEWEST_ROWS:
        raise InputError(f"{label}: loading and unloading have few extensions in common; a table needs {FEWEST_ROWS}")
    r = own.extensions[inside]
    force, count = (np.interp(r, other.extensions, column) for column in (other.forces, other.weights))
    weights = 4 / (1 / own.weights[inside] + 1 / count)  # the variance of a mean of two means
    return MeasuredRows(
        r, (own.forces[inside] + force) / 2, weights, own.squares + other.squares, own.spare + other.spare
    )


def curve_of(rows: MeasuredRows, noise: float | None) -> SmoothCurve:
    """The curve through rows: the rows themselves, or a smoothing spline.

    noise : standard deviation of a row's force; None to see from the rows whether they are noisy, 0 for exact ones

    The spline minimises sum w_i (f_i - g(r_i))**2/noise**2 + penalty times the integral of g''**2, with weights w, the
    penalty of greatest restricted likelihood (Wahba 1985); its posterior covariance gives the changes (Nychka 1988).
    """
    if rows.spare < FEWEST_ROWS:  # a few repeated rows show no noise, but may be an outlier
        rows = rows._replace(squares=0.0, spare=0)
    r, count, fit = rows.extensions, len(rows.extensions), None
    if noise != 0 and (noise is not None or count + rows.spare >= FEWEST_NOISY):
        fit = _smoothed(rows, noise)
    if fit is not None:
        return fit
    if count <= MOST_ROWS:
        return SmoothCurve(r, rows.forces, np.zeros((0, count)), "")
    chosen = np.linspace(0, count - 1, MOST_ROWS).round().astype(int)
    return SmoothCurve(r[chosen], rows.forces[chosen], np.zeros((0, MOST_ROWS)), f"{MOST_ROWS} of {count} rows")


def _smoothed(rows: MeasuredRows, noise: float | None) -> SmoothCurve | None:
    """The smoothing spline; None where the rows are not known to be noisy and do not look it."""
    from scipy.interpolate import CubicSpline  # only a table needs it, and it takes half a second to import
    from scipy.linalg import eigh

    r, w = rows.extensions, rows.weights
    starts = np.unique(np.linspace(0, len(r), min(len(r), MOST_MEANS), endpoint=False).astype(int))
    weights = np.add.reduceat(w, starts)
    x, y = np.add.reduceat(w * r, starts) / weights, np.add.reduceat(w * rows.forces, starts) / weights
    n, h, root = len(x), np.diff(x), np.sqrt(weights)
    bends = CubicSpline(x, np.eye(n), bc_type="natural")(x, 2)  # the spline's second derivatives, linear in its values
    mass = np.diag((np.r_[h, 0] + np.r_[0, h]) / 3) + np.diag(h / 6, 1) + np.diag(h / 6, -1)
    penalty = bends.T @ mass @ bends / np.outer(root, root)
    stiffness, modes = eigh((penalty + penalty.T) / 2)
    stiffness[:2], z = 0.0, modes.T @ (root * y)  # a straight line is not penalised
    stiffness[2:] = np.maximum(stiffness[2:], np.finfo(float).eps * stiffness[-1])
    multiples = np.geomspace(1e-6 / stiffness[-1], 1e6 / stiffness[2], 400)
    lost = 1 - 1 / (1 + multiples[:, None] * stiffness[2:])
    squares, freedom = lost @ z[2:] ** 2 + rows.squares, n - 2 + rows.spare
    with np.errstate(all="ignore"):  # rows on a straight line leave nothing, and no best penalty
        size = freedom * np.log(squares) if noise is None else squares / noise**2
        deviance = size - np.log(lost).sum(1)
        best = int(deviance.argmin())
        gain = deviance[0] - deviance[best]
    factors = np.r_[1.0, 1.0, 1 - lost[best]]
    sigma = float(np.sqrt(squares[best] / freedom)) if noise is None else noise
    smooth = factors.sum() < FREEDOM * n
    noisy = (smooth and gain > LIKELIER) or rows.squares > rows.spare * (EXACT_ROWS * np.ptp(y)) ** 2
    if noise is None and not (noisy and sigma > EXACT_ROWS * np.ptp(y)):
        return None
    count = np.clip(NODES_PER_FREEDOM * factors.sum(), *NODES)
    nodes = np.linspace(r[0], r[-1], int(count)) if smooth else np.r_[r[0], x[1:-1], r[-1]]
    at_nodes = CubicSpline(x, modes / root[:, None], bc_type="natural")(nodes)
    changes = sigma * (np.sqrt(factors) * at_nodes).T[:MOST_DIRECTIONS]
    note = f"{w.sum():.0f} rows smoothed, noise {sigma:.3g} {'estimated' if noise is None else 'stated'}"
    return SmoothCurve(nodes, at_nodes @ (factors * z), changes, note)


def _directions(r: np.ndarray) -> np.ndarray:
    """For each row (n,) whether the extension is on its way up, 1, or down, -1; small wobbles do not turn it."""
    directions, room = np.ones(len(r), int), TURN * np.ptp(r)
    direction, extreme, turned = 0, 0, 0  # the way, and the rows of its farthest extension and of its beginning
    low = high = 0
    values = r.tolist()
    for i, value in enumerate(values):
        if direction == 0:
            low, high = (i if value < values[low] else low), (i if value > values[high] else high)
            if values[high] - values[low] > room:
                direction, extreme = (1, high) if high > low else (-1, low)
        elif direction * (value - values[extreme]) > 0:
            extreme = i
        elif direction * (values[extreme] - value) > room:
            directions[turned : extreme + 1] = direction
            direction, turned, extreme = -direction, extreme + 1, i
    directions[turned:] = direction or 1
    return directions


def _loop_width(up: tuple[np.ndarray, np.ndarray], down: tuple[np.ndarray, np.ndarray]) -> float:
    """The mean force of rows on the way up less that on the way down at the same extension; 0 where it is none."""

    def above(branch, other):
        order = np.argsort(branch[0], kind="stable")
        inside = (other[0] >= branch[0].min()) & (other[0] <= branch[0].max())
        return np.interp(other[0][inside], branch[0][order], branch[1][order]) - other[1][inside]

    if min(len(up[0]), len(down[0])) < FEWEST_ON_BRANCH:
        return 0.0
    # Both ways round, the errors of straight lines between the rows of a curved law cancel.
    a, b = above(up, down), -above(down, up)
    widths = np.r_[a, b]
    if len(widths) < 2 * FEWEST_ON_BRANCH:
        return 0.0
    # A loop may be wide on one side and narrow on the other: noise is no more than neighbouring widths differ by.
    spread = min(widths.std(), np.r_[np.diff(a), np.diff(b)].std() / np.sqrt(2))
    mean = float(widths.mean())
    return mean if abs(mean) > LOOP_SIGNIFICANCE * spread / np.sqrt(len(widths)) else 0.0
