"""CasADi functions as lists of operations that run on balls, and on power series of balls.

Arb's balls (F. Johansson, IEEE Transactions on Computers 66, 2017) round outward in every operation. So the value of a
program on balls contains the values on all their points, and a series contains all Taylor coefficients.
"""

import operator
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import casadi as ca
from flint import arb, arb_series

from .refusal import Unproved

# A ball, or a power series of balls that is cut off at the context's order.
Value: TypeAlias = Any
# Whole numbers below 2**21, and these over powers of 2 that small, are meant as they stand in a model. Any other
# number there has been rounded.
SIGNIFICANT_BITS = 21
# What is raised where a series is divided by one that may begin with 0.
UNDEFINED = (ZeroDivisionError, ValueError)
# Powers up to this one are products.
LARGEST_PRODUCT = 64


class BallProgram:
    """A CasADi function of one vector as a list of operations; called with a list of values, it gives the list of its
    results.

    Raises `Unproved` for an operation without derivatives, as abs, and for a number that has been rounded.
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]):
        function = ca.Function("program", [ca.vertcat(*inputs)], [ca.densify(ca.vertcat(*outputs))])
        self.outputs = len(outputs)
        self._loads: list[tuple[int, int]] = []
        self._constants: list[tuple[int, arb]] = []
        self._operations: list[tuple[Callable, int, int, int | None]] = []
        self._stores: list[tuple[int, int]] = []
        # CasADi uses places of its work vector again. Each result gets a place of its own, so that loads and constants
        # may go first and stores last.
        places, count = dict[int, int](), 0
        for i in range(function.n_instructions()):
            code, ins, outs = function.instruction_id(i), function.instruction_input(i), function.instruction_output(i)
            if code == ca.OP_OUTPUT:
                self._stores.append((outs[1], places[ins[0]]))
                continue
            used = [places[place] for place in ins] if code not in (ca.OP_INPUT, ca.OP_CONST) else []
            places[outs[0]] = count
            if code == ca.OP_INPUT:
                self._loads.append((count, ins[1]))
            elif code == ca.OP_CONST:
                self._constants.append((count, exact_ball(function.instruction_constant(i))))
            else:
                self._operations.append((operation(code), count, used[0], used[1] if len(used) > 1 else None))
            count += 1
        self._size = count

    def __call__(self, values: Sequence[Value]) -> list[Value]:
        work: list[Value] = [None] * self._size
        for place, value in self._constants:
            work[place] = value
        for place, index in self._loads:
            work[place] = values[index]
        for operate, place, first, second in self._operations:
            work[place] = operate(work[first]) if second is None else operate(work[first], work[second])
        results: list[Value] = [_NULL] * self.outputs
        for index, place in self._stores:
            results[index] = work[place]
        return results


_NULL = arb(0)


def coefficient(value: Value, order: int) -> arb:
    """A Taylor coefficient of a result; a ball is a constant series. It is no number where the series is cut off
    before, as after a division by a series that begins with 0."""
    if isinstance(value, arb_series):
        return value[order] if order < value.prec else arb("nan")
    return value if order == 0 else _NULL


def exact_ball(value: float) -> arb:
    """A number that stands in a model; raises `Unproved` where it has been rounded."""
    mantissa, _ = float(value).as_integer_ratio()
    if abs(mantissa) >= 2**SIGNIFICANT_BITS or (abs(value) < 2.0**-SIGNIFICANT_BITS and value != 0):
        told = "state it as a parameter or in a formula, where its decimal is taken as it stands"
        raise Unproved(f"the model has the rounded number {value!r}: {told}")
    return arb(value)


def operation(code: int) -> Callable:
    """The function of balls that CasADi's operation stands for; raises `Unproved` for one that has none."""
    known = _BINARY.get(code) or _UNARY.get(code)
    if known is None:
        raise Unproved(f"the laws use {_name_of(code)}, which has no Taylor series everywhere")
    return known


def _name_of(code: int) -> str:
    names = {ca.OP_FABS: "abs", ca.OP_SIGN: "sign", ca.OP_FMAX: "max", ca.OP_FMIN: "min"}
    return names.get(code, f"CasADi's operation {code}")


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
    """x**y: a product for whole exponents, a root for halves, exp(y log x) for others, where x has to be positive."""
    if isinstance(y, arb):
        whole = y.unique_fmpz() if y.is_exact() else None
        if whole is not None and abs(int(whole)) <= LARGEST_PRODUCT:
            return _whole_power(x, int(whole))
        halves = (2 * y).unique_fmpz() if y.is_exact() and (2 * y).is_exact() else None
        if halves is not None and abs(int(halves)) <= LARGEST_PRODUCT:
            return _whole_power(x.sqrt(), int(halves))
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


_BINARY: dict[int, Callable] = {
    ca.OP_ADD: operator.add,
    ca.OP_SUB: operator.sub,
    ca.OP_MUL: operator.mul,
    ca.OP_DIV: operator.truediv,
    ca.OP_POW: _ball_power,
    ca.OP_CONSTPOW: _ball_power,
}
_UNARY: dict[int, Callable] = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_NEG: operator.neg,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_TWICE: lambda x: 2 * x,
    ca.OP_INV: lambda x: 1 / x,
    ca.OP_SQRT: lambda x: x.sqrt(),
    ca.OP_EXP: lambda x: x.exp(),
    ca.OP_LOG: lambda x: x.log(),
    ca.OP_EXPM1: _on_both(lambda x: x.expm1(), lambda x: x.exp() - 1),
    ca.OP_LOG1P: _on_both(lambda x: x.log1p(), lambda x: (1 + x).log()),
    ca.OP_SIN: _on_both(_with_bounds(arb.sin, -1, 1), arb_series.sin),
    ca.OP_COS: _on_both(_with_bounds(arb.cos, -1, 1), arb_series.cos),
    ca.OP_TAN: lambda x: x.tan(),
    ca.OP_ASIN: lambda x: x.asin(),
    ca.OP_ACOS: lambda x: x.acos(),
    ca.OP_ATAN: lambda x: x.atan(),
    ca.OP_SINH: _on_both(lambda x: x.sinh(), _sinh),
    ca.OP_COSH: _on_both(lambda x: x.cosh(), _cosh),
    ca.OP_TANH: _on_both(_with_bounds(arb.tanh, -1, 1), lambda x: 1 - 2 / ((2 * x).exp() + 1)),
    ca.OP_ASINH: _on_both(lambda x: x.asinh(), lambda x: (x + (x * x + 1).sqrt()).log()),
    ca.OP_ACOSH: _on_both(lambda x: x.acosh(), lambda x: (x + (x * x - 1).sqrt()).log()),
    ca.OP_ATANH: _on_both(lambda x: x.atanh(), lambda x: ((1 + x) / (1 - x)).log() / 2),
}
