"""A boundary value statement as equations: integrated along its flow, solved by Newton's method to rounding."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import FlowError, NoOrbit
from ..flow import Flow, Trajectories, Trajectory, flow_of
from ..model import Statement
from ..numerics import ROOTS, derivative, solve
from ..symbolic import BufferedFunction, MappedFunction, cached
from .arc_functions import boundary_functions


class NewtonOptions(NamedTuple):
    """Newton's method to rounding. Steps are relative to the unknowns."""

    # Change of the end of the motion by the last one: the next one, its square, would be below rounding.
    last_step: float = 1e-8
    smallest_unit: float = 1e-3  # in which smaller unknowns are measured, since a relative step has no meaning at 0
    duration_left: float = 0.2  # least share of a duration that a step leaves, so that no arc collapses
    reduction: float = 0.9  # of the residual by an accepted step, at least
    small_residual: float = 1e-6  # relative to the unknowns, below which full steps converge, and are accepted
    halvings: int = 12  # of a step, at most
    undamped: float = 0.1  # largest change of the unknowns by steps that are not damped, which may lead elsewhere
    steps: int = 8  # of a corrector that converges, with some to spare


NEWTON = NewtonOptions()


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The equations at one point, or at m points: every array then has an axis of that length in front.

    residual : (n,)
    jacobian : (n, n + k), with respect to the unknowns and to the k varied parameters
    trajectories : one `Trajectory`, of m points one `Trajectories`, per arc, with its sensitivities to its start and to
        the varied parameters
    transitions : derivatives (states, states + t) of each arc's end at fixed duration, by its start and by t
        parameters, the varied ones and the unknown ones
    starts : derivatives (states + t, n + k) of the same, by the unknowns and the varied parameters
    residual_by_end : derivatives (rows, states) of the residuals that belong to each arc by its end
    parts : derivatives (K, states, states) of the end of each of K parts of an arc by its start, where the arcs have
        been divided to find them
    """

    residual: np.ndarray
    jacobian: np.ndarray
    trajectories: tuple[Any, ...]
    transitions: tuple[np.ndarray, ...]
    starts: tuple[np.ndarray, ...]
    residual_by_end: tuple[np.ndarray, ...]
    parts: tuple[np.ndarray, ...] = ()

    def __getitem__(self, i: int | np.ndarray) -> "Evaluation":
        """The evaluation at one of the points, or at several in an order (k,)."""
        per_arc = self.trajectories, self.transitions, self.starts, self.residual_by_end, self.parts
        parts = (tuple(part[i] for part in each) for each in per_arc)
        return Evaluation(self.residual[i], self.jacobian[i], *parts)

    def of_unknowns(self, count: int) -> "Evaluation":
        """The evaluation at m points without the derivatives by a parameter that is varied besides the unknowns, which
        have this number; the evaluation itself where none is varied."""
        if self.jacobian.shape[2] == count:
            return self
        moving = (replace(motions, variations=motions.variations[:, :, :-1]) for motions in self.trajectories)
        transitions = tuple(each[:, :, :-1] for each in self.transitions)
        starts = tuple(each[:, :-1, :count] for each in self.starts)
        return Evaluation(
            self.residual, self.jacobian[:, :, :count], tuple(moving), transitions, starts, self.residual_by_end
        )

    @cached_property
    def amplification(self) -> Any:
        """The largest growth of a small change of the state over the motion, or (m,) of each; over a part of it where
        it has several."""
        if self.parts:
            return np.max([np.abs(each).max((-3, -2, -1)) for each in self.parts], axis=0)
        squares = (transition[..., : transition.shape[-2]] for transition in self.transitions)
        return np.max([np.abs(square).max((-2, -1)) for square in squares], axis=0)

    @cached_property
    def parameter_units(self) -> np.ndarray:
        """Of m points, the changes (m, t) of parameters that move the end of an arc as far as a change of the state at
        its start by its own size does."""
        units = list[np.ndarray]()
        for motions, transition in zip(self.trajectories, self.transitions, strict=True):
            n, changes = transition.shape[1], np.abs(transition)
            reach = changes[:, :, :n].max((1, 2)) * np.abs(motions.finals[:, :n]).max(1)
            with np.errstate(divide="ignore", over="ignore"):  # where a parameter hardly moves the end
                units.append(reach[:, None] / changes[:, :, n:].max(1))
        return np.min(units, axis=0)

    @cached_property
    def relative_growth(self) -> np.ndarray:
        """Of m points, the `amplification` (m,) of changes relative to the sizes of the states, in any units."""
        changes = self.parts or tuple(each[:, None, :, : each.shape[1]] for each in self.transitions)
        sizes = (motions.sizes[:, : each.shape[-1]] for motions, each in zip(self.trajectories, changes, strict=True))
        grown = (relative(each, size[:, None], size[:, None]) for each, size in zip(changes, sizes, strict=True))
        return np.max([each.max((1, 2, 3)) for each in grown], axis=0)

    @cached_property
    def growths_on_the_way(self) -> np.ndarray:
        """Of m points, the largest growths (m, arcs) of a small change of the state from the start of each arc to the
        start of a step, and at least 1: a motion that passes two unstable equilibria brings changes closer together
        again towards the second."""
        growths = np.ones((len(self.residual), len(self.transitions)))
        for own, motions, transition in zip(growths.T, self.trajectories, self.transitions, strict=True):
            if motions.variations is not None:
                own[:] = np.maximum(own, motions.largest(motions.variations[:, :, : transition.shape[1]]))
        return growths

    @cached_property
    def largest_growth(self) -> np.ndarray:
        """Of m points, the largest growth (m,) of a small change of the state to any place of the motion."""
        return np.maximum(self.amplification, self.growths_on_the_way.max(1))


def relative(change: np.ndarray, sizes: np.ndarray, by: np.ndarray) -> np.ndarray:
    """The sizes (..., n, c) of derivatives of states of the sizes (..., n) by numbers of the sizes `by` (..., c), both
    relative; 0 for a state that is 0 throughout."""
    of_sizes = sizes[..., None] + np.zeros_like(change)
    return np.divide(np.abs(change) * by[..., None, :], of_sizes, out=np.zeros_like(change), where=of_sizes > 0)


def joined(evaluations: Sequence[Evaluation]) -> Evaluation:
    """One evaluation at the points of several evaluations."""
    if len(evaluations) == 1:
        return evaluations[0]
    combined: dict[str, Any] = {}
    for name in Evaluation.__dataclass_fields__:
        parts: list[Any] = [getattr(evaluation, name) for evaluation in evaluations]
        combine = Trajectories.joined if name == "trajectories" else np.concatenate
        combined[name] = (
            tuple(map(combine, zip(*parts, strict=True))) if isinstance(parts[0], tuple) else combine(parts)
        )
    return Evaluation(**combined)


def settles(size: Any, last: Any, amplification: Any) -> Any:
    """Whether a relative Newton step of this size, or each of (m,), is the last one worth taking after a step of size
    `last`, where the motion amplifies small changes of the state; of symbols a number, 0 where it is not."""
    converged = (size < NEWTON.last_step) * (size * amplification < NEWTON.last_step)
    return converged + (size < ROOTS.small_step) * (size > ROOTS.stalled_ratio * last)


class Shooting:
    """The equations F(u, p) = 0 of a statement, for u (n,) and p (np,), whose entries `parameters` names; `vary` names
    k parameters with respect to which derivatives are taken too. Those t parameters that the statement has among its
    unknowns have the values of these: their entries in p have no effect. `own` is the number of the other unknowns."""

    def __init__(self, statement: Statement, parameters: tuple[str, ...]):
        self.statement, self.parameters = statement, tuple(parameters)
        self.size, self.durations = len(statement.unknowns), list(map(statement.unknowns.index, statement.durations))
        self.flows = tuple(flow_of(arc.phase, self.parameters) for arc in statement.arcs)
        self.own, self.places = self.size - len(statement.tuned), list(map(self.parameters.index, statement.tuned))

    def with_tuned(self, us: np.ndarray, ps: np.ndarray) -> np.ndarray:
        """The parameters (m, np) with the values of the unknown ones (m, n)."""
        if self.places:
            ps = ps.copy()
            ps[:, self.places] = us[:, self.own : self.size]
        return ps

    @property
    def in_lanes(self) -> bool:
        """Whether the motions of many points can be integrated together: those of one arc."""
        return len(self.flows) == 1 and self.flows[0].in_lanes

    def in_lanes_along(self, name: str) -> bool:
        """Whether the solutions at many values of a parameter can be found together: not where pieces depend on it."""
        return self.in_lanes and not any(map(self.flows[0].depends_on, (name, *self.statement.tuned)))

    @cached_property
    def ends(self) -> list[tuple[BufferedFunction, BufferedFunction]]:
        """The `boundary_functions` of each arc: (u, end of the arc before, p) -> start state with the duration, and the
        residuals at both ends, each with its derivatives by all arguments."""
        functions = boundary_functions(self.statement, self.parameters)
        return [(_with_derivatives(departure), _with_derivatives(arrival)) for departure, arrival in functions]

    def evaluate(self, u: ArrayLike, p: np.ndarray, vary: tuple[str, ...] = ()) -> Evaluation:
        """`evaluate_all` at one point."""
        return self.evaluate_all(np.reshape(u, (1, -1)), np.reshape(p, (1, -1)), vary)[0]

    @cached_property
    def together(self) -> list[list[int]]:
        """The arcs in groups of one flow each, which can be followed one after another: an arc that depends on the one
        before it is in a later group."""
        groups, behind = dict[tuple, list[int]](), [0] * len(self.flows)  # how many arcs depend on each
        for i in reversed(range(1, len(self.flows))):
            behind[i - 1] = (behind[i] + 1) * bool(self.ends[i][0].function.jac_sparsity(0, 1).nnz())
        for i, flow in enumerate(self.flows):
            groups.setdefault((behind[i], flow), []).append(i)
        return [groups[key] for key in sorted(groups, key=lambda key: -key[0])]

    @cached
    def seeds(self, vary: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, list]:
        """Derivatives of the unknowns (n, n + k), of the parameters (np, n + k) and of the `moving` ones (t, n + k) by
        the unknowns and the varied parameters; and for each arc the seeds of its start and of the parameters."""
        n, own, k, moving = self.size, self.own, len(vary), self.moving(vary)
        dp = np.zeros((len(self.parameters), n + k))
        for j, place in enumerate([*self.places, *map(self.parameters.index, vary)], start=own):
            dp[place, j] = 1.0
        sizes, count = [flow.size for flow in self.flows], len(moving)
        seeds = [(np.eye(size, size + count), np.hstack([np.zeros((len(dp), size)), dp[:, moving]])) for size in sizes]
        return np.eye(n, n + k), dp, np.eye(n + k)[moving], seeds

    def moving(self, vary: tuple[str, ...]) -> list[int]:
        """The places, among the unknowns and after them the varied parameters, of the parameters by which the motions
        are differentiated; with tuned ones, the parameters on which a field depends."""
        every = [*range(self.own, self.size + len(vary))]
        if not self.places:
            return every
        names = (*self.statement.tuned, *vary)
        return [place for place, name in zip(every, names, strict=True) if any(f.moves_with(name) for f in self.flows)]

    def evaluate_all(self, us: np.ndarray, ps: np.ndarray, vary: tuple[str, ...] = ()) -> Evaluation:
        """Residual, Jacobian and motion at points (m, n) with parameters (m, np), with steps that the error control of
        the flow chooses; raises `FlowError` when a motion cannot be integrated."""
        m, ps, arcs = len(us), self.with_tuned(us, ps), dict[int, tuple]()
        for group in self.together:
            flow, seeds, count = self.flows[group[0]], self.seeds(vary)[3][group[0]], len(group)
            ends = (arcs[i - 1][1] if i - 1 in arcs else np.zeros((m, self.flows[i - 1].size * (i > 0))) for i in group)
            (starts,) = self.departures(tuple(group))(us, ps, *ends)
            start = starts.transpose(2, 0, 1).reshape(count * m, -1)
            own = np.tile(ps, (count, 1)) if count > 1 else ps
            found = flow.run_all(start[:, :-1], own, start[:, -1], *seeds)
            known = arrival(flow, found[0], found[0].finals[:, : flow.size], found[1], own)
            for i, motions, place in zip(group, found[0].parted(count), range(0, count * m, m), strict=True):
                arcs[i] = motions, *(each[place : place + m] for each in known)
        return self.closed(us, ps, vary, [arcs[i] for i in range(len(arcs))])

    def evaluate_lanes(
        self, us: np.ndarray, ps: np.ndarray, vary: tuple[str, ...] = (), fewest: bool = False
    ) -> tuple[np.ndarray, Evaluation | None]:
        """`evaluate_all` at those points whose motions can be followed: their indices (k,), and the equations there,
        None without any. With the `fewest` derivatives the transitions are 0 where a state is the same at all starts of
        an arc, and the motions have no sensitivities to it."""
        which, before, arcs, ps = np.arange(len(us)), np.zeros((len(us), 0)), list[tuple](), self.with_tuned(us, ps)
        for i, (flow, begin, seeds) in enumerate(zip(self.flows, self.beginnings, self.seeds(vary)[3], strict=True)):
            start = begin(us[which], before, ps[which])[0][:, :, 0] if len(which) else np.zeros((0, flow.size + 1))
            able = np.flatnonzero(np.isfinite(start).all(1) & (start[:, -1] > 0))
            own, columns = seeds, [*range(seeds[0].shape[1])]
            if fewest:
                columns = [*self.varying[i], *columns[flow.size :]]
                own = [each[:, columns] for each in seeds]
            done, motions, transitions = flow.run_lanes(start[able, :-1], ps[which[able]], start[able, -1], *own)
            if motions is None:
                return which[:0], None
            if fewest:
                found, transitions = transitions, np.zeros((len(done), *seeds[0].shape))
                transitions[:, :, columns] = found
            if len(able := able[done]) < len(which):
                which, arcs = which[able], [tuple(each[able] for each in arc) for arc in arcs]
            before = motions.finals[:, : flow.size]
            arcs.append((motions, *arrival(flow, motions, before, transitions, ps[which])))
        return which, self.closed(us[which], ps[which], vary, arcs)

    def closed(self, us: np.ndarray, ps: np.ndarray, vary: tuple[str, ...], arcs: Sequence[tuple]) -> Evaluation:
        """The equations from the motions of each arc and the arrays of their `arrival`."""
        known = (each for _, *arrays in arcs for each in arrays)
        columns = ((each.swapaxes(1, 2) if each.ndim > 2 else each).reshape(len(us), -1) for each in known)
        residual, jacobian, *rest = self.closing(vary)(us, ps, *columns)
        trajectories, _, transitions, *_ = zip(*arcs, strict=True)
        return Evaluation(residual[:, :, 0], jacobian, trajectories, transitions, tuple(rest[::2]), tuple(rest[1::2]))

    @cached_property
    def varying(self) -> list[list[int]]:
        """The states of each arc whose start depends on the unknowns, the parameters or the arc before."""
        found = list[list[int]]()
        for flow, (departure, _) in zip(self.flows, self.ends, strict=True):
            rows = {row for i in range(3) for row in departure.function.jac_sparsity(0, i).get_triplet()[0]}
            found.append(sorted(rows & {*range(flow.size)}))
        return found

    @cached
    def departures(self, group: tuple[int, ...]) -> MappedFunction:
        """The starts and the durations of arcs with one flow, one column each, (u, p, the ends of the arcs before)."""
        u, p = arguments = [ca.SX.sym("u", self.size), ca.SX.sym("p", len(self.parameters))]
        ends = [ca.SX.sym("a", self.flows[i - 1].size * (i > 0)) for i in group]
        starts = [self.ends[i][0].function(u, end, p)[0] for i, end in zip(group, ends, strict=True)]
        return MappedFunction(dense("departures", [*arguments, *ends], [ca.horzcat(*starts)]))

    @cached_property
    def beginnings(self) -> list[MappedFunction]:
        """The start and the duration of each arc, (u, end of the arc before, p)."""
        functions = []
        for departure, _ in self.ends:
            arguments = departure.function.sx_in()
            functions.append(MappedFunction(dense("beginning", arguments, [departure.function(*arguments)[0]])))
        return functions

    @cached
    def closing(self, vary: tuple[str, ...]) -> MappedFunction:
        """The equations from the ends of all arcs: (u, p, and for each arc its end, its transition, the speed at its
        end, the data of the piece where it starts and their derivatives by p) -> residual, jacobian, and for each arc
        the derivatives of its start and those of the residuals by its end."""
        n, k = self.size, len(vary)
        moving = len(self.moving(vary))
        # Unneeded derivatives are left out, since some are not numbers (r**n by n where r < 0).
        du, dp, dmoving = (ca.sparsify(ca.DM(each)) for each in self.seeds(vary)[:3])
        u, p, before, dbefore = ca.SX.sym("u", n), ca.SX.sym("p", len(self.parameters)), ca.SX(0, 1), ca.SX(0, n + k)
        arguments, residuals, jacobians, results = [u, p], [], [], []
        for flow, (departure, arrival) in zip(self.flows, self.ends, strict=True):
            size, data = flow.size, flow.phase.pieces.size if flow.phase.pieces else 0
            sizes = (size, 1), (size, size + moving), (size, 1), (data, 1), (data, len(self.parameters))
            end, transition, speed, q, slopes = known = [ca.SX.sym("a", *shape) for shape in sizes]
            value, slope = departure.function(u, before, p)
            dvalue = slope @ ca.vertcat(du, dbefore, dp)
            dstart, longer = ca.vertcat(dvalue[:-1, :], dmoving), dvalue[-1, :]
            dend = transition @ dstart + speed @ longer
            residual, slope = arrival.function(u, value[:-1], end, p, q)
            residuals.append(residual)
            jacobians.append(slope @ ca.vertcat(du, dstart[:size, :], dend, dp, slopes @ dp))
            results += [dstart, slope[:, n + size : n + 2 * size]]
            before, dbefore, arguments = end, dend, [*arguments, *known]
        whole = [ca.vertcat(*residuals), ca.vertcat(*jacobians), *results]
        return MappedFunction(dense("closing", arguments, whole))

    def residual(self, u: np.ndarray, p: np.ndarray, paths: tuple[Trajectory, ...], end_of: Callable) -> np.ndarray:
        """The residual (n,) where every arc ends at end_of(flow, start, p, path), one of `paths` for each."""
        (p,), before, residuals = self.with_tuned(u[None], p[None]), np.zeros(0), []
        for flow, path, (departure, arrival) in zip(self.flows, paths, self.ends, strict=True):
            start = departure(u, before, p)[0][:-1, 0]
            before = end_of(flow, start, p, path)
            (q,) = flow.data_of_pieces(start[None], p[None])
            residuals.append(arrival(u, start, before, p, q)[0].ravel())
        return np.concatenate(residuals)

    def newton(
        self, u: ArrayLike, p: np.ndarray, attempts: int = 30, evaluation: Evaluation | None = None,
        least: ArrayLike = NEWTON.smallest_unit,
    ) -> tuple[np.ndarray, Evaluation]:  # fmt: skip
        """The solution (n,) by Newton's method from `u`, where the equations are the evaluation (1) if it is known, to
        rounding, and the equations at this one point; raises `NoOrbit` without convergence. A step that leaves the
        flow's domain or collapses a duration is halved. Unknowns smaller than the `least` units, one or (n,), are
        measured in these."""
        us, ps, size = np.array(u, dtype=float)[None], np.reshape(p, (1, -1)), np.inf
        evaluation = evaluation or self.evaluate_all(us, ps)
        for _ in range(attempts):
            step = solve(evaluation.jacobian[0], -evaluation.residual[0])
            last, size = size, np.max(np.abs(step) / np.maximum(np.abs(us), least))
            if not settles(size, last, evaluation.amplification[0]):
                if not np.isfinite(size):
                    break
                try:
                    us, evaluation = self._damped(us, ps, step, evaluation)
                    continue
                except NoOrbit:
                    if size > ROOTS.small_step:  # otherwise the remaining residual is rounding
                        raise
            return us[0] + step, self.evaluate_all(us + step, ps)
        raise NoOrbit(f"the {self.statement.name} equations did not converge (last relative step {size:.1e})")

    def _damped(self, us, ps, step, evaluation: Evaluation) -> tuple[np.ndarray, Evaluation]:
        """The point (1, n) after a Newton step, halved until the residual shrinks, and the equations there."""
        size, durations = np.linalg.norm(evaluation.residual), self.durations
        accepted = max(NEWTON.reduction * size, NEWTON.small_residual * (1 + np.abs(us[:, : self.own]).max()))
        for _ in range(NEWTON.halvings):
            new = us + step
            if (new[:, durations] > NEWTON.duration_left * us[:, durations]).all():
                try:
                    found = self.evaluate_all(new, ps)
                    if np.linalg.norm(found.residual) <= accepted:
                        return new, found
                except FlowError:
                    pass
            step = step / 2
        raise NoOrbit(f"the {self.statement.name} equations did not converge: no step reduces the residual {size:.1e}")

    def multiple_shooting(self, u: ArrayLike, p: np.ndarray) -> tuple[np.ndarray, Evaluation]:
        """Solve by `newton`, from a solution by Ipopt with a shooting node at the end of every integration step.

        A step that ends on a breakpoint of a piecewise field has a free length, and its node is held on the breakpoint.
        """
        from .multiple_shooting import solve_by_ipopt  # imports Ipopt

        return self.newton(solve_by_ipopt(self, np.asarray(u, float), p), p)  # Ipopt ends at its tolerance


# The equations of a statement, cached for the next call with the same statement.
shooting_equations = cached(Shooting)


def arrival(
    flow: Flow, motions: Trajectories, ends: np.ndarray, transitions: np.ndarray, ps: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Of motions (m,) with parameters (m, np): their ends (m, states), the derivatives of these, `transitions`, and
    their speeds; and the data of the pieces where they start, with derivatives by the parameters."""
    c, last = motions.coefficients[:, : flow.size], motions.last
    speeds = np.einsum("mrk,mk->mr", derivative(c[last]), motions.of_lasts[:, :-1])
    return ends, transitions, speeds, *flow.piece_data(c[motions.first, :, 0], ps)


def _with_derivatives(function: ca.Function) -> BufferedFunction:
    """The results of a function in one column, and its derivatives by all arguments."""
    arguments = function.sx_in()
    value = ca.vertcat(*function.call(arguments))
    return BufferedFunction(dense(function.name(), arguments, [value, ca.jacobian(value, ca.vertcat(*arguments))]))


def dense(name: str, arguments: list, results: list) -> ca.Function:
    """A function with dense results."""
    return ca.Function(name, arguments, [ca.densify(result) for result in results])
