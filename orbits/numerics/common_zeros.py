"""Where several smooth functions of two variables vanish together: a search on a grid whose cells are halved."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class CellOptions(NamedTuple):
    """When a cell is halved, and which predicted zeros are its own."""

    halvings: int = 5  # of a cell, at most
    curvature: float = 4.0  # the largest ratio of the curvature in a cell to that which its second differences show
    beside: float = 1.6  # distance from the middle, in halves of a side, of zeros predicted by nearly linear functions
    near: float = 4.0  # that distance where functions are not nearly linear


CELLS = CellOptions()


def near_common_zeros(values_of: Callable[[np.ndarray], np.ndarray], count: int) -> tuple[np.ndarray, int]:
    """Places (m, 2) in the unit square, near which functions may vanish together, from a grid of `count` by `count`
    places, and the number of these at which they have no value.

    values_of : places (..., 2) -> values (..., k) of the functions, NaN where they have none

    A cell is divided into four until one function has no zero in it, or all are nearly linear, so that they have at
    most one common zero, which is predicted, as it is for cells that were divided five times. A cell with a place
    without values is left out.
    """
    half = -(-(count - 1) // 2)
    axis, corners = np.linspace(0.0, 1.0, 2 * half + 1), _plane_of(np.arange(0, 2 * half, 2)).reshape(-1, 2)
    nodes, at = _plane_of(axis), corners[:, None, None] + _plane_of(np.arange(3))
    values = values_of(nodes)
    cells, middles = _Cells(values[at[..., 0], at[..., 1]]), nodes[at[:, 1, 1, 0], at[:, 1, 1, 1]]
    radius, found = float(axis[1]), list[np.ndarray]()
    for halving in range(CELLS.halvings + 1):
        linear, last, left = cells.linear, halving == CELLS.halvings, ~cells.linear & ~cells.excluded
        near = (linear & cells.within(CELLS.beside)) | (left & cells.within(CELLS.near) & last)
        found.append((middles + radius * cells.predicted)[near])
        middles = middles[left]
        if last or not len(middles):
            break
        radius /= 2
        middles = (middles[:, None] + radius * _plane_of(np.array([-1.0, 1.0])).reshape(-1, 2)).reshape(-1, 2)
        cells = _Cells(values_of(middles[:, None, None] + radius * _plane_of(np.array([-1.0, 0.0, 1.0]))))
    return np.concatenate(found), int(np.isnan(values[..., 0]).sum())


def _plane_of(axis: np.ndarray) -> np.ndarray:
    """The pairs (n, n, 2) of the values (n,) of an axis."""
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)


class _Cells:
    """Functions on cells: values (m, 3, 3, count) at the corners, the middles of the sides and the middles of cells.

    slopes : (m, count, 2), of straight lines, along half a side
    bends : (m, count), the largest second differences along either side, added up
    predicted : (m, 2), where straight lines are least together, in halves of a side from the middle
    steepest : (m,), the slope of all functions together in the direction in which that is least
    """

    def __init__(self, values: np.ndarray):
        self.values = values
        along = [values[:, 2] - values[:, 0], values[:, :, 2] - values[:, :, 0]]
        self.slopes = np.stack([each.mean(1) for each in along], axis=-1) / 2
        self.bends = sum(np.abs(np.diff(values, 2, axis=axis)).max((1, 2)) for axis in (1, 2))
        fit = np.einsum("mck,mc->mk", self.slopes, values.mean((1, 2)))
        square = np.einsum("mck,mcl->mkl", self.slopes, self.slopes)
        a, b, c = square[:, 0, 0], square[:, 1, 1], square[:, 0, 1]
        det = np.maximum(a * b - c * c, np.finfo(float).tiny)[:, None]
        self.predicted = -np.stack([b * fit[:, 0] - c * fit[:, 1], a * fit[:, 1] - c * fit[:, 0]], axis=1) / det
        self.steepest = np.sqrt(np.maximum((a + b) / 2 - np.sqrt((a - b) ** 2 / 4 + c * c), 0.0))

    @property
    def linear(self) -> np.ndarray:
        """Whether the functions have at most one common zero in each cell, since they are nearly linear."""
        v = self.values
        mixed = np.abs(v[:, 0, 0] - v[:, 0, 2] - v[:, 2, 0] + v[:, 2, 2]) / 4
        return CELLS.curvature * np.linalg.norm(self.bends + mixed, axis=1) < self.steepest

    def within(self, distance: float) -> np.ndarray:
        """Whether straight lines vanish within a distance of the middle of each cell, in halves of its side."""
        return np.abs(self.predicted).max(1) < distance

    @property
    def excluded(self) -> np.ndarray:
        """Whether one function has no zero in each cell, or the sum of all in the direction in which straight lines
        stay farthest from 0; and where a value is not known."""
        at = np.clip(np.nan_to_num(self.predicted), -1.0, 1.0)
        rest = self.values.mean((1, 2)) + np.einsum("mck,mk->mc", self.slopes, at)
        rest = rest / np.maximum(np.linalg.norm(rest, axis=1, keepdims=True), np.finfo(float).tiny)
        values = np.concatenate([self.values, np.einsum("mijc,mc->mij", self.values, rest)[..., None]], axis=-1)
        bends = np.column_stack([self.bends, np.einsum("mc,mc->m", self.bends, np.abs(rest))])
        one_sign = np.abs(np.sign(values).sum((1, 2))) == 9
        far = np.abs(values).min((1, 2)) > CELLS.curvature / 8 * bends
        return (one_sign & far).any(1) | ~np.isfinite(self.values).all((1, 2, 3))
