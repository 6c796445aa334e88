"""The flow map of a phase with exact derivatives, as a piecewise polynomial that is accurate between its nodes.

Three ways, the first that the phase allows:

- closed form: the phase says what its flow is, nothing is integrated;
- Taylor: jets of the field's graph, order 28, steps from the last two coefficients (Jorba and Zou 2005);
- Runge-Kutta: Cooper and Verner's order 8 with step halving, where the graph has an operation without a Taylor series.

Steps are chosen from the error, never by the caller, and end on the breakpoints of a piecewise field.
"""

from collections.abc import Callable
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ..errors import BreaksDown, FlowError, OutOfRange, RunsAway
from ..model.phase import Affine, Phase
from ..numerics.bernstein import Crossings, PiecewisePolynomials, evaluate
from ..symbolic import interrupts
from ..symbolic.calls import BufferedFunction, ElementwiseFunction
from .breakpoints import ActivePiece, ActivePieces
from .taylor import SHORTEST_STEP, TAYLOR_ORDER, RungeKuttaStepper, TaylorStepper, VectorField
from .trajectory import Trajectories, Trajectory

MAX_STEPS = 200_000
# Beyond this a motion has run away.
RUNAWAY = 1e20
# ... for good, with steps longer than this, or into a singularity, where they vanish.
SUDDEN = 1e-3
# What is left of a time beyond this share of it is rounding.
ALMOST = 1 - 1e-14
# Steps taken in one call of the interpreter's: two such calls are most of an oscillation.
LOOK_AHEAD = 6
MOST_AT_ONCE = 64
# A motion in closed form is asked for zeros by steps in units of its time, whose series of this order has converged, so
# many at a time.
CLOSED_STEP, CLOSED_ORDER, CLOSED_BLOCK = 1.0, 18, 4


@lru_cache(maxsize=64)
def flow_of(phase: Phase, parameters: tuple[str, ...]) -> "Flow":
    """The flow of a phase, kept for the next call with the same phase."""
    return Flow(phase, parameters)


