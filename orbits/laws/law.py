"""A law: force against extension, or gravity against height, with its values, slopes and range."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from fractions import Fraction
from functools import cached_property, lru_cache
from numbers import Rational
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, OutOfRange, unit_stated
from ..io import in_words
from ..running import LOCK, exclusive
from ..symbolic import ElementwiseFunction, MappedFunction, cached, has_taylor_series, suggest
from ..units import LENGTH, Message, Quantity
from .law_expressions import UNIT_FORCE, UNIT_LENGTH, Expression, scaled_expression, symbols_of

# Arguments of formulas, in sequences and by name: numbers, arrays (m,) of numbers, or CasADi expressions.
Algebraic: TypeAlias = Any
Scalars: TypeAlias = Sequence[Algebraic]
Parameters: TypeAlias = Mapping[str, Algebraic]
# Value and slope are compared at this share of the pieces on either side of a breakpoint. They jump there if they
# differ by the share `CORNER`.
SIDE = 1e-6
CORNER = 1e-4
# The message about a spring whose force falls as it is stretched from rest.
ONE_SIDED = (
    "it was measured in compression alone, but the spring lifts the foot in tension: measure extensions above 0 too"
)
WRONG_SIGN = "is tension positive? The force must have the sign of the extension, as in k*r"


class Written(NamedTuple):
    """A law as it is written, for a theorem about it.

    formulas : one for each piece, of the variable and the parameters; of a table, that of its scale, of the parameters
    breaks : formulas of where one piece follows the other
    potential : whether the law is the derivative of the formula
    rows : of a table, a function without arguments that returns rows (n, 4): a place, and value, slope and curvature
        there; from each row to the next the law is the polynomial of degree 5 with these at both ends, times the scale
    shift : of a table, the name of a parameter by which the places are moved, or None
    """

    formulas: tuple[str, ...]
    breaks: tuple[str, ...] = ()
    potential: bool = False
    rows: Callable[[], Any] | None = None
    shift: str | None = None


# (derivatives (k, size) of a number by the data of the pieces) -> its standard deviation by the noise of the rows of a
# measured law, None where that is not known; and, where it is not, the deviation for noise of unit deviation.
RowNoise: TypeAlias = Callable[[np.ndarray], tuple[float | None, float | None]]


class LawPieces(NamedTuple):
    """Where a law is smooth.

    size : number of data values of a piece
    table : parameters -> (breaks, data), of the variable times its unit minus its origin
    unit, origin : the names of the parameters that are the unit and the origin; None for 1 and 0
    noise : of a measured law whose rows may be noisy; None for any other
    jumps : whether the law may jump from one piece to the next
    exact : whether the data are exact, as outcomes of comparisons are
    """

    size: int
    table: Callable
    unit: str | None = None
    origin: str | None = None
    noise: RowNoise | None = None
    jumps: bool = False
    exact: bool = False

    def units(self, p: Parameters) -> Algebraic:
        """The unit of the variable."""
        return 1.0 if self.unit is None else p[self.unit]

    def origins(self, p: Parameters) -> Algebraic:
        """The origin of the variable."""
        return 0.0 if self.origin is None else p[self.origin]

    def ends(self, breaks: Algebraic, p: Parameters) -> Algebraic:
        """The values of the variable at breaks."""
        return (breaks + self.origins(p)) / self.units(p)


class Key(NamedTuple):
    """A law without its parameters' values; laws with equal keys share everything that is built from them.

    written : the law as it is written; None for a function that formulas cannot say
    branches : of a spring with hysteresis, the keys of its laws while the extension grows and while it shrinks; this
        key is then that of their mean
    """

    text: str
    variable: str
    expression: Callable
    names: tuple[str, ...]
    pieces: LawPieces | None
    written: Written | None = None
    branches: "tuple[Key, Key] | None" = None

    @lru_cache(maxsize=256)  # noqa: B019 -- equal keys share the result
    def degree(self) -> int:
        """0 for a constant and 1 for a straight line whatever the parameters, 2 for anything else."""
        if self.pieces is not None:
            return 2
        with LOCK:
            x, p = symbols_of(self.variable, self.names)
            value = ca.SX(self.expression(x, p, []))
            if not has_taylor_series(ca.Function("law", [x, *p.values()], [value])):
                return 2  # |x| has the derivatives of a straight line
            return next((order - 1 for order in (1, 2) if not any(ca.which_depends(value, x, order, True))), 2)


@dataclass(frozen=True)
class Law:
    """A function of one variable with named parameters; a call returns its values.

    text : the law as its user wrote it
    variable : "r", an extension, or "z", a height
    expression : (x, p, q) -> value, on CasADi scalars; `p` maps names to parameters, `q` is the data of a smooth piece
    parameters : values of the parameters
    pieces : `LawPieces`, or a tuple of the first of their entries; None for a smooth law
    written : the law in formulas; None where it cannot be written in formulas
    in_si : True for numbers in m and N, False for those of a machine without units, such as a law with the slope 1 at
        rest; None if the machine decides
    loop : for a branch of a measured loop, the function that returns the law of both branches; None for any other law
    """

    text: str
    variable: str
    expression: Callable
    parameters: Mapping[str, float] = field(default_factory=dict)
    pieces: LawPieces | None = None
    written: Written | None = None
    in_si: bool | None = field(default=None, compare=False)
    loop: Callable[[], Any] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        checked = {name: number(name, value) for name, value in self.parameters.items()}
        object.__setattr__(self, "parameters", MappingProxyType(checked))
        object.__setattr__(self, "pieces", self.pieces and LawPieces(*self.pieces))

    def __reduce__(self) -> tuple[type, tuple]:
        own = self.text, self.variable, self.expression, dict(self.parameters), self.pieces, self.written
        return Law, (*own, self.in_si, self.loop)

    @cached_property
    def key(self) -> Key:
        """The law without its parameters' values."""
        return Key(self.text, self.variable, self.expression, tuple(self.parameters), self.pieces, written=self.written)

    def __call__(self, x: ArrayLike) -> np.ndarray:
        """Values at `x` (any shape), NaN where there is none; a table raises `OutOfRange` outside its range."""
        return self.with_slope(x)[0]

    def with_slope(self, x: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Values and derivatives at `x` (any shape)."""
        x = np.asarray(x, dtype=float)
        if x.size == 0:
            return x, x
        p, q = np.array([list(self.parameters.values())]), np.zeros((1, 0))
        with LOCK:
            call, table = _numeric(self.key), pieces_of(self.key)
            if table is not None and self.pieces:
                (breaks,), (data,) = table(p)
                breaks = self.pieces.ends(breaks, self.parameters)
                if not (breaks[0] <= x.min() and x.max() <= breaks[-1]):
                    low, high = (Quantity(float(end), LENGTH) for end in breaks[[0, -1]])
                    text = "{variable} is outside the law's range, [{low:.6g}, {high:.6g}]"
                    raise OutOfRange(Message(text, variable=self.variable, low=low, high=high))
                q = data[np.clip(np.searchsorted(breaks, x.ravel(), "right") - 1, 0, len(breaks) - 2)]
            value, slope = call(x.reshape(-1, 1), p, q)
        return value.reshape(x.shape), slope.reshape(x.shape)

    def range(self) -> tuple[float, float]:
        """The bounds of the variable for which the law is stated; infinite for a formula, even if it is not defined
        everywhere."""
        if self.pieces is None:
            return -np.inf, np.inf
        breaks = self.pieces.table(self.parameters)[0]
        return float(self.pieces.ends(breaks[0], self.parameters)), float(self.pieces.ends(breaks[-1], self.parameters))

    def corners(self) -> list[float]:
        """The values of the variable inside the range at which the slope or the value jumps."""
        if self.pieces is None:
            return []
        breaks = np.unique(np.array(self.pieces.table(self.parameters)[0], dtype=float))
        levels = self.pieces.ends(breaks, self.parameters)
        widths = np.minimum(np.diff(levels)[:-1], np.diff(levels)[1:])
        away, levels = SIDE * np.minimum(widths, 1 + np.abs(levels[1:-1])), levels[1:-1]
        sides = [self.with_slope(levels + side * away) for side in (-1.0, 1.0)]
        below, above = map(np.array, sides)
        (value_jumps, slope_jumps), steepest = np.abs(above - below), np.abs([below[1], above[1]]).max(initial=0.0)
        rises = 2 * away * steepest  # of a continuous value
        return levels[(slope_jumps > CORNER * steepest) | (value_jumps > rises * (1 + CORNER))].tolist()

    def rest(self) -> float:
        """The value of the variable nearest to 0 in the range, where a spring is unloaded."""
        low, high = self.range()
        return min(max(0.0, low), high)

    def with_parameters(self, **values: float) -> "Law":
        """This law with other values of some parameters."""
        for name in values:
            if name not in self.parameters:
                raise InputError(f"'{self.text}' has no parameter '{name}'{suggest(name, self.parameters)}")
        return replace(self, parameters={**self.parameters, **values}) if values else self

    def scaled(self, length: float, force: float | None = None) -> "Law":
        """The law in units of `length` and `force`, which become its parameters; None does not scale the values."""
        expression = scaled_expression(self.expression, force is not None)
        pieces = self.pieces and self.pieces._replace(unit=UNIT_LENGTH)
        units = {UNIT_LENGTH: length} | ({} if force is None else {UNIT_FORCE: force})
        own = {**self.parameters, **units}
        return replace(self, expression=expression, pieces=pieces, parameters=own, written=None, in_si=None, loop=None)

    def continued(self) -> "Law":
        """The law of a finite range with straight lines beyond its ends, of its slopes there."""
        places = np.array(self.range())
        if self.pieces is None or not np.isfinite(places).all():
            return self
        values, slopes = self.with_slope(places)
        lines = tuple(zip(places.tolist(), values.tolist(), slopes.tolist(), strict=True))
        table = _continued_table(self.pieces.table, lines)
        pieces = self.pieces._replace(size=self.pieces.size + 4, table=table, noise=None)
        expression = _continued_expression(self.expression, self.pieces.size)
        return replace(self, expression=expression, pieces=pieces, written=None, in_si=None, loop=None)

    def refuse_units(self, in_si: bool) -> None:
        """Raise `InputError` where a machine, in SI or without units, would take the law's numbers for others."""
        if self.in_si is None or self.in_si == in_si:
            return
        if self.in_si:
            numbers = "is in m and N, but this machine has no units"
            remedy = "state the machine in SI, for example hopper_in_si(body_mass, foot_mass, force=law)"
        else:
            numbers = "has the slope 1 at rest, as in a machine without units, but this machine is in SI"
            remedy = "state its stiffness in N/m (stiffness=8000.0) and its lengths in m"
            remedy += "" if self.pieces else f"; as a formula it is 'stiffness*({self.text})'"
        raise InputError(f"the spring '{self.text}' {numbers}: {remedy}")

    def __repr__(self) -> str:
        return f"Law({', '.join([repr(self.text), *in_words(self.parameters)])})"


@lru_cache(maxsize=64)
def _continued_table(table: Callable, lines: tuple[tuple[float, float, float], ...]) -> Callable:
    """The pieces of a law between two lines through (place, value, slope): after the data of a piece stand those of its
    line, and 1 where the piece is that line."""

    def continued(p: Parameters) -> tuple[list, list]:
        breaks, data = table(p)
        inner = [[*row, 0.0, 0.0, 0.0, 0.0] for row in data]
        low, high = ([*row, *line, 1.0] for row, line in zip((data[0], data[-1]), lines, strict=True))
        return [-math.inf, *breaks, math.inf], [low, *inner, high]

    return Expression(continued, _continued_table, table, lines)


@lru_cache(maxsize=64)
def _continued_expression(expression: Callable, size: int) -> Callable:
    def continued(x: Algebraic, p: Parameters, q: Scalars) -> Algebraic:
        place, value, slope, straight = q[size:]
        return (1 - straight) * expression(x, p, q[:size]) + straight * (value + slope * (x - place))

    return Expression(continued, _continued_expression, expression, size)


def number(name: str, value: Any, low: float = -math.inf, high: float = math.inf) -> float:
    """`value` as a finite float strictly between the bounds; raises `InputError` that names it."""
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} = {str(value)[:40]!r} is not a number{unit_stated(value)}") from None
    if isinstance(value, bool | str):
        raise InputError(f"{name} = {value!r} is not a number")
    if not math.isfinite(result):
        raise InputError(f"{name} = {value!r} is not a finite number")
    exact = type(value) is not float and isinstance(value, Decimal | Rational)
    if exact and Fraction(value) not in (Fraction(result), Fraction(repr(result))):
        remedy = f"round it to {result!r}; prove(..., parameters=...) takes exact decimals"
        raise InputError(f"{name} = {value} has more digits than a machine can use: {remedy}")
    if not low < result < high:
        bounds = f"above {low:g}" if high == math.inf else f"between {low:g} and {high:g}"
        raise InputError(f"{name} = {result:g} is out of bounds; it must lie {bounds}")
    return result


