"""The functions of laws, (x, p, q) -> value on CasADi scalars: of formulas, derivatives and Python functions."""

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any

import casadi as ca

from ..errors import InputError
from ..symbolic import parse

# Parameters of a law in SI that is brought to a dimensionless machine's units.
UNIT_LENGTH, UNIT_FORCE = "unit_length", "unit_force"
HOW_TO_WRITE = "write it with operators and NumPy or CasADi functions, without if or float()"


class Expression:
    """A function of a law that knows the call that makes it, and is pickled as that, since no closure can be pickled.

    made : the cached function that made it and its arguments; expressions made by equal calls are equal
    """

    def __init__(self, function: Callable, *made: Any):
        self.function, self.made, self.hash = function, made, hash(made)

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Expression) and self.made == other.made

    def __hash__(self) -> int:
        return self.hash

    def __reduce__(self) -> tuple[Callable, tuple]:
        return self.made[0], self.made[1:]


def symbols_of(variable: str, names: Iterable[str]) -> tuple[ca.SX, dict[str, ca.SX]]:
    """The symbol of a variable, and those of parameters by name."""
    return ca.SX.sym(variable), {name: ca.SX.sym(name) for name in names}


@lru_cache(maxsize=256)
def formula_expression(text: str, variable: str) -> Callable:
    formula = parse(text)
    names = formula.names - {variable}
    value = lambda x, p, q: formula(**{variable: x}, **{name: p[name] for name in names})  # noqa: E731
    return Expression(value, formula_expression, text, variable)


@lru_cache(maxsize=256)
def derivative_expression(expression: Callable, variable: str) -> Callable:
    def derivative(x, p, q):
        inner = ca.SX.sym(variable)
        slope = ca.jacobian(ca.SX(expression(inner, p, q)), inner)
        return ca.substitute(slope, inner, ca.SX(x))

    return Expression(derivative, derivative_expression, expression, variable)


def function_expression(function: Callable, variable: str, names: tuple[str, ...]) -> Callable:
    """The expression of a Python function, traced again each time, since the variables that it uses may have
    changed."""
    (x, p), name = symbols_of(variable, names), getattr(function, "__name__", "function")
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
def _graph_expression(graph: str, names: tuple[str, ...]) -> Callable:
    """The expression of a serialized graph; equal graphs give the same object, which shares all that is built on it."""
    function = ca.Function.deserialize(graph)
    value = lambda x, p, q: function(x, *(p[name] for name in names))  # noqa: E731
    return Expression(value, _graph_expression, graph, names)


@lru_cache(maxsize=256)
def break_table(breaks: tuple[float, ...]) -> Callable:
    return Expression(lambda p: (breaks, [[] for _ in breaks[1:]]), break_table, breaks)


@lru_cache(maxsize=256)
def scaled_expression(expression: Callable, has_force: bool) -> Callable:
    """The expression of a law in units that are its parameters."""

    def scaled(x, p, q):
        value = expression(p[UNIT_LENGTH] * x, p, q)
        return value / p[UNIT_FORCE] if has_force else value

    return Expression(scaled, scaled_expression, expression, has_force)
