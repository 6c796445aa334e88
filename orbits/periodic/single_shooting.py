"""A boundary value statement as equations: evaluated along its flow, solved by Newton, or by multiple shooting."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ..errors import FlowError, NoOrbit
from ..flow.flow import flow_of
from ..flow.trajectory import Trajectories, Trajectory
from ..model.phase import Arc, Statement
from ..numerics.bernstein import derivative, evaluate
from ..numerics.linear import solve
from ..symbolic.calls import BufferedFunction, MappedFunction
from ..symbolic.ipopt import solve_equations
from .multiple_shooting import MultipleShooting

# A relative Newton step is the last if it changes the end of the motion by less than this: the next one, its square, is
# below rounding.
LAST = 1e-8
# ... or if it is this small and shrinks no more than by this factor: then it is rounding. (Towards a solution still far
# off, in a motion that grows small changes, they shrink by a half each.)
SMALL, STALLED_RATIO = 1e-9, 0.7


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A statement at one point; or at several, `stacked`, when all but the trajectories has one more axis in front.

    residual : (n,)
    jacobian : (n, n + k), with respect to the unknowns and to the k varied parameters
    trajectories : one per arc, with variations by its start and the varied parameters; `Trajectories` of several points
    transitions : derivatives (states, states + k) of each arc's end at fixed duration, by the same
    starts : derivatives (states + k, n + k) of the same, by the unknowns and the varied parameters
    durations : derivatives (n + k,) of each arc's duration
    residual_by_end : derivatives (rows, states) of the residuals that belong to each arc by its end
    """

    residual: np.ndarray
    jacobian: np.ndarray
    trajectories: tuple[Trajectory, ...] | tuple[Trajectories, ...]
    transitions: tuple[np.ndarray, ...]
    starts: tuple[np.ndarray, ...]
    durations: tuple[np.ndarray, ...]
    residual_by_end: tuple[np.ndarray, ...]

    def __getitem__(self, i: int | np.ndarray) -> "Evaluation":
        """One of several, or some of them in an order (k,)."""
        per_arc = self.trajectories, self.transitions, self.starts, self.durations, self.residual_by_end
        return Evaluation(self.residual[i], self.jacobian[i], *(tuple(part[i] for part in each) for each in per_arc))

    def replaced(self, i: np.ndarray, others: "Evaluation") -> "Evaluation":
        """With the points i (k,) of several, ascending, replaced by others."""
        order = np.arange(len(self.residual))
        order[i] = len(order) + np.arange(len(i))
        return _put_together(
            [self, others], lambda parts: np.concatenate(parts)[order], lambda parts: parts[0].replaced(i, parts[1])
        )

    @cached_property
    def amplification(self):
        """Of a small change of the state over the motion, the largest."""
        squares = (transition[..., : transition.shape[-2]] for transition in self.transitions)
        return np.max([np.abs(square).max((-2, -1)) for square in squares], axis=0)


def settles(size, last, growth):
    """Whether a relative Newton step is the last one worth taking: `last` is the one before, `growth` that of a small
    change of the state over the motion."""
    return (size * np.maximum(growth, 1.0) < LAST) | ((size < SMALL) & (size > STALLED_RATIO * last))


def stacked(heres: Sequence[Evaluation]) -> Evaluation:
    """A statement at several points, with or without variations at all of them."""
    return _put_together(heres, np.array, Trajectories.of)


def joined(heres: Sequence[Evaluation]) -> Evaluation:
    """As one what has been stacked in several."""
    return heres[0] if len(heres) == 1 else _put_together(heres, np.concatenate, Trajectories.joined)


def _put_together(heres: Sequence[Evaluation], arrays: Callable, motions: Callable) -> Evaluation:
    def per_arc(name: str, together: Callable) -> tuple:
        return tuple(map(together, zip(*(getattr(here, name) for here in heres), strict=True)))

    return Evaluation(
        arrays([here.residual for here in heres]),
        arrays([here.jacobian for here in heres]),
        per_arc("trajectories", motions),
        *(per_arc(name, arrays) for name in ("transitions", "starts", "durations", "residual_by_end")),
    )


