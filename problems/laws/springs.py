"""Spring laws: force phi(r) against extension r, tension positive.

Each named law is a function of its parameters. Without a `stiffness` it has the slope 1 at rest of a machine without
units: lengths are in units of the foot's weight over the stiffness, forces in the foot's weight (hopper), or in the
hand's (juggler). With a `stiffness`, its slope at rest in N/m, it is the same formula times the stiffness, for a
machine in SI: lengths are in m, and have no default. `beta` is 1/length**2, `delta` 1/length**4, `a` and `b` are
1/length, `gap`, `length`, `height` and `thickness` lengths; `exponent`, `ratio` and `stop` have no unit. Formulas and
tables of a machine in SI are in m and N. `NAMED` lists the laws for the command line.

>>> law = air(stiffness=8000.0, length=0.2)  # for hopper_in_si(60.0, 3.0, force=law)
>>> float(law.with_slope(0.0)[1])
8000.0
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from keyword import iskeyword
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from orbits.errors import InputError
from orbits.laws import (
    Expression,
    Law,
    LawLike,
    LawPieces,
    Written,
    law_statement as laws,
    number,
    positive,
)
from orbits.symbolic import suggest

from .fitting import fit as fit

if TYPE_CHECKING:
    from orbits.laws import HystereticLaw

    from ..recordings import BenchRecord, SmoothCurve

# A sample to try tables with: a leg's spring in mm and N, with noise as from a bench.
SAMPLE = Path(__file__).with_name("leg_spring.csv")
READING_OPTIONS = ("columns", "units", "cycle", "noise")  # of measured rows in text, after the file
TABLE_OPTIONS = (*READING_OPTIONS, "branch", "scale", "shift")
UNITS_IN_SI = {"beta": "1/m^2", "delta": "1/m^4"} | dict.fromkeys("ab", "1/m")  # of parameters of named laws
UNITS_IN_SI |= dict.fromkeys(("gap", "length", "height", "thickness"), "m")
HYSTERETIC_KINDS = ("hysteretic", "lossy", "loop")  # of springs with hysteresis in text, before the colon


def formula(text: str, /, **parameters: float) -> Law:
    """A spring from a formula of the extension r: ``formula("r + beta*r**3", beta=0.3)``.

    >>> float(formula("r + beta*r**3", beta=0.3)(2.0))
    4.4
    """
    return laws.from_formula(text, "r", parameters)


def potential(text: str, /, **parameters: float) -> Law:
    """A spring from its potential energy V(r); the force is dV/dr.

    >>> float(potential("r**2/2 + beta*r**4/4", beta=0.3)(2.0))
    4.4
    """
    return laws.from_potential(text, "r", parameters)


def function(force: Callable, /, breakpoints: tuple[float, ...] = (), **parameters: float) -> Law:
    """A spring from a Python function force(r, **parameters), smooth between the breakpoints.

    breakpoints : extensions at which the force jumps or has a kink: integration steps end there, and derivatives are
        computed correctly across them
    parameters : values of the function's parameters

    >>> float(function(lambda r, b: r + b * r**3, b=0.3)(2.0))
    4.4
    """
    return laws.from_function(force, "r", parameters, breakpoints)


def _sizes(stiffness: float | None = None, /, **stated: tuple[float | None, float]) -> dict[str, float]:
    """The parameters that have a unit of length, each stated as its value, or None, and its default.

    Raises `InputError` for a stiffness without one of them: a default is a length of a machine without units.
    """
    missing = [f"{name} ({UNITS_IN_SI[name]} in SI)" for name, (value, _) in stated.items() if value is None]
    if stiffness is not None and missing:
        raise InputError(f"a spring of stiffness {stiffness:g} needs {' and '.join(missing)}: state it too")
    return {name: default if value is None else value for name, (value, default) in stated.items()}


def _normalised(text: str, stiffness: float | None, **parameters: float) -> Law:
    """A formula with the slope 1 at rest, which is that of a machine without units, or times a stiffness."""
    if stiffness is None:
        return replace(formula(text, **parameters), in_si=False)
    return formula(f"stiffness*({text})", **positive(stiffness=stiffness), **parameters)


def _factor(stiffness: float | None, k: float | None) -> dict[str, float]:
    """The stiffness of a law by the name that it was stated by; k is its earlier name. Empty where it was not."""
    if stiffness is not None and k is not None:
        raise InputError(f"stiffness = {stiffness:g} and k = {k:g} are one parameter: leave k out")
    return positive(**{name: x for name, x in (("stiffness", stiffness), ("k", k)) if x is not None})


def linear(*, stiffness: float | None = None, k: float | None = None) -> Law:
    """Hooke's law stiffness*r: metal springs in small strain (Hooke 1678)."""
    factor = _factor(stiffness, k)
    return formula("*".join((*factor, "r")), **factor)


