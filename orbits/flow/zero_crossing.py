"""Zeros of affine functions of the state along one motion, and along many that are integrated together."""

import numpy as np
from numpy.typing import ArrayLike

from ..errors import FlowError
from ..model.phase import Affine
from ..numerics.bernstein import Crossings, PiecewisePolynomials, evaluate
from ..numerics.roots import Array
from ..symbolic import interrupts
from .breakpoints import ActivePieces
from .flow import Flow, StopTest
from .taylor import TaylorStepper
from .trajectory import Trajectories

# Closed forms are expanded about points this far apart, in units of the oscillation's 1 / frequency. The terms beyond
# this order are below rounding there, 1 / 19! = 8e-18. So many expansions are searched in one call.
CLOSED_STEP, CLOSED_ORDER, CLOSED_BLOCK = 1.0, 18, 4
# After so many of these steps the phase of the oscillation has fewer than four digits left, and the motion is given up.
MOST_CLOSED_STEPS = 1e12


def first_zero(quantity: Affine, skip_start: int = 0, rising: bool = False) -> StopTest:
    """A stop test at the first sign change of an affine function of the rows, or the first from minus to plus; a zero
    of order `skip_start` at the very start is divided out exactly."""
    crossings = Crossings(skip_start, rising)
    return lambda c, steps: next(iter(crossings(quantity.series(c), steps)), None)


def series_along(quantity: Affine, c: Array, steps: Array) -> PiecewisePolynomials:
    """An affine function along several motions of as many steps each, coefficients (m, count, rows, K + 1)."""
    series = quantity.series(c).reshape(-1, c.shape[3])
    return PiecewisePolynomials(series, steps.ravel(), np.full(len(steps), steps.shape[1]))


def until_zero(
    flow: Flow, starts: Array, ps: Array, quantity: Affine, skip_start: int = 0
) -> tuple[Array, Trajectories | None]:
    """Motions from states (m, n) with parameters (m, np) up to the first sign change of an affine function.

    Returns which of them (r,) reach it within the largest block of Taylor steps, and these motions. They are None when
    no motion does, and where motions are better followed one by one: on a piecewise field, without a Taylor series, and
    for a single start in closed form. `skip_start` is that of `first_zero`.
    """
    remaining, found = np.arange(len(starts)), []
    if (flow.phase.closed_form and len(starts) == 1) or not flow.smooth:
        return remaining[:0], None
    count, most, stepper = flow.expected_steps, flow.control.max_block, flow.stepper(0)
    assert isinstance(stepper, TaylorStepper)
    while len(remaining) and count <= most:
        steps, c, accepted = stepper.advance_all(starts[remaining], ps[remaining], count)
        accepted = np.logical_and.accumulate(accepted, axis=1)
        if not accepted.all():  # The steps after a rejected one start from the state that it does.
            steps, c = np.where(accepted, steps, 0.0), np.where(np.isfinite(c), c, 0.0)
        owner, last, t = series_along(quantity, c, steps).first_roots(skip_start)
        reached = accepted[owner, last] & (steps[owner, last] > 0)
        owner, last, t = owner[reached], last[reached], t[reached]
        if len(owner):
            lengths = steps[owner]
            begins = np.hstack([np.zeros((len(owner), 1)), np.cumsum(lengths, axis=1)[:, :-1]])
            used = (np.arange(count) <= last[:, None]) & (lengths > 0)
            ends = begins[np.arange(len(owner)), last] + t
            motions = Trajectories(begins[used], ends, c[owner][used], used.sum(1), flow.names)
            found.append((remaining[owner], motions))
            if len(starts) > 1:
                flow.expected_steps = min(int(last.max()) + 2, most)
        accepted[owner] = False
        remaining, count = remaining[accepted.all(1)], 2 * count
    if not found:
        return remaining[:0], None
    if len(found) == 1:
        return found[0]
    which, parts = zip(*found, strict=True)
    order = np.argsort(np.concatenate(which))
    return np.concatenate(which)[order], Trajectories.joined(parts)[order]


