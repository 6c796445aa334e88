"""The coordinates of a mechanism with their symbols, and exact properties of expressions of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property

import casadi as ca

from ..laws.law import Parameters, Scalars
from ..symbolic.formula import symbolic_numerals
from .coefficients import Coefficients, Entries, Numerals, Symbols
from .elements import Scalar, value_of


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The coordinates (n) and the actuators (k) of a mechanism, with the symbols in its expressions.

    names, actuators : each actuator is the name of a displacement and that of its rate
    p : the parameters
    numerals : the numbers that stand in expressions
    y, v : coordinates with displacements, and their rates, (n + k,)
    """

    names: tuple[str, ...]
    actuators: tuple[tuple[str, str], ...]
    p: dict[str, ca.SX]
    numerals: Numerals
    y: ca.SX
    v: ca.SX
    _weights: dict[Scalar, list[Fraction] | None] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, names: Sequence[str], actuators: Sequence[tuple[str, str]], parameters: Sequence[str]) -> "Coordinates":
        """The coordinates and actuators of these names."""
        y, v = (ca.SX.sym(name, len(names) + len(actuators)) for name in ("y", "v"))
        return cls(tuple(names), tuple(actuators), {name: ca.SX.sym(name) for name in parameters}, Numerals(), y, v)

    @property
    def size(self) -> int:
        """The number n of coordinates."""
        return len(self.names)

    @cached_property
    def moved(self) -> tuple[str, ...]:
        """The names (n + k,) of coordinates and displacements."""
        return (*self.names, *(name for name, _ in self.actuators))

    def named(self, values: Scalars) -> Parameters:
        """Values (n + k,) by the names of the coordinates and displacements."""
        return dict(zip(self.moved, values, strict=True))

    @cached_property
    def own_symbols(self) -> Symbols:
        """The symbols of expressions of the coordinates and of the parameters."""
        return self.symbols(self.y)

    def symbols(self, *place: ca.SX) -> Symbols:
        """The symbols of expressions of these and of the parameters."""
        return Symbols(ca.vertcat(*place), self.p, self.numerals)

    def scalar(self, expression: Scalar) -> ca.SX:
        """An expression of the coordinates and parameters, with symbols for its numerals."""
        if not (isinstance(expression, str) or callable(expression)):
            return self.numerals.number(float(expression))
        with symbolic_numerals(self.numerals.symbols, folded=True):
            return ca.SX(value_of(expression, self.named(ca.vertsplit(self.y)), self.p))

    def coefficients(self, matrix: ca.SX, symbols: Symbols | None = None) -> Coefficients:
        """A matrix of expressions of the coordinates, or of other symbols, and of the parameters."""
        return Coefficients(matrix, symbols or self.own_symbols)

    def vanishes(self, matrix: ca.SX, symbols: Symbols | None = None) -> bool:
        """Whether all entries of a matrix are 0."""
        return matrix.is_zero() or Entries(matrix, symbols or self.own_symbols).vanishes

    def varies(self, matrix: ca.SX, symbols: Symbols | None = None) -> bool:
        """Whether a matrix depends on the coordinates, or on the other symbols' place."""
        symbols = symbols or self.own_symbols
        return ca.depends_on(matrix, symbols.place) and Entries(matrix, symbols).varies

    def gradient(self, expression: Scalar) -> ca.SX:
        """The gradient (n + k,) of an expression by the coordinates and displacements."""
        return ca.gradient(self.scalar(expression), self.y)

    def at_zero(self, expression: Scalar) -> ca.SX:
        """An expression where all coordinates are 0."""
        return self.without_place(self.scalar(expression))

    def without_place(self, expression: ca.SX) -> ca.SX:
        """An expression of symbols where all coordinates are 0."""
        return ca.substitute(expression, self.y, ca.SX(ca.DM.zeros(self.y.numel())))

    def affine(self, expression: Scalar) -> Coefficients | None:
        """The weights of the coordinates and displacements and the offset of an expression, functions of the
        parameters; None where it is not affine."""
        found = self.coefficients(ca.horzcat(self.gradient(expression).T, self.at_zero(expression)))
        return None if found.by_coordinates else found

    def weights(self, expression: Scalar) -> list[Fraction] | None:
        """The weights (n + k,) of the coordinates and displacements in an expression that is a sum of these, with
        rational numbers before them, and of parameters; None for another."""
        if expression not in self._weights:
            weights = Entries(self.gradient(expression), self.own_symbols).exact
            numbers = [weight for weight in weights if weight is not None]
            self._weights[expression] = numbers if len(numbers) == len(weights) else None
        return self._weights[expression]
