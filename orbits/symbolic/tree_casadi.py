"""Exact expressions from CasADi's and as CasADi's, with one loop over the operations in either direction."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from math import isfinite, pi

import casadi as ca

from ..errors import InputError
from .calls import single_assignment
from .folding import exact_numeral
from .formula import FUNCTIONS
from .tree import ExactExpression, call, exact_number, in_order, power

# Smaller numbers have fewer digits as doubles, or none.
LEAST_NUMBER = 1e-300
# Arithmetic by the codes of CasADi, on whatever has these operators.
ARITHMETIC: dict[int, Callable] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a**2,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_POW: lambda a, b: a**b,
    ca.OP_CONSTPOW: lambda a, b: a**b,
}
_ARITHMETIC = {**ARITHMETIC, ca.OP_POW: power, ca.OP_CONSTPOW: power}
FUNCTION_NAMES = {getattr(ca, f"OP_{own.upper()}"): name for name, (_, own) in FUNCTIONS.items()}


@dataclass(frozen=True)
class Operation:
    """An operation that only CasADi evaluates, as the smaller of two numbers; or, without operands, a number that is
    not finite."""

    code: int
    number: str = ""

    @property
    def parity(self) -> int:
        """-1 for an odd function, 0 for another."""
        return -1 if self.code == ca.OP_ERF else 0

    def lowered(self, parts: Sequence[ca.SX]) -> ca.SX:
        """The operation on CasADi's expressions."""
        if self.number:
            return ca.SX(float(self.number))
        return (ca.SX.unary if len(parts) == 1 else ca.SX.binary)(self.code, *parts)

    def slopes(self, parts: Sequence[ExactExpression]) -> list[ExactExpression]:
        """The derivatives by the operands."""
        symbols = [ca.SX.sym(f"x{i}") for i in range(len(parts))]
        own = self.lowered(symbols)
        found = [ca.jacobian(own, each) for each in symbols]
        return lifted(found, dict(zip(symbols, parts, strict=True))) if parts else []


def lowered(outputs: Sequence[ExactExpression], symbols: Mapping[ExactExpression, ca.SX]) -> list[ca.SX]:
    """Expressions as CasADi's, where equal parts are one; raises `InputError` for a number without a double."""
    found = dict(symbols)
    for each in in_order(outputs):
        if each not in found:
            found[each] = _lowered(each, [found[part] for part in each.parts])
    return [found[each] for each in outputs]


def _lowered(each: ExactExpression, parts: list[ca.SX]) -> ca.SX:
    match each.kind:
        case "number":
            return ca.SX(rounded(each.value))
        case "pi":
            return ca.SX(pi)
        case "+":
            return parts[0] + parts[1]
        case "*":
            return parts[0] * parts[1]
        case "/":
            return parts[0] / parts[1]
        case "**":
            return parts[0] ** each.value
        case "power":
            return parts[0] ** parts[1]
        case "operation":
            return each.value.lowered(parts)
    return getattr(ca, FUNCTIONS[each.kind][1])(parts[0])


def rounded(number: Fraction) -> float:
    """The nearest double; raises `InputError` where that has fewer digits or is infinite."""
    value = float(number) if abs(number) < Fraction(10) ** 308 else float("inf")
    if isfinite(value) and (abs(value) >= LEAST_NUMBER or not number):
        return value
    size = Decimal(abs(number.numerator)) / Decimal(number.denominator)
    bound = f"below {LEAST_NUMBER:g}" if size < 1 else "above 1e308"
    raise InputError(f"a coefficient of the machine has the size {size:.2e}, {bound}: state it in other units")


def exact_value(text: str) -> ExactExpression:
    """The number that a numeral is; pi is the double that CasADi has for it, so that pi/180 is a number too."""
    return exact_number(Fraction(pi) if text == "pi" else exact_numeral(text))


def lifted(outputs: Sequence[ca.SX], symbols: Mapping[ca.SX, ExactExpression]) -> list[ExactExpression]:
    """CasADi's scalar expressions as exact ones, in which doubles are the rational numbers that they are.

    symbols : an exact expression for each scalar symbol in them
    """
    function = ca.Function("lifted", [ca.vertcat(*symbols)], [ca.densify(ca.vertcat(*outputs))])
    inputs, found = list(symbols.values()), list[ExactExpression]()
    results = dict[int, ExactExpression]()
    for operation, places, constant in single_assignment(function):
        if operation == ca.OP_INPUT:
            found.append(inputs[places[1]])
        elif operation == ca.OP_OUTPUT:
            results[places[2]] = found[places[0]]
            found.append(found[places[0]])
        elif constant is not None:
            finite = isfinite(constant)
            own = Operation(operation, str(constant))
            found.append(exact_number(Fraction(constant)) if finite else ExactExpression.of("operation", (), own))
        else:
            found.append(_lifted(operation, [found[place] for place in places]))
    return [results[i] for i in range(len(outputs))]


def _lifted(operation: int, parts: list[ExactExpression]) -> ExactExpression:
    if operation in _ARITHMETIC:
        return _ARITHMETIC[operation](*parts)
    if operation in FUNCTION_NAMES:
        return call(FUNCTION_NAMES[operation], parts[0])
    return ExactExpression.of("operation", tuple(parts), Operation(operation))
