"""A grid of members, where members far inside a region without orbits are not searched."""

from collections import Counter
from collections.abc import Callable
from time import perf_counter

import numpy as np

from ..running import TimeOver, exclusive, interrupts
from .members import solve_chunk
from .progress import SweepProgress, pace
from .question import CHUNK, Question, empty_table
from .sweep_result import Sweep

# Every member with indices that are multiples of this, and the last ones, is searched.
STRIDE = 4
# In a smaller grid all members are searched.
LARGE_GRID = 1000
NO_ORBIT, NOT_SEARCHED = "no orbit", "not searched: the searched members around it have no orbits either"


class SparseGrid:
    """The results of a grid (m, n), which are filled in step by step: first those of every `STRIDE`-th member."""

    def __init__(self, question: Question, show: Callable[[SweepProgress], None]):
        self.question, self.show, self.began = question, show, perf_counter()
        self.shape = tuple(question.members.shape or ())
        self.table, self.known = empty_table(len(question), question.columns()), np.zeros(self.shape, bool)
        self.table.members[:] = np.arange(len(question))
        for name, column in zip(question.members.names, question.members.values.T, strict=True):
            self.table.columns[name][:] = column
        corners = [np.unique([*range(0, count, STRIDE), count - 1]) for count in self.shape]
        self.corners = corners
        first = np.full(self.shape, len(question) < LARGE_GRID)
        first[np.ix_(*corners)] = True
        self.solve(first)
        self.solve(~self._without_orbits(first))
        self.table.columns["status"][~self.known.ravel()] = NO_ORBIT
        self.table.columns["reason"][~self.known.ravel()] = NOT_SEARCHED

    @property
    def statuses(self) -> np.ndarray:
        """The statuses (m, n)."""
        return self.table.columns["status"].reshape(self.shape)

    def _without_orbits(self, searched: np.ndarray) -> np.ndarray:
        """Whether each member lies between members that have no orbits, and is not one of them, (m, n)."""
        empty, found = (self.statuses == NO_ORBIT)[np.ix_(*self.corners)], np.zeros(self.shape, bool)
        for i, j in np.argwhere(empty[:-1, :-1] & empty[1:, :-1] & empty[:-1, 1:] & empty[1:, 1:]).tolist():
            found[self._cell(i, j)] = True
        return found & ~searched

    def _cell(self, i: int, j: int) -> tuple[slice, slice]:
        """The members of a cell of the members that are searched first."""
        (a, b), (c, d) = (each[[k, k + 1]].tolist() for each, k in zip(self.corners, (i, j), strict=True))
        return slice(a, b + 1), slice(c, d + 1)

    def search_around(self, nodes: np.ndarray) -> None:
        """Search the members that were not, in those cells in which some nodes (k, 2) lie, by their indices."""
        wanted = np.zeros(self.shape, bool)
        cells = [
            np.clip(np.searchsorted(each, nodes[:, k], side="right") - 1, 0, len(each) - 2)
            for k, each in enumerate(self.corners)
        ]
        for i, j in {*zip(*(each.tolist() for each in cells), strict=True)}:
            wanted[self._cell(i, j)] = True
        self.solve(wanted)

    @exclusive
    def solve(self, wanted: np.ndarray) -> None:
        """Fill in those of the wanted members (m, n) that are not known."""
        members = np.flatnonzero(wanted & ~self.known)
        try:
            with interrupts.deferred():
                for start in range(0, len(members), CHUNK):
                    interrupts.heed()
                    some = members[start : start + CHUNK]
                    part = solve_chunk(self.question, some, self.question.values_of(some))
                    for name, column in part.columns.items():
                        self.table.columns[name][some] = column
                    self.known.flat[some] = True
                    self._report()
        except TimeOver as over:
            done, seconds = int(self.known.sum()), perf_counter() - self.began
            raise over.reached(pace(done, self.known.size, seconds)) from None

    def _report(self) -> None:
        done, whole, seconds = int(self.known.sum()), self.known.size, perf_counter() - self.began
        counts = Counter(self.table.columns["status"][self.known.ravel()].tolist())
        self.show(SweepProgress(done, whole, dict(counts), seconds, (whole - done) * seconds / max(done, 1)))

    def sweep(self) -> Sweep:
        """The result."""
        return Sweep.of(self.question, self.table)
