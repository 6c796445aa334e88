"""Zeros of affine functions of the state along motions: of one motion, and of many that are integrated together."""

from dataclasses import dataclass

import numpy as np

from ..errors import FlowError
from ..model.closed_form import Oscillator, ThrownOscillator
from ..model.phase import Affine
from ..numerics.bernstein import Crossings, PiecewisePolynomials, evaluate
from ..symbolic import interrupts
from .breakpoints import ActivePieces, StopTest, integrate, out_of_range
from .dynamics import PhaseDynamics
from .taylor import TaylorStepper
from .trajectory import Trajectories

# Closed forms are expanded about points this far apart, in units of the oscillation's 1 / frequency. The terms beyond
# this order are below rounding there, 1 / 19! = 8e-18. So many expansions are searched in one call.
CLOSED_STEP, CLOSED_ORDER, CLOSED_BLOCK = 1.0, 18, 4


def first_zero(quantity: Affine, skip_start: int = 0, rising: bool = False) -> StopTest:
    """A stop test at the first sign change of an affine function of the rows, or the first from minus to plus.

    `skip_start` is the order of a zero known to lie at the very start, which is divided out exactly.
    """
    crossings = Crossings(skip_start, rising)

    def stop(coefficients, steps):
        found = crossings(quantity.series(coefficients), steps)
        return found[0] if found else None

    return stop


def series_along(quantity: Affine, c: np.ndarray, steps: np.ndarray) -> PiecewisePolynomials:
    """An affine function along several motions of as many steps each, coefficients (m, count, rows, K + 1)."""
    series = quantity.series(c).reshape(-1, c.shape[3])
    return PiecewisePolynomials(series, steps.ravel(), np.full(len(steps), steps.shape[1]))


def until_zero(
    dynamics: PhaseDynamics, starts: np.ndarray, ps: np.ndarray, quantity: Affine, skip_start: int = 0
) -> tuple[np.ndarray, Trajectories | None]:
    """Motions from states (m, n) with parameters (m, np) up to the first sign change of an affine function.

    Returns which of them (r,) reach it within the largest block of Taylor steps, and these motions. They are None when
    no motion does, and where motions are better followed one by one: on a piecewise field, without a Taylor series, and
    for a single start in closed form. `skip_start` is that of `first_zero`.
    """
    remaining, found = np.arange(len(starts)), []
    if (dynamics.phase.closed_form and len(starts) == 1) or not dynamics.smooth:
        return remaining[:0], None
    count, most, stepper = dynamics.expected_steps, dynamics.control.max_block, dynamics.stepper(0)
    assert isinstance(stepper, TaylorStepper)
    while len(remaining) and count <= most:
        steps, c, accepted = stepper.advance_all(starts[remaining], ps[remaining], count)
        accepted = np.logical_and.accumulate(accepted, axis=1)
        if not accepted.all():  # The steps after a rejected one start from the state that it does.
            steps, c = np.where(accepted, steps, 0.0), np.where(np.isfinite(c), c, 0.0)
        owner, piece, t = series_along(quantity, c, steps).roots(skip_start)
        owner, first = np.unique(owner, return_index=True)
        reached = accepted[owner, piece[first]] & (steps[owner, piece[first]] > 0)
        owner, first = owner[reached], first[reached]
        if len(owner):
            last = piece[first]
            found.append((remaining[owner], _cut_motions(dynamics.names, c[owner], steps[owner], last, t[first])))
            if len(starts) > 1:
                dynamics.expected_steps = min(int(last.max()) + 2, most)
        accepted[owner] = False
        remaining, count = remaining[accepted.all(1)], 2 * count
    if not found:
        return remaining[:0], None
    if len(found) == 1:
        return found[0]
    which, motions = zip(*found, strict=True)
    order = np.argsort(np.concatenate(which))
    return np.concatenate(which)[order], Trajectories.joined(motions)[order]


def _cut_motions(names: tuple[str, ...], c, steps, last, t) -> Trajectories:
    """Motions (m, count, ...) that end at the time `t` (m,) in the step `last` (m,); steps of length 0 are left out."""
    lengths = np.cumsum(steps, axis=1)
    begins = np.concatenate([np.zeros((len(steps), 1)), lengths[:, :-1]], axis=1)
    used = (np.arange(steps.shape[1]) <= last[:, None]) & (steps > 0)
    ends = begins[np.arange(len(steps)), last] + t
    return Trajectories(begins[used], ends, c[used], used.sum(1), names)


