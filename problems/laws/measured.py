"""Measured force against extension: the files of test machines."""

import codecs
import csv
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from orbits.errors import InputError

EXTENSION_NAMES = (
    *("extension", "deflection", "displacement", "elongation", "travel", "stroke", "compression", "weg", "r", "x"),
)
FORCE_NAMES = ("force", "tension", "load", "kraft", "f")
GERMAN = ("weg", "kraft")
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "in": 0.0254}
NEWTONS = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "MN": 1e6, "n": 1.0, "kn": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605}
NO_UNIT = ("", "-", "1")
UNIT_WORDS = {unit.lower() for unit in (*METRES, *NEWTONS)}
COMMENTS = ("#", "%", "//")
# Words of a header whose column counts tension and extension.
TENSILE = {"tension", "tensile", "extension", "elongation"}
# A number whose comma may be that of thousands or of decimals; and how that is recorded among the decimal marks.
THOUSANDS, GROUPED = re.compile(r"\s*[+-]?[1-9]\d{0,2},\d{3}\s*"), ",000"
FEWEST_ROWS = 4
# The header is among the first lines, and a longer file takes more than some ten seconds to read.
MOST_LINES_BEFORE_HEADER, MOST_LINES, MOST_BYTES = 200, 1_000_000, 32_000_000


class _Header(NamedTuple):
    line: int  # the index of the first line of rows
    delimiter: str | None
    cells: list[str]
    columns: tuple[int, int]
    units: tuple[str, str]


def read_table(path: Path, text: str, in_si: bool) -> tuple[tuple[np.ndarray, np.ndarray], float]:
    """Extensions and forces (n,), tension positive, in the order of the rows of a file's text, in SI in m and N; and
    -1.0 where it counts compression, else 1.0.

    Both columns count compression where the header of one says so, as `Compression [mm];Force [N]` does, unless that of
    the other says tension or extension.
    """
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        raise InputError(f"the table {short(path)} has more than {MOST_LINES} lines: keep every tenth row, or fewer")
    header = _find_header(path, lines[: 2 * MOST_LINES_BEFORE_HEADER])
    scales = _scales(path, header, in_si)
    sense = _sense(path, [header.cells[column] for column in header.columns])
    extensions, forces = _values(path, lines, header).T
    return (sense * scales[0] * extensions, sense * scales[1] * forces), sense


def _sense(path: Path, headers: list[str]) -> float:
    """-1.0 where the headers of extension and force say that compression counts, else 1.0."""
    compressed = [any(word.startswith("compress") for word in _words(header)) for header in headers]
    for header, other, is_compressed in zip(headers, headers[::-1], compressed, strict=True):
        if not is_compressed and any(compressed) and not TENSILE.isdisjoint(_words(header)):
            both = f"{short(header.strip())!r} and {short(other.strip())!r}"
            raise InputError(f"the table {short(path)}: {both} count opposite ways: turn one column and its name round")
    return -1.0 if any(compressed) else 1.0


def _values(path: Path, lines: list[str], header: _Header) -> np.ndarray:
    """Extension and force (n, 2) of a file's rows as they stand; raises `InputError` that names a row."""
    values, marks = [], set[str]()
    for line in range(header.line, len(lines)):
        if _is_empty(lines[line], header.delimiter):
            continue
        cells = _cells(lines[line], header.delimiter)
        more = len(cells) - len(header.cells)
        if (header.delimiter == "," and more > 0 and "".join(cells[-more:]).strip()) or (not header.delimiter and more):
            problem = f"has {len(cells)} cells, the header {len(header.cells)}: separate the columns by ; or tab"
        else:
            try:
                values.append([_number(cells[column], marks) for column in header.columns])
                continue
            except (ValueError, IndexError):
                problem = (
                    "mixes decimal commas with points"
                    if "." in marks and len(marks) > 1
                    else "does not hold two finite numbers"
                )
        raise InputError(f"the table {short(path)}, row {line + 1}: {short(lines[line])!r} {problem}")
    if not values:
        raise InputError(f"the table {short(path)} has no rows; it needs a header and at least {FEWEST_ROWS} rows")
    if marks == {GROUPED}:
        may = "each comma of its numbers may mark decimals or thousands"
        raise InputError(f"the table {short(path)}: {may}: write decimals with a point, and thousands without a mark")
    return np.array(values)


