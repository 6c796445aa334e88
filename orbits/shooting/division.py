"""Shooting by several arcs: motions are divided at nodes, whose states are further unknowns.

Near an unstable equilibrium a small change grows exponentially, and a motion that stays there for long is not
determined by its start in floating-point numbers. Between two nodes it grows little, so that the equations with nodes
determine the motion, and all derivatives, to rounding.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from typing import TypeAlias

import numpy as np

from ..errors import FlowError, NoOrbit
from ..flow import Trajectories, Trajectory
from ..model import Arc, Statement
from ..numerics import Array
from ..symbolic import cached
from .error_bound import error_bounds
from .newton_kernel import newton_kernel
from .node_places import DIVISION, GrowthAlong, growths_along, largest_growths, lengths_of_parts
from .single_shooting import NEWTON, Evaluation, Shooting, joined, settles, shooting_equations

# The parts of each arc, by the shares of its duration that they take.
PartsOfArcs: TypeAlias = tuple[tuple[float, ...], ...]


@cached
def divided_statement(statement: Statement, parts: PartsOfArcs) -> Statement:
    """A statement whose arcs are divided into parts; the states at the nodes are unknowns, in front of the tuned
    parameters."""
    own, nodes, arcs = len(statement.unknowns) - len(statement.tuned), list[str](), list[Arc]()
    for number, (arc, lengths) in enumerate(zip(statement.arcs, parts, strict=True), start=1):
        names = [[f"{state} at node {k} of arc {number}" for state in arc.phase.states] for k in range(1, len(lengths))]
        nodes += [name for each in names for name in each]
        ends = zip(lengths, [None, *names], [*names, None], strict=True)
        arcs += [_between_nodes(arc, length, here, there) for length, here, there in ends]
    unknowns = *statement.unknowns[:own], *nodes, *statement.unknowns[own:]
    return replace(statement, unknowns=unknowns, arcs=tuple(arcs))


def _between_nodes(arc: Arc, length: float, here: list[str] | None, there: list[str] | None) -> Arc:
    """A part of an arc, of this share of its duration, between two nodes, stated by the names of their states; None for
    an end."""
    part = replace(arc, duration=lambda u, p: arc.duration(u, p) * length)
    if here:
        part = replace(part, start=lambda u, before, p: [u[name] for name in here], guard=lambda u, x, p, q: [])
    if there:
        part = replace(part, conditions=lambda u, x, p: [end - u[name] for end, name in zip(x, there, strict=True)])
    return part


@dataclass(frozen=True, eq=False)
class Division:
    """The equations of a statement whose arcs are divided into `parts`."""

    undivided: Shooting
    parts: PartsOfArcs

    @cached_property
    def equations(self) -> Shooting:
        """The equations with nodes."""
        return shooting_equations(divided_statement(self.undivided.statement, self.parts), self.undivided.parameters)

    @property
    def is_uneven(self) -> bool:
        """Whether a motion passes several unstable equilibria, so that the nodes are not in equal distances."""
        return any(len(set(lengths)) > 1 for lengths in self.parts)

    @cached_property
    def nodes(self) -> slice:
        """The places of the states at nodes among the unknowns."""
        return slice(self.undivided.own, self.equations.own)

    @cached_property
    def first(self) -> list[int]:
        """The first part of each arc, and the number of parts."""
        return [0, *accumulate(map(len, self.parts))]

    def least_units(self, x: Array) -> Array:
        """The least units (N,) of unknowns (N,): near the middle of a passage a rate is small, and has few digits."""
        units = np.full(len(x), NEWTON.smallest_unit)
        if self.is_uneven:
            units[self.nodes] = DIVISION.least_state * np.abs(x[self.nodes]).max()
        return units

    def bare(self, xs: Array) -> Array:
        """Unknowns (..., N), with any further columns, without the states at nodes."""
        return np.concatenate([xs[..., : self.nodes.start], xs[..., self.nodes.stop :]], axis=-1)

    def inserted(self, us: Array, states: Array) -> Array:
        """Unknowns (..., n), with any further columns, with states at nodes (..., N - n)."""
        return np.concatenate([us[..., : self.nodes.start], states, us[..., self.nodes.start :]], axis=-1)

    def lifted(self, u: Array, paths: Sequence[Trajectory]) -> Array:
        """Unknowns (n,) with the states that their motions, one for each arc, have at the nodes (N,)."""
        states = list[Array]()
        for path, flow, lengths in zip(paths, self.undivided.flows, self.parts, strict=True):
            states += [path(path.times[-1] * share)[: flow.size] for share in accumulate(lengths[:-1])]
        return np.concatenate([u[: self.nodes.start], *states, u[self.nodes.start :]])

    def growths(self, evaluation: Evaluation) -> Array:
        """The largest growths (m, arcs) of a small change from the start of each arc, by the equations with nodes."""
        return largest_growths(evaluation, counts_of_parts(self, self.undivided))

    def _transitions(self, evaluation: Evaluation, i: int) -> tuple[Array, list[Array]]:
        """The transition (m, states, states + t) of a whole arc, and those of its parts."""
        parts = list(evaluation.transitions[self.first[i] : self.first[i + 1]])
        whole, n = parts[0], parts[0].shape[1]
        for part in parts[1:]:
            whole = part[:, :, :n] @ whole
            whole[:, :, n:] += part[:, :, n:]
        return whole, parts

    def whole(self, evaluation: Evaluation) -> Evaluation:
        """The undivided equations at m points from those with nodes; each residual is the largest of all equations."""
        jacobian, rows, matching, by_end = evaluation.jacobian, list[int](), list[int](), list[Array]()
        for i, count in enumerate(map(len, self.parts)):
            begun = len(rows)
            for k in range(count):
                first, last = len(rows) + len(matching), evaluation.residual_by_end[self.first[i] + k]
                own = last.shape[1] - self.undivided.flows[i].size if k < count - 1 else last.shape[1]
                rows += range(first, first + own)
                matching += range(first + own, first + last.shape[1])
            guard = np.zeros((len(last), len(rows) - begun - last.shape[1], last.shape[2]))
            by_end.append(np.concatenate([guard, last], axis=1))
        at_nodes, others = jacobian[:, :, self.nodes], self.bare(jacobian)
        # The derivatives of the states at nodes by the other unknowns.
        moves = -np.linalg.solve(at_nodes[:, matching], others[:, matching])
        transitions, starts, trajectories, arcs = list[Array](), list[Array](), list[Trajectories](), list[Array]()
        for i in range(len(self.parts)):
            whole, parts = self._transitions(evaluation, i)
            start, paths = evaluation.starts[self.first[i]], evaluation.trajectories[self.first[i] : self.first[i + 1]]
            transitions.append(whole)
            starts.append(self.bare(start) + start[:, :, self.nodes] @ moves)
            arcs.append(np.stack([part[:, :, : part.shape[1]] for part in parts], axis=1))
            trajectories.append(_one_after_another(paths))
        largest = np.abs(evaluation.residual).max(1)[:, None]
        return Evaluation(
            np.broadcast_to(largest, (len(largest), len(rows))),
            others[:, rows] + at_nodes[:, rows] @ moves,
            tuple(trajectories),
            tuple(transitions),
            tuple(starts),
            tuple(by_end),
            tuple(arcs),
        )

    def nearest(self, x: Array, p: Array) -> Evaluation:
        """The undivided equations (1) at the solution nearest to unknowns (N,), which are those of a solution nearly:
        unknowns that the equations do not determine stay as they are. Raises `NoOrbit`."""
        xs, ps, last = x[None], p[None], np.inf
        for _ in range(DIVISION.steps_to_nearest):
            evaluation, sizes = self.equations.evaluate_all(xs, ps), np.maximum(np.abs(xs), 0.1 * np.abs(xs).max())
            step = np.linalg.lstsq(
                evaluation.jacobian[0] * sizes, -evaluation.residual[0], rcond=DIVISION.undetermined
            )[0]
            size, xs = float(np.abs(step).max()), xs + step * sizes
            if settles(size, last, evaluation.amplification[0]):
                return self.whole(self.equations.evaluate_all(xs, ps))
            last = size
        raise NoOrbit(f"the {self.equations.statement.name} equations did not converge (last relative step {last:.1e})")


@cached
def division_of(undivided: Shooting, parts: PartsOfArcs) -> Division:
    """The equations of a statement whose arcs are divided into these parts."""
    return Division(undivided, parts)


def division_at(
    undivided: Shooting, along: Sequence[GrowthAlong], u: Array, p: Array, paths: Sequence[Trajectory]
) -> tuple[Division, Array]:
    """The equations with as many nodes as motions ask for, and the unknowns with nodes (N,); raises `NoOrbit`.

    along : how a small change grows along each arc
    u, p, paths : the unknowns (n,), the parameters (np,), and the motions over the arcs
    """
    for finer in DIVISION.finer:
        parts = tuple(lengths_of_parts(each, finer) for each in along)
        if max(map(len, parts)) > DIVISION.parts:
            break
        division = division_of(undivided, parts)
        x = division.lifted(u, paths)
        if division.equations.evaluate(x, p).amplification < DIVISION.largest_part_growth:
            return division, x
    most = max(each.growths.max() for each in along)
    raise NoOrbit(f"small changes grow {most:.0e}-fold, mostly within a short time")


def growths_without_nodes(division: Division | None, evaluation: Evaluation) -> Array:
    """The largest growths (m,) of a small change that are to be divided by nodes: to any place of the motion, or where
    it has nodes from one to the next, as no node lies where changes grow and shrink again."""
    return evaluation.largest_growth if division is None else evaluation.amplification


def are_divided(growths: Array, errors: Array, alphas: Array) -> Array:
    """Whether motions with these growths (m,) over an arc, or between their nodes, and launch speeds (m,) with bounds
    on their errors are divided, or divided again."""
    off = errors > DIVISION.error * np.maximum(np.abs(alphas), 1.0)
    return (growths > DIVISION.arc_growth) | (off & (growths > DIVISION.growth))


class Undetermined(NoOrbit):
    """An orbit's launch does not determine it in floating-point numbers."""