@dataclass(eq=False)
class ZeroSearch:
    """The search for the first zeros of an affine function along several motions.

    Its fields are the arguments of `Flow.first_zeros`, its results the attributes `times`, `rows` and `failed`.
    """

    dynamics: PhaseDynamics
    starts: np.ndarray
    p: np.ndarray
    quantity: Affine
    limit: np.ndarray
    skip: np.ndarray
    rising: bool
    over: tuple[Affine, int] | None

    def __post_init__(self) -> None:
        count = len(self.starts)
        self.signs = np.zeros(count)  # Signs of the quantity at the ends of the last block, 0 before the first.
        self.over_signs, self.over_changes = np.zeros(count), np.zeros(count, int)
        self.times, self.rows = np.full(count, np.nan), np.full((count, len(self.dynamics.names)), np.nan)
        self.failed: dict[int, FlowError] = {}

    def in_closed_form(self, form: Oscillator | ThrownOscillator) -> None:
        """Search motions in closed form."""
        length, remaining, began = CLOSED_STEP / np.sqrt(form.square), np.arange(len(self.starts)), 0.0
        while len(remaining):
            interrupts.check()
            times = began + length * np.arange(CLOSED_BLOCK)
            states = form.state(self.starts[remaining].T[:, :, None], times)
            c = form.along(self.quantity.weights, states.reshape(len(states), -1), CLOSED_ORDER)
            c[:, 0] += self.quantity.offset
            polynomials = PiecewisePolynomials(c, np.full(len(c), length), np.full(len(remaining), CLOSED_BLOCK))
            owner, piece, t = self._first_roots(polynomials, remaining, self.skip[remaining] if began == 0 else 0)
            found, hits = began + length * piece + t, remaining[owner]
            self.times[hits] = np.where(found <= self.limit[hits], found, np.nan)
            self.rows[hits, : self.dynamics.size] = form.state(self.starts[hits].T, found).T
            remaining, began = np.delete(remaining, owner), began + CLOSED_BLOCK * length
            remaining = remaining[began < self.limit[remaining]]
        for i, (slope, value) in enumerate(form.watch.values(), start=self.dynamics.size):
            self.rows[:, i] = slope * self.rows[:, 0] + value

    def by_taylor_steps(self, stepper: TaylorStepper) -> None:
        """Search motions that take Taylor steps together, in blocks of equal numbers of steps.

        Motions with a rejected step, or whose zero at the start cannot be divided out, are searched one by one.
        """
        dynamics, control = self.dynamics, self.dynamics.control
        remaining, x, began = np.arange(len(self.starts)), self.starts, np.zeros(len(self.starts))
        pieces = ActivePieces(dynamics, self.p, x)
        for _ in range(control.max_steps):
            inside = pieces.inside
            for i in np.flatnonzero(~inside):
                self.failed[int(remaining[i])] = out_of_range(dynamics, self.p, x[i])
            remaining, x, began = (part[inside] for part in (remaining, x, began))
            pieces.keep(inside)
            if not len(remaining):
                return
            interrupts.check()
            block = 1 if dynamics.phase.pieces else control.look_ahead
            steps, c, accepted = stepper.advance_all(x, pieces.data, block)
            steps = pieces.cut(c, steps)
            ends = evaluate(c[:, -1, : dynamics.size], steps[:, -1:])
            # A zero that is divided out must lie at the start of an accepted step.
            plain = steps.any(1) & ((steps[:, 0] > 0) | (began > 0) | (self.skip[remaining] == 0))
            plain &= accepted.all(1) & (np.abs(ends).max(1) < control.runaway)
            if not plain.all():
                self.one_by_one(remaining[~plain], x[~plain], began[~plain])
                remaining, ends, began, steps, c = (part[plain] for part in (remaining, ends, began, steps, c))
                pieces.keep(plain)
                if not len(remaining):
                    return
            reached = np.cumsum(steps, axis=1)
            left = self._search_block(remaining, began, steps, reached, c)
            began = began + reached[:, -1]
            left &= began < self.limit[remaining]
            if self.over:
                left &= ~self._given_up(self.over, remaining, left, steps, c)
            remaining, x, began = remaining[left], ends[left], began[left]
            pieces.enter(left)
        for i in remaining:
            self.failed[int(i)] = FlowError(f"the {dynamics.phase.name} takes too many steps")

    def one_by_one(self, indices: np.ndarray, x: np.ndarray, began: np.ndarray) -> None:
        """Search the motions `indices` one after the other, from the states `x` at the times `began`."""
        for index, start, before in zip(indices, x, began, strict=True):
            left, order = self.limit[index] - before, int(self.skip[index]) if before == 0 else 0
            stop = first_zero(self.quantity, order, self.rising)
            try:
                path, _ = integrate(self.dynamics, start, self.p, left, None, None, stop)
            except FlowError as error:
                self.failed[int(index)] = error
                continue
            if path.times[-1] < left:
                self.times[index], self.rows[index] = before + path.times[-1], path.end

    def _first_roots(self, polynomials: PiecewisePolynomials, remaining, skip):
        """The first roots in a block of the motions `remaining`: which of them have one, in which step, and when."""
        owner, piece, t = polynomials.roots(skip, self.rising, self.signs[remaining])
        self.signs[remaining] = polynomials.after
        owner, first = np.unique(owner, return_index=True)
        return owner, piece[first], t[first]

    def _search_block(self, remaining, began, steps, reached, c) -> np.ndarray:
        """Search a block of steps, whose ends are at `reached` in it; returns which motions have no zero there."""
        skip = np.where(began == 0, self.skip[remaining], 0)
        owner, piece, t = self._first_roots(series_along(self.quantity, c, steps), remaining, skip)
        found = began[owner] + np.where(piece > 0, reached[owner, piece - 1], 0.0) + t
        hits = remaining[owner]
        self.times[hits] = np.where(found <= self.limit[hits], found, np.nan)
        self.rows[hits] = evaluate(c[owner, piece], t[:, None])
        left = np.ones(len(remaining), bool)
        left[owner] = False
        return left

    def _given_up(self, over: tuple[Affine, int], remaining, left, steps, c) -> np.ndarray:
        """Which of the motions `left` never have a zero, since the function of `over` has changed its sign so often."""
        quantity, most = over
        polynomials = series_along(quantity, c, steps)
        owner = polynomials.roots(before=self.over_signs[remaining])[0]
        self.over_changes[remaining] += np.bincount(owner, minlength=len(remaining))
        self.over_signs[remaining] = polynomials.after
        never = left & (self.over_changes[remaining] >= most)
        self.times[remaining[never]] = np.inf
        return never
