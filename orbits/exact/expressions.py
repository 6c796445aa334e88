"""Exact expressions: operations on symbols and rational numbers, differentiated and written as programs of balls.

Nothing is rounded, and only exact simplifications are made: a sum or a product of rational numbers becomes a number,
and 0 + x, 1 x, x - x and 0 x become x, x, 0 and 0. The last two may lose a place where x has no value. So whatever
restricts the domain of a stated formula (a quotient, a root, a logarithm, a power) is collected beside it, see
`orbits.exact.formulas.Domain`, and is checked along the whole motion, whether or not it remains in the expression.

Equal expressions are one object, so that common parts are computed once.
"""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from math import isqrt
from typing import Any, ClassVar, Union
from weakref import WeakValueDictionary

from flint import Ordering, fmpq, fmpq_mpoly_ctx

# An expression, or an exact number that stands for one.
Operand = Union["ExactExpression", Fraction, int]
# Powers of numbers up to this exponent, with results of at most these bits, become numbers; others stay powers.
LARGEST_EXPONENT, MOST_BITS = 512, 20_000
# The largest power and the most terms of a polynomial that are expanded to decide whether an expression is 0.
LARGEST_EXPANDED, MOST_EXPANDED_TERMS = 24, 3000


class ExactExpression:
    """An operation on other expressions: `kind` is "number", "symbol", "pi", "+", "*", "/", "**" with a whole exponent,
    "power" with any other, or a function's name.

    parts : the operands
    value : the Fraction of a number, the name of a symbol, the exponent of "**"
    """

    __slots__ = ("__weakref__", "_slopes", "kind", "parts", "value")

    _known: ClassVar["WeakValueDictionary[tuple, ExactExpression]"] = WeakValueDictionary()

    kind: str
    parts: tuple["ExactExpression", ...]
    value: Any
    _slopes: dict["ExactExpression", "ExactExpression"]

    @classmethod
    def of(cls, kind: str, parts: tuple["ExactExpression", ...] = (), value: object = None) -> "ExactExpression":
        """The one expression of this kind and these parts."""
        key = (kind, tuple(map(id, parts)), value)
        found = cls._known.get(key)
        if found is None:
            found = object.__new__(cls)
            found.kind, found.parts, found.value, found._slopes = kind, parts, value, {}
            cls._known[key] = found
        return found

    @property
    def is_number(self) -> bool:
        """Whether it is a rational number."""
        return self.kind == "number"

    def is_(self, value: int) -> bool:
        """Whether it is this whole number."""
        return self.kind == "number" and self.value == value

    def __add__(self, other: Operand) -> "ExactExpression":
        a, b = self, expression(other)
        if a.is_number and b.is_number:
            return exact_number(a.value + b.value)
        if a.is_(0):
            return b
        if b.is_(0):
            return a
        return ExactExpression.of("+", (a, b))

    def __mul__(self, other: Operand) -> "ExactExpression":
        a, b = self, expression(other)
        if b.is_number:
            a, b = b, a
        if a.is_number:
            if b.is_number:
                return exact_number(a.value * b.value)
            if a.is_(0):
                return ZERO
            if a.is_(1):
                return b
            if b.kind == "*" and b.parts[0].is_number:
                return exact_number(a.value * b.parts[0].value) * b.parts[1]
        return ExactExpression.of("*", (a, b))

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> "ExactExpression":
        return exact_number(Fraction(-1)) * self

    def __sub__(self, other: Operand) -> "ExactExpression":
        other = expression(other)
        return ZERO if other is self else self + -other

    def __rsub__(self, other: Operand) -> "ExactExpression":
        return expression(other) - self

    def __truediv__(self, other: Operand) -> "ExactExpression":
        """A quotient; one by the number 0 is not simplified, so that its program meets the 0."""
        a, b = self, expression(other)
        if b.is_number and b.value:
            return exact_number(1 / b.value) * a
        if a.is_(0) and not b.is_number:
            return ZERO
        return ExactExpression.of("/", (a, b))

    def __rtruediv__(self, other: Operand) -> "ExactExpression":
        return expression(other) / self

    def __pow__(self, exponent: int) -> "ExactExpression":
        """A whole power."""
        if exponent == 0:
            return ONE
        if exponent == 1:
            return self
        if self.is_number and (self.value or exponent > 0) and abs(exponent) <= LARGEST_EXPONENT:
            numerator, denominator = abs(self.value.numerator), self.value.denominator
            if max(numerator, denominator).bit_length() * abs(exponent) <= MOST_BITS:
                return exact_number(self.value**exponent)
        return ExactExpression.of("**", (self,), exponent)

    def __repr__(self) -> str:
        if self.kind in ("number", "symbol"):
            return str(self.value)
        inner = ", ".join(map(repr, self.parts))
        return f"{self.kind}({inner}{'' if self.value is None else f', {self.value}'})"


def exact_number(value: Fraction | int) -> ExactExpression:
    """The expression of a rational number."""
    return ExactExpression.of("number", (), Fraction(value))


