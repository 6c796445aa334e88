"""Formulas from text: parsed by an allow-list to a tree of operations, evaluated with NumPy and CasADi alike.

The grammar has numbers, names, ``+ - * / **``, parentheses and the functions of `FUNCTIONS`. Nothing is ever handed to
``eval``; whatever is not on the list is an error that shows the place. Python's own parser gives the precedence.
"""

import ast
import difflib
import operator
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import casadi
import numpy as np

from ..errors import InputError
from .folding import folded

# Each level of nesting costs a handful of Python frames, so that the depth stays far from the interpreter's limit.
MAX_LENGTH, MAX_NODES, MAX_DEPTH = 2000, 1000, 60
BLANKS = " \t\n\r\f\v"
CONSTANTS = {"pi": np.pi}
# The names of each function in NumPy and in CasADi.
_SAME = ("exp", "expm1", "log", "log1p", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "sign")
FUNCTIONS = {
    **{name: (name, name) for name in _SAME},
    **{name: ("arc" + name[1:], name) for name in ("asin", "acos", "atan", "asinh", "acosh", "atanh")},
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
    same kind. Arithmetic without a value gives NaN or inf and no warning: the caller checks. The value of numerals
    alone is exact before it is rounded, see `folding`; `tree` is the formula as it is written.
    """

    text: str
    tree: tuple

    @cached_property
    def names(self) -> frozenset[str]:
        """The names that need a value: all but functions and constants."""
        return frozenset(node[1] for node in _nodes(self.tree) if node[0] == "name" and node[1] not in CONSTANTS)

    @cached_property
    def folded(self) -> tuple:
        """The tree with its numerals worked out in rational numbers."""
        return folded(_nodes(self.tree))

    @property
    def nodes(self) -> list[tuple]:
        """The operations as they are written, each after those of its operands: ("number", float, text),
        ("name", name), ("call", function, ...), ("negative", ...), or an operator with its two operands."""
        return _nodes(self.tree)

    @cached_property
    def folded_nodes(self) -> list[tuple]:
        """These operations with numerals worked out, whose texts may then be quotients, as "1/3"."""
        return _nodes(self.folded)

    @property
    def pieces(self) -> list[str]:
        """The functions in it that have no second derivative somewhere, whatever their argument."""
        return sorted({node[1] for node in _nodes(self.tree) if node[0] == "call" and node[1] in ("abs", "sign")})

    def without_value(self, variable: str, values: Mapping[str, float]) -> str | None:
        """The first part of the formula that does not depend on a variable and has no finite value, as text; None where
        each has one."""
        stack: list[tuple[str, Any]] = []  # of each branch its text and its value, None where it varies
        for node in _nodes(self.folded):
            parts = [stack.pop() for part in node[1:] if isinstance(part, tuple)][::-1]
            texts = [text if re.fullmatch(r"[-+.\w]+|\w+\(.*\)", text) else f"({text})" for text, _ in parts]
            match node[0]:
                case "number" | "name":
                    text = node[-1] if node[0] == "name" else node[2]
                case "call":
                    text = f"{node[1]}({parts[0][0]})"
                case "negative":
                    text = f"-{texts[0]}"
                case operation:
                    text = operation.join(texts)
            value = None
            if node != ("name", variable) and all(known is not None for _, known in parts):
                operands = [("number", known, text) for text, known in parts]
                called = node[1:2] if node[0] == "call" else ()
                with np.errstate(all="ignore"):
                    own = (node[0], *called, *operands) if operands else node
                    value = _evaluate(own, values, np.float64, np)
                if not np.isfinite(value):
                    return text
            stack.append((text, value))
        return None

    @property
    def terms(self) -> "list[Formula]":
        """The terms of the formula as a sum, up to their signs; the formula itself where it is not a sum."""
        terms, waiting = [], [self.tree]
        while waiting:
            if (tree := waiting.pop())[0] in ("+", "-"):
                waiting += tree[1:]
            else:
                terms.append(Formula(self.text, tree))
        return terms

    def __call__(self, /, **values: object) -> Any:
        """The value; raises `InputError` where a name has none."""
        if missing := sorted(self.names - values.keys()):
            raise InputError(f"'{self.text}' needs a value for {', '.join(missing)}")
        kinds = {type(value) for value in values.values() if isinstance(value, casadi.SX | casadi.MX)}
        if kinds:
            return _evaluate(self.folded, values, kinds.pop(), casadi)
        arrays = {name: np.asarray(value, dtype=float) for name, value in values.items()}
        with np.errstate(all="ignore"):
            return _evaluate(self.folded, arrays, np.float64, np)


def parse(text: str) -> Formula:
    """Parse `text` into a `Formula`; raises `InputError` that quotes the formula and marks the place."""
    if not isinstance(text, str):
        raise InputError(f"a formula is text, not {type(text).__name__}")
    if len(text) > MAX_LENGTH:
        raise InputError(f"the formula has {len(text)} characters; at most {MAX_LENGTH} are allowed")
    return _checked_formula(text)


@lru_cache(maxsize=256)
def _checked_formula(text: str) -> Formula:
    tokens = _tokens(text)
    _check_tokens(text, tokens)
    # Python's parser sees numbers and names as plain names: keywords may be names here, and 007 is a number.
    words = [f"_{i}" if kind in ("number", "name") else word for i, (kind, word, _) in enumerate(tokens[:-1])]
    return Formula(text, _as_tuples(ast.parse(" ".join(words), mode="eval").body, tokens))


class _Token(NamedTuple):
    kind: str  # "number", "name", "operator" or "end"
    word: str
    position: int


def _check_tokens(text: str, tokens: list[_Token]) -> None:
    """Raise the error of the first token that cannot stand where it is."""
    opened: list[int] = []  # the places of the parentheses that are open
    pending = [0]  # the signs and powers, outside and within each of them, whose operand has not ended
    operand_next, count, end = True, 0, tokens[-1]
    for before, token, after in zip([end, *tokens], tokens, [*tokens[1:], end], strict=False):
        kind, word, position = token
        count += word not in ("(", ")")
        if operand_next:
            if word == "(":
                opened.append(before.position if before.kind == "name" else position)
                pending.append(0)
            elif word in ("+", "-"):
                count -= word == "+"
                pending[-1] += 1
            else:
                operand_next = _is_call(text, token, after)
        elif word == ")" and opened:
            opened.pop()
            pending.pop()
        elif word in _OPERATORS:
            operand_next = True
            pending[-1] = pending[-1] + 1 if word == "**" else 0
        elif opened:
            raise _error(text, opened[-1], "this has no closing parenthesis")
        elif kind != "end":
            raise _error(text, position, f"an operator is missing before '{word}'")
        if len(opened) + sum(pending) > MAX_DEPTH:
            raise _error(text, after.position, f"nested deeper than {MAX_DEPTH} levels")
    if count - 1 > MAX_NODES:
        raise InputError(f"the formula has more than {MAX_NODES} operations; shorten it")


def _is_call(text: str, token: _Token, following: _Token) -> bool:
    """Whether a token where an operand must stand is a function, whose argument follows; raises if it is not an
    operand."""
    kind, word, position = token
    if kind not in ("number", "name"):
        raise _error(text, position, "a number, a name or '(' is missing here")
    if kind == "number" and not np.isfinite(float(word)):
        raise _error(text, position, f"the number {word} is too large")
    if kind == "name" and word.lower() in ("nan", "inf", "infinity"):
        raise _error(text, position, f"'{word}' is neither a number nor a name")
    called = kind == "name" and following.word == "("
    if called and word not in FUNCTIONS:
        raise _error(text, position, f"unknown function '{word}'{suggest(word, FUNCTIONS)}")
    if word in FUNCTIONS and not called:
        raise _error(text, position, f"the function '{word}' needs an argument in parentheses")
    return called


def _as_tuples(node: ast.expr, tokens: list[_Token]) -> tuple:
    """Python's syntax tree as one of tuples; operators that associate to the left need no recursion."""
    chain: list[ast.BinOp] = []
    while isinstance(node, ast.BinOp):
        chain.append(node)
        node = node.left
    match node:
        case ast.Name(id=place):
            kind, word, _ = tokens[int(place[1:])]
            tree: tuple = (kind, float(word), word) if kind == "number" else (kind, word)
        case ast.Call(func=ast.Name(id=place), args=[argument], keywords=[]):
            tree = ("call", tokens[int(place[1:])].word, _as_tuples(argument, tokens))
        case ast.UnaryOp(op=sign, operand=operand):
            tree = _as_tuples(operand, tokens)
            tree = ("negative", tree) if isinstance(sign, ast.USub) else tree
        case _:
            raise AssertionError(f"{type(node).__name__} cannot stand in a formula")
    for parent in reversed(chain):
        right = _as_tuples(parent.right, tokens)
        if isinstance(parent.op, ast.Pow) and right[0] == "number" and _is_whole(right):
            right = (*right, "whole")  # exact as a float, so that no symbol stands for it
        tree = (_SIGNS[type(parent.op)], tree, right)
    return tree


def _is_whole(number: tuple) -> bool:
    """Whether the decimal of a numeral is a whole number, and not only the float to which it is rounded."""
    _, value, text = number
    return value.is_integer() and Decimal(text) == int(value)


_SIGNS: dict[type, str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}


def suggest(word: object, known: Collection[str]) -> str:
    """'; did you mean ...' with the nearest known word, else the list of them, or '' when there are none."""
    if near := difflib.get_close_matches(str(word), list(known), n=1):
        return f"; did you mean '{near[0]}'?"
    return f"; known: {', '.join(known)}" if known else ""


def _tokens(text: str) -> list[_Token]:
    tokens, position, end = [], 0, len(text.rstrip(BLANKS))
    while position < end:
        if (match := _TOKEN.match(text, position)) is None or match.lastgroup is None:
            position = len(text) - len(text[position:].lstrip(BLANKS))
            character = text[position] if text[position].isprintable() else f"\\x{ord(text[position]):02x}"
            remedy = ": write a power as **" if character == "^" else ""
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


def _evaluate(tree: tuple, values: Mapping, constant: type, library):
    """The value of a tree; `constant` turns a number into the kind of the values, `library` has their functions."""
    stack = []
    for node in _nodes(tree):
        kind = node[0]
        if kind == "number":
            known = _numerals is None or library is np or len(node) == 4
            stack.append(constant(node[1]) if known else _numeral(node[2]))
        elif kind == "name" and node[1] in CONSTANTS:
            known = _numerals is None or library is np
            stack.append(constant(CONSTANTS[node[1]]) if known else _numeral(node[1]))
        elif kind == "name":
            stack.append(values[node[1]])
        elif kind == "call":
            stack.append(getattr(library, FUNCTIONS[node[1]][library is casadi])(stack.pop()))
        elif kind == "negative":
            stack.append(-stack.pop())
        else:
            right = stack.pop()
            stack.append(_OPERATORS[kind](stack.pop(), right))
    return stack.pop()


# The symbols of the numerals by their texts while `symbolic_numerals` is open.
_numerals: dict[str, casadi.SX] | None = None


@contextmanager
def symbolic_numerals(symbols: dict[str, casadi.SX]) -> Iterator[None]:
    """Formulas evaluated with CasADi expressions in this block take a symbol for each numeral, and for pi, in place of
    a rounded number. The mapping from the texts of the numerals to their symbols grows as formulas are evaluated; a
    text may be a quotient, as "1/3".

    Nothing that is stored for later may be built in the block: it would contain the symbols.
    """
    global _numerals
    before, _numerals = _numerals, symbols
    try:
        yield
    finally:
        _numerals = before


def _numeral(text: str) -> casadi.SX:
    assert _numerals is not None
    return _numerals.setdefault(text, casadi.SX.sym(text))


_OPERATORS = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "**": operator.pow}
