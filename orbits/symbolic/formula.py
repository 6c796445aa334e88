"""Formulas given as text: parsed by an allow-list to a tree of operations, evaluated with NumPy and CasADi alike.

The grammar has numbers, names, ``+ - * / **``, parentheses and the functions of `FUNCTIONS`. Nothing is ever handed to
``eval``; whatever is not on the list is an error that shows the place.
"""

import difflib
import operator
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi
import numpy as np

from ..errors import InputError

MAX_LENGTH = 2000
MAX_NODES = 1000
# Each level of nesting costs a handful of Python frames, so that this stays far from the interpreter's limit.
MAX_DEPTH = 60
BLANKS = " \t\n\r\f\v"

CONSTANTS = {"pi": np.pi}

# The names of each function in NumPy and in CasADi.
_SAME = ("exp", "expm1", "log", "log1p", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "sign")
_INVERSE = ("asin", "acos", "atan", "asinh", "acosh", "atanh")
FUNCTIONS = {
    **{name: (name, name) for name in _SAME},
    **{name: ("arc" + name[1:], name) for name in _INVERSE},
    "abs": ("abs", "fabs"),
}

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)|(?P<operator>\*\*|[-+*/()]))",
    re.ASCII,
)


@dataclass(frozen=True)
class Formula:
    """A parsed formula; call it with a value for every name it uses.

    The values may be floats, NumPy arrays (of any common shape) or CasADi SX or MX expressions; the result is of the
    same kind. Arithmetic without a value gives NaN or inf and no warning: the caller checks.
    """

    text: str
    tree: tuple

    @cached_property
    def names(self) -> frozenset[str]:
        """The names that need a value: all but functions and constants."""
        return frozenset(node[1] for node in _nodes(self.tree) if node[0] == "name" and node[1] not in CONSTANTS)

    @property
    def pieces(self) -> list[str]:
        """The functions in it that have no second derivative somewhere, whatever their argument."""
        return sorted({node[1] for node in _nodes(self.tree) if node[0] == "call" and node[1] in ("abs", "sign")})

    @property
    def terms(self) -> "list[Formula]":
        """The terms of the sum that it is, up to their signs; itself where it is no sum."""
        terms, waiting = [], [self.tree]
        while waiting:
            tree = waiting.pop()
            if tree[0] in ("+", "-"):
                waiting += tree[1:]
            else:
                terms.append(Formula(self.text, tree))
        return terms

    def __call__(self, /, **values: Any) -> Any:
        """The value; raises `InputError` where a name has none."""
        if missing := sorted(self.names - values.keys()):
            raise InputError(f"'{self.text}' needs a value for {', '.join(missing)}")
        kinds = {type(value) for value in values.values() if isinstance(value, casadi.SX | casadi.MX)}
        if kinds:
            return _evaluate(self.tree, values, kinds.pop(), symbolic=True)
        arrays = {name: np.asarray(value, dtype=float) for name, value in values.items()}
        with np.errstate(all="ignore"):
            return _evaluate(self.tree, arrays, np.float64, symbolic=False)


def parse(text: str) -> Formula:
    """Parse `text` into a `Formula`; raises `InputError` that quotes the formula and marks the place."""
    if not isinstance(text, str):
        raise InputError(f"a formula is text, not {type(text).__name__}")
    if len(text) > MAX_LENGTH:
        raise InputError(f"the formula has {len(text)} characters; at most {MAX_LENGTH} are allowed")
    return Formula(text, _Parser(text).parse())


class _Token(NamedTuple):
    kind: str  # "number", "name", "operator" or "end"
    word: str
    position: int