def cubic(*, beta: float | None = None, stiffness: float | None = None) -> Law:
    """Duffing's spring r + beta r**3: hardening for beta > 0, softening for beta < 0 (Duffing 1918)."""
    return _normalised("r + beta*r**3", stiffness, **_sizes(stiffness, beta=(beta, 0.3)))


def quintic(*, beta: float = 0.0, delta: float | None = None, stiffness: float | None = None) -> Law:
    """Spring r + beta r**3 + delta r**5, softening first and hardening then, or inversely (Nayfeh and Mook 1979)."""
    return _normalised("r + beta*r**3 + delta*r**5", stiffness, beta=beta, **_sizes(stiffness, delta=(delta, 0.1)))


def tanh(*, b: float | None = None, stiffness: float | None = None) -> Law:
    """Saturating spring tanh(b r)/b: at most 1/b, a smooth elastic, perfectly plastic curve (Hill 1950)."""
    return _normalised("tanh(b*r)/b", stiffness, **positive(**_sizes(stiffness, b=(b, 0.2))))


def sinh(*, b: float | None = None, stiffness: float | None = None) -> Law:
    """Hardening spring sinh(b r)/b, exponentially stiff both ways, as in Eyring's theory of flow (1936)."""
    return _normalised("sinh(b*r)/b", stiffness, **positive(**_sizes(stiffness, b=(b, 0.5))))


def toda(*, b: float | None = None, stiffness: float | None = None) -> Law:
    """Toda's lattice spring (1 - exp(-b r))/b (1967): hard in compression, at most 1/b in tension; b < 0 reverses."""
    own = _sizes(stiffness, b=(b, 0.2))
    if number("b", own["b"]) == 0:
        raise InputError("b = 0 makes the Toda spring linear; use the law 'linear'")
    return _normalised("(1 - exp(-b*r))/b", stiffness, **own)


def morse(*, a: float | None = None, stiffness: float | None = None) -> Law:
    """Morse's bond (1 - exp(-a r)) exp(-a r)/a: the tension has its maximum 1/(4 a) and then falls (Morse 1929)."""
    return _normalised("(1 - exp(-a*r))*exp(-a*r)/a", stiffness, **positive(**_sizes(stiffness, a=(a, 0.05))))


def bilinear(
    *, ratio: float = 3.0, gap: float | None = None, stiffness: float | None = None, k: float | None = None
) -> Law:
    """A stiffness up to the extension `gap`, `ratio` times that beyond: a second spring engages (Shaw and Holmes
    1983)."""
    formulas, factor = ("r", "gap + ratio*(r - gap)"), _factor(stiffness, k)
    own = positive(ratio=ratio, **_sizes(*factor.values(), gap=(gap, 0.5)))
    return _of_lines("bilinear", formulas, ("gap",), _bilinear_pieces, factor, own)


def end_stops(
    *, gap: float | None = None, stop: float = 20.0, stiffness: float | None = None, k: float | None = None
) -> Law:
    """A stiffness between extensions -gap and gap, `stop` times that beyond: stop and strap (Shaw and Holmes 1983)."""
    formulas, factor = ("-gap + stop*(r + gap)", "r", "gap + stop*(r - gap)"), _factor(stiffness, k)
    own = positive(**_sizes(*factor.values(), gap=(gap, 3.0)), stop=stop)
    return _of_lines("end_stops", formulas, ("-gap", "gap"), _end_stop_pieces, factor, own)


