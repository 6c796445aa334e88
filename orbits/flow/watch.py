"""Watched quantities of motions: the zeros of affine functions of the rows, found in the kernel that takes the
steps."""

from collections.abc import Sequence
from functools import partial
from math import comb
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..model import Affine
from ..numerics import HIGHEST_ORDER, NEGLIGIBLE, ROOTS, TINY, Array, bernstein_coefficients
from ..symbolic import Kernel, Mask, Number, VectorCode, cached
from .phase_field import PhaseField
from .taylor import TaylorStepper
from .taylor_step import StepSeries
from .vector_field import FLOW_CONTROL, TAYLOR, rows_used

# The first terms of a watched function, which are bounded together.
HEAD = TAYLOR.bound_degree + 1


class Watched(NamedTuple):
    """Steps (N,) of motions that are watched, with the lengths, whether they are the first, and the times and changes
    of `Places` before them, and the signs there; and the first events in them: times since the start, infinite where
    there is none, numbers of the functions, and whether neither is known; and the rows there."""

    coefficients: Array  # (N, size), as `coefficients_of` takes them
    begins: Array  # (N, 4)
    signs: Array  # (N, q)
    events: Array  # (N, 3)
    rows: Array  # (N, rows)


class Watch:
    """What the motions of a flow are watched for: the zeros of affine functions of the rows.

    functions : those whose zeros are events
    opening : the first functions of this number may have zeros at the start of a motion
    turns : another function and a number: a motion on which that function has changed its sign so often has no event
    rising : only the changes from minus to plus are events
    """

    def __init__(
        self, flow: PhaseField, functions: Sequence[Affine], opening: int = 1, turns: tuple[Affine, int] | None = None,
        rising: bool = False,
    ):  # fmt: skip
        self.functions, self.turns, self.rising, self.opening = functions, turns, rising, opening
        own = [*functions, turns[0]] if turns else functions
        self.size, self.most_turns = len(own), turns[1] if turns else 0
        self.weights, self.offsets = np.zeros((len(own), len(flow.names))), np.zeros(len(own))
        for i, each in enumerate(own):
            self.weights[i, : len(each.weights)], self.offsets[i] = each.weights, each.offset
        self.used = tuple(rows_used(row[:, None]) for row in self.weights)
        self._tests = np.concatenate([self.weights.ravel(), self.offsets])

    def data(self, p: Array, limits: Array, orders: Array, all_steps: bool = False) -> Array:
        """The data of motions with parameters (m, np) or (1, np), to time limits (m,), at whose starts the functions
        that open have zeros of these orders (m, opening)."""
        count, end = p.shape[1], p.shape[1] + len(self._tests)
        found = np.empty((len(limits), end + self.opening + 2))
        found[:, :count], found[:, count:end], found[:, end:-2] = p, self._tests, orders
        found[:, -2], found[:, -1] = limits, all_steps
        return found

    def follow(
        self, stepper: TaylorStepper, z: Array, data: Array, tables: Array | None, most: int = 1
    ) -> tuple[Array, Watched, Array, Array]:
        """Motions until an event, or until their times reach their limits.

        z, data : of each motion, as `TaylorStepper.watched_state` and `data` make them
        tables : of `OnPieces`, None for a smooth field
        most : number of steps, where all are recorded; else the steps alone are recorded in which an event is found or
            may be, and the first ends the motion

        Returns z when each has ended; the steps that are recorded; the number (m,) of these of each motion; and whether
        it would continue (m,), after the last record or after the most steps.
        """
        kernel = _watching_kernel(stepper, self.used, self.opening, self.most_turns, self.rising)
        z, records, counts, going = kernel(z, data, *(() if tables is None else (tables,)), most=most)
        return z, Watched(*records), counts, going


