"""The answer of a sweep: its members as columns, tables, statistics, figures and orbits."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..design.designs_at_once import DESIGN_STATUSES
from ..errors import InputError
from ..io import check_path, extra_package, one_line, to_json, write_json, write_table, writing
from ..model.machine import Machine, machine_in_words
from ..periodic.find import find
from ..periodic.orbit import Orbit
from ..result import cell, shown
from ..units import DIMENSIONS_OF_HOPS, UNIT_TEXTS, unit_text
from .question import COLUMNS_OF, Question, Table, question_again

# The packages of the extra `data` that write files with these endings.
WRITERS = {".nc": ("xarray", "netCDF4"), ".parquet": ("pandas", "pyarrow")}
# Members that are written at a time.
AT_ONCE = 10_000
# Shares of the members below the quantiles that a summary tells.
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True, eq=False)
class Sweep:
    """The members of a sweep and their results; a column is accessed by its name, `sweep["alpha"]`.

    parameters : names of the parameters that differ
    index : the numbers (k,) of the members that are finished, of `count` in all; fewer than `count` where a store is
        read before its sweep has ended
    columns : (k,) by name: the parameters, the results, the status and the reason; NaN where there is no result
    about : the sweep in words and numbers
    machine : the machine whose parameters the members replace; None where a store is read without it
    question : what the sweep computes; None where a store is read without its machine
    again : (question, table of parameters, quantities, **options) -> the sweep of these members; set by the module
        `sweep`, which imports this one
    """

    parameters: tuple[str, ...]
    index: np.ndarray
    columns: Mapping[str, np.ndarray]
    about: Mapping[str, Any]
    machine: Machine | None = None
    question: Question | None = None
    again: ClassVar[Callable[..., "Sweep"]]

    @classmethod
    def of(cls, question: Question, table: Table) -> "Sweep":
        """The sweep with the results of a question in a table."""
        names, about = question.members.names, question.document()
        return cls(names, table.members, table.columns, about, question.machine, question)

    @classmethod
    def load(cls, path: str | Path, machine: Machine | None = None) -> "Sweep":
        """The members that a store has, while its sweep runs or after it.

        machine : the one that was swept, with which `orbit` finds members and `sensitivity` solves further ones; the
            store does not have it

        Raises `InputError` when the file is not a store, was changed, or is of another machine.
        """
        from .store import question_in, read_store  # imports the database

        about = question_in(path)
        if machine is not None and to_json(machine_in_words(machine)) != to_json(about["machine"]):
            raise InputError(f"the store {path} is of another machine: {about['machine']}")
        if about["outcome"] not in COLUMNS_OF:
            raise InputError(
                f"the store {path} has the outcome {about['outcome']!r}: it was changed, or is of a later version"
            )
        columns = dict.fromkeys(about["parameters"], float) | COLUMNS_OF[about["outcome"]]
        columns |= dict.fromkeys(about["quantities"], float) | {"status": str, "reason": str}
        table = read_store(path, columns)
        names = tuple(about["parameters"])
        if machine is None or "axes" not in about:
            return cls(names, table.members, table.columns, about, machine)
        values = np.column_stack([table.columns[name] for name in names])
        question = question_again(machine, about, values)
        return cls(names, table.members, table.columns, about, machine, question)

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.columns:
            raise InputError(f"the sweep has no column '{name}'; it has {', '.join(self.columns)}")
        return self.columns[name]

    @property
    def count(self) -> int:
        """The number of members of the sweep, finished or not."""
        return self.about["members"] * len(self.about["families"])

    @property
    def units(self) -> dict[str, str]:
        """The units of the columns by name; empty for a dimensionless machine."""
        own = self.about["machine"].get("units")
        rises = {name: "m" for name in self.columns if name.endswith("_rise")}
        hops = {name: unit_text(dimension) for name, dimension in DIMENSIONS_OF_HOPS.items()}
        return {} if own is None else {**UNIT_TEXTS, **rises, **hops, **own}

    def heading(self, name: str) -> str:
        """A name with its unit, if it has one: "alpha (m/s)"."""
        return f"{name} ({self.units[name]})" if self.units.get(name) else name

    @property
    def numbers(self) -> tuple[str, ...]:
        """The names of the columns with numerical results."""
        return tuple(name for name in self.columns if name not in (*self.parameters, "status", "reason"))

    def of_family(self, family: int) -> "Sweep":
        """The members of one of the families."""
        families = self.about["families"]
        if family not in families:
            raise InputError(f"the sweep has no family {family}; it has {', '.join(map(str, families))}")
        kept = np.flatnonzero(self.index % len(families) == families.index(family))
        about = {**self.about, "families": [family]}
        question = self.question and replace(self.question, families=(family,))
        columns = {name: column[kept] for name, column in self.columns.items()}
        index = self.index[kept] // len(families)
        return replace(self, index=index, columns=columns, about=about, question=question)

    def statuses(self) -> dict[str, int]:
        """The number of members of each status."""
        return dict(sorted(Counter(self.columns["status"].tolist()).items()))

    def summary(self) -> dict[str, Any]:
        """The number of members of each status, and the quantiles of the numerical results, by name."""
        quantiles: dict[str, dict[str, float]] = {}
        for name in self.numbers:
            known = self.columns[name][np.isfinite(self.columns[name])]
            if len(known):
                found = np.quantile(known, QUANTILES).tolist()
                quantiles[name] = {f"{share:.0%}": value for share, value in zip(QUANTILES, found, strict=True)}
        return {"count": self.count, "done": len(self), "status": self.statuses(), "quantiles": quantiles}

    def __repr__(self) -> str:
        return one_line(self, {"parameters": self.parameters, "count": self.count, **self.statuses()})

    def title(self) -> str:
        """The sweep and the statuses of its members, in one line."""
        machine, status = self.about["machine"], ", ".join(f"{n} {name}" for name, n in self.statuses().items())
        return f"{len(self)} of {self.count} members of {machine['machine']}, spring {machine['spring']}: {status}"

    def __str__(self) -> str:
        told, lines = self.summary(), [self.title()]
        lines += [f"  over {', '.join(map(self.heading, self.parameters))}"]
        width = max(map(len, map(self.heading, told["quantiles"])), default=0)
        if told["quantiles"]:
            lines.append(f"  {'':{width}}" + "".join(f"{share:>13.0%}" for share in QUANTILES))
        for name, found in told["quantiles"].items():
            lines.append(f"  {self.heading(name):<{width}}" + "".join(f"{value:13.6g}" for value in found.values()))
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        told = self.summary()
        rows = [
            (self.heading(name), *(f"{value:.5g}" for value in each.values()))
            for name, each in told["quantiles"].items()
        ]
        over = f"over {', '.join(map(self.heading, self.parameters))}"
        return cell(self.title(), rows, self.plot, [over, *(f"{share:.0%}" for share in QUANTILES)] if rows else ())

    def rows(self) -> Iterator[dict[str, Any]]:
        """The members as JSON-ready data, None for results that a member does not have."""
        whole = {name for name, kind in COLUMNS_OF[self.about["outcome"]].items() if kind is int}
        texts = ("status", "reason")
        for i, member in enumerate(self.index.tolist()):
            row: dict[str, Any] = {"index": member}
            for name, column in self.columns.items():
                value = column[i]
                if name not in texts:
                    value = None if np.isnan(value) else int(value) if name in whole else float(value)
                row[name] = value
            yield row

    def _values(self) -> Iterator[tuple]:
        """The values of each member in the order of the columns, few of them at a time as objects of Python."""
        columns = (self.index, *self.columns.values())
        for first in range(0, len(self), AT_ONCE):
            yield from zip(*(column[first : first + AT_ONCE].tolist() for column in columns), strict=True)

    def document(self) -> dict[str, Any]:
        """The sweep as the JSON document of the command line."""
        status = dict.fromkeys(self.known_statuses(), 0) | self.statuses()
        document = {"parameters": list(self.parameters), "count": self.count, "status": status}
        document |= {"units": self.units} if self.units else {}
        return {**document, "members": list(self.rows())}

    @property
    def found(self) -> int:
        """The number of members that have a result."""
        first = self.columns[self.numbers[0]]
        return int(np.isfinite(first).sum())

    def known_statuses(self) -> tuple[str, ...]:
        """The statuses that are reported even where no member has them."""
        return DESIGN_STATUSES if self.about["outcome"] == "find" else ()

    def orbit(self, member: int) -> Orbit:
        """A member as a whole orbit, with its motion.

        member : its number, from 0

        Raises `InputError` without a machine, for a sweep of another outcome than orbits and for an unknown member, and
        `NoOrbit` for a member without an orbit.
        """
        if self.machine is None:
            raise InputError("a store does not tell its machine: give it, Sweep.load(path, machine=...)")
        if self.about["outcome"] != "find":
            raise InputError(f"the members of this sweep are no orbits, but answer '{self.about['outcome']}'")
        place = np.flatnonzero(self.index == member)
        if not len(place):
            raise InputError(f"the sweep has no member {member}; it has {len(self)}, from 0")
        values = {name: float(self.columns[name][place[0]]) for name in self.parameters}
        families = self.about["families"]
        return find(self.machine.with_values(**values), families[member % len(families)])

    @property
    def dataset(self) -> Any:
        """The sweep as an `xarray.Dataset`: with the parameters as coordinates for a grid, else along "member"."""
        xarray = extra_package("xarray", "for a dataset")
        shape, families = self.about["shape"], self.about["families"]
        complete = len(self) == self.count
        dims: tuple[str, ...] = ("member",)
        coordinates: dict[str, Any] = {"member": self.index}
        sizes: tuple[int, ...] = (len(self),)
        if shape is not None and complete:
            axes = {
                name: np.moveaxis(self.columns[name].reshape(*shape, len(families)), i, 0).reshape(shape[i], -1)[:, 0]
                for i, name in enumerate(self.parameters)
            }
            coordinates = {name: (name, values, self._attributes(name)) for name, values in axes.items()}
            dims, sizes = self.parameters, tuple(shape)
            if len(families) > 1:
                dims, sizes = (*dims, "asked_family"), (*sizes, len(families))
                coordinates["asked_family"] = ("asked_family", list(families))
        data: dict[str, Any] = {}
        for name, column in self.columns.items():
            if name not in coordinates:
                data[name.replace("/", " over ")] = dims, column.reshape(sizes), self._attributes(name)
        return xarray.Dataset(data, coordinates, {"sweep": to_json(self.about)})

    def _attributes(self, name: str) -> dict[str, str]:
        """What a dataset tells of a column."""
        unit = self.units.get(name)
        return {"long_name": name.replace("_", " "), **({"units": unit} if unit else {})}

    def dataframe(self) -> Any:
        """The sweep as a `pandas.DataFrame`, a row for each member; the units are `dataframe.attrs["units"]`."""
        pandas = extra_package("pandas", "for a data frame")
        frame = pandas.DataFrame(dict(self.columns), index=pandas.Index(self.index, name="member"))
        frame.attrs["units"] = {name: unit for name, unit in self.units.items() if unit and name in frame}
        return frame

    def save(self, path: str | Path) -> Path:
        """Write the sweep to .csv or .json, or, with the extra `data`, to .nc (NetCDF) or .parquet; returns the path.

        Raises `InputError` for another ending, and when the file cannot be written.
        """
        path = check_table(path)
        ending = path.suffix.lower()
        if ending == ".csv":
            names = ["member", *map(self.heading, self.columns)]
            return write_table(names, ([_blank(value) for value in row] for row in self._values()), path, "sweep")
        if ending == ".json":
            return write_json(self.document(), path, "sweep")
        with writing("sweep", path) as target:
            if ending == ".nc":
                self.dataset.to_netcdf(target)
            else:
                self.dataframe().to_parquet(target)
        return path

    def plot(self, quantity: str | None = None, axes: Any = None) -> Any:
        """Plot a quantity, the first one if None, over the parameters; returns the axes.

        Over one parameter it is a line, over two a map, hatched where there is no motion, and over more a matrix of
        scatter plots.
        """
        return shown("sweep_figures").plot_sweep(self, quantity or self.numbers[0], axes)

    def page(self, path: str | Path, quantity: str | None = None) -> Path:
        """Write a page of a quantity, the first one if None, over the parameters, in one file (.html) that needs no
        network; returns its path.

        Raises `InputError` for a bad path, a quantity that is no number, and without Bokeh.
        """
        return shown("pages.still").sweep_page(self, path, quantity)

    def sensitivity(
        self, quantities: Sequence[str] | None = None, samples: int = 1024, seed: int = 0, **options: Any
    ) -> dict[str, dict[str, dict[str, float]]]:
        """Sobol's indices of the quantities: the shares of their variance that are due to each parameter, for
        parameters that vary independently over the ranges or distributions of the sweep.

        quantities : numerical results of the sweep; None for all
        samples : a power of 2; the sweep for the indices has `samples` times (the number of parameters plus 2) members
        seed : of the sampling
        options : `executor`, `workers`, `client`, `progress` of that sweep

        Returns, by quantity and parameter, "first" and "total", each with the bounds "first_low", ... of its 95 %
        confidence interval. Raises `InputError` where members have no orbit. Source: `scipy.stats.sobol_indices`.
        """
        from .indices import sobol_indices

        if self.question is None:
            raise InputError("Sobol's indices take a sweep with its machine: Sweep.load(store, machine=...)")
        return sobol_indices(self.question, quantities, samples, seed, partial(Sweep.again, self.question, **options))


def solves_again(function: Callable[..., Sweep]) -> Callable[..., Sweep]:
    """The same function, which is now what solves further members of a sweep."""
    Sweep.again = staticmethod(function)
    return function


def check_table(path: str | Path) -> Path:
    """The path of a file that a sweep is to be saved to; raises `InputError` where it cannot be, or where a package is
    missing that writes it."""
    path = check_path(path, "sweep")
    for package in WRITERS.get(path.suffix.lower(), ()):
        extra_package(package, f"to write {path}")
    return path


def _blank(value: Any) -> Any:
    """A value of a CSV file; nothing for what a member does not have."""
    return "" if isinstance(value, float) and np.isnan(value) else value
