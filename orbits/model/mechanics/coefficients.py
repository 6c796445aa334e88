"""Numbers that follow from a machine's parameters, and from its configuration where its inertia depends on that."""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ...symbolic.calls import ElementwiseFunction, single_assignment
from ...symbolic.exclusive import LOCK

# Whether a coefficient is the same for all parameters is asked at so many random ones: a rational function that is
# constant at random places is constant (Schwartz 1980, Zippel 1979). Values that differ by less than this many times
# what their roundings explain are the same; a fraction with so small a denominator is then taken for exact.
SAMPLES, ROUNDING_SAFETY, LARGEST_EXACT = 5, 8.0, 1000
PARAMETERS_BETWEEN, COORDINATES_BETWEEN = (0.6, 1.7), (-0.4, 0.5)
UNIT_ROUNDING = float(np.finfo(float).eps)
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
EXPRESSIONS = (ca.SX, ca.MX)


class Coefficients:
    """A matrix of expressions of coordinates and parameters; those that are the same everywhere become numbers.

    analytic : whether also functions made with roots and sines are judged to be the same by random samples
    """

    def __init__(self, matrix: ca.SX, y: ca.SX, p: Mapping[str, ca.SX], analytic: bool = False):
        self.shape, flat = matrix.shape, ca.densify(ca.vec(matrix))
        self.by_coordinates = bool(ca.depends_on(flat, y)) if y.numel() else False
        constants = _constants(ca.Function("all", [y, ca.vertcat(*p.values())], [flat]), analytic)
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


def _constants(function: ca.Function, analytic: bool) -> np.ndarray:
    """The values (k,) of a function (y, p) that are the same everywhere, NaN for the others.

    Each value is computed at random places with a bound of its rounding errors. Only rational functions are taken for
    constant by that, or where `analytic` allows it also those made with roots and trigonometric functions: others, as
    exp(-50 s) or abs(s), may look constant where they are not.
    """
    random, sizes = np.random.default_rng(0), [function.numel_in(i) for i in range(function.n_in())]
    between = COORDINATES_BETWEEN, PARAMETERS_BETWEEN
    inputs = [random.uniform(*ends, (size, SAMPLES)) for ends, size in zip(between, sizes, strict=True)]
    known = {*_ERRORS, *(_SMOOTH if analytic else ())}
    rounded, results = list[_Rounded](), np.full(function.numel_out(0), np.nan)
    with np.errstate(all="ignore"):  # where there is no number there is no constant
        for operation, places, constant in single_assignment(function):
            if operation == ca.OP_OUTPUT:
                results[places[2]] = rounded[places[0]].constant()
                rounded.append(rounded[places[0]])
            elif operation == ca.OP_INPUT:
                rounded.append(_Rounded(inputs[places[0]][places[1]], np.zeros(SAMPLES), True, True))
            elif operation == ca.OP_CONST:
                rounded.append(_Rounded(np.full(SAMPLES, constant), np.zeros(SAMPLES), False, True))
            else:
                rounded.append(_rounded(operation, [rounded[place] for place in places], operation in known))
    return results


class _Rounded(NamedTuple):
    """Values (SAMPLES,) with bounds of their rounding errors; whether they depend on anything, and whether by functions
    that are judged by samples."""

    values: np.ndarray
    errors: np.ndarray
    depends: bool
    judged: bool

    def constant(self) -> float:
        """The number that it is everywhere, NaN where it is none."""
        if not self.depends:
            return float(self.values[0])
        allowed = ROUNDING_SAFETY * self.errors.max()
        if not (self.judged and np.ptp(self.values) <= allowed):
            return np.nan
        middle = float(np.sort(self.values)[SAMPLES // 2])
        exact = float(Fraction(middle).limit_denominator(LARGEST_EXACT))
        return exact if abs(exact - middle) <= allowed else middle


def _rounded(operation: int, parts: list[_Rounded], judged: bool) -> _Rounded:
    """The result of an operation, its error by those of its arguments and its own rounding (Higham 2002, section 3)."""
    a, b = parts[0], parts[-1]
    depends, judged = any(part.depends for part in parts), judged and all(part.judged for part in parts)
    if operation in _ERRORS:
        compute, spread = _ERRORS[operation]
        values = compute(a.values, b.values)
        return _Rounded(values, spread(a, b, values) + UNIT_ROUNDING * np.abs(values), depends, judged)
    if operation in _SMOOTH:
        compute, slope = _SMOOTH[operation]
        values = compute(a.values)
        errors = np.abs(slope(a.values)) * a.errors + 2 * UNIT_ROUNDING * np.abs(values)
        return _Rounded(values, errors, depends, judged)
    symbols = [ca.SX.sym("x") for _ in parts]
    expression = ca.SX.unary(operation, *symbols) if len(parts) == 1 else ca.SX.binary(operation, *symbols)
    evaluated = ca.Function("operation", symbols, [expression])(*(part.values[None] for part in parts))
    return _Rounded(evaluated.full().ravel(), np.full(SAMPLES, np.nan), depends, judged=False)


def _of_sum(a: _Rounded, b: _Rounded, values: np.ndarray) -> np.ndarray:
    return a.errors + b.errors


def _of_product(a: _Rounded, b: _Rounded, values: np.ndarray) -> np.ndarray:
    return np.abs(a.values) * b.errors + np.abs(b.values) * a.errors


def _of_quotient(a: _Rounded, b: _Rounded, values: np.ndarray) -> np.ndarray:
    return (a.errors + np.abs(values) * b.errors) / np.abs(b.values)


def _of_inverse(a: _Rounded, b: _Rounded, values: np.ndarray) -> np.ndarray:
    return values**2 * a.errors


# What each operation of a rational function computes, and the error that those of its arguments make.
_ERRORS: dict[int, tuple[Callable, Callable]] = {
    **{operation: (ARITHMETIC[operation], _of_sum) for operation in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE)},
    **{operation: (ARITHMETIC[operation], _of_product) for operation in (ca.OP_MUL, ca.OP_SQ)},
    ca.OP_DIV: (ARITHMETIC[ca.OP_DIV], _of_quotient),
    ca.OP_INV: (ARITHMETIC[ca.OP_INV], _of_inverse),
}
# Other functions, with their slopes.
_SMOOTH: dict[int, tuple[Callable, Callable]] = {
    ca.OP_SIN: (np.sin, np.cos),
    ca.OP_COS: (np.cos, np.sin),
    ca.OP_TAN: (np.tan, lambda x: 1 / np.cos(x) ** 2),
    ca.OP_SQRT: (np.sqrt, lambda x: 0.5 / np.sqrt(x)),
}
