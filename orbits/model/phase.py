"""Phases with their vector fields, and boundary value statements on sequences of phases.

Plain functions of CasADi scalars build expressions. A vector field is called as ``field(x, p, q)`` with a list `x` of
states, a mapping `p` of parameters by name and a list `q`, the data of the smooth piece that the state is on.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..io import fields_in_line
from ..laws import Algebraic, Parameters, RowNoise, Scalars
from .modes import Modes


def is_used(coefficient: Algebraic) -> bool:
    """Whether a coefficient is anything but the number 0."""
    return not (isinstance(coefficient, float) and coefficient == 0.0)


def weighted_sum(weights: Scalars, values: Scalars) -> Algebraic:
    """The sum of products, without terms whose weight is 0."""
    total: Algebraic = None
    for weight, value in zip(weights, values, strict=False):
        if is_used(weight):
            part = value if isinstance(weight, float) and weight == 1.0 else weight * value
            total = part if total is None else total + part
    return 0.0 if total is None else total


@dataclass(frozen=True)
class Affine:
    """The affine function weights . x + offset of a state x (n,).

    weights : one for each state
    offset : a number; for m trajectories together a weight or the offset may be an array (m,), as `Trajectories.series`
        takes them"""

    weights: tuple[Algebraic, ...]
    offset: Algebraic = 0.0

    def __call__(self, x: ArrayLike) -> Algebraic:
        """Values (...) at states `x` (..., n)."""
        return np.asarray(x) @ np.array(self.weights) + self.offset

    def at(self, x: Scalars) -> Algebraic:
        """The value at a list of states: numbers, arrays or expressions."""
        return sum((weight * part for weight, part in zip(self.weights, x, strict=False)), self.offset)

    def in_units(self, sizes: Sequence[float], unit: float) -> "Affine":
        """This function in units in which one old unit is `sizes` (n,) of the states and `unit` of the value."""
        weights = (weight * (unit / size) for weight, size in zip(self.weights, sizes, strict=True))
        return Affine(tuple(weights), self.offset * unit)

    def saved(self) -> list[Algebraic]:
        """The function for a file."""
        return [self.weights, self.offset]

    def series(self, coefficients: np.ndarray) -> np.ndarray:
        """Taylor coefficients (..., K + 1) from those of rows (..., rows, K + 1) that begin with the n states."""
        values = np.array(self.weights) @ coefficients[..., : len(self.weights), :]
        values[..., 0] += self.offset
        return values


@dataclass(frozen=True)
class Pieces:
    """Where a piecewise vector field is smooth: between neighbouring breakpoints of one coordinate of the state.

    coordinate : weights w (n,) of the coordinate w . x
    size : number of data values of a piece, the `q` of the vector field
    table : parameters -> (breakpoints (m + 1,), data (m, size)), for the coordinate times its unit minus its origin; a
        motion must stay in the interval that they span
    label : name of the coordinate in messages
    unit, origin : parameters -> the unit and the origin, where they are not 1 and 0; the table does not depend on
        parameters that change these alone
    noise : of the rows of a measured law
    jumps : whether the field may jump from one piece to the next
    exact : whether the data are exact, like the outcomes of comparisons
    """

    coordinate: tuple[float, ...]
    size: int
    table: Callable[[Parameters], tuple[Any, Any]]
    label: str = "coordinate"
    unit: Callable[[Parameters], Algebraic] = lambda p: 1.0
    origin: Callable[[Parameters], Algebraic] = lambda p: 0.0
    noise: RowNoise | None = None
    jumps: bool = False
    exact: bool = False

    def place(self, x: ArrayLike, p: Parameters) -> Any:
        """The coordinates (...) of states (..., n), times their unit, minus their origin."""
        return np.asarray(x) @ np.array(self.coordinate) * self.unit(p) - self.origin(p)

    def levels(self, breaks: ArrayLike, p: Parameters) -> Any:
        """The values of w . x at breakpoints."""
        return (np.asarray(breaks, dtype=float) + self.origin(p)) / self.unit(p)


def data_at(place: Algebraic, breaks: Any, rows: Any) -> list[Algebraic]:
    """The data of the piece at a place between breakpoints as expressions, or at places (m,) as arrays; outside their
    range those of the nearest."""
    choose = np.where if isinstance(place, np.ndarray) else ca.if_else
    q = list(rows[-1])
    for level, row in reversed(list(zip(breaks[1:-1], rows, strict=False))):
        q = [choose(place < level, below, above) for below, above in zip(row, q, strict=True)]
    return q


@dataclass(frozen=True, eq=False)
class Phase:
    """A part of the motion with one vector field, which is smooth or smooth in pieces.

    name : of the phase
    states : names of the n states
    field : (x, p, q) -> x', a list of n expressions of the states x, the parameters p by name, and the data q of a
        smooth piece
    watch : quantities whose Taylor series are computed with those of the states, by name, each (x, p, q) -> expression
    pieces : where the vector field is smooth; None if it is smooth everywhere
    closed_form : parameters -> the exact flow of the phase, used instead of integration

    Phases and statements compare by identity, since objects built from them are stored for as long as they exist.
    """

    name: str
    states: tuple[str, ...]
    field: Callable
    watch: Mapping[str, Callable] = field(default_factory=dict)
    pieces: Pieces | None = None
    closed_form: Callable[[Mapping[str, float]], Modes] | None = None

    def __repr__(self) -> str:
        return fields_in_line(self, "name", "states")

    def data(self, x: Scalars, p: Parameters) -> list[Algebraic]:
        """The data of the piece at a state as expressions, none for a smooth field; outside the range of the pieces,
        the data of the nearest piece."""
        if self.pieces is None:
            return []
        place = weighted_sum(self.pieces.coordinate, x) * self.pieces.unit(p) - self.pieces.origin(p)
        return data_at(place, *self.pieces.table(p))


@dataclass(frozen=True, eq=False)
class Arc:
    """A phase that is passed through once, with its boundary conditions.

    phase : the `Phase`
    start : (u, x_before, p) -> the first state; `x_before` is the last state of the previous arc, empty for the first
        arc
    duration : (u, p) -> its duration
    conditions : (u, x_end, p) -> expressions that vanish at its end
    guard : (u, x_start, p, q) -> expressions that vanish at its start

    The unknowns `u` and the parameters `p` are mappings of names; `x` and `q` are lists, as in a vector field.
    """

    phase: Phase
    start: Callable
    duration: Callable
    conditions: Callable
    guard: Callable = lambda u, x, p, q: []


@dataclass(frozen=True, eq=False)
class Statement:
    """A square boundary value problem on a sequence of phases, whose solutions are orbits.

    name : of the statement
    unknowns : names of the unknowns u
    arcs : in the order in which they are passed through
    durations : names of those unknowns that are times, which stay positive
    tuned : names of those unknowns, the last ones, that are parameters
    """

    name: str
    unknowns: tuple[str, ...]
    arcs: tuple[Arc, ...]
    durations: tuple[str, ...] = ()
    tuned: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return fields_in_line(self, "name", "unknowns")
