"""Numbers that follow from a machine's parameters, and from its configuration where its inertia depends on that."""

import operator
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ..symbolic.calls import ElementwiseFunction, Instruction, single_assignment
from ..symbolic.exclusive import LOCK

# A coefficient that is the same at so many random parameters and configurations is a number, to the digits that are
# alike; a rational function that is constant at random places is constant (Schwartz 1980, Zippel 1979).
SAMPLES, SAME, DIGITS = 5, 1e-12, 12
PARAMETERS_BETWEEN, COORDINATES_BETWEEN = (0.6, 1.7), (-0.4, 0.5)
# Short expressions of these operations are evaluated one by one on Python's numbers and NumPy's arrays, since a call of
# a compiled function takes as long as fifty of them.
ARITHMETIC: dict[int, Callable] = {
    ca.OP_ADD: operator.add,
    ca.OP_SUB: operator.sub,
    ca.OP_MUL: operator.mul,
    ca.OP_DIV: operator.truediv,
    ca.OP_NEG: operator.neg,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_INV: lambda x: 1.0 / x,
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
        values = list(self.constants)
        if self.places:
            for place, value in zip(self.places, self._values([p[name] for name in self.names], y), strict=True):
                values[place] = value
        rows, columns = self.shape
        return [[values[i + rows * j] for j in range(columns)] for i in range(rows)]

    def _values(self, p: list[Any], y: Sequence[Any]) -> list[Any]:
        """Those that are not constant."""
        place = list(y) if self.by_coordinates else [0.0] * self.function.numel_in(0)
        if any(isinstance(value, ca.SX | ca.MX) for value in (*p, *place)):
            return ca.vertsplit(self.function(ca.vertcat(*place), ca.vertcat(*p)))
        if self._instructions is not None:
            return _evaluated(self._instructions, (place, p), len(self.places))
        arrays = np.broadcast_arrays(*place, *p, np.zeros(()))[:-1]
        columns, count = [np.ravel(array) for array in arrays], len(place)
        size = max((len(column) for column in columns), default=1)
        (found,) = self._numeric(*(np.reshape(part, (-1, size)).T for part in (columns[:count], columns[count:])))
        return list(found.T) if arrays and arrays[0].ndim else found[0].tolist()

    @cached_property
    def _instructions(self) -> list[Instruction] | None:
        """The operations one after the other, None where there are many or others than those of arithmetic."""
        if self.function.n_instructions() > MOST_OPERATIONS:
            return None
        with LOCK:
            instructions = single_assignment(self.function)
        known = {*ARITHMETIC, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
        return instructions if all(operation in known for operation, *_ in instructions) else None

    @cached_property
    def _numeric(self) -> ElementwiseFunction:
        with LOCK:
            return ElementwiseFunction(self.function)


def _evaluated(instructions: Sequence[Instruction], arguments: Sequence[Sequence[Any]], count: int) -> list[Any]:
    """The results of operations on numbers and arrays."""
    values, results = list[Any](), [0.0] * count
    for operation, places, constant in instructions:
        if operation == ca.OP_INPUT:
            values.append(arguments[places[0]][places[1]])
        elif operation == ca.OP_OUTPUT:
            results[places[2]] = values[places[0]]
            values.append(None)
        elif operation == ca.OP_CONST:
            values.append(constant)
        else:
            values.append(ARITHMETIC[operation](*(values[place] for place in places)))
    return results


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
