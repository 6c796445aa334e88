"""Numbers and masks of the lanes of vector code, with the operators of Python."""

from functools import reduce

import casadi as ca

from .vector_code import VectorCode


class Number:
    """A value of a code with the operators of Python; a number with it is the same in every lane."""

    __slots__ = ("code", "name")

    def __init__(self, code: VectorCode, name: str):
        self.code, self.name = code, name

    def _by(self, op: int, *values: "Number | float") -> "Number":
        return Number(self.code, self.code.operation(op, [self._name(value) for value in values]))

    def _name(self, value: "Number | float") -> str:
        return value.name if isinstance(value, Number) else self.code.splat(value)

    def __add__(self, other: "Number | float") -> "Number":
        return self._by(ca.OP_ADD, self, other)

    def __sub__(self, other: "Number | float") -> "Number":
        return self._by(ca.OP_SUB, self, other)

    def __mul__(self, other: "Number | float") -> "Number":
        return self._by(ca.OP_MUL, self, other)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: "Number | float") -> "Number":
        return self._by(ca.OP_DIV, self, other)

    def __neg__(self) -> "Number":
        return self._by(ca.OP_NEG, self)

    def __abs__(self) -> "Number":
        return self._by(ca.OP_FABS, self)

    def __lt__(self, other: "Number | float") -> "Mask":
        return Mask(self.code, self.code.compare("olt", self.name, self._name(other)))

    def __le__(self, other: "Number | float") -> "Mask":
        return Mask(self.code, self.code.compare("ole", self.name, self._name(other)))

    def __gt__(self, other: "Number | float") -> "Mask":
        return Mask(self.code, self.code.compare("ogt", self.name, self._name(other)))

    def __ge__(self, other: "Number | float") -> "Mask":
        return Mask(self.code, self.code.compare("oge", self.name, self._name(other)))

    def least(self, *others: "Number | float") -> "Number":
        """The least of this and others that are numbers."""
        return reduce(lambda a, b: a._by(ca.OP_FMIN, a, b), others, self)

    def largest(self, *others: "Number | float") -> "Number":
        """The largest of this and others that are numbers."""
        return reduce(lambda a, b: a._by(ca.OP_FMAX, a, b), others, self)

    def root(self) -> "Number":
        """The square root."""
        return self._by(ca.OP_SQRT, self)

    def times_plus(self, factor: "Number | float", other: "Number | float") -> "Number":
        """This times a factor plus another one."""
        return Number(self.code, self.code.fused(self.name, self._name(factor), self._name(other)))


class Mask:
    """The lanes of a code in which something holds."""

    __slots__ = ("code", "name")

    def __init__(self, code: VectorCode, name: str):
        self.code, self.name = code, name

    def __and__(self, other: "Mask") -> "Mask":
        return Mask(self.code, self.code(f"and {self.code.masks} {self.name}, {other.name}"))

    def __or__(self, other: "Mask") -> "Mask":
        return Mask(self.code, self.code(f"or {self.code.masks} {self.name}, {other.name}"))

    def __invert__(self) -> "Mask":
        return Mask(self.code, self.code(f"xor {self.code.masks} {self.name}, splat (i1 1)"))

    def choose(self, yes: Number | float, no: Number | float) -> Number:
        """One number in these lanes and another one elsewhere."""
        names = (each.name if isinstance(each, Number) else self.code.splat(each) for each in (yes, no))
        return Number(self.code, self.code.choose(self.name, *names))

    def value(self) -> str:
        """Ones and zeros."""
        return self.code.number(self.name)
