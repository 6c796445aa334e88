"""A law: force against extension, or gravity against height, from a formula, a function, a potential or a table."""

import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
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

from ..errors import InputError, OutOfRange
from ..io import in_words
from ..running.exclusive import LOCK, exclusive
from ..symbolic.caches import cached
from ..symbolic.calls import MappedFunction
from ..symbolic.formula import CONSTANTS, parse, suggest
from ..symbolic.kernels import ElementwiseFunction
from ..symbolic.taylor_series import has_taylor_series
from ..symbolic.tracing import traced
from ..units import LENGTH, Message, Quantity

# Arguments of formulas, in sequences and by name: numbers, arrays (m,) of numbers, or CasADi expressions.
Algebraic: TypeAlias = Any
Scalars: TypeAlias = Sequence[Algebraic]
Parameters: TypeAlias = Mapping[str, Algebraic]
# Values of the parameters of a law, and laws by name.
Values = Mapping[str, float] | None
Named = Mapping[str, Callable]
# Parameters whose names begin so are 0 on every machine; each stands for a change of a measured law by one standard
# deviation of the effect of noise on it, independently of the others.
NOISE = "_noise"
# Parameters of a law in SI that is brought to a dimensionless machine's units.
UNIT_LENGTH, UNIT_FORCE = "unit_length", "unit_force"
# Names that formulas of a spring may use for the speed of its extension.
SPEEDS = ("v", "vel", "velocity", "speed", "rdot", "r_dot", "dr", "drdt", "dr_dt", "xdot", "x_dot", "dx", "dxdt")
# The message about a spring whose force falls as it is stretched from rest.
WRONG_SIGN = "is tension positive? A force acts against the extension, as in k*r, and the sign is that of r"
# Distances from 0 at which a formula without a value there is evaluated. Its values come together where those at a
# tenth of a distance differ by less than this share.
NEAR_ZERO, COMES_TOGETHER = (1e-2, 1e-3, 1e-4, 1e-5), 0.2
HOW_TO_WRITE = "write it with operators and NumPy or CasADi functions, without if or float()"


class Expression:
    """A function of a law that knows the call that makes it, and is pickled as that, since no closure can be pickled.

    made : the cached function that made it and its arguments; expressions made by equal calls are equal
    """

    def __init__(self, function: Callable, *made: Any):
        self.function, self.made, self.hash = function, made, hash(made)

    def __call__(self, *arguments: Algebraic) -> Algebraic:
        return self.function(*arguments)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Expression) and self.made == other.made

    def __hash__(self) -> int:
        return self.hash

    def __reduce__(self) -> tuple[Callable, tuple]:
        return self.made[0], self.made[1:]


class Written(NamedTuple):
    """A law as it is written, for a theorem about it.

    formulas : one for each piece, of the variable and the parameters
    breaks : formulas of where one piece follows the other
    potential : whether the law is the derivative of the formula
    """

    formulas: tuple[str, ...]
    breaks: tuple[str, ...] = ()
    potential: bool = False


