"""Multiple shooting: a statement's equations with every integration step a node, for a solver such as Ipopt."""

import casadi as ca
import numpy as np

from ..flow.flow import Flow
from ..flow.trajectory import Trajectory


class MultipleShooting:
    """The multiple-shooting equations of a statement, from its `Shooting`, on the mesh of its motion at a guess.

    Unknowns: u; per arc, the times of its legs (between breakpoints) where there is more than one; the state at the
    end of every step. Equations, each of order one: step(x[k-1]) - x[k]; on a breakpoint, coordinate - level; the sum
    of the legs' times; the statement's own conditions.
    """

    def __init__(self, equations, u, p):
        self.parts = [ca.MX.sym("u", equations.size)]
        self.guesses, self.scales = [u], [np.maximum(np.abs(u), 1.0)]
        self.lowers = [np.full(equations.size, -np.inf)]
        for name in equations.statement.durations:
            index = equations.statement.unknowns.index(name)
            self.lowers[0][index] = 1e-3 * u[index]  # else the solver collapses the phase
        self.zeros: list[ca.MX] = []
        last = ca.MX(0, 1)
        here = equations.evaluate(u, p)
        for along, path, (depart, arrive) in zip(equations.flows, here.trajectories, equations.ends, strict=True):
            depart = depart.function(self.parts[0], last, p)[0]
            start, duration = depart[:-1], depart[-1]
            last = self._arc(along, path, start, duration, p)
            q, _ = along.piece_data(path.coefficients[0, : along.size, 0], p)
            self.zeros.append(arrive.function(self.parts[0], start, last, p, q)[0])

    unknowns = property(lambda self: ca.vertcat(*self.parts))
    equations = property(lambda self: ca.vertcat(*self.zeros))
    guess = property(lambda self: np.concatenate(self.guesses))
    lower = property(lambda self: np.concatenate(self.lowers))
    scale = property(lambda self: np.concatenate(self.scales))

    def _new(self, name: str, guess, lower: float, scale) -> ca.MX:
        symbol = ca.MX.sym(name, len(guess))
        self.parts.append(symbol)
        self.guesses.append(guess)
        self.lowers.append(np.full(len(guess), lower))
        self.scales.append(np.broadcast_to(scale, guess.shape))
        return symbol

    def _arc(self, along: Flow, path: Trajectory, start: ca.MX, duration: ca.MX, p) -> ca.MX:
        """Add an arc's nodes and equations; returns the state at its end."""
        n, count = along.size, len(path.steps)
        nodes = np.vstack([path.coefficients[1:, :n, 0], path.end[:n]])
        size = np.maximum(np.abs(path.coefficients[:, :n, 0]).max(0), 1.0)
        states = ca.reshape(self._new("x", nodes.ravel(), -np.inf, np.tile(size, count)), n, count)
        before = ca.horzcat(start, states[:, :-1])
        leg, levels, data = self._legs(along, path, p)
        times = np.bincount(leg, path.steps)
        if len(times) == 1:
            lengths = duration
        else:
            lengths = self._new("t", times, 0.0, 1.0)
            self.zeros.append((ca.sum1(lengths) - duration) / times.sum())
        steps = ca.vertcat(*[lengths[int(i)] * (h / times[i]) for i, h in zip(leg, path.steps, strict=True)]).T
        ends = along.vector_field.step.map(count)(before, steps, ca.DM(data))
        self.zeros.append(ca.vec((ends - states) / size))
        for i, level in enumerate(levels):
            last = int(np.flatnonzero(leg == i)[-1])
            place = ca.DM(along.phase.pieces.coordinate).T @ states[:, last]
            self.zeros.append((place - level) / max(abs(level), 1.0))
        return states[:, -1]

    @staticmethod
    def _legs(along: Flow, path: Trajectory, p):
        """Leg of each step (N,), level at the end of each leg but the last, parameters with data (np + nq, N)."""
        data = along.mesh_data(path, p)
        if along.phase.pieces is None:
            return np.zeros(len(path.steps), int), [], data
        breaks = along.piece_table(p)[0]
        piece = along.mesh_pieces(path, breaks)
        change = np.diff(piece) != 0
        levels = [breaks[max(a, b)] for a, b in zip(piece[:-1][change], piece[1:][change], strict=True)]
        return np.concatenate([[0], np.cumsum(change)]), levels, data
