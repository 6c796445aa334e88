"""Smooth nonlinear functions of the state, such as the height of a body above a bent knee."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TypeAlias, TypedDict

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..laws import Algebraic, Parameters, Scalars
from ..symbolic import ElementwiseFunction, Formula, cached, composed_coefficients, parse
from .phase import Affine


@dataclass(frozen=True)
class StateFormula:
    """A smooth function of the state, stated as a formula so that files and pickles of orbits can store it.

    text : in the grammar of `orbits.symbolic.formula`, of the names of coordinates and of parameters, such as "h +
        2*l*sin(theta/2)"
    states : names of the n states
    values : of its parameters, numbers or expressions; for m trajectories together a value may be an array (m,)
    sizes, unit : the formula's units of the states (n,) and of the value, in the units of `x` and of the results; by
        default they are the same

    Raises `InputError` for a formula with other names, or one that is not smooth.
    """

    text: str
    states: tuple[str, ...]
    values: Parameters = field(default_factory=dict)
    sizes: tuple[float, ...] | None = None
    unit: float = 1.0

    def __post_init__(self) -> None:
        formula, known = _parsed(self.text), {*self.states, *self.values}
        if unknown := sorted(formula.names - known):
            raise InputError(
                f"the height '{self.text}' needs a value for '{unknown[0]}': it is not a state or parameter"
            )
        if formula.pieces:
            raise InputError(f"'{formula.pieces[0]}' gives the height '{self.text}' a corner: heights must be smooth")
        used = {name: value for name, value in self.values.items() if name in formula.names - {*self.states}}
        object.__setattr__(self, "values", used)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The names of the states on which the formula depends."""
        names = _parsed(self.text).names
        return tuple(name for name in self.states if name in names)

    def __call__(self, x: ArrayLike) -> Algebraic:
        """Values (...) at states `x` (..., n)."""
        return self.at(list(np.moveaxis(np.asarray(x, dtype=float), -1, 0)))

    def at(self, x: Scalars) -> Algebraic:
        """The value at a list of states: numbers, arrays or expressions."""
        sizes = self.sizes or (1.0,) * len(self.states)
        known = {name: part / size for name, part, size in zip(self.states, x, sizes, strict=False)}
        return self.unit * _parsed(self.text)(**{name: known[name] for name in self.coordinates}, **self.values)

    def of(self, owners: np.ndarray) -> "StateFormula":
        """The function with the parameter values of the trajectories `owners` (N,), where they differ between
        trajectories."""
        return replace(
            self, values={name: value[owners] if np.ndim(value) else value for name, value in self.values.items()}
        )

    def series(self, coefficients: np.ndarray) -> np.ndarray:
        """Taylor coefficients (N, K + 1) from those of rows (N, rows, K + 1) that begin with the n states."""
        count, _, orders = coefficients.shape
        rows = [self.states.index(name) for name in self.coordinates]
        inside = coefficients[:, rows]
        if self.sizes:
            inside = inside / np.array(self.sizes)[rows, None]
        values = np.zeros((count, len(self.values)))
        for i, value in enumerate(self.values.values()):
            values[:, i] = value
        composed = _series(self.text, self.coordinates, tuple(self.values), orders)
        return self.unit * composed(inside.reshape(count, -1), values)[0]

    def in_units(self, sizes: Sequence[float], unit: float) -> "StateFormula":
        """This function in units in which one old unit is `sizes` (n,) of the states and `unit` of the value."""
        own = self.sizes or (1.0,) * len(self.states)
        sizes = tuple(size * mine for size, mine in zip(sizes, own, strict=True))
        return replace(self, sizes=sizes, unit=self.unit * unit)

    def saved(self) -> "SavedFormula":
        """The function for a file, in the units of the formula."""
        return SavedFormula(formula=self.text, values=self.values)


class SavedFormula(TypedDict):
    """A `StateFormula` in a file."""

    formula: str
    values: Mapping[str, float]


# The result of `saved` for an `Affine` function or for a `StateFormula`, as it is read.
SavedHeight: TypeAlias = tuple[tuple[float, ...], float] | SavedFormula


def height_of(saved: SavedHeight, states: tuple[str, ...]) -> Affine | StateFormula:
    """The function of states of these names that was `saved`; raises `InputError` for an invalid formula."""
    if isinstance(saved, tuple):
        return Affine(*saved)
    return StateFormula(saved["formula"], states, saved["values"])


@lru_cache(maxsize=256)
def _parsed(text: str) -> Formula:
    return parse(text)


@cached
def _series(text: str, coordinates: tuple[str, ...], parameters: tuple[str, ...], orders: int) -> ElementwiseFunction:
    """(coefficients of the coordinates, one after the other; parameters) -> coefficients of the formula's value."""
    x, p = (ca.SX.sym(name, len(names)) for name, names in (("x", coordinates), ("p", parameters)))
    symbols = zip((*coordinates, *parameters), (*ca.vertsplit(x), *ca.vertsplit(p)), strict=True)
    function = ca.Function("height", [x, p], [_parsed(text)(**dict(symbols))])
    rows = ca.SX.sym("rows", orders, len(coordinates))
    composed = composed_coefficients(function, [ca.vertsplit(row) for row in ca.horzsplit(rows)], p)
    return ElementwiseFunction(ca.Function("series", [ca.vec(rows), p], [composed]))
