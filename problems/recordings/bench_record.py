"""The record of a test stand from a file, a data frame or two sequences."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from orbits.errors import InputError, true_or_false

from .header import find_header, scales_of, used_columns
from .text_rows import lines_of, numbers_below, short, text_of


class BenchRecord(NamedTuple):
    """Force against extension in the order of the measurement, tension positive, in m and N where it is in SI.

    extensions, forces : (n,)
    sense : -1.0 where the record counts compression, else 1.0
    name : of the file, or what stands for it
    columns : the names of both columns with their units, "" where they have none
    units : of extension and force; "" where they have none
    """

    extensions: np.ndarray
    forces: np.ndarray
    sense: float
    name: str
    columns: str
    units: tuple[str, str]


def read_record(
    source: Any,
    in_si: bool,
    columns: Sequence[str | int] | None = None,
    units: Sequence[str] | None = None,
) -> BenchRecord:
    """The record in a file, a `pandas.DataFrame`, whose columns are named as those of a file, or two sequences.

    in_si, columns, units : as in `springs.table`
    Both columns count compression where the header of one says so, as `Compression [mm];Force [N]` does, unless that of
    the other says tension or extension. Raises `InputError` for anything else.
    """
    in_si = true_or_false("in_si", in_si)
    columns, units = _two("columns", columns, str | int), _two("units", units, str)
    if units is not None and not in_si:
        raise InputError(f"units = {units!r} are for a machine in SI: state in_si=True too")
    if isinstance(source, str | Path):
        path = Path(source)
        return _of_text(f"the table {short(path)}", text_of(path), short(path.name), in_si, columns, units)
    if hasattr(source, "to_csv"):
        has_names = any(name is not None for name in source.index.names)
        text = source.to_csv(index=has_names)
        return _of_text("the table of a DataFrame", text, "DataFrame", in_si, columns, units)
    if columns is not None:
        raise InputError(f"columns = {columns!r}: two sequences have no names of columns; leave columns out")
    r, force = _numbers(source, "table")
    if units is None:
        return BenchRecord(r, force, 1.0, "table", "", ("m", "N") if in_si else ("", ""))
    titles = "extension", "force"
    scales, own = scales_of("the table", titles, [f"[{unit}]" for unit in units], in_si)
    words = " and ".join(f"{title} in {unit}" for title, unit in zip(titles, units, strict=True))
    return BenchRecord(scales[0] * r, scales[1] * force, 1.0, "table", words, own)


def _of_text(
    where: str, text: str, name: str, in_si: bool, columns: Sequence[str | int] | None, units: Sequence[str] | None
) -> BenchRecord:
    lines = lines_of(where, text)
    header = find_header(where, lines, columns)
    chosen = used_columns(where, header, None if units is None else [f"[{unit}]" for unit in units], in_si)
    values = numbers_below(where, lines, header.line, header.delimiter, len(header.cells), chosen.places)
    r, force = _numbers((chosen.sense * np.array(chosen.scales) * values).T, name)
    return BenchRecord(r, force, chosen.sense, name, chosen.text, chosen.units)


def _two(name: str, value: Any, kind: Any) -> Any:
    """Two columns or units, or None; raises `InputError` for anything else."""
    if value is None:
        return None
    fits = isinstance(value, Sequence) and not isinstance(value, str) and len(value) == 2
    if not fits or not all(isinstance(each, kind) and not isinstance(each, bool) for each in value):
        example = '("Displacement", "Force") or (0, 1)' if name == "columns" else '("mm", "N")'
        raise InputError(f"{name} = {value!r}; it is two, that of extension and that of force, as in {example}")
    return tuple(value)


def _numbers(source: Any, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Extensions and forces (n,) of two sequences; raises `InputError` for anything else."""
    try:
        r, force = (np.asarray(column, dtype=float) for column in source)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{label}: a table must be two sequences of numbers, extensions and forces") from None
    if r.ndim != 1 or not r.size or r.shape != force.shape or not (np.isfinite(r).all() and np.isfinite(force).all()):
        raise InputError(
            f"{label}: extensions and forces must be two lists of finite numbers, of the same length and not empty"
        )
    if max(np.abs(r).max(initial=0), np.abs(force).max(initial=0)) > 1e100:
        raise InputError(f"{label}: extensions or forces are too large to compute with; they must lie below 1e100")
    return r, force
