"""The coordinates of a mechanism with their symbols, and exact properties of expressions of them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import Any

import casadi as ca

from ..laws import Parameters, Scalars
from ..symbolic import (
    ZERO,
    Column,
    ExactExpression,
    derivative_by,
    exact_number,
    exact_value,
    expression_of_nodes,
    lifted,
    number_of,
    substitute,
    symbol,
    symbolic_numerals,
    vanishes,
    without,
)
from .coefficients import Coefficients
from .elements import Scalar, parsed, value_of


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The coordinates (n) and the actuators (k) of a mechanism, with the symbols in its expressions.

    names, actuators : each actuator is the name of a displacement and that of its rate
    p : the parameters
    """

    names: tuple[str, ...]
    actuators: tuple[tuple[str, str], ...]
    p: dict[str, ca.SX]
    _known: dict[Scalar, ExactExpression] = field(default_factory=dict, repr=False)
    _weights: dict[Scalar, list[Fraction] | None] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, names: Sequence[str], actuators: Sequence[tuple[str, str]], parameters: Sequence[str]) -> "Coordinates":
        """The coordinates and actuators of these names."""
        return cls(tuple(names), tuple(actuators), {name: ca.SX.sym(name) for name in parameters})

    @property
    def size(self) -> int:
        """The number n of coordinates."""
        return len(self.names)

    @cached_property
    def moved(self) -> tuple[str, ...]:
        """The names (n + k,) of coordinates and displacements."""
        return (*self.names, *(name for name, _ in self.actuators))

    @cached_property
    def y(self) -> Column:
        """The symbols (n + k,) of coordinates and displacements."""
        return list(map(symbol, self.moved))

    @cached_property
    def v(self) -> Column:
        """The symbols (n + k,) of their rates."""
        return [symbol(f"{name}'") for name in self.moved]

    def named(self, values: Scalars) -> Parameters:
        """Values (n + k,) by the names of the coordinates and displacements."""
        return dict(zip(self.moved, values, strict=True))

    def scalar(self, expression: Scalar) -> ExactExpression:
        """An expression of the coordinates and parameters."""
        if expression not in self._known:
            if isinstance(expression, str):
                formula = parsed(expression)
                names = {"pi": exact_value("pi"), **{name: symbol(name) for name in formula.names}}
                found = expression_of_nodes(formula.folded_nodes, names)
            elif callable(expression):
                found = self.of_function(lambda y, v: value_of(expression, self.named(y), self.p))
            else:
                found = exact_number(Fraction(float(expression)))
            self._known[expression] = found
        return self._known[expression]

    def of_function(self, function: Callable[[list[ca.SX], list[ca.SX]], Any]) -> ExactExpression:
        """The exact expression of a function of CasADi's coordinates and rates, (n + k,) each, in which the numerals of
        formulas are exact."""
        y, v = ([ca.SX.sym(each.value) for each in symbols] for symbols in (self.y, self.v))
        numerals = dict[str, ca.SX]()
        with symbolic_numerals(numerals):
            found = ca.SX(function(y, v))
        known = dict(zip([*y, *v], [*self.y, *self.v], strict=True))
        return self.lifted([found], {**known, **{each: exact_value(text) for text, each in numerals.items()}})[0]

    def lifted(self, expressions: Sequence[ca.SX], symbols: Mapping[ca.SX, ExactExpression] | None = None) -> Column:
        """The exact expressions of CasADi's ones of the parameters and of other symbols."""
        own = {each: symbol(name) for name, each in self.p.items()}
        return lifted(expressions, {**own, **(symbols or {})})

    def coefficients(
        self, matrix: Sequence[Sequence[ExactExpression]], place: Sequence[ExactExpression] | None = None
    ) -> Coefficients:
        """A matrix of expressions of the coordinates, or of other symbols, and of the parameters."""
        return Coefficients(matrix, self.y if place is None else place)

    def varies(self, entries: Iterable[ExactExpression], place: Sequence[ExactExpression] | None = None) -> bool:
        """Whether an expression depends on the coordinates, or on other symbols."""
        return any(without(each, self.y if place is None else place) is None for each in entries)

    def gradient(self, expression: Scalar | ExactExpression) -> Column:
        """The gradient (n + k,) of an expression by the coordinates and displacements."""
        own = expression if isinstance(expression, ExactExpression) else self.scalar(expression)
        return [derivative_by(own, each) for each in self.y]

    def at_zero(self, expression: Scalar | ExactExpression) -> ExactExpression:
        """An expression where all coordinates are 0."""
        own = expression if isinstance(expression, ExactExpression) else self.scalar(expression)
        return substitute([own], dict.fromkeys(self.y, ZERO))[0]

    def affine(self, expression: Scalar) -> Coefficients | None:
        """The weights of the coordinates and displacements and the offset of an expression, functions of the
        parameters; None where it is not affine."""
        found = self.coefficients([[*self.gradient(expression), self.at_zero(expression)]])
        return None if found.by_coordinates else found

    def weights(self, expression: Scalar) -> list[Fraction] | None:
        """The weights (n + k,) of the coordinates and displacements in an expression that is a sum of these, with
        rational numbers before them, and of parameters; None for another."""
        if expression not in self._weights:
            numbers = [weight for each in self.gradient(expression) if (weight := number_of(each)) is not None]
            self._weights[expression] = numbers if len(numbers) == len(self.y) else None
        return self._weights[expression]


def all_vanish(entries: Iterable[ExactExpression]) -> bool:
    """Whether all expressions are 0 everywhere."""
    return all(map(vanishes, entries))
