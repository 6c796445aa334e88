"""Measured force against extension: the files of test machines, loops, noise, and the curve through the rows."""

import codecs
import csv
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
COMMENTS = ("#", "%", "//")
FEWEST_ROWS = 4
# The header is among the first lines, and what is longer than this takes more than some ten seconds to read.
MOST_LINES_BEFORE_HEADER, MOST_LINES, MOST_BYTES = 200, 1_000_000, 32_000_000
# Each row between which a spline runs ends an integration step: more would cost minutes and add no digit.
MOST_ROWS = 500
# A smoothing spline is found from the means of at most so many neighbouring rows, by an eigendecomposition.
MOST_MEANS = 256
# An extension that comes back by this share of its range has turned.
TURN = 0.02
# Rows on the way up and on the way down differ where their mean difference is this many times its standard error and
# this share of the forces' range; a narrower loop is noise.
LOOP_SIGNIFICANCE, LOOP_WIDTH = 6.0, 5e-3
# Rows are noisy where a smoothing spline with fewer degrees of freedom than this share of the rows is likelier than
# the interpolating one, twice the logarithm by this much; noise below the last share of the range is rounding.
FREEDOM, LIKELIER, EXACT_ROWS = 0.8, 15.0, 1e-9
# Below so many rows noise and shape cannot be told apart.
FEWEST_NOISY = 12
# A smoothed curve goes on through so many nodes per degree of freedom, at least and at most so many.
NODES_PER_FREEDOM, NODES = 2, (16, 128)
# Directions of the noise in the curve, the smoothest first: all later ones add a tenth to what an orbit is moved by.
MOST_DIRECTIONS = 24


class SmoothCurve(NamedTuple):
    """A smooth curve through rows: forces (n,) at ascending extensions (n,), and what noise does to them.

    changes : (k, n), independent changes of the forces by one standard deviation each
    note : what was done to the rows, in words
    """

    extensions: np.ndarray
    forces: np.ndarray
    changes: np.ndarray
    note: str


class _Header(NamedTuple):
    line: int  # the index of the first line of rows
    delimiter: str | None
    cells: list[str]
    columns: tuple[int, int]
    units: tuple[str, str]


def read_table(path: Path, in_si: bool) -> tuple[tuple[np.ndarray, np.ndarray], float]:
    """Extensions and forces (n,), tension positive, in the order of a file's rows, in SI in m and N; and -1.0 where the
    file counts compression, else 1.0."""
    lines = _text(path).splitlines()
    if len(lines) > MOST_LINES:
        raise InputError(f"the table {short(path)} has more than {MOST_LINES} lines: keep every tenth row, or fewer")
    header = _find_header(path, lines[: 2 * MOST_LINES_BEFORE_HEADER])
    scales = _scales(path, header, in_si)
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
                problem = "mixes decimal commas with points" if len(marks) > 1 else "does not hold two numbers"
        raise InputError(f"the table {short(path)}, row {line + 1}: {short(lines[line])!r} {problem}")
    if not values:
        raise InputError(f"the table {short(path)} has no rows; it needs a header and at least {FEWEST_ROWS} rows")
    sense = -1.0 if "compression" in _words(header.cells[header.columns[0]]) else 1.0
    extensions, forces = np.array(values).T
    return (sense * scales[0] * extensions, sense * scales[1] * forces), sense


def branch_of(r: np.ndarray, force: np.ndarray, sense: float, branch: str | None, label: str) -> np.ndarray:
    """The indices of the rows on a branch of a loop: "loading", where the travel grows, "unloading", or "mean" for all.

    sense : -1.0 where the travel is a compression
    Raises `InputError` for a loop of which no branch is named, and for a branch without rows.
    """
    direction = _directions(r)
    if branch in ("loading", "unloading"):
        # A table of one side alone is loaded away from rest, whichever sign it gives that side.
        away = -1.0 if -(sense * r).min() > 2 * (sense * r).max() else 1.0
        rows = np.flatnonzero(direction * sense * away == (1 if branch == "loading" else -1))
        if len(rows) < FEWEST_ROWS:
            raise InputError(f"{label}: {len(rows)} rows on the branch '{branch}'; a table needs {FEWEST_ROWS}")
        return rows
    if branch not in (None, "mean"):
        raise InputError(f"branch = {branch!r}; it is 'loading', 'unloading' or 'mean'")
    up, down = ((r[direction == side], force[direction == side]) for side in (1, -1))
    width = _loop_width(up, down)
    if branch is None and abs(width) > LOOP_WIDTH * np.ptp(force):
        named = 'name one, branch="loading" or branch="unloading", or both, branch="mean"'
        raise InputError(
            f"{label} is a loop: loading and unloading differ by {abs(width):.3g}, "
            f"{100 * abs(width) / np.ptp(force):.2g}% of the forces' range; {named} (table:FILE?branch=loading)"
        )
    return np.arange(len(r))