def _of_lines(
    name: str, formulas: tuple[str, ...], places: tuple[str, ...], table: Callable, factor: Mapping[str, float],
    parameters: Mapping[str, float],
) -> Law:  # fmt: skip
    """A law of straight lines, each a formula up to one of the places; a stated factor multiplies it."""
    pieces = LawPieces(3, table)
    if not factor:
        return Law(name, "r", _line_expression, parameters, pieces, Written(formulas, places), in_si=False)
    times = next(iter(factor))
    written = Written(tuple(f"{times}*({formula})" for formula in formulas), places)
    return Law(name, "r", _moved_expression(_line_expression, times, None), {**factor, **parameters}, pieces, written)


def air(*, length: float | None = None, exponent: float = 1.4, stiffness: float | None = None) -> Law:
    """Air spring: a gas column of effective length `length`, compressed polytropically with `exponent`.

    (length/exponent) (1 - (1 + r/length)**-exponent), the change of the force p A (V0/V)**n from rest (Bachrach and
    Rivin 1983); exponent 1 is slow (isothermal), 1.4 fast (adiabatic) air. Tension stays below length/exponent.
    """
    own = positive(**_sizes(stiffness, length=(length, 5.0)), exponent=exponent)
    return _normalised("length/exponent*(1 - (1 + r/length)**(-exponent))", stiffness, **own)


def belleville(*, height: float | None = None, thickness: float | None = None, stiffness: float | None = None) -> Law:
    """Belleville washer after Almen and Laszlo (1936), held at both rims so that it can also be pulled.

    With deflection -r, cone height h and thickness t: r ((h + r)(h + r/2) + t**2)/(h**2 + t**2), stiffness 1 at rest.
    Where h/t exceeds sqrt(2) the washer snaps through in compression.
    """
    text = "r*((height + r)*(height + r/2) + thickness**2)/(height**2 + thickness**2)"
    return _normalised(
        text, stiffness, **positive(**_sizes(stiffness, height=(height, 4.0), thickness=(thickness, 4.0)))
    )


def rubber(*, length: float | None = None, stiffness: float | None = None) -> Law:
    """Neo-Hookean strip of rest length `length` in uniaxial tension (Treloar 1975).

    (length/3) (s - s**-2) with stretch s = 1 + r/length; stiffness 1 at rest, singular where the strip has no length.
    """
    own = positive(**_sizes(stiffness, length=(length, 10.0)))
    return _normalised("length/3*((1 + r/length) - (1 + r/length)**(-2))", stiffness, **own)


