"""Exact expressions as lists of operations that run on balls, and on power series of balls.

Arb's balls (F. Johansson, IEEE Transactions on Computers 66, 2017) round outward in every operation. So the value of a
program on balls contains the values on all their points, and a series contains all Taylor coefficients.
"""

import operator
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Generic, TypeAlias, TypeVar

from flint import arb, arb_series, ctx, fmpq

from ..exact import Unproved
from ..symbolic import ExactExpression, in_order

# A ball, or a power series of balls that is cut off at the context's order.
Value: TypeAlias = Any
Built = TypeVar("Built")
# The errors where a series is divided by one that may begin with 0.
UNDEFINED = (ZeroDivisionError, ValueError)
# Whole powers up to this exponent are computed as products.
LARGEST_PRODUCT = 2**20


class EachLaw(Generic[Built]):
    """What is built for each law of a phase, where it is first needed: of a table, a motion passes few pieces."""

    def __init__(self, build: Callable[[int], Built]):
        self._build, self._known = build, dict[int, Built]()

    def __getitem__(self, law: int) -> Built:
        if law not in self._known:
            self._known[law] = self._build(law)
        return self._known[law]


class BallProgram:
    """Expressions of some symbols as a list of operations; called with a list of values, it returns the list of its
    results. Constants are computed once for each precision.

    Raises `Unproved` for a power that is too large, and `ValueError` where a symbol has no value.
    """

    def __init__(self, inputs: Sequence[ExactExpression], outputs: Sequence[ExactExpression]):
        order = in_order(outputs)
        place = {each: i for i, each in enumerate(inputs)}
        if missing := [each for each in order if each.kind == "symbol" and each not in place]:
            raise ValueError(f"no value for {missing[0]!r}")
        moving = set[ExactExpression]()
        for each in order:
            if each in place or any(part in moving for part in each.parts):
                moving.add(each)
        # The constants that are needed by other operations or results follow the inputs.
        self._constant_expressions = [each for each in order if each not in moving]
        needed = {part for each in order if each in moving for part in each.parts} | {*outputs}
        self._constants = [each for each in self._constant_expressions if each in needed]
        place |= {each: len(inputs) + i for i, each in enumerate(self._constants)}
        self._operations: list[tuple[Callable, int, int | None]] = []
        for each in order:
            if each in moving and each not in place:
                place[each] = len(inputs) + len(self._constants) + len(self._operations)
                first, *second = (place[part] for part in each.parts)
                self._operations.append((operation(each), first, second[0] if second else None))
        self._stores = [place[each] for each in outputs]
        self._cached: tuple[int, list[arb]] = (0, [])
        self._count = len(inputs)

    def __call__(self, values: Sequence[Value]) -> list[Value]:
        if len(values) != self._count:  # else constants would be taken for inputs
            raise ValueError(f"{len(values)} values for {self._count} symbols")
        work = [*values, *self._balls()]
        for operate, first, second in self._operations:
            work.append(operate(work[first]) if second is None else operate(work[first], work[second]))
        return [work[place] for place in self._stores]

    def _balls(self) -> list[arb]:
        """Enclosures of the constants, at the precision of the context."""
        precision, balls = self._cached
        if precision != ctx.prec:
            found = dict[ExactExpression, arb]()
            for each in self._constant_expressions:
                found[each] = _constant_ball(each, [found[part] for part in each.parts])
            balls = [found[each] for each in self._constants]
            self._cached = ctx.prec, balls
        return balls


def ball_of_fraction(value: Fraction) -> arb:
    """An enclosure of a fraction."""
    return arb(fmpq(value.numerator, value.denominator))


def _constant_ball(each: ExactExpression, parts: Sequence[arb]) -> arb:
    if each.kind == "number":
        return ball_of_fraction(each.value)
    return arb.pi() if each.kind == "pi" else operation(each)(*parts)


def coefficient(value: Value, order: int) -> arb:
    """A Taylor coefficient of a result; a ball is a constant series. It is not a number where the series is cut off
    before, for example after a division by a series that begins with 0."""
    if isinstance(value, arb_series):
        return value[order] if order < value.prec else arb("nan")
    return value if order == 0 else _NULL


_NULL = arb(0)


def operation(each: ExactExpression) -> Callable:
    """The function of balls that computes an expression's operation."""
    if each.kind == "**":
        exponent = each.value
        if abs(exponent) > LARGEST_PRODUCT:
            raise Unproved(f"the power {exponent} is too large for a proof")
        return lambda x: _whole_power(x, exponent)
    return _OPERATIONS[each.kind]


def series_function(name: str) -> Callable | None:
    """The function of power series with the name of an elementary function; None for another name."""
    return _OPERATIONS.get(name) if name.isalnum() and name != "power" else None


def _with_bounds(function: Callable, low: int, high: int) -> Callable:
    """A function of balls whose values lie between bounds, also on the ball of all numbers."""
    whole = arb(low).union(arb(high))
    return lambda x: function(x) if x.is_finite() or x.is_nan() else whole


def _on_both(of_ball: Callable, of_series: Callable) -> Callable:
    return lambda x: of_series(x) if isinstance(x, arb_series) else of_ball(x)


def _exponential_pair(x: arb_series) -> tuple[arb_series, arb_series]:
    return x.exp(), (-x).exp()


def _sinh(x: arb_series) -> arb_series:
    grown, shrunk = _exponential_pair(x)
    return (grown - shrunk) / 2


def _cosh(x: arb_series) -> arb_series:
    grown, shrunk = _exponential_pair(x)
    return (grown + shrunk) / 2


def _ball_power(x: Value, y: Value) -> Value:
    """x**y for an exponent that is not a whole number, where x is positive."""
    return (y * x.log()).exp()


def _whole_power(x: Value, n: int) -> Value:
    if n < 0:
        return 1 / _whole_power(x, -n)
    result, square = None, x  # not x**n, which Arb takes by logarithms where x is near 0
    while n:
        if n & 1:
            result = square if result is None else result * square
        n >>= 1
        if n:
            square = square * square
    return arb(1) if result is None else result


_OPERATIONS: dict[str, Callable] = {
    "+": operator.add,
    "*": operator.mul,
    "/": operator.truediv,
    "power": _ball_power,
    "sqrt": lambda x: x.sqrt(),
    "exp": lambda x: x.exp(),
    "log": lambda x: x.log(),
    "expm1": _on_both(lambda x: x.expm1(), lambda x: x.exp() - 1),
    "log1p": _on_both(lambda x: x.log1p(), lambda x: (1 + x).log()),
    "sin": _on_both(_with_bounds(lambda x: x.sin(), -1, 1), arb_series.sin),
    "cos": _on_both(_with_bounds(lambda x: x.cos(), -1, 1), arb_series.cos),
    "tan": lambda x: x.tan(),
    "asin": lambda x: x.asin(),
    "acos": lambda x: x.acos(),
    "atan": lambda x: x.atan(),
    "sinh": _on_both(lambda x: x.sinh(), _sinh),
    "cosh": _on_both(lambda x: x.cosh(), _cosh),
    "tanh": _on_both(_with_bounds(lambda x: x.tanh(), -1, 1), lambda x: 1 - 2 / ((2 * x).exp() + 1)),
    "asinh": _on_both(lambda x: x.asinh(), lambda x: (x + (x * x + 1).sqrt()).log()),
    "acosh": _on_both(lambda x: x.acosh(), lambda x: (x + (x * x - 1).sqrt()).log()),
    "atanh": _on_both(lambda x: x.atanh(), lambda x: ((1 + x) / (1 - x)).log() / 2),
}
