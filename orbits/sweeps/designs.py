"""Designs of experiments: the values of the parameters at which a sweep computes orbits."""

import csv
from ast import literal_eval
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import LARGEST_SEED, InputError, finite_number, is_list, one_of, whole_number
from ..io import MEGABYTE, read_file
from ..model import refuse_others
from ..numerics import sobol_points

SAMPLINGS = ("grid", "sobol", "lhs", "random")
# Largest number of members of a sweep: their columns in memory take some hundred bytes each.
MOST_MEMBERS = 10_000_000
# A table's column spans decades from this ratio of its largest to its smallest value on.
DECADES = 100.0
# Characters of the arguments of a distribution in a store.
LONGEST_ARGUMENTS = 1000
# A table of designs larger than this is refused before it is read.
LARGEST_TABLE = 1024 * MEGABYTE


@dataclass(frozen=True)
class Axis:
    """The values of one parameter: a list of `values`, a frozen `distribution` of `scipy.stats`, or a range."""

    values: tuple[float, ...] = ()
    distribution: Any = None
    low: float = 0.0
    high: float = 1.0
    logarithmic: bool = False

    @property
    def stated(self) -> list[Any]:
        """The list, the distribution or the range, as JSON-ready data."""
        if self.distribution is not None:
            return [self.distribution.dist.name, *map(repr, (self.distribution.args, self.distribution.kwds))]
        return list(self.values) or [self.low, self.high, *(["log"] if self.logarithmic else [])]

    @property
    def kind(self) -> str:
        """The kind of data in `stated`."""
        return "distribution" if self.distribution is not None else "values" if self.values else "range"

    @classmethod
    def of_stated(cls, kind: str, stated: Sequence[Any]) -> "Axis":
        """The axis whose `kind` and `stated` these are; raises `InputError` for data that state none."""
        try:
            if kind == "distribution":
                return cls(distribution=_frozen(*stated))
            if kind == "values":
                return cls(tuple(stated))
            return cls(low=stated[0], high=stated[1], logarithmic=len(stated) == 3)
        except InputError:
            raise
        except (ValueError, TypeError, IndexError, KeyError, SyntaxError, MemoryError, RecursionError):
            raise InputError(f"{str(stated)[:80]} states no {kind}") from None

    def at(self, shares: np.ndarray) -> np.ndarray:
        """The values (m,) at shares (m,) between 0 and 1 of the range, the list or the probability."""
        if self.distribution is not None:
            return np.asarray(self.distribution.ppf(shares), dtype=float)
        if self.values:
            return np.array(self.values)[np.minimum((shares * len(self.values)).astype(int), len(self.values) - 1)]
        if self.logarithmic:
            return np.clip(self.low * (self.high / self.low) ** shares, self.low, self.high)
        return (1 - shares) * self.low + shares * self.high

    def share(self, value: float) -> float:
        """The share of the range at which a value lies."""
        if self.logarithmic:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)


def _frozen(name: str, arguments: str, options: str) -> Any:
    """The frozen distribution of `scipy.stats` with these arguments, which are written as in Python."""
    from scipy import stats

    family = getattr(stats, name, None)
    if not isinstance(family, stats.rv_continuous | stats.rv_discrete):
        raise InputError(f"{name!r} is not a distribution of scipy.stats")
    if len(arguments) + len(options) > LONGEST_ARGUMENTS:
        raise InputError(f"the arguments of {name!r} have more than {LONGEST_ARGUMENTS} characters")
    return family(*literal_eval(arguments), **literal_eval(options))


@dataclass(frozen=True)
class Members:
    """The members of a sweep: parameters by name, in order.

    values : (m, number of names)
    shape : the numbers of values along each parameter, whose product is m, for a grid; None for any other design
    axes : the axis of each parameter; empty for a table
    drawn : how they were drawn, in words
    """

    names: tuple[str, ...]
    values: np.ndarray
    shape: tuple[int, ...] | None = None
    axes: tuple[Axis, ...] = ()
    drawn: str = ""

    def __len__(self) -> int:
        return len(self.values)

    @property
    def logarithmic(self) -> list[str]:
        """The names of the parameters with a logarithmic range, or whose column in a table spans decades."""
        if self.axes:
            return [name for name, axis in zip(self.names, self.axes, strict=True) if axis.logarithmic]
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        return [name for name, a, b in zip(self.names, low, high, strict=True) if 0 < DECADES * a <= b]