def text_of(path: Path) -> str:
    """The text of a file of bounded size; raises `InputError` where it is no regular file or no text."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"the table {short(path)} cannot be read: it is no regular file")
        with open(path, "rb") as file:
            data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            bound = f"is larger than {MOST_BYTES // 10**6} MB"
            raise InputError(f"the table {short(path)} {bound}: keep every tenth row, or fewer")
        if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return data.decode("utf-16").removeprefix("\ufeff")
        try:
            return data.decode("utf-8-sig")
        except UnicodeDecodeError:
            return data.decode("cp1252")  # as test machines under Windows write
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"the table {short(path)!r} cannot be read: {short(error)}") from None


def _find_header(path: Path, lines: list[str]) -> _Header:
    """The first line that names both columns with numbers below it; a comment only where nothing else is a header."""
    found, first = list[_Header](), ""
    for commented in (False, True):
        for line, text in enumerate(lines[:MOST_LINES_BEFORE_HEADER]):
            if text.lstrip().startswith(COMMENTS) != commented or not text.strip(" \t,;"):
                continue
            first = first or text
            for header in _headers(lines, line, text.lstrip("#%/ \t")):
                rows = (each for each in lines[header.line :] if not _is_empty(each, header.delimiter))
                if _are_numbers(_cells(next(rows, ""), header.delimiter), header.columns):
                    return header
                found.append(header)
    if found:
        return found[0]
    if len([text for text in lines if text.strip(" \t,;")]) < 2:
        raise InputError(f"the table {short(path)} has no rows; it needs a header and at least {FEWEST_ROWS} rows")
    cells = re.split(r"[\t;,]|\s+", first.strip())
    if _are_numbers(cells, range(len(cells))):
        raise InputError(f"the table {short(path)} has no header; name its columns in the first row")
    names = FORCE_NAMES if any(_names(cell, EXTENSION_NAMES) for cell in cells) else EXTENSION_NAMES
    has = f"its header is {short(first)!r}, known names are {', '.join(names)}"
    raise InputError(f"the table {short(path)} has no column {names[0]}: {has}")


def _headers(lines: list[str], line: int, text: str) -> Iterator[_Header]:
    """A line as a header, for each separator with which it names both columns."""
    for delimiter in ("\t", ";", ",", None):
        cells = _cells(text, delimiter)
        named = [[i for i, cell in enumerate(cells) if _names(cell, names)] for names in (EXTENSION_NAMES, FORCE_NAMES)]
        if not all(named):
            continue
        # Of `Travel time` and `Travel`, or `Force setpoint` and `Force`, the plainer name is the measured column's.
        place, beside = (min(columns, key=lambda i: _count_of_words(cells[i])) for columns in named)
        if place == beside:
            continue
        below, columns = line + 1, (place, beside)
        units = _unit_in(cells[place], EXTENSION_NAMES), _unit_in(cells[beside], FORCE_NAMES)
        while below < len(lines) and _is_empty(lines[below], delimiter):
            below += 1
        under = [cell.strip(" []()") for cell in _cells(lines[below] if below < len(lines) else "", delimiter)]
        if len(under) > max(columns) and (under[place] in METRES or under[beside] in NEWTONS):
            units, below = (f"[{under[place]}]", f"[{under[beside]}]"), below + 1
        yield _Header(below, delimiter, cells, columns, units)


def _scales(path: Path, header: _Header, in_si: bool) -> tuple[float, float]:
    """The factors of both columns for m and N; raises `InputError` for a unit where there are none, or unknown."""
    scales = []
    for column, unit, known in zip(header.columns, header.units, (METRES, NEWTONS), strict=True):
        name, plain = header.cells[column].strip(), unit.strip(" []()")
        scale = known.get(plain, known.get(plain.lower()))
        if plain in NO_UNIT or (not in_si and scale is None and plain == unit):
            scales.append(1.0)  # without brackets, an unknown word belongs to the name
        elif not in_si:
            raise InputError(
                f"the table {short(path)} gives {short(name)!r} in {short(plain)}, but this machine has no units: "
                "state it with hopper_in_si (a file's [si]; a table in_si=True), or take the units out of the header"
            )
        elif scale is None:
            raise InputError(f"the table {short(path)}: unknown unit {short(plain)!r}; known: {', '.join(known)}")
        else:
            scales.append(scale)
    return scales[0], scales[1]


def short(text: object) -> str:
    """Text for a message: of a long one, its beginning and its end."""
    shown = str(text)
    return shown if len(shown) <= 60 else f"{shown[:20]}...{shown[-37:]}"


def _is_empty(line: str, delimiter: str | None) -> bool:
    """Whether a line holds no row: blank, or a comment."""
    comments = COMMENTS if delimiter == ";" else (*COMMENTS, ";")
    return not line.strip(" \t,;\"'") or line.lstrip().startswith(comments)


def _cells(line: str, delimiter: str | None) -> list[str]:
    """The cells of a line; None separates at blanks, but not a name from the unit in brackets behind it."""
    if delimiter is None:
        return re.split(r"\s+(?![\[(])", line.strip())
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return []


def _words(cell: str) -> list[str]:
    return [word for word in re.split(r"[\s_()\[\]/,.:|-]+", cell.strip().lower()) if word]


def _count_of_words(cell: str) -> int:
    """The number of words that name a column, without its unit."""
    return sum(word not in UNIT_WORDS for word in _words(re.sub(r"[\[(][^\])]*[\])]", " ", cell)))


def _names(cell: str, names: tuple[str, ...]) -> bool:
    """Whether a cell names a column: by its first word, or by a longer one later on."""
    words = _words(cell)
    compound = tuple(name for name in GERMAN if name in names)  # Federweg, Standardkraft
    return any(word.endswith(compound) or (word in names and (len(word) > 1 or i == 0)) for i, word in enumerate(words))


def _unit_in(cell: str, names: tuple[str, ...]) -> str:
    """The unit in a header's cell: the text in brackets, with them, or else the last word if it is not the name."""
    if bracketed := re.search(r"[\[(][^\])]*[\])]", cell):
        return bracketed[0]
    last = [word for word in re.split(r"[\s_/,:]+", cell.strip()) if word][-1]
    return "" if _names(last, names) else last


def _number(cell: str, marks: set[str]) -> float:
    """The finite number in a cell, whose decimal mark joins `marks`; a table has one mark; raises `ValueError`.

    A comma that may separate thousands joins them as `GROUPED`.
    """
    cell = cell.replace("\u2212", "-")
    if "," in cell or "." in cell:
        marks |= {GROUPED} if THOUSANDS.fullmatch(cell) else {mark for mark in ",." if mark in cell}
        if "." in marks and len(marks) > 1:
            raise ValueError(cell)
        cell = cell.replace(",", ".")
    if not math.isfinite(value := float(cell)):
        raise ValueError(cell)
    return value


def _are_numbers(cells: list[str], columns) -> bool:
    """Whether these columns of a row hold numbers."""
    try:
        for column in columns:
            _number(cells[column], set())
    except (ValueError, IndexError):
        return False
    return True
