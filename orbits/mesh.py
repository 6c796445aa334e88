"""A statement's equations on meshes of its motions' own Taylor steps: one CasADi graph, with all its derivatives.

The states at the nodes are unknowns beside those of the statement, so that the derivatives stay sparse and small
changes do not grow along the motion. What the nodes divide an arc into are shares of its duration.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from .flow import flow
from .model import Statement

# A mesh has this many times the steps that its motion needs, and a few more, so that it serves the neighbours too; of
# few numbers of steps, so that the graph is built for few.
ROOM, SPARE, GROUPS = 1.1, 1, 4


@dataclass(frozen=True, eq=False)
class Motion:
    """A statement's arcs travelled at one point.

    shares : of each arc (N,), the steps as parts of its duration
    nodes : of each arc (n, N), the states at the steps' ends
    sizes : of each arc (n,), the largest of each state, at least 1
    """

    shares: tuple[np.ndarray, ...]
    nodes: tuple[np.ndarray, ...]
    sizes: tuple[np.ndarray, ...]

    @property
    def counts(self) -> tuple[int, ...]:
        """Steps of each arc."""
        return tuple(map(len, self.shares))


def travel(statement: Statement, u: dict, p: dict) -> Motion:
    """The motion of a statement at unknowns and parameters by name, on meshes with room for the neighbours'."""
    shares, nodes, sizes, last = [], [], [], []
    for arc in statement.arcs:
        start, duration = [float(x) for x in arc.start(u, last, p)], float(arc.duration(u, p))
        path, _ = flow(arc.phase, tuple(p)).run(start, np.array(list(p.values())), duration)
        places = np.linspace(0, len(path.steps), GROUPS * int(np.ceil((ROOM * len(path.steps) + SPARE) / GROUPS)) + 1)
        times = np.interp(places, np.arange(len(path.times)), path.times)
        states = path(times[1:])[:, : len(start)]
        shares.append(np.diff(times) / times[-1])
        nodes.append(states.T)
        sizes.append(np.maximum(np.abs(states).max(0), 1.0))
        last = states[-1].tolist()
    return Motion(tuple(shares), tuple(nodes), tuple(sizes))


class Mesh:
    """The graph of a statement with `counts` steps of its arcs, at expressions `u` (n,) and `p` (np,) of the unknowns
    and the parameters.

    nodes : symbol of all nodes, arc by arc and step by step
    data : symbol of what a motion fixes: shares and sizes, see `data_of`
    equations : vanish on a solution; of order one: the steps', then the statement's own
    ends : of each arc, the state at its end
    """

    def __init__(self, statement: Statement, parameters: tuple[str, ...], counts: Sequence[int], u: ca.MX, p: ca.MX):
        sizes = [len(arc.phase.states) for arc in statement.arcs]
        self.nodes = ca.MX.sym("x", sum(n * count for n, count in zip(sizes, counts, strict=True)))
        self.data = ca.MX.sym("mesh", sum(n + count for n, count in zip(sizes, counts, strict=True)))
        self.ends: list[ca.MX] = []
        steps, own, place, at, before = [], [], 0, 0, ca.MX(0, 1)
        for arc, n, count in zip(statement.arcs, sizes, counts, strict=True):
            states = ca.reshape(self.nodes[place : place + n * count], n, count)
            shares, size = self.data[at : at + count].T, self.data[at + count : at + count + n]
            depart, arrive = ends_of(statement, parameters, arc, before.numel())
            start, duration = depart(u, before, p)
            step = flow(arc.phase, parameters).graph.step.map(count)
            there = step(ca.horzcat(start, states[:, :-1]), duration * shares, ca.repmat(p, 1, count))
            steps.append(ca.vec((there - states) / size))
            before = states[:, -1]
            own.append(arrive(u, start, before, p))
            self.ends.append(before)
            place, at = place + n * count, at + count + n
        self.equations = ca.vertcat(*steps, *own)

    @staticmethod
    def data_of(motion: Motion) -> np.ndarray:
        """The values of `data`."""
        return np.concatenate([part for pair in zip(motion.shares, motion.sizes, strict=True) for part in pair])

    @staticmethod
    def nodes_of(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """The values of `nodes`, and what counts as one unit of each."""
        values = np.concatenate([nodes.ravel(order="F") for nodes in motion.nodes])
        units = [np.tile(size, len(shares)) for size, shares in zip(motion.sizes, motion.shares, strict=True)]
        return values, np.concatenate(units)


def ends_of(statement: Statement, parameters: tuple[str, ...], arc, before: int) -> tuple[ca.Function, ca.Function]:
    """Where an arc starts and for how long, (u, state before, p); and what vanishes at its ends, (u, start, end, p)."""
    u, p = ca.SX.sym("u", len(statement.unknowns)), ca.SX.sym("p", len(parameters))
    named = dict(zip(statement.unknowns, ca.vertsplit(u), strict=True))
    values = dict(zip(parameters, ca.vertsplit(p), strict=True))
    last = ca.SX.sym("b", before)
    x, y = (ca.SX.sym(name, len(arc.phase.states)) for name in "xy")
    start = ca.vertcat(*arc.start(named, ca.vertsplit(last), values))
    holds = [*arc.guard(named, ca.vertsplit(x), values, []), *arc.conditions(named, ca.vertsplit(y), values)]
    depart = ca.Function("depart", [u, last, p], [ca.densify(start), ca.SX(arc.duration(named, values))])
    return depart, ca.Function("arrive", [u, x, y, p], [ca.densify(ca.vertcat(*holds))])
