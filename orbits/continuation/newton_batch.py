"""A boundary value statement at many points together: Newton steps from them, or a step along a curve, in one call.

Motions take Taylor's steps as long as they can be, each its own, and idle for the rest of a given number of them. With
that number, the statement, its derivatives and what follows from them are one function.
"""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from ..flow.taylor import LONGEST_STEP
from ..flow.trajectory import Trajectories
from ..periodic.single_shooting import Evaluation, Shooting, dense
from ..symbolic.calls import MappedFunction
from .predictor import hermite

# Functions that are kept for other numbers of steps.
MOST_KEPT = 64
# What is known of an arc: its duration, the derivatives of `Evaluation`, coefficients of the states (K + 1, n N) and of
# their derivatives (K + 1, n (n + 1) N), and the steps' lengths (1, N).
EVALUATED = "duration", "transition", "start", "longer", "holds", "c", "dc", "lengths"
# ... and once it is solved: when it ends, and the derivatives at its nodes (1, n (n + 1) N).
SOLVED = "end", "transition", "start", "longer", "holds", "c", "nodes", "lengths"


@lru_cache(maxsize=64)
def newton_batch(equations: Shooting, vary: str) -> "NewtonBatch":
    """Equations at many points, kept for the next call with the same."""
    return NewtonBatch(equations, vary)