class Key(NamedTuple):
    """A law without its parameters' values; laws with equal keys share everything that is built from them.

    written : the law as it is written; None for a table, and for a function that formulas cannot say
    reach : how far an integration step may go along the variable, see `features.reach`
    """

    text: str
    variable: str
    expression: Callable
    names: tuple[str, ...]
    pieces: tuple[int, Callable] | None
    reach: float = math.inf
    written: Written | None = None

    @lru_cache(maxsize=256)  # noqa: B019 -- equal keys share the result
    def degree(self) -> int:
        """0 for a constant and 1 for a straight line whatever the parameters, 2 for anything else."""
        if self.pieces is not None:
            return 2
        with LOCK:
            x, p = _symbols(self.variable, self.names)
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
    pieces : (size of q, parameters -> (breaks, data)) for a piecewise law, None for a smooth one
    written : the law in formulas; None where it cannot be written in formulas
    """

    text: str
    variable: str
    expression: Callable
    parameters: Mapping[str, float] = field(default_factory=dict)
    pieces: tuple[int, Callable] | None = None
    written: Written | None = None

    def __post_init__(self) -> None:
        checked = {name: number(name, value) for name, value in self.parameters.items()}
        object.__setattr__(self, "parameters", MappingProxyType(checked))

    def __reduce__(self) -> tuple[type, tuple]:
        return Law, (self.text, self.variable, self.expression, dict(self.parameters), self.pieces, self.written)

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
            call, table = _numeric(self.key)
            if table is not None:
                breaks, data = (np.array(out) for out in table(p[0]))
                breaks = breaks.ravel()
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
        breaks = self.pieces[1](self.parameters)[0]
        return float(breaks[0]), float(breaks[-1])

    def rest(self) -> float:
        """The value of the variable nearest to 0 in the range, where a spring is unloaded."""
        low, high = self.range()
        return min(max(0.0, low), high)

    def with_parameters(self, **values: float) -> "Law":
        """The same law with other values of some parameters."""
        for name in values:
            if name not in self.parameters:
                raise InputError(f"'{self.text}' has no parameter '{name}'{suggest(name, stated(self.parameters))}")
        return replace(self, parameters={**self.parameters, **values}) if values else self

    def scaled(self, length: float, force: float | None = None) -> "Law":
        """The law in units of `length` and `force`, which become its parameters; None does not scale the values."""
        expression = _scaled(self.expression, force is not None)
        pieces = self.pieces and (self.pieces[0], _scaled_table(self.pieces[1]))
        units = {UNIT_LENGTH: length} | ({} if force is None else {UNIT_FORCE: force})
        return replace(
            self, expression=expression, pieces=pieces, parameters={**self.parameters, **units}, written=None
        )

    def __repr__(self) -> str:
        named = {name: self.parameters[name] for name in stated(self.parameters)}
        return f"Law({', '.join([repr(self.text), *in_words(named)])})"


# A law as it is stated: itself, a formula, the name of a law, or a Python function.
LawLike: TypeAlias = Law | str | Callable[..., Algebraic]


def from_formula(text: str, variable: str, parameters: Values = None) -> Law:
    """A law from a formula in its variable; every other name in it is a parameter.

    Raises `InputError` for a parameter without a value and for one that the formula does not use.
    """
    parameters = dict(parameters or {})
    names = parse(text).names - {variable}
    if missing := sorted(names - parameters.keys()):
        if variable == "r" and (speeds := [name for name in missing if name.lower() in SPEEDS]):
            alone = f"'{text[:60]}' uses '{speeds[0]}', but a spring's force depends on the extension r alone"
            raise InputError(f"{alone}: for a force of its speed give damping; a constant needs its value")
        raise InputError(f"'{text}' uses {', '.join(map(repr, missing))} without a value: set {missing[0]}=VALUE")
    if unused := sorted(parameters.keys() - names):
        hint = suggest(unused[0], sorted(names)) if names else ""
        raise InputError(f"'{text}' does not use {', '.join(map(repr, unused))}{hint}")
    values = {name: parameters[name] for name in sorted(names)}
    law = Law(text, variable, _formula_expression(text, variable), values, written=Written((text,)))
    values = {name: np.float64(value) for name, value in law.parameters.items()}
    _refuse_removable(law, lambda x: law.expression(x, values, []))
    return law


def key_of(law: LawLike | Key | float, variable: str, parameters: Values = None) -> Key:
    """The key of a formula, "potential:FORMULA", a number or a Python function, whose parameters need no values yet."""
    if isinstance(law, Key):
        return law
    if callable(law):
        return from_function(law, variable, {name: (parameters or {})[name] for name in _argument_names(law)}).key
    if not isinstance(law, str | float | int):
        raise InputError(f"{law!r} is no law: it is a formula of {variable}, a law or a function")
    text = str(law).removeprefix("potential:")
    expression = _formula_expression(text, variable)
    if text != law and isinstance(law, str):
        expression = _derivative_expression(expression, variable)
    names = tuple(sorted(parse(text).names - {variable}))
    return Key(str(law), variable, expression, names, None, written=Written((text,), potential=text != str(law)))


def _refuse_removable(law: Law, force: Callable) -> None:
    """Raise `InputError` for a law that is 0/0 at 0 but has a limit there: near 0 its `force` loses all its digits."""
    h = np.array(NEAR_ZERO)
    with np.errstate(all="ignore"):
        if not np.isnan(force(np.float64(0.0))):
            return
        up, down, further = (force(x) for x in (h, -h, 2 * h))
        apart = np.maximum(abs(up - down), abs(up - further))
        together = np.flatnonzero(apart[1:] <= COMES_TOGETHER * apart[:-1])
    if together.size:
        limit = f"its limit there is about {(up + down)[together[-1] + 1] / 2:.3g}, but near it digits are lost"
        table = ", or as a table of its values, springs.table((r, force), noise=0)" if law.variable == "r" else ""
        remedy = f"write it without that division{table}"
        raise InputError(f"'{law.text[:60]}' is 0/0 at {law.variable} = 0; {limit}: {remedy}")


def stated(names: Iterable[str]) -> list[str]:
    """The names of parameters that users state: not those that stand for the noise of a table."""
    return [name for name in names if not name.startswith(NOISE)]


@exclusive
def from_potential(text: str, variable: str, parameters: Values = None) -> Law:
    """The law whose potential energy is the formula: its derivative with respect to the variable."""
    potential = from_formula(text, variable, parameters)
    force = _derivative_expression(potential.expression, variable)
    written = Written((text,), potential=True)
    return replace(potential, text=f"potential:{text}", expression=force, written=written)


@exclusive
def from_function(function: Callable, variable: str, parameters: Values = None, breakpoints: Sequence = ()) -> Law:
    """A law from a Python function (x, **parameters) written with operators and NumPy or CasADi functions.

    breakpoints : where it is not smooth; integration steps end there

    Raises `InputError` for a function that cannot be evaluated with symbols.
    """
    name = getattr(function, "__name__", "function")
    if not isinstance(breakpoints, list | tuple):
        raise InputError(f"breakpoints = {breakpoints!r}; they are a tuple of extensions")
    breaks = [-math.inf, *sorted(number("breakpoint", b) for b in breakpoints), math.inf]
    table = (0, _break_table(tuple(breaks))) if breakpoints else None
    parameters = dict(parameters or {})
    text = None if breakpoints else traced(function, (variable,), tuple(parameters))
    expression = _function_expression(function, variable, tuple(parameters))
    law = Law(name, variable, expression, parameters, table, Written((text,)) if text else None)
    _refuse_removable(law, law)
    if not np.isfinite(law(0.0)):  # float() of a symbol is NaN
        raise InputError(f"the law '{name}' has no finite value at {variable} = 0; {HOW_TO_WRITE}")
    return law


def from_any(law: LawLike, variable: str, parameters: Values, table: Named, what: str, shared: bool = True) -> Law:
    """A law from a law, a Python function, the name of one in `table`, a formula or "potential:FORMULA".

    parameters : their values; if they are `shared` with another law, those that this law does not have are ignored
    what : "gravity" or "a spring", for the `InputError` that anything else raises
    """

    def own(names):
        if not shared and (unused := sorted((parameters or {}).keys() - set(names))):
            raise InputError(f"this law has no parameter '{unused[0]}'{suggest(unused[0], stated(names))}")
        return {name: value for name, value in (parameters or {}).items() if name in names}

    if isinstance(law, Law):
        if law.variable != variable:
            raise InputError(f"'{law.text}' is a law of {law.variable}, not {what}")
        return law.with_parameters(**own(law.parameters))
    if callable(law):
        return from_function(law, variable, own(_argument_names(law)))
    if not isinstance(law, str):
        raise InputError(f"{what} is a law, a formula or a function, not {type(law).__name__}")
    key = law.replace("-", "_")  # hyphens may stand for underscores
    if key in table:
        return table[key](**own(table[key].__kwdefaults__ or {}))
    if law.isidentifier() and law != variable and law not in CONSTANTS:  # a lone name is a law's, and no formula
        raise InputError(f"unknown law '{law}'{suggest(law, table)}")
    text = law.removeprefix("potential:")
    return (from_formula if text == law else from_potential)(text, variable, own(parse(text).names - {variable}))


def _argument_names(function: Callable) -> list[str]:
    """Names of the arguments of a Python function after its first."""
    try:
        return list(inspect.signature(function).parameters)[1:]
    except ValueError:  # a builtin or a NumPy function
        return []


def number(name: str, value: Any, low: float = -math.inf, high: float = math.inf) -> float:
    """`value` as a finite float strictly between the bounds; raises `InputError` that names it."""
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} = {str(value)[:40]!r} is not a number that can be computed with") from None
    if isinstance(value, bool | str):
        raise InputError(f"{name} = {value!r} is not a number")
    if not math.isfinite(result):
        raise InputError(f"{name} = {value!r} is not a finite number")
    exact = type(value) is not float and isinstance(value, Decimal | Rational)
    if exact and Fraction(value) not in (Fraction(result), Fraction(repr(result))):
        remedy = f"round it, as {result!r}; prove(..., parameters=...) takes exact decimals"
        raise InputError(f"{name} = {value} has more digits than a number of a machine: {remedy}")
    if not low < result < high:
        bounds = f"above {low:g}" if high == math.inf else f"between {low:g} and {high:g}"
        raise InputError(f"{name} = {result:g} is out of bounds; it lies {bounds}")
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
        raise InputError(f"restitution = {result:g} is out of bounds; it lies between 0 and 1")
    return result


def _symbols(variable: str, names) -> tuple[ca.SX, dict[str, ca.SX]]:
    return ca.SX.sym(variable), {name: ca.SX.sym(name) for name in names}


def from_key(key: Key, p: Mapping[str, float]) -> Law:
    """The law of a key with the values that `p` has for its parameters."""
    values = {name: p[name] for name in key.names}
    return Law(key.text, key.variable, key.expression, values, key.pieces, key.written)


@exclusive
def values_and_slopes(key: Key, p: Mapping[str, np.ndarray], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes (m, k) of smooth laws with parameters (m,) by name at places (m, k)."""
    columns = [np.broadcast_to(p[name], len(x)) for name in key.names]
    values = np.column_stack(columns) if columns else np.zeros((len(x), 0))
    value, slope = _many(key)(x.reshape(-1, 1), np.repeat(values, x.shape[1], axis=0))
    return value.reshape(x.shape), slope.reshape(x.shape)


