"""Newton's method for many points of a curve at once: in each lane the motions, their closing and the steps."""

from typing import NamedTuple

import casadi as ca
import numpy as np

from ..flow.taylor import LONGEST_STEP, TaylorStepper
from ..flow.trajectory import Trajectories, begins_of_steps
from ..numerics.roots import Array
from ..symbolic.kept import kept
from ..symbolic.kernels import Kernel
from .single_shooting import LAST_STEP, SMALL_STEP, STALLED_RATIO, Evaluation, Shooting

# Newton steps of a corrector that converges, with some to spare.
MOST_NEWTON_STEPS = 8
# What a lane is doing: it takes Newton steps, follows the solution to record it, has done so, or has failed.
SOLVING, RECORDING, DONE, FAILED = 0, 1, 2, -1


class Solutions(NamedTuple):
    """Which of the points (k,) are solved for, the points X (k, n + 1) that solve the equations, the directions
    (k, n + 1) of the curve there, the growths (k,) of a small change over their motions, and the equations there, None
    where these are not asked for."""

    which: Array
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
    ) -> Solutions:
        """The solutions near points xs (m, n + 1) with parameters (m, np) where rows . X = levels, by at least so many
        Newton steps; the points left out have to be solved for by themselves."""
        n, control = self.size, self.flow.control
        states, columns = self.seeds.shape
        state, sensitivities = slice(2 * n + 5, 2 * n + 5 + states), slice(2 * n + 5 + states, -2)
        begin = self.equations.beginnings[0](xs[:, :-1], xs[:, :0], ps)[0][:, :, 0]
        z = np.zeros((len(xs), self.kernel.sizes_in[0]))
        z[:, :n], z[:, 2 * n], z[:, 2 * n + 4], z[:, state] = xs, np.inf, begin[:, -1], begin[:, :-1]
        z[:, sensitivities], z[:, -2], z[:, -1] = self.seeds.T.ravel(), begin[:, -1], LONGEST_STEP
        data = np.hstack([rows, levels[:, None], units, ps, np.full((len(xs), 2), (least, record))])
        z, (c, before, steps), counts, _ = self.kernel(z, data, most=control.max_block)
        solved = (z[:, 2 * n + 3] == DONE) & (np.abs(z[:, state]).max(1) <= control.runaway)
        if record:
            owner = np.repeat(np.arange(len(z)), counts)
            begins = begins_of_steps(steps[:, 0], counts)
            solved[owner[steps[:, 0] <= control.shortest_step * np.maximum(begins, 1.0)]] = False
        if not solved.all():
            if record:
                kept = solved[owner]
                c, before, begins, counts = c[kept], before[kept], begins[kept], counts[solved]
            z, ps = z[solved], ps[solved]
        xs, directions, growths, ends = z[:, :n], z[:, n : 2 * n], z[:, 2 * n + 1], z[:, state]
        which = np.flatnonzero(solved)
        if not (record and len(which)):
            return Solutions(which, xs, directions, growths, None)
        variations = before.reshape(-1, columns, states, 1).swapaxes(1, 2)
        c = c.reshape(len(c), self.rows, -1)
        motions = Trajectories(begins, z[:, 2 * n + 4], c, counts, self.flow.names, variations)
        transitions = z[:, sensitivities].reshape(-1, columns, states).swapaxes(1, 2)
        ps = np.hstack([ps[:, : self.place], xs[:, -1:], ps[:, self.place + 1 :]])
        evaluation = self.equations.closed(xs[:, :-1], ps, (self.along,), [(motions, ends, transitions)])
        return Solutions(which, xs, directions, growths, evaluation)

    def _function(self, motion_function: ca.Function, parameter_seeds: Array) -> ca.Function:
        """What the kernel iterates."""
        n, (states, columns), count = self.size, self.seeds.shape, len(self.equations.parameters)
        widths, given = (n, n, 1, 1, 1, 1, 1, motion_function.numel_in(0)), (n, 1, n, count, 1, 1)
        z, data = ca.MX.sym("z", sum(widths)), ca.MX.sym("data", sum(given))
        x, _, last, _, taken, doing, duration, motion = ca.vertsplit(z, np.cumsum([0, *widths]).tolist())
        row, level, unit, p, *options = ca.vertsplit(data, np.cumsum([0, *given]).tolist())
        parameters = ca.vertsplit(p)

        def parameters_at(point: ca.MX) -> ca.MX:
            return ca.vertcat(*parameters[: self.place], point[-1], *parameters[self.place + 1 :])

        parameters_with_seeds = ca.vertcat(parameters_at(x), ca.DM(parameter_seeds).reshape((-1, 1)))
        after, c, _, length, accepted, goes = motion_function(motion, parameters_with_seeds)
        ended = ca.logic_and(accepted, after[-2] <= 0)
        closing = parameters_at(x), after[:states], ca.reshape(after[states:-2], states, columns)
        found, does = self._newton()(x, *closing, row, level, unit, last, taken + 1, *options)
        solves = ca.logic_and(ended, doing == SOLVING)
        does = ca.if_else(solves, does, ca.if_else(ended, DONE, doing))
        known = ca.if_else(solves, found, z[: 2 * n + 3])
        restarts = ca.logic_and(solves, ca.logic_or(does == SOLVING, does == RECORDING))
        begin = self.equations.ends[0][0].function(known[: n - 1], ca.MX(0, 1), parameters_at(known[:n]))[0]
        start = ca.vertcat(begin[-1], begin[:-1], ca.vec(ca.DM(self.seeds)), begin[-1], LONGEST_STEP)
        new = ca.vertcat(known, does, ca.if_else(restarts, start, ca.vertcat(duration, after)))
        goes = ca.logic_or(restarts, ca.logic_and(goes, ca.logic_not(ended)))
        recorded = ca.logic_and(accepted, doing == RECORDING)
        return ca.Function("solve", [z, data], [new, c, motion[states:-2], length, recorded, goes])

    def _newton(self) -> ca.Function:
        """(X, parameters, end of the motion, its transition, row, level, unit, size of the last Newton step, number of
        steps, the least, whether to record) -> what z holds of the next point, and what the lane does next."""
        closing = self.equations.closing((self.along,)).function
        x, row, unit = (ca.SX.sym(name, self.size) for name in ("x", "row", "unit"))
        p, end, transition, _, q, slopes = (ca.SX.sym("a", *closing.size_in(i)) for i in range(1, 7))
        level, last, taken, least, record = ca.vertsplit(ca.SX.sym("options", 5))
        speed = self.flow.vector_field.field(end, p)[0]
        residual, jacobian, *_ = closing(x[:-1], p, end, transition, speed, q, slopes)
        sides = ca.vertcat(ca.horzcat(-residual, ca.SX(self.size - 1, 1)), ca.horzcat(level - ca.dot(row, x), 1))
        found = _solved(ca.densify(ca.horzcat(ca.vertcat(jacobian, row.T), sides)))
        size, growth = ca.mmax(ca.fabs(found[:, 0] / unit)), ca.mmax(ca.fabs(transition[:, : end.numel()]))
        rounding = ca.logic_and(size < SMALL_STEP, size > STALLED_RATIO * last)
        settled = ca.logic_or(size * ca.fmax(growth, 1.0) < LAST_STEP, rounding)
        failed = ca.logic_or(ca.logic_not(size < STALLED_RATIO * last), taken >= MOST_NEWTON_STEPS)
        does = ca.if_else(settled, ca.if_else(record, RECORDING, DONE), ca.if_else(failed, FAILED, SOLVING))
        known = ca.vertcat(x + found[:, 0], found[:, 1], size, growth, taken)
        arguments = [x, p, end, transition, row, level, unit, last, taken, least, record]
        return ca.Function("newton", arguments, [known, ca.if_else(taken >= least, does, SOLVING)])


def _solved(system: ca.SX) -> ca.SX:
    """The solutions of a system (n, n + k) with its right sides, by elimination with pivoting."""
    n = system.shape[0]
    rows = [system[i, :] for i in range(n)]
    for j in range(n):
        for i in range(j + 1, n):
            larger = ca.fabs(rows[i][j]) > ca.fabs(rows[j][j])
            rows[j], rows[i] = ca.if_else(larger, rows[i], rows[j]), ca.if_else(larger, rows[j], rows[i])
        rows = [row if i == j else row - row[j] / rows[j][j] * rows[j] for i, row in enumerate(rows)]
    return ca.vertcat(*[row[n:] / row[j] for j, row in enumerate(rows)])


# The kernel of a statement's equations and a parameter, kept for the next call with the same.
newton_kernel = kept(NewtonKernel)
