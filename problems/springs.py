"""Spring laws: force phi(r) against extension r, tension positive, stiffness 1 at rest where nothing else is said.

Lengths are in units of the foot's weight over the stiffness, forces in the foot's weight (hopper), or of the hand's
(juggler); of a machine stated in SI, in m and N. Each named law is a function of its parameters, whose units follow
from these: `beta` is 1/length**2, `delta` 1/length**4, `a` and `b` are 1/length, `gap`, `length`, `height` and
`thickness` lengths, `k`, `ratio` and `stop` stiffnesses. `NAMED` lists the laws for the command line.
"""

import csv
import math
import re
from pathlib import Path

import numpy as np

from orbits.errors import InputError

from . import laws
from .laws import Law, number

EXTENSIONS = ("extension", "deflection", "displacement", "elongation", "travel", "stroke", "compression", "r", "x")
FORCES = ("force", "tension", "load", "f")
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
NEWTONS = {"n": 1.0, "mn": 1e-3, "kn": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605}


def formula(text: str, /, **parameters: float) -> Law:
    """A spring from a formula of the extension r: ``formula("r + beta*r**3", beta=0.3)``."""
    return laws.from_formula(text, "r", parameters)


def potential(text: str, /, **parameters: float) -> Law:
    """A spring from its potential energy V(r); the force is dV/dr."""
    return laws.from_potential(text, "r", parameters)


def function(force, /, breakpoints: tuple[float, ...] = (), **parameters: float) -> Law:
    """A spring from a Python function force(r, **parameters), smooth between the breakpoints.

    Declare where it jumps or bends: steps end there, and derivatives are carried across a jump.
    """
    return laws.from_function(force, "r", parameters, breakpoints)


def linear(*, k: float = 1.0) -> Law:
    """Hooke's law k r: metal springs in small strain (Hooke 1678)."""
    number("k", k, low=0)
    return formula("r") if k == 1 else formula("k*r", k=k)


def cubic(*, beta: float = 0.3) -> Law:
    """Duffing's spring r + beta r**3: hardening for beta > 0, softening for beta < 0 (Duffing 1918)."""
    return formula("r + beta*r**3", beta=beta)


def quintic(*, beta: float = 0.0, delta: float = 0.1) -> Law:
    """r + beta r**3 + delta r**5, the next symmetric polynomial after Duffing's (Nayfeh and Mook 1979): a spring that
    softens first and hardens then, or the other way round."""
    return formula("r + beta*r**3 + delta*r**5", beta=beta, delta=delta)


def tanh(*, b: float = 0.2) -> Law:
    """Saturating spring tanh(b r)/b: the force never exceeds 1/b, a smooth form of the elastic,
    perfectly plastic curve (Hill 1950)."""
    number("b", b, low=0)
    return formula("tanh(b*r)/b", b=b)


def sinh(*, b: float = 0.5) -> Law:
    """Hardening spring sinh(b r)/b, exponentially stiff both ways, the form of stress in
    Eyring's theory of flow (1936)."""
    number("b", b, low=0)
    return formula("sinh(b*r)/b", b=b)


def toda(*, b: float = 0.2) -> Law:
    """Toda's lattice spring (1 - exp(-b r))/b: hard in compression, saturating at 1/b in tension (Toda 1967).

    A negative b turns it round: hard in tension.
    """
    if number("b", b) == 0:
        raise InputError("b = 0 makes the Toda spring linear; use the law 'linear'")
    return formula("(1 - exp(-b*r))/b", b=b)


def morse(*, a: float = 0.05) -> Law:
    """Morse's bond (1 - exp(-a r)) exp(-a r)/a: the tension has its maximum 1/(4 a) and then falls (Morse 1929)."""
    number("a", a, low=0)
    return formula("(1 - exp(-a*r))*exp(-a*r)/a", a=a)


def bilinear(*, ratio: float = 3.0, gap: float = 0.5) -> Law:
    """Stiffness 1 up to the extension `gap`, `ratio` beyond it: a second spring that is picked up in
    tension (Shaw and Holmes 1983)."""
    number("ratio", ratio, low=0)
    number("gap", gap, low=0)
    return Law("bilinear", "r", _line_expression, {"ratio": ratio, "gap": gap}, (3, _bilinear_pieces))


def end_stops(*, gap: float = 3.0, stop: float = 20.0) -> Law:
    """Stiffness 1 between stops at extensions -gap and gap, `stop` beyond them: a bump stop and a strap
    (Shaw and Holmes 1983)."""
    number("gap", gap, low=0)
    number("stop", stop, low=0)
    return Law("end_stops", "r", _line_expression, {"gap": gap, "stop": stop}, (3, _end_stop_pieces))


