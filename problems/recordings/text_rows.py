"""The text of a file of rows: its cells and its numbers, whatever marks decimals and thousands."""

import codecs
import csv
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from orbits.errors import InputError

from .measured_rows import ROWS

COMMENTS = ("#", "%", "//")
# A number whose comma may be that of thousands or of decimals; and how that is recorded among the decimal marks.
THOUSANDS, GROUPED = re.compile(r"\s*[+-]?[1-9]\d{0,2},\d{3}\s*"), ",000"
# A number with one mark between its thousands and the other one before its decimals, as 1.234,5 and 1,234.5.
BOTH_MARKS = re.compile(r"\s*[+-]?\d{1,3}(?:\.\d{3})+(,)\d*\s*|\s*[+-]?\d{1,3}(?:,\d{3})+(\.)\d*\s*")
# Cells that stand for a missing number.
MISSING = {"", "-", "nan", "na", "n/a", "null", "none"}
# A file of more lines or bytes takes more than some ten seconds to read.
MOST_LINES = 1_000_000
MOST_BYTES = 32_000_000


def text_of(path: Path) -> str:
    """The text of a file of bounded size; raises `InputError` if it is not a regular file or not text."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"the table {short(path)} cannot be read: it is not a regular file")
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


def lines_of(where: str, text: str) -> list[str]:
    """The lines of a text; raises `InputError` where they are too many."""
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        raise InputError(f"{where} has more than {MOST_LINES} lines: keep every tenth row, or fewer")
    return lines


def numbers_below(
    where: str, lines: list[str], first: int, delimiter: str | None, count: int, places: Sequence[int],
    missing: bool = False,
) -> np.ndarray:  # fmt: skip
    """The numbers (n, columns) at some places of the rows from line `first` on; raises `InputError` that names a row.

    count : the number of cells of the header
    missing : whether numbers may be missing, which are NaN then
    """
    rows, texts = list[int](), list[list[str]]()
    needed = "finite numbers" if missing else "two finite numbers"
    for line in range(first, len(lines)):
        if is_empty(lines[line], delimiter):
            continue
        cells = cells_of(lines[line], delimiter)
        more = len(cells) - count
        if (delimiter == "," and more > 0 and "".join(cells[-more:]).strip()) or (not delimiter and more):
            problem = f"has {len(cells)} cells, the header {count}: separate the columns by ; or tab"
            raise _wrong_row(where, lines, line, problem)
        if len(cells) <= max(places) and not missing:
            raise _wrong_row(where, lines, line, f"does not hold {needed}")
        rows.append(line)
        texts.append([cells[place] if place < len(cells) else "" for place in places])
    if not texts:
        raise InputError(f"{where} has no rows; it needs a header and at least {ROWS.fewest} rows")
    values, marks = list[list[float]](), set[str]()
    decimal = _decimal_mark(cell for cells in texts for cell in cells)
    for line, cells in zip(rows, texts, strict=True):
        try:
            values.append(
                [
                    math.nan if missing and cell.strip().lower() in MISSING else _number(cell, marks, decimal)
                    for cell in cells
                ]
            )
        except ValueError:
            is_mixed = "." in marks and len(marks) > 1
            problem = "mixes decimal commas with points" if is_mixed else f"does not hold {needed}"
            raise _wrong_row(where, lines, line, problem) from None
    if marks == {GROUPED}:
        may = "each comma of its numbers may mark decimals or thousands"
        raise InputError(f"{where}: {may}: write decimals with a point, and thousands without a mark")
    return np.array(values)


def are_numbers(cells: Sequence[str], places: Iterable[int]) -> bool:
    """Whether these cells of a row hold numbers."""
    try:
        for place in places:
            _number(cells[place], set(), _decimal_mark([cells[place]]))
    except (ValueError, IndexError):
        return False
    return True


def is_empty(line: str, delimiter: str | None) -> bool:
    """Whether a line holds no row: blank, or a comment."""
    comments = COMMENTS if delimiter == ";" else (*COMMENTS, ";")
    return not line.strip(" \t,;\"'") or line.lstrip().startswith(comments)


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """The cells of a line; None separates at blanks, but not a name from the unit in brackets behind it."""
    if delimiter is None:
        return re.split(r"\s+(?![\[(])", line.strip())
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return []


def short(text: object) -> str:
    """Text for a message: of a long one, its beginning and its end."""
    shown = str(text)
    return shown if len(shown) <= 60 else f"{shown[:20]}...{shown[-37:]}"


def _wrong_row(where: str, lines: list[str], line: int, problem: str) -> InputError:
    return InputError(f"{where}, row {line + 1}: {short(lines[line])!r} {problem}")


def _decimal_mark(cells: Iterable[str]) -> str | None:
    """The decimal mark of numbers, if some also have marks of thousands, as in 1.234,5; None if no number has."""
    for cell in cells:
        if "," in cell and "." in cell and (found := BOTH_MARKS.fullmatch(cell)):
            return found[1] or found[2]
    return None


def _number(cell: str, marks: set[str], decimal: str | None) -> float:
    """The finite number in a cell, whose decimal mark joins `marks`; a table has one mark; raises `ValueError`.

    decimal : the decimal mark where it is known; the other one then separates thousands
    A comma that may separate thousands joins the marks as `GROUPED`.
    """
    cell = cell.replace("\u2212", "-")
    if decimal is not None:
        thousands = "," if decimal == "." else "."
        whole = cell.partition(decimal)[0]
        if thousands in cell and not re.fullmatch(rf"\s*[+-]?\d{{1,3}}(?:{re.escape(thousands)}\d{{3}})+\s*", whole):
            marks |= {",", "."}
            raise ValueError(cell)
        cell = cell.replace(thousands, "").replace(decimal, ".")
    elif "," in cell or "." in cell:
        marks |= {GROUPED} if THOUSANDS.fullmatch(cell) else {mark for mark in ",." if mark in cell}
        if "." in marks and len(marks) > 1:
            raise ValueError(cell)
        cell = cell.replace(",", ".")
    if not math.isfinite(value := float(cell)):
        raise ValueError(cell)
    return value
