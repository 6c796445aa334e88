"""Taylor series of a field's solution and of its variational equations as loops in machine code.

The recursions are those of `taylor_series`. Where there are many columns, their graph has hundreds of thousands of
instructions, which take seconds to compile and leave the processor's cache; as loops over the orders they are short.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from .calls import single_assignment
from .taylor_series import separated_variations

# Values are names in the code of a kernel; a series that moves is the number of its place in the scratch memory, one
# that does not change with time is its value.
Row = int | str

_PARTNERS = {ca.OP_SIN: ca.OP_COS, ca.OP_COS: ca.OP_SIN, ca.OP_SINH: ca.OP_COSH, ca.OP_COSH: ca.OP_SINH}
_ROOTS = (ca.OP_SQRT, ca.OP_EXP)
_POWERS = (ca.OP_POW, ca.OP_CONSTPOW)
_LOOPED = {
    ca.OP_ASSIGN, ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_MUL, ca.OP_SQ, ca.OP_DIV, ca.OP_INV,
    *_PARTNERS, *_ROOTS, *_POWERS, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST,
}  # fmt: skip


class VariationsInLoops:
    """The function of `variations` as code, which `emit` appends to that of a kernel."""

    def __init__(self, field: ca.Function, varied: tuple[int, ...], columns: int, order: int):
        self.n, self.watched, self.columns, self.order = field.numel_out(0), field.numel_out(1), columns, order
        parts, extended, self.slopes, self.forces = separated_variations(field, varied)
        self.instructions = single_assignment(extended)
        self.matrices = [matrix.sparsity().get_triplet() for matrix in (parts.rates, parts.multiples, parts.arguments)]
        numbers = [matrix.nz[:] for matrix in (parts.rates, parts.multiples, parts.arguments)]
        self.linear = ca.Function("linear", [field.sx_in(1)], [ca.densify(ca.SX(each)) for each in numbers])

    @property
    def able(self) -> bool:
        """Whether every operation has a loop."""
        return {op for op, *_ in self.instructions} <= _LOOPED

    @property
    def products(self) -> int:
        """The number of products of the columns' series, by which the graph of `variations` is long."""
        return len(self.slopes) * self.columns * (self.order + 1) * self.order // 2

    def emit(self, code: Any, x: Sequence, p: Sequence, dx: Sequence, dp: Sequence) -> tuple[list, list, int]:
        """The coefficients of `variations` from its arguments: those of the solution and the first two and last two of
        the columns, as functions that load them; and the place of the coefficients of the columns."""
        base, stride, count = _Series(code, self.order), self.order + 2, len(self.slopes) + len(self.forces)
        first, watched = code.reserve(stride * len(dx)), code.reserve(stride * self.watched)
        states: list[int] = []

        def body(arguments: list) -> None:
            x, p, dx, dp = arguments
            states.extend(base.solve(self.instructions, x, p, self.n))
            zero = code.splat(0)
            self._columns(
                code, base, [base.outputs.get((1, self.watched + i), zero) for i in range(count)], p, dx, dp, first
            )
            for i in range(self.watched):
                row = base.outputs.get((1, i), zero)
                for k in range(self.order + 1):
                    code.put(base.coefficient(row, k), code.place(watched + i * stride + k))

        code.apart(body, [x, p, dx, dp])
        places = [*states, *range(watched, watched + stride * self.watched, stride)]
        c = [code.later(place, k) for place in places for k in range(self.order + 1)]
        ends = 0, 1, self.order - 1, self.order
        return c, [code.later(first + q * stride, k) for q in range(len(dx)) for k in ends], first

    def after(self, code: Any, first: int, h: str) -> list:
        """The columns after a time, by Horner's rule, as functions that load them; `first` is as of `emit`."""
        stride, count = self.order + 2, self.n * self.columns
        places = code.reserve(count)

        def body(arguments: list) -> None:
            ((step,),) = arguments

            def column(q: str, _: list) -> list:
                last = code.offset(code.moved(code.place(first), self.order), q, stride)

                def term(k: str, totals: list) -> list:
                    lower = code.get(code.offset(last, k, -1))
                    return [code.plus(code.times(totals[0], step), lower)]

                code.put(code.loop(1, self.order, term, [code.get(last)])[0], code.offset(code.place(places), q))
                return []

            code.loop(0, count - 1, column, [])

        code.apart(body, [[h]])
        return [code.later(places, q) for q in range(count)]

    def _columns(self, code: Any, base: "_Series", rows: Sequence, p: Sequence, dx: Sequence, dp: Sequence, first: int) -> None:
        """Store the coefficients of the columns from a place on, one state after the other, one column after the
        other."""
        n, stride = self.n, base.stride
        rates, multiples, arguments = (
            [(i, j, value) for i, j, value in zip(*places, values, strict=True)]
            for places, values in zip(self.matrices, code.graph(self.linear, [p]), strict=True)
        )
        varied = code.reserve(max(1, len(dp)))
        for q, value in enumerate(dx):
            code.put(value, code.place(first + q * stride))
        height = len(dp) // self.columns
        for q, value in enumerate(dp):
            code.put(value, code.place(varied + q))
        own = {j: [(i, value) for row, i, value in arguments if row == j] for j, _, _ in arguments}
        # An argument that is one state has the series of that state; others have series of their own.
        alone = {j: terms[0][0] for j, terms in own.items() if len(terms) == 1 and code.is_one(terms[0][1])}
        mixed = {j: code.reserve(stride) for j in own if j not in alone}
        functions = sorted({i for i, _ in self.slopes})
        slopes, forces = rows[: len(self.slopes)], rows[len(self.slopes) :]

        def column(c: str, _: list) -> list:
            own_rows, by_p = code.offset(code.place(first), c, n * stride), code.offset(code.place(varied), c, height)
            state = [code.moved(own_rows, i * stride) for i in range(n)]
            series = {j: state[i] for j, i in alone.items()} | {j: code.place(place) for j, place in mixed.items()}

            def order(k: str, _: list) -> list:
                now = [code.get(code.offset(each, k)) for each in state]
                for j in mixed:
                    code.put(_sum(code, [(now[i], value) for i, value in own[j]]), code.offset(series[j], k))
                moving = [
                    (i, j, row) for (i, j), row in zip(self.slopes, slopes, strict=True) if base.moves(row)
                ]

                def term(at: str, totals: list) -> list:
                    back = code.integer("sub", k, at)
                    moved = {j: code.get(code.offset(series[j], back)) for j in dict.fromkeys(j for _, j, _ in moving)}
                    found = dict(zip(functions, totals, strict=True))
                    for i, j, row in moving:
                        slope = code.get(code.offset(base.place(row), at))
                        found[i] = code.plus(found[i], code.times(slope, moved[j]))
                    return [*found.values()]

                changes = dict(zip(functions, code.loop(0, k, term, [code.splat(0)] * len(functions)), strict=True))
                for (i, j), row in zip(self.slopes, slopes, strict=True):
                    if not base.moves(row):
                        changes[i] = code.plus(changes[i], code.times(row, code.get(code.offset(series[j], k))))
                share = code.get(code.offset(code.place(base.inverses), k, offset=1))
                rises: list[list] = [[] for _ in range(n)]
                for i, j, value in rates:
                    rises[i].append((now[j], value))
                for i, f, value in multiples:
                    if f in changes:
                        rises[i].append((changes[f], value))
                for (i, j), row in zip(self.forces, forces, strict=True):
                    force = code.get(code.offset(base.place(row), k)) if base.moves(row) else base.still_at(row, k)
                    rises[i].append((force, code.get(code.moved(by_p, j))))
                for i, terms in enumerate(rises):
                    code.put(code.times(_sum(code, terms), share), code.offset(state[i], k, offset=1))
                return []

            code.loop(0, self.order - 1, order, [])
            return []

        code.loop(0, self.columns - 1, column, [])


