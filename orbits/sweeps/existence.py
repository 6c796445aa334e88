"""Where the orbits of a family exist in two parameters, and where they are motions.

The orbits of a grid of machines give a first approximation. Wherever two neighbours in a row of the grid differ in
status, the family between them is followed, and the event at which the status changes is followed as a curve in both
parameters, which passes all rows exactly, and if requested all columns. Where no such curve is found, the orbits at the
neighbours are continued to where they end or change, and what is left is located by bisection, for all pairs of
neighbours together.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from ..design import settled_designs, solved_designs
from ..errors import InputError, NoOrbit, list_of_names, whole_number
from ..io import Document
from ..model import Machine
from ..periodic import AT_FOLD, NOT_REACHED, Orbit, StartLike, continued_orbits, family_number, find, orbit_of
from ..result import Axes, Result, Row, shown
from ..running import TimeOver, running
from .boundaries import LOCATED_TO, Boundaries, bisected, by_continuation, cut_by_curves
from .boundary_curves import BoundaryCurve, boundary_curves
from .designs import MOST_MEMBERS, Axis, axis_of
from .diagram_grid import WITH_ORBIT, Grid
from .execution import check_executor
from .progress import SweepProgress, on_screen
from .sparse_grid import NOT_SEARCHED, SparseGrid
from .sweep import checked_question, sweep
from .sweep_result import Sweep


class Stretch(NamedTuple):
    """An interval of a row, from one value to another, with the status of its orbits."""

    low: float
    high: float
    status: str


@dataclass(frozen=True, eq=False, repr=False)
class Existence(Result, what="diagram", in_line=("along", "across", "values")):
    """An existence and admissibility diagram: the orbits of least launch speed on a grid of two parameters.

    along, across : names of the two parameters
    values : of `across`, one for each row, ascending
    grid : the sweep of the members on the grid, `along` first
    boundaries : the located points between neighbours of different statuses
    curves : the curves of events that were followed
    stopped : why some boundaries in rows are not located; "" if all are
    """

    along: str
    across: str
    values: tuple[float, ...]
    grid: Sweep
    boundaries: Boundaries
    curves: tuple[BoundaryCurve, ...] = ()
    stopped: str = ""

    machine = property(lambda self: self.grid.machine)

    @cached_property
    def units(self) -> dict[str, str]:
        """The units of the grid's columns, and of the ends of the stretches; empty for a dimensionless machine."""
        unit = self.grid.unit_of(self.along)
        return {**self.grid.units, **({f"{side} {self.along}": unit for side in ("from", "to")} if unit else {})}

    def title(self) -> str:
        return self.grid.title()

    def heads(self) -> list[str]:
        return [self.heading(self.across), f"motions for {self.along}"]

    def _rows(self) -> Iterator[Row]:
        """The intervals of each row on which there are motions."""
        for row, value in enumerate(self.values):
            motions = ", ".join(f"{low:.8g} to {high:.8g}" for low, high in self.motions(row)) or "none"
            text = f"{motions}{', in part not known' if self.unknown(row) else ''}"
            yield Row(f"{value:.6g}", {f"{self.across} = {value:.6g}": text})
        yield Row("rests on", {"rests on": self.rests_on})

    @property
    def rests_on(self) -> str:
        """The assumptions and the work behind the diagram, in words."""
        members, found = len(self.grid), self.boundaries
        skipped = int(np.count_nonzero(self.grid["reason"] == NOT_SEARCHED))
        exact = int(np.count_nonzero(found.exact))
        others = int(np.count_nonzero(found.located)) - exact
        text = f"{members - skipped} of {members} members were searched"
        text += f", and {skipped} inside regions without orbits were not" if skipped else ""
        text += f"; {exact} boundary points lie on {len(self.curves)} curves of events, {others} between members"
        loose = int(np.count_nonzero(self._loose))
        return text + (f", and {loose} are midpoints between members: {self.stopped}" if loose else "")

    @property
    def _loose(self) -> np.ndarray:
        """Whether boundaries lie in rows and are not located, (k,)."""
        return self.boundaries.in_row.astype(bool) & ~self.boundaries.located.astype(bool)

    @property
    def between(self) -> tuple[float, float]:
        """The ends of the rows."""
        places = self.grid[self.along]
        return float(places.min()), float(places.max())

    def row(self, row: int) -> list[Stretch]:
        """A row, counted from 0, as intervals of one status each, ascending; neighbours on the grid with the same
        status are joined."""
        row = whole_number("row", row, "rows", least=0, most=len(self.statuses) - 1)
        found, (low, high) = self.boundaries, self.between
        these = np.flatnonzero(found.in_row.astype(bool) & (found.nodes[:, 1] == row))
        these = these[np.argsort(found.points[these, 0], kind="stable")]
        ends = pairwise([low, *found.points[these, 0].tolist(), high])
        statuses = [str(self.statuses[row, 0]), *found.statuses[these, 1].tolist()]
        return [Stretch(*pair, status) for pair, status in zip(ends, statuses, strict=True)]

    @property
    def statuses(self) -> np.ndarray:
        """The statuses on the grid (rows, places along)."""
        shape = self.grid.about["shape"]
        return self.grid["status"].reshape(shape).T

    def stretches(self, row: int) -> list[tuple[float, float, bool]]:
        """The intervals on which a row has orbits: (from, to, whether they are motions)."""
        return [(low, high, status == WITH_ORBIT[0]) for low, high, status in self.row(row) if status in WITH_ORBIT]

    def motions(self, row: int) -> list[tuple[float, float]]:
        """The disjoint intervals on which a row has an orbit that is a motion, ascending."""
        return [(low, high) for low, high, motion in self.stretches(row) if motion]

    def unknown(self, row: int) -> bool:
        """Whether a row may be incomplete: a member failed or is not reached from the start (after a fold on the way,
        it may have other orbits), or its boundaries are not located."""
        loose = (self._loose & (self.boundaries.nodes[:, 1] == row)).any()
        return bool(loose) or any(status in ("failed", AT_FOLD, NOT_REACHED) for _, _, status in self.row(row))

    @property
    def orbit_edges(self) -> np.ndarray:
        """The located points (k, 2) at which orbits begin or end."""
        return self._edges(WITH_ORBIT)

    @property
    def motion_edges(self) -> np.ndarray:
        """The located points (k, 2) at which motions begin or end."""
        return self._edges(WITH_ORBIT[:1])

    def _edges(self, statuses: tuple[str, ...]) -> np.ndarray:
        inside = np.isin(self.boundaries.statuses.astype(str), statuses)
        return self.boundaries.points[(inside[:, 0] != inside[:, 1]) & self.boundaries.located.astype(bool)]

    def plot(self, quantity: str | None = None, axes: Axes | None = None) -> Axes:
        """Plot the diagram, coloured by a quantity if one is named; returns the axes."""
        if quantity is not None and quantity not in self.grid.numbers:
            raise InputError(f"the diagram has no quantity '{quantity}'; it has {', '.join(self.grid.numbers)}")
        return shown("sweep_figures").plot_existence(self, quantity, axes)

    def document(self) -> Document:
        """The diagram as JSON-ready data: the intervals of the rows, the boundaries, and the members on the grid."""
        swept, found = self.grid.document(), self.boundaries
        rows = [
            {"value": value, "stretches": [part._asdict() for part in self.row(row)]}
            for row, value in enumerate(self.values)
        ]
        names = "point", "statuses", "located"
        parts = zip(found.points.tolist(), found.statuses.tolist(), found.located.tolist(), strict=True)
        boundaries = [dict(zip(names, part, strict=True)) for part in parts]
        own = {"along": self.along, "across": self.across, "between": list(self.between), "accuracy": LOCATED_TO}
        return own | {"rows": rows, "boundaries": boundaries} | swept

    def table(self) -> dict[str, list[Any]]:
        """The stretches of the rows as columns: the row's value, from where to where, and the status."""
        parts = [(value, *part) for row, value in enumerate(self.values) for part in self.row(row)]
        names = self.across, f"from {self.along}", f"to {self.along}", "status"
        return dict(zip(names, map(list, zip(*parts, strict=True)), strict=True))

    @property
    def dataset(self) -> Any:
        """The diagram as an `xarray.Dataset`: that of the grid, with the boundaries along "boundary"."""
        found = self.boundaries
        columns = {"boundary_" + name: found.points[:, k] for k, name in enumerate((self.along, self.across))}
        columns |= {"boundary_" + name: found.statuses[:, k].astype(str) for k, name in enumerate(("before", "behind"))}
        return self.grid.dataset.assign({name: ("boundary", values) for name, values in columns.items()})


