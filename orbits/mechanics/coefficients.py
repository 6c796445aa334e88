"""Numbers that follow from a machine's parameters, and from its configuration where its inertia depends on that.

They are exact expressions: the numerals of formulas are the decimals that are written, numbers of Python the doubles
that they are. Their structure is decided exactly, never by values (`symbolic.identities`): a coefficient is a number,
or 0, or does not depend on the coordinates, where that is an identity. Rounding comes last, once for each number, so
that nothing is dropped because it is small.
"""

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import isnan, nan

import casadi as ca
import numpy as np

from ..laws import Algebraic, Parameters, Scalars
from ..running import LOCK
from ..symbolic import (
    ElementwiseFunction,
    ExactExpression,
    has_symbols,
    in_order,
    lowered,
    number_of,
    rounded,
    simplified,
    single_assignment,
    symbol,
    without,
)

# Short expressions of these operations, of two arguments or of one that occurs twice, are evaluated step by step on
# Python's numbers and NumPy's arrays, since a call of a compiled function takes as long as fifty of them.
ARITHMETIC: dict[int, Callable] = {
    ca.OP_ADD: operator.add,
    ca.OP_SUB: operator.sub,
    ca.OP_MUL: operator.mul,
    ca.OP_DIV: operator.truediv,
    ca.OP_NEG: lambda x, _: -x,
    ca.OP_SQ: operator.mul,
    ca.OP_TWICE: operator.add,
    ca.OP_INV: lambda x, _: 1.0 / x,
}
MOST_OPERATIONS = 60
EXPRESSIONS = (ca.SX, ca.MX)


class Coefficients:
    """A matrix of expressions of coordinates and parameters; entries that are constant become numbers.

    exact : the rational numbers of the entries, which go down the columns; None for one that depends on something
    constants : the same as doubles, with NaN for an entry that depends on something
    by_coordinates : whether an entry depends on coordinates
    """

    def __init__(self, matrix: Sequence[Sequence[ExactExpression]], place: Sequence[ExactExpression]):
        """The rows of the matrix, and the coordinates; all other symbols are parameters."""
        self.shape, self._place = (len(matrix), len(matrix[0]) if matrix else 0), list(place)
        self._entries = [each for column in zip(*matrix, strict=True) for each in column]

    @cached_property
    def exact(self) -> list[Fraction | None]:
        with LOCK:
            return list(map(number_of, self._entries))

    @cached_property
    def _varying(self) -> dict[int, ExactExpression]:
        """The entries that are not rational numbers, by their places, written without coordinates where that is so."""
        with LOCK:
            left = [(i, each) for i, each in enumerate(self._entries) if self.exact[i] is None]
            return {i: simplified(without(each, self._place) or each) for i, each in left}

    @cached_property
    def constants(self) -> list[float]:
        with LOCK:
            left = {i: nan if has_symbols(each) else _value(each) for i, each in self._varying.items()}
            return [left[i] if value is None else rounded(value) for i, value in enumerate(self.exact)]

    @cached_property
    def places(self) -> list[int]:
        """The places of the entries that depend on something."""
        return [i for i in self._varying if isnan(self.constants[i])]

    @cached_property
    def _written(self) -> list[ExactExpression]:
        return [self._varying[i] for i in self.places]

    @cached_property
    def _used(self) -> set[ExactExpression]:
        """The symbols in the entries."""
        return {each for each in in_order(self._written) if each.kind == "symbol"}

    @cached_property
    def by_coordinates(self) -> bool:
        return not self._used.isdisjoint(self._place)

    @cached_property
    def names(self) -> list[str]:
        """The names of the parameters on which they depend."""
        return sorted(each.value for each in self._used.difference(self._place))

    def __call__(self, p: Parameters, y: Scalars = ()) -> list[list[Algebraic]]:
        """The rows of the matrix at parameters and coordinates that are expressions, numbers, or arrays (m,)."""
        if not self.places:
            return self._numbers
        values = list(self.constants)
        for place, value in zip(self.places, self._values([p[name] for name in self.names], y), strict=True):
            values[place] = value
        return self._matrix(values)

    @cached_property
    def function(self) -> ca.Function:
        """The entries at `places`, of the coordinates and of the parameters `names`."""
        with LOCK:
            place, used = ([ca.SX.sym(each) for each in names] for names in (map(str, self._place), self.names))
            symbols = dict(zip([*self._place, *map(symbol, self.names)], [*place, *used], strict=True))
            entries = ca.cse(ca.vertcat(*lowered(self._written, symbols)))
            return ca.Function("coefficients", [ca.vertcat(*place), ca.vertcat(*used)], [entries])

    def _matrix(self, values: list[Algebraic]) -> list[list[Algebraic]]:
        """The rows of the matrix with these values, which go down its columns."""
        return [values[i :: self.shape[0]] for i in range(self.shape[0])]

    @cached_property
    def _numbers(self) -> list[list[Algebraic]]:
        """The rows of a matrix of numbers."""
        return self._matrix(self.constants)

    def _values(self, p: list[Algebraic], y: Scalars) -> list[Algebraic]:
        """The values of the entries that are not constant."""
        place = list(y) if self.by_coordinates else [0.0] * self.function.numel_in(0)  # nothing depends on them
        for value in (*p, *place):
            if isinstance(value, EXPRESSIONS):
                return ca.vertsplit(self.function(ca.vertcat(*place), ca.vertcat(*p)))
        if self._program:
            return self._program([*place, *p])
        arrays = np.broadcast_arrays(*place, *p, np.zeros(()))[:-1]
        columns, count = [np.ravel(array) for array in arrays], len(place)
        size = max((len(column) for column in columns), default=1)
        (found,) = self._numeric(*(np.reshape(part, (-1, size)).T for part in (columns[:count], columns[count:])))
        return list(found.T) if arrays and arrays[0].ndim else found[0].tolist()

    @cached_property
    def _program(self) -> "Program | None":
        """The operations one after the other, None where there are many, or some are not arithmetic."""
        with LOCK:
            return program_of(self.function) if self.function.n_instructions() <= MOST_OPERATIONS else None

    @cached_property
    def _numeric(self) -> ElementwiseFunction:
        with LOCK:
            return ElementwiseFunction(self.function)


