"""The vector field of a phase at states and parameters, smooth or in pieces: rates, and the piece of each state."""

from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import OutOfRange
from ..laws import PieceTable
from ..model import Phase
from ..numerics import Array, evaluate
from ..symbolic import BufferedFunction, ElementwiseFunction, MappedFunction
from ..units import Message, Quantity
from .breakpoints import SIDE_DISTANCE, same_place
from .trajectory import Trajectories, Trajectory
from .vector_field import TAYLOR, VectorField, rows_used

# The message about a motion that needs a law where it has no value.
OUT_OF_LAW = "leaves the law's range"
# A field that changes by a larger share of its size across a breakpoint jumps.
LEAST_JUMP = 1e-8


class PhaseField:
    """The vector field of one phase; `parameters` names the entries of the parameter vectors (np,) that it takes.

    The data (np + nq,) of a piecewise field are the parameters followed by the nq values of the smooth piece that the
    state is on.
    """

    def __init__(self, phase: Phase, parameters: tuple[str, ...]):
        self.phase, self.parameters = phase, tuple(parameters)
        self.size, self.names = len(phase.states), (*phase.states, *phase.watch)

    @cached_property
    def vector_field(self) -> VectorField:
        """The expression graph of the field; its parameters are followed by the data of a piece."""
        count = self.phase.pieces.size if self.phase.pieces else 0
        x, p = ca.SX.sym("x", self.size), ca.SX.sym("p", len(self.parameters) + count)
        arguments = self.symbols(x, p)
        rates = ca.vertcat(*self.phase.field(*arguments))
        watched = ca.SX(ca.vertcat(*[quantity(*arguments) for quantity in self.phase.watch.values()]))
        field, pieces = ca.Function("field", [x, p], ca.cse([rates, watched])), self.phase.pieces
        if pieces is None:
            return VectorField(field, x, p)
        unit, origin = (ca.SX(function(arguments[1])) for function in (pieces.unit, pieces.origin))
        order = TAYLOR.order if self.breaks < TAYLOR.many_pieces else TAYLOR.order_on_pieces
        return VectorField(field, x, p, pieces.coordinate, unit, origin, count, order)

    def symbols(self, x: ca.SX, p: ca.SX) -> tuple[list, dict, list]:
        """The arguments (x, p, q) of a phase's expressions from vectors of states and of parameters with piece data."""
        entries, named = ca.vertsplit(p), len(self.parameters)
        return ca.vertsplit(x), dict(zip(self.parameters, entries[:named], strict=True)), entries[named:]

    @cached_property
    def is_smooth(self) -> bool:
        """Whether the field has all derivatives everywhere."""
        return self.vector_field.has_series and self.phase.pieces is None

    def rates(self, x: ArrayLike, p: ArrayLike) -> Array:
        """The field at one state (n,), with parameters and piece data (np + nq,)."""
        return self._rates(x, p)[0].ravel()

    @cached_property
    def _rates(self) -> BufferedFunction:
        x, p = self.vector_field.x, self.vector_field.p
        return BufferedFunction(ca.Function("rates", [x, p], [ca.densify(self.vector_field.field(x, p)[0])]))

    def field(self, xs: Array, p: Array) -> list[Array]:
        """Rates (m, n) and watched quantities (m, k) at states (m, n) with parameters (m, np), or (np,) of them all."""
        return self.fields(xs, self.data(xs, p))

    @cached_property
    def fields(self) -> ElementwiseFunction:
        """The field at several points, (x, parameters with the data of a piece) -> rates, watched quantities."""
        return ElementwiseFunction(self.vector_field.field)

    def data(self, xs: Array, p: Array) -> Array:
        """Parameters (m, np), or (np,) of all, with the data of the piece of each state (m, n): (m, np + nq), without
        pieces (1, np) for those of all."""
        ps = np.atleast_2d(p)
        if self.phase.pieces is None:
            return ps
        return np.hstack([np.broadcast_to(ps, (len(xs), ps.shape[1])), self.data_of_pieces(xs, ps)])

    def piece_data(self, xs: Array, ps: Array) -> tuple[Array, Array]:
        """Data (m, nq) of the pieces at states (m, n) with parameters (m, np) or (1, np), and the derivatives
        (m, nq, np)."""
        values = self.data_of_pieces(xs, ps)
        if self.phase.pieces is None or not self._pieces_at.parameters:
            return values, np.zeros((*values.shape, ps.shape[1]))
        (breaks, data), slopes = self._pieces_at(ps), self._slopes_at(ps)
        slopes = slopes[:, breaks.shape[1] :].reshape(len(slopes), *data.shape[1:], -1)
        return values, slopes[np.arange(len(xs)) if len(slopes) > 1 else 0, self.piece(xs, ps, breaks)]

    def data_of_pieces(self, xs: Array, ps: Array) -> Array:
        """Data (m, nq) of the pieces at states (m, n) with parameters (m, np) or (1, np)."""
        if self.phase.pieces is None:
            return np.zeros((len(xs), 0))
        breaks, data = self._pieces_at(ps)
        return data[np.arange(len(xs)) if len(data) > 1 else 0, self.piece(xs, ps, breaks)]

    def mesh_data(self, motions: Trajectories, ps: Array) -> Array:
        """Parameters (m, np) with the data of the piece that each step of motions lies in, (N, np + nq)."""
        own = ps[motions.owner]
        if self.phase.pieces is None:
            return own
        return np.hstack([own, self.data_of_pieces(self._middles(motions), own)])

    def mesh_pieces(self, path: Trajectory, p: Array) -> Array:
        """Index (N,) of the piece that each step of a motion lies in."""
        return self.pieces_of(self._middles(Trajectories.of([path])), p[None])

    def _middles(self, motions: Trajectories) -> Array:
        """The states (N, n) in the middle of each step."""
        return evaluate(motions.coefficients[:, : self.size], 0.5 * motions.steps[:, None])

    def pieces_of(self, xs: Array, ps: Array) -> Array:
        """Indices (m,) of the pieces that contain states (m, n) with parameters (m, np)."""
        return self.piece(xs, ps, self._pieces_at(ps)[0])

    def piece(self, xs: Array, ps: Array, breaks: Array) -> Array:
        """Indices (m,) of the pieces between breaks (m, k + 1) or (1, k + 1) that contain states (m, n)."""
        return np.clip(_breaks_below(breaks, self._places(xs, ps)) - 1, 0, breaks.shape[1] - 2)

    def _places(self, xs: Array, ps: Array) -> Array:
        """The coordinates (m,) of states (m, n) that are compared with breakpoints."""
        assert self.phase.pieces is not None
        return self.phase.pieces.place(xs, dict(zip(self.parameters, ps.T, strict=True)))

    @cached_property
    def coordinate(self) -> Array:
        """Weights (n,) of the coordinate whose breakpoints bound the pieces."""
        assert self.phase.pieces is not None
        return np.array(self.phase.pieces.coordinate)

    def piece_table(self, p: Array) -> tuple[Array, Array, Array]:
        """Breaks (m + 1,), data (m, nq) and its derivatives (m, nq, np) at parameters (np,)."""
        (breaks,), (data,) = self._pieces_at(p[None])
        assert self.phase.pieces is not None
        levels = self.phase.pieces.levels(breaks, dict(zip(self.parameters, p.tolist(), strict=True)))
        return levels, data, self._slopes_at(p[None])[0, len(breaks) :].reshape(*data.shape, len(p))

    @cached_property
    def _pieces_at(self) -> PieceTable:
        """Breaks (m, k + 1) and data (m, k, nq) at parameters (m, np), for m = 1 where they are the same for all."""
        pieces, p = self.phase.pieces, ca.SX.sym("p", len(self.parameters))
        assert pieces is not None
        return PieceTable(p, *pieces.table(self.symbols(ca.SX(0, 1), p)[1]))

    def _slopes_at(self, ps: Array) -> Array:
        """The derivatives (m, k + 1 + k nq, np) of breaks and data, one row of the data after the other."""
        return self._piece_slopes(self._pieces_at.different(ps))[0]

    @cached_property
    def _piece_slopes(self) -> MappedFunction:
        """Parameters -> the derivatives of breaks and data."""
        p = ca.SX.sym("p", len(self.parameters))
        breaks, data = self._pieces_at.function(p)
        slopes = ca.jacobian(ca.vertcat(breaks, ca.vec(data.T)), p)
        return MappedFunction(ca.Function("slopes", [p], [ca.densify(slopes)]))

    def breakpoints(self, p: ca.SX) -> ca.SX:
        """The breakpoints as expressions of the parameters, those at the ends of the range included."""
        return self._pieces_at.function(p)[0]

    @cached_property
    def breaks(self) -> int:
        """The number of breakpoints, those at the ends of the range included; 0 for a smooth field."""
        return self._pieces_at.function.numel_out(0) if self.phase.pieces else 0

    def depends_on(self, name: str) -> bool:
        """Whether the table of pieces depends on a parameter."""
        return self.phase.pieces is not None and self.parameters.index(name) in self._pieces_at.parameters

    def moves_with(self, name: str) -> bool:
        """Whether the field depends on a parameter, by its expression or by the table of its pieces."""
        rows, place = self.vector_field.field.jac_sparsity(0, 1).get_triplet()[1], self.parameters.index(name)
        return place in rows or self.depends_on(name)

    def varied(self, parameter_seeds: Array) -> tuple[int, ...]:
        """The rows of the seeds (..., np, columns) of parameters that are not zero, and those of the data of a piece if
        one of these parameters changes it."""
        rows = rows_used(parameter_seeds)
        if self.phase.pieces is None or not {*self._pieces_at.parameters} & {*rows}:
            return rows
        count = len(self.parameters)
        return *rows, *range(count, count + self.phase.pieces.size)

    def first_pieces(self, starts: Array, ps: Array) -> Array:
        """Numbers (m,) of the pieces on which motions from states (m, n) begin, from 1 on; 0, or one more than there
        are pieces, where there is none.

        From a breakpoint, up to rounding, a motion enters a piece by the rate of the coordinate or, where that
        vanishes, the rate of the rate.
        """
        (breaks, data), places = self._pieces_at(ps), self._places(starts, ps)
        numbers, last = _breaks_below(breaks, places), breaks.shape[1] - 1
        each = np.arange(len(breaks)) if len(breaks) > 1 else 0
        nearest = breaks[each, np.clip([numbers - 1, numbers], 0, last)]
        numbers -= breaks[:, -1] == places
        on = (same_place(nearest, places).any(0) & (numbers > 0) & (numbers <= last)).nonzero()[0]
        if len(on):
            xs, own = starts[on], ps[on] if len(ps) > 1 else np.tile(ps, (len(on), 1))
            with_data = np.hstack([own, data[on if len(data) > 1 else 0, numbers[on] - 1]])
            rates = self.fields(xs, with_data)[0]
            heading = rates @ self.coordinate
            turns = (self.fields(xs + rates, with_data)[0] - rates) @ self.coordinate
            heading = np.where(heading == 0, turns, heading)
            own = on if len(breaks) > 1 else 0
            numbers[on] += (heading > 0) & same_place(breaks[own, numbers[on]], places[on])
            numbers[on] -= (heading < 0) & same_place(breaks[own, numbers[on] - 1], places[on])
        return numbers.astype(float)

    def approach(self, x: Array, p: Array, index: int) -> tuple[Array, Array]:
        """The derivatives (n,) and (np,) of the distance from a breakpoint, by the state and by the parameters."""
        by_x, by_p = (each.ravel() for each in self._approach(x, p))
        return by_x, by_p - (self._slopes_at(p[None])[0, index] if self._pieces_at.parameters else 0.0)

    @cached_property
    def _approach(self) -> BufferedFunction:
        graph = self.vector_field
        arguments = graph.place.sx_in()
        slopes = [ca.densify(ca.jacobian(graph.place(*arguments), each)) for each in arguments]
        return BufferedFunction(ca.Function("approach", arguments, slopes))

    def jumps(self, p: Array) -> list[float]:
        """The breakpoints inside the range at which the field jumps, at parameters (np,), where the other coordinates
        and all speeds are 0."""
        if self.phase.pieces is None:
            return []
        levels, data, _ = self.piece_table(p)
        levels, weights = levels[1:-1], self.coordinate
        places, away = levels[:, None] * weights / (weights @ weights), SIDE_DISTANCE * (1 + np.abs(levels))[:, None]
        away = away * weights / (weights @ weights)
        sides = [
            self.fields(places + side * k * away, np.hstack([np.tile(p, (len(levels), 1)), rows]))[0]
            for side, rows in ((-1, data[:-1]), (1, data[1:]))
            for k in (1, 2)
        ]
        jump = np.abs(2 * (sides[2] - sides[0]) - (sides[3] - sides[1])).max(1)
        return levels[jump > LEAST_JUMP * (1 + np.abs(sides[0]).max(1))].tolist()

    def out_of_range(self, p: Array, x: Array) -> OutOfRange:
        """The error of a motion that leaves the range of its law at the state `x`."""
        breaks, pieces = self.piece_table(p)[0], self.phase.pieces
        assert pieces is not None
        text = f"the {{label}} {OUT_OF_LAW}, [{{low:.6g}}, {{high:.6g}}], at {{place:.6g}}"
        along = self.phase.states[int(np.flatnonzero(self.coordinate)[0])]
        low, high, place = (Quantity(float(number), along) for number in (breaks[0], breaks[-1], self.coordinate @ x))
        return OutOfRange(Message(text, label=pieces.label, low=low, high=high, place=place))


def _breaks_below(breaks: Array, places: Array) -> Array:
    """How many of the breaks (m, k + 1), or (1, k + 1) of all, are not above places (m,)."""
    if len(breaks) == 1:
        return np.searchsorted(breaks[0], places, "right")
    return (breaks <= places[:, None]).sum(1)
