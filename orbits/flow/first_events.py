"""The first event on motions of a flow: the first sign change of one of several functions of the state.

Along one motion it is a `stop` of the flow, along many that are integrated together `first_events`. A zero at the
start, as that of the gap at a lift-off, is divided out exactly.
"""

from collections.abc import Sequence
from itertools import chain, repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import BreaksDown, FlowError, RunsAway
from ..model import Affine
from ..numerics import Array, Crossings, PiecewisePolynomials, evaluate
from ..running import apart, interrupts
from .flow import CLOSED_FORM, Flow, StopTest
from .taylor import OnPieces, TaylorStepper, coefficients_of
from .trajectory import Trajectories, Trajectory, begins_of_steps
from .watch import Watch, Watched

# The error of all motions that break off, where no reasons are requested.
BREAKS_OFF = FlowError("the motion breaks off")


class Events(NamedTuple):
    """The first events on m motions.

    times : (m,), NaN where there is none in time, and infinity where there never will be one
    which : (m,), the numbers of the functions that change their sign, -1 where none does
    rows : (m, rows), at these times
    failed : by index the `FlowError` of each motion that breaks off before
    """

    times: Array
    which: Array
    rows: Array
    failed: dict[int, FlowError]


class FirstOf:
    """A `stop` of a flow at the first of several tests; `which` is the one that ended the motion, None while none has.

    tests : each (coefficients, steps) -> (step, time in it), or None
    """

    def __init__(self, *tests: StopTest):
        self.tests = tests
        self.which: int | None = None

    def __call__(self, coefficients: Array, steps: Array) -> tuple[int, float] | None:
        hits = [(hit, i) for i, test in enumerate(self.tests) if (hit := test(coefficients, steps)) is not None]
        first, self.which = min(hits, default=(None, None))
        return first


def first_zero(quantity: Affine, skip_start: int = 0, rising: bool = False) -> StopTest:
    """A stop test at the first sign change of an affine function of the rows, or the first from minus to plus; a zero
    of order `skip_start` at the very start is divided out exactly."""
    crossings = Crossings(skip_start, rising)
    return lambda c, steps: next(iter(crossings(quantity.series(c), steps)), None)


def nth_zero(quantity: Affine, count: int) -> StopTest:
    """A stop test at the count-th sign change of an affine function of the rows."""
    crossings, left = Crossings(), [count]

    def stop(c: Array, steps: Array) -> tuple[int, float] | None:
        found = crossings(quantity.series(c), steps)
        left[0] -= len(found)
        return found[left[0] - 1] if left[0] <= 0 else None

    return stop


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
    search = _Search(flow, starts, ps, Watch(flow, [quantity]), np.inf, skip_start, all_steps=True)
    search.by_taylor_steps()
    if not len(which := np.isfinite(search.times).nonzero()[0]):
        return which, None
    owners, steps, coefficients = search.steps[0]
    if len(search.steps) > 1 or len(which) < len(starts):  # one record has the steps of one motion after the other
        owners, steps, coefficients = map(np.concatenate, zip(*search.steps, strict=True))
        reached = np.isfinite(search.times)[owners]
        order = reached.nonzero()[0][np.argsort(owners[reached], kind="stable")]
        owners, steps, coefficients = owners[order], steps[order], coefficients[order]
    counts = np.bincount(owners, minlength=len(starts))[which]
    return which, Trajectories(begins_of_steps(steps, counts), search.times[which], coefficients, counts, flow.names)


def first_events(
    flow: Flow, starts: ArrayLike, p: Array, watch: Watch, limit: ArrayLike, orders: ArrayLike = 0,
    reasons: bool = True, stops: Sequence[StopTest] = (),
) -> Events:  # fmt: skip
    """The first events on motions from states (m, n).

    p : parameters (np,) of all or, of motions that take Taylor steps, (m, np)
    limit : times (m,) by which they must happen
    orders : (m, opening), the orders of the zeros at the start, which are divided out exactly; or a number or (m, 1)
    reasons : whether each `FlowError` states its reason
    stops : further tests of a single motion, whose numbers follow those of the functions
    """
    return _Search(flow, starts, p, watch, limit, orders, reasons).events(stops)