class NewtonBatch:
    """The equations F(X) = 0 of unknowns and a varied parameter, X = (u, value), of which each arc is smooth.

    `counts` are numbers of steps, one for each arc, `ps` and `p` the parameters, of which that is replaced.
    """

    def __init__(self, equations: Shooting, vary: str):
        self.equations, self.vary = equations, vary
        self.index = equations.parameters.index(vary)
        # By numbers of steps and what is compiled: the statement, and the calls by the points that they remember.
        self._built: dict[tuple, tuple[ca.Function, dict[int, MappedFunction]]] = {}

    def newton_steps(self, counts, xs, ps, rows, targets) -> tuple:
        """As `Shooting.newton_steps`; where (m,) the steps are enough; and for each arc how many (m,) it takes, with
        those that are tried in vain."""
        return self._read(counts, self._called(0, counts, xs, rows, targets[:, None], ps))

    def step(self, counts, xs, tangents, known, row, level, closing, target, size, p):
        """Predicted from points (c, n + 1) of the curve, and two Newton steps.

        xs, tangents, known, row, level : what the prediction rests on, as in `hermite`, all points behind
        closing, target : the row (n + 1,) and level that close the equations
        size : (n + 1,), in whose units the lengths of the Newton steps are

        Returns the prediction; the steps' end, the direction of the curve, the equations there and Taylor's steps, as
        `newton_steps` gives them; and how many points the prediction rests on, and the lengths of both steps. None
        where the motion takes more of Taylor's steps.
        """
        arguments = xs, tangents, known, row, level, closing, target, size, p
        places, numbers, *results = self._called(len(xs), counts, *(np.reshape(a, (1, -1)) for a in arguments))
        _, directions, here, enough, used = self._read(counts, results)
        rests, before, last, also_enough = numbers[0, :, 0].tolist()
        if not (enough[0] and also_enough):
            return None
        return *places[0].T, directions[0], here, used, (int(rests), before, last)

    def _called(self, memory: int, counts: tuple[int, ...], *arguments) -> list[np.ndarray]:
        """The results of `_newton`, or where there is a memory of so many points, of `_step`, with these arguments."""
        steppers = tuple(along.stepper(along.size + 1, (self.index,)) for along in self.equations.flows)
        for stepper, count in zip(steppers, counts, strict=True):
            stepper.count_steps(count * len(arguments[0]))
        key = counts, tuple(stepper.compiled for stepper in steppers)
        if not (built := self._built.get(key)):
            if len(self._built) >= MOST_KEPT:
                self._built.clear()
            evaluation = self._evaluation(counts, steppers)
            built = self._built[key] = evaluation, {0: MappedFunction(self._newton(counts, evaluation))}
        evaluation, calls = built
        if memory not in calls:
            calls[memory] = MappedFunction(self._step(memory, evaluation, calls[0].function))
        return calls[memory](*arguments)

    def _read(self, counts, results) -> tuple:
        """`newton_steps` from the results of `_newton`."""
        vectors, enough, residual, jacobian, *rest = results
        arcs, used, size = [], [], len(vectors)
        enough = (enough[:, 0, 0] > 0) & np.isfinite(vectors).all((1, 2))
        for along, count, arc in zip(self.equations.flows, counts, _arcs(rest, SOLVED), strict=True):
            n, lengths = along.size, arc["lengths"][:, 0]
            taken = lengths > 0
            taken[:, 0] |= ~enough  # a motion has a step, though it be one in vain
            some, starts = slice(None) if taken.all() else taken.ravel(), lengths.cumsum(1) - lengths
            c = arc["c"].swapaxes(1, 2).reshape(size * count, n, -1)[some]
            nodes = arc["nodes"].reshape(size * count, n + 1, n)[some].swapaxes(1, 2)[..., None]
            motions = Trajectories(starts.ravel()[some], arc["end"][:, 0, 0], c, taken.sum(1), along.names[:n], nodes)
            enough &= motions.steps[motions.last] > 0
            arcs.append((motions, arc["transition"], arc["start"], arc["longer"][:, 0], arc["holds"]))
            used.append(count - taken[:, ::-1].argmax(1))
        here = Evaluation(residual[:, :, 0], jacobian, *zip(*arcs, strict=True))
        return vectors[:, :, 0], vectors[:, :, 1], here, enough, used

    def _parameters(self, p: ca.MX, value: ca.MX) -> ca.MX:
        """Parameters with a value of the varied one."""
        entries = ca.vertsplit(p)
        entries[self.index] = value
        return ca.vertcat(*entries)

    def _evaluation(self, counts: tuple[int, ...], steppers: tuple) -> ca.Function:
        """The statement and its derivatives by so many steps, (x (n + 1,), p) -> residual (n,), jacobian (n, n + 1),
        whether the steps are enough, and for each arc what `EVALUATED` names."""
        equations, n = self.equations, self.equations.size
        du, dp, own, seeds = (ca.DM(x) if isinstance(x, np.ndarray) else x for x in equations.seeds((self.vary,)))
        x, p = ca.MX.sym("x", n + 1), ca.MX.sym("p", len(equations.parameters))
        u, q = x[:-1], self._parameters(p, x[-1])
        last, dlast = ca.MX(0, 1), ca.MX(0, n + 1)
        residuals, jacobians, enough, results = [], [], [], []
        for along, count, stepper, (depart, arrive), (dx, dq) in zip(
            equations.flows, counts, steppers, equations.ends, seeds, strict=True
        ):
            size, (value, slope) = along.size, depart.function(u, last, q)
            dvalue = slope @ ca.vertcat(du, dlast, dp)
            start, duration, dstart, longer = value[:-1], value[-1], ca.vertcat(dvalue[:-1, :], own), dvalue[-1, :]
            data = ca.repmat(ca.vertcat(q, ca.vec(ca.DM(dq[[self.index]]))), 1, count)
            begin = ca.vertcat(start, ca.vec(ca.DM(dx)), duration, LONGEST_STEP)
            z, c, dc, made = stepper.step_function.mapaccum(count)(begin, data)
            end, transition, left = z[:size, -1], ca.reshape(z[size:-2, -1], size, size + 1), z[-2, -1]
            dend = transition @ dstart + along.vector_field.field(end, q)[0] @ longer
            holds, slope = arrive.function(u, start, end, q, ca.MX(0, 1))
            residuals.append(holds)
            jacobians.append(slope @ ca.vertcat(du, dstart[:size, :], dend, dp))
            enough += [duration > 0, left == 0]
            at_end = slope[:, n + size : n + 2 * size]
            results += [duration, transition, dstart, longer, at_end, c, dc, made[0, :]]
            last, dlast = end, dend
        results = [ca.vertcat(*residuals), ca.vertcat(*jacobians), ca.mmin(ca.vertcat(*enough)), *results]
        return dense("evaluation", [x, p], results)

    def _newton(self, counts: tuple[int, ...], evaluation: ca.Function) -> ca.Function:
        """A Newton step, (x (n + 1,), row (n + 1,), target, p) -> that and the curve's direction (n + 1, 2), whether
        the steps are enough, residual (n,) where it leads, jacobian (n, n + 1), and for each arc what `SOLVED` names,
        to first order where the step leads."""
        equations, n = self.equations, self.equations.size + 1
        x, p = ca.MX.sym("x", n), ca.MX.sym("p", evaluation.size1_in(1))
        row, target = ca.MX.sym("row", n), ca.MX.sym("target")
        residual, jacobian, enough, *rest = evaluation(x, p)
        both = _step_and_direction(n)(residual, jacobian, row, target - row.T @ x)
        step, ends, results = both[:, 0], [], []
        for along, count, arc in zip(equations.flows, counts, _arcs(rest, EVALUATED), strict=True):
            c, dc, lengths, size, order = arc["c"], arc["dc"], arc["lengths"], along.size, arc["c"].size1()
            if len(along.names) > size:  # without what is watched
                c = ca.horzcat(*[block[:, :size] for block in ca.horzsplit(c, len(along.names))])
            change = ca.diagcat(*[arc["start"] @ step] * count)
            c += ca.reshape(ca.reshape(dc, order * size, (size + 1) * count) @ change, order, size * count)
            longer = arc["longer"] @ step
            ends.append(_value(order, size)(c[:, -size:], lengths[-1] + longer))
            arc |= {"end": arc["duration"] + longer, "c": c, "nodes": dc[0, :]}
            results += [arc[name] for name in SOLVED]
        new = x + step
        arrived = equations.arrivals.function(new[:-1], self._parameters(p, new[-1]), *ends)
        return dense("newton", [x, row, target, p], [both, enough, arrived, jacobian, *results])

    @staticmethod
    def _step(memory: int, evaluation: ca.Function, newton: ca.Function) -> ca.Function:
        """`step` from so many points, its arguments in their order -> the prediction and the steps' end (n + 1, 2); of
        how many points that rests, the lengths of both steps, and whether Taylor's are enough for the first (4,); and
        the results of `_newton`."""
        n, p = evaluation.size1_in(0), ca.MX.sym("p", evaluation.size1_in(1))
        xs, tangents, known = ca.MX.sym("x", n, memory), ca.MX.sym("d", n, memory), ca.MX.sym("k", memory)
        row, level, closing, target = ca.MX.sym("r", n), ca.MX.sym("l"), ca.MX.sym("c", n), ca.MX.sym("t")
        size, last = ca.MX.sym("s", n), tangents[:, -1]
        guess, rests = hermite(n, memory, 0)(xs, tangents, known, row, level)
        guess += last * ((target - closing.T @ guess) / (closing.T @ last))
        residual, jacobian, enough, *_ = evaluation(guess, p)
        first = _step_and_direction(n)(residual, jacobian, closing, target - closing.T @ guess)[:, 0]
        both, *results = newton(guess + first, closing, target, p)
        lengths = [ca.mmax(ca.fabs(step / size)) for step in (first, both[:, 0])]
        places, numbers = ca.horzcat(guess, guess + first + both[:, 0]), ca.vertcat(rests, *lengths, enough)
        arguments = [xs, tangents, known, row, level, closing, target, size, p]
        return dense("step", arguments, [places, numbers, both, *results])


def _arcs(results: Sequence, names: tuple[str, ...]) -> list[dict]:
    """Results of all arcs, one after the other, by name."""
    size = len(names)
    return [dict(zip(names, results[i : i + size], strict=True)) for i in range(0, len(results), size)]


@lru_cache(maxsize=32)
def _step_and_direction(n: int) -> ca.Function:
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
