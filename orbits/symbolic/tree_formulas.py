"""Formulas as exact expressions: a numeral is the decimal that is written."""

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction

from .folding import exact_numeral
from .tree import ExactExpression, call, exact_number, power


def _no_note(kind: str, operands: Sequence[ExactExpression]) -> None:
    """Notes nothing."""


def expression_of_nodes(
    nodes: Sequence[tuple], names: Mapping[str, ExactExpression], value: Callable[[str], Fraction] = exact_numeral,
    note: Callable[..., None] = _no_note,
) -> ExactExpression:  # fmt: skip
    """The expression of the operations of a formula, see `Formula.nodes`, whose names stand for expressions.

    value : of a numeral
    note : (kind, operands) is called before each operation with that of "/" and "**", or the name of a function
    """
    stack = list[ExactExpression]()
    for node in nodes:
        kind = node[0]
        if kind == "number":
            stack.append(exact_number(value(node[2])))
        elif kind == "name":
            stack.append(names[node[1]])
        elif kind == "negative":
            stack.append(-stack.pop())
        elif kind == "call":
            note(node[1], stack[-1:])
            stack.append(call(node[1], stack.pop()))
        else:
            right, left = stack.pop(), stack.pop()
            note(kind, (left, right))
            stack.append(_OPERATIONS[kind](left, right))
    return stack.pop()


_OPERATIONS: dict[str, Callable] = {
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "*": lambda left, right: left * right,
    "/": lambda left, right: left / right,
    "**": power,
}