class Flow:
    """Flow map of one phase; `parameters` names the entries of the parameter vectors (np,) that it takes."""

    def __init__(self, phase: Phase, parameters: tuple[str, ...]):
        self.phase, self.parameters = phase, tuple(parameters)
        self.size = len(phase.states)
        self.names = (*phase.states, *phase.watch)
        self.steppers: dict[tuple, TaylorStepper | RungeKuttaStepper] = {}
        self.usual = LOOK_AHEAD  # steps of motions up to a zero, and one more

    @cached_property
    def vector_field(self) -> VectorField:
        """The field's expression graph; its parameters are followed by the data of a piece."""
        count = self.phase.pieces.size if self.phase.pieces else 0
        x, p = ca.SX.sym("x", self.size), ca.SX.sym("p", len(self.parameters) + count)
        arguments = self.symbols(x, p)
        rates = ca.vertcat(*self.phase.field(*arguments))
        watched = ca.vertcat(*[quantity(*arguments) for quantity in self.phase.watch.values()])
        return VectorField(ca.Function("field", [x, p], ca.cse([rates, watched])), x, p)

    def symbols(self, x: ca.SX, p: ca.SX) -> tuple[list, dict, list]:
        """The arguments (x, p, q) of a phase's expressions from vectors of states and of parameters with piece data."""
        entries = ca.vertsplit(p)
        named = dict(zip(self.parameters, entries, strict=False))
        return ca.vertsplit(x), named, entries[len(self.parameters) :]

    @cached_property
    def method(self) -> str:
        """'closed form', 'Taylor' or 'Runge-Kutta'."""
        if self.phase.closed_form:
            return "closed form"
        return "Taylor" if self.vector_field.has_series else "Runge-Kutta"

    @cached_property
    def smooth(self) -> bool:
        """Whether motions are Taylor series that no breakpoint ends, at least where parameters vary."""
        return self.vector_field.has_series and not self.phase.pieces

    @property
    def compiled(self) -> bool:
        """Whether stepping has taken long enough to be compiled."""
        return any(isinstance(stepper, TaylorStepper) and stepper.compiled for stepper in self.steppers.values())

    def stepper(self, columns: int, varied: tuple[int, ...] = ()):
        """The stepping scheme that carries so many sensitivities along, built on first use.

        varied : rows of the parameters, with the data of a piece, whose seeds are not zero
        """
        if (columns, varied) not in self.steppers:
            form = TaylorStepper if self.vector_field.has_series else RungeKuttaStepper
            self.steppers[columns, varied] = form(self.vector_field, columns, varied)
        return self.steppers[columns, varied]

    def run(self, start, p, duration=np.inf, seeds=None, parameter_seeds=None, stop: Callable | None = None):
        """Travel from `start` (n,) for `duration`, or until `stop` says so.

        p : parameter vector (np,)
        seeds : derivatives (n, columns) of the start with respect to whatever the caller varies
        parameter_seeds : derivatives (np, columns) of the parameters with respect to the same
        stop : (coefficients (m, rows, K + 1), steps (m,)) -> (step, time in it) to stop at, or None

        Returns (Trajectory, derivatives (n, columns) of the end at fixed duration, or None without seeds). Raises
        `FlowError` when the motion blows up, leaves the range of a piecewise field or is not a number.
        """
        x = np.array(start, dtype=float)
        p = np.asarray(p, dtype=float)
        if not (np.isfinite(x).all() and np.isfinite(p).all() and duration > 0):
            raise FlowError(f"the {self.phase.name} cannot start from {x} for a time {duration}")
        if self.phase.closed_form and (parameter_seeds is None or not parameter_seeds.any()):
            return self._closed_form(x, p, duration, seeds, stop)
        columns = 0 if seeds is None else seeds.shape[1]
        track = ActivePiece(self, p, x, columns, parameter_seeds)
        stepper = self.stepper(columns, track.varied())
        times, pieces, slopes, h, variations = [0.0], [], [], None, seeds
        while times[-1] < duration:
            interrupts.check()
            left = duration - times[-1]
            ahead = 1 if self.phase.pieces else LOOK_AHEAD if stop else _chunk(left, h) if h else stepper.usual
            steps, c, dc = stepper.advance(x, track.data, variations, track.seeds, ahead, left, h)
            steps, c = self._sound(steps, c, times[-1], len(pieces))
            count, cut, crossed, halted = self._cut(c, steps, left, track, stop)
            for i in range(count):
                t = times[-1]
                h = cut if i == count - 1 else steps[i]
                pieces.append(c[i])
                slopes.append(dc[i] if columns else None)
                times.append(t + h)
            power = h ** np.arange(1, c.shape[2])
            x = c[i, : self.size, 0] + c[i, : self.size, 1:] @ power
            if columns:
                variations = dc[i, ..., 0] + dc[i, ..., 1:] @ power
            h = steps[i]
            if np.abs(x).max() > RUNAWAY:
                kind = RunsAway if h > SUDDEN else BreaksDown
                raise kind(f"the {self.phase.name} runs away at time {times[-1]:.6g}, at {self._say(x)}")
            if halted:
                break
            if duration - times[-1] < 1e-15 * duration:
                times[-1] = duration
            if crossed:
                variations = track.enter(crossed, x, variations)
        if not stop:
            stepper.usual = min(len(pieces), MOST_AT_ONCE)
        moving = np.array(slopes) if columns else None
        return Trajectory(np.array(times), np.array(pieces), self.names, moving), variations

    def until_zero(self, starts, ps, quantity: Affine, skip_start: int = 0) -> tuple[np.ndarray, Trajectories | None]:
        """Motions from states (m, n) with parameters (m, np) up to the first sign change of an affine function of their
        rows, together: which of them (r,) take no more than `MOST_AT_ONCE` of Taylor's steps, and those; None when no
        motion does, or where there is a better way for one. As `first_zero` otherwise."""
        going, found = np.arange(len(starts)), []
        if (self.phase.closed_form and len(starts) == 1) or self.phase.pieces or not self.vector_field.has_series:
            going = going[:0]
        count = self.usual
        while len(going) and count <= MOST_AT_ONCE:
            steps, c, trusted = self.stepper(0).advance_all(starts[going], ps[going], count)
            trusted = np.logical_and.accumulate(trusted, axis=1)
            if not trusted.all():  # what follows a step that cannot be trusted starts where that one does
                steps, c = np.where(trusted, steps, 0.0), np.where(np.isfinite(c), c, 0.0)
            owner, piece, t = self._piled(quantity, c, steps).roots(skip_start)
            owner, first = np.unique(owner, return_index=True)
            reached = trusted[owner, piece[first]] & (steps[owner, piece[first]] > 0)
            owner, first = owner[reached], first[reached]
            piece, lengths = piece[first], np.cumsum(steps[owner], axis=1)
            begins = np.concatenate([np.zeros((len(owner), 1)), lengths[:, :-1]], axis=1)
            used = (np.arange(count) <= piece[:, None]) & (steps[owner] > 0)
            ends = begins[np.arange(len(owner)), piece] + t[first]
            if len(owner):
                found.append((going[owner], Trajectories(begins[used], ends, c[owner][used], used.sum(1), self.names)))
                self.usual = min(int(piece.max()) + 2, MOST_AT_ONCE) if len(starts) > 1 else self.usual
            trusted[owner] = False
            going, count = going[trusted.all(1)], 2 * count
        if len(found) < 2:
            return found[0] if found else (going[:0], None)
        which, motions = zip(*found, strict=True)
        order = np.argsort(np.concatenate(which))
        return np.concatenate(which)[order], Trajectories.joined(motions)[order]

    def first_zeros(self, starts, p, quantity: Affine, limit, skip=0, rising: bool = False, over=None):
        """When an affine function of the rows first changes its sign on motions from states (m, n), and where.

        p : parameters (np,) of all
        limit : times (m,) by which that must happen
        skip : orders (m,) of the zeros that it starts from, which are divided out exactly
        rising : count only changes from minus to plus
        over : another affine function and a number: once that has changed its sign so often, what has not happened
            never will; only known of motions that are followed together, by Taylor's steps

        Returns times (m,), NaN where it does not happen and infinity where it never will; rows (m, rows) there; and by
        index the `FlowError` of each motion that cannot be carried on so far.
        """
        starts = np.asarray(starts, dtype=float)
        skip, limit = (np.broadcast_to(values, len(starts)) for values in (skip, limit))
        times = np.full(len(starts), np.nan)
        rows = np.full((len(starts), len(self.names)), np.nan)
        failed: dict[int, FlowError] = {}
        if self.phase.closed_form:
            self._closed_zeros(starts, p, quantity, limit, skip, rising, times, rows)
        elif not self.vector_field.has_series:
            began = np.zeros(len(starts))
            known = limit, skip, rising, began
            self._zeros_one_by_one(np.arange(len(starts)), starts, p, quantity, *known, times, rows, failed)
        else:
            self._taylor_zeros(starts, p, quantity, limit, skip, rising, over, times, rows, failed)
        return times, rows, failed

    def _closed_zeros(self, starts, p, quantity, limit, skip, rising, times, rows):
        """`first_zeros` of motions in closed form, into the arrays."""
        form = self.phase.closed_form(dict(zip(self.parameters, p, strict=True)))
        length, going, began = CLOSED_STEP / np.sqrt(form.square), np.arange(len(starts)), 0.0
        signs = np.zeros(len(starts))
        while len(going):
            interrupts.check()
            states = form.state(starts[going].T[:, :, None], began + length * np.arange(CLOSED_BLOCK))
            c = form.along(quantity.weights, states.reshape(len(states), -1), CLOSED_ORDER)
            c[:, 0] += quantity.offset
            counts = np.full(len(going), CLOSED_BLOCK)
            pile = PiecewisePolynomials(c, np.full(len(c), length), counts)
            owner, piece, t = pile.roots(skip[going] if began == 0 else 0, rising, signs[going])
            signs[going] = pile.after
            owner, first = np.unique(owner, return_index=True)
            found = began + length * piece[first] + t[first]
            hits = going[owner]
            times[hits] = np.where(found <= limit[hits], found, np.nan)
            rows[hits, : self.size] = form.state(starts[hits].T, found).T
            going, began = np.delete(going, owner), began + CLOSED_BLOCK * length
            going = going[began < limit[going]]
        for i, (slope, value) in enumerate(form.watch.values(), start=self.size):
            rows[:, i] = slope * rows[:, 0] + value

    def _taylor_zeros(self, starts, p, quantity, limit, skip, rising, over, times, rows, failed):
        """`first_zeros` of motions by Taylor steps, into the arrays and `failed`."""
        going, x, began = np.arange(len(starts)), starts, np.zeros(len(starts))
        changes, signs, tracks = np.zeros(len(starts), int), np.zeros((2, len(starts))), ActivePieces(self, p, starts)
        for _ in range(MAX_STEPS):
            for i in np.flatnonzero(~tracks.inside):
                failed[int(going[i])] = OutOfRange(tracks.outside(x[i]))
            going, x, began = (part[tracks.inside] for part in (going, x, began))
            tracks.keep(tracks.inside)
            if not len(going):
                return
            interrupts.check()
            steps, c, trusted = self.stepper(0).advance_all(x, tracks.data, 1 if self.phase.pieces else LOOK_AHEAD)
            steps = tracks.cut(c, steps)
            last = evaluate(c[:, -1, : self.size], steps[:, -1:])
            # A zero to be left out stands before the first step that has a length.
            plain = steps.any(1) & ((steps[:, 0] > 0) | (began > 0) | (skip[going] == 0))
            slow = ~(plain & trusted.all(1) & (np.abs(last).max(1) < RUNAWAY))
            if slow.any():
                skipped = np.where(began[slow] == 0, skip[going[slow]], 0)
                known = limit[going[slow]], skipped, rising, began[slow]
                self._zeros_one_by_one(going[slow], x[slow], p, quantity, *known, times, rows, failed)
                going, last, began, steps, c = (part[~slow] for part in (going, last, began, steps, c))
                tracks.keep(~slow)
                if not len(going):
                    return
            pile = self._piled(quantity, c, steps)
            owner, piece, t = pile.roots(np.where(began == 0, skip[going], 0), rising, signs[0, going])
            signs[0, going] = pile.after
            owner, first = np.unique(owner, return_index=True)
            piece, t = piece[first], t[first]
            ends = np.cumsum(steps, axis=1)
            found = began[owner] + np.where(piece > 0, ends[owner, piece - 1], 0.0) + t
            times[going[owner]] = np.where(found <= limit[going[owner]], found, np.nan)
            rows[going[owner]] = evaluate(c[owner, piece], t[:, None])
            began = began + ends[:, -1]
            left = began < limit[going]
            left[owner] = False
            if over:
                pile = self._piled(over[0], c, steps)
                changes[going] += np.bincount(pile.roots(before=signs[1, going])[0], minlength=len(going))
                signs[1, going] = pile.after
                never = left & (changes[going] >= over[1])
                times[going[never]], left[never] = np.inf, False
            going, x, began = going[left], last[left], began[left]
            tracks.enter(left)
        for i in going:
            failed[int(i)] = FlowError(f"the {self.phase.name} takes too many steps")

    @staticmethod
    def _piled(quantity: Affine, c, steps) -> PiecewisePolynomials:
        """An affine function of the rows of several motions of as many steps each, (m, count, rows, K + 1)."""
        series = quantity.series(c[:, :, : len(quantity.weights)]).reshape(-1, c.shape[3])
        return PiecewisePolynomials(series, steps.ravel(), np.full(len(steps), steps.shape[1]))

    def _zeros_one_by_one(self, indices, x, p, quantity, limit, skip, rising, began, times, rows, failed):
        """`first_zeros` of some motions, which have lasted for the times `began`, step by step, into the arrays and
        `failed`."""
        for index, start, end, order, before in zip(indices, x, limit, skip, began, strict=True):
            try:
                path, _ = self.run(start, p, end - before, stop=first_zero(quantity, int(order), rising))
            except FlowError as error:
                failed[int(index)] = error
                continue
            if path.times[-1] < end - before:
                times[index], rows[index] = before + path.times[-1], path.end

    def _sound(self, steps, c, t: float, taken: int):
        """The leading steps that are numbers and not vanishing; raises `FlowError` when there is none."""
        good = (steps > SHORTEST_STEP * max(t, 1.0)) & np.isfinite(c).all((1, 2))
        if not good[0] or taken > MAX_STEPS:
            reason, kind = ("takes too many steps", FlowError) if good[0] else ("breaks down", BreaksDown)
            raise kind(f"the {self.phase.name} {reason} at time {t:.6g}, at {self._say(c[0, :, 0])}")
        count = len(steps) if good.all() else int(np.argmin(good))
        return steps[:count], c[:count]

    @staticmethod
    def _cut(c, steps, left: float, track: ActivePiece, stop):
        """How many steps to take, the length of the last, the end of a piece crossed there, and whether to stop."""
        count, cut, crossed, halted = len(steps), steps[-1], 0, False
        reached = np.cumsum(steps)
        if reached[-1] >= left * ALMOST:
            count = int(np.argmax(reached >= left * ALMOST)) + 1
            cut = left - (reached[count - 2] if count > 1 else 0.0)
        if track.pieces:
            cut, crossed = track.cut(c[0], cut)
        if stop:
            lengths = np.append(steps[: count - 1], cut)
            if halt := stop(c[:count], lengths):
                count, cut, crossed, halted = halt[0] + 1, halt[1], 0, True
        return count, cut, crossed, halted

    def _closed_form(self, start, p, duration, seeds, stop):
        """Polynomials of the exact flow, each from the exact state at its start: no error accumulates."""
        form = self.phase.closed_form(dict(zip(self.parameters, p, strict=True)))
        step = 1.0 / np.sqrt(form.square)  # where the series to ORDER has long converged
        count = int(np.clip(np.ceil(duration / step * (1 - 1e-12)), 1, MAX_STEPS))
        blocks, halt, end = [], None, duration
        for first in range(0, count, LOOK_AHEAD if stop else count):
            interrupts.check()
            times = step * np.arange(first, min(first + LOOK_AHEAD, count) if stop else count)
            c = form.series(form.state(start, times), TAYLOR_ORDER)
            if stop and (halt := stop(c, np.minimum(step, duration - times))):
                c, end = c[: halt[0] + 1], times[halt[0]] + halt[1]
            blocks.append(c)
            if halt:
                break
        if not halt and count * step < duration * (1 - 1e-12):
            raise FlowError(f"the {self.phase.name} takes too many steps, at {self._say(start)}")
        c = np.concatenate(blocks)
        times = np.append(step * np.arange(len(c)), end)
        variations = None if seeds is None else form.transition(end) @ seeds
        return Trajectory(times, c, (*self.phase.states, *form.watch)), variations

    def _say(self, x) -> str:
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.phase.states, x, strict=False))

    def rates(self, x, p) -> np.ndarray:
        """The field at one state (n,), with parameters and piece data (np + nq,)."""
        return self._rates(x, p)[0].ravel()

    @cached_property
    def _rates(self) -> BufferedFunction:
        x, p = self.vector_field.x, self.vector_field.p
        return BufferedFunction(ca.Function("rates", [x, p], [ca.densify(self.vector_field.field(x, p)[0])]))

    def field(self, xs, p) -> tuple[np.ndarray, np.ndarray]:
        """Rates (m, n) and watched quantities (m, k) at states (m, n), with parameters (np,) of all."""
        return tuple(self.fields(xs, self.data(xs, p)))

    def data(self, xs, p) -> np.ndarray:
        """Parameters with the data of the piece of each state (m, n): (m, np + nq), or (1, np) where there are none."""
        if self.phase.pieces is None:
            return np.reshape(p, (1, -1))
        return np.array([[*p, *self.piece_data(x, p)[0]] for x in xs])

    @cached_property
    def fields(self) -> ElementwiseFunction:
        """The field at several points, (x, parameters with the data of a piece) -> rates, watched quantities."""
        return ElementwiseFunction(self.vector_field.field)

    def piece_data(self, x, p) -> tuple[np.ndarray, np.ndarray]:
        """Data (nq,) of the piece at state `x` and its derivatives (nq, np)."""
        if self.phase.pieces is None:
            return np.zeros(0), np.zeros((0, len(p)))
        breaks, table, slopes = self.piece_table(p)
        index = self.piece(x, breaks)
        return table[index], slopes[index]

    def mesh_data(self, path: Trajectory, p) -> np.ndarray:
        """Parameters with the data of the piece that each step of a motion lies in, (np + nq, N)."""
        columns = np.tile(np.asarray(p, dtype=float)[:, None], len(path.steps))
        if self.phase.pieces is None:
            return columns
        breaks, table, _ = self.piece_table(p)
        return np.vstack([columns, table[self.mesh_pieces(path, breaks)].T])

    def data_of(self, motions: Trajectories, ps) -> np.ndarray:
        """`mesh_data` of several motions with parameters (m, np), transposed: (N, np + nq)."""
        if self.phase.pieces is None:
            return ps[motions.owner]
        return np.concatenate([self.mesh_data(path, p).T for path, p in zip(motions, ps, strict=True)])

    def mesh_pieces(self, path: Trajectory, breaks) -> np.ndarray:
        """Index (N,) of the piece that each step of a motion lies in."""
        middles = path(0.5 * (path.times[1:] + path.times[:-1]))[:, : self.size]
        return np.array([self.piece(x, breaks) for x in middles])

    def piece(self, x, breaks) -> int:
        """Index of the piece that holds state `x`."""
        place = float(np.array(self.phase.pieces.coordinate) @ x)
        return int(np.clip(np.searchsorted(breaks, place, "right") - 1, 0, len(breaks) - 2))

    def piece_table(self, p) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Breaks (m + 1,), data (m, nq) and its derivatives (m, nq, np) at parameters (np,)."""
        breaks, data, slopes = self._piece_function(p)
        return breaks.ravel(), data, slopes.reshape(data.shape[1], data.shape[0], len(p)).swapaxes(0, 1)

    @cached_property
    def _piece_function(self) -> BufferedFunction:
        p = ca.SX.sym("p", len(self.parameters))
        breaks, data = self.phase.pieces.table(dict(zip(self.parameters, ca.vertsplit(p), strict=True)))
        data = ca.vertcat(*[ca.horzcat(*row) for row in data]) if self.phase.pieces.size else ca.SX(len(data), 0)
        results = [ca.vertcat(*breaks), data, ca.jacobian(ca.vec(data), p)]
        return BufferedFunction(ca.Function("pieces", [p], [ca.densify(result) for result in results]))


def first_zero(quantity: Affine, skip_start: int = 0, rising: bool = False) -> Callable:
    """A `stop` at the first sign change of an affine function of the rows, or the first from minus to plus.

    `skip_start` is the order of a zero known to stand at the very start; it is divided out exactly there.
    """
    crossings = Crossings(skip_start, rising)

    def stop(coefficients, steps):
        found = crossings(quantity.series(coefficients[:, : len(quantity.weights)]), steps)
        return found[0] if found else None

    return stop


def _chunk(left: float, h: float) -> int:
    """How many steps to take at once: a power of two, about as many as are left."""
    return int(2 ** np.ceil(np.log2(np.clip(left / h, 1, LOOK_AHEAD))))
