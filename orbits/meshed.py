"""A boundary value statement on given meshes: Newton steps from many points, or a step along a curve, in one call.

A mesh says all the steps of a motion as shares of its duration, so that its neighbours can take the same ones. Nothing
is left to choose on the way then, and the statement, its derivatives and what follows from them are one function.
"""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from .calls import Calls
from .hermite import hermite
from .motions import Motions
from .shooting import Evaluation, Shooting, dense
from .steps import DEFECT

# Functions that are kept for other meshes.
MOST = 64
# What is known of an arc: its duration, the derivatives of `Evaluation`, coefficients of the states (K + 1, n N) and of
# their derivatives (K + 1, n (n + 1) N), the steps' lengths and how long they could be (1, N).
EVALUATED = "duration", "transition", "start", "longer", "holds", "c", "dc", "lengths", "trusted"
# ... and once it is solved: also when it ends, the derivatives at its nodes (1, n (n + 1) N), and which share the steps
# are of what they could be (1, N); it starts from the nodes of `duration`.
SOLVED = "duration", "end", "transition", "start", "longer", "holds", "c", "nodes", "loads"


@lru_cache(maxsize=64)
def meshed(equations: Shooting, vary: str) -> "Meshed":
    """Equations on meshes, kept for the next call with the same."""
    return Meshed(equations, vary)


