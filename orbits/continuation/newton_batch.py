"""Newton steps from many points, or a step along the curve, in one call.

Each motion takes Taylor steps of its own lengths, as long as they can be, and idles for the rest of a given number of
steps. With a fixed number of steps the equations, their Jacobian and the Newton step are one CasADi function.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ..flow.taylor import LONGEST_STEP
from ..flow.trajectory import Trajectories
from ..numerics.roots import Array
from ..periodic.single_shooting import Evaluation, Shooting, dense
from ..symbolic.calls import MappedFunction
from ..symbolic.kept import kept
from .predictor import hermite

# Functions for so many different numbers of Taylor steps are kept.
MOST_KEPT = 64
# The outputs for an arc of N Taylor steps of order K with n states: its duration; the derivatives of `Evaluation` (of
# its end by its start, of its start, of its duration, and of the residual by its end); the Taylor coefficients of the
# states (K + 1, n N) and of their variations (K + 1, n (n + 1) N); and the lengths of the Taylor steps (1, N).
EVALUATED = "duration", "transition", "start", "longer", "residual_by_end", "c", "dc", "lengths"
# The same after a Newton step, to first order in it: the arc's end time instead of its duration, and of the variations
# only those at the start of each Taylor step (1, n (n + 1) N).
SOLVED = "end", "transition", "start", "longer", "residual_by_end", "c", "variations", "lengths"


class NewtonBatch:
    """The equations F(X) = 0 of the unknowns and a varied parameter, X = (u, value), for statements with smooth arcs:
    `counts` are numbers of Taylor steps for each, `ps` and `p` parameters, the varied one taken from X instead."""

    def __init__(self, equations: Shooting, vary: str):
        self.equations, self.vary, self.index = equations, vary, equations.parameters.index(vary)
        # By numbers of Taylor steps and compiled flows: the evaluation, and its calls by the number of points that a
        # step is predicted from, which is 0 for Newton steps alone.
        self._built: dict[tuple, tuple[ca.Function, dict[int, MappedFunction]]] = {}

    def newton_steps(self, counts: tuple[int, ...], xs: Array, ps: Array, rows: Array, targets: Array) -> tuple:
        """As `Shooting.newton_steps`; for which points (m,) the Taylor steps suffice; and for each arc how many (m,) it
        takes, those included that are tried in vain."""
        return self._unpacked(counts, self._call(0, counts, xs, rows, targets[:, None], ps))

    def step(self, counts: tuple[int, ...], *arguments: Any) -> tuple | None:
        """A step along the curve: a prediction from points (c, n + 1) of it, and two Newton steps.

        arguments : those of `hermite`, with all points behind, closing, target, size, p
        closing, target : the row (n + 1,) and level that close the equations
        size : (n + 1,), the units of the lengths of the Newton steps

        Returns the prediction (n + 1,); where the Newton steps lead, the direction of the curve, the equations and the
        Taylor steps there as from `newton_steps`; and the number of points that the prediction is interpolated from,
        with the lengths of both Newton steps. None where the motion takes more Taylor steps.
        """
        places, numbers, *results = self._call(len(arguments[0]), counts, *(np.reshape(a, (1, -1)) for a in arguments))
        _, directions, evaluation, enough, used = self._unpacked(counts, results)
        rests, before, last, also_enough = numbers[0, :, 0].tolist()
        if not (enough[0] and also_enough):
            return None
        return *places[0].T, directions[0], evaluation, used, (int(rests), before, last)

    def _call(self, memory: int, counts: tuple[int, ...], *arguments) -> list[np.ndarray]:
        """The results of `_newton_function`, or of `_step_function` where `memory` points are predicted from."""
        steppers: tuple = tuple(flow.stepper(flow.size + 1, (self.index,)) for flow in self.equations.flows)
        for stepper, count in zip(steppers, counts, strict=True):
            stepper.count_steps(count * len(arguments[0]))
        key = counts, tuple(stepper.compiled for stepper in steppers)
        if not (built := self._built.get(key)):
            if len(self._built) >= MOST_KEPT:
                self._built.clear()
            evaluation = self._evaluation_function(counts, steppers)
            built = self._built[key] = evaluation, {0: MappedFunction(self._newton_function(counts, evaluation))}
        evaluation, calls = built
        if memory not in calls:
            calls[memory] = MappedFunction(self._step_function(memory, evaluation, calls[0].function))
        return calls[memory](*arguments)

    def _unpacked(self, counts, results) -> tuple:
        """The results of `newton_steps` from those of `_newton_function`."""
        vectors, enough, residual, jacobian, *rest = results
        arcs, used, size, enough = [], [], len(vectors), (enough[:, 0, 0] > 0) & np.isfinite(vectors).all((1, 2))
        for flow, count, arc in zip(self.equations.flows, counts, _arcs(rest, SOLVED), strict=True):
            n, lengths = flow.size, arc["lengths"][:, 0]
            taken = lengths > 0
            taken[:, 0] |= ~enough  # even a motion that fails keeps one step, as `Trajectories` needs it
            some, starts = slice(None) if taken.all() else taken.ravel(), lengths.cumsum(1) - lengths
            c = arc["c"].swapaxes(1, 2).reshape(size * count, n, -1)[some]
            variations = arc["variations"].reshape(size * count, n + 1, n)[some].swapaxes(1, 2)[..., None]
            motions = Trajectories(
                starts.ravel()[some], arc["end"][:, 0, 0], c, taken.sum(1), flow.names[:n], variations
            )
            enough &= motions.steps[motions.last] > 0
            arcs.append((motions, arc["transition"], arc["start"], arc["longer"][:, 0], arc["residual_by_end"]))
            used.append(count - taken[:, ::-1].argmax(1))
        evaluation = Evaluation(residual[:, :, 0], jacobian, vectors[:, :, 0], *zip(*arcs, strict=True))
        return vectors[:, :, 0], vectors[:, :, 1], evaluation, enough, used

    def _parameters(self, p: ca.MX, value: ca.MX) -> ca.MX:
        """The parameters with a value of the varied one."""
        entries = ca.vertsplit(p)
        entries[self.index] = value
        return ca.vertcat(*entries)

    def _evaluation_function(self, counts: tuple[int, ...], steppers: tuple) -> ca.Function:
        """The equations and their derivatives by so many Taylor steps, (x (n + 1,), p) -> residual (n,), jacobian
        (n, n + 1), whether the steps suffice, and for each arc `EVALUATED`."""
        equations, n = self.equations, self.equations.size
        du, dp, own, seeds = (ca.DM(x) if isinstance(x, np.ndarray) else x for x in equations.seeds((self.vary,)))
        x, p = ca.MX.sym("x", n + 1), ca.MX.sym("p", len(equations.parameters))
        u, q = x[:-1], self._parameters(p, x[-1])
        last, dlast = ca.MX(0, 1), ca.MX(0, n + 1)
        residuals, jacobians, enough, results = [], [], [], []
        arcs = zip(equations.flows, counts, steppers, equations.ends, seeds, strict=True)
        for flow, count, stepper, (departure, arrival), (dx, dq) in arcs:
            size, (value, slope) = flow.size, departure.function(u, last, q)
            dvalue = slope @ ca.vertcat(du, dlast, dp)
            start, duration, dstart, longer = value[:-1], value[-1], ca.vertcat(dvalue[:-1, :], own), dvalue[-1, :]
            data = ca.repmat(ca.vertcat(q, ca.vec(ca.DM(dq[[self.index]]))), 1, count)
            begin = ca.vertcat(start, ca.vec(ca.DM(dx)), duration, LONGEST_STEP)
            z, c, dc, made = stepper.step_function.mapaccum(count)(begin, data)
            end, transition, left = z[:size, -1], ca.reshape(z[size:-2, -1], size, size + 1), z[-2, -1]
            dend = transition @ dstart + flow.vector_field.field(end, q)[0] @ longer
            residual, slope = arrival.function(u, start, end, q, ca.MX(0, 1))
            residuals.append(residual)
            jacobians.append(slope @ ca.vertcat(du, dstart[:size, :], dend, dp))
            enough += [duration > 0, left == 0]
            results += [duration, transition, dstart, longer, slope[:, n + size : n + 2 * size], c, dc, made[0, :]]
            last, dlast = end, dend
        whole = [ca.vertcat(*residuals), ca.vertcat(*jacobians), ca.mmin(ca.vertcat(*enough))]
        return dense("evaluation", [x, p], [*whole, *results])

    def _newton_function(self, counts: tuple[int, ...], evaluation: ca.Function) -> ca.Function:
        """A Newton step, (x (n + 1,), row (n + 1,), target, p) -> step and direction of the curve (n + 1, 2), whether
        the Taylor steps suffice, residual (n,) where the step leads, jacobian (n, n + 1), and for each arc `SOLVED`."""
        equations, n = self.equations, self.equations.size + 1
        x, p = ca.MX.sym("x", n), ca.MX.sym("p", evaluation.size1_in(1))
        row, target = ca.MX.sym("row", n), ca.MX.sym("target")
        residual, jacobian, enough, *rest = evaluation(x, p)
        step_and_direction = _solve_bordered(n)(residual, jacobian, row, target - row.T @ x)
        step, ends, results = step_and_direction[:, 0], [], []
        for flow, count, arc in zip(equations.flows, counts, _arcs(rest, EVALUATED), strict=True):
            c, dc, lengths, size, order = arc["c"], arc["dc"], arc["lengths"], flow.size, arc["c"].size1()
            if len(flow.names) > size:  # without the coefficients of watched quantities
                c = ca.horzcat(*[block[:, :size] for block in ca.horzsplit(c, len(flow.names))])
            change = ca.diagcat(*[arc["start"] @ step] * count)
            c += ca.reshape(ca.reshape(dc, order * size, (size + 1) * count) @ change, order, size * count)
            longer = arc["longer"] @ step
            ends.append(_value(order, size)(c[:, -size:], lengths[-1] + longer))
            arc |= {"end": arc["duration"] + longer, "c": c, "variations": dc[0, :]}
            results += [arc[name] for name in SOLVED]
        new = x + step
        residual = equations.arrivals.function(new[:-1], self._parameters(p, new[-1]), *ends)
        return dense("newton", [x, row, target, p], [step_and_direction, enough, residual, jacobian, *results])

    @staticmethod
    def _step_function(memory: int, evaluation: ca.Function, newton: ca.Function) -> ca.Function:
        """`step` from `memory` points -> the prediction and where the Newton steps lead (n + 1, 2); (4,): how many
        points are used, both steps' lengths, whether the Taylor steps suffice for the first; results of the second."""
        n, p = evaluation.size1_in(0), ca.MX.sym("p", evaluation.size1_in(1))
        xs, tangents, known = ca.MX.sym("x", n, memory), ca.MX.sym("d", n, memory), ca.MX.sym("k", memory)
        row, level, closing, target = ca.MX.sym("r", n), ca.MX.sym("l"), ca.MX.sym("c", n), ca.MX.sym("t")
        size, last = ca.MX.sym("s", n), tangents[:, -1]
        guess, rests = hermite(n, memory, 0)(xs, tangents, known, row, level)
        guess += last * ((target - closing.T @ guess) / (closing.T @ last))
        residual, jacobian, enough, *_ = evaluation(guess, p)
        first = _solve_bordered(n)(residual, jacobian, closing, target - closing.T @ guess)[:, 0]
        step_and_direction, *results = newton(guess + first, closing, target, p)
        second = step_and_direction[:, 0]
        lengths = [ca.mmax(ca.fabs(step / size)) for step in (first, second)]
        places, numbers = ca.horzcat(guess, guess + first + second), ca.vertcat(rests, *lengths, enough)
        arguments = [xs, tangents, known, row, level, closing, target, size, p]
        return dense("step", arguments, [places, numbers, step_and_direction, *results])


