"""The operations of expressions and of their derivatives, each once, as rows that follow from earlier ones.

Of functions of a state and parameters it is known which rows are affine in the state, and derivatives are made of rows
again: those of a nonlinear function by its affine arguments, and of any row by a parameter.
"""

from collections.abc import Callable, Sequence
from functools import reduce
from math import pi, sqrt
from typing import NamedTuple

import casadi as ca

from .calls import single_assignment

SUMS = (ca.OP_ADD, ca.OP_SUB)
_COMMUTING = (ca.OP_ADD, ca.OP_MUL)
POWERS = (ca.OP_POW, ca.OP_CONSTPOW)
_ON_NUMBERS: dict[int, Callable[..., float]] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_NEG: lambda a: -a,
}


class Row(NamedTuple):
    """One operation of CasADi on the results of earlier rows; of an OP_INPUT the inputs are (which input, which
    element), and an OP_CONST has a `number`."""

    op: int
    inputs: tuple[int, ...]
    number: float | None = None


class Affine(NamedTuple):
    """An affine function of the state and of nonlinear functions of it, whose rows are the factors of each."""

    states: dict[int, int]  # the factors of the states, by element
    functions: dict[int, int]  # the factors of nonlinear functions, by their rows


class Recursion:
    """Rows of operations, each of them once. Those with states as input 0 and parameters as input 1 are separated:
    degrees are 0 without the state, 1 for an affine function of it, and 2 for others."""

    def __init__(self) -> None:
        self.rows: list[Row] = []
        self.degrees: list[int] = []
        self.needs: list[int] = []  # of each row, the parameters that it depends on, as bits
        self.arguments: list[frozenset[int]] = []  # of a nonlinear row, the affine rows that it is a function of
        # The rows that are integrals g' = s a', with the rows of their arguments a and slopes s.
        self.integrals: dict[int, tuple[int, int]] = {}
        self._found: dict[Row, int] = {}
        self._slopes: dict[tuple[int, int], int] = {}

    def graph(self, function: ca.Function) -> list[dict[int, int]]:
        """Add an SX function; return the rows of its results, by output and element, without rows that are 0."""
        places, outputs = list[int](), [dict[int, int]() for _ in range(function.n_out())]
        for op, inputs, number in single_assignment(function):
            if op == ca.OP_OUTPUT:
                outputs[inputs[1]][inputs[2]] = places[inputs[0]]
                places.append(-1)
            elif op == ca.OP_INPUT:
                places.append(self.input(*inputs))
            elif number is not None:
                places.append(self.number(number))
            else:
                places.append(self.add(op, *(places[i] for i in inputs)))
        return [{i: row for i, row in own.items() if not self.is_number(row, 0)} for own in outputs]

    def input(self, which: int, element: int) -> int:
        """The row of an input."""
        return self._new(Row(ca.OP_INPUT, (which, element)))

    def number(self, value: float) -> int:
        """The row of a number."""
        return self._new(Row(ca.OP_CONST, (), float(value)))

    def is_number(self, row: int, value: float) -> bool:
        """Whether a row is this number."""
        return self.rows[row].number == value

    def add(self, op: int, *inputs: int) -> int:
        """The row of an operation on rows."""
        a, b = inputs[0], inputs[-1]
        numbers = [self.rows[i].number for i in inputs]
        if op == ca.OP_ASSIGN:
            return a
        if op in _ON_NUMBERS and None not in numbers:
            return self.number(_ON_NUMBERS[op](*numbers))
        if op == ca.OP_TWICE:
            return self.add(ca.OP_MUL, self.number(2), a)
        if op == ca.OP_SQ:
            return self.add(ca.OP_MUL, a, a)
        if op == ca.OP_INV:
            return self.add(ca.OP_DIV, self.number(1), a)
        if op in (*SUMS, ca.OP_MUL, ca.OP_DIV):
            neutral = float(op in (ca.OP_MUL, ca.OP_DIV))
            if numbers[-1] == neutral:
                return a
            if numbers[0] == neutral and op in _COMMUTING:
                return b
            if op == ca.OP_SUB and numbers[0] == 0:
                return self.add(ca.OP_NEG, b)
            if (op == ca.OP_MUL and 0 in numbers) or (op == ca.OP_DIV and numbers[0] == 0):
                return self.number(0)
        if op in POWERS and self.degrees[b]:
            argument = self.add(ca.OP_MUL, b, self.add(ca.OP_LOG, a))  # before the power, whose series follows from it
            row = self._new(Row(ca.OP_POW, (a, b)))
            self.integrals[row] = argument, row
            return row
        row = self._new(Row(op, tuple(sorted(inputs)) if op in _COMMUTING else inputs))
        if op in _SLOPES and row not in self.integrals:
            self.integrals[row] = a, -1  # so that a sine can ask for the cosine, which asks for the sine
            self.integrals[row] = a, _SLOPES[op](self, a, row)
        return row

    def _new(self, row: Row) -> int:
        """The place of a row."""
        if (found := self._found.get(row)) is None:
            found = self._found[row] = len(self.rows)
            of_state = row.op == ca.OP_INPUT and row.inputs[0] == 0
            inputs = () if row.op == ca.OP_INPUT else row.inputs
            degree = (
                int(of_state) if row.op == ca.OP_INPUT else affine_degree(row.op, [self.degrees[i] for i in inputs])
            )
            needs = 1 << row.inputs[1] if row.op == ca.OP_INPUT and row.inputs[0] == 1 else 0
            self.rows.append(row)
            self.degrees.append(degree)
            self.needs.append(reduce(int.__or__, (self.needs[i] for i in inputs), needs))
            own = (
                self.arguments[i] if self.degrees[i] == 2 else {i} for i in inputs if degree == 2 and self.degrees[i]
            )
            self.arguments.append(frozenset().union(*own))
        return found

    def affine(self, row: int) -> Affine:
        """A row as an affine function of the state and nonlinear functions. A sum, or a multiple by a factor without
        the state, is taken apart; a sum of nonlinear functions of one argument is one function."""
        states, functions = dict[int, int](), dict[int, int]()

        def collect(row: int, factor: int) -> None:
            (op, inputs, _), degree = self.rows[row], self.degrees[row]
            varying = [i for i in inputs if self.degrees[i]] if op != ca.OP_INPUT else []
            if degree == 0:
                return
            if degree == 1 and op == ca.OP_INPUT:
                states[inputs[1]] = self._sum(states.get(inputs[1]), factor)
                return
            linear = affine_degree(op, [min(self.degrees[i], 1) for i in inputs]) == 1
            if degree == 2 and not (linear and (len(varying) == 1 or len(self.arguments[row]) > 1)):
                functions[row] = self._sum(functions.get(row), factor)
            elif op in (*SUMS, ca.OP_NEG):
                negative = self.add(ca.OP_NEG, factor)
                collect(inputs[0], negative if op == ca.OP_NEG else factor)
                if op in SUMS:
                    collect(inputs[1], negative if op == ca.OP_SUB else factor)
            elif op == ca.OP_DIV:
                collect(inputs[0], self.add(ca.OP_DIV, factor, inputs[1]))
            else:
                still = inputs[0] if varying[0] == inputs[1] else inputs[1]
                collect(varying[0], self.add(ca.OP_MUL, factor, still))

        collect(row, self.number(1))
        return Affine(*({i: f for i, f in each.items() if not self.is_number(f, 0)} for each in (states, functions)))

    def _sum(self, total: int | None, row: int) -> int:
        return row if total is None else self.add(ca.OP_ADD, total, row)

    def slope(self, row: int, by: int) -> int:
        """The derivative of a row by another one: by a parameter while the state is held, or by an affine argument of a
        nonlinear row while the parameters and the other arguments are held."""
        if row == by:
            return self.number(1)
        (op, inputs, _), of_parameter = self.rows[row], self.rows[by].op == ca.OP_INPUT and self.degrees[by] == 0
        if op == ca.OP_INPUT or not (self.needs[row] & self.needs[by] if of_parameter else by in self.arguments[row]):
            return self.number(0)
        if (known := self._slopes.get((row, by))) is None:
            known = self._slopes[row, by] = self._slope(row, op, inputs, by)
        return known

    def _slope(self, row: int, op: int, inputs: tuple[int, ...], by: int) -> int:
        add = self.add
        if row in self.integrals:
            argument, slope = self.integrals[row]
            return add(ca.OP_MUL, slope, self.slope(argument, by))
        a, b = inputs[0], inputs[-1]
        da, db = self.slope(a, by), self.slope(b, by)
        if op in SUMS:
            return add(op, da, db)
        if op == ca.OP_NEG:
            return add(op, da)
        if op == ca.OP_MUL:
            return add(ca.OP_ADD, add(op, a, db), add(op, da, b))
        if op == ca.OP_DIV:
            return add(op, add(ca.OP_SUB, da, add(ca.OP_MUL, row, db)), b)
        if op == ca.OP_SQRT:
            return add(ca.OP_DIV, da, add(ca.OP_MUL, self.number(2), row))
        lower = add(op, a, add(ca.OP_SUB, b, self.number(1)))  # of a power
        by_base = add(ca.OP_MUL, add(ca.OP_MUL, b, lower), da)
        if self.is_number(db, 0):
            return by_base
        return add(ca.OP_ADD, by_base, add(ca.OP_MUL, add(ca.OP_MUL, row, add(ca.OP_LOG, a)), db))