def curve_of(r: np.ndarray, force: np.ndarray, noise: float | None) -> SmoothCurve:
    """The curve through rows of ascending, different extensions r (n,): the rows themselves, or a smoothing spline.

    noise : standard deviation of a row's force; None to see from the rows whether they are noisy, 0 for exact ones

    The spline minimises sum (f_i - g(r_i))**2/noise**2 + penalty times the integral of g''**2, the penalty of greatest
    restricted likelihood (Wahba 1985); its posterior covariance gives the changes (Nychka 1988).
    """
    fit = None
    if noise != 0 and (noise is not None or len(r) >= FEWEST_NOISY):
        fit = _smoothed(r, force, noise)
    if fit is not None:
        return fit
    if len(r) <= MOST_ROWS:
        return SmoothCurve(r, force, np.zeros((0, len(r))), "")
    kept = np.linspace(0, len(r) - 1, MOST_ROWS).round().astype(int)
    return SmoothCurve(r[kept], force[kept], np.zeros((0, MOST_ROWS)), f"{MOST_ROWS} of {len(r)} rows")


def _smoothed(r: np.ndarray, force: np.ndarray, noise: float | None) -> SmoothCurve | None:
    """The smoothing spline; None where the rows are not known to be noisy and do not look it."""
    from scipy.interpolate import CubicSpline  # only a table needs it, and it takes half a second to import
    from scipy.linalg import eigh

    starts = np.unique(np.linspace(0, len(r), min(len(r), MOST_MEANS), endpoint=False).astype(int))
    counts = np.diff(starts, append=len(r))
    x, y = np.add.reduceat(r, starts) / counts, np.add.reduceat(force, starts) / counts
    n, h, root = len(x), np.diff(x), np.sqrt(counts)
    bends = CubicSpline(x, np.eye(n), bc_type="natural")(x, 2)  # the spline's second derivatives, linear in its values
    mass = np.diag((np.r_[h, 0] + np.r_[0, h]) / 3) + np.diag(h / 6, 1) + np.diag(h / 6, -1)
    penalty = bends.T @ mass @ bends / np.outer(root, root)
    stiffness, modes = eigh((penalty + penalty.T) / 2)
    stiffness[:2], z = 0.0, modes.T @ (root * y)  # a straight line is not penalised
    stiffness[2:] = np.maximum(stiffness[2:], np.finfo(float).eps * stiffness[-1])
    multiples = np.geomspace(1e-6 / stiffness[-1], 1e6 / stiffness[2], 400)
    lost = 1 - 1 / (1 + multiples[:, None] * stiffness[2:])
    squares = lost @ z[2:] ** 2
    with np.errstate(all="ignore"):  # rows on a straight line leave nothing, and no best penalty
        size = (n - 2) * np.log(squares) if noise is None else squares / noise**2
        deviance = size - np.log(lost).sum(1)
        best = int(deviance.argmin())
        gain = deviance[0] - deviance[best]
    kept = np.r_[1.0, 1.0, 1 - lost[best]]
    sigma = float(np.sqrt(squares[best] / (n - 2))) if noise is None else noise
    smooth = kept.sum() < FREEDOM * n and gain > LIKELIER and sigma > EXACT_ROWS * np.ptp(force)
    if noise is None and not smooth:
        return None
    nodes = np.linspace(r[0], r[-1], int(np.clip(NODES_PER_FREEDOM * kept.sum(), *NODES)))
    at_nodes = CubicSpline(x, modes / root[:, None], bc_type="natural")(nodes)
    changes = sigma * (np.sqrt(kept) * at_nodes).T[:MOST_DIRECTIONS]
    how = "estimated" if noise is None else "stated"
    return SmoothCurve(nodes, at_nodes @ (kept * z), changes, f"{len(r)} rows smoothed, noise {sigma:.3g} {how}")


def _text(path: Path) -> str:
    """The text of a file of bounded size; raises `InputError` for what is no regular file or no text."""
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
            return data.decode("cp1252")  # what test machines under Windows write
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"the table {short(path)!r} cannot be read: {short(error)}") from None