def positive(**values: float) -> dict[str, float]:
    """The values by name, each checked by `number` to be above 0."""
    for name, value in values.items():
        number(name, value, low=0)
    return values


def coefficient_of_restitution(value: object) -> float:
    """`value` as a coefficient of restitution, from 0 to 1; raises `InputError` for another."""
    result = number("restitution", value)
    if not 0 <= result <= 1:
        raise InputError(f"restitution = {result:g} is out of bounds; it must lie between 0 and 1")
    return result


def from_key(key: Key, p: Mapping[str, float]) -> Law:
    """The law of a key with the values that `p` has for its parameters."""
    values = {name: p[name] for name in key.names}
    return Law(key.text, key.variable, key.expression, values, key.pieces, key.written)


def values_and_slopes(key: Key, p: Mapping[str, np.ndarray], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes (m, k) of laws with parameters (m,) by name at places (m, k), NaN outside their ranges."""
    value, slope = evaluated(_many, key, p, x)
    return value, slope


@exclusive
def evaluated(
    function: Callable[[Key], ElementwiseFunction], key: Key, p: Mapping[str, np.ndarray], x: np.ndarray
) -> list[np.ndarray]:
    """Results (m, k) of a function of keys, whose value takes (x, parameters, data of a piece) to numbers, for laws
    with parameters (m,) by name at places (m, k); NaN outside their ranges."""
    columns = [np.broadcast_to(p[name], len(x)) for name in key.names]
    values, data, inside = np.column_stack(columns) if columns else np.zeros((len(x), 0)), np.zeros((1, 0)), None
    if (table := pieces_of(key)) and key.pieces:
        breaks, rows = table(values)
        count, pieces, size = rows.shape
        places = x * np.reshape(key.pieces.units(p), (-1, 1)) - np.reshape(key.pieces.origins(p), (-1, 1))
        if count == 1:
            index = np.searchsorted(breaks[0], places, "right") - 1
        else:
            index = (breaks[:, None] <= places[:, :, None]).sum(2) - 1
        inside = (breaks[:, :1] <= places) & (places <= breaks[:, -1:])
        first = pieces * np.arange(count)[:, None]
        data = rows.reshape(count * pieces, size)[(first + np.clip(index, 0, pieces - 1)).ravel()]
    found = function(key)(x.reshape(-1, 1), np.repeat(values, x.shape[1], axis=0), data)
    results = [each.reshape(x.shape) for each in found]
    return results if inside is None else [np.where(inside, each, np.nan) for each in results]


class PieceTable:
    """The pieces between breakpoints as a function: parameters (m, np) -> breaks (m, k + 1) and data (m, k, nq), for
    m = 1 where they are the same for all.

    p : symbols of the parameters
    breaks, rows : expressions of them, a row of data for each piece; or numbers
    """

    def __init__(self, p: ca.SX, breaks: Sequence[Algebraic], rows: Sequence[Scalars]):
        numbers = {type(each) for row in (breaks, *rows) for each in row} <= {int, float}
        matrix = ca.DM if numbers else lambda table: ca.vertcat(*[ca.horzcat(*row) for row in table])
        data = matrix(rows) if len(rows[0]) else ca.DM(len(rows), 0)
        results = [ca.densify(ca.SX(each)) for each in (matrix([breaks]).T, data)]
        self.function = ca.Function("pieces", [p], results)
        self._call = MappedFunction(self.function)
        self._last: tuple[bytes, tuple[np.ndarray, np.ndarray]] | None = None

    @cached_property
    def parameters(self) -> list[int]:
        """The places of the parameters that breaks or data depend on."""
        patterns = (self.function.jac_sparsity(i, 0) for i in (0, 1))
        return sorted({column for pattern in patterns for column in pattern.get_triplet()[1]})

    def different(self, ps: np.ndarray) -> np.ndarray:
        """The parameters (m, np), for m = 1 where they make the same table."""
        own = ps[:, self.parameters]
        return ps[:1] if (own == own[0]).all() else ps

    def __call__(self, ps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Breaks and data; a single table is stored for the next call with the same parameters."""
        ps = self.different(ps)
        if len(ps) > 1:
            breaks, data = self._call(ps)
            return breaks[:, :, 0], data
        values, last = ps[0, self.parameters].tobytes(), self._last
        if last is None or last[0] != values:
            breaks, data = self._call(ps)
            for each in (breaks, data):
                each.setflags(write=False)
            last = self._last = values, (breaks[:, :, 0], data)
        return last[1]


@cached
def pieces_of(key: Key) -> PieceTable | None:
    """The table of the pieces of a law; None for a smooth one."""
    if key.pieces is None:
        return None
    p = symbols_of(key.variable, key.names)[1]
    return PieceTable(ca.vertcat(*p.values()), *key.pieces.table(p))


@cached
def _many(key: Key) -> ElementwiseFunction:
    """(x, p, q) -> value and slope of a law."""
    x, p = symbols_of(key.variable, key.names)
    q = ca.SX.sym("q", key.pieces.size if key.pieces else 0)
    value = ca.SX(key.expression(x, p, ca.vertsplit(q)))
    arguments = [x, ca.vertcat(*p.values()), q]
    return ElementwiseFunction(ca.Function("laws", arguments, [value, ca.jacobian(value, x)]))


@cached
def _numeric(key: Key) -> MappedFunction:
    """The function (x, p, q) -> (value, slope), which nothing compiles for a few values."""
    return MappedFunction(_many(key).function)