def air(*, length: float = 5.0, exponent: float = 1.4) -> Law:
    """Air spring: a gas column of effective length `length`, compressed polytropically with `exponent`.

    (length/exponent) (1 - (1 + r/length)**-exponent), the change of the force p A (V0/V)**n from rest (Bachrach and
    Rivin 1983); exponent 1 is slow (isothermal), 1.4 fast (adiabatic) air. Tension stays below length/exponent.
    """
    number("length", length, low=0)
    number("exponent", exponent, low=0)
    return formula("length/exponent*(1 - (1 + r/length)**(-exponent))", length=length, exponent=exponent)


def belleville(*, height: float = 4.0, thickness: float = 4.0) -> Law:
    """Belleville washer after Almen and Laszlo (1936), held at both rims so that it can also be pulled.

    With deflection -r, cone height h and thickness t: r ((h + r)(h + r/2) + t**2)/(h**2 + t**2), stiffness 1 at rest.
    Where h/t exceeds sqrt(2) the washer snaps through in compression.
    """
    number("height", height, low=0)
    number("thickness", thickness, low=0)
    text = "r*((height + r)*(height + r/2) + thickness**2)/(height**2 + thickness**2)"
    return formula(text, height=height, thickness=thickness)


def rubber(*, length: float = 10.0) -> Law:
    """Neo-Hookean strip of rest length `length` in uniaxial tension (Treloar 1975).

    (length/3) (s - s**-2) with stretch s = 1 + r/length; stiffness 1 at rest, singular where the strip has no length.
    """
    number("length", length, low=0)
    return formula("length/3*((1 + r/length) - (1 + r/length)**(-2))", length=length)


def table(source, *, in_si: bool = False) -> Law:
    """A spring from measured pairs: a CSV file with a header, or (extensions, forces) as two sequences.

    The header names one column of `EXTENSIONS` and one of `FORCES`, tension and extension positive; under
    `compression` both are counted the other way. In SI a unit after the name (mm, kN) is converted to m and N;
    a dimensionless machine takes the numbers as they stand. Rows in any order, repeated extensions averaged.

    Through the points runs the C2 cubic spline, as a quintic Hermite interpolant whose slopes and curvatures are cut
    back where the spline would overshoot: between rows the force is monotone, and the whole is twice differentiable.
    Outside the table there is no force: an orbit that needs one is refused with the range.
    """
    label, columns = _read(Path(source), in_si) if isinstance(source, str | Path) else ("table", source)
    try:
        r, force = (np.asarray(column, dtype=float) for column in columns)
    except (TypeError, ValueError):
        raise InputError(f"{label}: a table is two sequences of numbers, extensions and forces") from None
    if r.ndim != 1 or r.shape != force.shape or not (np.isfinite(r).all() and np.isfinite(force).all()):
        raise InputError(f"{label}: extensions and forces must be two finite lists of one length")
    grid, place = np.unique(r, return_inverse=True)
    if len(grid) < 4:
        raise InputError(f"{label}: {len(grid)} different extensions; a table needs at least 4")
    if np.diff(grid).min() < 1e-9 * np.ptp(grid) or np.abs(force).max() > 1e100:
        raise InputError(f"{label}: rows too close together or too large to compute with")
    mean = np.bincount(place, force) / np.bincount(place)
    data = _quintic_pieces(grid, mean)

    def expression(x, p, q):
        value = 0
        for coefficient in reversed(q[1:]):
            value = value * (x - q[0]) + coefficient
        return value

    return Law(f"table:{label}", "r", expression, {}, (7, lambda p: (grid.tolist(), data.tolist())))


NAMED = {
    law.__name__: law
    for law in (linear, cubic, quintic, tanh, sinh, toda, morse, bilinear, end_stops, air, belleville, rubber)
}


def as_spring(law, parameters: dict[str, float] | None = None, in_si: bool = False) -> Law:
    """A spring from a law, a formula, a law's name, "table:FILE", "potential:FORMULA" or a Python function."""
    kind, colon, rest = law.partition(":") if isinstance(law, str) else ("", "", "")
    if not (colon and kind in ("table", "potential")):
        return laws.from_any(law, "r", parameters, NAMED, "a spring")
    if not rest.strip():
        raise InputError(f"spring '{law}' names no {'file' if kind == 'table' else 'formula'} after the colon")
    if kind == "potential":
        return potential(rest, **(parameters or {}))
    if parameters:
        raise InputError(f"a table has no parameter '{next(iter(parameters))}'")
    return table(rest, in_si=in_si)


