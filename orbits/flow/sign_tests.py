"""Whether functions on motions may have a zero in a step: a bound for many steps and functions in one call."""

from collections.abc import Sequence
from functools import partial
from typing import Any

from ..numerics import HIGHEST_ORDER
from ..symbolic import CodedFunction, ElementwiseFunction, Number, VectorCode, cached
from .taylor_step import StepSeries
from .watch import HEAD, may_change_sign


@cached
def sign_tests(rows: int, orders: int, kinds: tuple[tuple[bool, int], ...]) -> ElementwiseFunction:
    """The signs in a step of q affine functions of rows of polynomials, or of their rates, (coefficients, one row after
    the other; length; 1 where the motion begins, else 0; weights (q rows,); offsets (q,)) -> for each (3,), the value
    at the start without the zero there, whether there may be another zero, and the sign at the end.

    kinds : of each, whether its rate is meant, and the order of the zero where the motion begins
    """
    function = may_change_sign(1, 1, False)

    def append(code: VectorCode, arguments: Sequence[Any]) -> list[list[str]]:
        c, (h,), (begins,), weights, offsets = arguments
        number, fresh = partial(Number, code), Number(code, begins) > 0.0
        motion, places = StepSeries.of(code, c, rows), code.table([float(k) for k in range(orders)])
        # A rate is stored one place before the function would be, so that its last coefficient is 0.
        room = orders + HIGHEST_ORDER + 1
        first = code.reserve(room * len(kinds) + 1) + 1
        own = StepSeries(code, first, len(kinds), room - 2)

        def store(k: str, _: list[str]) -> list[str]:
            for i, (by_rate, _order) in enumerate(kinds):
                value = motion.weighted([*enumerate(weights[i * rows : (i + 1) * rows])], k)
                value = value * motion.at(places, k) if by_rate else value
                code.put(value.name, code.offset(code.place(first + i * room - by_rate), k))
            return []

        code.loop(0, orders - 1, store)
        found, zero = list[str](), code.splat(0)
        for i, (by_rate, order) in enumerate(kinds):
            place, offset = first + i * room, zero if by_rate else offsets[i]
            for k in range(orders - by_rate, orders + HIGHEST_ORDER):
                code.put(zero, code.place(place + k))
            terms = own.terms([(i, code.splat(1))], offset, number(h), HEAD + HIGHEST_ORDER)
            (change,), (sign,), _ = code.graph(function, [*terms, [begins], [code.splat(order)], [zero]])
            start = number(terms[0][0])
            begin = fresh.choose(own.at(place, order), start) if order else start
            found += [begin.name, change, sign]
        return [found]

    sizes = [rows * orders, 1, 1, rows * len(kinds), len(kinds)]
    return ElementwiseFunction(CodedFunction(sizes, [3 * len(kinds)], append, (0,)))
