"""A boundary value statement as equations: evaluated along its flow, solved by Newton, or by multiple shooting."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import casadi as ca
import numpy as np

from . import nlp
from .calls import Call, Calls
from .errors import FlowError, NoOrbit
from .flow import flow
from .hermite import hermite
from .model import Arc, Statement
from .motions import Motions, Trajectory
from .nodes import Nodes
from .polynomial import derivative, evaluate
from .steps import DEFECT

# A relative Newton step is the last if it changes the end of the motion by less than this: the next one, its square, is
# below rounding.
LAST = 1e-8
# ... or if it is this small and shrinks no more than by this factor: then it is rounding. (Towards a solution still far
# off, in a motion that grows small changes, they shrink by a half each.)
SMALL, STALLED = 1e-9, 0.7


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A statement at one point; or at several, `stacked`, when all but the trajectories has one more axis in front.

    residual : (n,)
    jacobian : (n, n + k), with respect to the unknowns and to the k varied parameters
    trajectories : one per arc, with variations by its start and the varied parameters; `Motions` of several points
    transitions : derivatives (states, states + k) of each arc's end at fixed duration, by the same
    starts : derivatives (states + k, n + k) of the same, by the unknowns and the varied parameters
    durations : derivatives (n + k,) of each arc's duration
    holds : derivatives (rows, states) of the residuals that belong to each arc by its end
    """

    residual: np.ndarray
    jacobian: np.ndarray
    trajectories: tuple[Trajectory, ...] | tuple[Motions, ...]
    transitions: tuple[np.ndarray, ...]
    starts: tuple[np.ndarray, ...]
    durations: tuple[np.ndarray, ...]
    holds: tuple[np.ndarray, ...]

    def __getitem__(self, i: int | np.ndarray) -> "Evaluation":
        """One of several, or some of them in an order (k,)."""
        per_arc = self.trajectories, self.transitions, self.starts, self.durations, self.holds
        return Evaluation(self.residual[i], self.jacobian[i], *(tuple(part[i] for part in each) for each in per_arc))

    def replaced(self, i: np.ndarray, others: "Evaluation") -> "Evaluation":
        """With the points i (k,) of several replaced by others."""
        order = np.arange(len(self.residual))
        order[i] = len(order) + np.arange(len(i))
        both = lambda name: zip(getattr(self, name), getattr(others, name), strict=True)  # noqa: E731
        return Evaluation(
            *(np.concatenate([getattr(part, name) for part in (self, others)])[order] for name in ("residual", "jacobian")),
            tuple(motions.replaced(i, other) for motions, other in both("trajectories")),
            *(
                tuple(np.concatenate(parts)[order] for parts in both(name))
                for name in ("transitions", "starts", "durations", "holds")
            ),
        )

    @cached_property
    def growth(self):
        """Of a small change of the state over the motion, the largest."""
        squares = (transition[..., : transition.shape[-2]] for transition in self.transitions)
        return np.max([np.abs(square).max((-2, -1)) for square in squares], axis=0)


def settles(size, last, growth):
    """Whether a relative Newton step is the last one worth taking: `last` is the one before, `growth` that of a small
    change of the state over the motion."""
    return (size * np.maximum(growth, 1.0) < LAST) | ((size < SMALL) & (size > STALLED * last))


def stacked(heres: Sequence[Evaluation]) -> Evaluation:
    """A statement at several points, with or without variations at all of them."""
    return _put_together(heres, np.array, Motions.of)


def joined(heres: Sequence[Evaluation]) -> Evaluation:
    """As one what has been stacked in several."""
    return heres[0] if len(heres) == 1 else _put_together(heres, np.concatenate, Motions.joined)


def _put_together(heres: Sequence[Evaluation], arrays: Callable, motions: Callable) -> Evaluation:
    def per_arc(name: str, together: Callable) -> tuple:
        return tuple(map(together, zip(*(getattr(here, name) for here in heres), strict=True)))

    return Evaluation(
        arrays([here.residual for here in heres]),
        arrays([here.jacobian for here in heres]),
        per_arc("trajectories", motions),
        *(per_arc(name, arrays) for name in ("transitions", "starts", "durations", "holds")),
    )


