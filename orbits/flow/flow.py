"""The flow map of a phase with exact derivatives, as a piecewise polynomial that is accurate throughout each step.

A phase may state its flow in closed form. Else Taylor series of order 28 are used or, where an operation of the field
has none, Runge-Kutta steps of order 8. The error alone controls the step size. Steps end on breakpoints of the field.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BreaksDown, FlowError, RunsAway
from ..model import Modes, Phase
from ..numerics import Array
from ..running import interrupts
from ..symbolic import cached
from ..units import TIME, Message, Quantity, described
from .phase_field import PhaseField
from .runge_kutta import RungeKuttaMotion, RungeKuttaStepper
from .taylor import OnPieces, TaylorMotion, TaylorStepper
from .taylor_step import PieceRows
from .trajectory import Trajectories, Trajectory, begins_of_steps
from .vector_field import FLOW_CONTROL, TAYLOR

# Shares of a duration that are rounding: of a remaining time in closed form, and of a difference of two times.


class ClosedFormOptions(NamedTuple):
    """Motions in closed form, in steps about whose beginnings they are expanded."""

    rounding: float = 1e-12  # share of a duration that is rounding
    largest_block: int = 4000  # steps that are searched in one call
    step: float = 1.0  # distance of the points of expansion, in units of the oscillation's 1 / frequency
    order: int = 18  # of expansions: the terms beyond are below rounding there, 1 / 19! = 8e-18
    block: int = 2  # expansions whose events are searched in one call
    # Steps after which the phase of the oscillation has fewer than four digits left: the motion is given up.
    most_steps: float = 1e12
    # Expansions before the end of a range without zeros, known to rounding, at which the search resumes.
    early: float = 0.01


CLOSED_FORM = ClosedFormOptions()
# (coefficients (m, rows, K + 1), steps (m,)) -> the step and the time in it at which to stop, None to go on.
StopTest = Callable[[Array, Array], tuple[int, float] | None]


@cached
def flow_of(phase: Phase, parameters: tuple[str, ...]) -> "Flow":
    """The flow of a phase, stored for the next call with the same phase."""
    return Flow(phase, parameters)


class _Drift(NamedTuple):
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


class Flow(PhaseField):
    """The flow map of one phase: the motions of its vector field.

    `control` bounds the steps of all motions.
    """

    control = FLOW_CONTROL

    def __init__(self, phase: Phase, parameters: tuple[str, ...]):
        super().__init__(phase, parameters)
        self.steppers: dict[tuple, TaylorStepper | RungeKuttaStepper] = {}
        self._last_form: tuple[tuple[float, ...], Modes] | None = None
        self._last_tables: tuple[Array, Array] | None = None  # the breaks of a table, and its `PieceRows`

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
        if (stepper := self._together(seeds, parameter_seeds)) is None:
            return self._run_each(starts, ps, durations, seeds, parameter_seeds)
        done, motions, variations = self._run_together(stepper, starts, ps, durations, seeds, parameter_seeds)
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
        if len(starts) and (stepper := self._together(seeds, parameter_seeds)):
            done, motions, variations = self._run_together(stepper, starts, ps, durations, seeds, parameter_seeds)
            return done.nonzero()[0], motions, variations
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
        if phase.closed_form or not graph.has_many_products:
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

    def _together(self, seeds: Array, parameter_seeds: Array) -> TaylorStepper | None:
        """The steps of motions with these seeds that are integrated together; None where they are not."""
        stepper, exact = self.stepper(seeds.shape[-1], varied := self.varied(parameter_seeds)), self.phase.closed_form
        return stepper if isinstance(stepper, TaylorStepper) and (varied or not exact) else None

    def _run_together(
        self, stepper: TaylorStepper, starts: Array, ps: Array, durations: Array, seeds: Array, parameter_seeds: Array
    ) -> tuple[Array, Trajectories | None, Array]:
        """Whether each of the motions (m,) can be followed in the steps of one call; the motions that can, None without
        any, and the derivatives of their ends."""
        on = self.on_pieces(starts, ps, parameter_seeds)
        found = stepper.advance_all(starts, ps, durations, seeds, parameter_seeds, self.control.together, on)
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
        count = int(np.clip(np.ceil(duration / step * (1 - CLOSED_FORM.rounding)), 1, control.max_steps))
        blocks, halt, end, first = [], None, duration, 0
        while first < count:
            interrupts.heed()
            # The further a motion has come, the more steps are searched in one call.
            block = min(max(first, control.look_ahead), CLOSED_FORM.largest_block) if stop else count
            times = step * np.arange(first, first := min(first + block, count))
            c = form.series(start, times, TAYLOR.order)
            if stop and (halt := stop(c, np.minimum(step, duration - times))):
                c, end = c[: halt[0] + 1], times[halt[0]] + halt[1]
            blocks.append(c)
            if form.pushed and not np.abs(c[..., 0]).max() <= control.runaway:
                raise RunsAway(self.failure("runs away", times[-1], c[-1, : self.size, 0]))
            if halt:
                break
        if not halt and count * step < duration * (1 - CLOSED_FORM.rounding):
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
            if duration - times[-1] < self.control.same_time * max(duration, 1.0):
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
            text = "the {name} {what} at time {time:.6g}, where a law or the motion is not finite"
            return Message(text, **known)
        text = "the {name} {what} at time {time:.6g}, at {place}"
        return Message(text, **known, place=described(self.phase.states, x))

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

    @property
    def in_lanes(self) -> bool:
        """Whether many motions are integrated together, as Taylor series."""
        return self.vector_field.has_series

    def stepper(self, columns: int, varied: tuple[int, ...] = ()) -> TaylorStepper | RungeKuttaStepper:
        """The stepper for `columns` sensitivities, built on first use; only the rows `varied` of the seeds of
        parameters and data of a piece are not zero."""
        if (columns, varied) not in self.steppers:
            form = TaylorStepper if self.vector_field.has_series else RungeKuttaStepper
            self.steppers[columns, varied] = form(self.vector_field, columns, varied)
        return self.steppers[columns, varied]

    def on_pieces(self, starts: Array, ps: Array, parameter_seeds: Array | None = None) -> OnPieces | None:
        """The pieces that motions from states (m, n) with parameters (m, np) or (1, np) begin on, with the derivatives
        along seeds (np, columns) or (m, np, columns) of the parameters; None for a smooth field."""
        if self.phase.pieces is None:
            return None
        seeds = np.zeros((ps.shape[1], 0)) if parameter_seeds is None else parameter_seeds
        breaks, data = self._pieces_at(ps)
        rows = self._piece_rows(seeds.shape[-1], self.varied(seeds))
        if rows.varied:
            tables = rows.tables(breaks, data, self._slopes_at(ps) @ seeds)
        elif self._last_tables is None or self._last_tables[0] is not breaks:
            tables = rows.tables(breaks, data, np.zeros((1, 0, 0)))
            self._last_tables = (breaks, tables) if len(breaks) == 1 else None
        else:
            tables = self._last_tables[1]
        return OnPieces(tables, self.first_pieces(starts, ps), breaks)

    def _piece_rows(self, columns: int, varied: tuple[int, ...] = ()) -> PieceRows:
        """The layout of the tables that the stepper for these sensitivities reads."""
        stepper = self.stepper(columns, varied)
        assert isinstance(stepper, TaylorStepper)
        return stepper.piece_rows

    def inside(self, on: OnPieces | None, numbers: Array) -> Array:
        """Which of the `numbers` (m,) are those of pieces."""
        if on is None:
            return np.ones(len(numbers), bool)
        return (numbers > 0) & (numbers < on.tables.shape[1] // self._piece_rows(0).width - 1)