@dataclass(frozen=True, eq=False)
class NodedSolution:
    """A solution of equations, with nodes where its motions amplify small changes.

    undivided : the equations without nodes
    division : None where no nodes are needed
    x, p : the unknowns (N,), the states at nodes among them, and the parameters (np,)
    evaluation : the equations (1) with their nodes
    """

    undivided: Shooting
    division: Division | None
    x: Array
    p: Array
    evaluation: Evaluation

    @property
    def equations(self) -> Shooting:
        """The equations with their nodes."""
        return self.division.equations if self.division else self.undivided

    @property
    def u(self) -> Array:
        """The unknowns (n,) without the states at nodes."""
        return self.division.bare(self.x) if self.division else self.x

    @property
    def whole(self) -> Evaluation:
        """The equations (1) without nodes."""
        return self.division.whole(self.evaluation) if self.division else self.evaluation

    def near(self, x: Array, p: Array) -> "NodedSolution":
        """The solution with parameters (np,) near unknowns (N,) with the same nodes; raises `NoOrbit`."""
        least = self.division.least_units(x) if self.division else NEWTON.smallest_unit
        x, evaluation = self.equations.newton(x, p, least=least)
        return replace(self, x=x, p=p, evaluation=evaluation).divided()

    def divided(self) -> "NodedSolution":
        """This solution with the nodes that its motions need; raises `NoOrbit` if its launch does not determine it."""
        if self.division and (most := self.growths.max()) > DIVISION.most_growth:
            raise Undetermined(
                f"it stays near an unstable equilibrium for so long that small changes grow {most:.0e}-fold: 16 "
                "digits of its launch do not determine it"
            )
        if (growth := float(growths_without_nodes(self.division, self.evaluation)[0])) > DIVISION.arc_growth:
            return self.with_nodes()
        if growth > DIVISION.growth and are_divided(np.array([growth]), self.error, self.alpha)[0]:
            with suppress(NoOrbit, FlowError):
                return self.or_nearer(self.with_nodes())
        return self

    def without_nodes(self) -> "NodedSolution":
        """This solution by the equations without nodes; raises `NoOrbit`."""
        u, evaluation = self.undivided.newton(self.u, self.p)
        return replace(self, division=None, x=u, evaluation=evaluation)

    def or_nearer(self, other: "NodedSolution") -> "NodedSolution":
        """The one of two descriptions of a solution with the smaller error: where small changes grow within a short
        time, it is the one without nodes."""
        same = np.abs(self.alpha - other.alpha) <= self.error + other.error
        return other if (same & (other.error < self.error))[0] else self

    def simplest(self) -> "NodedSolution":
        """This solution without nodes where they are not needed, and do not make the error smaller."""
        if self.growths.max() <= DIVISION.arc_growth:
            with suppress(NoOrbit, FlowError):
                return self.or_nearer(self.without_nodes())
        return self

    def with_nodes(self) -> "NodedSolution":
        """This solution with the nodes that its motions need, from unknowns that need not solve the equations yet."""
        whole, paths = self.whole, [each[0] for each in self.whole.trajectories]
        division, x = division_at(self.undivided, self.along, self.u, self.p, paths)
        return NodedSolution(self.undivided, division, x, self.p, whole).near(x, self.p)

    @property
    def growths(self) -> Array:
        """The largest growths (1, arcs) of a small change from the start of each arc."""
        return largest_growths(self.evaluation, counts_of_parts(self.division, self.undivided))

    @property
    def along(self) -> list[GrowthAlong]:
        """How a small change grows along each arc."""
        return growths_along(self.evaluation, counts_of_parts(self.division, self.undivided))

    @cached_property
    def error(self) -> Array:
        """A bound (1,) on the error of the launch speed."""
        at = self.x[None], self.p[None], self.evaluation
        return error_bounds(self.equations, *at, None, True, by_nodes=bool(self.division))[0]

    @property
    def alpha(self) -> Array:
        """The launch speed (1,)."""
        return self.x[[self.equations.statement.unknowns.index("alpha")]]