def members_of(
    over: Mapping[str, object] | Sequence[str] | None,
    samples: object,
    sampling: str | None,
    seed: int,
    allowed: Sequence[str],
    machine: Any = None,
) -> Members:
    """The members of a sweep over some of the parameters `allowed` of a machine; the others as in `sweep`.

    Raises `InputError` that names the invalid argument.
    """
    table = samples is not None and not isinstance(samples, int | np.integer | float | tuple)
    if table:
        if isinstance(over, Mapping):
            raise InputError("a table of samples has the values: over must then be the names of its columns, or None")
        if sampling is not None:
            raise InputError(
                f"sampling = {sampling!r} draws samples, but a table of samples has them already: leave it out"
            )
        return _members_of_table(samples, None if over is None else list(over), allowed, machine)
    if not isinstance(over, Mapping) or not over:
        raise InputError(f"over = {over!r}; it must map names of parameters to values or ranges, as {{'k': (1, 2)}}")
    refuse_others(machine, over, "to sweep over", allowed)
    axes = {name: axis_of(name, stated) for name, stated in over.items()}
    if sampling is None:
        sampling = "grid" if isinstance(samples, tuple) or all(axis.values for axis in axes.values()) else "sobol"
    if one_of("sampling", sampling, SAMPLINGS) == "grid":
        return _grid(axes, samples)
    count = whole_number("samples", 1000 if samples is None else samples, "members", most=MOST_MEMBERS)
    shares = _shares(sampling, count, len(axes), whole_number("seed", seed, least=0, most=LARGEST_SEED))
    columns = [axis.at(column) for axis, column in zip(axes.values(), shares.T, strict=True)]
    drawn = f"{sampling}, seed {seed}"
    return _finite_members(Members(tuple(axes), np.column_stack(columns), None, tuple(axes.values()), drawn))


def axis_of(name: str, stated: object) -> Axis:
    """The axis that is stated for a parameter: a range (low, high) or (low, high, "log"), a list of values, or a frozen
    distribution of `scipy.stats`. Raises `InputError` for anything else."""
    if hasattr(stated, "ppf"):
        return Axis(distribution=stated)
    if isinstance(stated, tuple) and len(stated) in (2, 3) and not (len(stated) == 3 and stated[2] != "log"):
        low, high = (finite_number(f"over '{name}'", value) for value in stated[:2])
        if not low < high:
            raise InputError(f"over '{name}' = {stated}: low must be below high; for one value give a list, [{low:g}]")
        if len(stated) == 3 and not low > 0:
            raise InputError(f"over '{name}' = {stated}: a logarithmic range must lie above 0")
        return Axis(low=low, high=high, logarithmic=len(stated) == 3)
    if isinstance(stated, list | np.ndarray | range) and is_list(stated):
        values = tuple(finite_number(f"over '{name}'", value) for value in stated)
        if not values:
            raise InputError(f"over '{name}' = {stated!r} has no values")
        return Axis(values)
    known = "a range (low, high) or (low, high, 'log'), a list of values or a frozen distribution of scipy.stats"
    raise InputError(f"over '{name}' = {stated!r}; it must be {known}")


def _grid(axes: Mapping[str, Axis], samples: object) -> Members:
    """All combinations; `samples` is the number of values of each range, or a tuple of one for each axis."""
    ranges = [name for name, axis in axes.items() if not axis.values]
    counts = samples if isinstance(samples, tuple) else (10 if samples is None else samples,) * len(axes)
    if len(counts) != len(axes):
        raise InputError(f"samples = {samples}: a grid over {', '.join(axes)} needs {len(axes)} numbers of values")
    columns = []
    for (name, axis), count in zip(axes.items(), counts, strict=True):
        if axis.values:
            columns.append(np.array(axis.values))
            continue
        count = whole_number("samples", count, f"values of '{name}' on the grid", most=MOST_MEMBERS)
        # The ends of a distribution may be infinite; its values then lie at the midpoints of equal shares.
        shares = np.linspace(0, 1, count) if np.isfinite(axis.at(np.array([0.0, 1.0]))).all() else None
        columns.append(axis.at((np.arange(count) + 0.5) / count if shares is None or count == 1 else shares))
    shape = tuple(map(len, columns))
    if float(np.prod(shape, dtype=float)) > MOST_MEMBERS:
        raise InputError(
            f"samples = {samples}: a grid of {' x '.join(map(str, shape))} has more than {MOST_MEMBERS} members"
        )
    if not ranges and samples is not None and not isinstance(samples, tuple):
        raise InputError(f"samples = {samples}: the lists already set the size of the grid; leave samples out")
    values = np.stack(np.meshgrid(*columns, indexing="ij"), axis=-1).reshape(-1, len(columns))
    return _finite_members(Members(tuple(axes), values, shape, tuple(axes.values())))


