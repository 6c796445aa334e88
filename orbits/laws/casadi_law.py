"""Laws that are CasADi functions (x, parameters) -> value, taken apart into scalar operations."""

from collections.abc import Callable, Collection
from functools import cached_property
from typing import Any

import casadi as ca

from ..errors import InputError
from ..symbolic import ARITHMETIC, CONSTANTS, FUNCTION_NAMES, FUNCTIONS, MAX_LENGTH, OPERATIONS, Text, single_assignment

_OPERATION_NAMES = {getattr(ca, name): name.removeprefix("OP_").lower() for name in dir(ca) if name.startswith("OP_")}
_BRANCHING = ("lt", "le", "eq", "ne", "not", "and", "or", "if_else_zero", "floor", "ceil", "fmin", "fmax")
# Operations with kinks and jumps, in addition to those of formulas.
BRANCHES = {op for op, name in _OPERATION_NAMES.items() if name in (*_BRANCHING, "copysign", "fmod", "remainder")}
# Operations that formulas have, on parts of these.
_WRITTEN: dict[int, Callable] = {**ARITHMETIC, ca.OP_ASSIGN: lambda a: a}


class CasadiLaw:
    """A CasADi function of one variable and of parameters by its names of these, called as a Python function is, and
    with parts of formulas.

    values : the names of parameters that have values
    branches : whether it may have kinks and jumps, where breakpoints are stated

    Raises `InputError` for a function that is not one scalar of scalars, has free variables, is not made of scalar
    operations, or has branches that it may not have.
    """

    def __init__(self, function: ca.Function, values: Collection[str], branches: bool = False):
        self.__name__ = function.name()
        own = f"the law '{self.__name__}'"
        self.parameters = [function.name_in(i) for i in range(1, function.n_in())]
        sizes = [function.sparsity_in(i) for i in range(function.n_in())]
        if not sizes or not all(size.is_scalar() and size.is_dense() for size in sizes):
            shapes = ", ".join(f"{function.name_in(i)} {size.dim()}" for i, size in enumerate(sizes))
            raise InputError(
                f"{own} is a function of {shapes or 'nothing'}; its arguments must be numbers, the extension first"
            )
        if function.n_out() != 1 or not function.sparsity_out(0).is_scalar():
            shapes = ", ".join(function.sparsity_out(i).dim() for i in range(function.n_out()))
            raise InputError(f"{own} returns {shapes or 'nothing'}; a law must return one number")
        if not function.nnz_out(0):
            raise InputError(f"{own} returns a result without entries, which is 0 for all arguments")
        if function.has_free():
            raise InputError(
                f"{own} has free variables, {', '.join(map(str, function.get_free()))}: make them arguments"
            )
        if bad := [name for name in self.parameters if name in FUNCTIONS or name in CONSTANTS]:
            raise InputError(f"{own} has an argument '{bad[0]}', which has a meaning in formulas; rename it")
        if missing := [name for name in self.parameters if name not in values]:
            raise InputError(f"{own} needs a value for '{missing[0]}': parameters={{'{missing[0]}': ...}}")
        self.function = self._expanded(function, own)
        operations = {op for op, *_ in self._tape}
        if not branches and (found := sorted(_OPERATION_NAMES[op] for op in operations & BRANCHES)):
            raise InputError(
                f"{own} has branches ({', '.join(found)}): state where it has kinks or jumps, for example by "
                f"springs.function({self.__name__}, breakpoints=(0.5,))"
            )

    @staticmethod
    def _expanded(function: ca.Function, own: str) -> ca.Function:
        """The function in scalar operations."""
        remedy = "state its formula, or a table of its values, springs.table((r, force), noise=0)"
        try:
            expanded = function.expand()
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1][:100]
            raise InputError(f"{own} cannot be written in scalar operations ({reason}): {remedy}") from None
        operations = {expanded.instruction_id(i) for i in range(expanded.n_instructions())}
        if others := sorted(_OPERATION_NAMES[op] for op in operations - OPERATIONS):
            called = ", ".join(function.get_function()) if "call" in others else ""
            what = f"calls {called}" if called else f"has {', '.join(others)}"
            raise InputError(f"{own} {what}, which cannot be written in scalar operations: {remedy}")
        return expanded

    @cached_property
    def _tape(self) -> list:
        return single_assignment(self.function)

    def __call__(self, x: Any, **p: Any) -> Any:
        """The value, of numbers, CasADi's expressions or parts of formulas."""
        arguments = [x, *(p[name] for name in self.parameters)]
        if isinstance(x, Text):
            return self._written(arguments)
        value = self.function(*arguments)
        return float(value) if isinstance(value, ca.DM) and value.numel() == 1 else value

    def _written(self, arguments: list[Text]) -> Text:
        """The formula of these arguments; raises `TypeError` where there is none that is short enough."""
        values: list[Any] = []
        for op, places, constant in self._tape:
            if op == ca.OP_OUTPUT:
                return (
                    values[places[0]] if isinstance(values[places[0]], Text) else 0 * arguments[0] + values[places[0]]
                )
            if op == ca.OP_INPUT:
                values.append(arguments[places[0]])
            elif constant is not None:
                values.append(int(constant) if constant == int(constant) else constant)
            elif op in FUNCTION_NAMES:
                values.append(Text(f"{FUNCTION_NAMES[op]}({values[places[0]].text})"))
            elif op in _WRITTEN:
                values.append(_WRITTEN[op](*(values[place] for place in places)))
            else:
                raise TypeError(f"formulas have no {_OPERATION_NAMES[op]}")
            if len(getattr(values[-1], "text", "")) > MAX_LENGTH:
                raise TypeError("the formula is too long")
        raise AssertionError("a function has a result")