def solved(equations: Shooting, u: Array, p: Array, vary: str | None = None) -> tuple[Array, Evaluation]:
    """The solution (n,) near unknowns (n,) and the equations there (1), by Newton's method in one call or, where that
    does not converge nearby, step by step; raises `NoOrbit` without convergence. In the first case the equations have
    derivatives by the parameter to vary too."""
    return _in_one_call(equations, u, p, vary) or equations.newton(u, p)


def _in_one_call(equations: Shooting, u: Array, p: Array, vary: str | None = None) -> tuple[Array, Evaluation] | None:
    """The solution near unknowns by Newton's method in one call, with the equations there and their derivatives by a
    parameter; None where it leads far away or nowhere, and for motions in several arcs, without a series, or in closed
    form."""
    if not (equations.in_lanes and equations.parameters) or equations.flows[0].phase.closed_form:
        return None
    kernel = newton_kernel(equations, vary or equations.parameters[0])
    x = np.append(u, p[kernel.place])[None]  # the parameter keeps its value
    units, row = np.maximum(np.abs(x), NEWTON.smallest_unit), np.eye(1, x.size, x.size - 1)
    found = kernel(x, row, x[:, -1], units, p[None], 1, True)
    if not found.evaluation or (np.abs(found.xs - x) > NEWTON.undamped * units).any():
        return None
    return found.xs[0, :-1], found.evaluation