@cached
def _watching_kernel(
    stepper: TaylorStepper, used: tuple[tuple[int, ...], ...], opening: int, turns: int, rising: bool
) -> Kernel:
    """The kernel of `Watch.follow` with functions of the rows `used`. Where a function may change its sign in a step,
    by Bernstein exclusion, its first root is searched there; where it changes it several times, and where only rising
    ones count, this is left to the caller."""
    at, rows, size, count = stepper.places, stepper.rows, len(used), stepper.sizes[1]
    may_change, events = may_change_sign(size, opening, turns > 0), size - (turns > 0)

    def append(code: VectorCode, arguments: Sequence) -> list:
        z, data, *row = arguments
        number = partial(Number, code)
        moved = stepper.motion(code, z[: at.time], data[:count], *row)
        tests, orders, (limit, all_steps) = data[count : -2 - opening], data[-2 - opening : -2], map(number, data[-2:])
        tested, terms = [], list[list[str]]()
        for i, own in enumerate(used):
            tested.append(([(place, tests[i * rows + place]) for place in own], tests[size * rows + i]))
            terms += moved.series.terms(*tested[-1], moved.tried, HEAD + HIGHEST_ORDER * (i < opening))
        before, fresh, time = z[at.signs], number(z[at.fresh]), number(z[at.time])
        (change,), signs, (turned,) = code.graph(may_change, [*terms, [fresh.name], orders, before])
        largest = abs(number(moved.after[0])).largest(*(abs(number(each)) for each in moved.after[1 : stepper.n]))
        inside = moved.counts & (largest < FLOW_CONTROL.runaway)
        found, length = inside & (number(change) > 0.0), number(moved.length[0])
        search = _EventSearch(
            moved.series, [(*own, sign) for own, sign in zip(tested[:events], before, strict=False)], orders, fresh
        )
        event = search.append(length, found, signs[:events]) if not rising else _unknown(code, rows, signs[:events])
        first, which, unknown, there, ends = event
        found = found & ((first < np.inf) | (unknown > 0.0))
        new_time, changes = time + length, number(z[at.changes]) + number(turned)
        signs = [each.name for each in ends] + signs[events:]
        new = [*moved.after, new_time.name, code.splat(0), found.value(), changes.name, *signs]
        # A motion that runs away stays where it was, so that it can be followed from there alone.
        stays = [*z[: at.left], *moved.after[at.left : at.piece], *z[at.piece :]]
        new = [inside.choose(number(each), number(old)).name for each, old in zip(new, stays, strict=True)]
        goes = moved.goes & ~found & (number(new[at.time]) < limit)
        goes = goes & (moved.tried > time * FLOW_CONTROL.shortest_step)
        if turns:
            goes = goes & (number(new[at.changes]) < turns)
        recorded = inside & (found | (all_steps > 0.0))
        begins, events_of = [length, fresh, time, number(z[at.changes])], [time + first, which, unknown]
        records = [[each.name for each in part] for part in (begins, events_of, there)]
        return [new, moved.rows, records[0], before, *records[1:], [recorded.value()], [goes.value()]]

    z_size = at.signs.start + size
    sizes = [z_size, count + size * (rows + 1) + opening + 2, *stepper.sizes[2:]]
    return stepper.kernel_of(append, sizes, [z_size, stepper.recorded, 4, size, 3, rows, 1, 1])


def _unknown(code: VectorCode, rows: int, signs: Sequence[str]) -> tuple:
    """What `_EventSearch.append` returns where the caller searches."""
    zero = Number(code, code.splat(0))
    return zero + np.inf, zero, zero + 1.0, [zero] * rows, [Number(code, each) for each in signs]