@dataclass(frozen=True)
class Program:
    """Operations on numbers and arrays.

    constants : numbers that follow after the arguments in the list of values
    steps : each operation with the places of its two arguments; its result is added to the list
    results : the places of the results
    """

    constants: tuple[float, ...]
    steps: tuple[tuple[Callable, int, int], ...]
    results: tuple[int, ...]

    def __call__(self, arguments: list[Algebraic]) -> list[Algebraic]:
        values = [*arguments, *self.constants]
        for operation, i, j in self.steps:
            values.append(operation(values[i], values[j]))
        return [values[i] for i in self.results]


def program_of(function: ca.Function) -> Program | None:
    """The operations of a function of vectors with one result; None where some are not arithmetic."""
    instructions = single_assignment(function)
    if not {operation for operation, *_ in instructions} <= {*ARITHMETIC, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}:
        return None
    starts = (0, function.numel_in(0))
    constants = [float(constant) for *_, constant in instructions if constant is not None]
    first = sum(function.numel_in(i) for i in range(function.n_in()))
    position, steps, results, known = (
        list[int](),
        list[tuple[Callable, int, int]](),
        dict[int, int](),
        iter(range(first, first + len(constants))),
    )
    for operation, places, _ in instructions:
        if operation == ca.OP_INPUT:
            position.append(starts[places[0]] + places[1])
        elif operation == ca.OP_CONST:
            position.append(next(known))
        elif operation == ca.OP_OUTPUT:
            results[places[2]] = position[places[0]]
            position.append(-1)
        else:
            i, j = position[places[0]], position[places[-1]]
            position.append(first + len(constants) + len(steps))
            steps.append((ARITHMETIC[operation], i, j))
    return Program(tuple(constants), tuple(steps), tuple(results[i] for i in range(len(results))))


def _value(each: ExactExpression) -> float:
    """The double of an expression without symbols, as sqrt(2)."""
    return float(ca.evalf(lowered([each], {})[0]))