@cached
def _many(key: Key) -> ElementwiseFunction:
    """(x, p) -> value and slope of a smooth law."""
    x, p = _symbols(key.variable, key.names)
    value = ca.SX(key.expression(x, p, []))
    return ElementwiseFunction(ca.Function("laws", [x, ca.vertcat(*p.values())], [value, ca.jacobian(value, x)]))


@cached
def _numeric(key: Key):
    """The function (x, p, q) -> (value, slope), and p -> (breaks, data) for a piecewise law."""
    (x, p), pieces = _symbols(key.variable, key.names), key.pieces
    q = ca.SX.sym("q", pieces[0] if pieces else 0)
    value = ca.SX(key.expression(x, p, ca.vertsplit(q)))
    vector = ca.vertcat(*p.values())
    table = None
    if pieces:
        breaks, data = pieces[1](p)
        rows = ca.vertcat(*[ca.horzcat(*row) for row in data]) if pieces[0] else ca.SX(len(data), 0)
        table = ca.Function("table", [vector], [ca.vertcat(*breaks), ca.densify(rows)])
    results = [ca.densify(value), ca.densify(ca.jacobian(value, x))]
    return MappedFunction(ca.Function("law", [x, vector, q], results)), table


@lru_cache(maxsize=256)
def _formula_expression(text: str, variable: str) -> Callable:
    formula = parse(text)
    names = formula.names - {variable}
    value = lambda x, p, q: formula(**{variable: x}, **{name: p[name] for name in names})  # noqa: E731
    return Expression(value, _formula_expression, text, variable)


