"""Multiple shooting: the equations of a statement with the state at the end of every integration step as an unknown."""

from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..flow import Flow, Trajectories, Trajectory
from ..symbolic import EquationSolver, cached
from .arc_functions import boundary_functions

# A duration stays above this share of its guess: a solver that shrinks it to zero collapses the phase.
SHORTEST_DURATION = 1e-3


def defects(flow: Flow, start: ca.MX, nodes: ca.MX, steps: ca.MX, data: ca.MX, sizes: ca.MX) -> ca.MX:
    """The differences (n N,) between the ends of the integration steps and the shooting nodes, in units of `sizes`.

    start : state (n,) at the start of the arc
    nodes : states (n, N) at the ends of the steps
    steps : step sizes (1, N)
    data : parameters of each step with the data of its smooth piece, (np + nq, N)
    """
    ends = flow.vector_field.step.map(nodes.shape[1])(ca.horzcat(start, nodes[:, :-1]), steps, data)
    return ca.vec((ends - nodes) / sizes)


class MultipleShooting:
    """The multiple-shooting equations of a statement, on meshes with `legs`: for each arc, the number of steps of each
    leg between breakpoints. The argument `equations` is a `Shooting`.

    Unknowns: u; per arc, the shooting nodes; the times of its legs where there is more than one.
    Equations, each of order one: the defects; at a breakpoint, coordinate - level; the sum of the legs' times; the
    statement's own conditions. Parameters: those of the statement and of the meshes.
    """

    def __init__(self, equations: Any, legs: tuple[tuple[int, ...], ...]):
        self._unknowns, self._parameters, self._equations = list[ca.MX](), list[ca.MX](), list[ca.MX]()
        u, p = self._unknown(equations.size), self._parameter(len(equations.parameters))
        before = ca.MX(0, 1)
        boundaries = boundary_functions(equations.statement, equations.parameters)
        for flow, own, (departure, arrival) in zip(equations.flows, legs, boundaries, strict=True):
            start, duration = departure(u, before, p)
            before = self._add_arc(flow, own, start, duration)
            q = self._parameter(flow.phase.pieces.size if flow.phase.pieces else 0)
            self._equations.append(arrival(u, start, before, p, q))
        self.solve = EquationSolver(
            *(ca.vertcat(*each) for each in (self._unknowns, self._parameters, self._equations))
        )

    def _unknown(self, size: int) -> ca.MX:
        self._unknowns.append(ca.MX.sym("x", size))
        return self._unknowns[-1]

    def _parameter(self, size: int) -> ca.MX:
        self._parameters.append(ca.MX.sym("p", size))
        return self._parameters[-1]

    def _add_arc(self, flow: Flow, legs: tuple[int, ...], start: ca.MX, duration: ca.MX) -> ca.MX:
        """Add the unknowns, the parameters and the equations of an arc, and return the state at its end."""
        n, count, several = flow.size, sum(legs), len(legs) > 1
        nodes = ca.reshape(self._unknown(n * count), n, count)
        sizes, steps, levels = self._parameter(n), self._parameter(count), self._parameter(len(legs) - 1)
        data = ca.reshape(self._parameter(flow.vector_field.p.numel() * count), -1, count)
        begins = [0, *accumulate(legs)]
        leg_times = self._unknown(len(legs)) if several else duration
        if several:
            self._equations.append((ca.sum1(leg_times) - duration) / ca.sum1(steps))
        parts = [steps[a:b] for a, b in pairwise(begins)]
        lengths = ca.vertcat(*[part * (leg_times[i] / ca.sum1(part)) for i, part in enumerate(parts)])
        self._equations.append(defects(flow, start, nodes, lengths.T, data, sizes))
        for i, last in enumerate(begins[1:-1]):
            place = ca.DM(flow.vector_field.coordinate).T @ nodes[:, last - 1]
            self._equations.append((place - levels[i]) / ca.fmax(ca.fabs(levels[i]), 1.0))
        return nodes[:, -1]


class ArcMesh(NamedTuple):
    """The mesh of an arc: the number of steps in each leg; the guess, lower bounds and sizes of its unknowns, and its
    parameters, in the order of `MultipleShooting`."""

    legs: tuple[int, ...]
    guess: np.ndarray
    lower: np.ndarray
    scale: np.ndarray
    parameters: np.ndarray

    @classmethod
    def of(cls, flow: Flow, path: Trajectory, p: np.ndarray) -> "ArcMesh":
        """The mesh of the steps of a motion."""
        n, xs = flow.size, path.coefficients[:, : flow.size, 0]
        sizes, (q,) = np.maximum(np.abs(xs).max(0), 1.0), flow.data_of_pieces(xs[:1], p[None])
        legs, levels = _legs(flow, path, p)
        nodes = np.vstack([xs[1:], path.end[:n]]).ravel()
        times = np.add.reduceat(path.steps, [0, *accumulate(legs[:-1])]) if len(legs) > 1 else np.zeros(0)
        guess = np.concatenate([nodes, times])
        lower = np.concatenate([np.full(len(nodes), -np.inf), np.zeros(len(times))])
        scale = np.concatenate([np.tile(sizes, len(path.steps)), np.ones(len(times))])
        data = flow.mesh_data(Trajectories.of([path]), p[None]).ravel()
        return cls(legs, guess, lower, scale, np.concatenate([sizes, path.steps, levels, data, q]))


def _legs(flow: Flow, path: Trajectory, p: np.ndarray) -> tuple[tuple[int, ...], list[float]]:
    """The number of steps of each leg, and the breakpoint at the end of each leg but the last."""
    if flow.phase.pieces is None:
        return (len(path.steps),), []
    breaks = flow.piece_table(p)[0]
    piece = flow.mesh_pieces(path, p)
    changes = np.flatnonzero(np.diff(piece)) + 1
    legs = np.diff([0, *changes, len(piece)])
    return tuple(legs.tolist()), [breaks[max(piece[i - 1], piece[i])] for i in changes]


# The equations on meshes of these sizes, cached for machines with other values of the parameters.
multiple_shooting = cached(MultipleShooting)


def solve_by_ipopt(equations: Any, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """The unknowns (n,) of a `Shooting`, solved by Ipopt on the mesh of its motions at the guess `u`."""
    legs, *numbers = on_mesh(equations, u, p)
    return multiple_shooting(equations, legs).solve(*numbers)[: equations.size]


def on_mesh(equations: Any, u: np.ndarray, p: np.ndarray) -> tuple[Any, ...]:
    """The legs of each arc, and the guess, the lower bounds, the sizes and the parameters of `MultipleShooting`, at `u`
    and p."""
    paths = equations.evaluate(u, p).trajectories
    meshes = [ArcMesh.of(flow, path, p) for flow, path in zip(equations.flows, paths, strict=True)]
    lower = np.full(equations.size, -np.inf)
    lower[equations.durations] = SHORTEST_DURATION * u[equations.durations]
    legs, *numbers = zip(*meshes, strict=True)
    own = u, lower, np.maximum(np.abs(u), 1.0), p
    return legs, *(np.concatenate([first, *rest]) for first, rest in zip(own, numbers, strict=True))