def first_zeros(
    flow: Flow,
    starts: ArrayLike,
    p: Array,
    quantity: Affine,
    limit: ArrayLike,
    skip: ArrayLike = 0,
    rising: bool = False,
    over: tuple[Affine, int] | None = None,
) -> tuple[Array, Array, dict[int, FlowError]]:
    """When an affine function of the rows first changes its sign on motions from states (m, n), and where.

    p : parameters (np,) of all
    limit : times (m,) by which that must happen
    skip : orders (m,) of the zeros at the start, which are divided out exactly
    rising : count only changes from minus to plus
    over : another affine function and a number: a motion on which that function has changed its sign so often never has
        the zero. It is only used for motions that take Taylor steps together.

    Returns times (m,), NaN where it does not happen in time and infinity where it never will; the rows (m, rows) at
    these times; and by index the `FlowError` of each motion that breaks off before.
    """
    search = _ZeroSearch(flow, np.asarray(starts, dtype=float), p, quantity, limit, skip, rising, over)
    if flow.phase.closed_form:
        search.in_closed_form()
    elif isinstance(flow.stepper(0), TaylorStepper):
        search.by_taylor_steps()
    else:
        search.one_by_one(np.arange(len(search.starts)), search.starts, np.zeros(len(search.starts)))
    return search.times, search.rows, search.failed