def _quotient(r: Recursion, row: int, sign: float = 1.0) -> int:
    return r.add(ca.OP_DIV, r.number(sign), row)


def _one_and(r: Recursion, op: int, row: int) -> int:
    """1 + row or 1 - row."""
    return r.add(op, r.number(1), row)


def _circle(r: Recursion, a: int) -> int:
    """(1 - a) (1 + a), without the cancellation of 1 - a**2."""
    return r.add(ca.OP_MUL, _one_and(r, ca.OP_SUB, a), _one_and(r, ca.OP_ADD, a))


def _hyperbola(r: Recursion, a: int) -> int:
    """(a - 1) (a + 1)."""
    return r.add(ca.OP_MUL, r.add(ca.OP_SUB, a, r.number(1)), r.add(ca.OP_ADD, a, r.number(1)))


def _squared(r: Recursion, a: int) -> int:
    return r.add(ca.OP_MUL, a, a)


# The slopes s of functions g' = s a', from the rows of a and g.
_SLOPES: dict[int, Callable[[Recursion, int, int], int]] = {
    ca.OP_EXP: lambda r, a, g: g,
    ca.OP_EXPM1: lambda r, a, g: _one_and(r, ca.OP_ADD, g),
    ca.OP_LOG: lambda r, a, g: _quotient(r, a),
    ca.OP_LOG1P: lambda r, a, g: _quotient(r, _one_and(r, ca.OP_ADD, a)),
    ca.OP_SIN: lambda r, a, g: r.add(ca.OP_COS, a),
    ca.OP_COS: lambda r, a, g: r.add(ca.OP_NEG, r.add(ca.OP_SIN, a)),
    ca.OP_TAN: lambda r, a, g: _one_and(r, ca.OP_ADD, _squared(r, g)),
    ca.OP_SINH: lambda r, a, g: r.add(ca.OP_COSH, a),
    ca.OP_COSH: lambda r, a, g: r.add(ca.OP_SINH, a),
    ca.OP_TANH: lambda r, a, g: _circle(r, g),
    ca.OP_ASIN: lambda r, a, g: _quotient(r, r.add(ca.OP_SQRT, _circle(r, a))),
    ca.OP_ACOS: lambda r, a, g: _quotient(r, r.add(ca.OP_SQRT, _circle(r, a)), -1.0),
    ca.OP_ATAN: lambda r, a, g: _quotient(r, _one_and(r, ca.OP_ADD, _squared(r, a))),
    ca.OP_ASINH: lambda r, a, g: _quotient(r, r.add(ca.OP_SQRT, _one_and(r, ca.OP_ADD, _squared(r, a)))),
    ca.OP_ACOSH: lambda r, a, g: _quotient(r, r.add(ca.OP_SQRT, _hyperbola(r, a))),
    ca.OP_ATANH: lambda r, a, g: _quotient(r, _circle(r, a)),
    ca.OP_ERF: lambda r, a, g: r.add(
        ca.OP_MUL, r.number(2 / sqrt(pi)), r.add(ca.OP_EXP, r.add(ca.OP_NEG, _squared(r, a)))
    ),
}
_ALGEBRAIC = (*SUMS, ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN, ca.OP_MUL, ca.OP_SQ, ca.OP_DIV, ca.OP_INV, ca.OP_SQRT)
WITH_SERIES = {*_ALGEBRAIC, *POWERS, *_SLOPES, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}


def applied(op: int, inputs: Sequence[ca.SX]) -> ca.SX:
    """The result of an operation of CasADi."""
    return ca.SX.unary(op, inputs[0]) if len(inputs) == 1 else ca.SX.binary(op, *inputs)


def affine_degree(op: int, degrees: Sequence[int]) -> int:
    """The degree of an operation's result as a function of the state, 2 for whatever is not affine."""
    if not any(degrees):
        return 0
    if op in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN):
        return max(degrees)
    by_constant = (op == ca.OP_MUL and 0 in degrees) or (op == ca.OP_DIV and degrees[1] == 0)
    return max(degrees) if by_constant else 2