class _Parser:
    """Recursive descent from sums over products, signs and powers to operands, with the precedence of Python."""

    def __init__(self, text: str):
        self.text, self.tokens, self.index, self.nodes, self.depth = text, _tokens(text), 0, 0, 0

    def parse(self) -> tuple:
        tree = self.sum()
        if self.token.kind != "end":
            raise _error(self.text, self.token.position, f"an operator is missing before '{self.token.word}'")
        return tree

    @property
    def token(self) -> _Token:
        return self.tokens[self.index]

    def take(self, *operators: str) -> str:
        """The next token if it is one of `operators`, which is then passed; else ''."""
        if self.token.kind != "operator" or self.token.word not in operators:
            return ""
        self.index += 1
        return self.tokens[self.index - 1].word

    def node(self, *parts) -> tuple:
        self.nodes += 1
        if self.nodes > MAX_NODES:
            raise InputError(f"the formula has more than {MAX_NODES} operations; shorten it")
        return parts

    def nested(self, rule: Callable[[], tuple]) -> tuple:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise _error(self.text, self.token.position, f"nested deeper than {MAX_DEPTH} levels")
        tree = rule()
        self.depth -= 1
        return tree

    def sum(self) -> tuple:
        tree = self.product()
        while sign := self.take("+", "-"):
            tree = self.node(sign, tree, self.product())
        return tree

    def product(self) -> tuple:
        tree = self.signed()
        while sign := self.take("*", "/"):
            tree = self.node(sign, tree, self.signed())
        return tree

    def signed(self) -> tuple:
        sign = self.take("+", "-")
        if not sign:
            return self.power()
        tree = self.nested(self.signed)
        return self.node("negative", tree) if sign == "-" else tree

    def power(self) -> tuple:
        base = self.operand()
        return self.node("**", base, self.nested(self.signed)) if self.take("**") else base

    def operand(self) -> tuple:
        kind, word, position = self.token
        if self.take("("):
            return self.rest_of_parenthesis(position)
        if kind not in ("number", "name"):
            raise _error(self.text, position, "a number, a name or '(' is missing here")
        self.index += 1
        if kind == "number":
            if not np.isfinite(float(word)):
                raise _error(self.text, position, f"the number {word} is too large")
            return self.node("number", float(word))
        if self.take("("):
            if word not in FUNCTIONS:
                raise _error(self.text, position, f"unknown function '{word}'{suggest(word, FUNCTIONS)}")
            return self.node("call", word, self.rest_of_parenthesis(position))
        if word in FUNCTIONS:
            raise _error(self.text, position, f"the function '{word}' needs an argument in parentheses")
        return self.node("name", word)

    def rest_of_parenthesis(self, position: int) -> tuple:
        tree = self.nested(self.sum)
        if not self.take(")"):
            raise _error(self.text, position, "this has no closing parenthesis")
        return tree


def suggest(word: str, known: Collection[str]) -> str:
    """'; did you mean ...' with the nearest known word, else the list of them, or '' when there are none."""
    near = difflib.get_close_matches(word, list(known), n=1)
    if near:
        return f"; did you mean '{near[0]}'?"
    return f"; known: {', '.join(known)}" if known else ""


def _tokens(text: str) -> list[_Token]:
    tokens, position, end = [], 0, len(text.rstrip(BLANKS))
    while position < end:
        match = _TOKEN.match(text, position)
        if match is None or match.lastgroup is None:
            position = len(text) - len(text[position:].lstrip(BLANKS))
            character = text[position] if text[position].isprintable() else f"\\x{ord(text[position]):02x}"
            remedy = ": a power is written **" if character == "^" else ""
            raise _error(text, position, f"'{character}' is not allowed{remedy}")
        tokens.append(_Token(match.lastgroup, match[match.lastgroup], match.start(match.lastgroup)))
        position = match.end()
    return [*tokens, _Token("end", "the end", end)]


def _error(text: str, position: int, problem: str) -> InputError:
    start = max(0, position - 30)
    shown = "".join(c if c.isprintable() else "?" for c in text[start : position + 30])
    return InputError(f"formula, character {position + 1}: {problem}\n    {shown}\n    {' ' * (position - start)}^")


def _nodes(tree: tuple) -> list[tuple]:
    """All nodes, each after its branches; without recursion, as a long sum is a deep tree."""
    nodes, waiting = [], [tree]
    while waiting:
        node = waiting.pop()
        nodes.append(node)
        waiting.extend(branch for branch in node[1:] if isinstance(branch, tuple))
    return nodes[::-1]


def _evaluate(tree: tuple, values: Mapping, constant: type, symbolic: bool):
    """The value of a tree; `constant` turns a number into the kind of the values."""
    stack = []
    for node in _nodes(tree):
        kind = node[0]
        if kind == "number":
            stack.append(constant(node[1]))
        elif kind == "name":
            stack.append(constant(CONSTANTS[node[1]]) if node[1] in CONSTANTS else values[node[1]])
        elif kind == "call":
            numpy_name, casadi_name = FUNCTIONS[node[1]]
            function = getattr(casadi, casadi_name) if symbolic else getattr(np, numpy_name)
            stack.append(function(stack.pop()))
        elif kind == "negative":
            stack.append(-stack.pop())
        else:
            right = stack.pop()
            stack.append(_OPERATORS[kind](stack.pop(), right))
    return stack.pop()


_OPERATORS = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
}