@lru_cache(maxsize=64)
def shooting_equations(statement: Statement, parameters: tuple[str, ...]) -> "Shooting":
    """The equations of a statement, kept for the next call with the same statement."""
    return Shooting(statement, parameters)


class Shooting:
    """The equations F(u, p) = 0 of a statement, `parameters` naming the entries of p."""

    def __init__(self, statement: Statement, parameters: tuple[str, ...]):
        self.statement, self.parameters = statement, tuple(parameters)
        self.size = len(statement.unknowns)
        self.flows = tuple(flow_of(arc.phase, self.parameters) for arc in statement.arcs)

    @property
    def smooth(self) -> bool:
        """Whether each arc's motions are Taylor series that no breakpoint ends."""
        return all(along.smooth for along in self.flows)

    @property
    def compiled(self) -> bool:
        """Whether one of the flows has taken long enough to be compiled."""
        return any(along.compiled for along in self.flows)

    @cached_property
    def ends(self) -> list[tuple[BufferedFunction, BufferedFunction]]:
        """For each arc: where it starts and for how long, and what holds at its ends; values and derivatives."""
        functions = []
        before = 0
        u, p = ca.SX.sym("u", self.size), ca.SX.sym("p", len(self.parameters))
        for arc, along in zip(self.statement.arcs, self.flows, strict=True):
            last, x0, x1 = (ca.SX.sym(name, n) for name, n in (("b", before), ("x", along.size), ("y", along.size)))
            start, duration = self._start(arc, u, last, p)
            z = ca.vertcat(u, last, p)
            depart = ca.vertcat(start, duration)
            q = ca.SX.sym("q", arc.phase.pieces.size if arc.phase.pieces else 0)
            arguments = self._names(u, p)
            guard = arc.guard(arguments[0], ca.vertsplit(x0), arguments[1], ca.vertsplit(q))
            ends = arc.conditions(arguments[0], ca.vertsplit(x1), arguments[1])
            holds = ca.vertcat(*guard, *ends)
            w = ca.vertcat(u, x0, x1, p, q)
            functions.append(
                (
                    BufferedFunction(dense("depart", [u, last, p], [depart, ca.jacobian(depart, z)])),
                    BufferedFunction(dense("arrive", [u, x0, x1, p, q], [holds, ca.jacobian(holds, w)])),
                )
            )
            before = along.size
        return functions

    def _names(self, u, p):
        return (
            dict(zip(self.statement.unknowns, ca.vertsplit(u), strict=True)),
            dict(zip(self.parameters, ca.vertsplit(p), strict=True)),
        )

    def _start(self, arc: Arc, u, last, p):
        unknowns, named = self._names(u, p)
        start = ca.vertcat(*arc.start(unknowns, ca.vertsplit(last), named))
        return start, arc.duration(unknowns, named)

    def evaluate(self, u, p, vary: tuple[str, ...] = ()) -> Evaluation:
        """Residual, Jacobian and motion at unknowns `u` (n,) and parameters `p` (np,), each step as long as it can
        be."""
        n, k = self.size, len(vary)
        du, dp, own, seeds = self.seeds(vary)
        last, dlast = np.zeros(0), np.zeros((0, n + k))
        residuals, jacobians, arcs = [], [], []
        for along, (depart, arrive), (dx, dparameters) in zip(self.flows, self.ends, seeds, strict=True):
            value, slope = depart(u, last, p)
            dvalue = _chain(slope, du, dlast, dp)
            start, dstart = value[:-1, 0], np.vstack([dvalue[:-1], own])
            path, transition = along.run(start, p, value[-1, 0], dx, dparameters)
            end = path.end[: along.size]
            speed = evaluate(derivative(path.coefficients[-1, : along.size]), path.steps[-1])
            dend = transition @ dstart + np.outer(speed, dvalue[-1])
            q, slope = along.piece_data(start, p)
            dq = _chain(slope, dp)
            holds, slope = arrive(u, start, end, p, q)
            residuals.append(holds.ravel())
            jacobians.append(_chain(slope, du, dstart[: along.size], dend, dp, dq))
            arcs.append((path, transition, dstart, dvalue[-1], slope[:, n + along.size : n + 2 * along.size]))
            last, dlast = end, dend
        return Evaluation(np.concatenate(residuals), np.vstack(jacobians), *zip(*arcs, strict=True))

    @lru_cache(maxsize=8)  # noqa: B019 - the equations themselves are kept as long
    def seeds(self, vary: tuple[str, ...]):
        """Derivatives of the unknowns, of the parameters and of those varied by all that changes; and for each arc the
        seeds of its start and of the parameters."""
        n, k = self.size, len(vary)
        dp = np.zeros((len(self.parameters), n + k))
        for j, name in enumerate(vary):
            dp[self.parameters.index(name), n + j] = 1.0
        seeds = [
            (np.eye(along.size, along.size + k), np.hstack([np.zeros((len(dp), along.size)), dp[:, n:]]))
            for along in self.flows
        ]
        return np.eye(n, n + k), dp, np.eye(k, n + k, n), seeds

    def evaluate_all(self, us, ps, vary: tuple[str, ...] = ()) -> Evaluation:
        """`evaluate` at several points (m, n) with their parameters (m, np), stacked."""
        return stacked([self.evaluate(u, p, vary) for u, p in zip(us, ps, strict=True)])

    def newton_steps(self, vary: str, here, xs, ps, rows, targets) -> tuple[np.ndarray, np.ndarray, Evaluation]:
        """Newton steps from points (m, n + 1), unknowns and a varied parameter, towards F = 0, rows . X = targets (m,).

        here, ps : the equations, `stacked`, and the parameters (m, np) there

        Returns the steps (m, n + 1), the directions of the curve (m, n + 1), and the equations, `stacked`, where the
        steps lead, to first order but for the residuals.
        """
        right = np.zeros((*xs.shape, 2))
        right[:, :-1, 0], right[:, -1, 0] = -here.residual, targets - np.einsum("mi,mi->m", xs, rows)
        right[:, -1, 1] = 1.0
        steps, directions = np.moveaxis(solve(np.concatenate([here.jacobian, rows[:, None]], axis=1), right), 2, 0)
        new, ps = xs + steps, ps.copy()
        ps[:, self.parameters.index(vary)] = new[:, -1]
        return steps, directions, self.moved(here, new[:, :-1], ps, steps)

    def moved(self, here: Evaluation, us, ps, steps) -> Evaluation:
        """The equations, `stacked`, taken along by Newton steps (m, n + k) that settle them, to the points `us` (m, n)
        where those lead with parameters `ps` (m, np): to first order, but for the residuals."""
        if any(motions.variations is None for motions in here.trajectories):  # closed forms cost nothing
            return stacked([self.evaluate(u, p) for u, p in zip(us, ps, strict=True)])
        arcs = zip(here.trajectories, here.starts, here.durations, strict=True)
        apply = lambda slopes: np.einsum("m...c,mc->m...", slopes, steps)  # noqa: E731
        moved = tuple(motions.moved(apply(start), apply(longer)) for motions, start, longer in arcs)
        if any(along.phase.pieces for along in self.flows):
            by_end = lambda along, start, p, path: path.end  # noqa: E731
            known = zip(us, ps, zip(*moved, strict=True), strict=True)
            residual = np.array([self.residual(u, p, paths, by_end) for u, p, paths in known])
        else:
            residual = self.arrivals(us, ps, *(motions.finals for motions in moved))[0][:, :, 0]
        return replace(here, residual=residual, trajectories=moved)

    @cached_property
    def arrivals(self) -> MappedFunction:
        """The residual from the ends of all arcs, (u, p, end, ...), of fields without pieces."""
        u, p = ca.SX.sym("u", self.size), ca.SX.sym("p", len(self.parameters))
        ends = [ca.SX.sym("x", along.size) for along in self.flows]
        before, residuals = [ca.SX(0, 1), *ends], []
        for last, end, (depart, arrive) in zip(before, ends, self.ends, strict=False):
            start = depart.function(u, last, p)[0][:-1]
            residuals.append(arrive.function(u, start, end, p, ca.SX(0, 1))[0])
        return MappedFunction(dense("arrivals", [u, p, *ends], [ca.vertcat(*residuals)]))

    def residual(self, u, p, paths: tuple[Trajectory, ...], travel: Callable) -> np.ndarray:
        """The residual (n,) with every arc's end from travel(flow, start, p, path), one of `paths` for each."""
        last, residuals = np.zeros(0), []
        for along, path, (depart, arrive) in zip(self.flows, paths, self.ends, strict=True):
            start = depart(u, last, p)[0][:-1, 0]
            last = travel(along, start, p, path)
            q, _ = along.piece_data(start, p)
            residuals.append(arrive(u, start, last, p, q)[0].ravel())
        return np.concatenate(residuals)

    def newton(self, u, p, attempts: int = 30) -> tuple[np.ndarray, Evaluation]:
        """The solution (n,) by Newton's method from `u`, to rounding, and the statement there, `stacked`.

        A step that leaves the flow's domain or a positive duration is halved. Raises `NoOrbit` without convergence.
        """
        u = np.array(u, dtype=float)
        here, size = self.evaluate(u, p), np.inf
        for _ in range(attempts):
            step = solve(here.jacobian, -here.residual)
            last, size = size, np.max(np.abs(step) / np.maximum(np.abs(u), 1e-3))
            if settles(size, last, here.amplification):
                u = u + step
                return u, self.moved(stacked([here]), u[None], np.reshape(p, (1, -1)), step[None])
            if not np.isfinite(size):
                break
            u, here = self._damped(u, step, p, here)
        raise NoOrbit(f"the {self.statement.name} equations did not converge (last relative step {size:.1e})")

    def _damped(self, u, step, p, here):
        times = [self.statement.unknowns.index(name) for name in self.statement.durations]
        size = np.linalg.norm(here.residual)
        for _ in range(12):
            new = u + step
            if (new[times] > 0.2 * u[times]).all():
                try:
                    there = self.evaluate(new, p)
                    if np.linalg.norm(there.residual) <= max(0.9 * size, 1e-6 * (1 + np.abs(u).max())):
                        return new, there
                except FlowError:
                    pass
            step = step / 2
        raise NoOrbit(f"the {self.statement.name} equations did not converge: no step reduces the residual {size:.1e}")

    def multiple_shooting(self, u, p) -> tuple[np.ndarray, Evaluation]:
        """As `newton`, with every integration step a shooting node, by Ipopt, from `u`.

        A step that ends on a breakpoint of a piecewise field becomes a node with a free time, held on the breakpoint.
        """
        problem = MultipleShooting(self, np.asarray(u, float), np.asarray(p, float))
        solution = solve_equations(problem.unknowns, problem.equations, problem.guess, problem.lower, problem.scale)
        return self.newton(solution[: self.size], p)  # Ipopt ends at its tolerance, this at rounding


def _chain(slope, *inner) -> np.ndarray:
    """Chain rule, without the derivatives that are not needed: some may be no numbers (r**n by n where r < 0)."""
    inner = np.vstack(inner)
    used = inner.any(1)
    return slope[:, used] @ inner[used]


def dense(name: str, arguments: list, results: list) -> ca.Function:
    """A function with dense results."""
    return ca.Function(name, arguments, [ca.densify(result) for result in results])
