"""Numbers that follow from a machine's parameters, and from its configuration where its inertia depends on that."""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ..symbolic.calls import ElementwiseFunction, single_assignment
from ..symbolic.exclusive import LOCK

# A coefficient that is the same at so many random parameters and configurations is a number, to the digits that are
# alike; a rational function that is constant at random places is constant (Schwartz 1980, Zippel 1979).
SAMPLES, SAME, DIGITS = 5, 1e-12, 12
PARAMETERS_BETWEEN, COORDINATES_BETWEEN = (0.6, 1.7), (-0.4, 0.5)
# Short expressions of these operations, of two arguments or of one given twice, are evaluated one by one on Python's
# numbers and NumPy's arrays, since a call of a compiled function takes as long as fifty of them.
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


class Coefficients:
    """A matrix of expressions of coordinates and parameters; those that are the same everywhere become numbers."""

    def __init__(self, matrix: ca.SX, y: ca.SX, p: Mapping[str, ca.SX]):
        self.shape, flat = matrix.shape, ca.densify(ca.vec(matrix))
        self.by_coordinates = bool(ca.depends_on(flat, y)) if y.numel() else False
        constants = _constants(ca.Function("all", [y, ca.vertcat(*p.values())], [flat]))
        self.constants = constants.tolist()
        self.places = np.flatnonzero(np.isnan(constants)).tolist()
        self.names = [name for name, symbol in p.items() if ca.depends_on(flat, symbol)]
        used = ca.vertcat(*(p[name] for name in self.names))
        self.function = ca.Function("coefficients", [y, used], [ca.cse(flat[self.places])])

    def __call__(self, p: Mapping[str, Any], y: Sequence[Any] = ()) -> list[list[Any]]:
        """The rows of the matrix at parameters and coordinates that are expressions, numbers, or arrays (m,)."""
        if not self.places:
            return self._numbers
        values = list(self.constants)
        for place, value in zip(self.places, self._values([p[name] for name in self.names], y), strict=True):
            values[place] = value
        return self._matrix(values)

    def _matrix(self, values: list[Any]) -> list[list[Any]]:
        """The rows of the matrix with these values, which go down its columns."""
        return [values[i :: self.shape[0]] for i in range(self.shape[0])]

    @cached_property
    def _numbers(self) -> list[list[Any]]:
        """The rows of a matrix of numbers."""
        return self._matrix(self.constants)

    def _values(self, p: list[Any], y: Sequence[Any]) -> list[Any]:
        """Those that are not constant."""
        place = list(y) if self.by_coordinates else self._nowhere
        for value in (*p, *place):
            if isinstance(value, ca.SX | ca.MX):
                return ca.vertsplit(self.function(ca.vertcat(*place), ca.vertcat(*p)))
        if self._program:
            return self._program([*place, *p])
        arrays = np.broadcast_arrays(*place, *p, np.zeros(()))[:-1]
        columns, count = [np.ravel(array) for array in arrays], len(place)
        size = max((len(column) for column in columns), default=1)
        (found,) = self._numeric(*(np.reshape(part, (-1, size)).T for part in (columns[:count], columns[count:])))
        return list(found.T) if arrays and arrays[0].ndim else found[0].tolist()

    @cached_property
    def _nowhere(self) -> list[float]:
        """Coordinates on which nothing depends."""
        return [0.0] * self.function.numel_in(0)

    @cached_property
    def _program(self) -> "Program | None":
        """The operations one after the other, None where there are many or others than those of arithmetic."""
        with LOCK:
            return program_of(self.function) if self.function.n_instructions() <= MOST_OPERATIONS else None

    @cached_property
    def _numeric(self) -> ElementwiseFunction:
        with LOCK:
            return ElementwiseFunction(self.function)


@dataclass(frozen=True)
class Program:
    """Operations on numbers and arrays.

    constants : that follow after the arguments in the list of values
    steps : each operation with the places of its two arguments; its result is added to the list
    results : their places
    """

    constants: tuple[float, ...]
    steps: tuple[tuple[Callable, int, int], ...]
    results: tuple[int, ...]

    def __call__(self, arguments: list[Any]) -> list[Any]:
        values = [*arguments, *self.constants]
        for operation, i, j in self.steps:
            values.append(operation(values[i], values[j]))
        return [values[i] for i in self.results]


def program_of(function: ca.Function) -> Program | None:
    """The operations of a function of vectors with one result; None where some are no arithmetic."""
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


def _constants(function: ca.Function) -> np.ndarray:
    """The values (k,) of a function (y, p) that are the same everywhere, NaN for the others."""
    random = np.random.default_rng(0)
    samples = [
        function(random.uniform(*COORDINATES_BETWEEN, n), random.uniform(*PARAMETERS_BETWEEN, m)).full().ravel()
        for n, m in [(function.numel_in(0), function.numel_in(1))] * SAMPLES
    ]
    with np.errstate(invalid="ignore"):  # where there is no number there is no constant
        value, spread = samples[0], np.ptp(samples, axis=0)
    rounded = np.round(value, DIGITS)
    value = np.where(np.abs(value - rounded) <= SAME, rounded + 0.0, value)
    return np.where(spread <= SAME * (1 + np.abs(value)), value, np.nan)
