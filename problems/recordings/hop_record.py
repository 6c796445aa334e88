"""A recorded hop from a file, a data frame or columns: its times, its channels, and its missing samples."""

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from orbits.errors import InputError
from orbits.symbolic import suggest
from orbits.units import ACCELERATION, FORCE, LENGTH, SPEED, STANDARD_GRAVITY, TIME, Dimension

from .channels import GROUND_FORCE, KINDS, SPRING_LENGTH
from .header import COMPRESSIVE, DELIMITERS, FORCE_NAMES, METRES, MOST_LINES_BEFORE_HEADER, NEWTONS, words_of
from .text_rows import COMMENTS, are_numbers, cells_of, is_empty, lines_of, numbers_below, short, text_of

TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0}
TIME_NAMES = ("time", "t", "timestamp", "seconds", "zeit", "temps", "tiempo", "zaman")
# Words that name what is recorded, by the order of the derivative, where no unit says it.
WORDS_OF_KINDS = (
    ("height", "position", "pos", "z", "y", "elevation"),
    ("speed", "velocity", "vel", "v"),
    ("acceleration", "accel", "acc", "a"),
)
FORCE_WORDS = {*FORCE_NAMES, "grf", "ground", "plate"}
LENGTH_WORDS = {"spring", "leg"}
# Other names of the masses of a machine, its upper and its lower one.
OTHER_NAMES = ({"body", "trunk", "torso", "hip", "pelvis", "ball"}, {"foot", "toe", "shoe", "hand"})
CENTRE = {"com", "centre", "center"}


class RecordOptions(NamedTuple):
    """The numbers of a record."""

    largest: float = 1e12  # in SI, beyond which squares and differences mean nothing


RECORD = RecordOptions()


def _units() -> dict[str, tuple[Dimension, float]]:
    """The dimension and the size in SI of each unit, by its text without blanks and signs."""
    found = {unit: (TIME, size) for unit, size in TIMES.items()}
    found |= {unit: (FORCE, size) for unit, size in NEWTONS.items()}
    found |= {unit: (LENGTH, size) for unit, size in METRES.items()}
    for metre, size in METRES.items():
        found[f"{metre}/s"] = found[f"{metre}s-1"] = SPEED, size
        found |= {f"{metre}{square}": (ACCELERATION, size) for square in ("/s2", "/s²", "s-2", "/s/s")}
    return found | {"g": (ACCELERATION, STANDARD_GRAVITY)}


UNITS_OF_HOPS = _units()


class HopRecord(NamedTuple):
    """One recorded motion, in the units of the machine.

    name : of the file, or what stands for it
    times : (n,), increasing
    values : (n,) of each channel by name, NaN where a sample is missing
    unused : the names of columns that are not channels
    """

    name: str
    times: np.ndarray
    values: dict[str, np.ndarray]
    unused: tuple[str, ...]


class _Column(NamedTuple):
    """A column: the channel, or "time", and the factor of its numbers; what is not known is ""."""

    meaning: str
    scale: float = 1.0


def read_hops(
    source: Any, channels: Collection[str], in_si: bool,
    columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None,
) -> list[HopRecord]:  # fmt: skip
    """The motions in a file, a `pandas.DataFrame`, a mapping of columns, or a list of these.

    channels : names of the channels that the machine has
    columns, units : of "time" and of channels, by their names, where the header does not say them
    A time that goes back begins another motion. Raises `InputError` that names what is missing.
    """
    if isinstance(source, list | tuple):
        if not source:
            raise InputError("no record: state a file, a data frame or a mapping of columns")
        return [record for each in source for record in read_hops(each, channels, in_si, columns, units)]
    stated = _Stated(channels, in_si, _by_channel("columns", columns, channels), _by_channel("units", units, channels))
    if isinstance(source, Mapping):
        _check_columns(stated, [str(name) for name in source], "the record")
        columns_of = {name: stated.column(str(name)) for name in source}
        known = {name: column for name, column in columns_of.items() if column.meaning}
        unused = tuple(short(name) for name, column in columns_of.items() if not column.meaning)
        return _records("record", [*known.values()], _numbers([source[name] for name in known]), stated, unused)
    if isinstance(source, str | Path):
        path = Path(source)
        return _of_text(f"the record {short(path)}", short(path.name), text_of(path), stated)
    if hasattr(source, "to_csv"):
        return _of_text("the record of a DataFrame", "DataFrame", source.to_csv(index=False), stated)
    raise InputError(
        f"source = {short(source)}; a record must be a file, a data frame, a mapping of columns, or a list"
    )