class Meshed:
    """The equations F(X) = 0 of unknowns and a varied parameter, X = (u, value), of which each arc is smooth.

    `meshes` are nodes (N + 1,) from 0 to 1 for each arc, `ps` and `p` the parameters, of which that is replaced.
    """

    def __init__(self, equations: Shooting, vary: str):
        self.equations, self.vary = equations, vary
        self.index = equations.parameters.index(vary)
        # By numbers of steps and what is compiled: the statement, and the calls by the points that they remember.
        self._built: dict[tuple, tuple[ca.Function, dict[int, Calls]]] = {}

    def newton_steps(self, meshes, xs, ps, rows, targets) -> tuple[np.ndarray, np.ndarray, Evaluation, np.ndarray]:
        """As `Shooting.newton_steps`, and where (m,) the meshes are fine enough."""
        return self._read(meshes, self._called(0, meshes, xs, rows, targets[:, None], ps))

    def step(self, meshes, xs, tangents, known, row, level, closing, target, size, p):
        """Predicted from points (c, n + 1) of the curve, and two Newton steps.

        xs, tangents, known, row, level : what the prediction rests on, as in `hermite`, all points behind
        closing, target : the row (n + 1,) and level that close the equations
        size : (n + 1,), in whose units the lengths of the Newton steps are

        Returns the prediction; the steps' end, the direction of the curve and the equations there, as `newton_steps`
        gives them; how many points the prediction rests on, and the lengths of both steps; and for each arc which
        share (N,) the motion's steps are of what they could be. None where `meshes` are too coarse.
        """
        arguments = xs, tangents, known, row, level, closing, target, size, p
        places, numbers, *results = self._called(len(xs), meshes, *(np.reshape(a, (1, -1)) for a in arguments))
        _, directions, here, fine = self._read(meshes, results)
        rests, before, last, also_fine = numbers[0, :, 0].tolist()
        if not (fine[0] and also_fine):
            return None
        loads = [arc["loads"][0, 0] for arc in _arcs(results[4:], SOLVED)]
        return *places[0].T, directions[0], here, (int(rests), before, last), loads

    def _called(self, memory: int, meshes: Sequence[np.ndarray], *arguments) -> list[np.ndarray]:
        """The results of `_newton`, or where there is a memory of so many points, of `_step`, with these arguments."""
        flows, counts = self.equations.flows, tuple(len(mesh) - 1 for mesh in meshes)
        schemes = tuple(along.scheme(along.size + 1, (self.index,)) for along in flows)
        for scheme, count in zip(schemes, counts, strict=True):
            scheme.spend(count * len(arguments[0]))
        key = counts, tuple(scheme.compiled for scheme in schemes)
        if not (built := self._built.get(key)):
            if len(self._built) >= MOST:
                self._built.clear()
            evaluation = self._evaluation(counts, schemes)
            built = self._built[key] = evaluation, {0: Calls(self._newton(counts, evaluation))}
        evaluation, calls = built
        if memory not in calls:
            calls[memory] = Calls(self._step(memory, evaluation, calls[0].function))
        return calls[memory](np.concatenate(meshes)[None], *arguments)

    def _read(self, meshes, results) -> tuple[np.ndarray, np.ndarray, Evaluation, np.ndarray]:
        """`newton_steps` from the results of `_newton`."""
        vectors, fine, residual, jacobian, *rest = results
        arcs, count = [], len(vectors)
        for along, mesh, arc in zip(self.equations.flows, meshes, _arcs(rest, SOLVED), strict=True):
            n, steps = along.size, len(mesh) - 1
            c = arc["c"].swapaxes(1, 2).reshape(count * steps, n, -1)
            nodes = arc["nodes"].reshape(count * steps, n + 1, n).swapaxes(1, 2)[..., None]
            starts, counts = (arc["duration"][:, 0] * mesh[:-1]).ravel(), np.full(count, steps)
            motions = Motions(starts, arc["end"][:, 0, 0], c, counts, along.names[:n], nodes)
            arcs.append((motions, arc["transition"], arc["start"], arc["longer"][:, 0], arc["holds"]))
        here = Evaluation(residual[:, :, 0], jacobian, *zip(*arcs, strict=True))
        fine = (fine[:, 0, 0] > 0) & np.isfinite(vectors).all((1, 2))
        return vectors[:, :, 0], vectors[:, :, 1], here, fine

    def _parameters(self, p: ca.MX, value: ca.MX) -> ca.MX:
        """Parameters with a value of the varied one."""
        entries = ca.vertsplit(p)
        entries[self.index] = value
        return ca.vertcat(*entries)

    def _evaluation(self, counts: tuple[int, ...], schemes: tuple) -> ca.Function:
        """The statement and its derivatives on meshes of so many steps, (meshes, x (n + 1,), p) -> residual (n,),
        jacobian (n, n + 1), whether the meshes are fine enough, and for each arc what `EVALUATED` names."""
        equations, n = self.equations, self.equations.size
        du, dp, own, seeds = (ca.DM(x) if isinstance(x, np.ndarray) else x for x in equations.seeds((self.vary,)))
        x, p = ca.MX.sym("x", n + 1), ca.MX.sym("p", len(equations.parameters))
        u, q = x[:-1], self._parameters(p, x[-1])
        nodes = ca.MX.sym("t", sum(counts) + len(counts))
        meshes = ca.vertsplit(nodes, np.cumsum([0, *(count + 1 for count in counts)]).tolist())
        last, dlast = ca.MX(0, 1), ca.MX(0, n + 1)
        residuals, jacobians, fine, results = [], [], [], []
        for along, count, scheme, mesh, (depart, arrive), (dx, dq) in zip(
            equations.flows, counts, schemes, meshes, equations.ends, seeds, strict=True
        ):
            size, (value, slope) = along.size, depart.function(u, last, q)
            dvalue = slope @ ca.vertcat(du, dlast, dp)
            start, duration, dstart, longer = value[:-1], value[-1], ca.vertcat(dvalue[:-1, :], own), dvalue[-1, :]
            data = ca.repmat(ca.vertcat(q, ca.vec(ca.DM(dq[[self.index]]))), 1, count)
            lengths = duration * (mesh[1:] - mesh[:-1]).T
            z, c, dc, made = scheme.one.mapaccum(count)(ca.vertcat(start, ca.vec(ca.DM(dx))), data, lengths)
            end, transition = z[:size, -1], ca.reshape(z[size:, -1], size, size + 1)
            dend = transition @ dstart + along.graph.field(end, q)[0] @ longer
            holds, slope = arrive.function(u, start, end, q, ca.MX(0, 1))
            residuals.append(holds)
            jacobians.append(slope @ ca.vertcat(du, dstart[:size, :], dend, dp))
            whole = ca.logic_and(mesh[0] == 0, mesh[-1] == 1)
            fine += [whole, ca.mmin(lengths) > 0, ca.mmin(made[0, :] == lengths), ca.mmin(made[1, :] <= DEFECT)]
            at_end = slope[:, n + size : n + 2 * size]
            results += [duration, transition, dstart, longer, at_end, c, dc, lengths, made[2, :]]
            last, dlast = end, dend
        results = [ca.vertcat(*residuals), ca.vertcat(*jacobians), ca.mmin(ca.vertcat(*fine)), *results]
        return dense("evaluation", [nodes, x, p], results)

    def _newton(self, counts: tuple[int, ...], evaluation: ca.Function) -> ca.Function:
        """A Newton step, (meshes, x (n + 1,), row (n + 1,), target, p) -> that and the curve's direction (n + 1, 2),
        whether the meshes are fine enough, residual (n,) where it leads, jacobian (n, n + 1), and for each arc what
        `SOLVED` names, to first order where the step leads."""
        equations, n = self.equations, self.equations.size + 1
        nodes, p = ca.MX.sym("t", evaluation.size1_in(0)), ca.MX.sym("p", evaluation.size1_in(2))
        x, row, target = ca.MX.sym("x", n), ca.MX.sym("row", n), ca.MX.sym("target")
        residual, jacobian, fine, *rest = evaluation(nodes, x, p)
        both = _both(n)(residual, jacobian, row, target - row.T @ x)
        step, ends, results = both[:, 0], [], []
        for along, count, arc in zip(equations.flows, counts, _arcs(rest, EVALUATED), strict=True):
            c, dc, lengths, size, order = arc["c"], arc["dc"], arc["lengths"], along.size, arc["c"].size1()
            if len(along.names) > size:  # without what is watched
                c = ca.horzcat(*[block[:, :size] for block in ca.horzsplit(c, len(along.names))])
            change = ca.diagcat(*[arc["start"] @ step] * count)
            c += ca.reshape(ca.reshape(dc, order * size, (size + 1) * count) @ change, order, size * count)
            last = lengths[-1] + arc["longer"] @ step
            fine = ca.fmin(fine, last > 0)
            ends.append(_value(order, size)(c[:, -size:], last))
            end = arc["duration"] + arc["longer"] @ step
            arc |= {"end": end, "c": c, "nodes": dc[0, :], "loads": lengths / arc["trusted"]}
            results += [arc[name] for name in SOLVED]
        new = x + step
        arrived = equations.arrivals.function(new[:-1], self._parameters(p, new[-1]), *ends)
        return dense("newton", [nodes, x, row, target, p], [both, fine, arrived, jacobian, *results])

    @staticmethod
    def _step(memory: int, evaluation: ca.Function, newton: ca.Function) -> ca.Function:
        """`step` from so many points, (meshes, and its arguments in their order) -> the prediction and the steps' end
        (n + 1, 2); of how many points that rests, the lengths of both steps, and whether the meshes are fine enough for
        the first (4,); and the results of `_newton`."""
        nodes, p, n = ca.MX.sym("t", evaluation.size1_in(0)), ca.MX.sym("p", evaluation.size1_in(2)), newton.size1_in(1)
        xs, tangents, known = ca.MX.sym("x", n, memory), ca.MX.sym("d", n, memory), ca.MX.sym("k", memory)
        row, level, closing, target = ca.MX.sym("r", n), ca.MX.sym("l"), ca.MX.sym("c", n), ca.MX.sym("t")
        size, last = ca.MX.sym("s", n), tangents[:, -1]
        guess, rests = hermite(n, memory, 0)(xs, tangents, known, row, level)
        guess += last * ((target - closing.T @ guess) / (closing.T @ last))
        residual, jacobian, fine, *_ = evaluation(nodes, guess, p)
        first = _both(n)(residual, jacobian, closing, target - closing.T @ guess)[:, 0]
        both, *results = newton(nodes, guess + first, closing, target, p)
        lengths = [ca.mmax(ca.fabs(step / size)) for step in (first, both[:, 0])]
        places, numbers = ca.horzcat(guess, guess + first + both[:, 0]), ca.vertcat(rests, *lengths, fine)
        arguments = [nodes, xs, tangents, known, row, level, closing, target, size, p]
        return dense("step", arguments, [places, numbers, both, *results])