def table(
    source: Any,
    *,
    in_si: bool = False,
    columns: Sequence[str | int] | None = None,
    units: Sequence[str] | None = None,
    cycle: int | str | None = None,
    branch: str | None = None,
    noise: float | None = None,
    scale: str | None = None,
    shift: str | None = None,
) -> Law:
    """A spring from measured pairs: a file of text columns with a header, a `pandas.DataFrame` whose columns have such
    names, or (extensions, forces) as two sequences.

    in_si : whether the law is in m and N, to which the units in the header are then converted; otherwise units in the
        header are an error, since a dimensionless machine uses the numbers as they are
    columns : names of the columns of extension and force, or their places from 0, as for a file without a header;
        needed where several columns may be meant
    units : of these columns, as ("mm", "N") or ("deg", "N m"), where the header does not have them
    cycle : of a record of several cycles, its number from 1, "last", "mean", the mean of all cycles, or "all", their
        rows together; None for the last one, if all agree within the noise
    branch : of a hysteresis loop: "loading", on which the measured travel grows (away from rest, if the table has one
        side only), "unloading", or "mean", the mean of both where both have been measured
    noise : standard deviation of a row's force, in the law's unit; 0 where the rows are exact, None to estimate it
    scale, shift : names of parameters of the law, s and d, for the force s f(r - d) of a measured force f; 1 and 0
        where a machine does not say otherwise

    The header names one column of `header.EXTENSION_NAMES` and one of `header.FORCE_NAMES`, or an angle and a torque;
    tension and extension are positive; the signs of both are reversed where one says compression, unless the other says
    tension. Units follow the names, as in `Weg [mm]`, `force_kN`, or are in the row below. Tabs, semicolons, commas or
    blanks separate the columns; with commas a decimal comma has to be in quotes. Lines before the header and comments
    (#, ;, %, //) are ignored.

    A record of cycles, whose rows are in the order of the measurement, is split where its extension turns. A cycle is
    the half cycle that leads to an extreme of the side to which the record moves first, and the one after it. The first
    half cycle is a virgin curve, which is left out, unless a later one repeats it. Rows without cycles may be in any
    order; forces at repeated extensions are averaged, and their differences count as noise. The text of the law says
    which columns, rows, cycle and branch it is of. What cycles drift counts as uncertainty of the law.

    The law is the C2 cubic spline, as a quintic Hermite interpolant whose slopes and curvatures are reduced where the
    spline would overshoot: between rows the force is monotone, and the law is twice differentiable. Noisy rows are
    smoothed first, see `smoothing.curve_of`; the text of the law says so, and orbits state the effect on alpha. Outside
    the table the force is not defined: an orbit that leaves it is refused, with the range that it needs. Raises
    `InputError` for a table that cannot be read or interpolated, where several columns may be meant or a unit is
    missing, and for a loop, or cycles that differ, where none is named.

    >>> law = table(([-2.0, -1.0, 0.0, 1.0, 2.0], [-3.0, -1.2, 0.0, 1.2, 3.0]), noise=0)
    >>> float(law(1.0)), law.range()
    (1.2, (-2.0, 2.0))
    """
    from ..recordings import read_record

    record = read_record(source, in_si, columns, units)
    law = _measured(record, branch, cycle, noise, scale, shift)
    whole = branch is None or scale or shift
    return law if whole else replace(law, loop=partial(_loop_of, record, cycle, noise))


def _measured(
    record: "BenchRecord", branch: str | None, cycle: int | str | None, noise: float | None,
    scale: str | None = None, shift: str | None = None,
) -> Law:  # fmt: skip
    """The law of a branch of a record."""
    from ..recordings import choose, curve_of, with_drifts

    if noise is not None and number("noise", noise, high=1e100) < 0:
        raise InputError(f"noise = {noise:g} is below 0; it is the standard deviation of a row's force")
    chosen = choose(record, branch, cycle)
    curve = curve_of(chosen.rows, noise)
    if noise != 0:
        curve = with_drifts(curve, chosen.rows.extensions, chosen.drifts)
    note = ", ".join(filter(None, (record.columns, chosen.note, curve.note)))
    text = f"table:{record.name}" + (f" ({note})" if note else "")
    named = [(scale, "scale", 1.0), (shift, "shift", 0.0)]
    own = {_name(name, what): value for name, what, value in named if name is not None}
    if scale is not None and scale == shift:
        raise InputError(f"scale = shift = '{scale}': they are two parameters; give them two names")
    moved = _moved_expression(_piece_expression, scale, shift) if own else _piece_expression
    text = (f"{scale}*" if scale else "") + text + (f" moved by {shift}" if shift else "")
    nodes, pieces = _table_pieces(curve)
    written = Written((scale or "1",), rows=_rows_of_table(nodes), shift=shift)
    return Law(text, "r", moved, own, pieces._replace(origin=shift), written, any(record.units) or None)


