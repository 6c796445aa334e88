"""Formulas as text: an allow-list parser to one expression tree that evaluates on NumPy and on CasADi alike.

Grammar: numbers, names, ``+ - * / **``, parentheses and the functions of `FUNCTIONS`. Nothing is ever handed to
``eval``; what is not on the list is an error that shows the place.
"""

import difflib
import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi
import numpy as np

from ..errors import InputError

MAX_LENGTH = 2000
MAX_NODES = 1000
# Each level of nesting costs a handful of Python frames, so this stays far from the interpreter's limit.
MAX_DEPTH = 60
BLANKS = " \t\n\r\f\v"

CONSTANTS = {"pi": np.pi}

# name -> (NumPy's name, CasADi's name)
FUNCTIONS = {
    "exp": ("exp", "exp"),
    "expm1": ("expm1", "expm1"),
    "log": ("log", "log"),
    "log1p": ("log1p", "log1p"),
    "sqrt": ("sqrt", "sqrt"),
    "sin": ("sin", "sin"),
    "cos": ("cos", "cos"),
    "tan": ("tan", "tan"),
    "asin": ("arcsin", "asin"),
    "acos": ("arccos", "acos"),
    "atan": ("arctan", "atan"),
    "sinh": ("sinh", "sinh"),
    "cosh": ("cosh", "cosh"),
    "tanh": ("tanh", "tanh"),
    "asinh": ("arcsinh", "asinh"),
    "acosh": ("arccosh", "acosh"),
    "atanh": ("arctanh", "atanh"),
    "abs": ("abs", "fabs"),
    "sign": ("sign", "sign"),
}

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)|(?P<operator>\*\*|[-+*/()]))",
    re.ASCII,
)


@dataclass(frozen=True)
class Formula:
    """A parsed formula; call it with a value for every name it uses.

    The values may be floats, NumPy arrays (any common shape) or CasADi SX/MX expressions; the result is of the same
    kind. Arithmetic that has no value gives NaN or inf, never a warning: the caller checks.
    """

    text: str
    tree: tuple

    @cached_property
    def names(self) -> frozenset[str]:
        """The names that must be given a value: everything but functions and constants."""
        return frozenset(node[1] for node in _nodes(self.tree) if node[0] == "name" and node[1] not in CONSTANTS)

    @property
    def pieces(self) -> list[str]:
        """The functions in it that have no second derivative somewhere, whatever is inside."""
        return sorted({node[1] for node in _nodes(self.tree) if node[0] == "call" and node[1] in ("abs", "sign")})

    @property
    def terms(self) -> "list[Formula]":
        """What it is the sum of: itself, where it is no sum."""
        terms, waiting = [], [self.tree]
        while waiting:
            tree = waiting.pop()
            if tree[0] in ("+", "-"):
                waiting += tree[1:]
            else:
                terms.append(Formula(self.text, tree))
        return terms

    def __call__(self, /, **values):
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


class _Parser:
    """Recursive descent: sum > product > sign > power > atom, as in Python."""

    def __init__(self, text: str):
        self.text, self.tokens, self.index, self.nodes, self.depth = text, _tokens(text), 0, 0, 0

    def parse(self) -> tuple:
        tree = self.sum()
        kind, word, position = self.token
        if kind != "end":
            raise _error(self.text, position, f"an operator is missing before '{word}'")
        return tree

    @property
    def token(self):
        return self.tokens[self.index]

    def take(self, *words: str):
        kind, word, _ = self.token
        if kind == "operator" and word in words:
            self.index += 1
            return word
        return None

    def node(self, *parts) -> tuple:
        self.nodes += 1
        if self.nodes > MAX_NODES:
            raise InputError(f"the formula has more than {MAX_NODES} operations; shorten it")
        return parts

    def deeper(self, rule):
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise _error(self.text, self.token[2], f"nested deeper than {MAX_DEPTH} levels")
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
        if sign is None:
            return self.power()
        tree = self.deeper(self.signed)
        return self.node("negative", tree) if sign == "-" else tree

    def power(self) -> tuple:
        base = self.atom()
        return self.node("**", base, self.deeper(self.signed)) if self.take("**") else base

    def atom(self) -> tuple:
        kind, word, position = self.token
        if self.take("("):
            return self.closed(position)
        self.index += kind in ("number", "name")
        if kind == "number":
            if not np.isfinite(float(word)):
                raise _error(self.text, position, f"the number {word} is too large")
            return self.node("number", float(word))
        if kind == "name":
            if self.take("("):
                if word not in FUNCTIONS:
                    raise _error(self.text, position, f"unknown function '{word}'{suggest(word, FUNCTIONS)}")
                return self.node("call", word, self.closed(position))
            if word in FUNCTIONS:
                raise _error(self.text, position, f"the function '{word}' needs an argument in parentheses")
            return self.node("name", word)
        raise _error(self.text, position, "a number, a name or '(' is missing here")

    def closed(self, position: int) -> tuple:
        tree = self.deeper(self.sum)
        if not self.take(")"):
            raise _error(self.text, position, "this has no closing parenthesis")
        return tree


def suggest(word: str, known) -> str:
    """'; did you mean ...' for the nearest known word, or the list of them, or nothing when there are none."""
    near = difflib.get_close_matches(word, list(known), n=1)
    if near:
        return f"; did you mean '{near[0]}'?"
    return f"; known: {', '.join(known)}" if known else ""


def _tokens(text: str) -> list[tuple[str, str, int]]:
    tokens, position, end = [], 0, len(text.rstrip(BLANKS))
    while position < end:
        match = _TOKEN.match(text, position)
        if match is None:
            position += len(text[position:]) - len(text[position:].lstrip(BLANKS))
            remedy = ": a power is written **" if text[position] == "^" else ""
            raise _error(text, position, f"'{_visible(text[position])}' is not allowed{remedy}")
        tokens.append((match.lastgroup, match[match.lastgroup], match.start(match.lastgroup)))
        position = match.end()
    return [*tokens, ("end", "the end", end)]


def _visible(character: str) -> str:
    """What a terminal may be given for a character."""
    return character if character.isprintable() else f"\\x{ord(character):02x}"


def _error(text: str, position: int, problem: str) -> InputError:
    start = max(0, position - 30)
    shown = "".join(c if c.isprintable() else "?" for c in text[start : position + 30])
    return InputError(f"formula, character {position + 1}: {problem}\n    {shown}\n    {' ' * (position - start)}^")


def _nodes(tree: tuple) -> list[tuple]:
    """Every node, each after its branches; without recursion, as a long sum is a deep tree."""
    nodes, waiting = [], [tree]
    while waiting:
        node = waiting.pop()
        nodes.append(node)
        waiting.extend(branch for branch in node[1:] if isinstance(branch, tuple))
    return nodes[::-1]


def _evaluate(tree: tuple, values: Mapping, constant: type, symbolic: bool):
    """The value of a tree; `constant` makes a number one of the values' kind."""
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
