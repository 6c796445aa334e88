"""Taylor series of a field's solution and of its variational equations, as loops in machine code.

The recursions are those of `taylor_series`. With many columns their graph has hundreds of thousands of instructions,
which take seconds to compile and do not fit into the processor's cache; as loops over the orders they are short.

Values are names in the code of a `MachineCode`. A series that changes with time has the number of a place in its
scratch memory, from which its coefficients follow each other; one that does not is its value.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from .calls import single_assignment
from .taylor_series import separated_variations

_PARTNERS = {ca.OP_SIN: ca.OP_COS, ca.OP_COS: ca.OP_SIN, ca.OP_SINH: ca.OP_COSH, ca.OP_COSH: ca.OP_SINH}
_POWERS = (ca.OP_POW, ca.OP_CONSTPOW)
_LINEAR = (ca.OP_ASSIGN, ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE)
_NONLINEAR = (ca.OP_MUL, ca.OP_SQ, ca.OP_DIV, ca.OP_INV, ca.OP_SQRT, ca.OP_EXP, *_POWERS, *_PARTNERS)
_LOOPED = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, *_LINEAR, *_NONLINEAR}
_Row = int | str


@dataclass(frozen=True)
class _Memory:
    """The places of the results of a `VariationsInLoops`: of the series of the states and watched quantities, and of
    the first series of the columns."""

    rows: list[int]
    columns: int


class VariationsInLoops:
    """The function of `variations`, to be appended to the code of a kernel."""

    def __init__(self, field: ca.Function, varied: tuple[int, ...], columns: int, order: int):
        self.n, self.watched, self.columns, self.order = field.numel_out(0), field.numel_out(1), columns, order
        self.stride, self.size = order + 2, field.numel_out(0) * columns
        parts, extended, self.slopes, self.forces = separated_variations(field, varied)
        self.instructions = single_assignment(extended)
        matrices = parts.rates, parts.multiples, parts.arguments
        self.places = [matrix.sparsity().get_triplet() for matrix in matrices]
        self.numbers = ca.Function("linear", [field.sx_in(1)], [ca.densify(ca.SX(each.nz[:])) for each in matrices])

    @property
    def able(self) -> bool:
        """Whether every operation has a loop; the derivative of a power whose exponent changes is one that has none."""
        return {op for op, *_ in self.instructions} <= _LOOPED

    def append(self, code: Any, arguments: Sequence[Sequence[str]]) -> _Memory:
        """Append the code that finds the coefficients from x, p, dx and dp; return where they are."""
        memory = _Memory([], code.reserve(self.stride * self.size))
        code.apart(lambda own: memory.rows.extend(self._solve(code, memory.columns, *own)), arguments)
        return memory

    def coefficients(self, code: Any, memory: _Memory) -> tuple[list, list]:
        """The coefficients of the states and watched quantities, and the first two and last two of the columns, as
        functions that load them."""
        ends, columns = (0, 1, self.order - 1, self.order), range(self.size)
        rows = [code.later(place + k) for place in memory.rows for k in range(self.order + 1)]
        return rows, [code.later(memory.columns + q * self.stride + k) for q in columns for k in ends]

    def columns_after(self, code: Any, memory: _Memory, h: str) -> list:
        """Append the code that finds the columns after a time; return functions that load them."""
        found = code.reserve(self.size)

        def every(own: list[list[str]]) -> None:
            def column(q: str, _: list) -> list:
                last = code.offset(code.place(memory.columns + self.order), q, self.stride)

                def horner(k: str, total: list) -> list:
                    return [code.plus(code.times(total[0], own[0][0]), code.get(code.offset(last, k, -1)))]

                code.put(code.loop(1, self.order, horner, [code.get(last)])[0], code.offset(code.place(found), q))
                return []

            code.loop(0, self.size - 1, column, [])

        code.apart(every, [[h]])
        return [code.later(found + q) for q in range(self.size)]

    def _solve(self, code: Any, first: int, x: Sequence, p: Sequence, dx: Sequence, dp: Sequence) -> list[int]:
        """Append the code of the solution, then that of the columns, which begin at the place `first`; return the
        places of the states and watched quantities."""
        series = _SeriesInLoops(code, self.order)
        states = series.solve(self.instructions, x, p, self.n)
        outputs = [series.outputs.get((1, i), code.splat(0)) for i in range(self.watched)]
        rows = [*states, *(series.stored(row) for row in outputs)]
        for q, value in enumerate(dx):
            code.put(value, code.place(first + q * self.stride))
        varied = code.reserve(max(1, len(dp)))
        for q, value in enumerate(dp):
            code.put(value, code.place(varied + q))
        count = len(self.slopes) + len(self.forces)
        derivatives = [series.outputs.get((1, self.watched + i), code.splat(0)) for i in range(count)]
        matrices = code.graph(self.numbers, [p])
        terms = [[*zip(*place, values, strict=True)] for place, values in zip(self.places, matrices, strict=True)]

        def column(c: str, _: list) -> list:
            own = code.offset(code.place(first), c, self.n * self.stride)
            changes = code.offset(code.place(varied), c, len(dp) // self.columns)
            self._column(code, series, derivatives, terms, own, changes)
            return []

        code.loop(0, self.columns - 1, column, [])
        return rows

    def _column(self, code: Any, series: "_SeriesInLoops", derivatives: list, terms: list, own: str, dp: str) -> None:
        """Append the code of one column, whose series are at the pointer `own` and whose changes of the parameters are
        at `dp`: each order follows from those before it."""
        rates, multiples, arguments = terms
        states = [code.moved(own, i * self.stride) for i in range(self.n)]
        slopes = [(*place, row) for place, row in zip(self.slopes, derivatives, strict=False)]
        forces = [(*place, row) for place, row in zip(self.forces, derivatives[len(slopes) :], strict=True)]
        moving, functions = [each for each in slopes if series.moves(each[2])], sorted({i for i, *_ in slopes})
        sums = {j: [(i, value) for row, i, value in arguments if row == j] for j, *_ in arguments}
        # The series of an argument that is one state are that state's; others are stored besides.
        alone = {j: states[each[0][0]] for j, each in sums.items() if len(each) == 1 and code.is_one(each[0][1])}
        others = {j: code.place(code.reserve(self.stride)) for j in sums if j not in alone}
        of_arguments = alone | others

        def order(k: str, _: list) -> list:
            now = [code.get(code.offset(each, k)) for each in states]
            for j, pointer in others.items():
                code.put(_weighted_sum(code, [(now[i], value) for i, value in sums[j]]), code.offset(pointer, k))

            def term(at: str, totals: list) -> list:
                back, found = code.integer("sub", k, at), dict(zip(functions, totals, strict=True))
                used = dict.fromkeys(j for _, j, _ in moving)
                moved = {j: code.get(code.offset(of_arguments[j], back)) for j in used}
                for i, j, row in moving:
                    found[i] = code.plus(found[i], code.times(series.get(row, at), moved[j]))
                return [*found.values()]

            sums_now = code.loop(0, k, term, [code.splat(0)] * len(functions))
            change = dict(zip(functions, sums_now, strict=True))
            for i, j, row in slopes:
                if not series.moves(row):
                    change[i] = code.plus(change[i], code.times(row, code.get(code.offset(of_arguments[j], k))))
            rises: list[list] = [[] for _ in states]
            for i, j, value in rates:
                rises[i].append((now[j], value))
            for i, j, value in multiples:
                rises[i].append((change.get(j, code.splat(0)), value))
            for i, j, row in forces:
                rises[i].append((series.get(row, k), code.get(code.moved(dp, j))))
            share = series.get(series.inverses + 1, k)
            for state, each in zip(states, rises, strict=True):
                code.put(code.times(_weighted_sum(code, each), share), code.offset(code.moved(state, 1), k))
            return []

        code.loop(0, self.order - 1, order, [])


def _weighted_sum(code: Any, terms: Sequence[tuple[str, str]]) -> str:
    """The sum of values times factors."""
    products = [value if code.is_one(factor) else code.times(value, factor) for value, factor in terms]
    total = products[0] if products else code.splat(0)
    for product in products[1:]:
        total = code.plus(total, product)
    return total


class _SeriesInLoops:
    """The series of the instructions of a field, up to an order."""

    def __init__(self, code: Any, order: int):
        self.code, self.order, self.stride = code, order, order + 2
        numbers = range(order + 2)
        self.inverses = code.table([0.0, *(1 / k for k in numbers[1:]), 0.0])  # 1/k, of which the last is not used
        self.numbers, self.only_first = (
            code.table([float(k) for k in numbers]),
            code.table([float(k == 0) for k in numbers]),
        )
        self.rows: list[Any] = []  # of each instruction
        self.outputs: dict[tuple[int, int], _Row] = {}
        self.partners: dict[tuple[int, int], int] = {}  # of trigonometric functions, by operation and argument
        self.multiples: dict[int, int] = {}  # the series j a[j] of a series a, by place, for those that need it

    @staticmethod
    def moves(row: _Row) -> bool:
        """Whether a series changes with time."""
        return isinstance(row, int)

    def get(self, row: _Row, k: str) -> str:
        """Coefficient k of a series."""
        if isinstance(row, int):
            return self.code.get(self.code.offset(self.code.place(row), k))
        return self.code.times(row, self.get(self.only_first, k))

    def first(self, row: _Row) -> str:
        """The first coefficient of a series."""
        return self.code.get(self.code.place(row)) if isinstance(row, int) else row

    def put(self, value: str, place: int, k: str) -> None:
        """Store coefficient k of a series."""
        self.code.put(value, self.code.offset(self.code.place(place), k))

    def new(self, value: str) -> int:
        """The place of a new series whose first coefficient is known."""
        place = self.code.reserve(self.stride)
        self.code.put(value, self.code.place(place))
        return place

    def stored(self, row: _Row) -> int:
        """The place of a series, also of one that does not change with time."""
        if isinstance(row, int):
            return row
        place = self.new(row)
        for k in range(1, self.order + 1):
            self.code.put(self.code.splat(0), self.code.place(place + k))
        return place

    def solve(self, instructions: Sequence, x: Sequence, p: Sequence, n: int) -> list[int]:
        """Append the code of all series; return the places of those of the states."""
        code, states, values = self.code, [self.new(value) for value in x], list[str]()
        for op, inputs, constant in instructions:
            row, value = None, ""
            if op == ca.OP_OUTPUT:
                self.outputs[inputs[1], inputs[2]] = self.rows[inputs[0]]
            elif op == ca.OP_INPUT:
                value = (x, p)[inputs[0]][inputs[1]]
                row = states[inputs[1]] if inputs[0] == 0 else value
            elif constant is not None:
                row = value = code.splat(constant)
            else:
                value = code.operation(op, [values[i] for i in inputs])
                row = self._begun(op, [self.rows[i] for i in inputs], value, values[inputs[0]])
            self.rows.append(row)
            values.append(value)
        rates = [self.outputs.get((0, i), code.splat(0)) for i in range(n)]
        for state, rate in zip(states, rates, strict=True):
            code.put(self.first(rate), code.place(state + 1))

        def order(k: str, _: list) -> list:
            for state in states:
                self._store_multiple(state, k)
            done = {*states}
            for (op, inputs, _), row in zip(instructions, self.rows, strict=True):
                if isinstance(row, int) and row not in done:
                    done |= self._advance(op, [self.rows[i] for i in inputs], row, k)
            share = self.get(self.inverses + 1, k)
            for state, rate in zip(states, rates, strict=True):
                value = self.get(rate, k) if self.moves(rate) else code.splat(0)
                self.put(code.times(value, share), state + 1, k)
            return []

        code.loop(1, self.order, order, [])
        return states

    def _begun(self, op: int, inputs: list, value: str, argument: str) -> _Row:
        """The series of an operation with this first coefficient, where `argument` is that of its first argument."""
        if not any(map(self.moves, inputs)):
            return value
        if op in (*_PARTNERS, *_POWERS, ca.OP_EXP) and inputs[0] not in self.multiples:
            self.multiples[inputs[0]] = self.new(self.code.splat(0))
        if op in _PARTNERS and (op, inputs[0]) not in self.partners:
            self.partners[op, inputs[0]] = self.new(value)
            self.partners[_PARTNERS[op], inputs[0]] = self.new(self.code.operation(_PARTNERS[op], [argument]))
        return self.partners[op, inputs[0]] if op in _PARTNERS else self.new(value)

    def _store_multiple(self, place: int, k: str) -> None:
        """Store coefficient k of the multiples of a series, where they are needed."""
        if place in self.multiples:
            self.put(self.code.times(self.get(self.numbers, k), self.get(place, k)), self.multiples[place], k)

    def _convolved(self, pairs: Sequence[tuple[int, int]], low: int, high: str, k: str) -> list[str]:
        """The sums of a[j] b[k-j] for low <= j <= high, of pairs of series a and b."""
        code = self.code

        def term(j: str, totals: list) -> list:
            back = code.integer("sub", k, j)
            products = [code.times(self.get(a, j), self.get(b, back)) for a, b in pairs]
            return [code.plus(total, product) for total, product in zip(totals, products, strict=True)]

        return code.loop(low, high, term, [code.splat(0)] * len(pairs))

    def _advance(self, op: int, inputs: list, row: int, k: str) -> set[int]:
        """Append the code of coefficient k of an operation; return the places of the series that have it now."""
        new = {row: ""}
        if op in _PARTNERS:
            other, multiples = self.partners[_PARTNERS[op], inputs[0]], self.multiples[inputs[0]]
            totals = self._convolved([(multiples, other), (multiples, row)], 1, k, k)
            for place, total in zip((row, other), totals, strict=True):
                value = self.code.times(total, self.get(self.inverses, k))
                falls = self.partners.get((ca.OP_COS, inputs[0])) == place
                new[place] = self.code.operation(ca.OP_NEG, [value]) if falls else value
        else:
            new[row] = self._coefficient(op, inputs[0], inputs[-1], row, k)
        for place, value in new.items():
            self.put(value, place, k)
            self._store_multiple(place, k)
        return {*new}

    def _coefficient(self, op: int, a: Any, b: Any, row: int, k: str) -> str:
        """Coefficient k of an operation on its first argument a and its last argument b, from 1 on."""
        code = self.code
        now = [self.get(each, k) if self.moves(each) else code.splat(0) for each in (a, b)]
        if op in _LINEAR:
            return code.operation(op, now)
        if op in (ca.OP_MUL, ca.OP_SQ):
            if self.moves(a) and self.moves(b):
                return self._convolved([(a, b)], 0, k, k)[0]
            return code.times(now[0], b) if self.moves(a) else code.times(a, now[1])
        if op == ca.OP_DIV:
            left = now[0] if not self.moves(b) else code.minus(now[0], self._convolved([(b, row)], 1, k, k)[0])
            return code.operation(op, [left, self.first(b)])
        if op == ca.OP_INV:
            left, divisor = code.minus(code.splat(0), self._convolved([(a, row)], 1, k, k)[0]), self.first(a)
        elif op == ca.OP_SQRT:
            left = code.minus(now[0], self._convolved([(row, row)], 1, code.integer("sub", k, 1), k)[0])
            divisor = code.operation(ca.OP_TWICE, [self.first(row)])
        elif op == ca.OP_EXP:
            return code.times(self._convolved([(self.multiples[a], row)], 1, k, k)[0], self.get(self.inverses, k))
        else:
            weighted, total = self._convolved([(self.multiples[a], row), (a, row)], 1, k, k)
            share = code.times(code.plus(b, code.splat(1)), self.get(self.inverses, k))
            left, divisor = code.minus(code.times(share, weighted), total), self.first(a)
        return code.operation(ca.OP_DIV, [left, divisor])


@dataclass(frozen=True, eq=False)
class InLoops:
    """A step of a motion with sensitivities, whose series are loops in machine code.

    before : its arguments -> those of the series
    series : the coefficients of the solution and of the sensitivities
    choose : its arguments, the coefficients of the solution, and the first two and last two of the sensitivities ->
        what the step is to be, the last of it its length
    after : its arguments, the coefficients of the solution, what `choose` returns, and the sensitivities after that
        length -> its results
    flat : makes the same function as one graph
    """

    before: ca.Function
    series: VariationsInLoops
    choose: ca.Function
    after: ca.Function
    flat: Callable[[], ca.Function]

    def name(self) -> str:
        """Its name."""
        return self.after.name()

    def n_in(self) -> int:
        """The number of arguments."""
        return self.before.n_in()

    def n_out(self) -> int:
        """The number of results."""
        return self.after.n_out()

    def nnz_in(self, i: int) -> int:
        """The size of an argument."""
        return self.before.nnz_in(i)

    def nnz_out(self, i: int) -> int:
        """The size of a result."""
        return self.after.nnz_out(i)

    def n_instructions(self) -> int:
        """The number of instructions beside those of the loops, which are few."""
        return sum(part.n_instructions() for part in (self.before, self.choose, self.after))

    def append(self, code: Any, arguments: Sequence[Sequence]) -> list[list[str]]:
        """Append its code; return the values of the results."""
        memory = self.series.append(code, code.graph(self.before, arguments))
        rows, ends = self.series.coefficients(code, memory)
        chosen = code.graph(self.choose, [*arguments, rows, ends])
        columns = self.series.columns_after(code, memory, chosen[-1][0])
        return code.graph(self.after, [*arguments, rows, *chosen, columns])