class _EventSearch:
    """The code of the search for the first zero of some functions in a step.

    tested : of each function its weights by row, its offset, and its sign before, 0 where the motion begins
    orders : of the zeros at the start of the functions that open, divided out where the motion is `fresh`
    """

    def __init__(self, series: StepSeries, tested: list, orders: Sequence[str], fresh: Number):
        self.series, self.code, self.tested, self.orders, self.fresh = series, series.code, tested, orders, fresh
        # Of the function its series, and its Bernstein coefficients.
        self.own, self.bernstein = (series.code.reserve(series.order + 2 + HIGHEST_ORDER) for _ in range(2))

    def append(self, h: Number, wanted: Mask, signs: Sequence[str]) -> tuple:
        """The time of the first zero in a step of length h, infinite where there is none, the number of its function,
        whether neither is known, the rows there, and the signs at the end of the step; nothing is searched where no
        lane is `wanted`, and `signs` are those at the end."""
        code = self.code

        def search(_: str, before: list[str]) -> list[str]:
            first, which, unknown = (Number(code, each) for each in before[:3])
            ends = []
            for i, (weights, offset, sign) in enumerate(self.tested):
                self._store(weights, offset, i)
                root, end, several = self._first_root(h, Number(code, sign))
                which, first = (root < first).choose(float(i), which), root.least(first)
                unknown = unknown.largest(several.choose(1.0, 0.0))
                ends.append(wanted.choose(end, Number(code, signs[i])))
            first = wanted.choose(first, np.inf)
            there = self.series.evaluate(self.series.rows, (first < np.inf).choose(first, 0.0), [])[0]
            return [each.name for each in (first, which, unknown, *there, *ends)]

        start = [code.splat(np.inf), code.splat(-1), *[code.splat(0)] * (1 + self.series.rows), *signs]
        first, which, unknown, *rest = (Number(code, each) for each in code.once(wanted.name, search, start))
        return first, which, unknown, rest[: self.series.rows], rest[self.series.rows :]

    def _store(self, weights: list[tuple[int, str]], offset: str, number: int) -> None:
        """Store the series of a function, divided by the power of its zero at the start."""
        code, order = self.code, self.series.order

        def each(k: str, _: list[str]) -> list[str]:
            code.put(self.series.weighted(weights, k).name, code.offset(code.place(self.own), k))
            return []

        code.loop(0, order, each)
        code.put((Number(code, offset) + self._at(self.own, 0)).name, code.place(self.own))
        for extra in range(1, 1 + HIGHEST_ORDER):
            code.put(code.splat(0), code.place(self.own + order + extra))
        if number >= len(self.orders):
            return
        zeros = self.fresh * Number(code, self.orders[number])

        def shift(k: str, _: list[str]) -> list[str]:
            value = self._at(self.own, k)
            for skipped in range(1, 1 + HIGHEST_ORDER):
                value = (zeros >= float(skipped)).choose(self._at(self.own + skipped, k), value)
            code.put(value.name, code.offset(code.place(self.own), k))
            return []

        code.loop(0, order, shift)

    def _at(self, place: int, k: str | int) -> Number:
        return self.series.at(place, k)

    def _first_root(self, h: Number, before: Number) -> tuple[Number, Number, Mask]:
        """The first root on [0, h] of the stored polynomial, infinite where there is none; its sign at h; and whether
        neither is known, since the Bernstein coefficients have several changes of sign, or Newton's method does not
        settle. The polynomial has the sign before, which is 0 where it begins."""
        code, order = self.code, self.series.order
        self._store_bernstein(h)
        start = self._at(self.bernstein, 0)
        start = (abs(before) > 0.0).choose(before * abs(start).largest(TINY), start)
        code.put(start.name, code.place(self.bernstein))

        def look(j: str, sums: list[str]) -> list[str]:
            """Count the changes of sign, and see where the polygon of the coefficients crosses zero."""
            changes, about = (Number(code, each) for each in sums)
            one, other = self._at(self.bernstein, j), self._at(self.bernstein + 1, j)
            changed = ((one >= 0.0) & (other < 0.0)) | ((one < 0.0) & (other >= 0.0))
            place = (self._at(orders, j) + one / (one - other)) * (1 / order)
            return [(changes + changed.choose(1.0, 0.0)).name, changed.choose(place, about).name]

        orders = code.table([float(k) for k in range(order + 2)])
        changes, about = (Number(code, each) for each in code.loop(0, order - 1, look, [code.splat(0)] * 2))
        rises = (self._at(self.bernstein, order) >= 0.0).choose(1.0, -1.0)
        zero = Number(code, code.splat(0))
        one = (changes > 0.5) & (changes < 1.5)
        z = one.choose(1.0, 0.0), about * h, zero, h, zero

        def refine(_: str, found: list[str]) -> list[str]:
            going, t, low, high, last = numbers = [Number(code, each) for each in found]
            after = self._refined(t, low, high, last, rises)
            return [(going > 0.0).choose(new, old).name for old, new in zip(numbers, after, strict=True)]

        found = code.loop(1, ROOTS.steps_in_kernel, refine, [each.name for each in z], while_first=True)
        unsettled, root = Number(code, found[0]) > 0.0, Number(code, found[1])
        return (changes > 0.5).choose(root, np.inf), rises, (changes > 1.5) | unsettled

    def _store_bernstein(self, h: Number) -> None:
        """Store the Bernstein coefficients on [0, h] of the stored polynomial, by differences."""
        code, order, place = self.code, self.series.order, self.bernstein
        shares = code.table([1 / comb(order, k) for k in range(order + 1)])

        def scale(k: str, power: list[str]) -> list[str]:
            value = self._at(self.own, k) * self._at(shares, k) * Number(code, power[0])
            code.put(value.name, code.offset(code.place(place), k))
            return [(Number(code, power[0]) * h).name]

        code.loop(0, order, scale, [code.splat(1)])

        # After round j the first j + 1 are the coefficients, and the others the differences that are left.
        def rounds(j: str, _: list[str]) -> list[str]:
            def add(i: str, last: list[str]) -> list[str]:
                pointer = code.offset(code.place(place), i)
                value = code.get(pointer)
                code.put(code.plus(value, last[0]), pointer)
                return [value]

            pointer = code.offset(code.place(place - 1), j)
            code.loop(j, order, add, [code.get(pointer)])
            return []

        code.loop(1, order, rounds)

    def _refined(self, t: Number, low: Number, high: Number, last: Number, rises: Number) -> tuple[Number, ...]:
        """Whether a root is not yet known, the root, its bracket, and the size of the last step of Newton's method,
        after one step of this method, or bisection where that leads out of the bracket."""
        value, slope = self.series.value_and_slope(self.own, t)
        above = rises * value >= 0.0
        low, high = above.choose(low, t), above.choose(t, high)
        new = (abs(slope) > 0.0).choose(t - value / slope, low)
        step = abs(new - t)
        ratio = step / last
        settled = (last > 0.0) & (step * (ratio * ratio) <= high * NEGLIGIBLE)
        settled = settled | (step.least(high - low) <= high * ROOTS.closed)
        inside = (low < new) & (new < high)
        found = settled.choose(new.largest(low).least(high), inside.choose(new, (low + high) * 0.5))
        return settled.choose(0.0, 1.0), found, low, high, inside.choose(step, 0.0)


