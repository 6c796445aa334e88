"""Exact expressions: operations on symbols and rational numbers, which are differentiated, and are evaluated by CasADi
and by programs of balls.

Nothing is rounded, and only exact simplifications are made: a sum or a product of rational numbers becomes a number,
numbers come first in products, and 0 + x, 1 x, x - x, 0 x, x/x and (x y)/x become x, x, 0, 0, 1 and y. The last four
may lose a place where x has no value. Proofs therefore collect what restricts the domain of a stated formula (a
quotient, a root, a logarithm, a power), see `orbits.exact.formulas.Domain`, and check it along the whole motion.

Equal expressions are one object, so that common parts are computed once.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import count
from math import isqrt
from typing import Any, ClassVar, Union
from weakref import WeakValueDictionary

# An expression, or an exact number that stands for one.
Operand = Union["ExactExpression", Fraction, int]
# Powers of numbers up to this exponent, with results of at most these bits, become numbers; others stay powers.
LARGEST_EXPONENT, MOST_BITS = 512, 20_000
# Sizes are not counted beyond this.
LARGEST_SIZE = 10**6


class ExactExpression:
    """An operation on other expressions: `kind` is "number", "symbol", "pi", "+", "*", "/", "**" with a whole exponent,
    "power" with any other, a function's name, or "operation" for any other of CasADi's.

    parts : the operands
    serial : larger than those of its parts
    notes : what is worked out of it, see `noted`
    size : how many operations it has, common parts counted as often as they are used
    value : the Fraction of a number, the name of a symbol, the exponent of "**", the `Operation` of CasADi
    """

    __slots__ = ("__weakref__", "kind", "notes", "parts", "serial", "size", "value")

    _known: ClassVar["WeakValueDictionary[tuple, ExactExpression]"] = WeakValueDictionary()
    _serials: ClassVar[Iterator[int]] = count()

    kind: str
    parts: tuple["ExactExpression", ...]
    value: Any
    serial: int
    size: int
    notes: dict[Any, Any]

    @classmethod
    def of(cls, kind: str, parts: tuple["ExactExpression", ...] = (), value: Any = None) -> "ExactExpression":
        """The one expression of this kind and these parts."""
        # The hash of a fraction takes longer than that of its parts.
        own = value.as_integer_ratio() if kind == "number" else value
        key = (kind, own, *map(id, parts))
        found = cls._known.get(key)
        if found is None:
            found = object.__new__(cls)
            found.kind, found.parts, found.value, found.notes = kind, parts, value, {}
            found.serial = next(cls._serials)
            found.size = min(1 + sum(part.size for part in parts), LARGEST_SIZE) if parts else 0
            cls._known[key] = found
        return found

    def __lt__(self, other: "ExactExpression") -> bool:
        return self.serial < other.serial

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
        for x, y in ((a, b), (b, a)):
            if x.kind == "*" and x.parts[0].is_number:
                return x.parts[0] * (x.parts[1] * y)
            if x.kind == "/" and x.parts[1] is y:
                return x.parts[0]
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
        if a is b and not b.is_number:
            return ONE
        if a.kind == "*" and b in a.parts and not b.is_number:
            return a.parts[0] if a.parts[1] is b else a.parts[1]
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
    return ExactExpression.of("number", (), value if isinstance(value, Fraction) else Fraction(value))


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
    """A power, by its logarithm where the exponent is not a whole number."""
    if exponent.is_number and exponent.value.denominator == 1:
        return base ** int(exponent.value)
    if exponent.is_number and exponent.value == Fraction(1, 2):
        return call("sqrt", base)
    return ExactExpression.of("power", (base, exponent))


_ZERO_AT_ZERO = (
    "abs", "sign", "sin", "tan", "sinh", "tanh", "asin", "atan", "asinh", "atanh", "expm1", "log1p",
)  # fmt: skip
# The functions that are odd (-1) and even (1).
_PARITIES = {
    **dict.fromkeys(("sin", "tan", "sinh", "tanh", "asin", "atan", "asinh", "atanh", "sign"), -1),
    **dict.fromkeys(("cos", "cosh", "abs"), 1),
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
    "abs": lambda f, x: call("sign", x),
    "sign": lambda f, x: ZERO,
}
SMOOTH_FUNCTIONS = frozenset(_SLOPES) - {"abs", "sign"}


def parity_of(each: ExactExpression) -> int:
    """-1 for an odd function, 1 for an even one, 0 for any other operation."""
    return each.value.parity if each.kind == "operation" else _PARITIES.get(each.kind, 0)


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


def noted(of: ExactExpression, key: Any, work: Callable[[ExactExpression], Any]) -> Any:
    """What is worked out of an expression, once it is of its parts; stored under the key."""
    waiting = [of]
    while waiting:
        each = waiting[-1]
        if key in each.notes:
            waiting.pop()
        elif missing := [part for part in each.parts if key not in part.notes]:
            waiting += missing
        else:
            each.notes[key] = work(each)
    return of.notes[key]


def derivative_by(of: ExactExpression, by: ExactExpression) -> ExactExpression:
    """The derivative by a symbol."""
    return noted(of, by, lambda each: _derivative_of(each, by))


def _derivative_of(of: ExactExpression, by: ExactExpression) -> ExactExpression:
    """The derivative of an expression whose parts have their derivatives stored."""
    if not of.parts:
        return ONE if of is by else ZERO
    (x, dx), *rest = [(part, part.notes[by]) for part in of.parts]
    if of.kind in _SLOPES:
        return dx if dx is ZERO else _SLOPES[of.kind](of, x) * dx
    if of.kind == "**":
        return dx if dx is ZERO else of.value * x ** (of.value - 1) * dx
    if of.kind == "operation":
        slopes = of.value.slopes(of.parts)
        return total(slope * part.notes[by] for slope, part in zip(slopes, of.parts, strict=True))
    y, dy = rest[0]
    if of.kind == "+":
        return dx + dy
    if of.kind == "*":
        return dx * y + x * dy
    if of.kind == "/":
        return dx / y if dy is ZERO else (dx - of * dy) / y
    assert of.kind == "power"
    if y.is_number:
        return dx if dx is ZERO else y * power(x, y - 1) * dx
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
    if each.kind == "operation":
        return ExactExpression.of(each.kind, tuple(parts), each.value)
    return power(*parts) if each.kind == "power" else call(each.kind, parts[0])


def depends_on(of: Iterable[ExactExpression], on: Iterable[ExactExpression]) -> bool:
    """Whether some expressions contain one of these symbols."""
    these = set(on)
    return any(each in these for each in in_order(of))