def _sum(code: Any, terms: Sequence[tuple[str, str]]) -> str:
    """The sum of values times factors."""
    total = code.splat(0)
    for n, (value, factor) in enumerate(terms):
        product = value if code.is_one(factor) else code.times(value, factor)
        total = code.plus(total, product) if n else product
    return total


class _Series:
    """The series of the instructions of a field in the scratch memory of a code: the place of one that moves, or the
    value of one that does not change with time."""

    def __init__(self, code: Any, order: int):
        self.code, self.order, self.stride = code, order, order + 2
        self.inverses = code.table([0.0, *(1 / k for k in range(1, order + 3))])
        self.numbers = code.table([float(k) for k in range(order + 2)])
        self.zeros = code.table([1.0, *[0.0] * (order + 1)])
        self.found: list[int | str | None] = []
        self.outputs: dict[tuple[int, int], int | str] = {}
        self.partners: dict[tuple[int, int], int] = {}  # of trigonometric functions, by operation and argument
        self.weighted: dict[int, int] = {}  # the place of the multiples j a[j] of a series a, by its place

    def moves(self, row: int | str) -> bool:
        """Whether a row of `found` changes with time."""
        return isinstance(row, int)

    def place(self, row: int | str) -> str:
        """The pointer to a series."""
        return self.code.place(row)

    def still_at(self, value: str, k: str) -> str:
        """Coefficient k of a constant."""
        return self.code.times(value, self._get(self.zeros, k))

    def coefficient(self, row: int | str, k: int) -> Any:
        """Coefficient k."""
        return self.code.later(row, k)() if isinstance(row, int) else row if k == 0 else self.code.splat(0)

    def new(self, value: str) -> int:
        """The place of a new series whose first coefficient is known."""
        place = self.code.reserve(self.stride)
        self.code.put(value, self.code.place(place))
        return place

    def solve(self, instructions: Sequence, x: Sequence, p: Sequence, n: int) -> list[int]:
        """The places of the series of the states; finds those of all instructions."""
        code, states = self.code, [self.new(value) for value in x]
        firsts: list[str] = []
        for op, inputs, constant in instructions:
            row: int | str | None = None
            first = ""
            if op == ca.OP_INPUT:
                first = (x, p)[inputs[0]][inputs[1]]
                row = states[inputs[1]] if inputs[0] == 0 else first
            elif op == ca.OP_OUTPUT:
                self.outputs[inputs[1], inputs[2]] = self.found[inputs[0]]
            elif constant is not None:
                row = first = code.splat(constant)
            else:
                first = code.operation(op, [firsts[i] for i in inputs])
                if not any(isinstance(self.found[i], int) for i in inputs):
                    row = first
                elif op in _PARTNERS:
                    row = self._with_partner(op, self.found[inputs[0]], first, firsts[inputs[0]])
                else:
                    row = self.new(first)
                if op in (ca.OP_EXP, *_POWERS) and isinstance(row, int):
                    if op != ca.OP_EXP and isinstance(self.found[inputs[1]], int):
                        raise NotImplementedError("a power with an exponent that moves")
                    self._weigh(self.found[inputs[0]])
            self.found.append(row)
            firsts.append(first)
        outputs = [self.outputs.get((0, i), code.splat(0)) for i in range(n)]
        for state, row in zip(states, outputs, strict=True):
            code.put(code.get(code.place(row)) if self.moves(row) else row, code.moved(code.place(state), 1))

        def order(k: str, _: list) -> list:
            for state in states:
                self._weighted_at(state, k)
            done = {*states}
            for (op, inputs, _), row in zip(instructions, self.found, strict=True):
                if isinstance(row, int) and row not in done:
                    done |= self._advance(op, [self.found[i] for i in inputs], row, k)
            share = code.get(code.offset(code.place(self.inverses), k, offset=1))
            for state, row in zip(states, outputs, strict=True):
                rate = self._get(row, k) if isinstance(row, int) else code.splat(0)
                code.put(code.times(rate, share), code.offset(code.place(state), k, offset=1))
            return []

        code.loop(1, self.order, order, [])
        return states

    def _weigh(self, row: Any) -> None:
        if row not in self.weighted:
            self.weighted[row] = self.new(self.code.splat(0))

    def _weighted_at(self, row: int, k: str) -> None:
        """Store coefficient k of the multiples of a series, if they are needed."""
        if row in self.weighted:
            number = self._get(self.numbers, k)
            self._put(self.code.times(number, self._get(row, k)), self.weighted[row], k)

    def _with_partner(self, op: int, argument: Any, first: str, value: str) -> int:
        """The place of a trigonometric function, whose partner is another series beside it."""
        if (op, argument) not in self.partners:
            self._weigh(argument)
            self.partners[op, argument] = self.new(first)
            self.partners[_PARTNERS[op], argument] = self.new(self.code.operation(_PARTNERS[op], [value]))
        return self.partners[op, argument]

    def _get(self, place: int, k: str) -> str:
        return self.code.get(self.code.offset(self.code.place(place), k))

    def _put(self, value: str, place: int, k: str) -> None:
        self.code.put(value, self.code.offset(self.code.place(place), k))

    def _convolved(self, pairs: Sequence[tuple[int, int]], low: int, high: str, k: str) -> list[str]:
        """The sums of a[j] b[k-j] for low <= j <= high of pairs (a, b)."""
        code = self.code

        def term(j: str, totals: list) -> list:
            back = code.integer("sub", k, j)
            products = [code.times(self._get(a, j), self._get(b, back)) for a, b in pairs]
            return [code.plus(total, product) for total, product in zip(totals, products, strict=True)]

        return code.loop(low, high, term, [code.splat(0)] * len(pairs))

    def _advance(self, op: int, inputs: list, row: int, k: str) -> set[int]:
        """Store coefficient k of an operation on series or constants, at least one of which moves; return the places of
        the series that it belongs to."""
        code, (a, b) = self.code, (inputs[0], inputs[-1])
        if op in _PARTNERS:
            argument, other = a, self.partners[_PARTNERS[op], a]
            share, weights = self._get(self.inverses, k), self.weighted[argument]
            by_other, by_own = self._convolved([(weights, other), (weights, row)], 1, k, k)
            for place, total, falls in ((row, by_other, op == ca.OP_COS), (other, by_own, op == ca.OP_SIN)):
                value = code.times(total, share)
                self._put(code.operation(ca.OP_NEG, [value]) if falls else value, place, k)
            changed = {row, other}
        else:
            self._put(self._coefficient(op, a, b, row, k), row, k)
            changed = {row}
        for place in changed:
            self._weighted_at(place, k)
        return changed

    def _coefficient(self, op: int, a: Any, b: Any, row: int, k: str) -> str:
        code = self.code
        now = [self._get(each, k) if isinstance(each, int) else code.splat(0) for each in (a, b)]
        first = [code.get(code.place(each)) if isinstance(each, int) else each for each in (a, b)]
        minus: Callable = lambda u, v: code.operation(ca.OP_SUB, [u, v])  # noqa: E731
        over: Callable = lambda u, v: code.operation(ca.OP_DIV, [u, v])  # noqa: E731
        match op:
            case ca.OP_ADD | ca.OP_SUB | ca.OP_NEG | ca.OP_TWICE | ca.OP_ASSIGN:
                return code.operation(op, now)
            case ca.OP_MUL if not isinstance(a, int):
                return code.times(a, now[1])
            case ca.OP_MUL if not isinstance(b, int):
                return code.times(now[0], b)
            case ca.OP_MUL | ca.OP_SQ:
                return self._convolved([(a, b)], 0, k, k)[0]
            case ca.OP_DIV if not isinstance(b, int):
                return over(now[0], b)
            case ca.OP_DIV:
                return over(minus(now[0], self._convolved([(b, row)], 1, k, k)[0]), first[1])
            case ca.OP_INV:
                total = self._convolved([(a, row)], 1, k, k)[0]
                return over(code.operation(ca.OP_NEG, [total]), first[0])
            case ca.OP_SQRT:
                before = code.integer("sub", k, 1)
                total = self._convolved([(row, row)], 1, before, k)[0]
                return over(minus(now[0], total), code.operation(ca.OP_TWICE, [code.get(code.place(row))]))
        share, weights = self._get(self.inverses, k), self.weighted[a]
        if op == ca.OP_EXP:
            return code.times(self._convolved([(weights, row)], 1, k, k)[0], share)
        by_weights, total = self._convolved([(weights, row), (a, row)], 1, k, k)
        factor = code.times(code.plus(b, code.splat(1)), share)
        return over(minus(code.times(factor, by_weights), total), first[0])


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
        """The number of instructions to compile, about, of which those of the loops are few."""
        return sum(part.n_instructions() for part in (self.before, self.choose, self.after))

    def emit(self, code: Any, arguments: Sequence[Sequence]) -> list[list[str]]:
        """The values of the results, from those of the arguments."""
        c, ends, first = self.series.emit(code, *code.graph(self.before, arguments))
        chosen = code.graph(self.choose, [*arguments, c, ends])
        moved = self.series.after(code, first, chosen[-1][0])
        return code.graph(self.after, [*arguments, c, *chosen, moved])
