"""Common to all results: a result declares what it has, and `Result` prints, shows, tables, saves and loads it.

The room `show`, which draws results, stands above all of them: `shown` is the one way up to it, taken when something is
drawn.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cached_property, partial
from importlib import import_module
from io import BytesIO
from operator import attrgetter
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, BinaryIO, ClassVar, NamedTuple, Self, TypeAlias, TypeVar, get_type_hints

import numpy as np

from .errors import InputError
from .io import (
    MEGABYTE,
    Document,
    check_ending,
    check_path,
    conform,
    extra_package,
    one_line,
    read_file,
    read_sealed,
    to_json,
    write_json,
    write_table,
    writing,
)
from .model import Machine, machine_in_words
from .running import check_report
from .tables import DIGITS, digits_within, escaped, html_table, number_text, text_table, wrapped
from .units import OF_HEIGHTS, UNIT_TEXTS

# A `matplotlib.axes.Axes`. The import waits until something is drawn, and its types differ between versions.
Axes: TypeAlias = Any
Progress: TypeAlias = Callable[[float], None] | None  # called with the share that is done
Item = TypeVar("Item")


class DisplayOptions(NamedTuple):
    """The sizes of results in cells of a notebook, and of tables."""

    dots_per_inch: int = 150  # sharp on most screens, and a picture of some 30 kB
    rows_of_cell: int = 30  # of a table in a cell; a design with the certificate of its orbit has fewer
    at_once: int = 10_000  # rows of a table that are objects of Python together, as it is written


DISPLAY = DisplayOptions()
ALL_DIGITS = "all"  # the format of a number with all the digits that its error allows
MOST_DIGITS = 15  # that every double keeps
TABLE_ROWS = 201  # of a motion whose times are not stated
NOTE = "font:13px/1.45 system-ui,sans-serif;margin:6px 0;max-width:56ch;overflow-wrap:anywhere"
TITLE = "font:600 13px/1.45 system-ui,sans-serif;margin:4px 0;overflow-wrap:anywhere"
SIDE_BY_SIDE = "display:flex;flex-wrap:wrap;gap:8px 28px;align-items:flex-start"
# The endings of the files that a result is saved to, with the packages that write them.
ENDINGS: dict[str, tuple[str, ...]] = {
    ".json": (), ".csv": (), ".nc": ("xarray", "netCDF4"), ".parquet": ("pandas", "pyarrow"),
}  # fmt: skip


def shown(module: str) -> Any:
    """The module of the room `show` with this name, such as "plot" or "pages.saved_page"."""
    return import_module(f"{__package__}.show.{module}")


def reported(items: Sequence[Item], progress: Progress) -> Iterator[Item]:
    """The items, one after the other, with a report of the share that is done after each; raises `InputError` for what
    takes no such report."""
    check_report("progress", progress)
    for i, item in enumerate(items, 1):
        yield item
        if progress:
            progress(i / len(items))


class _Shown:
    """A value within the pattern of a row: a number has all the digits that its table shows and its error allows,
    unless it says how; by "all" it has those on a page too."""

    def __init__(self, value: Any, digits: int, error: float | None):
        self.value, self.digits, self.error = value, digits, error

    def __format__(self, spec: str) -> str:
        if spec not in ("", ALL_DIGITS) and self.value is not None:
            return format(self.value, spec)
        most = MOST_DIGITS if spec else self.digits
        if self.error is None or not isinstance(self.value, float):
            return number_text(self.value, "", most)
        digits = digits_within(self.value, self.error, most)
        return number_text(self.value, "", digits, zeros=digits < most and self.value != 0)


class Row(NamedTuple):
    """A row of the table of a result.

    heading : its first cell, a text or a number
    values : the numbers and texts that the row is about, by name
    cells : its other cells, patterns as for `str.format`, with a pair of braces for each of the values in their order
    errors : of values, by name; each value is shown with the digits that its error allows
    """

    heading: Any
    values: Mapping[str, Any]
    cells: tuple[str, ...] = ("{}",)
    errors: Mapping[str, float] = MappingProxyType({})

    @classmethod
    def of(cls, name: str, value: object, unit: str = "", after: str = "", pattern: str = "{}") -> "Row":
        """The row of one value by a pattern, with its unit and the text after it; its heading is the name in words."""
        unit = f" {unit}" if unit and value is not None else ""
        return cls(name.replace("_", " ").replace("liftoff", "lift-off"), {name: value}, (f"{pattern}{unit}{after}",))

    def texts(self, digits: int) -> tuple[str, ...]:
        """The row as texts; its numbers have this number of digits unless their cell says otherwise."""
        values = (_Shown(value, digits, self.errors.get(name)) for name, value in self.values.items())
        return number_text(self.heading, digits=digits), *"\0".join(self.cells).format(*values).split("\0")


class Result:
    """The methods of all results. Each verb means one thing for all of them:

    machine : the machine in words and numbers, as it describes itself; empty if the result has none. `source` is the
        machine itself, if it is known
    units : the unit of each quantity by name, "m/s"; empty for a dimensionless machine
    summary : the numbers and texts of the result, by name; `rows()` is the table of their texts, which `str(result)`
        prints and a notebook shows next to `plot()`
    table : the data as columns of one length, by name, with the units of `units`; `dataframe()`, `dataset` and
        the files .csv, .nc and .parquet are made of it
    document : the result as JSON-ready data, as the command line prints it
    save : a file, whose ending says which; `load(path)` reads the .json again, to the last bit
    page : an HTML file that needs no network

    A class of results defines `what` its results are called in messages and files; the names `in_line`, the `title`
    and, unless its `table` is short, its `_rows`; `document`, and `of_saved`, which restores the result from what
    `saved` put into a file. Names that only other modules use are `internal`: `dir` and completion leave them out, as
    well as fields that a result does not have.
    """

    what: ClassVar[str]
    in_line: ClassVar[tuple[str, ...]] = ()  # attributes in the one line of its `repr`
    endings: ClassVar[tuple[str, ...]] = tuple(ENDINGS)
    printed_digits: ClassVar[int] = 12
    dimension: ClassVar[str] = "row"  # what the rows of the table are called in a dataset
    largest_file: ClassVar[int] = 32 * MEGABYTE
    document_is_whole: ClassVar[bool] = False  # whether `of_saved` needs no more than the document
    undrawn: ClassVar[str] = ""  # why such results have no picture; "" for results with a `plot` of their own
    internal: ClassVar[tuple[str, ...]] = (
        "dimension", "document_is_whole", "endings", "form", "heading", "heads", "in_line", "internal", "largest_file",
        "of_saved", "printed_digits", "rows", "saved", "title", "undrawn", "unit_of", "variable", "what",
    )  # fmt: skip
    machine: Mapping[str, Any]

    def __init_subclass__(cls, **own: object) -> None:
        """A class of results states its values of the names above in its heading."""
        super().__init_subclass__()
        for name, value in own.items():
            setattr(cls, name, value)

    if not TYPE_CHECKING:  # which would take any name for one of the result

        def __getattr__(self, name: str) -> Any:
            """Raise `AttributeError`, which says in which part of the result a name is."""
            if hasattr(type(self), name):
                return object.__getattribute__(self, name)  # once more, for the error in it
            own = f"'{type(self).__name__}' object has no attribute '{name}'"
            place = "" if name.startswith("_") else _place_of(self, name)
            raise AttributeError(f"{own}; take {place}" if place else own, name=name, obj=self)

    def __dir__(self) -> list[str]:
        internal = {name for each in type(self).__mro__ for name in vars(each).get("internal", ())}
        internal |= {
            name for name, value in vars(self).items() if value is None or (isinstance(value, dict) and not value)
        }
        return sorted({*super().__dir__()} - internal)

    @cached_property
    def units(self) -> Mapping[str, str]:
        """The units of the quantities and parameters by name; empty for a dimensionless machine."""
        own = self.machine.get("units")
        return {} if own is None else {**UNIT_TEXTS, **own}

    def title(self) -> str:
        """What the result is, in one line."""
        raise NotImplementedError

    def table(self) -> Mapping[str, Any]:
        """The data as columns of one length, by name."""
        raise NotImplementedError

    def document(self) -> Document:
        """The result as JSON-ready data, as the command line prints it."""
        return stored(self)

    def heads(self) -> list[str]:
        """The headings of the columns of `rows`; none where these are names and values."""
        return [*map(self.heading, self.table())] if type(self)._rows is Result._rows else []

    def _rows(self) -> Iterable[Row]:
        """The rows of its table: those of the `table` itself."""
        names = [*self.table()]
        for i, row in enumerate(_table_rows([*self.table().values()])):
            of = f"of {row[0]}" if isinstance(row[0], str) else f"{i}"
            yield Row(
                row[0], {f"{n} {of}": x for n, x in zip(names[1:], row[1:], strict=True)}, ("{}",) * (len(row) - 1)
            )

    def _notes(self) -> list[str]:
        """Texts below its table."""
        return []

    def _line(self) -> Mapping[str, object]:
        """The contents of the one line of its `repr`."""
        return {name.split(".")[-1]: attrgetter(name)(self) for name in self.in_line}

    def __repr__(self) -> str:
        return one_line(self, self._line())

    def summary(self) -> dict[str, Any]:
        """The numbers and texts of the result by name; a second value of the same name is "name 2"."""
        found, count = dict[str, object](), Counter[str]()
        for name, value in (pair for row in self._rows() for pair in row.values.items()):
            count[name] += 1
            found[f"{name} {count[name]}" if name in found else name] = value
        return found

    def rows(self, digits: int = DIGITS) -> list[tuple[str, ...]]:
        """The summary as texts, a heading and one or more cells for each row of a table."""
        return [row.texts(digits) for row in self._rows()]

    def __str__(self) -> str:
        lines = text_table(self.rows(self.printed_digits), self.heads())
        notes = [line for note in self._notes() for line in wrapped(note, indent="  ")]
        return "\n".join([*wrapped(self.title(), onward="    "), *lines, *notes])

    def _repr_html_(self) -> str:
        draw = None if self.undrawn else self._draw
        return cell(self.title(), self.rows(), draw, self.heads(), self._notes())

    def _draw(self, axes: Axes) -> Axes:
        """Draw the picture of a cell on these axes or in a figure of its own; returns its axes."""
        return self.plot(axes=axes)

    def plot(self, *args: Any, **options: Any) -> Axes:
        """Draw the result; raises `InputError` with the reason where there is nothing to draw."""
        raise InputError(self.undrawn)

    def page(self, path: str | Path) -> Path:
        """Write a page of the result in one file (.html) that needs no network; returns its path."""
        return shown("pages.saved_page").result_page(self, path, None if self.undrawn else self._draw, self._notes())

    def unit_of(self, name: str) -> str:
        """The unit of a quantity, "" where it has none."""
        is_height = bool(self.units) and name.isidentifier() and name.endswith(OF_HEIGHTS)
        return self.units.get(name, "m" if is_height else "") or ""

    def heading(self, name: str) -> str:
        """A name with its unit, if it has one: "alpha (m/s)"."""
        return f"{name} ({self.unit_of(name)})" if self.unit_of(name) else name

    def dataframe(self, *args: Any, **options: Any) -> Any:
        """The `table`, which takes these arguments, as a `pandas.DataFrame`; `dataframe.attrs["units"]` has the units
        by column. Raises `InputError` without pandas, which the extra `data` installs."""
        frame = extra_package("pandas", "for a data frame").DataFrame(dict(self.table(*args, **options)))
        frame.attrs["units"] = {name: self.unit_of(name) for name in frame if self.unit_of(name)}
        return frame

    @property
    def dataset(self) -> Any:
        """The `table` as an `xarray.Dataset`; raises `InputError` without xarray, which the extra `data` installs."""
        xarray = extra_package("xarray", "for a dataset")
        columns = dict(self.variable(name, column, self.dimension) for name, column in self.table().items())
        machine = machine_in_words(self.machine) if isinstance(self.machine, Machine) else self.machine
        return xarray.Dataset(columns, attrs={"title": self.title(), "machine": to_json(machine)})

    def variable(self, name: str, column: object, dims: object, shape: Sequence[int] = (-1,)) -> tuple[str, tuple]:
        """A column as a variable of a dataset with these dimensions, under a name that NetCDF accepts, with its
        description and "" for None."""
        values = np.asarray(column)
        if values.dtype == object:
            values = np.array(["" if each is None else str(each) for each in values.ravel()])
        unit = {"units": self.unit_of(name)} if self.unit_of(name) else {}
        plain = name.replace("/", " over ")
        plain = plain if plain[:1].isidentifier() else f"_{plain}"
        return plain, (dims, values.reshape(shape), {"long_name": name.replace("_", " "), **unit})

    def save(self, path: str | Path) -> Path:
        """Write the result to a file and return its path: the whole result to .json, for `load`, or its `table` to .csv
        or, with the extra `data`, to .nc (NetCDF) or .parquet. Floats have all their digits.

        Raises `InputError` when the file cannot be written.
        """
        path = check_ending(path, self.endings)
        if (ending := path.suffix.lower()) == ".json":
            return write_json(self.saved(), path, self.what)
        if ending == ".csv":
            table = self.table()
            return write_table([*map(self.heading, table)], _table_rows([*table.values()]), path, self.what)
        with writing(self.what, check_file(path)) as target:
            if ending == ".nc":
                self.dataset.to_netcdf(target)
            else:
                Result.dataframe(self).to_parquet(target)
        return path

    @classmethod
    def form(cls) -> str:
        """The "format" that a file of such a result states."""
        return f"persistent-orbits {cls.what} 1"

    def saved(self) -> Document:
        """The document of a file of the result, and the fields that it lacks, for `of_saved`."""
        whole = self.document_is_whole or type(self).document is Result.document
        return {"format": self.form(), **self.document(), **({} if whole else {"fields": stored(self)})}

    @classmethod
    def of_saved(cls, document: object, machine: Machine | None = None) -> Any:
        """The result in a document of `saved`; raises `ValueError` if its parts contradict each other, or if it belongs
        to another machine."""
        whole = cls._conform(document, Mapping[str, Any])
        return cls(**cls._fields_in(whole.get("fields", whole), machine))

    @classmethod
    def _fields_in(cls, data: Mapping[str, Any], machine: Machine | None = None) -> dict[str, Any]:
        """The fields of the result in a document, each checked against its type."""
        own, kinds = dict[str, object](), get_type_hints(cls)
        for each in fields(cls):  # type: ignore[arg-type]
            name, kind = each.name, kinds[each.name]
            if name not in data:
                continue
            if name == "source":
                own[name] = is_of(machine, **data[name])
            elif isinstance(kind, type) and issubclass(kind, Result):
                own[name] = kind.of_saved(data[name], machine)
            else:
                own[name] = conform(data[name], kind, name)
        return own

    @classmethod
    def load(cls, path: str | Path, machine: Machine | None = None) -> Self:
        """Read a result that `save` wrote to .json.

        machine : the machine of the result, needed if the file does not hold it: for designs, fronts and simulations,
            and if a file cannot state it, for example because its spring is a Python function. It becomes the `source`
            of the result; results without a source ignore it

        Raises `InputError` when the file is not such a result, was changed since, or belongs to another machine.
        """
        return read_file(path, f"{path} is not a saved {cls.what}", partial(cls._read, machine), cls.largest_file)

    @classmethod
    def _read(cls, machine: Machine | None, file: BinaryIO) -> Any:
        return cls.of_saved(read_sealed(file), machine)

    @classmethod
    def _conform(cls, document: object, kind: object) -> Any:
        """The document of a file of such a result, checked against its type; raises `ValueError` for another format."""
        data = conform(document, kind)
        if data.get("format") != cls.form():
            raise ValueError(f"format {data.get('format')!r}, expected {cls.form()!r}")
        return data


def _place_of(value: object, name: str) -> str:
    """Where a public part of a value, or a part of that, has an attribute, as "certificate.clearance"; else ""."""
    public = (own for own in dir(value) if own in vars(value) and not own.startswith("_"))
    parts = {own: vars(value)[own] for own in public}
    parts = {own: part for own, part in parts.items() if is_dataclass(part) and not isinstance(part, type)}
    for own, part in parts.items():
        if name in vars(part) or hasattr(type(part), name):
            return f"{own}.{name}"
    places = ((own, _place_of(part, name)) for own, part in parts.items())
    return next((f"{own}.{place}" for own, place in places if place), "")


def check_file(path: str | Path, endings: Sequence[str] = tuple(ENDINGS)) -> Path:
    """The path of a file that a result is to be saved to; raises `InputError` where it cannot be, or where a package is
    missing that writes it."""
    path = check_path(path, tuple(endings))
    for package in ENDINGS.get(path.suffix.lower(), ()):
        extra_package(package, f"to write {path}")
    return path


def _table_rows(columns: Sequence[Any]) -> Iterable[tuple]:
    """The rows of columns (m,), few of them at a time as objects of Python; a number that there is not is empty."""
    for first in range(0, len(columns[0]) if columns else 0, DISPLAY.at_once):
        parts = (np.asarray(column)[first : first + DISPLAY.at_once].tolist() for column in columns)
        for row in zip(*parts, strict=True):
            yield tuple("" if each is None or each != each else each for each in row)


def stored(value: Any) -> Any:
    """A value as JSON-ready data: a dataclass by its fields without the missing ones, such as NaN, a machine in words
    and by its values, and a result within another one as its own file has it."""
    if isinstance(value, np.ndarray):
        return stored(value.tolist()) if value.size or value.ndim < 2 else None  # a list has but its first dimension
    if hasattr(value, "describe"):
        return {"words": machine_in_words(value), "values": dict(value.values)}
    if is_dataclass(value):
        parts = ((each.name, getattr(value, each.name)) for each in fields(value))
        inner = {name: part.saved() if isinstance(part, Result) else stored(part) for name, part in parts}
        return {name: part for name, part in inner.items() if part is not None}
    if isinstance(value, Mapping):
        return {name: stored(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [*map(stored, value)]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def known(numbers: Any) -> list[float | None]:
    """Numbers (m,) for JSON, None for numbers that are not finite."""
    return [value if np.isfinite(value) else None for value in np.ravel(numbers).tolist()]


def is_of(machine: Any, words: Mapping[str, object], values: Mapping[str, float] = MappingProxyType({})) -> Any:
    """The machine of a result that is read again, with these values of its parameters, which then describes itself in
    these words; raises `InputError` for none, and `ValueError` for another one."""
    if machine is None:
        raise InputError("the file does not hold its machine; pass it: load(path, machine)")
    if changed := {name: value for name, value in values.items() if machine.values.get(name) != value}:
        machine = machine.with_values(**changed)
    if json.loads(to_json(machine_in_words(machine))) != json.loads(to_json(words)):
        raise ValueError(f"it belongs to another machine: {dict(words)}")
    return machine


def cell(
    title: str,
    rows: Sequence[Sequence[str]],
    draw: Callable[..., Any] | None = None,
    heads: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> str:
    """A result in HTML, for its `_repr_html_`: a table as `html_table` makes it, and a picture.

    draw : called with `axes`, draws the picture and returns the axes; None for none. Where that fails the reason stands
        in its place
    notes : texts below the table
    """
    words = f'<div style="flex:0 1 auto;max-width:100%;overflow-x:auto">{table_with_notes(rows, heads, notes)}</div>'
    beside = f'<div style="{SIDE_BY_SIDE}">{words}{_picture(title, draw) if draw else ""}</div>'
    return f'<div><p style="{TITLE}">{escaped(title)}</p>{beside}</div>'


def table_with_notes(rows: Sequence[Sequence[str]], heads: Sequence[str] = (), notes: Sequence[str] = ()) -> str:
    """The rows of a result in HTML, of many those at the beginning and at the end, above its notes."""
    table = html_table(without_middle(rows), "", heads) if rows else ""
    return table + "".join(f'<p style="{NOTE}">{escaped(note)}</p>' for note in notes)


def _picture(title: str, draw: Callable[..., Any]) -> str:
    """The picture as a PNG within the page, or in words why there is none."""
    import base64

    try:
        canvas = shown("canvas")
        with canvas.off_screen():
            axes = draw(axes=canvas.new_axes())
        data = base64.b64encode(_small_png(axes.figure)).decode("ascii")
    except Exception as error:  # the table is worth showing without its picture
        reason = str(error) or type(error).__name__
        return f'<p style="{NOTE}">no picture: {escaped(reason)}</p>'
    style = "flex:1 1 300px;min-width:0;max-width:600px;width:100%;height:auto"
    return f'<img alt="{escaped(title)}" style="{style}" src="data:image/png;base64,{data}">'


def _small_png(figure: Any) -> bytes:
    """A figure as a PNG of 256 colours, a third as large as one of all."""
    from PIL import Image  # which matplotlib takes to write its own

    whole, small = BytesIO(), BytesIO()
    figure.savefig(whole, format="png", dpi=DISPLAY.dots_per_inch)
    Image.open(whole).convert("RGB").quantize(256).save(small, format="png", optimize=True)
    return small.getvalue()


def without_middle(rows: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """The rows of a table, of more than `DISPLAY.rows_of_cell` those at the beginning and at the end."""
    most = DISPLAY.rows_of_cell
    if len(rows) <= most:
        return list(rows)
    blank = [""] * (len(rows[0]) - 2)
    return [*rows[: most - 3], ("...", f"{len(rows) - most + 1} more", *blank), *rows[-2:]]
