"""Zeros of affine functions of the state along one motion, and along many that are integrated together."""

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BreaksDown, FlowError, RunsAway
from ..model.phase import Affine
from ..numerics.polynomial_roots import Crossings, PiecewisePolynomials, evaluate
from ..numerics.roots import Array
from ..running import interrupts
from ..running.exclusive import apart
from .flow import Flow, StopTest
from .taylor import OnPieces, TaylorStepper, Watched
from .trajectory import Trajectories, begins_of_steps

# Closed forms are expanded about points this far apart, in units of the oscillation's 1 / frequency. The terms beyond
# this order are below rounding there, 1 / 19! = 8e-18. The last number is that of the expansions searched in one call.
CLOSED_STEP, CLOSED_ORDER, CLOSED_BLOCK = 1.0, 18, 2
# After this number of these steps the phase of the oscillation has fewer than four digits left: the motion is given up.
MOST_CLOSED_STEPS = 1e12
# The search resumes this number of expansions before the end of a range without zeros, which is known to rounding.
EARLY = 0.01
# The error of all motions that break off, where no reasons are requested.
BREAKS_OFF = FlowError("the motion breaks off")


def first_zero(quantity: Affine, skip_start: int = 0, rising: bool = False) -> StopTest:
    """A stop test at the first sign change of an affine function of the rows, or the first from minus to plus; a zero
    of order `skip_start` at the very start is divided out exactly."""
    crossings = Crossings(skip_start, rising)
    return lambda c, steps: next(iter(crossings(quantity.series(c), steps)), None)


def until_zero(
    flow: Flow, starts: Array, ps: Array, quantity: Affine, skip_start: int = 0
) -> tuple[Array, Trajectories | None]:
    """Motions from states (m, n) with parameters (m, np) up to the first sign change of an affine function.

    Returns which of them (r,) reach it within the largest block of Taylor steps, and these motions. They are None when
    no motion does, and where motions are better followed one by one: on a piecewise field, without a Taylor series, and
    for a single start in closed form. `skip_start` is that of `first_zero`.
    """
    if (flow.phase.closed_form and len(starts) == 1) or not flow.in_lanes:
        return np.zeros(0, int), None
    search = _ZeroSearch(flow, starts, ps, quantity, np.inf, skip_start, all_steps=True)
    search.by_taylor_steps()
    if not len(which := np.isfinite(search.times).nonzero()[0]):
        return which, None
    if len(starts) == len(search.steps) == 1:
        ((_, steps, coefficients),) = search.steps
        counts = np.array([len(steps)])
        return which, Trajectories(begins_of_steps(steps, counts), search.times, coefficients, counts, flow.names)
    owners, steps, coefficients = map(np.concatenate, zip(*search.steps, strict=True))
    reached = np.isfinite(search.times)[owners]
    order = reached.nonzero()[0][np.argsort(owners[reached], kind="stable")]
    counts = np.bincount(owners[order], minlength=len(starts))[which]
    begins = begins_of_steps(steps[order], counts)
    return which, Trajectories(begins, search.times[which], coefficients[order], counts, flow.names)


def first_zeros(
    flow: Flow,
    starts: ArrayLike,
    p: Array,
    quantity: Affine,
    limit: ArrayLike,
    skip: ArrayLike = 0,
    rising: bool = False,
    over: tuple[Affine, int] | None = None,
    ahead: ArrayLike = 0.0,
    reasons: bool = True,
) -> tuple[Array, Array, dict[int, FlowError]]:
    """When an affine function of the rows first changes its sign on motions from states (m, n), and where.

    p : parameters (np,) of all or, of motions that take Taylor steps, (m, np)
    limit : times (m,) by which that must happen
    skip : orders (m,) of the zeros at the start, which are divided out exactly
    rising : count only changes from minus to plus
    ahead : times (m,) until which the function is known to be positive, of motions in closed form; 0 where it is not
    over : another affine function and a number: a motion on which that function changes sign this many times never has
        the zero. It is only used for motions that take Taylor steps together.
    reasons : whether each `FlowError` states its reason

    Returns times (m,), NaN where it does not happen in time and infinity where it never will; the rows (m, rows) at
    these times; and by index the `FlowError` of each motion that breaks off before.
    """
    ps = np.atleast_2d(p)
    search = _ZeroSearch(flow, np.asarray(starts, dtype=float), ps, quantity, limit, skip, rising, over, reasons)
    if flow.phase.closed_form:
        with apart():
            search.in_closed_form(np.broadcast_to(ahead, len(search.starts)))
    elif isinstance(flow.stepper(0), TaylorStepper):
        search.by_taylor_steps()
    else:
        everything = np.arange(len(search.starts))
        search.one_by_one(everything, search.starts, np.zeros(len(everything)), search.skip)
    return search.times, search.rows, search.failed


