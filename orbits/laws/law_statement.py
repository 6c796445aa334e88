"""Laws as users state them: a formula, a potential, a Python function, the name of a law."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import casadi as ca
import numpy as np

from ..errors import InputError
from ..io import in_words
from ..running import exclusive
from ..symbolic import CONSTANTS, parse, suggest, traced
from .casadi_law import CasadiLaw
from .jumps import in_pieces
from .law import Algebraic, Key, Law, Written, number
from .law_expressions import HOW_TO_WRITE, derivative_expression, formula_expression, function_expression

# A law as it is stated: itself, a formula, the name of a law, or a Python function.
LawLike: TypeAlias = Law | str | Callable[..., Algebraic]
# Values of the parameters of a law, and laws by name.
Values = Mapping[str, float] | None
Named = Mapping[str, Callable]
# Names that formulas of a spring may use for the speed of its extension.
SPEEDS = ("v", "vel", "velocity", "speed", "rdot", "r_dot", "dr", "drdt", "dr_dt", "xdot", "x_dot", "dx", "dxdt")
# Distances from 0 at which a formula without a value there is evaluated.
NEAR_ZERO = (1e-2, 1e-3, 1e-4, 1e-5)
# The values of a formula come together towards 0 where those at a tenth of a distance differ by a smaller share.
COMES_TOGETHER = 0.2


def from_any(law: LawLike, variable: str, parameters: Values, table: Named, what: str, shared: bool = True) -> Law:
    """A law from a law, a Python function, the name of one in `table`, a formula or "potential:FORMULA".

    parameters : their values; if they are `shared` with another law, parameters that this law does not have are ignored
    what : "gravity" or "a spring", for the `InputError` that anything else raises
    """

    def own(names):
        if not shared and (unused := sorted((parameters or {}).keys() - set(names))):
            raise InputError(f"this law has no parameter '{unused[0]}'{suggest(unused[0], names)}")
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


def from_formula(text: str, variable: str, parameters: Values = None) -> Law:
    """A law from a formula in its variable; every other name in it is a parameter.

    Raises `InputError` for a parameter without a value and for one that the formula does not use.
    """
    parameters = dict(parameters or {})
    names = parse(text).names - {variable}
    if missing := sorted(names - parameters.keys()):
        if variable == "r" and (speeds := [name for name in missing if name.lower() in SPEEDS]):
            alone = f"'{text[:60]}' uses '{speeds[0]}', but a spring's force depends on the extension r alone"
            raise InputError(f"{alone}: state a force that depends on its speed as damping; give a constant its value")
        raise InputError(f"'{text}' uses {', '.join(map(repr, missing))} without a value: set {missing[0]}=VALUE")
    if unused := sorted(parameters.keys() - names):
        hint = suggest(unused[0], sorted(names)) if names else ""
        raise InputError(f"'{text}' does not use {', '.join(map(repr, unused))}{hint}")
    values = {name: parameters[name] for name in sorted(names)}
    law = Law(text, variable, formula_expression(text, variable), values, written=Written((text,)))
    if part := parse(text).without_value(variable, law.parameters):
        used = parse(part).names & law.parameters.keys()
        given = f" for {', '.join(in_words({name: law.parameters[name] for name in sorted(used)}))}" if used else ""
        raise InputError(f"'{text[:60]}' has no finite value: {part} in it has none{given}")
    values = {name: np.float64(value) for name, value in law.parameters.items()}
    _refuse_removable(law, lambda x: law.expression(x, values, []))
    return in_pieces(law) if parse(text).pieces else law


@exclusive
def from_potential(text: str, variable: str, parameters: Values = None) -> Law:
    """The law whose potential energy is the formula: its derivative with respect to the variable."""
    potential = from_formula(text, variable, parameters)
    force = derivative_expression(formula_expression(text, variable), variable)
    written = Written((text,), potential=True)
    law = replace(potential, text=f"potential:{text}", expression=force, pieces=None, written=written)
    return in_pieces(law) if parse(text).pieces else law


@exclusive
def from_function(function: Callable, variable: str, parameters: Values = None, breakpoints: Sequence = ()) -> Law:
    """A law from a Python function (x, **parameters) written with operators and NumPy or CasADi functions, or from a
    `casadi.Function` (x, parameters), whose names of its arguments are those of the parameters.

    breakpoints : where it is not smooth; integration steps end there, and where a comparison of straight lines says
        that it jumps

    Raises `InputError` for a function that cannot be evaluated with symbols, or that jumps elsewhere without a
    breakpoint, and for a `casadi.Function` that is not a scalar function of scalars in scalar operations, or has
    branches and no breakpoints.
    """
    if isinstance(function, ca.Function):
        function = CasadiLaw(function, parameters or {}, branches=bool(breakpoints))
    name = getattr(function, "__name__", "function")
    if not isinstance(breakpoints, list | tuple):
        raise InputError(f"breakpoints = {breakpoints!r}; they must be a tuple of extensions")
    breaks = [number("breakpoint", b) for b in breakpoints]
    parameters = dict(parameters or {})
    text = None if breakpoints else traced(function, (variable,), tuple(parameters))
    if text is not None and isinstance(function, CasadiLaw):
        return from_formula(text, variable, parameters)
    expression = function_expression(function, variable, tuple(parameters))
    law = Law(name, variable, expression, parameters, written=Written((text,)) if text else None)
    _refuse_removable(law, law)
    if not np.isfinite(law(0.0)):  # float() of a symbol is NaN
        raise InputError(f"the law '{name}' has no finite value at {variable} = 0; {HOW_TO_WRITE}")
    return in_pieces(law, breaks)


def key_of(law: LawLike | Key | float, variable: str, parameters: Values = None) -> Key:
    """The key of a formula, "potential:FORMULA", a number or a Python function, whose parameters need no values yet."""
    if isinstance(law, Key):
        return law
    if callable(law):
        return from_function(law, variable, {name: (parameters or {})[name] for name in _argument_names(law)}).key
    if not isinstance(law, str | float | int):
        raise InputError(f"{law!r} is not a law: it must be a formula of {variable}, a law or a function")
    text = str(law).removeprefix("potential:")
    expression = formula_expression(text, variable)
    if text != law and isinstance(law, str):
        expression = derivative_expression(expression, variable)
    formula, written = parse(text), Written((text,), potential=text != str(law))
    names = tuple(sorted(formula.names - {variable}))
    if formula.pieces:
        values = {name: (parameters or {}).get(name, 1.0) for name in names}  # those of others decide nothing
        return in_pieces(Law(str(law), variable, expression, values, written=written)).key
    return Key(str(law), variable, expression, names, None, written=written)


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


def _argument_names(function: Callable) -> list[str]:
    """Names of the arguments of a function after its first."""
    if isinstance(function, ca.Function):
        return [function.name_in(i) for i in range(1, function.n_in())]
    try:
        return list(inspect.signature(function).parameters)[1:]
    except ValueError:  # a builtin or a NumPy function
        return []
