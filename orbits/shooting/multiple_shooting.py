"""Multiple shooting: the equations of a statement with the state at the end of every integration step as an unknown."""

from typing import Any

import casadi as ca
import numpy as np

from ..flow import Flow, Trajectories, Trajectory
from ..model import Statement

# A duration stays above this share of its guess: a solver that shrinks it to zero collapses the phase.
SHORTEST_DURATION = 1e-3


def boundary_functions(statement: Statement, parameters: tuple[str, ...]) -> list[tuple[ca.Function, ca.Function]]:
    """For each arc of a statement, its start and the residuals at its ends.

    The first function is (u, end of the arc before, p) -> (start, duration). The second is (u, start, end, p, q) ->
    residuals of the guard and of the conditions.
    """
    u, p = ca.SX.sym("u", len(statement.unknowns)), ca.SX.sym("p", len(parameters))
    unknowns = dict(zip(statement.unknowns, ca.vertsplit(u), strict=True))
    values = dict(zip(parameters, ca.vertsplit(p), strict=True))
    functions, size_before = [], 0
    for arc in statement.arcs:
        size = len(arc.phase.states)
        before, x, y = ca.SX.sym("before", size_before), ca.SX.sym("x", size), ca.SX.sym("y", size)
        q = ca.SX.sym("q", arc.phase.pieces.size if arc.phase.pieces else 0)
        start = ca.vertcat(*arc.start(unknowns, ca.vertsplit(before), values))
        guard = arc.guard(unknowns, ca.vertsplit(x), values, ca.vertsplit(q))
        residuals = ca.vertcat(*guard, *arc.conditions(unknowns, ca.vertsplit(y), values))
        leaving = [ca.densify(start), ca.SX(arc.duration(unknowns, values))]
        arrival = ca.Function("arrival", [u, x, y, p, q], [ca.densify(residuals)])
        functions.append((ca.Function("departure", [u, before, p], leaving), arrival))
        size_before = size
    return functions


def defects(flow: Flow, start: ca.MX, nodes: ca.MX, steps: ca.MX, data: ca.MX | ca.DM, sizes: ca.MX | ca.DM) -> ca.MX:
    """The differences (n N,) between the ends of the integration steps and the shooting nodes, in units of `sizes`.

    start : state (n,) at the start of the arc
    nodes : states (n, N) at the ends of the steps
    steps : step sizes (1, N)
    data : parameters of each step with the data of its smooth piece, (np + nq, N)
    """
    ends = flow.vector_field.step.map(nodes.shape[1])(ca.horzcat(start, nodes[:, :-1]), steps, data)
    return ca.vec((ends - nodes) / sizes)


class MultipleShooting:
    """The multiple-shooting equations of a statement, on the mesh of its trajectories at a guess.

    Unknowns: u; per arc, the times of its legs (between breakpoints) where there is more than one; the shooting nodes.
    Equations, each of order one: the defects; at a breakpoint, coordinate - level; the sum of the legs' times; the
    statement's own conditions. The argument `equations` is a `Shooting`.
    """

    def __init__(self, equations: Any, u: np.ndarray, p: np.ndarray):
        statement = equations.statement
        lower = np.full(equations.size, -np.inf)
        lower[equations.durations] = SHORTEST_DURATION * u[equations.durations]
        self._parts: list[tuple] = []
        self._equations: list[ca.MX] = []
        symbol = self._add_unknowns("u", u, lower, np.maximum(np.abs(u), 1.0))
        before, trajectories = ca.MX(0, 1), equations.evaluate(u, p).trajectories
        boundaries = boundary_functions(statement, equations.parameters)
        for flow, path, (departure, arrival) in zip(equations.flows, trajectories, boundaries, strict=True):
            start, duration = departure(symbol, before, p)
            before = self._add_arc(flow, path, start, duration, p)
            (q,) = flow.data_of_pieces(path.coefficients[:1, : flow.size, 0], p[None])
            self._equations.append(arrival(symbol, start, before, p, q))
        unknowns, *values = zip(*self._parts, strict=True)
        self.unknowns, self.equations = ca.vertcat(*unknowns), ca.vertcat(*self._equations)
        self.guess, self.lower, self.scale = map(np.concatenate, values)

    def _add_unknowns(self, name: str, guess: np.ndarray, lower, scale) -> ca.MX:
        """A symbol for further unknowns."""
        symbol = ca.MX.sym(name, len(guess))
        self._parts.append((symbol, guess, *(np.broadcast_to(bound, guess.shape) for bound in (lower, scale))))
        return symbol

    def _add_arc(self, flow: Flow, path: Trajectory, start: ca.MX, duration: ca.MX, p: np.ndarray) -> ca.MX:
        """Add the shooting nodes and the equations of an arc, and return the state at its end."""
        n, count = flow.size, len(path.steps)
        guess = np.vstack([path.coefficients[1:, :n, 0], path.end[:n]])
        sizes = np.maximum(np.abs(path.coefficients[:, :n, 0]).max(0), 1.0)
        nodes = ca.reshape(self._add_unknowns("x", guess.ravel(), -np.inf, np.tile(sizes, count)), n, count)
        leg, levels, coordinate = _legs(flow, path, p)
        times = np.bincount(leg, path.steps)
        leg_times = duration
        if len(times) > 1:
            leg_times = self._add_unknowns("t", times, 0.0, 1.0)
            self._equations.append((ca.sum1(leg_times) - duration) / times.sum())
        steps = ca.vertcat(*[leg_times[int(i)] * (h / times[i]) for i, h in zip(leg, path.steps, strict=True)]).T
        data = ca.DM(flow.mesh_data(Trajectories.of([path]), p[None])).T
        self._equations.append(defects(flow, start, nodes, steps, data, sizes))
        for i, level in enumerate(levels):
            last = int(np.flatnonzero(leg == i)[-1])
            self._equations.append((ca.DM(coordinate).T @ nodes[:, last] - level) / max(abs(level), 1.0))
        return nodes[:, -1]


def _legs(flow: Flow, path: Trajectory, p: np.ndarray) -> tuple[np.ndarray, list[float], tuple[float, ...]]:
    """The leg that each step (N,) belongs to, the breakpoint at the end of each leg but the last, and the weights of
    the coordinate that has them."""
    if flow.phase.pieces is None:
        return np.zeros(len(path.steps), int), [], ()
    breaks = flow.piece_table(p)[0]
    piece = flow.mesh_pieces(path, p)
    change = np.diff(piece) != 0
    levels = [breaks[max(a, b)] for a, b in zip(piece[:-1][change], piece[1:][change], strict=True)]
    return np.concatenate([[0], np.cumsum(change)]), levels, flow.phase.pieces.coordinate