def hysteretic(extending: LawLike, shortening: LawLike, /, **parameters: float) -> "HystereticLaw":
    """A spring with hysteresis: the force is `extending` while the extension grows, `shortening` while it shrinks.

    extending, shortening : springs stated in any of the ways of `as_spring`, the first nowhere below the second
    parameters : values of the names in their formulas, which they have in common

    The force does not depend on how fast the spring moves. A cycle between two extensions loses the area between the
    branches; where they do not meet at a reversal the force jumps. `simulate` and `ReturnMap` follow such a spring; it
    has no lossless hop, but its `mean` has, the law half way between the branches. Raises `InputError` where the force
    would be smaller while the spring extends, and so gain energy.

    >>> law = hysteretic("r + friction", "r - friction", friction=0.1)
    >>> float(law.extending(2.0)), float(law.shortening(2.0)), float(law.mean(2.0))
    (2.1, 1.9, 2.0)
    """
    from . import loops

    branches = [as_spring(law, parameters, shared=True) for law in (extending, shortening)]
    _refuse_unused(parameters, {name for law in branches for name in law.parameters})
    return loops.of_branches(f"hysteretic:{branches[0].text};{branches[1].text}", *branches)


def lossy(
    mean: LawLike, /, *, loss_factor: float | None = None, loop_area: float | None = None,
    between: tuple[float, float] | None = None, **parameters: float,
) -> "HystereticLaw":  # fmt: skip
    """A spring with hysteresis from its mean law and its loss: (1 + pi/2 loss_factor) times the mean law while it moves
    away from rest, and (1 - pi/2 loss_factor) times while it comes back (Reid 1956).

    loss_factor : the loss of a cycle over 2 pi times the energy stored at its end, for a cycle between opposite
        extensions of a spring that is the same in tension and compression; a parameter of the law
    loop_area, between : instead, the area of the loop that was measured between two extensions
    parameters : values of the names in the mean law

    >>> float(lossy("r", loss_factor=0.1).extending(2.0).round(6)), float(lossy("r", loss_factor=0.1).mean(2.0))
    (2.314159, 2.0)
    """
    from . import loops

    law = as_spring(mean, parameters, shared=True)
    _refuse_unused(parameters, law.parameters)
    if (loss_factor is None) == (loop_area is None) or (loop_area is None) != (between is None):
        raise InputError(
            "a lossy spring needs a loss_factor, or a loop_area and the two extensions `between` which it was measured"
        )
    if loss_factor is None:
        assert loop_area is not None  # and between, as was checked
        assert between is not None
        loss_factor = loops.loss_factor_of(law, loop_area, between)
    return loops.of_loss(law, loss_factor)


def loop(
    source: Any, *, in_si: bool = False, columns: Sequence[str | int] | None = None, units: Sequence[str] | None = None,
    cycle: int | str | None = None, noise: float | None = None,
) -> "HystereticLaw":  # fmt: skip
    """A spring with hysteresis from a measured loop, whose rows are in the order of the measurement; see `table` for
    the arguments.

    >>> travel = [-2.0, -1.0, 0.0, 1.0, 2.0, 1.0, 0.0, -1.0, -2.0]
    >>> force = [-2.0, -0.8, 0.2, 1.2, 2.0, 0.8, -0.2, -1.2, -2.0]
    >>> law = loop((travel, force), noise=0)
    >>> float(law.extending(0.0)), float(law.shortening(0.0))
    (0.2, -0.2)
    """
    from ..recordings import read_record

    return _loop_of(read_record(source, in_si, columns, units), cycle, noise)


def _loop_of(record: "BenchRecord", cycle: int | str | None, noise: float | None) -> "HystereticLaw":
    """The loop of a record."""
    from ..recordings import choose
    from . import loops

    branches = [_measured(record, name, cycle, noise) for name in ("loading", "unloading")]
    lows, highs = zip(*(law.range() for law in branches), strict=True)
    low, high = max(lows), min(highs)
    if not low < high:
        raise InputError(f"{branches[0].text}: its two branches have no extension in common")
    # Of a spring measured in compression alone, the extension grows while it is unloaded.
    places = np.linspace(low, high, 257)
    if float(np.mean(branches[0](places) - branches[1](places))) < 0:
        branches.reverse()
    notes = [choose(record, name, cycle).note for name in ("loading", "unloading")]
    named = ", ".join(filter(None, (record.columns, *notes)))
    return loops.of_branches(f"loop:{record.name}" + (f" ({named})" if named else ""), *branches)