@lru_cache(maxsize=256)
def _derivative_expression(expression: Callable, variable: str) -> Callable:
    def derivative(x, p, q):
        inner = ca.SX.sym(variable)
        slope = ca.jacobian(ca.SX(expression(inner, p, q)), inner)
        return ca.substitute(slope, inner, ca.SX(x))

    return Expression(derivative, _derivative_expression, expression, variable)


def _function_expression(function: Callable, variable: str, names: tuple[str, ...]) -> Callable:
    """The expression of a Python function, traced anew each time, since the variables that it uses may have changed."""
    (x, p), name = _symbols(variable, names), getattr(function, "__name__", "function")
    mode = ca.GlobalOptions.getNumpyMode() if hasattr(ca.GlobalOptions, "getNumpyMode") else None
    try:
        if mode is not None:
            ca.GlobalOptions.setNumpyMode(1)  # NumPy's functions then give CasADi expressions, without a warning
        value = ca.SX(function(x, **p))
    except Exception as error:
        message = " ".join(str(error).split())[:80]
        kind = type(error).__name__ + (f": {message}" if message else "")
        raise InputError(f"the law '{name}' fails on a symbolic argument ({kind}); {HOW_TO_WRITE}") from error
    finally:
        if mode is not None:
            ca.GlobalOptions.setNumpyMode(mode)
    if value.numel() != 1:
        raise InputError(f"the law '{name}' returns {value.numel()} values, not 1")
    return _graph_expression(ca.Function("law", [x, *p.values()], [value]).serialize(), names)


@lru_cache(maxsize=256)
def _break_table(breaks: tuple[float, ...]) -> Callable:
    return Expression(lambda p: (breaks, [[] for _ in breaks[1:]]), _break_table, breaks)


@lru_cache(maxsize=256)
def _graph_expression(graph: str, names: tuple[str, ...]) -> Callable:
    """The expression of a serialized graph; equal graphs give the same object, which shares all that is built on it."""
    function = ca.Function.deserialize(graph)
    value = lambda x, p, q: function(x, *(p[name] for name in names))  # noqa: E731
    return Expression(value, _graph_expression, graph, names)


@lru_cache(maxsize=256)
def _scaled(expression: Callable, has_force: bool) -> Callable:
    """The expression of a law in units that are its parameters."""

    def scaled(x, p, q):
        value = expression(p[UNIT_LENGTH] * x, p, q)
        return value / p[UNIT_FORCE] if has_force else value

    return Expression(scaled, _scaled, expression, has_force)


@lru_cache(maxsize=256)
def _scaled_table(table: Callable) -> Callable:
    """The pieces of a law in a unit of length that is its parameter."""

    def scaled(p):
        breaks, data = table(p)
        return [b / p[UNIT_LENGTH] for b in breaks], data

    return Expression(scaled, _scaled_table, table)