@running("existence")
def existence(
    machine: Machine,
    along: str,
    between: tuple[object, ...],
    across: str,
    values: Sequence[float] | tuple[object, ...],
    family: int = 1,
    *,
    samples: int | tuple[int, int] = 100,
    both_ways: bool = False,
    quantities: str | Sequence[str] = (),
    start: StartLike | None = None,
    executor: object = None,
    workers: int | None = None,
    client: object = None,
    store: str | Path | None = None,
    progress: Callable[[SweepProgress], None] | bool | None = None,
) -> Existence:
    """Where the orbits of a family exist in two parameters, and where they are motions.

    machine : as in `find`, with `with_values`; its values of the two parameters are not used
    along, between : the parameter along the rows, and their ends, (low, high) or (low, high, "log")
    across, values : the parameter that differs from row to row, and a list of its values, or a range like `between`
    family : number of the family, from 1
    samples : the number of values of a range, or a pair of numbers, along and across
    both_ways : whether to locate boundaries between the rows too, which helps if they are nearly parallel to the rows
    quantities, start : as in `sweep`; with a start, the machine must have the parameter values of that orbit
    executor, workers, client, store : as in `sweep`, for the grid
    progress : called with a `SweepProgress`; True prints a line, and None does so on a terminal

    The orbit of a machine is the one of least launch speed, or the one continued from the start. Boundaries are located
    to 1e-6 of a parameter's range wherever neighbours on the grid have different statuses; nothing is detected between
    neighbours of the same status. If orbits become too sensitive to be computed before they end, the boundary lies
    where they are lost, which rounding decides. If a `time_limit` is reached after the search of the grid, boundaries
    that are not yet located are midpoints between members, and `rests_on` says so; before that, `NoOrbit` is raised.
    Raises `InputError` for invalid arguments.

    >>> from orbits import existence
    >>> from problems import Hopper
    >>> diagram = existence(Hopper("cubic"), "beta", (-0.03, 0.01), "rest_length", [25.0, 30.0], samples=8)
    >>> [(round(low, 4), high) for low, high in diagram.motions(1)]
    [(-0.0067, 0.01)]
    """
    family_number(family)
    along, across = list_of_names("along, across", (along, across))
    if along == across:
        raise InputError(f"a diagram in '{along}' needs a second parameter")
    row, column = axis_of(along, between), axis_of(across, values)
    if row.values or row.distribution is not None or column.distribution is not None:
        raise InputError(
            f"between = {between!r} must be a range, (low, high), and values = {values!r} a list or a range"
        )
    if column.values:
        listed = sorted(set(column.values))
        column = replace(column, values=tuple(listed), low=listed[0], high=listed[-1])
    stated = samples if isinstance(samples, tuple) else (samples, samples)
    counts = tuple(whole_number("samples", each, "values", most=MOST_MEMBERS) for each in stated)
    if len(counts) != 2 or counts[0] == 1 or (counts[1] == 1 and not column.values):
        raise InputError(
            f"samples = {samples!r}: a range needs at least two values; for one row give a list of one value"
        )
    over, shape = {along: between, across: list(column.values) or values}, (counts[0], len(column.values) or counts[1])
    first = None if start is None else find(machine, start=start)
    show, sparse, began = on_screen(progress), None, perf_counter()
    if executor is None and client is None and store is None and start is None:
        check_executor(executor, workers)
        sparse = SparseGrid(checked_question(machine, over, shape, "grid", 0, family, quantities), show)
        swept = sparse.sweep()
    else:
        swept = sweep(
            machine, over, shape, sampling="grid", family=family, quantities=quantities, start=start, executor=executor,
            workers=workers, client=client, store=store, progress=progress,
        )  # fmt: skip

    def statuses_at(points: np.ndarray) -> np.ndarray:
        return solved_designs(machine, (along, across), points, family, {}, first).statuses

    def orbit_at(here: Machine) -> Orbit:
        if first is None:
            return find(here, family)
        (orbit,) = continued_orbits(machine, first, [here])
        if isinstance(orbit, NoOrbit):
            raise orbit
        return orbit_of(here, orbit)

    grid, curves, stopped = _grid_of(swept, (row, column)), list[BoundaryCurve](), ""
    found = grid.brackets()
    try:
        curves = boundary_curves(grid, orbit_at, machine)
        if sparse:
            sparse.search_around(_nodes_before(grid, curves))
            swept = sparse.sweep()
            grid = _grid_of(swept, (row, column))
            found = grid.brackets()
        found, passed = cut_by_curves(grid, curves, both_ways, statuses_at)
        done, met = len(swept) + 2 * passed, Counter[str](grid.statuses.ravel().tolist())
        show(SweepProgress(done, done, dict(met), perf_counter() - began, 0.0))
        if first is None:
            settled = partial(settled_designs, machine, (along, across))
            found = by_continuation(grid, found, both_ways, lambda points, near: settled(points, family, near))
    except TimeOver as over:
        stopped = str(over)
    found, later = bisected(grid, found, both_ways, statuses_at, show)
    boundaries, rows = Boundaries.of(grid, found, both_ways), tuple(grid.values[1].tolist())
    return Existence(along, across, rows, swept, boundaries, tuple(curves), stopped or later)


def _grid_of(swept: Sweep, axes: tuple[Axis, Axis]) -> Grid:
    """The nodes of a sweep; those of listed values lie at shares of the range between the first and the last."""
    shape = swept.about["shape"]
    names, (row, column) = (swept.parameters[0], swept.parameters[1]), axes
    values = swept[names[0]].reshape(shape)[:, 0], swept[names[1]].reshape(shape)[0]
    listed = (values[1] - column.low) / ((column.high - column.low) or 1.0)
    shares = np.linspace(0, 1, shape[0]), listed if column.values else np.linspace(0, 1, shape[1])
    return Grid(names, (row, replace(column, values=())), shares, values, swept["status"].reshape(shape))


def _nodes_before(grid: Grid, curves: Sequence[BoundaryCurve]) -> np.ndarray:
    """The nodes (k, 2) of the grid before the points of curves, by their indices."""
    points = [np.concatenate([[], *(getattr(curve, way) for curve in curves)]) for way in ("along", "across")]
    each = zip(grid.values, points, strict=True)
    return np.column_stack([np.searchsorted(values, places, side="right") - 1 for values, places in each])