def _refuse_unused(parameters: Mapping[str, float], used: Collection[str]) -> None:
    if unused := [name for name in parameters if name not in used]:
        raise InputError(f"this law has no parameter '{unused[0]}'{suggest(unused[0], used)}")


def _with_loss(kind: str, text: str, values: Mapping[str, float], in_si: bool) -> "HystereticLaw":
    """The law of "hysteretic:EXTENDING;SHORTENING", "lossy:MEAN" and "loop:FILE?noise=0.5"."""
    from . import loops

    if kind == "loop":
        path, options = table_options(text)
        if not path.strip() or options.keys() - {*READING_OPTIONS}:
            remedy = f"a loop is stated as loop:FILE, or loop:FILE?noise=0.5, and has {', '.join(READING_OPTIONS)}"
            raise InputError(f"spring 'loop:{text}': {remedy}")
        return loop(path, in_si=in_si, **options)
    if kind == "lossy":
        if "loss_factor" not in values:
            raise InputError(f"spring 'lossy:{text}' needs a loss factor: set loss_factor=VALUE")
        mean = as_spring(text, {name: x for name, x in values.items() if name != "loss_factor"}, in_si, shared=True)
        return loops.of_loss(mean, values["loss_factor"])
    texts = text.split(";")
    if len(texts) != 2:
        raise InputError(
            f"spring 'hysteretic:{text}': it must have two branches, as in hysteretic:EXTENDING;SHORTENING"
        )
    branches = [as_spring(law.strip(), values, in_si, shared=True) for law in texts]
    return loops.of_branches(f"hysteretic:{branches[0].text};{branches[1].text}", *branches)


NAMED = {
    law.__name__: law
    for law in (linear, cubic, quintic, tanh, sinh, toda, morse, bilinear, end_stops, air, belleville, rubber)
}


def __dir__() -> list[str]:
    """What states springs, for completion."""
    others = ("NAMED", "SAMPLE", "as_spring", "fit", "formula", "function", "hysteretic", "loop", "lossy", "potential")
    return [*NAMED, *others, "table", "table_options"]


def as_spring(
    law: LawLike, parameters: Mapping[str, float] | None = None, in_si: bool = False, shared: bool = False
) -> Law:
    """A spring from a law, a formula, a law's name, "table:FILE", "table:FILE?branch=loading&noise=0.5",
    "potential:FORMULA" or a Python function; with hysteresis from "hysteretic:EXTENDING;SHORTENING", "lossy:MEAN" with
    the parameter loss_factor, or "loop:FILE".

    parameters : their values by name
    in_si : as in `table`
    shared : whether the parameters are another law's too; this law then takes its own ones, while otherwise a parameter
        that it does not have is an `InputError`
    """
    kind, colon, rest = law.partition(":") if isinstance(law, str) else ("", "", "")
    if colon and kind == "table":
        path, options = table_options(rest)
        if not path.strip():
            raise InputError(f"spring '{law}' names no file after the colon")
        law = table(path, in_si=in_si, **options)
    elif colon and kind in HYSTERETIC_KINDS:
        law = _with_loss(kind, rest, parameters or {}, in_si)
    return laws.from_any(law, "r", parameters, NAMED, "a spring", shared)


def _line_expression(x, p, q):
    start, force, stiffness = q
    return force + stiffness * (x - start)


def _bilinear_pieces(p):
    return [-math.inf, p["gap"], math.inf], [[0.0, 0.0, 1.0], [p["gap"], p["gap"], p["ratio"]]]


def _end_stop_pieces(p):
    gap, stop = p["gap"], p["stop"]
    return [-math.inf, -gap, gap, math.inf], [[-gap, -gap, stop], [0.0, 0.0, 1.0], [gap, gap, stop]]