@cached
def may_change_sign(size: int, opening: int, counts: bool) -> ca.Function:
    """(of each of the functions the first terms in a step, and the sums of the others and of their sizes; whether the
    motion begins; the orders of zeros at the start, and signs (size,) before) -> whether a function may change its sign
    in the step, the signs after it, and whether that of the last has changed. With `counts` the last function may
    change it, else this is not checked.

    A polynomial has no zero where the Bernstein coefficients of its first terms have one sign and are larger than the
    sum of the other terms; the sign at the start is that at the end of the step before. The first of these coefficients
    may be smaller: the other terms are at most their sum times t, and the first terms at least that much, if the value
    at the start has the same sign.
    """
    fresh, orders, before = ca.SX.sym("fresh"), ca.SX.sym("o", opening), ca.SX.sym("s", size)
    heads, rests = list[ca.SX](), list[ca.SX]()
    change, after, turned = ca.SX(0), [], ca.SX(0)
    for i in range(size):
        head, rest = ca.SX.sym("head", HEAD + HIGHEST_ORDER * (i < opening)), ca.SX.sym("rest", 2)
        heads.append(head)
        rests.append(rest)
        order, kept, start = fresh * orders[i] if i < opening else 0, ca.SX(head), head[:HEAD]
        for skipped in range(1, head.numel() - HEAD + 1):
            start = ca.if_else(order >= skipped, head[skipped : skipped + HEAD], start)
            kept[skipped - 1] = ca.if_else(order >= skipped, 0, head[skipped - 1])
        ends = ca.sum1(kept[:HEAD]) + rest[0]
        begins = ca.if_else(before[i] == 0, start[0], before[i]) >= 0
        after.append(ca.if_else(ends >= 0, 1.0, -1.0))
        if counts and i == size - 1:
            turned = begins != (ends >= 0)
            continue
        bounds = ca.vertcat(*bernstein_coefficients(start, ca.SX.ones(start.numel()))[1:], ends)
        same = ca.if_else(begins, ca.mmin(bounds) >= rest[1], ca.mmax(bounds) < -rest[1])
        change = ca.logic_or(change, ca.logic_not(ca.logic_and(same, ca.fabs(ends) < np.inf)))
    arguments = [each for pair in zip(heads, rests, strict=True) for each in pair]
    results = [change, ca.densify(ca.vertcat(*after)), turned]
    return ca.Function("signs", [*arguments, fresh, orders, before], results)