def symbol(name: str) -> ExactExpression:
    """The one symbol of a name."""
    return ExactExpression.of("symbol", (), name)


def symbols(prefix: str, count: int) -> list[ExactExpression]:
    """Numbered symbols of a prefix that no name of a formula begins with."""
    return [symbol(f"{prefix}.{i}") for i in range(count)]


def expression(value: Operand) -> ExactExpression:
    """A value as an expression; numbers are converted."""
    return value if isinstance(value, ExactExpression) else exact_number(Fraction(value))


ZERO, ONE, TWO, PI = exact_number(0), exact_number(1), exact_number(2), ExactExpression.of("pi")


def call(name: str, x: ExactExpression) -> ExactExpression:
    """A function of an expression; some rational values become numbers."""
    if x.is_(0) and name in _ZERO_AT_ZERO:
        return ZERO
    if x.is_(0) and name in ("exp", "cos", "cosh"):
        return ONE
    if x.is_(1) and name == "log":
        return ZERO
    if name == "sqrt" and x.is_number and x.value > 0:
        roots = [isqrt(x.value.numerator), isqrt(x.value.denominator)]
        if roots[0] ** 2 == x.value.numerator and roots[1] ** 2 == x.value.denominator:
            return exact_number(Fraction(*roots))
    return ExactExpression.of(name, (x,))


def power(base: ExactExpression, exponent: ExactExpression) -> ExactExpression:
    """A power, by its logarithm where the exponent is no whole number."""
    if exponent.is_number and exponent.value.denominator == 1:
        return base ** int(exponent.value)
    if exponent.is_number and exponent.value == Fraction(1, 2):
        return call("sqrt", base)
    return ExactExpression.of("power", (base, exponent))


_ZERO_AT_ZERO = (
    "sin", "tan", "sinh", "tanh", "asin", "atan", "asinh", "atanh", "expm1", "log1p",
)  # fmt: skip
# The functions that are odd (-1) and even (1).
PARITIES = {
    **dict.fromkeys(("sin", "tan", "sinh", "tanh", "asin", "atan", "asinh", "atanh"), -1),
    **dict.fromkeys(("cos", "cosh"), 1),
}
# The derivative of each function f by its argument x.
_SLOPES = {
    "exp": lambda f, x: f,
    "expm1": lambda f, x: f + 1,
    "log": lambda f, x: 1 / x,
    "log1p": lambda f, x: 1 / (1 + x),
    "sqrt": lambda f, x: Fraction(1, 2) / f,
    "sin": lambda f, x: call("cos", x),
    "cos": lambda f, x: -call("sin", x),
    "tan": lambda f, x: 1 + f**2,
    "sinh": lambda f, x: call("cosh", x),
    "cosh": lambda f, x: call("sinh", x),
    "tanh": lambda f, x: 1 - f**2,
    "asin": lambda f, x: 1 / call("sqrt", 1 - x**2),
    "acos": lambda f, x: -1 / call("sqrt", 1 - x**2),
    "atan": lambda f, x: 1 / (1 + x**2),
    "asinh": lambda f, x: 1 / call("sqrt", 1 + x**2),
    "acosh": lambda f, x: 1 / (call("sqrt", x - 1) * call("sqrt", x + 1)),
    "atanh": lambda f, x: 1 / (1 - x**2),
}
SMOOTH_FUNCTIONS = frozenset(_SLOPES)


def in_order(outputs: Iterable[ExactExpression]) -> list[ExactExpression]:
    """All subexpressions of some expressions, each once and after its parts; without recursion, as sums are deep."""
    order, seen = list[ExactExpression](), set[ExactExpression]()
    waiting = [(each, False) for each in reversed([*outputs])]
    while waiting:
        each, ready = waiting.pop()
        if ready:
            order.append(each)
        elif each not in seen:
            seen.add(each)
            waiting.append((each, True))
            waiting.extend((part, False) for part in reversed(each.parts) if part not in seen)
    return order


def derivative_by(of: ExactExpression, by: ExactExpression) -> ExactExpression:
    """The derivative by a symbol."""
    waiting = [of]
    while waiting:
        each = waiting[-1]
        if by in each._slopes:
            waiting.pop()
        elif missing := [part for part in each.parts if by not in part._slopes]:
            waiting += missing
        else:
            each._slopes[by] = _derivative_of(each, by)
    return of._slopes[by]


def _derivative_of(of: ExactExpression, by: ExactExpression) -> ExactExpression:
    """The derivative of an expression whose parts have their derivatives stored."""
    if not of.parts:
        return ONE if of is by else ZERO
    (x, dx), *rest = [(part, part._slopes[by]) for part in of.parts]
    if of.kind in _SLOPES:
        return dx if dx is ZERO else _SLOPES[of.kind](of, x) * dx
    if of.kind == "**":
        return dx if dx is ZERO else of.value * x ** (of.value - 1) * dx
    y, dy = rest[0]
    if of.kind == "+":
        return dx + dy
    if of.kind == "*":
        return dx * y + x * dy
    if of.kind == "/":
        return dx / y if dy is ZERO else (dx - of * dy) / y
    assert of.kind == "power"
    by_base = ZERO if dx is ZERO else y * dx / x
    return of * (by_base if dy is ZERO else by_base + dy * call("log", x))


