"""Taylor series of the solutions of x' = f(x, p), by one recurrence for each operation of f.

`Recursion` holds the operations of expressions and of their derivatives, each once. `Series` finds the coefficients of
all of them, one order after the other, by the classical recurrences for products, quotients, powers and integrals
(Jorba and Zou, "A software package for the numerical integration of ODEs by means of high-order Taylor methods", Exp.
Math. 14, 2005), at a cost that grows with the square of the order. It writes them by a `SeriesCode`: as an expression
graph of CasADi here (`GraphCode`), or as loops in machine code.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial, reduce
from math import pi, sqrt
from typing import Any, NamedTuple, Protocol

import casadi as ca

from .calls import single_assignment

# The operators of `ca.SX` first try to read their operands as NumPy arrays, which takes ten times as long as these.
_plus, _times = (partial(ca.SX.binary, op) for op in (ca.OP_ADD, ca.OP_MUL))
_ZERO = ca.SX(0)
_slice = cache(ca.Slice)
# From this many products on, their sum takes less time as a product of columns.
_MANY = 7

_SUMS = (ca.OP_ADD, ca.OP_SUB)
_COMMUTING = (ca.OP_ADD, ca.OP_MUL)
_POWERS = (ca.OP_POW, ca.OP_CONSTPOW)
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
        """Add an SX function; return the rows of its results, by output and element, without those that are 0."""
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
        if op in (*_SUMS, ca.OP_MUL, ca.OP_DIV):
            neutral = float(op in (ca.OP_MUL, ca.OP_DIV))
            if numbers[-1] == neutral:
                return a
            if numbers[0] == neutral and op in _COMMUTING:
                return b
            if op == ca.OP_SUB and numbers[0] == 0:
                return self.add(ca.OP_NEG, b)
            if (op == ca.OP_MUL and 0 in numbers) or (op == ca.OP_DIV and numbers[0] == 0):
                return self.number(0)
        if op in _POWERS and self.degrees[b]:
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
            elif op in (*_SUMS, ca.OP_NEG):
                negative = self.add(ca.OP_NEG, factor)
                collect(inputs[0], negative if op == ca.OP_NEG else factor)
                if op in _SUMS:
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
        if op in _SUMS:
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
_ALGEBRAIC = (*_SUMS, ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN, ca.OP_MUL, ca.OP_SQ, ca.OP_DIV, ca.OP_INV, ca.OP_SQRT)
_WITH_SERIES = {*_ALGEBRAIC, *_POWERS, *_SLOPES, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}


class SeriesCode(Protocol):
    """Writes the operations of series. Values are its own; a series is what `series` returns, and orders k are whole
    numbers, or their names in the code."""

    def number(self, value: float) -> Any:
        """A number as a value."""

    def operation(self, op: int, values: Sequence[Any]) -> Any:
        """An operation of CasADi on one value or two."""

    def series(self) -> Any:
        """A new series."""

    def get(self, series: Any, k: Any) -> Any:
        """Coefficient k of a series."""

    def put(self, series: Any, k: Any, value: Any) -> None:
        """Set coefficient k of a series."""

    def orders(self, first: int, last: int, body: Callable[[Any], None]) -> None:
        """Do what `body` writes of one order for all orders from `first` to `last`."""

    def shifted(self, k: Any, by: int) -> Any:
        """The order k + by."""

    def over(self, k: Any) -> Any:
        """The value 1 / k."""

    def times_order(self, value: Any, k: Any) -> Any:
        """A value times k."""

    def convolved(self, pairs: Sequence[tuple[Any, Any]], low: int, high: Any, k: Any) -> list[Any]:
        """The sums of a[j] b[k - j] for low <= j <= high, of pairs of series a and b."""

    def squared(self, series: Any, k: Any) -> Any:
        """The sum of a[j] a[k - j] for 0 <= j <= k."""


class Series:
    """The series of the rows of a recursion that some rows `wanted` need, beside those of the `states`, which the
    caller fills.

    values : of each row its first coefficient
    stored : the series by row, of the states, of rows that are `kept`, and of those that sums of products read
    """

    def __init__(
        self, code: SeriesCode, recursion: Recursion, states: Sequence[Any], wanted: Sequence[int],
        kept: Sequence[int] = (),
    ):  # fmt: skip
        self.code, self.recursion = code, recursion
        self.values, self.stored, self.multiples = dict[int, Any](), dict[int, Any](), dict[int, Any]()
        self.needed = self._needed((*wanted, *kept))
        self.moving = [row for row in self.needed if recursion.degrees[row]]
        rows, stores = recursion.rows, {row for row in kept if recursion.degrees[row]}
        for row in self.moving:
            op, inputs, _ = rows[row]
            if row in recursion.integrals:
                argument, slope = recursion.integrals[row]
                self.multiples.setdefault(argument, None)
                stores |= {slope} if recursion.degrees[slope] else set()
            elif op == ca.OP_MUL and all(recursion.degrees[i] for i in inputs):
                stores |= {*inputs}
            elif op == ca.OP_DIV and recursion.degrees[inputs[1]]:
                stores |= {row, inputs[1]}
            elif op == ca.OP_SQRT:
                stores.add(row)
            elif op in _POWERS:
                self.multiples.setdefault(inputs[0], None)
                stores |= {row, inputs[0]}
        inputs_of = {row: rows[row].inputs for row in self.moving if rows[row].op == ca.OP_INPUT}
        self.stored = {row: states[places[1]] for row, places in inputs_of.items()}
        self.stored |= {row: code.series() for row in sorted(stores - self.stored.keys())}
        self.multiples = {row: code.series() for row in self.multiples}

    def _needed(self, wanted: Sequence[int]) -> list[int]:
        """All rows that these need, each after those that its first coefficient needs."""
        found, left = set[int](), [*wanted]
        while left:
            row = left.pop()
            if row not in found:
                found.add(row)
                own = self.recursion.rows[row]
                left += own.inputs if own.op != ca.OP_INPUT else ()
                left += self.recursion.integrals.get(row, ()) if self.recursion.degrees[row] else ()
        return sorted(found)

    def begin(self, inputs: Sequence[Sequence[Any]]) -> None:
        """Write the first coefficients of all rows, from those of the inputs."""
        for row in self.needed:
            op, places, number = self.recursion.rows[row]
            if op == ca.OP_INPUT:
                value = inputs[places[0]][places[1]]
            elif number is not None:
                value = self.code.number(number)
            else:
                value = self.code.operation(op, [self.values[i] for i in places])
            self.values[row] = value
            if row in self.stored and op != ca.OP_INPUT:
                self.code.put(self.stored[row], 0, value)
            if row in self.multiples:
                self.code.put(self.multiples[row], 0, self.code.number(0))

    def advance(self, k: Any, inputs: Sequence[Any]) -> dict[int, Any]:
        """Write coefficient k >= 1 of all rows that move, from those of the states `inputs`; return them by row."""
        code, now = self.code, dict[int, Any]()
        for row in self.moving:
            op, places, _ = self.recursion.rows[row]
            now[row] = inputs[places[1]] if op == ca.OP_INPUT else self._coefficient(row, op, places, now, k)
            if row in self.stored and op != ca.OP_INPUT:
                code.put(self.stored[row], k, now[row])
            if row in self.multiples:
                code.put(self.multiples[row], k, code.times_order(now[row], k))
        return now

    def _coefficient(self, row: int, op: int, places: tuple[int, ...], now: dict[int, Any], k: Any) -> Any:
        """Coefficient k of an operation on rows."""
        code, values, stored = self.code, self.values, self.stored
        if row in self.recursion.integrals:
            argument, slope = self.recursion.integrals[row]
            if not self.recursion.degrees[slope]:
                return code.operation(ca.OP_MUL, [values[slope], now[argument]])
            (total,) = code.convolved([(self.multiples[argument], stored[slope])], 1, k, k)
            return code.operation(ca.OP_MUL, [total, code.over(k)])
        a, b = places[0], places[-1]
        if op == ca.OP_NEG:
            return code.operation(op, [now[a]])
        if op in _SUMS:
            if b not in now:
                return now[a]
            if a not in now:
                return now[b] if op == ca.OP_ADD else code.operation(ca.OP_NEG, [now[b]])
            return code.operation(op, [now[a], now[b]])
        if op == ca.OP_MUL:
            if a in now and b in now:
                return code.squared(stored[a], k) if a == b else code.convolved([(stored[a], stored[b])], 0, k, k)[0]
            return code.operation(op, [now[a], values[b]] if a in now else [values[a], now[b]])
        if op == ca.OP_DIV:
            if b not in now:
                return code.operation(op, [now[a], values[b]])
            (total,) = code.convolved([(stored[b], stored[row])], 1, k, k)
            left = code.operation(ca.OP_SUB, [now[a], total]) if a in now else code.operation(ca.OP_NEG, [total])
            return code.operation(op, [left, values[b]])
        if op == ca.OP_SQRT:
            (total,) = code.convolved([(stored[row], stored[row])], 1, code.shifted(k, -1), k)
            twice = code.operation(ca.OP_TWICE, [values[row]])
            return code.operation(ca.OP_DIV, [code.operation(ca.OP_SUB, [now[a], total]), twice])
        pairs = [(self.multiples[a], stored[row]), (stored[a], stored[row])]
        weighted, total = code.convolved(pairs, 1, k, k)
        raised = code.operation(ca.OP_ADD, [values[b], code.number(1)])
        share = code.operation(ca.OP_MUL, [raised, code.over(k)])
        left = code.operation(ca.OP_SUB, [code.operation(ca.OP_MUL, [share, weighted]), total])
        return code.operation(ca.OP_DIV, [left, values[a]])


class GraphCode:
    """Series as expressions of CasADi. For sums of many products their coefficients are stored in columns too, one of
    them from its end backwards, which CasADi multiplies without a call for each coefficient."""

    class Columns(list):
        """The coefficients found so far, and both columns of them with the number of those stored."""

        def __init__(self, coefficients: Sequence[ca.SX] = ()) -> None:
            super().__init__(coefficients)
            self.columns, self.stored = (ca.SX(0, 1), ca.SX(0, 1)), 0

        def up_to(self, high: int) -> tuple[ca.SX, ca.SX]:
            """Both columns, with the coefficients up to one."""
            if high >= (room := self.columns[0].numel()):
                self.columns, self.stored = (ca.SX.zeros(2 * room or 32), ca.SX.zeros(2 * room or 32)), 0
                return self.up_to(high)
            for k in range(self.stored, high + 1):
                self.columns[0].set_nz(self[k], False, _slice(k, k + 1))
                self.columns[1].set_nz(self[k], False, _slice(room - 1 - k, room - k))
            self.stored = max(self.stored, high + 1)
            return self.columns

    number = staticmethod(cache(ca.SX))
    series = Columns

    def operation(self, op: int, values: Sequence[ca.SX]) -> ca.SX:
        """An operation of CasADi."""
        return applied(op, values)

    def get(self, series: Columns, k: int) -> ca.SX:
        """Coefficient k of a series."""
        return series[k]

    def put(self, series: Columns, k: int, value: ca.SX) -> None:
        """Append coefficient k to a series."""
        series.append(value)

    def orders(self, first: int, last: int, body: Callable[[int], None]) -> None:
        """Do `body` for each order."""
        for k in range(first, last + 1):
            body(k)

    def shifted(self, k: int, by: int) -> int:
        """The order k + by."""
        return k + by

    def over(self, k: int) -> ca.SX:
        """The number 1 / k."""
        return self.number(1 / k)

    def times_order(self, value: ca.SX, k: int) -> ca.SX:
        """A value times k."""
        return _times(self.number(k), value)

    def convolved(self, pairs: Sequence[tuple[Columns, Columns]], low: int, high: int, k: int) -> list[ca.SX]:
        """The sums of a[j] b[k - j] for low <= j <= high."""
        return [self._convolved(a, b, low, high, k) for a, b in pairs]

    def squared(self, series: Columns, k: int) -> ca.SX:
        """The sum of a[j] a[k - j]."""
        products = _times(self.number(2), self._convolved(series, series, 0, (k - 1) // 2, k))
        return _plus(products, ca.SX.unary(ca.OP_SQ, series[k // 2])) if k % 2 == 0 else products

    @staticmethod
    def _convolved(a: Columns, b: Columns, low: int, high: int, k: int) -> ca.SX:
        if high - low + 1 >= _MANY:
            (forward, _), (_, backward) = a.up_to(high), b.up_to(k - low)
            end = backward.numel() - k
            return ca.dot(
                forward.get_nz(False, _slice(low, high + 1)), backward.get_nz(False, _slice(end - 1 + low, end + high))
            )
        terms = [_times(a[j], b[k - j]) for j in range(low, high + 1)]
        return reduce(_plus, terms) if terms else _ZERO


def has_taylor_series(function: ca.Function) -> bool:
    """Whether every operation of the SX function has a recurrence, as comparisons, switches and splines have not."""
    return {function.instruction_id(i) for i in range(function.n_instructions())} <= _WITH_SERIES


def taylor_coefficients(field: ca.Function, x: ca.SX, p: ca.SX, order: int) -> ca.SX:
    """Taylor coefficients of the solution through `x`, and of the quantities watched along it.

    `field` is an SX function (x, p) -> (x', w): the vector field (n) and watched quantities (m, may be 0).
    Returns an SX matrix (n + m, order + 1); column k holds the coefficients of t**k.
    """
    recursion, code = Recursion(), GraphCode()
    rates, watched = recursion.graph(field)
    states, followed = ([GraphCode.Columns() for _ in range(field.numel_out(i))] for i in (0, 1))
    series = Series(code, recursion, states, [*rates.values(), *watched.values()])
    for state, value in zip(states, ca.vertsplit(x), strict=True):
        state.append(value)
    series.begin([ca.vertsplit(x), ca.vertsplit(p)])
    for k in range(order + 1):
        now = series.advance(k, [state[k] for state in states]) if k else series.values
        for i, row in enumerate(followed):
            row.append(now.get(watched.get(i, -1), _ZERO))
        for i, state in enumerate(states if k < order else ()):
            state.append(_times(now.get(rates.get(i, -1), _ZERO), code.over(k + 1)))
    return ca.SX(ca.vertcat(*[ca.horzcat(*row) for row in (*states, *followed)]))


def composed_coefficients(function: ca.Function, rows: Sequence[Sequence[ca.SX]], p: ca.SX) -> ca.SX:
    """Taylor coefficients (K + 1,) of the SX function (x, p) -> value along x(t), whose elements have the coefficients
    `rows` (n of K + 1 each)."""
    recursion, states = Recursion(), [GraphCode.Columns(row) for row in rows]
    (value,) = recursion.graph(function)
    series = Series(GraphCode(), recursion, states, [*value.values()])
    series.begin([[row[0] for row in rows], ca.vertsplit(p)])
    orders = range(1, len(rows[0]))
    found = [series.values, *(series.advance(k, [row[k] for row in rows]) for k in orders)]
    return ca.vertcat(*(now.get(value.get(0, -1), _ZERO) for now in found))


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