def _find_header(path: Path, lines: list[str]) -> _Header:
    """The first line that names both columns with numbers below it; a comment only where nothing else is a header."""
    found, first = list[_Header](), ""
    for commented in (False, True):
        for line, text in enumerate(lines[:MOST_LINES_BEFORE_HEADER]):
            if text.startswith(COMMENTS) != commented or not text.strip(" \t,;"):
                continue
            first = first or text
            for header in _headers(lines, line, text.lstrip("#%/ ")):
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
    """What a line is as a header, for each separator with which it names both columns."""
    for delimiter in ("\t", ";", ",", None):
        cells = _cells(text, delimiter)
        place, beside = (
            next((i for i, cell in enumerate(cells) if _names(cell, names)), None)
            for names in (EXTENSION_NAMES, FORCE_NAMES)
        )
        if place is None or beside is None or place == beside:
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
    """What multiplies both columns for m and N; raises `InputError` for a unit where there are none, or unknown."""
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
    return not line.strip(" \t,;\"'") or line.startswith(COMMENTS if delimiter == ";" else (*COMMENTS, ";"))


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


def _names(cell: str, names: tuple[str, ...]) -> bool:
    """Whether a cell names a column: by its first word, or by a longer one later on."""
    words = _words(cell)
    compound = tuple(name for name in GERMAN if name in names)  # Federweg, Standardkraft
    return any(word.endswith(compound) or (word in names and (len(word) > 1 or i == 0)) for i, word in enumerate(words))


def _unit_in(cell: str, names: tuple[str, ...]) -> str:
    """The unit in a header's cell: what is in brackets, with them, or else the last word if it is not the name."""
    if bracketed := re.search(r"[\[(][^\])]*[\])]", cell):
        return bracketed[0]
    last = [word for word in re.split(r"[\s_/,:]+", cell.strip()) if word][-1]
    return "" if _names(last, names) else last


def _number(cell: str, marks: set[str]) -> float:
    """The number in a cell, whose decimal mark joins `marks`, of which a table has one; raises `ValueError`."""
    if "," in cell or "." in cell:
        marks |= {mark for mark in ",." if mark in cell}
        if len(marks) > 1:
            raise ValueError(cell)
        cell = cell.replace(",", ".")
    return float(cell.replace("\u2212", "-"))


def _are_numbers(cells: list[str], columns) -> bool:
    """Whether these columns of a row hold numbers."""
    try:
        return all(np.isreal(_number(cells[column], set())) for column in columns)
    except (ValueError, IndexError):
        return False


def _directions(r: np.ndarray) -> np.ndarray:
    """For each row (n,) whether the extension is on its way up, 1, or down, -1; small wobbles do not turn it."""
    directions, room = np.ones(len(r), int), TURN * np.ptp(r)
    direction, extreme, turned = 0, 0, 0  # the way, and the rows of its farthest extension and of its beginning
    low = high = 0
    values = r.tolist()
    for i, value in enumerate(values):
        if direction == 0:
            low, high = (i if value < values[low] else low), (i if value > values[high] else high)
            if values[high] - values[low] > room:
                direction, extreme = (1, high) if high > low else (-1, low)
        elif direction * (value - values[extreme]) >= 0:
            extreme = i
        elif direction * (values[extreme] - value) > room:
            directions[turned : extreme + 1] = direction
            direction, turned, extreme = -direction, extreme + 1, i
    directions[turned:] = direction or 1
    return directions


def _loop_width(up: tuple[np.ndarray, np.ndarray], down: tuple[np.ndarray, np.ndarray]) -> float:
    """The mean force of rows on the way up less that on the way down at the same extension; 0 where it is none."""

    def above(branch, other):
        order = np.argsort(branch[0], kind="stable")
        inside = (other[0] >= branch[0].min()) & (other[0] <= branch[0].max())
        return np.interp(other[0][inside], branch[0][order], branch[1][order]) - other[1][inside]

    if min(len(up[0]), len(down[0])) < FEWEST_ROWS:
        return 0.0
    # Both ways round, what straight lines between the rows of a curved law are off by cancels.
    widths = np.r_[above(up, down), -above(down, up)]
    if len(widths) < 2 * FEWEST_ROWS:
        return 0.0
    mean = float(widths.mean())
    return mean if abs(mean) > LOOP_SIGNIFICANCE * widths.std() / np.sqrt(len(widths)) else 0.0