@lru_cache(maxsize=64)
def shooting(statement: Statement, parameters: tuple[str, ...]) -> "Shooting":
    """The equations of a statement, kept for the next call with the same statement."""
    return Shooting(statement, parameters)


class Shooting:
    """The equations F(u, p) = 0 of a statement, `parameters` naming the entries of p."""

    def __init__(self, statement: Statement, parameters: tuple[str, ...]):
        self.statement, self.parameters = statement, tuple(parameters)
        self.size = len(statement.unknowns)
        self.flows = tuple(flow(arc.phase, self.parameters) for arc in statement.arcs)

    @property
    def compiled(self) -> bool:
        """Whether one of the flows has taken long enough to be compiled."""
        return any(along.compiled for along in self.flows)

    @cached_property
    def ends(self) -> list[tuple[Call, Call]]:
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
                    Call(_dense("depart", [u, last, p], [depart, ca.jacobian(depart, z)])),
                    Call(_dense("arrive", [u, x0, x1, p, q], [holds, ca.jacobian(holds, w)])),
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
        du, dp, own, seeds = self._seeds(vary)
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
    def _seeds(self, vary: tuple[str, ...]):
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

    def evaluate_all(self, us, ps, vary: tuple[str, ...] = (), meshes=None) -> Evaluation:
        """`evaluate` at several points (m, n) with their parameters (m, np), stacked.

        meshes : nodes (N + 1,) of each arc as shares of its duration, to try first, all in one call: it saves choosing
            the steps
        """
        if meshes is None or not self.has_meshes:
            return stacked([self.evaluate(u, p, vary) for u, p in zip(us, ps, strict=True)])
        here, fine = self._read(meshes, *self._called(self._whole, vary, meshes, us, ps))
        if fine.all():
            return here
        known = zip(fine, us, ps, strict=True)
        return stacked([here[i] if good else self.evaluate(u, p, vary) for i, (good, u, p) in enumerate(known)])

    def step(self, vary: str, meshes, p, xs, tangents, counts, row, level, closing, target, size):
        """A step along the curve F = 0 of unknowns and a varied parameter: predicted from points of it, and two Newton
        steps, all in one call.

        xs, tangents, counts, row, level : what the prediction rests on, as in `hermite`, all points behind
        closing, target : the row (n + 1,) and level that close the equations
        size : (n + 1,), in whose units the lengths of the Newton steps are

        Returns the prediction; where the steps lead, the direction of the curve there, the last step, and the equations
        before that, stacked; and the numbers, of points that the prediction rests on, and the lengths of both steps.
        None where `meshes` are too coarse.
        """
        made = partial(self._step, count=len(xs))
        arguments = xs.ravel(), tangents.ravel(), counts, row, level, closing, target, size, p
        arguments = (np.reshape(argument, (1, -1)) for argument in arguments)
        schemes, (vectors, numbers, *results) = self._called(made, (vary,), meshes, *arguments)
        rests, before, length, fine = numbers[0, :, 0].tolist()
        here, also_fine = self._read(meshes, schemes, results)
        if not (fine and also_fine[0] and length < np.inf):
            return None
        return *vectors[0].T, here, (int(rests), before, length)

    @cached_property
    def has_meshes(self) -> bool:
        """Whether a mesh says all of a motion's steps."""
        return all(along.smooth for along in self.flows)

    def _called(self, function: Callable, vary: tuple[str, ...], meshes, *arguments) -> tuple[tuple, list]:
        """The schemes of all arcs, and the results of `_whole` or `_step` with these arguments."""
        count, sizes = len(arguments[0]), tuple(len(mesh) - 1 for mesh in meshes)
        schemes = tuple(
            along.scheme(along.size + len(vary), tuple(map(self.parameters.index, vary))) for along in self.flows
        )
        for scheme, size in zip(schemes, sizes, strict=True):
            scheme.spend(count * size)
        call = function(vary, sizes, schemes, tuple(scheme.compiled for scheme in schemes))
        return schemes, call(np.concatenate(meshes)[None], *arguments)

    def _read(self, meshes, schemes, results) -> tuple[Evaluation, np.ndarray]:
        """The equations at several points from the results of `_whole`; and where (m,) the meshes are fine enough."""
        residual, jacobian, *rest = results
        # derivatives that nothing needs may be no numbers; the longer way leaves them out
        fine, arcs = np.isfinite(jacobian).all((1, 2)), []
        for i, (along, scheme, mesh) in enumerate(zip(self.flows, schemes, meshes, strict=True)):
            duration, transition, dstart, longer, holds, c, dc, made, lengths = rest[9 * i : 9 * (i + 1)]
            c, dc = (part.reshape(-1, *part.shape[2:]) for part in scheme.unfold(c, dc))
            fine &= _trusted(made, lengths) & np.isfinite(c).reshape(len(fine), -1).all(1)
            starts, ends = (duration[:, 0] * mesh[:-1]).ravel(), duration[:, 0, 0] * mesh[-1]
            motions = Motions(starts, ends, c, np.full(len(fine), len(mesh) - 1), along.names, dc)
            arcs.append((motions, transition, dstart, longer[:, 0], holds))
        return Evaluation(residual[:, :, 0], jacobian, *zip(*arcs, strict=True)), fine

    @lru_cache(maxsize=32)  # noqa: B019 - the equations themselves are kept as long
    def _whole(
        self, vary: tuple[str, ...], counts: tuple[int, ...], schemes: tuple, compiled: tuple[bool, ...]
    ) -> Calls:
        """The statement and its derivatives on meshes of so many steps, (meshes, u, p); another one when a scheme has
        been compiled."""
        n, k = self.size, len(vary)
        du, dp, own, seeds = (ca.DM(x) if isinstance(x, np.ndarray) else x for x in self._seeds(vary))
        u, p, nodes = ca.MX.sym("u", n), ca.MX.sym("p", len(self.parameters)), ca.MX.sym("t", sum(counts) + len(counts))
        meshes = ca.vertsplit(nodes, np.cumsum([0, *(count + 1 for count in counts)]).tolist())
        last, dlast = ca.MX(0, 1), ca.MX(0, n + k)
        residuals, jacobians, results = [], [], []
        for along, count, scheme, mesh, (depart, arrive), (dx, dq) in zip(
            self.flows, counts, schemes, meshes, self.ends, seeds, strict=True
        ):
            value, slope = depart.function(u, last, p)
            dvalue = slope @ ca.vertcat(du, dlast, dp)
            start, duration, dstart, longer = value[:-1], value[-1], ca.vertcat(dvalue[:-1, :], own), dvalue[-1, :]
            varied = dq[[self.parameters.index(name) for name in vary]]
            data = ca.repmat(ca.vertcat(p, ca.vec(ca.DM(varied))), 1, count)
            lengths = duration * (mesh[1:] - mesh[:-1]).T
            z, c, dc, made = scheme.one.mapaccum(count)(ca.vertcat(start, ca.vec(ca.DM(dx))), data, lengths)
            size = along.size
            end, transition = z[:size, -1], ca.reshape(z[size:, -1], size, size + k)
            dend = transition @ dstart + along.graph.field(end, p)[0] @ longer
            holds, slope = arrive.function(u, start, end, p, ca.MX(0, 1))
            residuals.append(holds)
            jacobians.append(slope @ ca.vertcat(du, dstart[:size, :], dend, dp))
            at_end = slope[:, n + size : n + 2 * size]
            results += [duration, transition, dstart, longer, at_end, c, dc, made, lengths]
            last, dlast = end, dend
        results = [ca.vertcat(*residuals), ca.vertcat(*jacobians), *results]
        return Calls(_dense("whole", [nodes, u, p], results))

    @lru_cache(maxsize=32)  # noqa: B019 - the equations themselves are kept as long
    def _step(
        self, vary: tuple[str, ...], counts: tuple[int, ...], schemes: tuple, compiled: tuple[bool, ...], count: int
    ) -> Calls:
        """`step` from so many points, the meshes first and p last; the last number tells whether they are fine."""
        n, index, whole = self.size + 1, self.parameters.index(*vary), self._whole(vary, counts, schemes, compiled)
        nodes, p = ca.MX.sym("t", whole.function.size1_in(0)), ca.MX.sym("p", len(self.parameters))
        xs, tangents, known, row, level = (ca.MX.sym(*a) for a in (("x", n, count), ("d", n, count), ("k", count), ("r", n), ("l",)))
        closing, target, size = ca.MX.sym("c", n), ca.MX.sym("v"), ca.MX.sym("s", n)
        square, right = ca.SX.sym("square", n, n), ca.SX.sym("right", n, 2)
        solve_ = ca.Function("solve", [square, right], [ca.solve(square, right)])  # singular: not numbers, no error
        guess, rests = hermite(n, count, 0)(xs, tangents, known, row, level)
        last = tangents[:, -1]
        guess += last * ((target - closing.T @ guess) / (closing.T @ last))
        x, lengths, fine = guess, [], []
        for _ in range(2):
            results = whole.function(nodes, x[:-1], ca.vertcat(p[:index], x[-1], p[index + 1 :]))
            residual, jacobian, *rest = results
            lack = ca.vertcat(-residual, target - closing.T @ x)
            both = solve_(ca.vertcat(jacobian, closing.T), ca.horzcat(lack, np.eye(n)[-1]))
            x += both[:, 0]
            lengths.append(ca.mmax(ca.fabs(both[:, 0] / size)))
            for i in range(len(self.flows)):
                made, asked = rest[9 * i + 7 : 9 * i + 9]
                fine += [ca.mmin(made[0, :] == asked), ca.mmin(made[1, :] <= DEFECT)]
        tangent = both[:, 1] * ca.sign((both[:, 1] / size).T @ (last / size))
        vectors, numbers = ca.horzcat(guess, x, tangent, both[:, 0]), ca.vertcat(rests, *lengths, ca.mmin(ca.vertcat(*fine)))
        arguments = [nodes, xs, tangents, known, row, level, closing, target, size, p]
        return Calls(_dense("step", arguments, [vectors, numbers, *results]))

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
            residual = self._arrivals(us, ps, *(motions.finals for motions in moved))[0][:, :, 0]
        return replace(here, residual=residual, trajectories=moved)

    @cached_property
    def _arrivals(self) -> Calls:
        """The residual from the ends of all arcs, (u, p, end, ...), of fields without pieces."""
        u, p = ca.SX.sym("u", self.size), ca.SX.sym("p", len(self.parameters))
        ends = [ca.SX.sym("x", along.size) for along in self.flows]
        before, residuals = [ca.SX(0, 1), *ends], []
        for last, end, (depart, arrive) in zip(before, ends, self.ends, strict=False):
            start = depart.function(u, last, p)[0][:-1]
            residuals.append(arrive.function(u, start, end, p, ca.SX(0, 1))[0])
        return Calls(_dense("arrivals", [u, p, *ends], [ca.vertcat(*residuals)]))

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
            if settles(size, last, here.growth):
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
        problem = Nodes(self, np.asarray(u, float), np.asarray(p, float))
        solution = nlp.solve(problem.unknowns, problem.equations, problem.guess, problem.lower, problem.scale)
        return self.newton(solution[: self.size], p)  # Ipopt ends at its tolerance, this at rounding


def _chain(slope, *inner) -> np.ndarray:
    """Chain rule, without the derivatives that are not needed: some may be no numbers (r**n by n where r < 0)."""
    inner = np.vstack(inner)
    used = inner.any(1)
    return slope[:, used] @ inner[used]


def solve(matrix, right) -> np.ndarray:
    """The solution of a square system, or of a stack of them, NaN where one is singular."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        if matrix.ndim == 2:
            return np.full(np.shape(right), np.nan)
        right = np.broadcast_to(right, (len(matrix), *np.shape(right)[-2:]))
        return np.array([solve(one, side) for one, side in zip(matrix, right, strict=True)])


def _trusted(made, lengths) -> np.ndarray:
    """Which motions (m,) have all the steps that were to be made (m, 1, N): lengths and defects `made` (m, 2, N)."""
    return (made[:, 0] == lengths[:, 0]).all(1) & (made[:, 1] <= DEFECT).all(1)


def _dense(name: str, arguments: list, results: list) -> ca.Function:
    return ca.Function(name, arguments, [ca.densify(result) for result in results])