@lru_cache(maxsize=64)
def _moved_expression(expression: Callable, scale: str | None, shift: str | None) -> Expression:
    """The expression of a law with a factor and with a shift of its variable, each a parameter if it has a name."""

    def moved(x, p, q):
        value = expression(x - p[shift] if shift else x, p, q)
        return p[scale] * value if scale else value

    return Expression(moved, _moved_expression, expression, scale, shift)


def _name(name: Any, what: str) -> str:
    """A name of a parameter; raises `InputError` for anything else."""
    valid = isinstance(name, str) and name.isidentifier() and not iskeyword(name)
    if not valid or name == "r":
        raise InputError(
            f"{what} = {name!r}; it must be the name of a parameter, as in table(file, {what}='{what[0]}')"
        )
    return name


def _piece_expression(x, p, q):
    # Through the square it takes two products of series and a square, by Horner's rule four products.
    start, c0, c1, c2, c3, c4, c5 = q
    r = x - start
    square = r * r
    return c0 + r * (c1 + c2 * r + square * (c3 + c4 * r + c5 * square))


def _table_pieces(curve: "SmoothCurve") -> tuple[bytes, LawPieces]:
    """The nodes of a table's law in bytes, and its pieces, with the noise of its rows."""
    nodes, x = _nodes_of_table(*curve[:4]), curve.extensions.tobytes()
    pieces = LawPieces(7, _quintic_table(x, _quintic_pieces(nodes).tobytes()))
    if curve.deviations is not None or len(curve.changes):
        unit = None if curve.deviations is None else curve.deviations.tobytes()
        pieces = pieces._replace(noise=_row_noise(x, curve.places.tobytes(), curve.changes.tobytes(), unit))
    return nodes.tobytes(), pieces


@lru_cache(maxsize=64)
def _rows_of_table(nodes: bytes) -> Expression:
    """The function without arguments that returns the nodes (n, 4) of a measured law."""
    return Expression(lambda: np.frombuffer(nodes).reshape(-1, 4), _rows_of_table, nodes)


@lru_cache(maxsize=64)
def _quintic_table(breaks: bytes, rows: bytes) -> Expression:
    """The pieces of a measured law from its extensions and the rows of its pieces, in bytes, so that equal ones compare
    equal."""
    places, data = np.frombuffer(breaks).tolist(), np.frombuffer(rows).reshape(-1, 7).tolist()
    return Expression(lambda p: (places, data), _quintic_table, breaks, rows)


@lru_cache(maxsize=64)
def _row_noise(breaks: bytes, places: bytes, changes: bytes, unit: bytes | None) -> Expression:
    """The `RowNoise` of a measured law from its extensions and the numbers of its `SmoothCurve`."""
    x, at, deviations = np.frombuffer(breaks), np.frombuffer(places), unit and np.frombuffer(unit)
    moves = np.frombuffer(changes).reshape(-1, len(at))

    def noise(slopes: np.ndarray) -> tuple[float | None, float | None]:
        from scipy.interpolate import CubicSpline

        r, weights = _weights_of_values(x, slopes)
        known = float(np.linalg.norm(weights @ CubicSpline(at, moves.T)(r))) if len(moves) else None
        if deviations is None:
            return known, None
        return known, float(np.linalg.norm(_by_rows(breaks, r, weights) * deviations))

    return Expression(noise, _row_noise, breaks, places, changes, unit)