def _check_columns(stated: "_Stated", titles: Sequence[str], where: str) -> None:
    """Raise `InputError` where a stated column is missing."""
    known = [title.strip() for title in titles]
    if missing := [title for title in stated.columns.values() if str(title).strip() not in known]:
        raise InputError(f"{where} has no column {short(missing[0])!r}{suggest(str(missing[0]), known)}")


class _Stated(NamedTuple):
    """What is known of a record before it is read."""

    channels: Collection[str]
    in_si: bool
    columns: Mapping[str, str]
    units: Mapping[str, str]

    def column(self, cell: str, under: str = "") -> _Column:
        """The meaning of a column by its header and the unit below that."""
        own = [name for name, title in self.columns.items() if str(title).strip() == cell.strip()]
        unit = under or _unit_of(cell)
        meaning = own[0] if own else _meaning(cell, unit, self.channels)
        if not meaning or (not own and meaning in self.columns):
            return _Column("")
        if not self.in_si:
            if unit:
                raise InputError(f"{short(cell)!r} has a unit, but this machine has none: state it with hopper_in_si")
            return _Column(meaning, _sign(cell))
        unit = self.units.get(meaning, unit)
        if not unit:
            raise InputError(
                f"{short(cell)!r} has no unit: write it in the header, as in 'body height [mm]', or state "
                f"units={{{meaning!r}: ...}}"
            )
        dimension, scale = UNITS_OF_HOPS.get(_spelled(unit), ((), 0.0))
        if dimension != (needed := _dimension(meaning)):
            known = ", ".join(name for name, (own, _) in UNITS_OF_HOPS.items() if own == needed)
            raise InputError(f"{short(cell)!r}: '{unit}' is not a unit of a {meaning}; known are {known}")
        return _Column(meaning, scale * _sign(cell))


def _by_channel(name: str, stated: object, channels: Collection[str]) -> Mapping[str, str]:
    """Columns or units by channel; raises `InputError` for others."""
    if stated is None:
        return {}
    if not isinstance(stated, Mapping):
        raise InputError(f'{name} = {stated!r}; it must map channels, as in {{"time": "t", "foot height": "z2"}}')
    known = ("time", *channels)
    if wrong := [each for each in stated if each not in known]:
        raise InputError(f"{name}: the machine has no channel {wrong[0]!r}{suggest(str(wrong[0]), known)}")
    return stated


def _dimension(meaning: str) -> Dimension:
    if meaning in ("time", GROUND_FORCE, SPRING_LENGTH):
        return {"time": TIME, GROUND_FORCE: FORCE, SPRING_LENGTH: LENGTH}[meaning]
    return (LENGTH, SPEED, ACCELERATION)[KINDS.index(meaning.rpartition(" ")[2])]


def _spelled(unit: str) -> str:
    return re.sub(r"[\s·*.^]+", "", unit.strip(" []()"))


def _unit_of(cell: str) -> str:
    """The unit in a header's cell: the text in brackets, or the last word where that is a unit and not all."""
    if bracketed := re.search(r"[\[(]([^\])]*)[\])]", cell):
        return bracketed[1].strip()
    parts = [part for part in re.split(r"[\s_,:]+", cell.strip()) if part]
    return parts[-1] if len(parts) > 1 and _spelled(parts[-1]) in UNITS_OF_HOPS else ""


def _sign(cell: str) -> float:
    """-1.0 where a header says that compression counts."""
    return -1.0 if any(word.startswith(COMPRESSIVE) for word in words_of(cell)) else 1.0


def _meaning(cell: str, unit: str, channels: Collection[str]) -> str:
    """The channel that a column is, by its words and its unit; "" if it is not a channel."""
    words = set(words_of(re.sub(r"[\[(][^\])]*[\])]", " ", cell)))
    dimension = UNITS_OF_HOPS.get(_spelled(unit), (None,))[0]
    heights = [name.rpartition(" ")[0] for name in channels if name.endswith(f" {KINDS[0]}")]
    named = [name for name in heights if words.issuperset(name.split())]
    named += [name for name, others in zip(heights, OTHER_NAMES, strict=False) if words & others]
    named += [name for name in heights if name.startswith("centre") and words & CENTRE]
    if words & set(TIME_NAMES) and dimension in (None, TIME):
        return "time"
    if words & FORCE_WORDS and dimension in (None, FORCE):
        return "" if words & LENGTH_WORDS else GROUND_FORCE
    orders = (LENGTH, SPEED, ACCELERATION)
    order = orders.index(dimension) if dimension in orders else None
    if order is None and dimension is not None:
        return ""
    if words & LENGTH_WORDS and not named:
        return SPRING_LENGTH if order in (None, 0) else ""
    if not named:
        return ""
    named_kinds = [k for k, each in enumerate(WORDS_OF_KINDS) if words & set(each)]
    kind = order if order is not None else named_kinds[-1] if named_kinds else 0
    return f"{named[0]} {KINDS[kind]}"


