"""One Taylor step of a flow with its sensitivities in machine code: its series, its length, and its end.

A step on a piece of a piecewise field ends where the piece ends. The coordinate of the pieces is either too near to its
start in the whole step to reach an end, or monotone, so that it reaches one end once: other steps are shortened.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..numerics import TINY, Array
from ..symbolic import Block, Mask, Number, VariationSeries, VectorCode
from .vector_field import TAYLOR, VectorField


class Places(NamedTuple):
    """The layout of z, the state of a motion between two steps; without watched functions it ends with the
    longest step to try."""

    state: slice  # (n,)
    sensitivities: slice  # (n columns,), one column after the other
    signs: slice  # (q,) of the functions, 0 where they begin; they come last
    left: int  # the time left
    longest: int  # the longest step to try
    piece: int  # the number of the piece that the motion is on, see `PieceRows`
    time: int  # the time gone by
    fresh: int  # 1 at the start of a motion, where zeros of the functions are divided out, else 0
    found: int  # whether a function may change its sign in the step before
    changes: int  # how often the last function has changed its sign at the ends of steps


@dataclass(frozen=True)
class PieceRows:
    """The layout of a row of the table of pieces, which a kernel reads in each step: the ends of the piece, its data
    (nq,), those of the pieces below and above it, and the derivatives of ends and data along `columns`.

    The pieces are numbered from 1; the rows before the first piece and behind the last one are NaN.
    """

    data: int
    columns: int

    @property
    def varied(self) -> bool:
        """Whether ends and data vary."""
        return self.columns > 0

    @property
    def width(self) -> int:
        """The length of a row."""
        return 2 + 3 * self.data + self.columns * (2 + self.data)

    def split(self, row: Any) -> tuple[list[Any], list[tuple[Any, Any]]]:
        """The ends (2,), the data (nq,) of the piece, of that below and that above it; and the derivatives (2,) and
        (nq,) along each column."""
        first = [0, 2, *(2 + k * self.data for k in (1, 2, 3))]
        begins = [first[-1] + k * (2 + self.data) for k in range(self.columns)]
        moves = [(row[begin : begin + 2], row[begin + 2 : begin + 2 + self.data]) for begin in begins]
        return [row[begin:end] for begin, end in pairwise(first)], moves

    def tables(self, breaks: Array, data: Array, moves: Array) -> Array:
        """The tables (m, rows width) of pieces between breaks (m, k + 1) with data (m, k, nq), whose derivatives are
        those of the breaks and data together, (m, k + 1 + k nq, columns)."""
        m, (_, k, nq) = max(len(data), len(moves)), data.shape
        breaks, data = np.broadcast_to(breaks, (m, k + 1)), np.broadcast_to(data, (m, k, nq))
        around = np.pad(data, ((0, 0), (1, 1), (0, 0)), "edge")
        rows = [breaks[:, :-1, None], breaks[:, 1:, None], data, around[:, :-2], around[:, 2:]]
        if self.varied:
            by_breaks, by_data = np.split(moves, [k + 1], axis=1)
            ends = np.stack([by_breaks[:, :-1], by_breaks[:, 1:]], axis=2)
            of_pieces = np.concatenate([ends, by_data.reshape(m, k, nq, -1)], axis=2)
            rows.append(of_pieces.swapaxes(2, 3).reshape(m, k, -1))
        beyond = (0, 0), (1, 1), (0, 0)
        return np.pad(np.concatenate(rows, axis=2), beyond, constant_values=np.nan).reshape(m, -1)


class Step(NamedTuple):
    """A step in the code of a kernel: z after it up to the piece, the coefficients of states and watched quantities,
    the lengths taken and tried, and whether all coefficients are finite."""

    after: list[str]
    rows: Block
    series: "StepSeries"
    taken: Number
    tried: Number
    finite: Mask


class TaylorStep:
    """The code of a step from z, the data (parameters, and seeds of the varied parameters, one column after the other)
    and the row of the piece; z after a step that is rejected is that before it, with a shorter longest step."""

    def __init__(self, graph: VectorField, at: Places, columns: int, varied: tuple[int, ...], piece_rows: PieceRows):
        self.graph, self.at, self.columns, self.varied, self.piece_rows = graph, at, columns, varied, piece_rows
        self.count_p = graph.p.numel() - graph.data  # the number of parameters
        self.own = sum(row < self.count_p for row in varied)
        self.series = VariationSeries(graph.field, varied, columns, graph.order)
        symbols = [graph.x, graph.p]
        self.rates = ca.Function("rates", symbols, [ca.densify(graph.field(*symbols)[0])])
        self.reaches = [
            (weights.sparsity().get_triplet()[1], ca.Function("reach", symbols, [ca.SX(weights.nz[:]), *change]))
            for weights, change in graph.reaches
        ]
        if graph.coordinate:
            self.scales = ca.Function("scales", [graph.p], [graph.unit, graph.origin])
            self.saltation = _saltation(graph, columns, varied)

    def append(self, code: VectorCode, z: Sequence[str], data: Sequence[str], row: Sequence[str]) -> Step:
        """Append its code."""
        at, graph, n = self.at, self.graph, self.graph.size
        (ends, q, below, above), moves = self.piece_rows.split(row)
        x, dx, p, own = z[at.state], z[at.sensitivities], [*data[: self.count_p], *q], data[self.count_p :]
        moved_data = [each for _, each in moves] or [[]] * self.columns
        dp = [each for c, moved in enumerate(moved_data) for each in (*own[c * self.own :][: self.own], *moved)]
        found = self.series.append(code, x, p, dx, dp)
        left, longest = Number(code, z[at.left]), Number(code, z[at.longest])
        c = StepSeries(code, found.rows.place, n + graph.field.numel_out(1), graph.order)
        size, *terms = c.sizes(n)
        h = longest.least(_truncated_length(graph.order, size, *terms))
        # The series of f_p may have a smaller radius of convergence than that of f, as may that of f_x along a motion
        # that a symmetry makes simple.
        if self.varied or (self.columns and graph.has_many_products):
            changes = _largest(code, dp) if self.varied else 0.0
            scale, *terms = StepSeries(code, found.columns, n * self.columns, graph.order).sizes(n * self.columns)
            h = h.least(_truncated_length(graph.order, scale + changes, *terms))
        for states, function in self.reaches:
            weights, *room = code.graph(function, [x, p])
            h = c.within_reach([*zip(states, weights, strict=True)], [Number(code, each) for (each,) in room], h)
        h = (h >= left).choose(left, (h * TAYLOR.shared_steps >= left).choose(left * 0.5, h))
        side, within = Number(code, code.splat(0)), None
        if graph.coordinate:
            unit, origin = (Number(code, each) for (each,) in code.graph(self.scales, [p]))
            c.set_places(graph.coordinate, unit, origin)
            h, within, side = c.on_piece(h, *(Number(code, each) for each in ends))
        size = size.largest(TINY)  # The size of a motion at rest at the origin would be 0.
        defect, after = self._defect(c, h, p)
        accepted = defect <= size * TAYLOR.largest_defect
        accepted = accepted & within if within else accepted
        # A step that is far too long for the rate of the state is shortened in one go instead of halved many times.
        speed = _largest(code, [c.coefficient(i, 1).name for i in range(n)])
        shorter = h.least((h * size / speed).root()) * 0.5
        after += [each() for each in self.series.columns_after(code, found, h.name)]
        if self.columns and graph.coordinate:
            after[n:] = self._beyond(code, after, p, [*zip(below, above, strict=True)], dp, moves, side)
        pairs = zip(after, (*x, *dx), strict=True)
        taken = accepted.choose(h, 0.0)
        made = taken > 0.0
        new = [made.choose(*(Number(code, each) for each in pair)) for pair in pairs]
        new += [left - taken, accepted.choose(TAYLOR.longest_step, shorter)]
        new.append(Number(code, z[at.piece]) + made.choose(side, 0.0))
        return Step([each.name for each in new], found.rows, c, taken, h, abs(c.total()) < np.inf)

    def _beyond(
        self, code: VectorCode, after: Sequence[str], p: list[str], sides: list[tuple], dp: list[str], moves: list,
        side: Number,
    ) -> list[str]:  # fmt: skip
        """The sensitivities (n columns,) beyond the end of the piece, by the saltation there."""
        above = side > 0.0
        beyond, by_end = (
            [above.choose(Number(code, high), Number(code, low)).name for low, high in pairs]
            for pairs in (sides, [ends for ends, _ in moves] or [(code.splat(0),) * 2] * self.columns)
        )
        n, known = self.graph.size, [*p[: self.count_p], *beyond]
        return code.graph(self.saltation, [after[:n], p, known, after[n:], dp, by_end, [side.name]])[0]

    def _defect(self, c: "StepSeries", h: Number, p: list[str]) -> tuple[Number, list[str]]:
        """The largest defect of the polynomial in the differential equation at the quarters of the step, times its
        length, and the state at its end.

        It shows what a series cannot show where a law is flat to the last digit, as a saturated spring is.
        """
        code, n = c.code, self.graph.size
        # A state whose rate is another state has no defect.
        rates = ca.vertsplit(self.graph.field(self.graph.x, self.graph.p)[0])
        checked = [i for i, rate in enumerate(rates) if not rate.is_symbolic()]
        parts, ends = code.table(TAYLOR.measured), code.reserve(n)

        def part(index: str, worst: list[str]) -> list[str]:
            time = h * Number(code, code.get(code.offset(code.place(parts), index)))
            states, slopes = c.evaluate(n, time, checked)
            rates, total = code.graph(self.rates, [[each.name for each in states], p])[0], Number(code, worst[0])
            for i, slope in zip(checked, slopes, strict=True):
                total = total.largest(abs((slope - Number(code, rates[i])) * h))
            for i, state in enumerate(states):
                code.put(state.name, code.place(ends + i))
            return [total.name]

        (worst,) = code.loop(0, len(TAYLOR.measured) - 1, part, [code.splat(0)])
        return Number(code, worst), [code.get(code.place(ends + i)) for i in range(n)]


class StepSeries:
    """Polynomials of a step in the scratch memory of a code, as many rows as there are."""

    def __init__(self, code: VectorCode, first: int, rows: int, order: int):
        self.code, self.first, self.rows, self.order, self.stride = code, first, rows, order, order + 2
        self.places = code.reserve(self.stride)  # of the coordinate of the pieces

    @classmethod
    def of(cls, code: VectorCode, coefficients: Block, rows: int) -> "StepSeries":
        """The polynomials with these coefficients, one row after the other."""
        series = cls(code, coefficients.place, rows, coefficients.count // rows - 1)
        series.stride = series.order + 1
        return series

    def coefficient(self, row: int, k: int) -> Number:
        """A coefficient."""
        return self.at(self.first + row * self.stride, k)

    def at(self, place: int, k: int | str, scale: int = 1) -> Number:
        """Coefficient k of the series at a place, or scale k of those after it."""
        code = self.code
        pointer = code.place(place)
        return Number(code, code.get(code.moved(pointer, k) if isinstance(k, int) else code.offset(pointer, k, scale)))

    def weighted(self, weights: Sequence[tuple[int, str]], k: int | str) -> Number:
        """Coefficient k of the sum of rows with weights."""
        total = Number(self.code, self.code.splat(0))
        for row, weight in weights:
            total = Number(self.code, weight).times_plus(self.at(self.first + row * self.stride, k), total)
        return total

    def value_and_slope(self, place: int, time: Number, low: int = 0) -> tuple[Number, Number]:
        """The polynomial with the coefficients at a place from `low` on at a time, divided by its power `low`, and the
        derivative of that by the time."""

        def term(k: str, sums: list[Number]) -> list[Number]:
            return [sums[0].times_plus(time, self.at(place, k)), sums[1].times_plus(time, sums[0])]

        value, slope = self.horner(low, term, 2)
        return value, slope

    def sum(
        self, last: int, term: Callable[[str, list[Number]], list[Number]], count: int, first: int = 0
    ) -> list[Number]:
        """What `count` numbers that begin with 0 become by terms from `first` to `last`."""
        code = self.code

        def body(index: str, before: list[str]) -> list[str]:
            return [each.name for each in term(index, [Number(code, each) for each in before])]

        return [Number(code, each) for each in code.loop(first, last, body, [code.splat(0)] * count)]

    def horner(self, low: int, term: Callable[[str, list[Number]], list[Number]], count: int) -> list[Number]:
        """`sum` from the highest order down to `low`."""
        code, order = self.code, self.order
        return self.sum(order - low, lambda index, before: term(code.integer("sub", order, index), before), count)

    def total(self) -> Number:
        """The sum of all coefficients, which is not finite where one is not."""
        size = self.order + 1

        def term(k: str, totals: list[Number]) -> list[Number]:
            return [each + self.at(self.first + i * self.stride, k) for i, each in enumerate(totals)]

        totals = self.sum(size - 1, term, self.rows)
        return reduce(lambda a, b: a + b, totals)

    def sizes(self, count: int) -> tuple[Number, Number, Number]:
        """The largest of the first two coefficients of the first rows of this number, of the last but one and of the
        last."""
        order, stride = self.order, self.stride

        def term(row: str, before: list[Number]) -> list[Number]:
            first, second, third, last = (abs(self.at(self.first + k, row, stride)) for k in (0, 1, order - 1, order))
            return [before[0].largest(first, second), before[1].largest(third), before[2].largest(last)]

        scale, third, last = self.sum(count - 1, term, 3)
        return scale, third, last

    def evaluate(self, count: int, time: Number, checked: Sequence[int]) -> tuple[list[Number], list[Number]]:
        """The first rows of this number at a time, and the slopes of some of them."""

        def term(k: str, before: list[Number]) -> list[Number]:
            values = before[:count]
            slopes = [slope.times_plus(time, values[i]) for i, slope in zip(checked, before[count:], strict=True)]
            own = (self.at(self.first + i * self.stride, k) for i in range(count))
            return [*(value.times_plus(time, each) for value, each in zip(values, own, strict=True)), *slopes]

        found = self.horner(0, term, count + len(checked))
        return found[:count], found[count:]

    def terms(self, weights: list[tuple[int, str]], offset: str, h: Number, head: int) -> tuple[list[str], list[str]]:
        """The first terms of an affine function of the rows in a step, `head` of them; and the sum of those behind the
        bound degree and that of their sizes."""

        def term(k: str, sums: list[Number]) -> list[Number]:
            own = self.weighted(weights, k)
            return [sums[0].times_plus(h, own), sums[1].times_plus(h, abs(own))]

        degree = TAYLOR.bound_degree
        powers = [*accumulate([h] * max(head, degree + 1), lambda power, h: power * h)]  # from the first on
        first = [self.weighted(weights, 0) + Number(self.code, offset)]
        first += [self.weighted(weights, k) * powers[k - 1] for k in range(1, head)]
        rest = [each * powers[degree] for each in self.horner(degree + 1, term, 2)]
        return [each.name for each in first], [each.name for each in rest]

    def within_reach(self, weights: list[tuple[int, str]], change: list[Number], h: Number) -> Number:
        """The length of a step, at most h, in which a coordinate, the sum of rows with these weights, changes no more
        than this to either side from its start."""
        longest = h

        def moves(k: str | int, sign: float) -> Number:
            return self.weighted(weights, k) * sign

        def later_terms(h: Number, sign: float, k: str, sums: list[Number]) -> list[Number]:
            return [sums[0].times_plus(h, moves(k, sign).largest(0.0))]

        for farthest, sign in zip(change, (-1.0, 1.0), strict=True):
            # The terms after the first that lead to this side bound the change: it is a convex function of the length,
            # by the speed and the acceleration alone and by all terms.
            speed, later, distance = moves(1, sign), moves(2, sign).largest(0.0), farthest.least(TAYLOR.unbounded)
            h = h.least(distance * 2 / (speed + (speed * speed + later * distance * 4).root()))
            (rest,) = self.horner(2, partial(later_terms, h, sign), 1)
            moved = h * rest.times_plus(h, speed)
            h = h * (moved > distance).choose(distance / moved, 1.0)
        return h.largest(longest.least(TAYLOR.shortest_bound))

    def set_places(self, coordinate: Sequence[float], unit: Number, origin: Number) -> None:
        """Store the series of the coordinate of the pieces."""
        code = self.code
        weights = [(i, code.splat(weight)) for i, weight in enumerate(coordinate) if weight]

        def order(k: str, _: list[str]) -> list[str]:
            code.put((self.weighted(weights, k) * unit).name, code.offset(code.place(self.places), k))
            return []

        code.loop(0, self.order, order)
        code.put((self.at(self.places, 0) - origin).name, code.place(self.places))

    def on_piece(self, h: Number, low: Number, high: Number) -> tuple[Number, Mask, Number]:
        """The length of a step, at most h, in which the coordinate stays between two ends, whether it does so, and the
        side on which it reaches an end, 0 for none.

        The coordinate stays away from both ends, or its first term that is more than rounding outweighs the others, so
        that it is monotone and its end shows whether it has reached an end of the piece.
        """
        code, start = self.code, self.at(self.places, 0)
        room, first, second = (high - start).least(start - low), self.at(self.places, 1), self.at(self.places, 2)

        def try_length(tried: Number) -> tuple[Mask, Mask]:
            """Whether a length is valid, and whether the first term outweighs the others."""

            def term(k: str, sums: list[Number]) -> list[Number]:
                size = abs(self.at(self.places, k))
                order = Number(code, code.get(code.offset(code.place(orders), k)))
                return [sums[0].times_plus(tried, size), sums[1].times_plus(tried, size * order)]

            cube = tried * tried * tried
            sums, weighted = (each * cube for each in self.horner(3, term, 2))
            moves = abs(first) * tried, abs(second) * tried * tried
            steep = (moves[1] * 2 + weighted) * 2 <= moves[0]
            flat = weighted * 2 <= moves[1] * 2
            rounded = moves[0] * moves[0] <= moves[1] * TAYLOR.rounded_change * (abs(start) + moves[1])
            return (moves[0] + moves[1] + sums < room) | steep | (rounded & flat), steep

        orders = code.table([float(k) for k in range(self.order + 2)])
        valid, steep = try_length(h)
        values = [h, steep.choose(1.0, 0.0), valid.choose(1.0, 0.0)]
        halvings = code.if_any((~valid).name, TAYLOR.tried_lengths - 1)

        def halve(_: str, before: list[str]) -> list[str]:
            length, was_steep, within = (Number(code, each) for each in before)
            done = within > 0.0
            tried = done.choose(length, length * 0.5)
            valid, steep = try_length(tried)
            new = done.choose(was_steep, steep.choose(1.0, 0.0)), done.choose(1.0, valid.choose(1.0, 0.0))
            return [each.name for each in (tried, *new)]

        found = code.loop(1, halvings, halve, [each.name for each in values])
        length, is_steep, is_within = (Number(code, each) for each in found)
        move = self.value_and_slope(self.places, length, 1)[0] * length
        inside, end = is_within > 0.0, start + move
        rises, falls = inside & (move > 0.0) & (end >= high), inside & (move < 0.0) & (end <= low)
        side = rises.choose(1.0, falls.choose(-1.0, 0.0))
        distance = rises.choose(high, low) - start
        share = distance / move
        share = (is_steep > 0.0).choose(share, share.root())

        def newton(_: str, before: list[str]) -> list[str]:
            going, share = (Number(code, each) for each in before)
            time = share * length
            value, slope = self.value_and_slope(self.places, time, 1)
            value, slope = value * time - distance, slope.times_plus(time, value) * length
            new = (share - value / slope).largest(TAYLOR.shortest_cut).least(1.0)
            # What one lane does must not depend on the others: a share that is settled stays.
            new = (going > 0.0).choose(new, share)
            return [(abs(new - share) > new * TAYLOR.settled_share).choose(1.0, 0.0).name, new.name]

        ends_there = rises | falls
        begin = [ends_there.choose(1.0, 0.0).name, share.name]
        last = code.if_any(ends_there.name, TAYLOR.steps_to_end)
        _, cut = code.loop(1, last, newton, begin, while_first=True)
        return length * ends_there.choose(Number(code, cut), 1.0), inside, side


def _largest(code: VectorCode, values: Sequence[str]) -> Number:
    """The largest size of some values."""
    first, *others = [abs(Number(code, each)) for each in values]
    return first.largest(*others)


def _truncated_length(order: int, scale: Number, before: Number, last: Number) -> Number:
    """The step at which the last two terms of series of these sizes vanish compared with `scale`, by Jorba and Zou
    (2005), the source of `taylor_series`."""
    code, bound = scale.code, scale * TAYLOR.truncation
    sizes = ((bound / each, code.splat(1 / k)) for each, k in ((before, order - 1), (last, order)))
    one, other = (Number(code, code.rough_power(size.name, power)) for size, power in sizes)
    return one.least(other)


def _saltation(graph: VectorField, columns: int, varied: tuple[int, ...]) -> ca.Function:
    """(state at the end of a piece, p there and beyond it, sensitivities (n columns,), those of p, those of the end
    (columns,), side) -> the sensitivities beyond the end; unchanged where the side is 0."""
    n, x, p, side, beyond = graph.size, graph.x, graph.p, ca.SX.sym("side"), ca.SX.sym("beyond", graph.p.numel())
    moved, by_end, dp = ca.SX.sym("dx", n, columns), ca.SX.sym("de", columns), ca.SX.sym("dp", len(varied), columns)
    before, after, weights = graph.field(x, p)[0], graph.field(x, beyond)[0], ca.DM(graph.coordinate)
    place = ca.dot(weights, x) * graph.unit - graph.origin
    changes = ca.jacobian(place, x) @ moved + ca.jacobian(place, p)[:, list(varied)] @ dp - by_end.T
    earlier = changes / (ca.jacobian(place, x) @ before)
    jump = ca.if_else(side == 0, 0, (after - before) @ earlier)
    arguments = [x, p, beyond, ca.vec(moved), ca.vec(dp), by_end, side]
    return ca.Function("saltation", arguments, [ca.densify(ca.vec(moved + jump))])