def _line_expression(x, p, q):
    start, force, stiffness = q
    return force + stiffness * (x - start)


def _bilinear_pieces(p):
    gap = p["gap"]
    return [-math.inf, gap, math.inf], [[0.0, 0.0, 1.0], [gap, gap, p["ratio"]]]


def _end_stop_pieces(p):
    gap, stop = p["gap"], p["stop"]
    return [-math.inf, -gap, gap, math.inf], [[-gap, -gap, stop], [0.0, 0.0, 1.0], [gap, gap, stop]]


def _read(path: Path, in_si: bool) -> tuple[str, tuple[np.ndarray, np.ndarray]]:
    """Name, and extensions and forces, of a CSV file with a header."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"the table {str(path)!r} cannot be read: {error}") from None
    if len(rows) < 2:
        raise InputError(f"the table {path} has no rows; it needs a header and at least 4 rows")
    if all(_is_number(cell) for cell in rows[0]):
        raise InputError(f"the table {path} has no header; name its columns in the first row")
    header = [re.split(r"[\s_()\[\]/]+", cell.strip().lower()) for cell in rows[0]]
    columns, signs, scales = [], [], []
    for names, units in ((EXTENSIONS, METRES), (FORCES, NEWTONS)):
        column = next((i for i, words in enumerate(header) if words[0] in names), None)
        if column is None:
            raise InputError(f"the table {path} has no column {names[0]}: its header is {','.join(rows[0])!r}, known "
                             f"names are {', '.join(names)}")  # fmt: skip
        unit = next((word for word in header[column][1:] if word), "")
        if in_si and unit and unit not in units:
            raise InputError(f"the table {path}: unknown unit '{unit}'; known: {', '.join(units)}")
        columns.append(column)
        signs.append(-1.0 if header[column][0] == "compression" else 1.0)
        scales.append(units[unit] if in_si and unit else 1.0)
    values = []
    for line, row in enumerate(rows[1:], start=2):
        try:
            values.append([float(row[i]) for i in columns])
        except (ValueError, IndexError):
            raise InputError(f"the table {path}, row {line}: {','.join(row)!r} does not hold two numbers") from None
    extensions, forces = np.array(values).T
    return path.name, (signs[0] * scales[0] * extensions, signs[0] * scales[1] * forces)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _quintic_pieces(x, y) -> np.ndarray:
    """Rows (start, c0 .. c5) of the shape-preserving C2 interpolant, one per interval."""
    from scipy.interpolate import CubicSpline  # only a table needs it, and it takes half a second to import

    spline = CubicSpline(x, y)
    slope, curvature = spline(x, 1), spline(x, 2)
    h, rise = np.diff(x), np.diff(y)
    secant = rise / h
    # Monotone between rows: a node's slope has the sign of both secants (0 at an extremum) and is at most 1.25 times
    # the smaller, which keeps the middle control points of the quintic in order when the curvature is 0.
    sides = np.column_stack([np.r_[secant[0], secant], np.r_[secant, secant[-1]]])
    sign = np.where((sides > 0).all(1), 1.0, np.where((sides < 0).all(1), -1.0, 0.0))
    slope = sign * np.clip(sign * slope, 0, 1.25 * np.abs(sides).min(1))
    # The curvature then has room on each side: the control points b1 <= b2 and b2 <= b3 <= b4 (times the sign).
    direction = np.sign(rise)
    room = np.maximum(direction * (rise - 0.4 * h * (slope[:-1] + slope[1:])), 0) * 10 / h**2
    low, high = np.full(len(x), -np.inf), np.full(len(x), np.inf)
    for nodes, side in ((slice(None, -1), 1.0), (slice(1, None), -1.0)):
        edge = 4 * np.abs(slope[nodes]) / h
        bounds = side * direction * np.stack([-edge, room])
        low[nodes] = np.maximum(low[nodes], bounds.min(0))
        high[nodes] = np.minimum(high[nodes], bounds.max(0))
    curvature = np.clip(curvature, low, high)
    d0, d1, s0, s1 = slope[:-1], slope[1:], curvature[:-1], curvature[1:]
    c3 = 10 * rise / h**3 - (6 * d0 + 4 * d1) / h**2 - (1.5 * s0 - 0.5 * s1) / h
    c4 = -15 * rise / h**4 + (8 * d0 + 7 * d1) / h**3 + (1.5 * s0 - s1) / h**2
    c5 = 6 * rise / h**5 - 3 * (d0 + d1) / h**4 - (0.5 * s0 - 0.5 * s1) / h**3
    return np.column_stack([x[:-1], y[:-1], d0, s0 / 2, c3, c4, c5])