def _shares(sampling: str, count: int, dimensions: int, seed: int) -> np.ndarray:
    """Points (count, dimensions) in the unit cube, reproducible by their seed."""
    if sampling == "random":
        return np.random.default_rng(seed).random((count, dimensions))
    if sampling == "sobol":
        return sobol_points(count, dimensions, seed)
    from scipy.stats import qmc  # slow to import

    return qmc.LatinHypercube(dimensions, seed=seed).random(count)


def _members_of_table(table: Any, wanted: list[str] | None, allowed: Sequence[str], machine: Any) -> Members:
    """The members that a DataFrame, a mapping of arrays or a CSV file states; all columns where none are `wanted`."""
    name = "samples"
    if isinstance(table, str | Path):
        name, columns = str(table), read_designs(table)
    elif isinstance(table, Mapping) or hasattr(table, "columns"):
        columns = {str(name): table[name] for name in table}
    else:
        raise InputError(
            f"samples = {table!r}; it must be a number, a DataFrame, a mapping of arrays or a CSV file's name"
        )
    if not columns:
        raise InputError("the table of samples has no columns")
    if missing := [name for name in wanted or () if name not in columns]:
        raise InputError(f"the table of samples has no column '{missing[0]}'; it has {', '.join(columns)}")
    names = tuple(columns if wanted is None else wanted)
    refuse_others(machine, names, "to sweep over", allowed)
    arrays = [as_numbers(each, columns[each], name) for each in names]
    if len(set(map(len, arrays))) > 1:
        lengths = ", ".join(f"{name} {len(array)}" for name, array in zip(names, arrays, strict=True))
        raise InputError(f"the columns of samples have different lengths: {lengths}")
    return _finite_members(Members(names, np.column_stack(arrays)))


def read_designs(path: str | Path) -> dict[str, list[str]]:
    """The columns of a CSV file by name; raises `InputError` for a file that is not a table."""
    return read_file(path, f"{path} is not a table of designs", _csv_columns, LARGEST_TABLE)


def _csv_columns(file: BinaryIO) -> dict[str, list[str]]:
    """The columns of a CSV file by the names in its first line."""
    try:
        return _named_columns(csv.reader(_text_lines(file)))
    except csv.Error as error:
        raise ValueError(error) from None


def _named_columns(rows: Any) -> dict[str, list[str]]:
    """The columns of rows whose first one has their names."""
    names = [name.strip() for name in next(rows, [])]
    if not names or not all(names) or len(set(names)) < len(names):
        raise ValueError(f"its first line, {names}, must name the columns, each once")
    columns: dict[str, list[str]] = {name: [] for name in names}
    for row in rows:
        if row and len(row) != len(names):
            raise ValueError(f"line {rows.line_num} has {len(row)} values for {len(names)} columns")
        for name, value in zip(names, row, strict=False):
            columns[name].append(value)
    if not columns[names[0]]:
        raise ValueError("it has no rows below the names of its columns")
    return columns


def _text_lines(file: BinaryIO) -> Iterator[str]:
    """The lines of a file; raises `ValueError` for one that is not text."""
    for i, line in enumerate(file):
        try:
            yield line.decode("utf-8-sig" if i == 0 else "utf-8")
        except UnicodeDecodeError:
            raise ValueError(f"line {i + 1} is not text in UTF-8: save the file in UTF-8") from None


def as_numbers(name: str, column: Iterable[Any], table: str = "samples") -> np.ndarray:
    """A column of a table as numbers (m,); raises `InputError` with the first value that is not a finite number."""
    entries = column if isinstance(column, np.ndarray) and column.dtype.kind == "f" else list(column)
    try:
        values = np.array([np.nan if isinstance(value, bool) else float(value) for value in entries])
    except (TypeError, ValueError, OverflowError):
        values = np.array([_as_number(value) for value in entries])
    if not np.isfinite(values).all():
        row = int(np.argmin(np.isfinite(values)))
        raise InputError(f"{table}: row {row + 1} of column '{name}' is {entries[row]!r}, which is not a finite number")
    return values


def _as_number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return np.nan


def _finite_members(members: Members) -> Members:
    """The members; raises `InputError` where there are none, too many, or a value is not finite."""
    if not 0 < len(members) <= MOST_MEMBERS:
        raise InputError(f"a sweep must have from 1 to {MOST_MEMBERS} members, not {len(members)}")
    for name, column in zip(members.names, members.values.T, strict=True):
        if not np.isfinite(column).all():
            raise InputError(f"over '{name}': its distribution has values that are not finite")
    return members
