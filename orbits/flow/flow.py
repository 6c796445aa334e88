"""The flow map of a phase with exact derivatives, as a piecewise polynomial that is accurate throughout each step.

A phase may state its flow in closed form. Else Taylor series of order 28 are used or, where an operation of the field
has none, Runge-Kutta steps of order 8. The error alone controls the step size. Steps end on breakpoints of the field.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import BreaksDown, FlowError, OutOfRange, RunsAway
from ..laws.law import parameters_of
from ..model.modes import Modes
from ..model.phase import Phase
from ..numerics.polynomial_roots import evaluate
from ..numerics.roots import Array
from ..running import interrupts
from ..symbolic.caches import cached
from ..symbolic.calls import BufferedFunction, MappedFunction
from ..symbolic.kernels import ElementwiseFunction
from ..units import TIME, Message, Quantity, described
from .breakpoints import SIDE_DISTANCE, same_place
from .runge_kutta import RungeKuttaMotion, RungeKuttaStepper
from .taylor import OnPieces, TaylorMotion, TaylorStepper
from .taylor_step import PieceRows
from .trajectory import Trajectories, Trajectory, begins_of_steps
from .vector_field import FLOW_CONTROL, TAYLOR_ORDER, VectorField, rows_used

# The message about a motion that needs a law where it has no value.
OUT_OF_LAW = "leaves the law's range"
# Shares of a duration that are rounding: of a remaining time in closed form, and of a difference of two times.
STEP_ROUNDING, SAME_TIME = 1e-12, 1e-15
# A field that changes by a larger share of its size across a breakpoint jumps.
LEAST_JUMP = 1e-8
LARGEST_BLOCK = 4000  # steps in closed form that are searched in one call
# (coefficients (m, rows, K + 1), steps (m,)) -> the step and the time in it at which to stop, None to go on.
StopTest = Callable[[Array, Array], tuple[int, float] | None]


@cached
def flow_of(phase: Phase, parameters: tuple[str, ...]) -> "Flow":
    """The flow of a phase, stored for the next call with the same phase."""
    return Flow(phase, parameters)


@dataclass(frozen=True, eq=False)
class _Drift:
    """Sensitivities whose columns along a mask `free` are polynomials of the time, which are not integrated: those of
    states that drift, with the derivative `matrix` of `VectorField.drift`."""

    seeds: Array
    parameter_seeds: Array
    free: Array
    matrix: Array

    @property
    def others(self) -> tuple[Array, Array]:
        """The seeds of the columns that are integrated."""
        return self.seeds[:, ~self.free], self.parameter_seeds[:, ~self.free]

    def joined(self, motions: Trajectories, variations: Array) -> tuple[Trajectories, Array]:
        """Motions and the derivatives of their ends with all columns."""
        assert motions.variations is not None
        return replace(motions, variations=self._at(motions.starts, motions.variations)), self._at(
            motions.ends, variations
        )

    def _at(self, times: Array, others: Array) -> Array:
        """All columns (m, n, columns) at times (m,)."""
        found, term, factor = np.zeros((len(times), *self.seeds.shape)), self.seeds[:, self.free], np.ones(len(times))
        found[:, :, ~self.free] = others
        order = 0
        while term.any():
            found[:, :, self.free] += factor[:, None, None] * term
            order += 1
            factor, term = factor * times / order, self.matrix @ term
        return found


class Flow:
    """The flow map of one phase; `parameters` names the entries of the parameter vectors (np,) that it takes.

    The data (np + nq,) of a piecewise field are the parameters followed by the nq values of the smooth piece that the
    state is on. `control` bounds the steps of all motions.
    """

    control = FLOW_CONTROL

    def __init__(self, phase: Phase, parameters: tuple[str, ...]):
        self.phase, self.parameters = phase, tuple(parameters)
        self.size, self.names = len(phase.states), (*phase.states, *phase.watch)
        self.steppers: dict[tuple, TaylorStepper | RungeKuttaStepper] = {}
        self._last_form: tuple[tuple[float, ...], Modes] | None = None

    def run(
        self,
        start: ArrayLike,
        p: ArrayLike,
        duration: float = np.inf,
        seeds: Array | None = None,
        parameter_seeds: Array | None = None,
        stop: StopTest | None = None,
    ) -> tuple[Trajectory, Array]:
        """The motion from `start` (n,) for a `duration`, or until `stop` ends it.

        p : parameter vector (np,)
        seeds : derivatives (n, columns) of the start with respect to whatever the caller varies
        parameter_seeds : derivatives (np, columns) of the parameters with respect to the same
        stop : (coefficients (m, rows, K + 1), steps (m,)) -> (step, time in it) to stop at, or None

        Returns the motion and the derivatives (n, columns) of its end at fixed duration, without columns where there
        are no seeds. Raises `FlowError` when the motion blows up, leaves the range of a piecewise field or is not a
        number.
        """
        x, p = np.array(start, dtype=float), np.asarray(p, dtype=float)
        if not (np.isfinite(x).all() and np.isfinite(p).all() and duration > 0):
            text, place = "the {name} cannot start from {place} for a time {time:g}", described(self.phase.states, x)
            raise FlowError(Message(text, name=self.phase.name, place=place, time=Quantity(duration, TIME)))
        if self.phase.closed_form and (parameter_seeds is None or not parameter_seeds.any()):
            return self._run_in_closed_form(x, p, duration, seeds, stop)
        return self._integrate(x, p, duration, seeds, parameter_seeds, stop)

    def run_all(
        self, starts: Array, ps: Array, durations: Array, seeds: Array, parameter_seeds: Array
    ) -> tuple[Trajectories, Array]:
        """`run` of several motions with sensitivities, from states (m, n) with parameters (m, np) for times (m,).

        All have the same seeds (n, columns) and parameter seeds (np, columns), or (m, n, columns) and (m, np, columns)
        are those of each. Returns the motions and the derivatives (m, n, columns) of their ends. Raises the `FlowError`
        of the first that cannot be followed.
        """
        if self.shared is not None:
            flow, used = self.shared
            return flow.run_all(starts, ps[:, used], durations, seeds, parameter_seeds[..., used, :])
        if (drift := self._drift_along(seeds, parameter_seeds)) is not None:
            return drift.joined(*self.run_all(starts, ps, durations, *drift.others))
        if not self._is_together(seeds, parameter_seeds):
            return self._run_each(starts, ps, durations, seeds, parameter_seeds)
        done, motions, variations = self._run_together(starts, ps, durations, seeds, parameter_seeds)
        if motions is None or not done.all():
            return self._run_each(starts, ps, durations, seeds, parameter_seeds, broken=(~done).nonzero()[0].tolist())
        return motions, variations

    def run_lanes(
        self, starts: Array, ps: Array, durations: Array, seeds: Array, parameter_seeds: Array
    ) -> tuple[Array, Trajectories | None, Array]:
        """`run_all` of those motions that can be followed: their indices (k,), the motions, None without any, and the
        derivatives (k, n, columns) of their ends."""
        if self.shared is not None:
            flow, used = self.shared
            return flow.run_lanes(starts, ps[:, used], durations, seeds, parameter_seeds[..., used, :])
        if (drift := self._drift_along(seeds, parameter_seeds)) is not None:
            which, motions, variations = self.run_lanes(starts, ps, durations, *drift.others)
            return which, *((motions, variations) if motions is None else drift.joined(motions, variations))
        if len(starts) and self._is_together(seeds, parameter_seeds):
            done, motions, variations = self._run_together(starts, ps, durations, seeds, parameter_seeds)
            return np.flatnonzero(done), motions, variations
        found = dict[int, tuple[Trajectory, Array]]()
        for i, one in enumerate(zip(starts, ps, durations.tolist(), strict=True)):
            with suppress(FlowError):
                found[i] = self.run(*one, seeds, parameter_seeds)
        paths, ends = [path for path, _ in found.values()], [variations for _, variations in found.values()]
        return np.array([*found], int), Trajectories.of(paths) if paths else None, np.array(ends)

    @cached_property
    def shared(self) -> "tuple[Flow, list[int]] | None":
        """Where the steps are long, the flow with those parameters alone that the field depends on, for many motions of
        all flows of the phase, so that the steps are compiled once; and the places of these parameters."""
        phase, graph = self.phase, self.vector_field
        if phase.closed_form or not graph.in_loops:
            return None
        used = sorted({*chain(*(graph.field.jac_sparsity(i, 1).get_triplet()[1] for i in (0, 1)))})
        names = tuple(self.parameters[i] for i in used)
        if names == self.parameters:
            return None
        flow = flow_of(phase, names)
        try:
            flow.vector_field  # noqa: B018
        except KeyError:  # the field names parameters that cancel in it
            return None
        return flow, used

    def _drift_along(self, seeds: Array, parameter_seeds: Array) -> "_Drift | None":
        """The columns of common seeds along which states drift alone, None without any."""
        if self.vector_field.drift is None or self.phase.closed_form or seeds.ndim > 2 or parameter_seeds.ndim > 2:
            return None
        drifting, matrix = self.vector_field.drift
        free = ~(seeds[~drifting].any(0) | parameter_seeds.any(0))
        return _Drift(seeds, parameter_seeds, free, matrix) if free.any() and not free.all() else None

    def expect(self, steps: int, seeds: Array, parameter_seeds: Array) -> None:
        """Compile now what is worth it for this number of steps with such sensitivities."""
        if self.shared is not None:
            flow, used = self.shared
            flow.expect(steps, seeds, parameter_seeds[..., used, :])
            return
        if (drift := self._drift_along(seeds, parameter_seeds)) is not None:
            seeds, parameter_seeds = drift.others
        stepper = self.stepper(seeds.shape[-1], self.varied(parameter_seeds))
        if isinstance(stepper, TaylorStepper):
            stepper.kernel.expect(steps)

    def _is_together(self, seeds: Array, parameter_seeds: Array) -> bool:
        """Whether motions with these seeds are integrated together."""
        stepper = self.stepper(seeds.shape[-1], self.varied(parameter_seeds))
        return isinstance(stepper, TaylorStepper) and not (self.phase.closed_form and not parameter_seeds.any())

    def _run_together(self, starts, ps, durations, seeds, parameter_seeds) -> tuple[Array, Trajectories | None, Array]:
        """Whether each of the motions (m,) can be followed, those that can, None without any, and the derivatives of
        their ends."""
        stepper = self.stepper(seeds.shape[-1], self.varied(parameter_seeds))
        assert isinstance(stepper, TaylorStepper)
        on = self.on_pieces(starts, ps, parameter_seeds)
        found = stepper.advance_all(starts, ps, durations, seeds, parameter_seeds, self.control.max_block, on)
        c, counts, variations = found.coefficients, found.counts, found.variations
        begins, before = begins_of_steps(found.steps, counts), found.begins
        vanishing = found.steps <= self.control.shortest_step * np.maximum(begins, 1.0)
        done = (found.left == 0) & (durations > 0) & (np.abs(found.ends).max(1) <= self.control.runaway)
        if vanishing.any() or not done.all():
            owner = np.repeat(np.arange(len(done)), counts)
            done[owner[vanishing]] = False
            c, begins, before = (each[done[owner]] for each in (c, begins, before))
            counts, durations, variations = counts[done], durations[done], variations[done]
        motions = Trajectories(begins, durations, c, counts, self.names, before) if done.any() else None
        return done, motions, variations

    def _run_each(self, starts, ps, durations, *seeds, broken=()) -> tuple[Trajectories, Array]:
        """`run_all` of one motion after the other, those with indices `broken` first, which seem to be like that."""
        own = [each if each.ndim > 2 else [each] * len(starts) for each in seeds]
        each, found = list(zip(starts, ps, durations.tolist(), *own, strict=True)), {}
        for i in (*broken, *range(len(each))):
            found[i] = self.run(*each[i])
        motions, variations = zip(*(found[i] for i in range(len(each))), strict=True)
        return Trajectories.of(motions), np.array(variations)

    def _run_in_closed_form(self, start, p, duration: float, seeds, stop: StopTest | None):
        """Polynomials of the exact flow, each from the exact state at its start, so that no error accumulates."""
        form, control = self.closed_form(p), self.control
        step = 1.0 / np.sqrt(form.square)  # The series has long converged at this step.
        count = int(np.clip(np.ceil(duration / step * (1 - STEP_ROUNDING)), 1, control.max_steps))
        blocks, halt, end, first = [], None, duration, 0
        while first < count:
            interrupts.heed()
            # The further a motion has come, the more steps are searched in one call.
            block = min(max(first, control.look_ahead), LARGEST_BLOCK) if stop else count
            times = step * np.arange(first, first := min(first + block, count))
            c = form.series(start, times, TAYLOR_ORDER)
            if stop and (halt := stop(c, np.minimum(step, duration - times))):
                c, end = c[: halt[0] + 1], times[halt[0]] + halt[1]
            blocks.append(c)
            if form.pushed and not np.abs(c[..., 0]).max() <= control.runaway:
                raise RunsAway(self.failure("runs away", times[-1], c[-1, : self.size, 0]))
            if halt:
                break
        if not halt and count * step < duration * (1 - STEP_ROUNDING):
            text = "the {name} takes too many steps, at {place}"
            raise FlowError(Message(text, name=self.phase.name, place=described(self.phase.states, start)))
        c = np.concatenate(blocks)
        variations = np.zeros((self.size, 0)) if seeds is None else form.transition(end) @ seeds
        return Trajectory(np.append(step * np.arange(len(c)), end), c, (*self.phase.states, *form.watch)), variations

    def _integrate(self, x, p, duration, seeds, parameter_seeds, stop):
        variations = np.zeros((len(x), 0)) if seeds is None else seeds
        columns = variations.shape[1]
        moving = np.zeros((len(p), columns)) if parameter_seeds is None else parameter_seeds
        stepper = self.stepper(columns, self.varied(moving))
        motion: TaylorMotion | RungeKuttaMotion = (
            TaylorMotion(self, stepper, p, moving, x, variations, self.on_pieces(x[None], p[None], moving))
            if isinstance(stepper, TaylorStepper)
            else RungeKuttaMotion(self, stepper, p, moving, x, variations)
        )
        coefficients, begins, times, h, taken = [], [], [0.0], None, 0
        block = self.control.look_ahead if stop else self.control.max_block
        while times[-1] < duration:
            interrupts.heed()
            left = duration - times[-1]
            found = motion.advance(block, left)
            steps, c = self._accepted_steps(found.steps, found.coefficients, times[-1], taken)
            lengths, stopped = self._block_end(c, steps, left, stop)
            times.extend((times[-1] + lengths.cumsum()).tolist())
            coefficients.append(c[: (count := len(lengths))])
            begins.append(found.begins[:count])
            taken += count
            motion = motion.after(found, count, lengths[-1])
            h = steps[count - 1]
            if np.abs(motion.x).max() > self.control.runaway:
                kind = RunsAway if h > self.control.singular_step else BreaksDown
                raise kind(self.failure("runs away", times[-1], motion.x))
            if stopped:
                break
            if duration - times[-1] < SAME_TIME * max(duration, 1.0):
                times[-1] = duration
        with_variations = np.concatenate(begins) if columns else None
        return Trajectory(np.array(times), np.concatenate(coefficients), self.names, with_variations), motion.variations

    def _accepted_steps(self, steps, c, t: float, taken: int) -> tuple[Array, Array]:
        """The leading steps that are numbers and not vanishing; raises `FlowError` when there is none."""
        accepted = (steps > self.control.shortest_step * max(t, 1.0)) & np.isfinite(c).all((1, 2))
        if not accepted[0] or taken > self.control.max_steps:
            reason, kind = ("takes too many steps", FlowError) if accepted[0] else ("breaks down", BreaksDown)
            raise kind(self.failure(reason, t, c[0, :, 0]))
        count = len(steps) if accepted.all() else int(np.argmin(accepted))
        return steps[:count], c[:count]

    def _block_end(self, c, steps, left: float, stop: StopTest | None) -> tuple[Array, bool]:
        """The lengths of the steps of a block up to its end, and whether the motion stops there."""
        lengths, reached, almost = steps.copy(), steps.cumsum(), left * (1 - self.control.rounding)
        if reached[-1] >= almost:
            count = int((reached >= almost).argmax()) + 1
            lengths = lengths[:count]
            lengths[-1] = left - (reached[count - 2] if count > 1 else 0.0)
        if stop and (halt := stop(c[: len(lengths)], lengths)):
            lengths = lengths[: halt[0] + 1]
            lengths[-1] = halt[1]
            return lengths, True
        return lengths, False

    def failure(self, what: str, t: float, x: Array) -> Message:
        """The message about what happens to a motion in a state at a time."""
        known = {"name": self.phase.name, "what": what, "time": Quantity(t, TIME)}
        if not np.isfinite(x).all():
            text = "the {name} {what} at time {time:.6g}, where a law or the motion is no number"
            return Message(text, **known)
        text = "the {name} {what} at time {time:.6g}, at {place}"
        return Message(text, **known, place=described(self.phase.states, x))

    @cached_property
    def vector_field(self) -> VectorField:
        """The expression graph of the field; its parameters are followed by the data of a piece."""
        count = self.phase.pieces.size if self.phase.pieces else 0
        x, p = ca.SX.sym("x", self.size), ca.SX.sym("p", len(self.parameters) + count)
        arguments = self.symbols(x, p)
        rates = ca.vertcat(*self.phase.field(*arguments))
        watched = ca.SX(ca.vertcat(*[quantity(*arguments) for quantity in self.phase.watch.values()]))
        field, pieces = ca.Function("field", [x, p], ca.cse([rates, watched])), self.phase.pieces
        if pieces is None:
            return VectorField(field, x, p, self.phase.reaches)
        unit, origin = (ca.SX(function(arguments[1])) for function in (pieces.unit, pieces.origin))
        return VectorField(field, x, p, self.phase.reaches, pieces.coordinate, unit, origin, count)

    def symbols(self, x: ca.SX, p: ca.SX) -> tuple[list, dict, list]:
        """The arguments (x, p, q) of a phase's expressions from vectors of states and of parameters with piece data."""
        entries, named = ca.vertsplit(p), len(self.parameters)
        return ca.vertsplit(x), dict(zip(self.parameters, entries[:named], strict=True)), entries[named:]

    def closed_form(self, p: Array) -> Modes:
        """The exact flow at parameters (np,); that of the latest parameters is stored."""
        assert self.phase.closed_form is not None
        values, last = tuple(p), self._last_form
        if last is None or last[0] != values:
            last = self._last_form = values, self.phase.closed_form(dict(zip(self.parameters, p, strict=True)))
        return last[1]

    @cached_property
    def method(self) -> str:
        """'closed form', 'Taylor' or 'Runge-Kutta'."""
        if self.phase.closed_form:
            return "closed form"
        return "Taylor" if self.vector_field.has_series else "Runge-Kutta"

    @cached_property
    def is_smooth(self) -> bool:
        """Whether the field has all derivatives everywhere."""
        return self.vector_field.has_series and self.phase.pieces is None

    @property
    def in_lanes(self) -> bool:
        """Whether many motions are integrated together, as Taylor series."""
        return self.vector_field.has_series

    @property
    def compiled(self) -> bool:
        """Whether motions take their steps in machine code."""
        steppers = [*self.steppers.values(), *(self.shared[0].steppers.values() if self.shared else ())]
        return any(isinstance(stepper, TaylorStepper) and stepper.compiled for stepper in steppers)

    def stepper(self, columns: int, varied: tuple[int, ...] = ()) -> TaylorStepper | RungeKuttaStepper:
        """The stepper for `columns` sensitivities, built on first use; only the rows `varied` of the seeds of
        parameters and data of a piece are not zero."""
        if (columns, varied) not in self.steppers:
            form = TaylorStepper if self.vector_field.has_series else RungeKuttaStepper
            self.steppers[columns, varied] = form(self.vector_field, columns, varied)
        return self.steppers[columns, varied]

    def rates(self, x: ArrayLike, p: ArrayLike) -> Array:
        """The field at one state (n,), with parameters and piece data (np + nq,)."""
        return self._rates(x, p)[0].ravel()

    @cached_property
    def _rates(self) -> BufferedFunction:
        x, p = self.vector_field.x, self.vector_field.p
        return BufferedFunction(ca.Function("rates", [x, p], [ca.densify(self.vector_field.field(x, p)[0])]))

    def field(self, xs: Array, p: Array) -> list[Array]:
        """Rates (m, n) and watched quantities (m, k) at states (m, n) with parameters (m, np), or (np,) of them all."""
        return self.fields(xs, self.data(xs, p))

    @cached_property
    def fields(self) -> ElementwiseFunction:
        """The field at several points, (x, parameters with the data of a piece) -> rates, watched quantities."""
        return ElementwiseFunction(self.vector_field.field)

    def data(self, xs: Array, p: Array) -> Array:
        """Parameters (m, np), or (np,) of all, with the data of the piece of each state (m, n): (m, np + nq), without
        pieces (1, np) for those of all."""
        ps = np.atleast_2d(p)
        if self.phase.pieces is None:
            return ps
        return np.hstack([np.broadcast_to(ps, (len(xs), ps.shape[1])), self.data_of_pieces(xs, ps)])

    def piece_data(self, xs: Array, ps: Array) -> tuple[Array, Array]:
        """Data (m, nq) of the pieces at states (m, n) with parameters (m, np) or (1, np), and the derivatives
        (m, nq, np)."""
        values = self.data_of_pieces(xs, ps)
        if self.phase.pieces is None or not self._piece_parameters:
            return values, np.zeros((*values.shape, ps.shape[1]))
        (breaks, data), slopes = self._pieces_at(ps), self._slopes_at(ps)
        slopes = slopes[:, breaks.shape[1] :].reshape(len(slopes), *data.shape[1:], -1)
        return values, slopes[np.arange(len(xs)) if len(slopes) > 1 else 0, self.piece(xs, ps, breaks)]

    def data_of_pieces(self, xs: Array, ps: Array) -> Array:
        """Data (m, nq) of the pieces at states (m, n) with parameters (m, np) or (1, np)."""
        if self.phase.pieces is None:
            return np.zeros((len(xs), 0))
        breaks, data = self._pieces_at(ps)
        return data[np.arange(len(xs)) if len(data) > 1 else 0, self.piece(xs, ps, breaks)]

    def mesh_data(self, motions: Trajectories, ps: Array) -> Array:
        """Parameters (m, np) with the data of the piece that each step of motions lies in, (N, np + nq)."""
        own = ps[motions.owner]
        if self.phase.pieces is None:
            return own
        return np.hstack([own, self.data_of_pieces(self._middles(motions), own)])

    def mesh_pieces(self, path: Trajectory, p: Array) -> Array:
        """Index (N,) of the piece that each step of a motion lies in."""
        return self.pieces_of(self._middles(Trajectories.of([path])), p[None])

    def _middles(self, motions: Trajectories) -> Array:
        """The states (N, n) in the middle of each step."""
        return evaluate(motions.coefficients[:, : self.size], 0.5 * motions.steps[:, None])

    def pieces_of(self, xs: Array, ps: Array) -> Array:
        """Indices (m,) of the pieces that contain states (m, n) with parameters (m, np)."""
        return self.piece(xs, ps, self._pieces_at(ps)[0])

    def piece(self, xs: Array, ps: Array, breaks: Array) -> Array:
        """Indices (m,) of the pieces between breaks (m, k + 1) or (1, k + 1) that contain states (m, n)."""
        return np.clip((breaks <= self._places(xs, ps)[:, None]).sum(1) - 1, 0, breaks.shape[1] - 2)

    def _places(self, xs: Array, ps: Array) -> Array:
        """The coordinates (m,) of states (m, n) that are compared with breakpoints."""
        assert self.phase.pieces is not None
        return self.phase.pieces.place(xs, dict(zip(self.parameters, ps.T, strict=True)))

    @cached_property
    def coordinate(self) -> Array:
        """Weights (n,) of the coordinate whose breakpoints bound the pieces."""
        assert self.phase.pieces is not None
        return np.array(self.phase.pieces.coordinate)

    def piece_table(self, p: Array) -> tuple[Array, Array, Array]:
        """Breaks (m + 1,), data (m, nq) and its derivatives (m, nq, np) at parameters (np,)."""
        (breaks,), (data,) = self._pieces_at(p[None])
        assert self.phase.pieces is not None
        levels = self.phase.pieces.levels(breaks, dict(zip(self.parameters, p.tolist(), strict=True)))
        return levels, data, self._slopes_at(p[None])[0, len(breaks) :].reshape(*data.shape, len(p))

    def _pieces_at(self, ps: Array) -> tuple[Array, Array]:
        """Breaks (m, k + 1) and data (m, k, nq) at parameters (m, np), for m = 1 where they are the same for all."""
        breaks, data = self._piece_function(self._different(ps))
        return breaks[:, :, 0], data

    def _slopes_at(self, ps: Array) -> Array:
        """The derivatives (m, k + 1 + k nq, np) of breaks and data, one row of the data after the other."""
        return self._piece_slopes(self._different(ps))[0]

    def _different(self, ps: Array) -> Array:
        """The parameters (m, np), for m = 1 where they make the same table."""
        own = self._piece_parameters
        return ps[:1] if (ps[:, own] == ps[0, own]).all() else ps

    @cached_property
    def _piece_function(self) -> MappedFunction:
        """Parameters -> breaks (k + 1,) and data (k, nq)."""
        pieces, p = self.phase.pieces, ca.SX.sym("p", len(self.parameters))
        assert pieces is not None
        breaks, rows = pieces.table(self.symbols(ca.SX(0, 1), p)[1])
        data = ca.vertcat(*[ca.horzcat(*row) for row in rows]) if pieces.size else ca.SX(len(rows), 0)
        return MappedFunction(ca.Function("pieces", [p], [ca.densify(ca.vertcat(*breaks)), ca.densify(data)]))

    @cached_property
    def _piece_slopes(self) -> MappedFunction:
        """Parameters -> the derivatives of breaks and data."""
        p = ca.SX.sym("p", len(self.parameters))
        breaks, data = self._piece_function.function(p)
        slopes = ca.jacobian(ca.vertcat(breaks, ca.vec(data.T)), p)
        return MappedFunction(ca.Function("slopes", [p], [ca.densify(slopes)]))

    @property
    def _piece_parameters(self) -> list[int]:
        """The places of the parameters that the table of pieces depends on."""
        return parameters_of(self._piece_function)

    @cached_property
    def breaks(self) -> int:
        """The number of breakpoints, those at the ends of the range included; 0 for a smooth field."""
        return self._piece_function.function.numel_out(0) if self.phase.pieces else 0

    def depends_on(self, name: str) -> bool:
        """Whether the table of pieces depends on a parameter."""
        return self.phase.pieces is not None and self.parameters.index(name) in self._piece_parameters

    def moves_with(self, name: str) -> bool:
        """Whether the field depends on a parameter, by its expression or by the table of its pieces."""
        rows, place = self.vector_field.field.jac_sparsity(0, 1).get_triplet()[1], self.parameters.index(name)
        return place in rows or self.depends_on(name)

    def varied(self, parameter_seeds: Array) -> tuple[int, ...]:
        """The rows of the seeds (..., np, columns) of parameters that are not zero, and those of the data of a piece if
        one of these parameters changes it."""
        rows = rows_used(parameter_seeds)
        if self.phase.pieces is None or not {*self._piece_parameters} & {*rows}:
            return rows
        count = len(self.parameters)
        return *rows, *range(count, count + self.phase.pieces.size)

    def on_pieces(self, starts: Array, ps: Array, parameter_seeds: Array | None = None) -> OnPieces | None:
        """The pieces that motions from states (m, n) with parameters (m, np) or (1, np) begin on, with the derivatives
        along seeds (np, columns) or (m, np, columns) of the parameters; None for a smooth field."""
        if self.phase.pieces is None:
            return None
        seeds = np.zeros((ps.shape[1], 0)) if parameter_seeds is None else parameter_seeds
        breaks, data = self._pieces_at(ps)
        rows = self._piece_rows(seeds.shape[-1], self.varied(seeds))
        moves = self._slopes_at(ps) @ seeds if rows.varied else np.zeros((1, 0, 0))
        return OnPieces(rows.tables(breaks, data, moves), self.first_pieces(starts, ps), breaks)

    def _piece_rows(self, columns: int, varied: tuple[int, ...] = ()) -> PieceRows:
        """The layout of the tables that the stepper for these sensitivities reads."""
        stepper = self.stepper(columns, varied)
        assert isinstance(stepper, TaylorStepper)
        return stepper.piece_rows

    def first_pieces(self, starts: Array, ps: Array) -> Array:
        """Numbers (m,) of the pieces on which motions from states (m, n) begin, from 1 on; 0, or one more than there
        are pieces, where there is none.

        From a breakpoint, up to rounding, a motion enters a piece by the rate of the coordinate or, where that
        vanishes, the rate of the rate.
        """
        (breaks, data), places = self._pieces_at(ps), self._places(starts, ps)[:, None]
        numbers = (breaks <= places).sum(1) - (breaks[:, -1:] == places)[:, 0]
        on = (same_place(breaks, places).any(1) & (numbers > 0) & (numbers < breaks.shape[1])).nonzero()[0]
        if len(on):
            xs, own = starts[on], ps[on] if len(ps) > 1 else np.tile(ps, (len(on), 1))
            with_data = np.hstack([own, data[on if len(data) > 1 else 0, numbers[on] - 1]])
            rates = self.fields(xs, with_data)[0]
            heading = rates @ self.coordinate
            turns = (self.fields(xs + rates, with_data)[0] - rates) @ self.coordinate
            heading = np.where(heading == 0, turns, heading)
            own = on if len(breaks) > 1 else 0
            numbers[on] += (heading > 0) & same_place(breaks[own, numbers[on]], places[on, 0])
            numbers[on] -= (heading < 0) & same_place(breaks[own, numbers[on] - 1], places[on, 0])
        return numbers.astype(float)

    def approach(self, x: Array, p: Array, index: int) -> tuple[Array, Array]:
        """The derivatives (n,) and (np,) of the distance from a breakpoint, by the state and by the parameters."""
        by_x, by_p = (each.ravel() for each in self._approach(x, p))
        return by_x, by_p - (self._slopes_at(p[None])[0, index] if self._piece_parameters else 0.0)

    @cached_property
    def _approach(self) -> BufferedFunction:
        graph = self.vector_field
        arguments = graph.place.sx_in()
        slopes = [ca.densify(ca.jacobian(graph.place(*arguments), each)) for each in arguments]
        return BufferedFunction(ca.Function("approach", arguments, slopes))

    def inside(self, on: OnPieces | None, numbers: Array) -> Array:
        """Which of the `numbers` (m,) are those of pieces."""
        if on is None:
            return np.ones(len(numbers), bool)
        return (numbers > 0) & (numbers < on.tables.shape[1] // self._piece_rows(0).width - 1)

    def jumps(self, p: Array) -> list[float]:
        """The breakpoints inside the range at which the field jumps, at parameters (np,), where the other coordinates
        and all speeds are 0."""
        if self.phase.pieces is None:
            return []
        levels, data, _ = self.piece_table(p)
        levels, weights = levels[1:-1], self.coordinate
        places, away = levels[:, None] * weights / (weights @ weights), SIDE_DISTANCE * (1 + np.abs(levels))[:, None]
        away = away * weights / (weights @ weights)
        sides = [
            self.fields(places + side * k * away, np.hstack([np.tile(p, (len(levels), 1)), rows]))[0]
            for side, rows in ((-1, data[:-1]), (1, data[1:]))
            for k in (1, 2)
        ]
        jump = np.abs(2 * (sides[2] - sides[0]) - (sides[3] - sides[1])).max(1)
        return levels[jump > LEAST_JUMP * (1 + np.abs(sides[0]).max(1))].tolist()

    def out_of_range(self, p: Array, x: Array) -> OutOfRange:
        """The error of a motion that leaves the range of its law at the state `x`."""
        breaks, pieces = self.piece_table(p)[0], self.phase.pieces
        assert pieces is not None
        text = f"the {{label}} {OUT_OF_LAW}, [{{low:.6g}}, {{high:.6g}}], at {{place:.6g}}"
        along = self.phase.states[int(np.flatnonzero(self.coordinate)[0])]
        low, high, place = (Quantity(float(number), along) for number in (breaks[0], breaks[-1], self.coordinate @ x))
        return OutOfRange(Message(text, label=pieces.label, low=low, high=high, place=place))
