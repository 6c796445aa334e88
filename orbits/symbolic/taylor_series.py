"""Taylor series of the solutions of x' = f(x, p), by one recurrence for each operation of f.

`Recursion` holds the operations of expressions and of their derivatives, each once. `Series` finds the coefficients of
all of them, one order after the other, by the classical recurrences for products, quotients, powers and integrals
(Jorba and Zou, "A software package for the numerical integration of ODEs by means of high-order Taylor methods", Exp.
Math. 14, 2005), at a cost that grows with the square of the order. It writes them by a `SeriesCode`: as an expression
graph of CasADi here (`GraphCode`), or as loops in machine code.
"""

from collections.abc import Sequence
from functools import cache, partial, reduce
from typing import Any, Protocol

import casadi as ca

from .recursion import POWERS, SUMS, WITH_SERIES, Recursion, applied

# The operators of `ca.SX` first try to read their operands as NumPy arrays, which takes ten times as long as these.
_plus, _times = (partial(ca.SX.binary, op) for op in (ca.OP_ADD, ca.OP_MUL))
_ZERO = ca.SX(0)
_slice = cache(ca.Slice)
# From this many products on, their sum takes less time as a product of columns.
_MANY = 7


class SeriesCode(Protocol):
    """Writes the operations of series. Values are its own; a series is what `series` returns, and orders k are whole
    numbers, or their names in the code."""

    def number(self, value: float) -> Any:
        """A number as a value."""

    def operation(self, op: int, values: Sequence[Any]) -> Any:
        """An operation of CasADi on one value or two."""

    def series(self) -> Any:
        """A new series."""

    def put(self, series: Any, k: Any, value: Any) -> None:
        """Set coefficient k of a series, after those before it."""

    def over(self, k: Any) -> Any:
        """The value 1 / k."""

    def times_order(self, value: Any, k: Any) -> Any:
        """A value times k."""

    def convolved(self, a: Any, b: Any, low: int, k: Any, last: bool = True) -> Any:
        """The sum of a[j] b[k - j] of two series from j = low, 0 or 1, up to k, or without the last term."""

    def squared(self, series: Any, k: Any) -> Any:
        """The sum of a[j] a[k - j] for 0 <= j <= k."""


class Series:
    """The series of the rows of a recursion that some rows `wanted` need, in addition to those of the `states`, which
    the caller fills.

    values : of each row its first coefficient
    stored : the series by row, of the states, of rows that are `kept`, and of rows that sums of products read
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
            elif op in POWERS:
                self.multiples.setdefault(inputs[0], None)
                stores |= {row, inputs[0]}
        inputs_of = {row: rows[row].inputs for row in self.moving if rows[row].op == ca.OP_INPUT}
        self.stored = {row: states[places[1]] for row, places in inputs_of.items()}
        self.stored |= {row: code.series() for row in sorted(stores - self.stored.keys())}
        self.multiples = {row: code.series() for row in self.multiples}

    def _needed(self, wanted: Sequence[int]) -> list[int]:
        """All rows that these need, each after the rows that its first coefficient needs."""
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
            total = code.convolved(self.multiples[argument], stored[slope], 1, k)
            return code.operation(ca.OP_MUL, [total, code.over(k)])
        a, b = places[0], places[-1]
        if op == ca.OP_NEG:
            return code.operation(op, [now[a]])
        if op in SUMS:
            if b not in now:
                return now[a]
            if a not in now:
                return now[b] if op == ca.OP_ADD else code.operation(ca.OP_NEG, [now[b]])
            return code.operation(op, [now[a], now[b]])
        if op == ca.OP_MUL:
            if a in now and b in now:
                return code.squared(stored[a], k) if a == b else code.convolved(stored[a], stored[b], 0, k)
            return code.operation(op, [now[a], values[b]] if a in now else [values[a], now[b]])
        if op == ca.OP_DIV:
            if b not in now:
                return code.operation(op, [now[a], values[b]])
            total = code.convolved(stored[b], stored[row], 1, k)
            left = code.operation(ca.OP_SUB, [now[a], total]) if a in now else code.operation(ca.OP_NEG, [total])
            return code.operation(op, [left, values[b]])
        if op == ca.OP_SQRT:
            total = code.convolved(stored[row], stored[row], 1, k, last=False)
            twice = code.operation(ca.OP_TWICE, [values[row]])
            return code.operation(ca.OP_DIV, [code.operation(ca.OP_SUB, [now[a], total]), twice])
        weighted, total = (code.convolved(each, stored[row], 1, k) for each in (self.multiples[a], stored[a]))
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

    def put(self, series: Columns, k: int, value: ca.SX) -> None:
        """Append coefficient k to a series."""
        series.append(value)

    def over(self, k: int) -> ca.SX:
        """The number 1 / k."""
        return self.number(1 / k)

    def times_order(self, value: ca.SX, k: int) -> ca.SX:
        """A value times k."""
        return _times(self.number(k), value)

    def convolved(self, a: Columns, b: Columns, low: int, k: int, last: bool = True) -> ca.SX:
        """The sum of a[j] b[k - j] from j = low up to k, or without the last term."""
        return self._convolved(a, b, low, k if last else k - 1, k)

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
    """Whether every operation of the SX function has a recurrence, unlike comparisons, switches and splines."""
    return {function.instruction_id(i) for i in range(function.n_instructions())} <= WITH_SERIES


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