# The equations at many points, kept for the next call with the same equations.
newton_batch = kept(NewtonBatch)


def _arcs(results: Sequence, names: tuple[str, ...]) -> list[dict]:
    """The outputs of each arc by name, from those of all arcs one after the other."""
    size = len(names)
    return [dict(zip(names, results[i : i + size], strict=True)) for i in range(0, len(results), size)]


@lru_cache(maxsize=32)
def _solve_bordered(n: int) -> ca.Function:
    """(residual (n - 1,), jacobian (n - 1, n), row (n,), lack = target - level) -> the Newton step and the direction of
    the curve (n, 2), which solve the Jacobian bordered by the row for (-residual, lack) and (0, 1); NaN if singular."""
    residual, jacobian = ca.SX.sym("f", n - 1), ca.SX.sym("df", n - 1, n)
    row, lack = ca.SX.sym("row", n), ca.SX.sym("lack")
    right = ca.horzcat(ca.vertcat(-residual, lack), np.eye(n)[-1])
    return dense("bordered", [residual, jacobian, row, lack], [ca.solve(ca.vertcat(jacobian, row.T), right)])


@lru_cache(maxsize=32)
def _value(order: int, rows: int) -> ca.Function:
    """(coefficients (order, rows), t) -> the polynomials' values (rows,)."""
    c, t = ca.SX.sym("c", order, rows), ca.SX.sym("t")
    value = ca.SX.zeros(rows)
    for k in reversed(range(order)):
        value = value * t + c[k, :].T
    return ca.Function("value", [c, t], [value])
