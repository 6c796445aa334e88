"""The grid of a diagram: its nodes with their statuses, and the sides of its cells on which boundaries lie."""

from typing import NamedTuple

import numpy as np

from .designs import Axis

# Statuses of members that have an orbit, the first of them a motion.
WITH_ORBIT = ("certified", "inadmissible")


class Brackets(NamedTuple):
    """Parts of sides of cells that each contain a boundary, between two different statuses.

    nodes, in_row : the nodes (k, 2) before the sides by their indices, and whether the sides lie in rows (k,)
    low, high : the shares (k,) of the range between which the boundary lies
    statuses : (k, 2), before and behind it
    exact : whether it is known exactly (k,), where both shares are the same
    """

    nodes: np.ndarray
    in_row: np.ndarray
    low: np.ndarray
    high: np.ndarray
    statuses: np.ndarray
    exact: np.ndarray

    def take(self, which: np.ndarray) -> "Brackets":
        """Some of them."""
        return Brackets(*(part[which] for part in self))

    def and_also(self, others: "Brackets") -> "Brackets":
        """These and others."""
        return Brackets(*map(np.concatenate, zip(self, others, strict=True)))

    @property
    def orbits(self) -> np.ndarray:
        """Whether there are orbits before and behind (k, 2)."""
        return np.isin(self.statuses.astype(str), WITH_ORBIT)


class Grid(NamedTuple):
    """The nodes of a diagram, with two entries for the ways along rows (m) and across (n).

    names : of the parameters
    axes : their ranges
    shares, values : of the ranges at which nodes lie, and the parameters there
    statuses : (m, n)
    """

    names: tuple[str, str]
    axes: tuple[Axis, Axis]
    shares: tuple[np.ndarray, np.ndarray]
    values: tuple[np.ndarray, np.ndarray]
    statuses: np.ndarray

    def points(self, nodes: np.ndarray, in_row: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """The points (k, 2) on sides that begin at nodes (k, 2), at shares (k,) of the ranges."""
        found = np.column_stack([values[nodes[:, k]] for k, values in enumerate(self.values)])
        for k, which in enumerate((in_row, ~in_row)):
            found[which, k] = self.axes[k].at(shares[which])
        return found

    def brackets(self) -> Brackets:
        """The sides between nodes of different statuses."""
        along = np.argwhere(self.statuses[1:] != self.statuses[:-1])
        across = np.argwhere(self.statuses[:, 1:] != self.statuses[:, :-1])
        return self.sides(np.concatenate([along, across]), np.repeat([True, False], [len(along), len(across)]))

    def sides(self, nodes: np.ndarray, in_row: np.ndarray) -> Brackets:
        """The whole sides that begin at nodes (k, 2), in rows or between them."""
        both = nodes, nodes + np.where(in_row[:, None], [1, 0], [0, 1])
        low, high = (np.where(in_row, *(own[at[:, k]] for k, own in enumerate(self.shares))) for at in both)
        statuses = np.column_stack([self.statuses[tuple(at.T)] for at in both])
        return Brackets(nodes, in_row, low, high, statuses, np.zeros(len(nodes), bool))