def _arcs(results: Sequence, names: tuple[str, ...]) -> list[dict]:
    """Results of all arcs, one after the other, by name."""
    size = len(names)
    return [dict(zip(names, results[i : i + size], strict=True)) for i in range(0, len(results), size)]


@lru_cache(maxsize=32)
def _both(n: int) -> ca.Function:
    """(residual (n - 1,), jacobian (n - 1, n), row (n,), what its level lacks) -> the Newton step and the direction in
    which the level changes (n, 2); not numbers, and no error, where there is none."""
    residual, jacobian = ca.SX.sym("f", n - 1), ca.SX.sym("df", n - 1, n)
    row, lack = ca.SX.sym("row", n), ca.SX.sym("lack")
    right = ca.horzcat(ca.vertcat(-residual, lack), np.eye(n)[-1])
    return dense("both", [residual, jacobian, row, lack], [ca.solve(ca.vertcat(jacobian, row.T), right)])


@lru_cache(maxsize=32)
def _value(order: int, rows: int) -> ca.Function:
    """(coefficients (order, rows), t) -> the polynomials' values (rows,)."""
    c, t = ca.SX.sym("c", order, rows), ca.SX.sym("t")
    value = ca.SX.zeros(rows)
    for k in reversed(range(order)):
        value = value * t + c[k, :].T
    return ca.Function("value", [c, t], [value])
