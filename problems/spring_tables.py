"""Springs measured on a bench: tables of extensions and forces, and the smooth law through their rows."""

import csv
import re
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from orbits.errors import InputError

EXTENSION_NAMES = ("extension", "deflection", "displacement", "elongation", "travel", "stroke", "compression", "r", "x")
FORCE_NAMES = ("force", "tension", "load", "f")
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
NEWTONS = {"n": 1.0, "mn": 1e-3, "kn": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605}
FEWEST_ROWS = 4


def read_table(path: Path, in_si: bool) -> tuple[np.ndarray, np.ndarray]:
    """Extensions and forces (n,), tension positive, of a CSV file with a header; in SI they are in m and N.

    Raises `InputError` that names the file, and the column or row that is wrong.
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"the table {str(path)!r} cannot be read: {error}") from None
    if len(rows) < 2:
        raise InputError(f"the table {path} has no rows; it needs a header and at least {FEWEST_ROWS} rows")
    if all(_is_number(cell) for cell in rows[0]):
        raise InputError(f"the table {path} has no header; name its columns in the first row")
    at, name, metres = _named_column(path, rows[0], EXTENSION_NAMES, METRES, in_si)
    beside, _, newtons = _named_column(path, rows[0], FORCE_NAMES, NEWTONS, in_si)
    values = []
    for line, row in enumerate(rows[1:], start=2):
        try:
            values.append([float(row[at]), float(row[beside])])
        except (ValueError, IndexError):
            raise InputError(f"the table {path}, row {line}: {','.join(row)!r} does not hold two numbers") from None
    sign = -1.0 if name == "compression" else 1.0
    extensions, forces = np.array(values).T
    return sign * metres * extensions, sign * newtons * forces


def checked_pairs(columns: tuple[ArrayLike, ArrayLike], label: str) -> tuple[np.ndarray, np.ndarray]:
    """Ascending extensions (n,) and the mean force (n,) at each; raises `InputError` where no law goes through them."""
    try:
        r, force = (np.asarray(column, dtype=float) for column in columns)
    except (TypeError, ValueError):
        raise InputError(f"{label}: a table is two sequences of numbers, extensions and forces") from None
    if r.ndim != 1 or r.shape != force.shape or not (np.isfinite(r).all() and np.isfinite(force).all()):
        raise InputError(f"{label}: extensions and forces must be two finite lists of one length")
    grid, place = np.unique(r, return_inverse=True)
    if len(grid) < FEWEST_ROWS:
        raise InputError(f"{label}: {len(grid)} different extensions; a table needs at least {FEWEST_ROWS}")
    if np.diff(grid).min() < 1e-9 * np.ptp(grid) or np.abs(force).max() > 1e100:
        raise InputError(f"{label}: rows too close together or too large to compute with")
    return grid, np.bincount(place, force) / np.bincount(place)


def quintic_pieces(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Rows (start, c0 .. c5), one per interval, of the shape-preserving C2 interpolant of values y (n,) at x (n,).

    It is the quintic Hermite interpolant with the slopes and curvatures of the C2 cubic spline, cut back where needed
    to keep it monotone between rows.
    """
    from scipy.interpolate import CubicSpline  # only a table needs it, and it takes half a second to import

    spline = CubicSpline(x, y)
    h, rise = np.diff(x), np.diff(y)
    slope = _limited_slopes(spline(x, 1), rise / h)
    curvature = _limited_curvatures(spline(x, 2), slope, h, rise)
    # The coefficients are written out, since through Bernstein form, as in SciPy, the highest lose three digits.
    d0, d1, s0, s1 = slope[:-1], slope[1:], curvature[:-1], curvature[1:]
    c3 = 10 * rise / h**3 - (6 * d0 + 4 * d1) / h**2 - (1.5 * s0 - 0.5 * s1) / h
    c4 = -15 * rise / h**4 + (8 * d0 + 7 * d1) / h**3 + (1.5 * s0 - s1) / h**2
    c5 = 6 * rise / h**5 - 3 * (d0 + d1) / h**4 - (0.5 * s0 - 0.5 * s1) / h**3
    return np.column_stack([x[:-1], y[:-1], d0, s0 / 2, c3, c4, c5])


def _limited_slopes(slope: np.ndarray, secant: np.ndarray) -> np.ndarray:
    """Slopes (n,) that let the interpolant be monotone beside secants (n - 1,): 0 at an extremum of the rows."""
    sides = np.column_stack([np.r_[secant[0], secant], np.r_[secant, secant[-1]]])
    sign = np.where((sides > 0).all(1), 1.0, np.where((sides < 0).all(1), -1.0, 0.0))
    # 1.25 times the smaller secant keeps the middle control points of a quintic without curvature in order.
    return sign * np.clip(sign * slope, 0, 1.25 * np.abs(sides).min(1))


def _limited_curvatures(curvature: np.ndarray, slope: np.ndarray, h: np.ndarray, rise: np.ndarray) -> np.ndarray:
    """Curvatures (n,) that leave each quintic's control points in order, b1 <= b2 <= b3 <= b4 times its rise's sign."""
    direction = np.sign(rise)
    room = np.maximum(direction * (rise - 0.4 * h * (slope[:-1] + slope[1:])), 0) * 10 / h**2
    low, high = np.full(len(slope), -np.inf), np.full(len(slope), np.inf)
    for ends, side in ((slice(None, -1), 1.0), (slice(1, None), -1.0)):
        edge = 4 * np.abs(slope[ends]) / h
        bounds = side * direction * np.stack([-edge, room])
        low[ends] = np.maximum(low[ends], bounds.min(0))
        high[ends] = np.minimum(high[ends], bounds.max(0))
    return np.clip(curvature, low, high)


def _named_column(path, header, names, units, in_si) -> tuple[int, str, float]:
    """The index, the name and the unit of the first column that has one of the names, perhaps a unit after it."""
    for index, cell in enumerate(header):
        name, *others = re.split(r"[\s_()\[\]/]+", cell.strip().lower())
        if name in names:
            unit = next(filter(None, others), "")
            if in_si and unit and unit not in units:
                raise InputError(f"the table {path}: unknown unit '{unit}'; known: {', '.join(units)}")
            return index, name, units[unit] if in_si and unit else 1.0
    has, known = ",".join(header), ", ".join(names)
    raise InputError(f"the table {path} has no column {names[0]}: its header is {has!r}, known names are {known}")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