def recorded_event(
    flow: Flow, start: ArrayLike, p: Array, watch: Watch, limit: ArrayLike, orders: ArrayLike,
    stops: Sequence[StopTest] = (),
) -> tuple[Events, Trajectory | None]:  # fmt: skip
    """The `first_events` of a single motion, from a state (1, n), and its path up to the event or the limit; None in
    closed form, and where the motion breaks off or never has one."""
    search = _Search(flow, start, p, watch, limit, orders, all_steps=True, whole=True)
    events = search.events(stops)
    known = bool(search.steps) and not search.failed and not np.isinf(search.times[0])
    return events, search.path(0) if known else None


class _Search:
    """The search of `first_events`, with its arguments and its results `times`, `which`, `rows` and `failed`; the
    parameters are (m, np), or (1, np) for all."""

    def __init__(self, flow, starts, ps, watch: Watch, limit, orders, reasons=True, all_steps=False, whole=False):
        starts, ps = np.asarray(starts, dtype=float), np.atleast_2d(ps)
        count = len(starts)
        self.whole = whole  # whether all steps of motions of more than one block are recorded too
        self.flow, self.starts, self.ps, self.watch = flow, starts, ps, watch
        self.reasons, self.all_steps = reasons, all_steps
        self.limit, self.orders = np.empty(count), np.empty((count, watch.opening))
        self.limit[:], self.orders[:] = limit, orders
        self.times, self.which, self.rows = np.empty(count), np.empty(count, int), np.empty((count, len(flow.names)))
        self.times[:], self.which[:], self.rows[:] = np.nan, -1, np.nan
        self.failed: dict[int, FlowError] = {}
        self.steps: list[tuple] = []  # the motion, length and coefficients of `all_steps` up to the zeros

    def events(self, stops: Sequence[StopTest]) -> Events:
        """The first events, by the way in which the flow takes its steps; with further tests of a single motion."""
        if stops:
            self.one_by_one(np.zeros(1, int), self.starts, np.zeros(1), stops=stops)
        elif self.flow.phase.closed_form:
            with apart():
                self.in_closed_form()
        elif isinstance(self.flow.stepper(0), TaylorStepper):
            self.by_taylor_steps()
        else:
            self.one_by_one(np.arange(len(self.starts)), self.starts, np.zeros(len(self.starts)))
        return Events(self.times, self.which, self.rows, self.failed)

    def orders_of(self, number: int) -> Array:
        """The orders (m,) of the zeros of a function at the start."""
        return self.orders[:, number] if number < self.watch.opening else np.zeros(len(self.orders))

    def in_closed_form(self) -> None:
        """Search motions in closed form, for one function after the other up to the first event known so far."""
        form, limit = self.flow.closed_form(self.ps[0]), self.limit
        ends = np.full(len(limit), self.watch.most_turns * np.pi / form.rates.min()) if self.watch.turns else limit
        self.limit = np.minimum(limit, ends)
        for number, quantity in enumerate(self.watch.functions):
            self._zeros_in_closed_form(form, number, quantity)
        # A motion may break off while a function is searched whose zero is later than that of another one.
        self.failed = {i: error for i, error in self.failed.items() if not np.isfinite(self.times[i])}
        if self.watch.turns:
            never = np.isnan(self.times) & (ends <= limit)
            never[[*self.failed]] = False
            self.times[never] = np.inf
        for i, (slopes, value) in enumerate(form.watch.values(), start=self.flow.size):
            self.rows[:, i] = self.rows[:, : self.flow.size] @ np.asarray(slopes) + value

    def _zeros_in_closed_form(self, form, number: int, quantity: Affine) -> None:
        """Search the zeros of one function, some expansions at a time."""
        block, length = CLOSED_FORM.block, CLOSED_FORM.step / np.sqrt(form.square)
        remaining = np.arange(len(self.starts))
        orders = self.orders_of(number)
        rises, falls = form.positive_between(quantity, self.starts.T)
        began = self._not_before(form, quantity, orders)
        # The signs are those at the ends of the last block.
        signs = np.zeros(len(self.starts))
        for _ in range(self.flow.control.max_calls):
            if not len(remaining):
                break
            interrupts.heed()
            times = began[:, None] + length * np.arange(block)
            c = form.along(quantity.weights, self.starts[remaining].T[:, :, None], times, CLOSED_FORM.order)
            c[:, 0] += quantity.offset
            polynomials = PiecewisePolynomials(c, np.full(len(c), length), np.full(len(remaining), block))
            skip = np.where(began > 0, 0, orders[remaining]).astype(int)
            owner, piece, t = polynomials.first_roots(skip, self.watch.rising, signs[remaining])
            signs[remaining] = polynomials.after
            found, hits = began[owner] + length * piece + t, remaining[owner]
            soon = (found < self.limit[hits]) | ((found == self.limit[hits]) & (self.which[hits] < 0))
            self._found(hits[soon], found[soon], number, form.state(self.starts[hits[soon]].T, found[soon]).T)
            if form.pushed:
                away = ~(np.abs(c[block - 1 :: block, 0]) <= self.flow.control.runaway)
                away[owner] = False
                for i in away.nonzero()[0].tolist():
                    at = began[i], form.state(self.starts[remaining[i]], began[i])
                    self.failed[int(remaining[i])] = RunsAway(self.flow.failure("runs away", *at))
                owner = np.append(owner, away.nonzero()[0])
            remaining, began = np.delete(remaining, owner), np.delete(began, owner) + block * length
            # While the quantity stays positive nothing is searched, until shortly before that ends.
            jump = falls[remaining] - CLOSED_FORM.early * length
            began = np.where(began >= rises[remaining], np.maximum(began, jump), began)
            left, followed = began < self.limit[remaining], began < CLOSED_FORM.most_steps * length
            self._give_up(remaining[left & ~followed])
            remaining, began = remaining[left & followed], began[left & followed]
        self._give_up(remaining)

    def _not_before(self, form, quantity: Affine, orders: Array) -> Array:
        """The times (m,) until shortly before which a function that opens at the start with one order stays positive in
        closed form; 0 where none is known."""
        if self.watch.rising or not orders.any() or (orders != orders[0]).any():
            return np.zeros(len(orders))
        rate = np.sqrt(form.square)
        ahead = form.positive_until(quantity, self.starts.T, int(orders[0])) - CLOSED_FORM.early / rate
        return np.where((ahead > 0) & (ahead < self.limit) & (ahead * rate < CLOSED_FORM.most_steps), ahead, 0.0)

    def _found(self, lanes: Array, times: Array, which: ArrayLike, rows: Array) -> None:
        """Store events, at rows (k, r) that begin with the states."""
        self.times[lanes], self.which[lanes], self.limit[lanes] = times, which, times
        self.rows[lanes, : rows.shape[1]] = rows

    def by_taylor_steps(self) -> None:
        """Search motions in lanes, each to the next step in which an event may occur, and one by one from a step on
        that cannot be used."""
        flow, stepper, on = self.flow, self.flow.stepper(0), self.flow.on_pieces(self.starts, self.ps)
        at, most = stepper.places, flow.control.max_block if self.all_steps else 1
        z = stepper.watched_state(self.starts, self.watch.size, on.numbers if on else 0.0)
        data = self.watch.data(self.ps, self.limit, self.orders, self.all_steps)
        lanes = np.arange(len(z))
        for _ in range(flow.control.max_calls):
            if on:
                inside = self._on_pieces(on, lanes, z)
                lanes, z, data = lanes[inside], z[inside], data[inside]
            if not len(lanes):
                return
            interrupts.heed()
            z, steps, counts, going = self.watch.follow(stepper, z, data, on and on.of(lanes), most)
            found, over = z[:, at.found] > 0, z[:, at.time] >= self.limit[lanes]
            never = ~found & self._never(z)
            self.times[lanes[never]] = np.inf
            ended = found | never | over
            stays = ~flow.inside(on, z[:, at.piece]) & ~ended if on else np.zeros(len(lanes), bool)
            if (self.whole or not self.all_steps) and not (known := ended | stays).all():
                broken, longer = ~going & ~known, going & ~known
                if self.whole:
                    stays |= longer
                else:
                    self._give_up(lanes[longer])
                self._beyond(lanes[broken], on, z[broken])
            if self.all_steps:
                self._record(lanes, steps, counts, found | self.whole)
                last = np.cumsum(counts)[found] - 1
                steps = Watched(*(values[last] for values in steps))
            if found.any():
                with apart():
                    stays[found] = self._search_steps(lanes, z, found, steps)
            if not stays.any():
                return
            lanes, z, data = lanes[stays], z[stays], data[stays]
        self._give_up(lanes)

    def _on_pieces(self, on: OnPieces, lanes: Array, z: Array) -> Array:
        """Which motions are on a piece; the others have left the range of a law."""
        at = self.flow.stepper(0).places
        inside = self.flow.inside(on, z[:, at.piece])
        for i in (~inside).nonzero()[0].tolist():
            p = self.ps[lanes[i] if len(self.ps) > 1 else 0]
            self.failed[int(lanes[i])] = self.flow.out_of_range(p, z[i, at.state])
        return inside

    def _give_up(self, lanes: Array) -> None:
        """Motions that have neither the zero nor an end after the most calls."""
        for i in lanes.tolist():
            self.failed[i] = FlowError(f"the {self.flow.phase.name} takes too many steps")

    def _record(self, lanes, steps: Watched, counts, found) -> None:
        """Record the steps of the motions that have `found` one that may hold a zero."""
        arrays = lanes.repeat(counts), steps.begins[:, 0], steps.coefficients
        if not found.all():
            chosen = found.repeat(counts)
            arrays = tuple(each[chosen] for each in arrays)
        owners, lengths, c = arrays
        self.steps.append((owners, lengths, self._coefficients(c)))

    def _coefficients(self, records: Array) -> Array:
        return coefficients_of(records, len(self.flow.names), self.flow.vector_field.order)

    def path(self, lane: int) -> Trajectory:
        """The steps of a motion up to its event or limit."""
        parts = [(steps[owners == lane], c[owners == lane]) for owners, steps, c in self.steps]
        steps, c = map(np.concatenate, zip(*parts, strict=True))
        begins, end = begins_of_steps(steps, np.array([len(steps)])), self.limit[lane]
        count = max(1, int((begins < end).sum()))
        return Trajectory(np.append(begins[:count], end), c[:count], self.flow.names)

    def _never(self, z: Array) -> Array:
        """Which motions have turned so often that they never have an event."""
        if not self.watch.turns:
            return np.zeros(len(z), bool)
        return z[:, self.flow.stepper(0).places.changes] >= self.watch.most_turns

    def _search_steps(self, lanes: Array, z: Array, found: Array, steps: Watched) -> Array:
        """Use the events in one step of each of the motions `found` with these z after it, searched by halving where
        the kernel does not know them; returns which have none there and continue, with the z where they do."""
        at, lanes = self.flow.stepper(0).places, lanes[found]
        event, rows, signs = steps.events, steps.rows, z[found][:, at.signs][:, : len(self.watch.functions)]
        if (again := event[:, 2] > 0).any():
            some = Watched(*(values[again] for values in steps))
            event[again], rows[again], signs[again] = self._halved(some, lanes[again])
        times = event[:, 0]
        left, soon = times == np.inf, times <= self.limit[lanes]
        self._found(lanes[soon], times[soon], event[soon, 1], rows[soon])
        if not left.any():
            return left
        z[found, at.fresh] = z[found, at.found] = 0.0
        z[found, at.signs.start : at.signs.start + signs.shape[1]] = signs
        never = left & self._never(z[found])
        self.times[lanes[never]] = np.inf
        return left & ~never & (z[found, at.time] < self.limit[lanes])

    def _halved(self, steps: Watched, lanes: Array) -> tuple[Array, Array, Array]:
        """The `Watch.event` of steps in which functions may change their signs several times, or rise, by halving."""
        count, functions = len(steps.begins), self.watch.functions
        c = self._coefficients(steps.coefficients)
        event, signs = np.zeros((count, 3)), np.empty((count, len(functions)))
        event[:, 0] = np.inf
        for number, quantity in enumerate(functions):
            order = (self.orders_of(number)[lanes] * steps.begins[:, 1]).astype(int)
            polynomials = PiecewisePolynomials(quantity.series(c), steps.begins[:, 0], np.ones(count, int))
            owner, _, t = polynomials.first_roots(order, self.watch.rising, steps.signs[:, number])
            sooner = t < event[owner, 0]
            event[owner[sooner], 0], event[owner[sooner], 1] = t[sooner], number
            signs[:, number] = polynomials.after
        rows = evaluate(c, np.where(event[:, 0] < np.inf, event[:, 0], 0.0)[:, None])
        event[:, 0] += steps.begins[:, 2]
        return event, rows, signs

    def _beyond(self, indices: Array, on: OnPieces | None, z: Array) -> None:
        """Search the motions `indices` with these z from a step on that cannot be used. Most of them break off soon or
        end in time, which is determined together."""
        at = self.flow.stepper(0).places
        if len(indices):
            left = ~self._ended(indices, on and on._replace(tables=on.of(indices), numbers=z[:, at.piece]), z)
            indices, z = indices[left], z[left]
        x, began, fresh, turned = (z[:, place] for place in (at.state, at.time, at.fresh, at.changes))
        self.one_by_one(indices, x, began, fresh, turned)

    def _ended(self, indices: Array, on: OnPieces | None, z: Array) -> Array:
        """Whether motions `on` pieces end without an event within the steps of one call of `Flow.run`, which decides it
        in the same way: no step can be used, or all can and the state runs away or the time is over. Stores their
        errors."""
        flow, control, seeds = self.flow, self.flow.control, np.zeros((self.flow.size, 0))
        stepper = flow.stepper(0)
        x, began, fresh = (z[:, getattr(stepper.places, place)] for place in ("state", "time", "fresh"))
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
        for number, quantity in enumerate(self.watch.functions if whole.any() else ()):
            chosen, own = whole[owner], whole.nonzero()[0]
            polynomials = PiecewisePolynomials(quantity.series(c[chosen]), steps[chosen], counts[whole])
            at_start = (self.orders_of(number)[indices[own]] * fresh[own]).astype(int)
            whole[own[polynomials.first_roots(at_start, self.watch.rising)[0]]] = False
        for i in (none | (whole & away)).nonzero()[0].tolist():
            last = ends[i] - 1
            at = (began[i], x[i]) if none[i] else (times[last] + steps[last], found.ends[i])
            kind = RunsAway if whole[i] and steps[last] > control.singular_step else BreaksDown
            what = "breaks down" if none[i] else "runs away"
            self.failed[int(indices[i])] = kind(flow.failure(what, *at)) if self.reasons else BREAKS_OFF
        return none | whole

    def one_by_one(
        self, indices: Array, x: Array, began: Array, fresh: ArrayLike = 1, turned: ArrayLike = 0,
        stops: Sequence[StopTest] = (),
    ) -> None:  # fmt: skip
        """Search the motions `indices` one after the other, from the states `x` at the times `began`, which are `fresh`
        at the very start, and behind which they have `turned` this number of times; with further tests."""
        watch = self.watch
        orders = (self.orders[indices].T * fresh).T.astype(int).tolist()
        left_turns = (watch.most_turns - np.broadcast_to(turned, len(x))).astype(int).tolist()
        for index, start, before, own, turns in zip(indices, x, began, orders, left_turns, strict=True):
            left, zeros = self.limit[index] - before, chain(own, repeat(0))
            tests = [first_zero(each, order, watch.rising) for each, order in zip(watch.functions, zeros, strict=False)]
            stop = FirstOf(*tests, *stops, *([nth_zero(watch.turns[0], turns)] if watch.turns else ()))
            try:
                path, _ = self.flow.run(start, self.ps[index if len(self.ps) > 1 else 0], left, stop=stop)
            except FlowError as error:
                self.failed[int(index)] = error
                continue
            if self.whole:
                self.steps.append((np.full(len(path.steps), index), path.steps, path.coefficients))
            if watch.turns and stop.which == len(stop.tests) - 1:
                self.times[index] = np.inf
            elif stop.which is not None and path.times[-1] < left:
                self._found(np.array([index]), before + path.times[-1], stop.which, path.end[None])
