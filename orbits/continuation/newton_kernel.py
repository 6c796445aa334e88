"""Newton's method for many points of a curve at once: in each lane the motions, their closing and the steps."""

from itertools import accumulate
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..flow.taylor import LONGEST_STEP, TaylorStepper
from ..flow.trajectory import Trajectories, begins_of_steps
from ..numerics.roots import Array
from ..periodic.single_shooting import LAST_STEP, SMALL_STEP, STALLED_RATIO, Evaluation, Shooting
from ..symbolic.kept import kept
from ..symbolic.kernels import Kernel

# Newton steps of a corrector that converges, with some to spare.
MOST_NEWTON_STEPS = 8
# What a lane is doing: it takes Newton steps, follows the solution to record it, has done so, or has failed.
SOLVING, RECORDING, DONE, FAILED = 0, 1, 2, -1


class Solutions(NamedTuple):
    """Points X (m, n + 1) that solve the equations, the directions (m, n + 1) of the curve there, the growths (m,) of a
    small change over their motions, and the equations there, None where these are not asked for."""

    xs: Array
    directions: Array
    growths: Array
    evaluation: Evaluation | None


class NewtonKernel:
    """Newton's method for the equations F(u, p) = 0 of one arc, where a row measures the length along their curve and
    the parameter `along` varies.

    Steps of the motion are iterated; where one ends, the next Newton step begins another motion. The argument z holds
    the point X = (u, value), the direction of the curve, the last relative step, the growth of a small change, the
    number of Newton steps, what the lane is doing, the duration, and the argument of the motion. The data are the row,
    the level, what is one unit of each component of X, the parameters, the least number of Newton steps, and whether to
    record the motion of the solution.
    """

    def __init__(self, equations: Shooting, along: str):
        self.equations, self.along, (self.flow,) = equations, along, equations.flows
        self.size, self.place = equations.size + 1, equations.parameters.index(along)
        ((self.seeds, parameter_seeds),) = equations.seeds((along,))[3]
        used = np.flatnonzero(parameter_seeds.any(1))
        stepper = self.flow.stepper(self.seeds.shape[1], tuple(used.tolist()))
        assert isinstance(stepper, TaylorStepper)
        self.rows = stepper.rows
        self.kernel = Kernel(self._function(stepper.motion_function, parameter_seeds[used]))

    def __call__(
        self, xs: Array, rows: Array, levels: Array, units: Array, ps: Array, least: int, record: bool
    ) -> Solutions | None:
        """The solutions near points xs (m, n + 1) with parameters (m, np) where rows . X = levels, by at least so many
        Newton steps; None where one of them has to be solved for by itself."""
        n, control = self.size, self.flow.control
        states, columns = self.seeds.shape
        begin = self.equations.beginnings[0](xs[:, :-1], xs[:, :0], ps)[0][:, :, 0]
        z = np.zeros((len(xs), self.kernel.sizes_in[0]))
        z[:, :n], z[:, 2 * n], z[:, 2 * n + 4] = xs, np.inf, begin[:, -1]
        state, sensitivities = slice(2 * n + 5, 2 * n + 5 + states), slice(2 * n + 5 + states, -2)
        z[:, state], z[:, sensitivities] = begin[:, :-1], self.seeds.T.ravel()
        z[:, -2], z[:, -1] = begin[:, -1], LONGEST_STEP
        data = np.hstack([rows, levels[:, None], units, ps, np.full((len(xs), 2), (least, record))])
        z, (c, before, steps), counts, _ = self.kernel(z, data, most=control.max_block)
        doing, durations, ends = z[:, 2 * n + 3], z[:, 2 * n + 4], z[:, state]
        begins = begins_of_steps(steps[:, 0], counts)
        vanishing = steps[:, 0] <= control.shortest_step * np.maximum(begins, 1.0)
        if (doing != DONE).any() or vanishing.any() or not np.abs(ends).max() <= control.runaway:
            return None
        xs, evaluation = z[:, :n], None
        if record:
            variations = before.reshape(-1, columns, states, 1).swapaxes(1, 2)
            c = c.reshape(len(c), self.rows, -1)
            motions = Trajectories(begins, durations, c, counts, self.flow.names, variations)
            transitions = z[:, sensitivities].reshape(-1, columns, states).swapaxes(1, 2)
            ps = np.hstack([ps[:, : self.place], xs[:, -1:], ps[:, self.place + 1 :]])
            evaluation = self.equations.closed(xs[:, :-1], ps, (self.along,), [(motions, ends, transitions)])
        return Solutions(xs, z[:, n : 2 * n], z[:, 2 * n + 1], evaluation)

    def _function(self, motion_function: ca.Function, parameter_seeds: Array) -> ca.Function:
        """What the kernel iterates."""
        n, (states, columns), count = self.size, self.seeds.shape, len(self.equations.parameters)
        widths, given = (n, n, 1, 1, 1, 1, 1, motion_function.numel_in(0)), (n, 1, n, count, 1, 1)
        z, data = ca.MX.sym("z", sum(widths)), ca.MX.sym("data", sum(given))
        x, _, last, _, taken, doing, duration, motion = _split(z, *widths)
        row, level, unit, p, least, record = _split(data, *given)
        parameters = ca.vertsplit(p)

        def parameters_at(point: ca.MX) -> ca.MX:
            return ca.vertcat(*parameters[: self.place], point[-1], *parameters[self.place + 1 :])

        parameters_with_seeds = ca.vertcat(parameters_at(x), ca.DM(parameter_seeds).reshape((-1, 1)))
        after, c, _, length, accepted, goes = motion_function(motion, parameters_with_seeds)
        ended = ca.logic_and(accepted, after[-2] <= 0)
        end, transition = after[:states], ca.reshape(after[states:-2], states, columns)
        step, onward = self._newton()(x, parameters_at(x), end, transition, row, level)
        solves = ca.logic_and(ended, doing == SOLVING)
        does, moved, grown = _decision(n, states, columns)(step / unit, last, transition, taken + 1, least, record)
        does = ca.if_else(solves, does, ca.if_else(ended, DONE, doing))
        known = ca.if_else(solves, ca.vertcat(x + step, onward, moved, grown, taken + 1), z[: 2 * n + 3])
        restarts = ca.logic_and(solves, ca.logic_or(does == SOLVING, does == RECORDING))
        begin = self.equations.ends[0][0].function(known[: n - 1], ca.MX(0, 1), parameters_at(known[:n]))[0]
        start = ca.vertcat(begin[:-1], ca.vec(ca.DM(self.seeds)), begin[-1], LONGEST_STEP)
        new = ca.vertcat(known, does, ca.if_else(restarts, ca.vertcat(begin[-1], start), ca.vertcat(duration, after)))
        goes = ca.logic_or(restarts, ca.logic_and(goes, ca.logic_not(ended)))
        recorded = ca.logic_and(accepted, doing == RECORDING)
        return ca.Function("solve", [z, data], [new, c, motion[states:-2], length, recorded, goes])

    def _newton(self) -> ca.Function:
        """(X, parameters, end of the motion, its transition, row, level) -> Newton step and direction of the curve."""
        closing = self.equations.closing((self.along,)).function
        point, row, level = ca.SX.sym("x", self.size), ca.SX.sym("row", self.size), ca.SX.sym("level")
        p, end, transition, _, q, slopes = (ca.SX.sym("a", *closing.size_in(i)) for i in range(1, 7))
        speed = self.flow.vector_field.field(end, p)[0]
        residual, jacobian, *_ = closing(point[:-1], p, end, transition, speed, q, slopes)
        right = ca.vertcat(-residual, level - ca.dot(row, point))
        sides = ca.horzcat(right, ca.vertcat(ca.SX.zeros(self.size - 1), 1))
        found = _solved(ca.densify(ca.horzcat(ca.vertcat(jacobian, row.T), sides)))
        return ca.Function("newton", [point, p, end, transition, row, level], [found[:, 0], found[:, 1]])


