"""The dynamics of one phase in numbers: its vector field, the data of its smooth pieces, and the steppers."""

from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..model.phase import Phase
from ..symbolic.calls import BufferedFunction, ElementwiseFunction
from .runge_kutta import RungeKuttaStepper
from .taylor import TaylorStepper
from .trajectory import Trajectories, Trajectory
from .vector_field import FLOW_CONTROL, VectorField


class PhaseDynamics:
    """The vector field of a phase and what integrates it; `parameters` names the entries of parameter vectors (np,).

    The data (np + nq,) of a piecewise field are the parameters followed by the nq values of the smooth piece that the
    state is on. `control` bounds the steps of all motions.
    """

    control = FLOW_CONTROL

    def __init__(self, phase: Phase, parameters: tuple[str, ...]):
        self.phase, self.parameters = phase, tuple(parameters)
        self.size = len(phase.states)
        self.names = (*phase.states, *phase.watch)
        self.steppers: dict[tuple, TaylorStepper | RungeKuttaStepper] = {}
        # Steps in the first block of motions up to a zero: one more than the most that recent ones took.
        self.expected_steps = self.control.look_ahead

    @cached_property
    def vector_field(self) -> VectorField:
        """The expression graph of the field; its parameters are followed by the data of a piece."""
        count = self.phase.pieces.size if self.phase.pieces else 0
        x, p = ca.SX.sym("x", self.size), ca.SX.sym("p", len(self.parameters) + count)
        arguments = self.symbols(x, p)
        rates = ca.vertcat(*self.phase.field(*arguments))
        watched = ca.vertcat(*[quantity(*arguments) for quantity in self.phase.watch.values()])
        return VectorField(ca.Function("field", [x, p], ca.cse([rates, watched])), x, p)

    def symbols(self, x: ca.SX, p: ca.SX) -> tuple[list, dict, list]:
        """The arguments (x, p, q) of a phase's expressions from vectors of states and of parameters with piece data."""
        entries = ca.vertsplit(p)
        return ca.vertsplit(x), dict(zip(self.parameters, entries, strict=False)), entries[len(self.parameters) :]

    @cached_property
    def method(self) -> str:
        """'closed form', 'Taylor' or 'Runge-Kutta'."""
        if self.phase.closed_form:
            return "closed form"
        return "Taylor" if self.vector_field.has_series else "Runge-Kutta"

    @cached_property
    def smooth(self) -> bool:
        """Whether motions are Taylor series that no breakpoint ends, at least where parameters vary."""
        return self.vector_field.has_series and not self.phase.pieces

    @property
    def compiled(self) -> bool:
        """Whether a step function has been compiled."""
        return any(isinstance(stepper, TaylorStepper) and stepper.compiled for stepper in self.steppers.values())

    def stepper(self, columns: int, varied: tuple[int, ...] = ()) -> TaylorStepper | RungeKuttaStepper:
        """The stepper that integrates so many columns of sensitivities, built on first use.

        varied : rows of the parameters, with the data of a piece, whose seeds are not zero
        """
        if (columns, varied) not in self.steppers:
            form = TaylorStepper if self.vector_field.has_series else RungeKuttaStepper
            self.steppers[columns, varied] = form(self.vector_field, columns, varied)
        return self.steppers[columns, varied]

    def rates(self, x: ArrayLike, p: ArrayLike) -> np.ndarray:
        """The field at one state (n,), with parameters and piece data (np + nq,)."""
        return self._rates(x, p)[0].ravel()

    @cached_property
    def _rates(self) -> BufferedFunction:
        x, p = self.vector_field.x, self.vector_field.p
        return BufferedFunction(ca.Function("rates", [x, p], [ca.densify(self.vector_field.field(x, p)[0])]))

    def field(self, xs: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates (m, n) and watched quantities (m, k) at states (m, n) with the same parameters (np,)."""
        rates, watched = self.fields(xs, self.data(xs, p))
        return rates, watched

    @cached_property
    def fields(self) -> ElementwiseFunction:
        """The field at several points, (x, parameters with the data of a piece) -> rates, watched quantities."""
        return ElementwiseFunction(self.vector_field.field)

    def data(self, xs: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Parameters with the data of the piece of each state (m, n): (m, np + nq), or (1, np) without pieces."""
        if self.phase.pieces is None:
            return np.reshape(p, (1, -1))
        breaks, table, _ = self.piece_table(p)
        return np.hstack([np.tile(p, (len(xs), 1)), table[self.piece(xs, breaks)]])

    def piece_data(self, x: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Data (nq,) of the piece at state `x` and its derivatives (nq, np)."""
        if self.phase.pieces is None:
            return np.zeros(0), np.zeros((0, len(p)))
        breaks, table, slopes = self.piece_table(p)
        index = self.piece(x, breaks)
        return table[index], slopes[index]

    def mesh_data(self, path: Trajectory, p: np.ndarray) -> np.ndarray:
        """Parameters with the data of the piece that each step of a motion lies in, (np + nq, N)."""
        if self.phase.pieces is None:
            return np.tile(np.asarray(p, dtype=float)[:, None], len(path.steps))
        return self.data(self._middles(path), p).T

    def data_of(self, motions: Trajectories, ps: np.ndarray) -> np.ndarray:
        """`mesh_data` of several motions with parameters (m, np), transposed: (N, np + nq)."""
        if self.phase.pieces is None:
            return ps[motions.owner]
        return np.concatenate([self.mesh_data(path, p).T for path, p in zip(motions, ps, strict=True)])

    def mesh_pieces(self, path: Trajectory, breaks: np.ndarray) -> np.ndarray:
        """Index (N,) of the piece that each step of a motion lies in."""
        return self.piece(self._middles(path), breaks)

    def _middles(self, path: Trajectory) -> np.ndarray:
        return path(0.5 * (path.times[1:] + path.times[:-1]))[:, : self.size]

    def piece(self, x: np.ndarray, breaks: np.ndarray) -> np.ndarray:
        """Indices (...) of the pieces that hold states (..., n)."""
        return np.clip(np.searchsorted(breaks, x @ self.coordinate, "right") - 1, 0, len(breaks) - 2)

    @cached_property
    def coordinate(self) -> np.ndarray:
        """Weights (n,) of the coordinate whose breakpoints bound the pieces."""
        assert self.phase.pieces is not None
        return np.array(self.phase.pieces.coordinate)

    def piece_table(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Breaks (m + 1,), data (m, nq) and its derivatives (m, nq, np) at parameters (np,)."""
        breaks, data, slopes = self._piece_function(p)
        return breaks.ravel(), data, slopes.reshape(data.shape[1], data.shape[0], len(p)).swapaxes(0, 1)

    @cached_property
    def _piece_function(self) -> BufferedFunction:
        pieces, p = self.phase.pieces, ca.SX.sym("p", len(self.parameters))
        assert pieces is not None
        breaks, rows = pieces.table(self.symbols(ca.SX(0, 1), p)[1])
        data = ca.vertcat(*[ca.horzcat(*row) for row in rows]) if pieces.size else ca.SX(len(rows), 0)
        results = ca.vertcat(*breaks), data, ca.jacobian(ca.vec(data), p)
        return BufferedFunction(ca.Function("pieces", [p], [ca.densify(result) for result in results]))