def solved_with_nodes(undivided: Shooting, u: Array, p: Array, solve: Callable | None = None) -> NodedSolution:
    """The solution near unknowns (n,), with nodes where its motions ask for them; where those of the unknowns amplify
    small changes, nodes are placed on these, since Newton's method without nodes would lead elsewhere.

    solve : (u, p) -> solution near u and the equations there, without nodes; None for Newton's method

    Raises `NoOrbit` without convergence.
    """
    if not solve and (found := _in_one_call(undivided, u, p)) and found[1].amplification[0] <= DIVISION.sensitive:
        return NodedSolution(undivided, None, found[0], p, found[1].of_unknowns(len(u))).divided()
    evaluation = undivided.evaluate_all(u[None], p[None])
    if evaluation.amplification[0] > DIVISION.sensitive:
        with suppress(NoOrbit, FlowError):
            divided = NodedSolution(undivided, None, u, p, evaluation).with_nodes()
            if divided.growths.max() > DIVISION.growth:
                return divided.simplest()
            u, evaluation = divided.u, divided.whole
    u, evaluation = solve(u, p) if solve else undivided.newton(u, p, evaluation=evaluation)
    return NodedSolution(undivided, None, u, p, evaluation).divided()


def counts_of_parts(division: Division | None, undivided: Shooting) -> list[int]:
    """The number of parts of each arc, 1 where there is no division."""
    return [*map(len, division.parts)] if division else [1] * len(undivided.flows)