class _ZeroSearch:
    """The search of `first_zeros`, with its arguments and its results `times`, `rows` and `failed`."""

    def __init__(self, flow, starts, p, quantity, limit, skip, rising, over):
        count = len(starts)
        self.flow, self.starts, self.p, self.quantity, self.rising, self.over = flow, starts, p, quantity, rising, over
        self.limit, self.skip = np.broadcast_to(limit, count), np.broadcast_to(skip, count)
        self.signs = np.zeros(count)  # Signs of the quantity at the ends of the last block, 0 before the first.
        self.over_signs, self.over_changes = np.zeros(count), np.zeros(count, int)
        self.times, self.rows = np.full(count, np.nan), np.full((count, len(flow.names)), np.nan)
        self.failed: dict[int, FlowError] = {}

    def in_closed_form(self):
        """Search motions in closed form, some expansions at a time."""
        form, block = self.flow.closed_form(self.p), CLOSED_BLOCK
        length, remaining, began = CLOSED_STEP / np.sqrt(form.square), np.arange(len(self.starts)), np.zeros(1)
        rises, falls = form.positive_between(self.quantity, self.starts.T)
        for _ in range(self.flow.control.max_calls):
            if not len(remaining):
                break
            interrupts.check()
            times = began[:, None] + length * np.arange(block)
            states = form.state(self.starts[remaining].T[:, :, None], times)
            c = form.along(self.quantity.weights, states.reshape(len(states), -1), CLOSED_ORDER)
            c[:, 0] += self.quantity.offset
            polynomials = PiecewisePolynomials(c, np.full(len(c), length), np.full(len(remaining), block))
            skip = 0 if began.any() else self.skip[remaining]
            owner, piece, t = polynomials.first_roots(skip, self.rising, self.signs[remaining])
            self.signs[remaining] = polynomials.after
            began = np.broadcast_to(began, remaining.shape)
            found, hits = began[owner] + length * piece + t, remaining[owner]
            self.times[hits] = np.where(found <= self.limit[hits], found, np.nan)
            self.rows[hits, : self.flow.size] = form.state(self.starts[hits].T, found).T
            remaining, began = np.delete(remaining, owner), np.delete(began, owner) + block * length
            # While the quantity stays positive nothing is searched, up to the last block that begins before that ends.
            jump = np.floor(falls[remaining] / (block * length)) * (block * length)
            began = np.where(began >= rises[remaining], np.maximum(began, jump), began)
            left, followed = began < self.limit[remaining], began < MOST_CLOSED_STEPS * length
            self._give_up(remaining[left & ~followed])
            remaining, began = remaining[left & followed], began[left & followed]
        self._give_up(remaining)
        for i, (slope, value) in enumerate(form.watch.values(), start=self.flow.size):
            self.rows[:, i] = slope * self.rows[:, 0] + value

    def by_taylor_steps(self):
        """Search motions by equal numbers of Taylor steps, and one by one from a step on that cannot be used."""
        flow, control, stepper = self.flow, self.flow.control, self.flow.stepper(0)
        remaining, x, began = np.arange(len(self.starts)), self.starts, np.zeros(len(self.starts))
        pieces = ActivePieces(flow, self.p, x)
        for _ in range(control.max_calls):
            inside = pieces.inside
            for i in np.flatnonzero(~inside):
                self.failed[int(remaining[i])] = flow.out_of_range(self.p, x[i])
            remaining, x, began = (part[inside] for part in (remaining, x, began))
            pieces.keep(inside)
            if not len(remaining):
                return
            interrupts.check()
            block = 1 if flow.phase.pieces else control.look_ahead
            steps, c, accepted = stepper.advance_all(x, pieces.data, block)
            steps = pieces.cut(c, steps)
            ends = evaluate(c[:, -1, : flow.size], steps[:, -1:])
            # A zero that is divided out must lie at the start of an accepted step.
            plain = steps.any(1) & ((steps[:, 0] > 0) | (began > 0) | (self.skip[remaining] == 0))
            plain &= accepted.all(1) & (np.abs(ends).max(1) < control.runaway)
            if not plain.all():
                self.one_by_one(remaining[~plain], x[~plain], began[~plain])
                remaining, ends, began, steps, c = (part[plain] for part in (remaining, ends, began, steps, c))
                pieces.keep(plain)
            reached = np.cumsum(steps, axis=1)
            left = self._search_block(remaining, began, steps, reached, c)
            began = began + reached[:, -1]
            left &= began < self.limit[remaining]
            if self.over:
                left &= ~self._given_up(self.over, remaining, left, steps, c)
            remaining, x, began = remaining[left], ends[left], began[left]
            pieces.enter(left)
        self._give_up(remaining)

    def _give_up(self, remaining):
        """Motions that have neither the zero nor an end after the most calls."""
        for i in remaining.tolist():
            self.failed[i] = FlowError(f"the {self.flow.phase.name} takes too many steps")

    def one_by_one(self, indices, x, began):
        """Search the motions `indices` one after the other, from the states `x` at the times `began`."""
        for index, start, before in zip(indices, x, began, strict=True):
            left, order = self.limit[index] - before, int(self.skip[index]) if before == 0 else 0
            stop = first_zero(self.quantity, order, self.rising)
            try:
                path, _ = self.flow.run(start, self.p, left, stop=stop)
            except FlowError as error:
                self.failed[int(index)] = error
                continue
            if path.times[-1] < left:
                self.times[index], self.rows[index] = before + path.times[-1], path.end

    def _search_block(self, remaining, began, steps, reached, c) -> Array:
        """Search a block of steps, whose ends are at `reached` in it; returns which motions have no zero there."""
        skip = np.where(began == 0, self.skip[remaining], 0)
        polynomials = series_along(self.quantity, c, steps)
        owner, piece, t = polynomials.first_roots(skip, self.rising, self.signs[remaining])
        self.signs[remaining] = polynomials.after
        found = began[owner] + np.where(piece > 0, reached[owner, piece - 1], 0.0) + t
        hits = remaining[owner]
        self.times[hits] = np.where(found <= self.limit[hits], found, np.nan)
        self.rows[hits] = evaluate(c[owner, piece], t[:, None])
        left = np.ones(len(remaining), bool)
        left[owner] = False
        return left

    def _given_up(self, over: tuple[Affine, int], remaining, left, steps, c) -> Array:
        """Which of the motions `left` never have a zero, since the function of `over` has changed its sign so often."""
        quantity, most = over
        polynomials = series_along(quantity, c, steps)
        owner = polynomials.roots(before=self.over_signs[remaining])[0]
        self.over_changes[remaining] += np.bincount(owner, minlength=len(remaining))
        self.over_signs[remaining] = polynomials.after
        never = left & (self.over_changes[remaining] >= most)
        self.times[remaining[never]] = np.inf
        return never
