"""Rows of a record at ascending extensions, and those half way between several curves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orbits.errors import InputError


class RowOptions(NamedTuple):
    """The fewest rows of a table, and which of them are the same or stairs."""

    fewest: int = 4  # of a table
    same: float = 1e-9  # extensions that differ by this share of their range or less are the same
    rows_of_step: int = 2  # forces are stairs where the median number of rows on a step is this large
    steps: int = 24  # of stairs, at least
    level: int = 6  # a step of this many times the median is a level part of the law


ROWS = RowOptions()


class MeasuredRows(NamedTuple):
    """Ascending, different extensions (n,) and the mean force (n,) of the rows at each.

    weights : (n,), of how many different rows each force is the mean; copies of a row count as one
    squares : sum of the squared differences of rows from the mean at their extension
    spare : how many differences of these are independent, the number of repeated rows that are not copies
    """

    extensions: np.ndarray
    forces: np.ndarray
    weights: np.ndarray
    squares: float
    spare: int


def rows_at(r: np.ndarray, force: np.ndarray, label: str) -> MeasuredRows:
    """Measured rows (N,) in order; raises `InputError` where no law goes through them."""
    order = np.argsort(r, kind="stable")
    r, force = _middles_of_steps(r[order], force[order])
    place = np.cumsum(np.diff(r, prepend=r[:1]) > ROWS.same * np.ptp(r)) if len(r) else np.zeros(0, int)
    counts = np.bincount(place)
    lowest, highest = np.full(len(counts), np.inf), np.full(len(counts), -np.inf)
    np.minimum.at(lowest, place, force)
    np.maximum.at(highest, place, force)
    if len(counts) < ROWS.fewest:
        few = f"{len(counts)} different extensions; a table needs at least {ROWS.fewest}"
        raise InputError(f"{label}: {few}: record more rows")
    means = np.bincount(place, force) / counts
    squares = float(np.sum((force - means[place]) ** 2))
    # Rows of one force to the last bit are copies, or too coarse to show their noise: they count as one measurement.
    measured = np.where(lowest == highest, 1, counts)
    spare = int(measured.sum()) - len(counts)
    return MeasuredRows(np.bincount(place, r) / counts, means, measured.astype(float), squares, spare)


def _middles_of_steps(r: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middle of each step, if the forces of rows are the stairs of a coarse rounding: the force there is that of
    the step, while the error of rounding along a step does not differ from row to row. Other rows are unchanged."""
    if len(r) < ROWS.steps or not np.ptp(r) > 0:
        return r, force
    begins = np.flatnonzero(np.diff(force, prepend=np.nan) != 0)
    counts = np.diff(np.r_[begins, len(r)])
    typical = np.median(counts)
    different = np.diff(r) > ROWS.same * np.ptp(r)
    if typical < ROWS.rows_of_step or len(begins) < ROWS.steps or not np.mean(different) > 0.9:  # copies are no steps
        return r, force
    level = np.repeat(counts > ROWS.level * typical, counts)
    step = np.repeat(np.arange(len(begins)), counts)
    group = np.cumsum(np.diff(step, prepend=-1).astype(bool) | level) - 1
    sizes = np.bincount(group)
    return np.bincount(group, r) / sizes, np.bincount(group, force) / sizes


def mean_of_curves(curves: Sequence[MeasuredRows], label: str) -> MeasuredRows:
    """The mean force of several curves, at the extensions of that with the fewest, where all have been measured."""
    own = min(curves, key=lambda rows: len(rows.extensions))
    low, high = max(rows.extensions[0] for rows in curves), min(rows.extensions[-1] for rows in curves)
    r = own.extensions[(own.extensions >= low) & (own.extensions <= high)]
    if len(r) < ROWS.fewest:
        common = "the branches have few extensions in common"
        raise InputError(f"{label}: {common}; a table needs {ROWS.fewest}: record more rows")
    forces = [np.interp(r, rows.extensions, rows.forces) for rows in curves]
    variances = [1 / np.interp(r, rows.extensions, rows.weights) for rows in curves]
    weights = len(curves) ** 2 / np.sum(variances, axis=0)  # the variance of a mean of means
    squares, spare = sum(rows.squares for rows in curves), sum(rows.spare for rows in curves)
    return MeasuredRows(r, np.mean(forces, axis=0), weights, squares, spare)
