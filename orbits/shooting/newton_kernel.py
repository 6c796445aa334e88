"""Newton's method for many points of a curve together: in each lane the motions, the equations at their ends, steps."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..flow import TAYLOR, TaylorStepper, Trajectories, begins_of_steps, coefficients_of, rows_used
from ..numerics import ROOTS, Array
from ..symbolic import Block, Kernel, Number, VectorCode, cached
from .single_shooting import NEWTON, Evaluation, Shooting, arrival, settles


class Lane(IntEnum):
    """The state of a lane: it takes Newton steps, integrates the solution to record it, has recorded it, or failed."""

    SOLVING = 0
    RECORDING = 1
    DONE = 2
    FAILED = -1


class Solutions(NamedTuple):
    """The indices (k,) of the solved points, the points X (k, n + 1) that solve the equations, the directions
    (k, n + 1) of the curve there, the growths (k,) of a small change over their motions, and the equations there, None
    where they are not requested."""

    which: Array
    xs: Array
    directions: Array
    growths: Array
    evaluation: Evaluation | None


class NewtonPlaces(NamedTuple):
    """The places in z, the data of a lane between two steps of a motion, of the entries in addition to that motion."""

    point: slice  # X = (u, value)
    direction: slice  # of the curve there
    last: int  # the size of the last Newton step
    growth: int  # of a small change over the motion
    taken: int  # the number of Newton steps
    doing: int  # the state of the lane
    duration: int  # of the motion
    begins: int  # whether the motion begins
    data: slice  # of the piece where it begins


class NewtonKernel:
    """Newton's method for the equations F(u, p) = 0 of one arc, where a row measures the length along their curve and
    the parameter `along` varies.

    Steps of the motion are iterated; where one ends, the next Newton step begins another motion. The argument z is that
    of the motion, then the entries at `places`. The data are the row, the level, the unit of each component of X, the
    parameters, the least number of Newton steps, and whether the motion of the solution is requested. On pieces, a
    further argument are their breakpoints.
    """

    def __init__(self, equations: Shooting, along: str):
        self.equations, self.along, (self.flow,) = equations, along, equations.flows
        self.size, self.place = equations.size + 1, equations.parameters.index(along)
        ((self.seeds, parameter_seeds),) = equations.seeds((along,))[3]
        stepper = self.flow.stepper(self.seeds.shape[1], rows_used(parameter_seeds))
        assert isinstance(stepper, TaylorStepper)
        self.stepper, self.motion, first = stepper, stepper.places, stepper.places.time
        last = first + 2 * self.size
        parts = slice(first, first + self.size), slice(first + self.size, last)
        data = slice(last + 6, last + 6 + self.flow.vector_field.data)
        self.places = NewtonPlaces(*parts, last, last + 1, last + 2, last + 3, last + 4, last + 5, data)
        self.kernel = self._kernel(parameter_seeds)

    def __call__(
        self, xs: Array, rows: Array, levels: Array, units: Array, ps: Array, least: int, with_motions: bool,
        most: int | None = None,
    ) -> Solutions:  # fmt: skip
        """The solutions near points xs (m, n + 1) with parameters (m, np) where rows . X = levels, by at least `least`
        Newton steps; the points left out have to be solved one by one.

        most : steps of a motion that are recorded, which bounds the memory; None for those of one call of the flow
        """
        at, motion, control, (states, columns) = self.places, self.motion, self.flow.control, self.seeds.shape
        begin = self.equations.beginnings[0](xs[:, :-1], xs[:, :0], ps)[0][:, :, 0]
        z = np.zeros((len(xs), self.kernel.sizes_in[0]))
        z[:, at.point], z[:, at.last], z[:, at.duration], z[:, motion.state] = xs, np.inf, begin[:, -1], begin[:, :-1]
        z[:, motion.sensitivities], z[:, motion.left] = self.seeds.T.ravel(), begin[:, -1]
        z[:, motion.longest], z[:, at.doing], z[:, at.begins] = TAYLOR.longest_step, Lane.SOLVING, 1.0
        data = [rows, levels[:, None], units, ps, np.full((len(xs), 2), (least, with_motions))]
        pieces = list[Array]()
        if on := self.flow.on_pieces(begin[:, :-1], ps):
            z[:, motion.piece], pieces = on.numbers, [on.breaks, on.tables]
        z, (c, before, steps), counts, _ = self.kernel(z, np.hstack(data), *pieces, most=most or control.together)
        solved = (z[:, at.doing] == Lane.DONE) & (np.abs(z[:, motion.state]).max(1) <= control.runaway)
        owner, begins = np.repeat(np.arange(len(z)), counts), begins_of_steps(steps[:, 0], counts)
        solved[owner[steps[:, 0] <= control.shortest_step * np.maximum(begins, 1.0)]] = False
        if not solved.all():
            of_solved = solved[owner]
            c, before, begins, counts = c[of_solved], before[of_solved], begins[of_solved], counts[solved]
            z, ps = z[solved], ps[solved]
        xs, directions, growths, ends = z[:, at.point], z[:, at.direction], z[:, at.growth], z[:, motion.state]
        which = np.flatnonzero(solved)
        if not (with_motions and len(which)):
            return Solutions(which, xs, directions, growths, None)
        variations = before.reshape(-1, columns, states).swapaxes(1, 2)
        c = coefficients_of(c, self.stepper.rows, self.stepper.graph.order)
        motions = Trajectories(begins, z[:, at.duration], c, counts, self.flow.names, variations)
        transitions = z[:, motion.sensitivities].reshape(-1, columns, states).swapaxes(1, 2)
        ps = self.equations.with_tuned(xs, np.hstack([ps[:, : self.place], xs[:, -1:], ps[:, self.place + 1 :]]))
        arcs = [(motions, *arrival(self.flow, motions, ends, transitions, ps))]
        evaluation = self.equations.closed(xs[:, :-1], ps, (self.along,), arcs)
        return Solutions(which, xs, directions, growths, evaluation)

    def _kernel(self, parameter_seeds: Array) -> Kernel:
        """The kernel, which iterates a step of the motion and, where that ends, the Newton step."""
        stepper, at, at_piece = self.stepper, self.places, self.motion.piece
        next_motion, rows = self._next_motion(), self.stepper.sizes[2:]
        parameters = ca.Function("parameters", *self._parameters())
        seeds = parameter_seeds[stepper.varied_parameters].T.ravel().tolist()

        def append(code: VectorCode, arguments: Sequence) -> list:
            z, data, *pieces = arguments
            breaks, row = pieces[:1], pieces[1:]
            own = [*code.graph(parameters, [z[at.point], data])[0], *map(code.splat, seeds)]
            moved = stepper.motion(code, z[: at.point.start], own, *row)
            flags = [moved.counts.value()], [moved.goes.value()]
            new, recorded, goes, *start = code.graph(next_motion, [z, data, *row, moved.after, *flags])
            if start:
                (restarts,), (place,) = start
                mask = code.nonzero(restarts)
                new[at_piece] = code.choose(mask, _piece(code, mask, place, *breaks), moved.after[at_piece])
            return [new, moved.rows, moved.begins, moved.length, recorded, goes]

        sizes = [at.data.stop, stepper.recorded, stepper.n * stepper.columns, 2, 1, 1]
        pieces = [self.flow.breaks, *rows] if rows else []
        return stepper.kernel_of(append, [at.data.stop, sum(self.sizes), *pieces], sizes, (2,) if rows else ())

    @property
    def sizes(self) -> list[int]:
        """The sizes of the parts of the data."""
        return [self.size, 1, self.size, len(self.equations.parameters), 1, 1]

    def _parameters(self) -> tuple[list, list]:
        """The symbols of X and the data, and of these the parameters at X."""
        x, data = ca.SX.sym("x", self.size), ca.SX.sym("data", sum(self.sizes))
        return [x, data], [self._parameters_at(x, data)]

    def _parameters_at(self, x: ca.SX, data: ca.SX) -> ca.SX:
        equations, first = self.equations, sum(self.sizes[:3])
        places = {**dict(zip(equations.places, range(equations.own, equations.size), strict=True)), self.place: -1}
        own = ca.vertsplit(data[first : first + len(equations.parameters)])
        return ca.vertcat(*(x[places[i]] if i in places else each for i, each in enumerate(own)))

    def _next_motion(self) -> ca.Function:
        """(z, data, row of the piece, z of the motion after a step, whether this counts, whether it continues) -> the
        new z, whether the step is recorded, whether to continue and, on pieces, whether a motion begins, and the place
        of the coordinate there, by which its piece is chosen."""
        at, motion, stepper, shape = self.places, self.motion, self.stepper, self.seeds.shape
        z, data, after = ca.SX.sym("z", at.data.stop), ca.SX.sym("data", sum(self.sizes)), ca.SX.sym("m", motion.time)
        accepted, going = ca.SX.sym("counts"), ca.SX.sym("goes")
        piece = [ca.SX.sym("row", size) for size in stepper.sizes[2:]]
        x, doing = z[at.point], z[at.doing]
        row, level, unit, _, *options = ca.vertsplit(data, np.cumsum([0, *self.sizes]).tolist())
        q = stepper.piece_rows.split(*piece)[0][1] if piece else ca.SX(0, 1)
        begun = ca.if_else(z[at.begins] > 0, q, z[at.data]) if piece else q
        ended = ca.logic_and(accepted, after[motion.left] <= 0)
        p = self._parameters_at(x, data)
        closing = p, after[motion.state], ca.reshape(after[motion.sensitivities], *shape), begun, q
        found, does = self._newton()(x, *closing, row, level, unit, z[at.last], z[at.taken] + 1, *options)
        solves = ca.logic_and(ended, doing == Lane.SOLVING)
        does = ca.if_else(solves, does, ca.if_else(ended, Lane.DONE, doing))
        known = ca.if_else(solves, found, z[at.point.start : at.doing])
        restarts = ca.logic_and(solves, ca.logic_or(does == Lane.SOLVING, does == Lane.RECORDING))
        x = known[: self.size]  # known are the places from the point up to the state of the lane
        p = self._parameters_at(x, data)
        begin = self.equations.ends[0][0].function(x[:-1], ca.SX(0, 1), p)[0]
        start = ca.vertcat(begin[:-1], ca.vec(ca.DM(self.seeds)), begin[-1], TAYLOR.longest_step, 0.0)
        duration = ca.if_else(restarts, begin[-1], z[at.duration])
        begins = ca.logic_or(restarts, ca.logic_and(z[at.begins] > 0, ca.logic_not(accepted)))
        new = ca.vertcat(ca.if_else(restarts, start, after), known, does, duration, begins, begun)
        goes = ca.logic_or(restarts, ca.logic_and(going, ca.logic_not(ended)))
        recorded = ca.logic_and(accepted, doing == Lane.RECORDING)
        arguments, results = [z, data, *piece, after, accepted, going], [ca.densify(new), recorded, goes]
        if piece:
            results += [restarts, self.flow.vector_field.place(begin[:-1], p)]
        return ca.Function("next", arguments, results, {"cse": True})

    def _newton(self) -> ca.Function:
        """(X, parameters, end of the motion, its transition, data of the pieces at its start and end, row, level, unit,
        size of the last Newton step, number of steps, the least, whether its motion is requested) -> the new entries of
        z, and the next state of the lane. The data of the pieces do not vary along the curve."""
        closing = self.equations.closing((self.along,)).function
        x, row, unit = (ca.SX.sym(name, self.size) for name in ("x", "row", "unit"))
        p, end, transition, _, q, slopes = (ca.SX.sym("a", *closing.size_in(i)) for i in range(1, 7))
        level, last, taken, least, with_motions = ca.vertsplit(ca.SX.sym("options", 5))
        q_end = ca.SX.sym("q", q.numel())
        speed = self.flow.vector_field.field(end, ca.vertcat(p, q_end))[0]
        residual, jacobian, *_ = closing(x[:-1], p, end, transition, speed, q, ca.SX(*slopes.shape))
        sides = ca.vertcat(ca.horzcat(-residual, ca.SX(self.size - 1, 1)), ca.horzcat(level - ca.dot(row, x), 1))
        found = _solved(ca.densify(ca.horzcat(ca.vertcat(jacobian, row.T), sides)))
        n, units = end.numel(), ca.SX(unit)
        growth = ca.mmax(ca.fabs(transition[:, :n]))
        for column, place in enumerate(self.equations.moving((self.along,)), start=n):
            own = growth * ca.mmax(ca.fabs(end)) / ca.mmax(ca.fabs(transition[:, column]))  # as `parameter_units`
            units[place] = ca.fmin(unit[place], own)
        size = ca.mmax(ca.fabs(found[:, 0] / units))
        settled = settles(size, last, growth)
        failed = ca.logic_or(ca.logic_not(size < ROOTS.stalled_ratio * last), taken >= NEWTON.steps)
        does = ca.if_else(
            settled, ca.if_else(with_motions, Lane.RECORDING, Lane.DONE), ca.if_else(failed, Lane.FAILED, Lane.SOLVING)
        )
        known = ca.vertcat(x + found[:, 0], found[:, 1], size, growth, taken)
        arguments = [x, p, end, transition, q, q_end, row, level, unit, last, taken, least, with_motions]
        return ca.Function("newton", arguments, [known, ca.if_else(taken >= least, does, Lane.SOLVING)])


def _piece(code: VectorCode, mask: str, place: str, breaks: Block) -> str:
    """The number of the piece at a place, as in `PieceRows`, in the lanes of a mask."""
    at, first = Number(code, place), code.place(breaks.place - 1)

    def body(k: str, before: list[str]) -> list[str]:
        number = Number(code, before[0])
        return [(Number(code, code.get(code.offset(first, k))) <= at).choose(number + 1.0, number).name]

    # The last breakpoint belongs to the piece below it.
    (number,) = code.loop(1, code.if_any(mask, breaks.count - 1), body, [code.splat(0)])
    below, last = Number(code, number), Number(code, code.get(code.place(breaks.place + breaks.count - 1)))
    return (last < at).choose(below + 1.0, below).name


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


# The kernel of a statement's equations and a parameter, cached for the next call with the same arguments.
newton_kernel = cached(NewtonKernel)