def _decision(n: int, states: int, columns: int) -> ca.Function:
    """(relative Newton step (n,), size of the last one, transition of the motion, number of Newton steps, the least,
    whether to record) -> what the lane does next, size of the step, growth of a small change over the motion."""
    step, transition = ca.SX.sym("s", n), ca.SX.sym("T", states, columns)
    last, taken, least, record = (ca.SX.sym(name) for name in ("last", "taken", "least", "record"))
    size, growth = ca.mmax(ca.fabs(step)), ca.mmax(ca.fabs(transition[:, :states]))
    rounding = ca.logic_and(size < SMALL_STEP, size > STALLED_RATIO * last)
    settled = ca.logic_or(size * ca.fmax(growth, 1.0) < LAST_STEP, rounding)
    failed = ca.logic_or(ca.logic_not(size < STALLED_RATIO * last), taken >= MOST_NEWTON_STEPS)
    does = ca.if_else(settled, ca.if_else(record, RECORDING, DONE), ca.if_else(failed, FAILED, SOLVING))
    does = ca.if_else(taken >= least, does, SOLVING)
    return ca.Function("judged", [step, last, transition, taken, least, record], [does, size, growth])


def _split(vector: ca.MX, *widths: int) -> list[ca.MX]:
    return ca.vertsplit(vector, [*accumulate(widths, initial=0)])


def _solved(system: ca.SX) -> ca.SX:
    """The solutions of a system (n, n + k) with its right sides, by elimination with pairwise pivoting."""
    n = system.shape[0]
    rows = [system[i, :] for i in range(n)]
    for j in range(n):
        for i in range(j + 1, n):
            larger = ca.fabs(rows[i][j]) > ca.fabs(rows[j][j])
            rows[j], rows[i] = ca.if_else(larger, rows[i], rows[j]), ca.if_else(larger, rows[j], rows[i])
            rows[i] -= rows[i][j] / rows[j][j] * rows[j]
    found: list[ca.SX] = [ca.SX()] * n
    for j in reversed(range(n)):
        rest = sum((rows[j][k] * found[k] for k in range(j + 1, n)), ca.SX.zeros(1, system.shape[1] - n))
        found[j] = (rows[j][n:] - rest) / rows[j][j]
    return ca.vertcat(*found)


# The kernel of a statement's equations and a parameter, kept for the next call with the same.
newton_kernel = kept(NewtonKernel)