class _ZeroSearch:
    """The search of `first_zeros`, with its arguments and its results `times`, `rows` and `failed`; the parameters are
    (m, np), or (1, np) for all."""

    def __init__(self, flow, starts, ps, quantity, limit, skip, rising=False, over=None, reasons=True, all_steps=False):
        count = len(starts)
        self.flow, self.starts, self.ps, self.over = flow, starts, ps, over
        self.quantity, self.rising, self.all_steps, self.reasons = quantity, rising, all_steps, reasons
        self.limit, self.skip = np.broadcast_to(limit, count), np.broadcast_to(skip, count)
        self.times, self.rows = np.full(count, np.nan), np.full((count, len(flow.names)), np.nan)
        self.failed: dict[int, FlowError] = {}
        self.steps: list[tuple] = []  # the motion, length and coefficients of `all_steps` up to the zeros

    def in_closed_form(self, began: Array):
        """Search motions in closed form, some expansions at a time."""
        form, block = self.flow.closed_form(self.ps[0]), CLOSED_BLOCK
        length, remaining = CLOSED_STEP / np.sqrt(form.square), np.arange(len(self.starts))
        rises, falls = form.positive_between(self.quantity, self.starts.T)
        # The signs are those at the ends of the last block.
        signs = np.zeros(len(self.starts))
        for _ in range(self.flow.control.max_calls):
            if not len(remaining):
                break
            interrupts.heed()
            times = began[:, None] + length * np.arange(block)
            c = form.along(self.quantity.weights, self.starts[remaining].T[:, :, None], times, CLOSED_ORDER)
            c[:, 0] += self.quantity.offset
            polynomials = PiecewisePolynomials(c, np.full(len(c), length), np.full(len(remaining), block))
            skip = np.where(began > 0, 0, self.skip[remaining])
            owner, piece, t = polynomials.first_roots(skip, self.rising, signs[remaining])
            signs[remaining] = polynomials.after
            found, hits = began[owner] + length * piece + t, remaining[owner]
            self.times[hits] = np.where(found <= self.limit[hits], found, np.nan)
            self.rows[hits, : self.flow.size] = form.state(self.starts[hits].T, found).T
            if form.pushed:
                away = ~(np.abs(c[block - 1 :: block, 0]) <= self.flow.control.runaway)
                away[owner] = False
                for i in away.nonzero()[0].tolist():
                    at = began[i], form.state(self.starts[remaining[i]], began[i])
                    self.failed[int(remaining[i])] = RunsAway(self.flow.failure("runs away", *at))
                owner = np.append(owner, away.nonzero()[0])
            remaining, began = np.delete(remaining, owner), np.delete(began, owner) + block * length
            # While the quantity stays positive nothing is searched, until shortly before that ends.
            jump = falls[remaining] - EARLY * length
            began = np.where(began >= rises[remaining], np.maximum(began, jump), began)
            left, followed = began < self.limit[remaining], began < MOST_CLOSED_STEPS * length
            self._give_up(remaining[left & ~followed])
            remaining, began = remaining[left & followed], began[left & followed]
        self._give_up(remaining)
        for i, (slopes, value) in enumerate(form.watch.values(), start=self.flow.size):
            self.rows[:, i] = self.rows[:, : self.flow.size] @ np.asarray(slopes) + value

    def by_taylor_steps(self):
        """Search motions in lanes, each to the next step in which an event may occur, and one by one from a step on
        that cannot be used."""
        flow, stepper = self.flow, self.flow.stepper(0)
        at, turns = stepper.places, self.over[1] if self.over else 0
        most, on = flow.control.max_block if self.all_steps else None, flow.on_pieces(self.starts, self.ps)
        remaining, (weights, offsets) = np.arange(len(self.starts)), self._tests()
        z = stepper.watched_state(self.starts, self.skip, offsets.shape[1], on.numbers if on else 0.0)
        for _ in range(flow.control.max_calls):
            remaining, z = self._on_pieces(on, remaining, z)
            if not len(remaining):
                return
            interrupts.heed()
            p = self.ps[remaining] if len(self.ps) > 1 else self.ps
            tests, limits = (weights[remaining], offsets[remaining]), self.limit[remaining]
            z, steps, counts, going = stepper.watch(z, p, *tests, limits, on and on.of(remaining), turns, most)
            found = z[:, at.found] > 0
            never = ~found & self._never(z)
            self.times[remaining[never]] = np.inf
            left = ~never & ~flow.inside(on, z[:, at.piece]) & (z[:, at.time] < limits)
            broken = ~(found | never | going | left | (z[:, at.time] >= limits))
            if not self.all_steps:
                self._give_up(remaining[going & ~found & ~never])
                self._beyond(remaining[broken], on, z[broken])
            else:
                self._record(remaining, steps, counts, found)
                last = np.cumsum(counts)[found] - 1
                steps = Watched(*(values[last] for values in steps))
            searched = z[found]
            with apart():
                left[found] = self._search_steps(remaining[found], searched, steps)
            z[found] = searched
            remaining, z = remaining[left], z[left]
        self._give_up(remaining)

    def _on_pieces(self, on: OnPieces | None, remaining: Array, z: Array) -> tuple[Array, Array]:
        """The motions that are on a piece, and their z; the others have left the range of a law."""
        at = self.flow.stepper(0).places
        inside = self.flow.inside(on, z[:, at.piece])
        for i in (~inside).nonzero()[0].tolist():
            p = self.ps[remaining[i] if len(self.ps) > 1 else 0]
            self.failed[int(remaining[i])] = self.flow.out_of_range(p, z[i, at.state])
        return (remaining, z) if inside.all() else (remaining[inside], z[inside])

    def _give_up(self, remaining):
        """Motions that have neither the zero nor an end after the most calls."""
        for i in remaining.tolist():
            self.failed[i] = FlowError(f"the {self.flow.phase.name} takes too many steps")

    def _record(self, remaining, steps: Watched, counts, found):
        """Record the steps of the motions that have `found` one that may hold a zero."""
        owners = np.repeat(remaining, counts)
        chosen = np.repeat(found, counts)
        self.steps.append((owners[chosen], steps.lengths[chosen], steps.coefficients[chosen]))

    def _never(self, z: Array) -> Array:
        """Which motions have passed the number of zeros of `over` after which the zero is excluded."""
        changes = self.flow.stepper(0).places.changes
        return z[:, changes] >= self.over[1] if self.over else np.zeros(len(z), bool)

    def _tests(self) -> tuple[Array, Array]:
        """Weights (m, q, rows) and offsets (m, q) of the zero, and of the zero of `over`."""
        count, tests = len(self.starts), [self.quantity] + ([self.over[0]] if self.over else [])
        weights, offsets = np.zeros((count, len(tests), len(self.flow.names))), np.zeros((count, len(tests)))
        for i, test in enumerate(tests):
            weights[:, i, : len(test.weights)], offsets[:, i] = test.weights, test.offset
        return weights, offsets

    def _beyond(self, indices: Array, on: OnPieces | None, z: Array) -> None:
        """Search the motions `indices` with these z from a step on that cannot be used. Most of them break off soon or
        end in time, which is determined together."""
        at = self.flow.stepper(0).places
        if len(indices):
            left = ~self._ended(indices, on and on._replace(tables=on.of(indices), numbers=z[:, at.piece]), z)
            indices, z = indices[left], z[left]
        self.one_by_one(indices, *(z[:, place] for place in (at.state, at.time, at.order)))

    def _ended(self, indices: Array, on: OnPieces | None, z: Array) -> Array:
        """Whether motions `on` pieces end without the zero within the steps of one call of `Flow.run`, which decides it
        in the same way: no step can be used, or all can and the state runs away or the time is over. Stores their
        errors."""
        flow, control, seeds = self.flow, self.flow.control, np.zeros((self.flow.size, 0))
        stepper = flow.stepper(0)
        x, began, orders = (z[:, getattr(stepper.places, place)] for place in ("state", "time", "order"))
        ps, durations = self.ps[indices] if len(self.ps) > 1 else self.ps, self.limit[indices] - began
        found = stepper.advance_all(x, ps, durations, seeds, np.zeros((ps.shape[1], 0)), control.look_ahead, on)
        c, steps, counts = found.coefficients, found.steps, found.counts
        owner, ends, begun = np.repeat(np.arange(len(x)), counts), np.cumsum(counts), counts > 0
        times = began[owner] + begins_of_steps(steps, counts)
        usable = (steps > control.shortest_step * np.maximum(times, 1.0)) & np.isfinite(c).all((1, 2))
        none = ~begun
        none[begun] = ~usable[(ends - counts)[begun]]
        away = np.abs(found.ends).max(1) > control.runaway
        whole = (np.bincount(owner, ~usable, len(x)) == 0) & ~none & (away | (found.left == 0))
        if whole.any():
            chosen = whole[owner]
            polynomials = PiecewisePolynomials(self.quantity.series(c[chosen]), steps[chosen], counts[whole])
            whole[whole.nonzero()[0][polynomials.first_roots(orders[whole].astype(int), self.rising)[0]]] = False
        for i in (none | (whole & away)).nonzero()[0].tolist():
            last = ends[i] - 1
            at = (began[i], x[i]) if none[i] else (times[last] + steps[last], found.ends[i])
            kind = RunsAway if whole[i] and steps[last] > control.singular_step else BreaksDown
            what = "breaks down" if none[i] else "runs away"
            self.failed[int(indices[i])] = kind(flow.failure(what, *at)) if self.reasons else BREAKS_OFF
        return none | whole

    def one_by_one(self, indices, x, began, orders):
        """Search the motions `indices` one after the other, from the states `x` at the times `began`, with zeros of
        these orders there."""
        for index, start, before, order in zip(indices, x, began, orders.astype(int), strict=True):
            left, stop = self.limit[index] - before, first_zero(self.quantity, int(order), self.rising)
            try:
                path, _ = self.flow.run(start, self.ps[index if len(self.ps) > 1 else 0], left, stop=stop)
            except FlowError as error:
                self.failed[int(index)] = error
                continue
            if path.times[-1] < left:
                self.times[index], self.rows[index] = before + path.times[-1], path.end

    def _search_steps(self, remaining, z, steps: Watched) -> Array:
        """Search one step of each motion, at whose end z is that of `TaylorStepper.watch`; returns which motions have
        no zero there, with z where these go on."""
        at, count, (c, lengths, times, orders, _, signs) = self.flow.stepper(0).places, len(remaining), steps
        polynomials = PiecewisePolynomials(self.quantity.series(c), lengths, np.ones(count, int))
        owner, _, t = polynomials.first_roots(orders.astype(int), self.rising, signs[:, 0])
        hits, found = remaining[owner], times[owner] + t
        self.times[hits] = np.where(found <= self.limit[hits], found, np.nan)
        self.rows[hits] = evaluate(c if len(owner) == count else c[owner], t[:, None])
        left = np.ones(count, bool)
        left[owner] = False
        z[:, at.order], z[:, at.found], z[:, at.signs.start] = 0.0, 0.0, polynomials.after
        never = left & self._never(z)
        self.times[remaining[never]] = np.inf
        left &= ~never
        return left & (z[:, at.time] < self.limit[remaining])
