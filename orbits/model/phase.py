"""Phases with their vector fields, and boundary value statements on sequences of them.

Expressions are built by plain functions of CasADi scalars: a field is called as ``field(x, p, q)`` with a list `x` of
states, a mapping `p` of named parameters and a list `q` with the data of a smooth piece, and returns a list of
expressions.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from .closed_form import Oscillator, ThrownOscillator


@dataclass(frozen=True)
class Affine:
    """The function weights . x + offset of a state, the weights one per state.

    For several motions at once weights and offset may be arrays (m,), one number for each (`Trajectories.series`).
    """

    weights: tuple[float, ...]
    offset: float = 0.0

    def __call__(self, x):
        """Value at states `x` (..., n)."""
        return x @ np.array(self.weights) + self.offset

    def series(self, coefficients):
        """Taylor coefficients (..., K + 1) along those of the state (..., n, K + 1)."""
        along = np.array(self.weights) @ coefficients
        along[..., 0] += self.offset
        return along


@dataclass(frozen=True)
class Pieces:
    """Where a piecewise vector field is smooth: between `breaks` of one coordinate of the state.

    coordinate : the weights w of the coordinate w . x
    size : number of data values of a piece, the `q` of the field
    table : parameters -> (breaks (m + 1), data (m, size)); the motion may not leave [breaks[0], breaks[-1]]
    label : what to call the coordinate in a message
    """

    coordinate: tuple[float, ...]
    size: int
    table: Callable[[Mapping[str, float]], tuple[np.ndarray, np.ndarray]]
    label: str = "coordinate"


@dataclass(frozen=True, eq=False)
class Phase:
    """One smooth (or piecewise smooth) way of moving.

    field : (x, p, q) -> x', see the module
    watch : named quantities to carry along as Taylor series, (x, p, q) -> expression
    pieces : where the field is smooth, None for everywhere
    closed_form : parameters -> exact flow of the phase, used instead of integration

    Phases and statements compare by identity: what is built from them is kept as long as they are.
    """

    name: str
    states: tuple[str, ...]
    field: Callable
    watch: Mapping[str, Callable] = field(default_factory=dict)
    pieces: Pieces | None = None
    closed_form: Callable[[Mapping[str, float]], Oscillator | ThrownOscillator] | None = None


@dataclass(frozen=True, eq=False)
class Arc:
    """A phase travelled once: start (u, x_before, p) -> x, duration (u, p), conditions (u, x_end, p) -> zeros.

    `x_before` is the end of the arc before (empty for the first); `guard` (u, x_start, p, q) -> zeros holds at the
    start. `u` and `p` are mappings of names, x and q lists, as in a phase's field.
    """

    phase: Phase
    start: Callable
    duration: Callable
    conditions: Callable
    guard: Callable = lambda u, x, p, q: []


@dataclass(frozen=True, eq=False)
class Statement:
    """A square boundary value problem on a sequence of phases: what makes a motion an orbit.

    unknowns : names of the unknowns u
    durations : names of the unknowns that are times; they stay positive
    arcs : travelled in this order
    """

    name: str
    unknowns: tuple[str, ...]
    arcs: tuple[Arc, ...]
    durations: tuple[str, ...] = ()