def jacobian(outputs: Sequence[ExactExpression], inputs: Sequence[ExactExpression]) -> list[list[ExactExpression]]:
    """The derivatives (outputs, inputs) by symbols."""
    contained = symbols_in(outputs)  # most outputs contain few of the symbols of a large system
    return [[derivative_by(each, x) if x in contained[each] else ZERO for x in inputs] for each in outputs]


def symbols_in(outputs: Iterable[ExactExpression]) -> dict[ExactExpression, frozenset[ExactExpression]]:
    """The symbols that some expressions, and all of their subexpressions, contain."""
    found = dict[ExactExpression, frozenset[ExactExpression]]()
    for each in in_order(outputs):
        own = [found[part] for part in each.parts]
        found[each] = frozenset([each]) if each.kind == "symbol" else own[0].union(*own[1:]) if own else frozenset()
    return found


def along(of: ExactExpression, places: Sequence[ExactExpression], rates: Sequence[ExactExpression]) -> ExactExpression:
    """The derivative of a function of places that change at these rates."""
    return total(derivative_by(of, place) * rate for place, rate in zip(places, rates, strict=True))


def total(terms: Iterable[Operand]) -> ExactExpression:
    """The sum of some expressions."""
    found = ZERO
    for term in terms:
        found = found + term
    return found


def substitute(of: Sequence[ExactExpression], places: Mapping[ExactExpression, Operand]) -> list[ExactExpression]:
    """Expressions with symbols replaced by others."""
    new = {each: expression(value) for each, value in places.items()}
    for each in in_order(of):
        if each not in new:
            new[each] = rebuilt(each, [new[part] for part in each.parts]) if each.parts else each
    return [new[each] for each in of]


def rebuilt(each: ExactExpression, parts: Sequence[ExactExpression]) -> ExactExpression:
    """The operation of an expression on other parts."""
    if each.kind == "+":
        return parts[0] + parts[1]
    if each.kind == "*":
        return parts[0] * parts[1]
    if each.kind == "/":
        return parts[0] / parts[1]
    if each.kind == "**":
        return parts[0] ** each.value
    return power(*parts) if each.kind == "power" else call(each.kind, parts[0])


def vanishes(each: ExactExpression) -> bool:
    """Whether an expression is 0 as a quotient of polynomials in its symbols and its function values, of which those at
    equal arguments are equal, and those at opposite ones if the function is even or odd; one that is 0 by another
    identity of functions is not recognised."""
    order = in_order([each])
    polynomials = ("number", "+", "*", "/", "**")
    atoms = [node for node in order if node.kind not in polynomials]
    context = fmpq_mpoly_ctx.get([f"x{i}" for i in range(len(atoms))], Ordering.lex)
    known = dict(zip(atoms, context.gens(), strict=True))
    one = context.constant(1)
    found = dict[ExactExpression, tuple[Any, Any]]()
    for node in order:
        parts = [found[part] for part in node.parts]
        if node in known:
            same = ((_same_value(node, parts, other, found), other) for other in atoms if other in found and parts)
            sign, other = next((pair for pair in same if pair[0]), (1, node))
            found[node] = sign * (known[node] if other is node else found[other][0]), one
        elif node.kind == "number":
            found[node] = context.constant(fmpq(node.value.numerator, node.value.denominator)), one
        elif node.kind == "**":
            (a, b), n = parts[0], abs(node.value)
            if n > LARGEST_EXPANDED:
                return False
            found[node] = (a**n, b**n) if node.value > 0 else (b**n, a**n)
        else:
            (a, b), (c, d) = parts
            found[node] = (a * d + c * b, b * d) if node.kind == "+" else (a * c, b * d)
            if node.kind == "/":
                found[node] = a * d, b * c
        if found[node][1] == 0 or max(map(len, found[node])) > MOST_EXPANDED_TERMS:
            return False
    return bool(found[each][0] == 0)


def _same_value(each: ExactExpression, parts: list, other: ExactExpression, found: Mapping) -> int:
    """1 where a function's value is that of another expression, -1 where it is the negative of that, else 0; `parts`
    and `found` have the quotients of polynomials that the arguments are."""
    if each.kind != other.kind:
        return 0
    pairs = list(zip(parts, (found[part] for part in other.parts), strict=True))
    if all(a * d == c * b for (a, b), (c, d) in pairs):
        return 1
    return PARITIES.get(each.kind, 0) if all(a * d == -c * b for (a, b), (c, d) in pairs) else 0


def depends_on(of: Iterable[ExactExpression], on: Iterable[ExactExpression]) -> bool:
    """Whether some expressions contain one of these symbols."""
    these = set(on)
    return any(each in these for each in in_order(of))
