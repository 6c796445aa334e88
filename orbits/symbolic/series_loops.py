"""Taylor series of a field's solution and of its variational equations, as loops over the orders in machine code."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import casadi as ca

from .recursion import Affine, Recursion
from .taylor_series import Series
from .vector_code import VECTORS, Block, VectorCode


class LoopOptions(NamedTuple):
    """How the series of columns are found."""

    # Up to this many columns are found together with the solution, more of them one after the other, in less code.
    together: int = 4


LOOPS = LoopOptions()


def room_of_series(count: int, order: int) -> int:
    """The places of a number of series up to an order, each with room for one coefficient more: a multiple of all
    numbers of lanes."""
    return -(-count * (order + 2) // VECTORS.lanes) * VECTORS.lanes


class LoopCode:
    """Series in the scratch memory of a code, up to an order. A series is the number of a place, from which its
    coefficients follow each other; an order is the name of a whole number."""

    def __init__(self, code: VectorCode, order: int):
        self.code, self.order = code, order
        # Of no power of 2, which would let all series compete for the same places of the processor's cache.
        self.stride = order + 2
        orders = range(order + 2)
        self._orders = code.table([float(k) for k in orders])
        self._inverses = code.table([1 / max(k, 1) for k in orders])
        # The pairs of series whose sums are needed, with those begun of two orders; the first one is `_first`.
        self._pairs, self._first = dict[tuple[int | str, int | str], list[str]](), ""

    def number(self, value: float) -> str:
        """A number as a value."""
        return self.code.splat(value)

    def operation(self, op: int, values: Sequence[str]) -> str:
        """An operation of CasADi on one value or two."""
        return self.code.operation(op, values)

    def series(self) -> int:
        """A new series."""
        return self.code.reserve(self.stride)

    def at(self, series: int | str, k: str | int) -> str:
        """The pointer to coefficient k of a series, which may be a pointer too."""
        if isinstance(series, int) and isinstance(k, int):
            return self.code.place(series + k)
        return self.code.offset(self.code.place(series) if isinstance(series, int) else series, k)

    def get(self, series: int | str, k: str | int) -> str:
        """Coefficient k of a series."""
        return self.code.get(self.at(series, k))

    def put(self, series: int, k: str | int, value: str) -> None:
        """Set coefficient k of a series."""
        self.code.put(value, self.at(series, k))

    def orders(self, first: int, last: int, body: Callable[[str], None]) -> None:
        """Do what `body` writes of one order for all orders from `first` to `last`."""

        def each(k: str, _: list[str]) -> list[str]:
            body(k)
            return []

        self.code.loop(first, last, each)

    def shifted(self, k: str | int, by: int) -> str | int:
        """The order k + by."""
        return k + by if isinstance(k, int) else self.code.integer("add", k, by)

    def over(self, k: str | int) -> str:
        """The value 1 / k."""
        return self.get(self._inverses, k)

    def times_order(self, value: str, k: str) -> str:
        """A value times k."""
        return self.code.times(value, self.get(self._orders, k))

    def convolved(self, a: int | str, b: int | str, low: int, k: str | int, last: bool = True) -> str:
        """The sum of a[j] b[k - j] from j = low up to k, or without the last term: what `_begin_pair` has found of it,
        and the terms with coefficients that have been found since."""
        code, ends = self.code, list[tuple[str | int, str | int]]([(0, k)] if low == 0 else [])
        if isinstance(k, int):
            self._pairs.setdefault((a, b), [])
            total = code.splat(0)
            ends += [(j, k - j) for j in range(1, k + last)]
        else:
            (total, later), second = self._pairs[a, b], k != self._first
            total = later if second else total
            before = self.shifted(k, -1)
            ends += [(1, before), (before, 1)] if second else []
            ends += [(k, 0)] if last else []
        for i, j in ends:
            total = code.fused(self.get(a, i), self.get(b, j), total)
        return total

    def squared(self, series: int, k: str | int) -> str:
        """The sum of a[j] a[k - j] for 0 <= j <= k."""
        return self.convolved(series, series, 0, k)

    def orders_in_pairs(self, last: int, body: Callable[[str | int], None]) -> None:
        """Do what `body` writes of one order for all orders from 1 to `last`. The sums of two orders are begun
        together, so that they load each coefficient once."""
        body(1)

        def each(q: str) -> None:
            self._begin_pair(first := self.code.integer("shl", q, 1))
            body(first)
            body(self.shifted(first, 1))

        if last > 2:
            self.orders(1, (last - 1) // 2, each)
        if last % 2 == 0:
            self._begin_pair(first := self.code.integer("add", last, 0))
            body(first)

    def _begin_pair(self, k: str) -> None:
        """Find the sums of the orders k and k + 1 of all pairs of series as far as coefficients below k go."""
        code, zero, self._first = self.code, self.code.splat(0), k
        if not self._pairs:
            return
        firsts, seconds = (dict.fromkeys(each) for each in zip(*self._pairs, strict=True))

        def add(j: str, before: list[str]) -> list[str]:
            after = {a: self.get(a, self.shifted(j, 1)) for a in firsts}
            own, totals = dict(zip(firsts, before, strict=False)), before[len(firsts) :]
            others = {b: self.get(b, code.integer("sub", k, j)) for b in seconds}
            for i, (a, b) in enumerate(self._pairs):
                totals[2 * i] = code.fused(own[a], others[b], totals[2 * i])
                totals[2 * i + 1] = code.fused(after[a], others[b], totals[2 * i + 1])
            return [*after.values(), *totals]

        start = [*(self.get(a, 1) for a in firsts), *[zero] * (2 * len(self._pairs))]
        found = code.loop(1, code.integer("sub", k, 2), add, start)
        for i, (a, b) in enumerate(self._pairs):
            total, later = found[len(firsts) + 2 * i :][:2]
            # The last term of the first sum, whose factor of the second sum is not known yet.
            total = code.fused(found[[*firsts].index(a)], self.get(b, 1), total)
            self._pairs[a, b] = [total, later]


class Coefficients(NamedTuple):
    """The places of the series of states and watched quantities, which follow each other, and of the columns, one
    column of states after the other; all with the same stride."""

    rows: Block
    columns: int
    stride: int


class _Terms(NamedTuple):
    """What a column of the variational equations consists of: for each state the factors of states, those of functions,
    and the rows that are its derivatives by the parameters varied, by column of these; of each function the rows that
    are its derivatives by affine arguments, and of each argument the factors of states. All factors are rows."""

    states: list[dict[int, int]]
    functions: list[dict[int, int]]
    parameters: list[dict[int, int]]
    slopes: dict[int, dict[int, int]]
    arguments: dict[int, dict[int, int]]


class _Column(NamedTuple):
    """Pointers to the series of the states of a column and of its arguments, and the changes of the parameters."""

    states: list[str]
    arguments: dict[int, str]
    dp: Sequence[str]


class VariationSeries:
    """Taylor series of the solution of a field (x, p) -> (x', watched quantities) and of columns of its variational
    equations dx' = f_x dx + f_p dp, where `varied` are the rows of dp that are not zero.

    f_x = R + Q D A, with the derivatives D of nonlinear functions by their affine arguments A: the fewer functions of
    the state there are, the fewer products of series a column takes, for a force that pulls at two masses one instead
    of four.
    """

    def __init__(self, field: ca.Function, varied: tuple[int, ...], columns: int, order: int):
        self.n, self.watched, self.columns, self.order = field.numel_out(0), field.numel_out(1), columns, order
        self.recursion = Recursion()
        self.rates, self.quantities = self.recursion.graph(field)
        self.terms = self._terms(varied if columns else ())

    def _terms(self, varied: tuple[int, ...]) -> _Terms:
        recursion = self.recursion
        affine = [recursion.affine(self.rates[i]) if i in self.rates else Affine({}, {}) for i in range(self.n)]
        slopes, arguments = dict[int, dict[int, int]](), dict[int, dict[int, int]]()

        def derivatives(row: int, by: Sequence[int]) -> dict[int, int]:
            found = {i: recursion.slope(row, each) for i, each in enumerate(by)}
            return {i: each for i, each in found.items() if not recursion.is_number(each, 0)}

        symbols = [recursion.input(1, row) for row in varied]
        parameters = [derivatives(self.rates[i], symbols) if i in self.rates else {} for i in range(self.n)]
        for function in dict.fromkeys(row for each in affine for row in each.functions):
            own = sorted(recursion.arguments[function])
            slopes[function] = {own[i]: row for i, row in derivatives(function, own).items()}
            arguments |= {each: recursion.affine(each).states for each in slopes[function]}
        return _Terms(
            [each.states for each in affine], [each.functions for each in affine], parameters, slopes, arguments
        )

    def append(
        self, code: VectorCode, x: Sequence[str], p: Sequence[str], dx: Sequence[str], dp: Sequence[str]
    ) -> Coefficients:
        """Append the code that finds the coefficients; dx (n columns) and dp (varied columns) are one column after the
        other. Returns where they are."""
        own, terms, n = LoopCode(code, self.order), self.terms, self.n
        size, stride = room_of_series(n + self.watched, self.order), own.stride
        found = Coefficients(Block(code.reserve(size), size), code.reserve(stride * n * self.columns), stride)
        places = [found.rows.place + i * stride for i in range(n + self.watched)]
        factors = [
            row for each in (*terms.states, *terms.functions, *terms.arguments.values()) for row in each.values()
        ]
        kept = [row for each in (*terms.slopes.values(), *terms.parameters) for row in each.values()]
        wanted = [*self.rates.values(), *self.quantities.values(), *(factors if self.columns else ())]
        series = Series(own, self.recursion, places[:n], wanted, kept if self.columns else ())
        followed = [self.quantities.get(i, -1) for i in range(self.watched)]
        moving = [row in series.moving for row in followed]
        series.begin([x, p])
        for place, value in zip(
            places, [*x, *(series.values.get(row, own.number(0)) for row in followed)], strict=True
        ):
            own.put(place, 0, value)
        for q, value in enumerate(dx):
            own.put(found.columns + q * own.stride, 0, value)
        for place in (place for place, moves in zip(places[n:], moving, strict=True) if not moves):
            own.orders(1, self.order, partial(own.put, place, value=own.number(0)))
        together, count = self.columns <= LOOPS.together, len(dp) // max(self.columns, 1)
        starts = [code.place(found.columns + c * n * own.stride) for c in range(self.columns if together else 0)]
        columns = [self._column(own, series, start, dp[c * count :][:count]) for c, start in enumerate(starts)]
        self._advance_states(own, places[:n], series.values, 0)
        self._advance_columns(own, series, columns, 0)

        def order(k: str | int) -> None:
            now = series.advance(k, [own.get(place, k) for place in places[:n]])
            for place, row, moves in zip(places[n:], followed, moving, strict=True):
                if moves:
                    own.put(place, k, now[row])
            self._advance_states(own, places[:n], now, k)
            self._advance_columns(own, series, columns, k)

        own.orders_in_pairs(self.order if any(moving) else self.order - 1, order)
        if not together:
            self._one_by_one(own, series, found.columns, dp)
        return found

    def _advance_states(self, own: LoopCode, states: Sequence[int], now: dict[int, str], k: str | int) -> None:
        """Append the code of coefficients k + 1 of the states, from those of order k of all rows."""
        share = own.over(own.shifted(k, 1))
        for i, place in enumerate(states):
            rate = now.get(self.rates.get(i, -1), own.number(0))
            own.put(place, own.shifted(k, 1), own.code.times(rate, share))

    def _one_by_one(self, own: LoopCode, series: Series, first: int, dp: Sequence[str]) -> None:
        """Append the code of the columns in a loop, once the solution is known."""
        code, count = own.code, len(dp) // self.columns
        own = LoopCode(code, self.order)  # with the sums of the columns alone
        changes = code.reserve(max(1, len(dp)))
        for q, value in enumerate(dp):
            code.put(value, code.place(changes + q))

        def column(c: str, _: list[str]) -> list[str]:
            pointer = code.offset(code.place(changes), c, count)
            moves = [code.get(code.moved(pointer, j)) for j in range(count)]
            start = code.offset(code.place(first), c, self.n * own.stride)
            each = [self._column(own, series, start, moves)]
            self._advance_columns(own, series, each, 0)
            own.orders_in_pairs(self.order - 1, partial(self._advance_columns, own, series, each))
            return []

        code.loop(0, self.columns - 1, column)

    def _column(self, own: LoopCode, series: Series, start: str, dp: Sequence[str]) -> _Column:
        """The column whose series begin at a pointer; those of arguments that are one state are that state's."""
        code = own.code
        states, arguments = [code.moved(start, i * own.stride) for i in range(self.n)], dict[int, str]()
        for row, parts in self.terms.arguments.items():
            alone = [self.recursion.is_number(factor, 1) for factor in parts.values()] == [True]
            arguments[row] = states[next(iter(parts))] if alone else code.place(own.series())
        return _Column(states, arguments, dp)

    def _advance_columns(self, own: LoopCode, series: Series, columns: Sequence[_Column], k: Any) -> None:
        """Append the code of coefficients k + 1 of columns, from those up to k."""
        code, terms, after = own.code, self.terms, own.shifted(k, 1)
        now = [[code.get(code.offset(pointer, k)) for pointer in each.states] for each in columns]
        for each, values in zip(columns, now, strict=True):
            for row, parts in terms.arguments.items():
                if each.arguments[row] not in each.states:
                    total = self._weighted(own, series, parts, values, own.number(0))
                    code.put(total, code.offset(each.arguments[row], k))
        changes = self._changes(own, series, columns, k) if columns else []
        for each, values, change in zip(columns, now, changes, strict=True):
            for i, pointer in enumerate(each.states):
                total = self._weighted(own, series, terms.states[i], values, own.number(0))
                total = self._weighted(own, series, terms.functions[i], change, total)
                for j, row in terms.parameters[i].items():
                    total = self._driven(own, series, row, each.dp[j], k, total)
                code.put(code.times(total, own.over(after)), code.offset(pointer, after))

    @staticmethod
    def _weighted(own: LoopCode, series: Series, factors: dict[int, int], values: Any, total: str) -> str:
        """A sum with values times factors, whose rows do not move."""
        for i, factor in factors.items():
            total = own.code.fused(series.values[factor], values[i], total)
        return total

    def _changes(self, own: LoopCode, series: Series, columns: Sequence[_Column], k: Any) -> list[dict[int, str]]:
        """Coefficients k of the changes of the nonlinear functions along columns, from those of their arguments."""
        code, slopes = own.code, [(f, *each) for f, found in self.terms.slopes.items() for each in found.items()]
        changes = [dict.fromkeys(self.terms.slopes, own.number(0)) for _ in columns]
        for each, change in zip(columns, changes, strict=True):
            for f, argument, row in slopes:
                pointer = each.arguments[argument]
                if row in series.stored and k != 0:
                    change[f] = code.plus(change[f], own.convolved(series.stored[row], pointer, 0, k))
                else:
                    change[f] = code.fused(series.values[row], code.get(code.offset(pointer, k)), change[f])
        return changes

    @staticmethod
    def _driven(own: LoopCode, series: Series, row: int, change: str, k: Any, total: str) -> str:
        """A sum with coefficient k of a derivative by a parameter times the change of this."""
        if change == own.number(0) or (k != 0 and row not in series.stored):
            return total
        return own.code.fused(series.values[row] if k == 0 else own.get(series.stored[row], k), change, total)

    def columns_after(self, code: VectorCode, found: Coefficients, h: str) -> list[Callable[[], str]]:
        """Append the code that finds the columns (n columns) after a time; return functions that load them."""
        after, n = code.reserve(max(1, self.n * self.columns)), self.n

        def column(c: str, _: list[str]) -> list[str]:
            last = code.offset(code.place(found.columns + self.order), c, n * found.stride)
            target = code.offset(code.place(after), c, n)
            ends = [code.moved(last, i * found.stride) for i in range(n)]

            def horner(k: str, totals: list[str]) -> list[str]:
                back = code.integer("sub", 0, k)
                return [
                    code.fused(each, h, code.get(code.offset(end, back)))
                    for each, end in zip(totals, ends, strict=True)
                ]

            for i, value in enumerate(code.loop(1, self.order, horner, [code.get(end) for end in ends])):
                code.put(value, code.moved(target, i))
            return []

        if self.columns:
            code.loop(0, self.columns - 1, column)
        return [code.later(after + q) for q in range(n * self.columns)]
