"""Numbers that follow from a machine's parameters, and from its configuration where its inertia depends on that.

Their structure is decided exactly, never by values. Their expressions are quotients of polynomials of symbols,
roots, sines and other functions over the rational numbers (`symbolic.rational`): the numerals of formulas are the
decimals that are written, numbers of Python the doubles that they are. So a coefficient is a number, or 0, or does not
depend on the coordinates, where that is an identity. Rounding comes last, once for each number, so that nothing is
dropped because it is small. An expression that is too long to be worked out counts as one that depends on all that
occurs in it; this costs time and changes no result.
"""

import operator
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cached_property
from math import nan

import casadi as ca
import numpy as np

from ..laws.law import Algebraic, Parameters, Scalars
from ..running.exclusive import LOCK
from ..symbolic.calls import single_assignment
from ..symbolic.folding import exact_numeral
from ..symbolic.formula import CONSTANTS
from ..symbolic.kernels import ElementwiseFunction
from ..symbolic.rational import NormalForms, Normalised, normalised, rounded

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


class Numerals:
    """The numbers of a machine as symbols, so that CasADi does not round while it derives.

    symbols : by the texts of the numbers, see `symbolic.formula.symbolic_numerals`
    """

    def __init__(self) -> None:
        self.symbols: dict[str, ca.SX] = {}
        self._known: tuple[ca.SX, list[ca.SX], list[Fraction]] = (ca.SX(0, 1), [], [])

    def number(self, value: float | Fraction) -> ca.SX:
        """The symbol of a number; 0, 1 and -1 stand for themselves, with which CasADi's arithmetic is exact."""
        if value in (0, 1, -1):
            return ca.SX(float(value))
        text = str(value) if isinstance(value, Fraction) else str(Decimal(value))
        if text.startswith("-"):
            return -self.number(-value)
        return self.symbols.setdefault(text, ca.SX.sym(text))

    def known(self) -> tuple[ca.SX, list[ca.SX], list[Fraction]]:
        """The symbols, as a vector and one by one, and the numbers for which they stand."""
        if len(self.symbols) != len(self._known[1]):
            scalars = list(self.symbols.values())
            self._known = ca.vertcat(*scalars), scalars, [self._value(text) for text in self.symbols]
        return self._known

    @staticmethod
    def _value(text: str) -> Fraction:
        return Fraction(CONSTANTS[text]) if text in CONSTANTS else exact_numeral(text)

    def rounded(self, expression: ca.SX) -> ca.SX:
        """An expression with doubles in place of the symbols."""
        vector, scalars, values = self.known()
        if not scalars:
            return expression
        return ca.substitute(expression, vector, ca.SX(ca.DM([float(each) for each in values])))


class Symbols:
    """The symbols in a machine's expressions.

    place : the coordinates, or those of the contact
    p : the parameters by name
    """

    def __init__(self, place: ca.SX, p: Mapping[str, ca.SX], numerals: Numerals):
        self.place, self.p, self.numerals = place, p, numerals
        self.vectors, self.scalars = [place, ca.vertcat(*p.values())], [*ca.vertsplit(place), *p.values()]
        self.size, self.names = place.numel(), list(p)


class Coefficients:
    """A matrix of expressions of coordinates and parameters; entries that are constant become numbers.

    exact : the rational numbers of the entries, which go down the columns; None for one that depends on something
    constants : the same as doubles, with NaN for an entry that depends on something
    by_coordinates : whether an entry depends on coordinates
    """

    def __init__(self, matrix: ca.SX, symbols: Symbols):
        self.shape = matrix.shape
        found = Entries(matrix, symbols)
        self.exact, self.constants = found.exact, found.constants
        self.places = [i for i, constant in enumerate(self.constants) if constant != constant]
        written, used = [found.written(place) for place in self.places], set[int]()
        used.update(*(variables for _, variables in written))
        self.by_coordinates = any(variable < symbols.size for variable in used)
        self.names = [name for i, name in enumerate(symbols.names, symbols.size) if i in used]
        self._written, self._symbols = [expression for expression, _ in written], symbols

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
            used = ca.vertcat(*(self._symbols.p[name] for name in self.names))
            entries = ca.cse(ca.SX(ca.vertcat(*self._written)))
            return ca.Function("coefficients", [self._symbols.place, used], [entries])

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
        """The operations one after the other, None where there are many, or some are no arithmetic."""
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


class Entries:
    """The entries of a matrix of expressions and their dependencies, decided exactly.

    exact, constants : as in `Coefficients`
    """

    def __init__(self, matrix: ca.SX, symbols: Symbols):
        self.symbols, self.entries = symbols, ca.densify(ca.vec(matrix))
        vector, scalars, values = symbols.numerals.known()
        self.count, function = len(symbols.scalars), ca.Function("entries", [*symbols.vectors, vector], [self.entries])
        exact = dict(enumerate(values, self.count))
        self.found: Normalised = normalised(function, [*symbols.scalars, *scalars], exact)
        self.forms: NormalForms = self.found.forms
        self.exact = [self.forms.constant(each) for each in self.found.results]
        self.constants = [self._rounded(place) for place in range(len(self.exact))]

    @property
    def vanishes(self) -> bool:
        """Whether all entries are 0."""
        return all(each == 0 for each in self.exact)

    @property
    def varies(self) -> bool:
        """Whether an entry depends on coordinates."""
        coordinates = range(self.symbols.size)
        return any(self.forms.without(form, coordinates) is None for form in self.found.results)

    def _rounded(self, place: int) -> float:
        """The double of an entry, NaN where it is no number, or lies outside the range of doubles."""
        value, form = self.exact[place], self.found.results[place]
        if value is None and not self.forms.variables(form):  # a function of numbers, as sqrt(2)
            return float(ca.evalf(self.symbols.numerals.rounded(self.forms.expression(form))))
        try:
            return nan if value is None else rounded(value)
        except OverflowError:
            return nan

    def written(self, place: int) -> tuple[ca.SX, set[int]]:
        """The expression of an entry, and the places of the symbols on which it depends.

        The expression of the normal form is taken where it is no longer than the derived one, or where it alone is free
        of coordinates.
        """
        form, used, rounded = self.found.results[place], self.found.uses[place], self.symbols.numerals.rounded
        free = self.forms.without(form, range(self.symbols.size))
        simplest = form if free is None else free
        varies = any(variable < self.symbols.size for variable in used)
        if self.forms.operations(simplest) <= self.found.sizes[place] or (varies and free is not None):
            with suppress(OverflowError):
                expression, generators = self.forms.expression(simplest), simplest.generators
                if max(generators, default=0) < self.count:  # of symbols alone
                    return expression, generators
                # The arguments of functions stand as they were derived, with numerals and with all that cancels.
                expression, symbols = rounded(expression), enumerate(self.symbols.scalars)
                return expression, {i for i, symbol in symbols if ca.depends_on(expression, symbol)}
        return rounded(self.entries[place]), used