def _weights_of_values(x: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Extensions (m,) and the derivatives (m,) of a number by the law's values there, from those by the data of its
    pieces between `x`; only pieces that matter have extensions."""
    used = np.flatnonzero(slopes.any(1))
    h = np.diff(x)[used, None]
    shares = (1 - np.cos(np.pi * (np.arange(6) + 0.5) / 6)) / 2
    weights = (slopes[used, 1:] / h ** np.arange(6)) @ np.linalg.inv(np.vander(shares, increasing=True))
    return (x[used, None] + h * shares).ravel(), weights.ravel()


def _by_rows(x: bytes, r: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The derivatives (n,) of a number by the forces at `x` (n,), from those by the spline's values at `r` (m,)."""
    from scipy.interpolate import BSpline

    knots, solve = _spline_through(x)
    return solve(BSpline.design_matrix(r, knots, 3).T @ weights)


@lru_cache(maxsize=64)
def _spline_through(x: bytes) -> tuple[np.ndarray, Callable]:
    """The knots of the spline through values at `x` (n,), and the derivatives by its coefficients -> by its values."""
    from scipy.interpolate import BSpline
    from scipy.sparse.linalg import splu

    rows = np.frombuffer(x)
    knots = np.r_[[rows[0]] * 4, rows[2:-2], [rows[-1]] * 4]
    return knots, splu(BSpline.design_matrix(rows, knots, 3).T.tocsc()).solve


def table_options(text: str) -> tuple[str, dict[str, Any]]:
    """The path and the options of "FILE?branch=loading&noise=0.5"; a ? without = after it belongs to the path."""
    path, mark, query = text.rpartition("?")
    if not mark or "=" not in query:
        return text, {}
    options: dict[str, Any] = dict(pair.partition("=")[::2] for pair in query.split("&"))
    if unknown := [name for name in options if name not in TABLE_OPTIONS]:
        raise InputError(f"a table has no option '{unknown[0][:40]}'{suggest(unknown[0], TABLE_OPTIONS)}")
    if "noise" in options:
        try:
            options["noise"] = float(options["noise"])
        except ValueError:
            raise InputError(f"noise = {options['noise'][:40]!r} is not a number") from None
    for name in ("columns", "units"):
        if name in options:
            options[name] = tuple(_whole_number(part.strip()) for part in options[name].split(","))
    if "cycle" in options:
        options["cycle"] = _whole_number(options["cycle"])
    return path, options


def _whole_number(text: str) -> int | str:
    """The number from 0 on in a text, else the text."""
    return int(text) if text.isdecimal() else text


def _nodes_of_table(x: np.ndarray, y: np.ndarray, slope: np.ndarray | None, curvature: np.ndarray | None) -> np.ndarray:
    """Nodes (n, 4) of the interpolant of y (n,) at x (n,): x, y, and these slopes and curvatures, or the ones that
    `table` describes."""
    from scipy.interpolate import CubicSpline  # only a table needs it, and it takes half a second to import

    if slope is None or curvature is None:
        spline, h, rise = CubicSpline(x, y), np.diff(x), np.diff(y)
        slope = _limited_slopes(spline(x, 1), rise / h)
        curvature = _limited_curvatures(spline(x, 2), slope, h, rise)
    return np.column_stack([x, y, slope, curvature])


def _quintic_pieces(nodes: np.ndarray) -> np.ndarray:
    """Rows (start, c0 .. c5), one per interval, of the polynomials of degree 5 between nodes (n, 4)."""
    x, y, slope, curvature = nodes.T
    h, rise = np.diff(x), np.diff(y)
    # The coefficients are written out, since through Bernstein form, as in SciPy, the highest lose three digits.
    d0, d1, s0, s1 = slope[:-1], slope[1:], curvature[:-1], curvature[1:]
    # What is left of value, slope and curvature at the end of a piece beyond those of the parabola at its start: in
    # these the errors of rounding cancel at the end.
    off, tilt, bend = rise - h * (d0 + s0 * h / 2), h * (d1 - d0 - s0 * h), h**2 * (s1 - s0)
    c3 = (10 * off - 4 * tilt + bend / 2) / h**3
    c4 = (-15 * off + 7 * tilt - bend) / h**4
    c5 = (6 * off - 3 * tilt + bend / 2) / h**5
    return np.column_stack([x[:-1], y[:-1], d0, s0 / 2, c3, c4, c5])


def _limited_slopes(slope: np.ndarray, secant: np.ndarray) -> np.ndarray:
    """Slopes (n,) that let the interpolant be monotone between the secants (n - 1,): 0 at an extremum of the rows."""
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
