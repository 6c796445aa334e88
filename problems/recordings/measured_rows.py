"""Rows of a record at ascending extensions, and those half way between several curves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orbits.errors import InputError

FEWEST_ROWS = 4
# Extensions that differ by this share of their range or less are the same.
SAME_EXTENSION = 1e-9


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


def rows_at(r: np.ndarray, force: np.ndarray, label: str) -> MeasuredRows:
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


def mean_of_curves(curves: Sequence[MeasuredRows], label: str) -> MeasuredRows:
    """The mean force of several curves, at the extensions of that with the fewest, where all have been measured."""
    own = min(curves, key=lambda rows: len(rows.extensions))
    low, high = max(rows.extensions[0] for rows in curves), min(rows.extensions[-1] for rows in curves)
    r = own.extensions[(own.extensions >= low) & (own.extensions <= high)]
    if len(r) < FEWEST_ROWS:
        raise InputError(f"{label}: the branches have few extensions in common; a table needs {FEWEST_ROWS}")
    forces = [np.interp(r, rows.extensions, rows.forces) for rows in curves]
    variances = [1 / np.interp(r, rows.extensions, rows.weights) for rows in curves]
    weights = len(curves) ** 2 / np.sum(variances, axis=0)  # the variance of a mean of means
    squares, spare = sum(rows.squares for rows in curves), sum(rows.spare for rows in curves)
    return MeasuredRows(r, np.mean(forces, axis=0), weights, squares, spare)