def with_nodes(undivided: Shooting, us: Array, ps: Array, evaluation: Evaluation) -> Evaluation:
    """The equations at known solutions (m, n), by way of nodes where the motions amplify small changes; raises
    `NoOrbit`."""
    hanging = np.flatnonzero(evaluation.largest_growth > DIVISION.arc_growth).tolist()
    if not hanging:
        return evaluation
    parts = [evaluation[np.array([i])] for i in range(len(us))]
    for i in hanging:
        paths = [each[0] for each in parts[i].trajectories]
        along = growths_along(parts[i], counts_of_parts(None, undivided))
        division, x = division_at(undivided, along, us[i], ps[i], paths)
        parts[i] = division.nearest(x, ps[i])
    most = max(each.shape[1] for part in parts for each in part.parts)
    return joined([_alike(part, most) for part in parts])


def _alike(evaluation: Evaluation, count: int) -> Evaluation:
    """An evaluation (1) whose arcs have as many parts as others, some of them without a duration, and no variations."""
    paths = tuple(path.only(path.names) for path in evaluation.trajectories)
    own = evaluation.parts or tuple(each[:, None, :, : each.shape[1]] for each in evaluation.transitions)
    still = (np.broadcast_to(np.eye(each.shape[-1]), (1, count - each.shape[1], *each.shape[2:])) for each in own)
    parts = tuple(np.concatenate(each, axis=1) for each in zip(own, still, strict=True))
    return replace(evaluation, trajectories=paths, parts=parts)


def _one_after_another(paths: Sequence[Trajectories]) -> Trajectories:
    """The motions (m,) that begin with those of the first of several parts, without variations."""
    before = np.cumsum([np.zeros(len(paths[0])), *(path.ends for path in paths)], axis=0)
    owners = np.concatenate([path.owner for path in paths])
    order = np.argsort(owners, kind="stable")
    starts = np.concatenate([path.starts + start[path.owner] for path, start in zip(paths, before, strict=False)])
    coefficients, counts = (
        np.concatenate([path.coefficients for path in paths]),
        np.sum([path.counts for path in paths], axis=0),
    )
    return Trajectories(starts[order], before[-1], coefficients[order], counts, paths[0].names)