def _of_text(where: str, name: str, text: str, stated: _Stated) -> list[HopRecord]:
    """The motions in a text."""
    lines = lines_of(where, text)
    line, delimiter, cells = _header(where, lines, stated)
    below = [cell.strip(" []()") for cell in cells_of(lines[line + 1] if line + 1 < len(lines) else "", delimiter)]
    has_units = any(_spelled(unit) in UNITS_OF_HOPS for unit in below) and len(below) == len(cells)
    under, first = (below, line + 2) if has_units else ([""] * len(cells), line + 1)
    if all(is_empty(each, delimiter) for each in lines[first:]):
        raise InputError(f"{where} has a header and no rows")
    _check_columns(stated, cells, where)
    columns = [stated.column(cell, unit) for cell, unit in zip(cells, under, strict=True)]
    known = [place for place, column in enumerate(columns) if column.meaning]
    values = numbers_below(where, lines, first, delimiter, len(cells), known, missing=True)
    unused = tuple(short(cell.strip()) for cell, column in zip(cells, columns, strict=True) if not column.meaning)
    return _records(name, [columns[place] for place in known], values.T, stated, unused)


def _header(where: str, lines: list[str], stated: _Stated) -> tuple[int, str | None, list[str]]:
    """The line with the most names of columns, the delimiter and the cells there; a comment only where nothing else
    has any."""
    best: tuple[int, int, str | None, list[str]] = 0, 0, None, []
    names = {str(title).strip() for title in stated.columns.values()}
    for commented in (False, True):
        for line, each in enumerate(lines[:MOST_LINES_BEFORE_HEADER]):
            if each.lstrip().startswith(COMMENTS) != commented or not each.strip(" \t,;"):
                continue
            for delimiter in DELIMITERS:
                cells = cells_of(each.lstrip("#%/ \t"), delimiter)
                known = [
                    cell.strip() in names or _meaning(cell, _unit_of(cell), stated.channels) != "" for cell in cells
                ]
                if sum(known) > best[0] and not are_numbers(cells, range(len(cells))):
                    best = sum(known), line, delimiter, cells
        if best[0]:
            return best[1:]
    example = f"time [s], {', '.join(list(stated.channels)[:2])}"
    raise InputError(f"{where} has no header with a time and a channel, as {example}; or state columns=")


def _numbers(columns: Sequence[Any]) -> np.ndarray:
    """The columns (columns, n) of a mapping; raises `InputError` for anything but numbers of one length."""
    try:
        return np.array([np.asarray(column, dtype=float).ravel() for column in columns], dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError("a record must be a mapping of columns of numbers, all of the same length") from None


def _records(
    name: str, columns: Sequence[_Column], values: np.ndarray, stated: _Stated, unused: tuple[str, ...] = ()
) -> list[HopRecord]:
    """The motions of a record from its columns (columns, n)."""
    found = dict[str, np.ndarray]()
    for (meaning, scale), own in zip(columns, values, strict=True):
        if meaning in found:
            remedy = f"state which, columns={{{meaning!r}: ...}}"
            raise InputError(f"{name}: two columns may be the {meaning}: {remedy}")
        found[meaning] = scale * own
    if "time" not in found:
        raise InputError(f"{name} has no column of times, such as 'time [s]'; a fit needs one")
    if (times := found.pop("time")).size and not np.isfinite(times).all():
        raise InputError(f"{name}: the time of row {int(np.argmin(np.isfinite(times))) + 1} is missing")
    for meaning, own in (("time", times), *found.items()):
        if np.abs(own[np.isfinite(own)]).max(initial=0.0) > RECORD.largest:
            raise InputError(f"{name}: the {meaning} is larger than {RECORD.largest:g}: check its unit")
    if not found:
        raise InputError(f"{name} has no channel of this machine, which are {', '.join(stated.channels)}")
    cuts = [0, *(np.flatnonzero(np.diff(times) < 0) + 1).tolist(), len(times)]
    motions = []
    for number, (a, b) in enumerate(pairwise(cuts), 1):
        if len(twice := times[a:b][1:][np.diff(times[a:b]) == 0]):
            raise InputError(f"{name}: two rows have the time {twice[0]:g}")
        label = name if len(cuts) == 2 else f"{name}, motion {number}"
        motions.append(HopRecord(label, times[a:b], {key: own[a:b] for key, own in found.items()}, unused))
    return motions
