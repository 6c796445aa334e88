"""The result of a sweep: its members as columns, tables, statistics, figures and orbits."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypedDict

import numpy as np

from ..design import DESIGN_STATUSES, tuned_orbit
from ..errors import InputError, NoOrbit, list_of_names, whole_number
from ..io import Document, conform, extra_package, named_file, to_json
from ..model import Machine
from ..periodic import Orbit, continued_orbits, find, orbit_of
from ..result import Axes, Result, Row, is_of, shown
from ..units import DIMENSIONS_OF_HOPS, OF_HEIGHTS, UNIT_TEXTS, unit_text
from .question import COLUMNS_OF, Question, SavedQuestion, Table, question_again
from .same_equations import refuse_other_equations

if TYPE_CHECKING:
    from .indices import Indices

TEXTS = ("status", "reason")  # columns that are not numbers
# Shares of the members below the quantiles of a summary.
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Result, what="sweep", document_is_whole=True):
    """The members of a sweep and their results; a column is accessed by its name, `sweep["alpha"]`.

    parameters : names of the parameters that differ
    index : the available members (k,) out of `count`; fewer if a store is read before its sweep has ended
    columns : (k,) by name: the parameters, the requested results, the status and the reason; NaN for a missing number
    about : the question in words and numbers
    source : the machine whose parameters the members replace; None for a file that is read without it
    question : the question of the sweep; None for a file that is read without its machine
    again : (question, table of parameters, quantities, **options) -> the sweep of these members; set by
        the module `sweep`, which imports this one
    """

    parameters: tuple[str, ...]
    index: np.ndarray
    columns: Mapping[str, np.ndarray]
    about: Mapping[str, Any]
    source: Machine | None = None
    question: Question | None = None
    again: ClassVar[Callable[..., "Sweep"]]

    @classmethod
    def of(cls, question: Question, table: Table) -> "Sweep":
        """The result of a question."""
        names, about = question.members.names, question.document()
        return cls(names, table.members, table.columns, about, question.machine, question)

    @classmethod
    def load(cls, path: str | Path, machine: Machine | None = None) -> "Sweep":
        """The members in a .json file that `save` wrote, or in a store, even while a sweep is running.

        machine : the machine of the sweep, which the store does not hold; `orbit` and `sensitivity` need it

        Raises `InputError` when the file is not a store, was changed, or belongs to another machine.
        """
        if (path := named_file(path)).suffix.lower() == ".json":
            return super().load(path, machine)
        from .store import question_in, read_store  # imports the database

        about = question_in(path)
        try:
            return cls._of_table(about, read_store(path, _columns_of_members(about)), machine)
        except ValueError as error:
            raise InputError(f"the store {path}: {error}") from None

    @classmethod
    def of_saved(cls, document: object, machine: Machine | None = None) -> "Sweep":
        data = cls._conform(document, _SavedSweep)
        conform(data["about"], SavedQuestion)
        rows, kinds = data["members"], _columns_of_members(data["about"])
        columns = {
            name: np.array([row[name] for row in rows], object if kind is str else float)
            for name, kind in kinds.items()
        }
        return cls._of_table(data["about"], Table(np.array([row["index"] for row in rows], np.int64), columns), machine)

    @classmethod
    def _of_table(cls, about: Mapping[str, Any], table: Table, machine: Machine | None) -> "Sweep":
        """The sweep of a question in words, with the table of its members."""
        names, question = tuple(about["parameters"]), None
        if machine is not None:
            is_of(machine, about["machine"])
            refuse_other_equations(about, machine)
            if "axes" in about:
                values = np.column_stack([table.columns[name] for name in names])
                question = question_again(machine, about, values)
        return cls(names, table.members, table.columns, about, machine, question)

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, name: str) -> np.ndarray:
        if not isinstance(name, str) or name not in self.columns:
            raise InputError(f"the sweep has no column {name!r}; it has {', '.join(self.columns)}")
        return self.columns[name]

    @property
    def count(self) -> int:
        """The number of members of the sweep, finished or not."""
        return self.about["members"] * len(self.about["families"])

    machine = property(lambda self: self.about["machine"])

    @cached_property
    def units(self) -> dict[str, str]:
        """The units of the columns by name; empty for a dimensionless machine."""
        own = self.machine.get("units")
        heights = {name: "m" for name in self.columns if name.endswith(OF_HEIGHTS)}
        hops = {name: unit_text(dimension) for name, dimension in DIMENSIONS_OF_HOPS.items()}
        return {} if own is None else {**UNIT_TEXTS, **heights, **hops, **own}

    @property
    def numbers(self) -> tuple[str, ...]:
        """The names of the columns with results that are numbers."""
        return tuple(name for name in self.columns if name not in (*self.parameters, *TEXTS))

    def of_family(self, family: int) -> "Sweep":
        """The members of one of the families."""
        families = self.about["families"]
        if family not in families:
            raise InputError(f"the sweep has no family {family}; it has {', '.join(map(str, families))}")
        chosen = np.flatnonzero(self.index % len(families) == families.index(family))
        about = {**self.about, "families": [family]}
        question = self.question and replace(self.question, families=(family,))
        columns = {name: column[chosen] for name, column in self.columns.items()}
        index = self.index[chosen] // len(families)
        return replace(self, index=index, columns=columns, about=about, question=question)

    def statuses(self) -> dict[str, int]:
        """The number of members of each status."""
        return dict(sorted(Counter(self.columns["status"].tolist()).items()))

    def quantiles(self) -> dict[str, dict[str, float]]:
        """The quantiles of each column of numbers, by share such as "5%", over the members that have a number."""
        quantiles: dict[str, dict[str, float]] = {}
        for name in self.numbers:
            known = self.columns[name][np.isfinite(self.columns[name])]
            if len(known):
                found = np.quantile(known, QUANTILES).tolist()
                quantiles[name] = {f"{share:.0%}": value for share, value in zip(QUANTILES, found, strict=True)}
        return quantiles

    def summary(self) -> dict[str, Any]:
        """The number of members of each status, and the quantiles of their numbers, such as "alpha 5%"."""
        return {"count": self.count, "done": len(self), **self.statuses(), **super().summary()}

    def _line(self) -> dict[str, object]:
        return {"parameters": self.parameters, "count": self.count, **self.statuses()}

    def title(self) -> str:
        status = ", ".join(f"{n} {name}" for name, n in self.statuses().items())
        words = f"{self.machine['machine']}, spring {self.machine['spring']}"
        return f"{len(self)} of {self.count} members of {words}: {status}"

    def heads(self) -> list[str]:
        shares = [f"{share:.0%}" for share in QUANTILES] if self.quantiles() else []
        return [f"over {', '.join(map(self.heading, self.parameters))}", *shares]

    def _rows(self) -> Iterator[Row]:
        """The quantiles of each number."""
        for name, each in self.quantiles().items():
            values = {f"{name} {share}": value for share, value in each.items()}
            yield Row(self.heading(name), values, ("{:.1e}" if name == "error" else "{:.6g}",) * len(values))

    def table(self) -> dict[str, np.ndarray]:
        """The columns, after the index "member"."""
        return {"member": self.index, **self.columns}

    def members(self) -> Iterator[dict[str, Any]]:
        """The members as JSON-ready data, None for values that a member does not have."""
        whole = {name for name, kind in COLUMNS_OF[self.about["outcome"]].items() if kind is int}
        for i, member in enumerate(self.index.tolist()):
            row: dict[str, object] = {"index": member}
            for name, column in self.columns.items():
                value = column[i]
                if name not in TEXTS:
                    kind = bool if name == "admissible" else int if name in whole else float
                    value = None if np.isnan(value) else kind(value)
                row[name] = value
            yield row

    def document(self) -> Document:
        known = DESIGN_STATUSES if self.about["outcome"] == "find" else ()  # counted even where no member has them
        status = dict.fromkeys(known, 0) | self.statuses()
        document = {"parameters": list(self.parameters), "count": self.count, "status": status}
        document |= {"units": self.units} if self.units else {}
        return {**document, "members": list(self.members())}

    def saved(self) -> Document:
        return {**super().saved(), "about": self.about}

    @property
    def found(self) -> int:
        """The number of members that have a result."""
        first = self.columns[self.numbers[0]]
        return int(np.isfinite(first).sum())

    def orbit(self, member: int) -> Orbit:
        """A member as a whole orbit, with its motion."""
        if self.source is None:
            raise InputError("a file does not hold its machine; pass it: Sweep.load(path, machine=...)")
        if self.about["outcome"] != "find":
            raise InputError(
                f"the members of this sweep are not orbits, but results of outcome = '{self.about['outcome']}'"
            )
        place = np.flatnonzero(self.index == whole_number("member", member, least=0))
        if not len(place):
            raise InputError(f"the sweep has no member {member}; it has {len(self)}, counted from 0")
        values = {name: float(self.columns[name][place[0]]) for name in self.parameters}
        families, machine = self.about["families"], self.source.with_values(**values)
        if (tuned := self.about.get("tune")) is not None:
            own = tuned, self.about["at"], self.about.get("start")
            return tuned_orbit(self.source, values, families[member % len(families)], *own)
        if (start := self.about.get("start")) is None:
            return find(machine, families[member % len(families)], method=self.about.get("method"))
        (orbit,) = continued_orbits(self.source, find(self.source, start=start), [machine])
        if isinstance(orbit, NoOrbit):
            raise orbit
        return orbit_of(machine, orbit)

    @property
    def dataset(self) -> Any:
        """The sweep as an `xarray.Dataset`, with the parameters of a grid as coordinates, else along "member"."""
        xarray = extra_package("xarray", "for a dataset")
        shape, families = self.about["shape"], self.about["families"]
        complete = len(self) == self.count
        dims: tuple[str, ...] = ("member",)
        coordinates: dict[str, object] = {"member": self.index}
        sizes: tuple[int, ...] = (len(self),)
        if shape is not None and complete:
            axes = {
                name: np.moveaxis(self.columns[name].reshape(*shape, len(families)), i, 0).reshape(shape[i], -1)[:, 0]
                for i, name in enumerate(self.parameters)
            }
            coordinates = dict(self.variable(name, values, name) for name, values in axes.items())
            dims, sizes = self.parameters, tuple(shape)
            if len(families) > 1:
                dims, sizes = (*dims, "asked_family"), (*sizes, len(families))
                coordinates["asked_family"] = ("asked_family", list(families))
        columns = ((name, column) for name, column in self.columns.items() if name not in coordinates)
        data = dict(self.variable(name, column, dims, sizes) for name, column in columns)
        return xarray.Dataset(data, coordinates, {"sweep": to_json(self.about)})

    def dataframe(self) -> Any:
        """The table in pandas, see `Result.dataframe`, a row for each member."""
        return super().dataframe().set_index("member")

    def plot(self, quantity: str | None = None, axes: Axes | None = None) -> Axes:
        """Plot a quantity, the first one if None, over the parameters; returns the axes.

        Over one parameter it is a line. Over two it is a map: where there is no motion, a grid is hatched and samples
        are circled. Over more it is a matrix of scatter plots in a figure of its own, without `axes`.
        """
        return shown("sweep_figures").plot_sweep(self, quantity or self.numbers[0], axes)

    def _draw(self, axes: Axes) -> Axes:
        return self.plot(axes=axes if len(self.parameters) <= 2 else None)

    def page(self, path: str | Path, quantity: str | None = None) -> Path:
        """Write a page of a quantity, the first one if None, over the parameters, in one file (.html) that needs no
        network; returns its path.

        Raises `InputError` for a bad path, a quantity that is not a number, and without Bokeh.
        """
        return shown("pages.saved_page").sweep_page(self, path, quantity)

    def sensitivity(
        self, quantities: str | Sequence[str] | None = None, samples: int = 1024, seed: int = 0, **options: object
    ) -> "Indices":
        """Sobol's indices of the quantities: the share of their variance that is due to each parameter, if the
        parameters vary independently over the ranges or distributions of the sweep.

        quantities : numerical results of the sweep, one or a list; None for all
        samples : a power of 2; the sweep for the indices has `samples` * (number of parameters + 2) members
        seed : of the sampling
        options : `executor`, `workers`, `client`, `progress` of that sweep

        Returns a mapping by quantity and parameter of "first" and "total", each with the bounds "first_low", ... of its
        95 % confidence interval. Raises `InputError` where members have no orbit. Source: `scipy.stats.sobol_indices`.
        """
        from .indices import sobol_indices

        if self.question is None:
            raise InputError("Sobol's indices need the machine of the sweep: Sweep.load(store, machine=...)")
        return sobol_indices(
            self.question,
            quantities if quantities is None else list_of_names("quantities", quantities),
            samples,
            seed,
            partial(Sweep.again, self.question, **options),
        )


def solves_again(function: Callable[..., Sweep]) -> Callable[..., Sweep]:
    """Register a function as the one that solves further members of a sweep."""
    Sweep.again = staticmethod(function)
    return function


class _SavedSweep(TypedDict):
    """A `Sweep` in a file, with the question in words."""

    members: tuple[Mapping[str, Any], ...]
    about: Mapping[str, Any]


def _columns_of_members(about: Mapping[str, Any]) -> dict[str, type]:
    """The columns of the members of a question in words, with their types; raises `ValueError` for an unknown one."""
    if about["outcome"] not in COLUMNS_OF:
        raise ValueError(
            f"its outcome {about['outcome']!r} is unknown: the file was changed, or a later version wrote it"
        )
    numbers = dict.fromkeys(about["parameters"], float) | COLUMNS_OF[about["outcome"]]
    numbers |= dict.fromkeys(about.get("tuned_columns", ()), float)
    return numbers | dict.fromkeys(about["quantities"], float) | dict.fromkeys(TEXTS, str)
