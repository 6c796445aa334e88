"""One Taylor step of a flow with its sensitivities, as a graph: its series, its length, and what comes after it.

A step on a piece of a piecewise field ends where the piece ends. The coordinate of the pieces is either too near to its
start in the whole step to reach an end, or monotone, so that it reaches one end once: other steps are shortened.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..numerics import TINY, Array
from ..symbolic import Room, cached, driven_coefficients, tangent, variations
from .vector_field import TAYLOR, VectorField, symbolic_powers


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

    def split(self, row: ca.MX) -> list[ca.MX]:
        """The ends (2,), the data (nq,) of the piece, of that below and that above it, and the derivatives
        (columns, 2) and (columns, nq)."""
        first = [0, 2, *(2 + k * self.data for k in (1, 2, 3))]
        parts = [row[begin:end] for begin, end in pairwise(first)]
        moves = ca.reshape(row[first[-1] :], 2 + self.data, self.columns).T
        return [*parts, moves[:, :2], moves[:, 2:]]

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


class _NoPieces(PieceRows):
    """Of a field that is smooth everywhere."""

    width = 0

    def split(self, row: ca.MX) -> list[ca.MX]:
        """Nothing."""
        return [ca.MX([-np.inf, np.inf]), *[ca.MX(0, 1)] * 3, ca.MX(0, 2), ca.MX(0, 0)]


NO_PIECES = _NoPieces(0, 0)


@cached
def step_expansion(graph: VectorField, columns: int, varied: tuple[int, ...]) -> ca.Function:
    """(x, p, dx, dp) -> the coefficients of a step and those of its sensitivities."""
    if columns == 1:
        return tangent(graph.field, varied, TAYLOR.order)
    return variations(graph.field, varied, columns, TAYLOR.order)


def step_function_of(
    graph: VectorField, at: Places, columns: int, varied: tuple[int, ...], piece_rows: PieceRows
) -> ca.Function:
    """The `step_function` of a `TaylorStepper`."""
    n, count_p = graph.size, graph.p.numel() - graph.data
    own = [row for row in varied if row < count_p]
    z, data = ca.MX.sym("z", at.time), ca.MX.sym("p", count_p + len(own) * columns)
    row = ca.MX.sym("row", piece_rows.width)
    ends_of_piece, q, below, above, moved_ends, dq = piece_rows.split(row)
    x, dx = z[at.state], ca.reshape(z[at.sensitivities], n, columns)
    p, dp = ca.vertcat(data[:count_p], q), ca.reshape(data[count_p:], len(own), columns)
    dp = ca.vertcat(dp, dq.T) if piece_rows.varied else dp
    base, shares = ca.SX(n, TAYLOR.order + 1), ca.SX.eye(n)
    if columns:
        c, dc = step_expansion(graph, columns, varied)(x, p, dx, dp)
        series = c[:, :n]
    else:
        base, shares, driven = driven_coefficients(graph.field, graph.x, graph.p, TAYLOR.order)
        series, dc = ca.Function("series", [graph.x, graph.p], [ca.densify(driven.T)])(x, p), ca.MX(TAYLOR.order + 1, 0)
        symbols = graph.x, graph.p, ca.SX.sym("series", *series.shape)
        c = ca.Function("rows", symbols, [ca.densify((base + shares @ symbols[-1].T).T)])(x, p, series)
        base, shares = base[:n, :], shares[:n, :]
    choice = length_function(graph, base, shares, columns, len(varied))
    numbers = x, p, ca.vec(dp), z[at.left], z[at.longest], ends_of_piece
    ends, powers, left, longest, made, side = choice(series, c[:, :n], dc, *numbers)
    moved = (powers.T @ dc).T
    if columns and graph.coordinate:
        beyond = ca.vertcat(data[:count_p], ca.if_else(side > 0, above, below))
        by_end = ca.if_else(side > 0, moved_ends[:, 1], moved_ends[:, 0])
        moved = _saltation(graph, columns, varied)(ends, p, beyond, moved, ca.vec(dp), by_end, side)
    after = after_step(at, z, ca.vertcat(ends, moved), left, longest, made, side)
    return ca.Function("taylor", [z, data, row] if graph.coordinate else [z, data], [after, c, made])


def after_step(at: Places, z: ca.MX, ends: ca.MX, left: ca.MX, longest: ca.MX, made: ca.MX, side: ca.MX) -> ca.MX:
    """The entries of z up to the piece after a step, which ends in these states with their sensitivities."""
    # A choice between ends costs less than powers of a chosen length, into which CasADi draws the choice.
    after = ca.if_else(made[0] > 0, ends, z[: at.left])
    return ca.vertcat(after, left, longest, z[at.piece] + ca.if_else(made[0] > 0, side, 0))


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
    return ca.Function("saltation", arguments, [ca.vec(moved + jump)])


def length_function(
    graph: VectorField, base: ca.SX, shares: ca.SX, columns: int, varied: int, of_columns: int = TAYLOR.order + 1
) -> ca.Function:
    """The choice of a step's length: the series of a step, its coefficients, those of the sensitivities, x, p, dp, the
    time left, the longest step to try and the ends of the piece -> the state after the length tried, the powers
    (K + 1,) of this length, the time left then and the next longest step, the lengths taken and tried, and the side on
    which the step reaches an end of the piece, 0 for none. The coefficients are those of `base` (n, K + 1) and of the
    series in these `shares` (n, s); those of the sensitivities may be the first two and last two alone."""
    n, orders = graph.size, TAYLOR.order + 1
    series, c = (ca.SX.sym("c", orders, count) for count in (shares.shape[1], n))
    dc = ca.SX.sym("dc", of_columns, n * columns)
    dp, left, longest = ca.SX.sym("dp", varied * columns), ca.SX.sym("left"), ca.SX.sym("longest")
    ends_of_piece = ca.SX.sym("ends", 2)
    length = _truncated_length(c, 0)
    # The series of f_p may have a smaller radius of convergence than that of f, as may that of f_x along a motion that
    # a symmetry makes simple.
    if varied or (columns and graph.in_loops):
        length = ca.fmin(length, _truncated_length(dc, ca.norm_inf(dp) if varied else 0))
    h = ca.fmin(longest, length)
    for weights, change in graph.reaches:
        h = _within_reach(weights @ c.T, change, h)
    h = ca.if_else(h >= left, left, ca.if_else(TAYLOR.shared_steps * h >= left, 0.5 * left, h))
    within, side = ca.SX(1), ca.SX(0)
    if graph.coordinate:
        places = c @ ca.DM(graph.coordinate) * graph.unit
        places[0] -= graph.origin
        h, within, side = _on_piece(places, h, *ca.vertsplit(ends_of_piece))
    size = ca.fmax(ca.norm_inf(ca.vec(c[:2, :])), TINY)  # The size of a motion at rest at the origin would be 0.
    powers = symbolic_powers(h)
    terms, free = ca.diag(powers) @ series, ca.diag(powers) @ base.T
    ends = ca.sum1(free).T + shares @ ca.sum1(terms).T
    accepted = _defect(graph, ends, free, terms, shares, h) <= TAYLOR.largest_defect * size
    accepted = ca.logic_and(accepted, within) if graph.coordinate else accepted
    # A step that is far too long for the rate of the state is shortened in one go instead of halved many times.
    shorter = 0.5 * ca.fmin(h, ca.sqrt(h * size / ca.norm_inf(c[1, :])))
    taken, next_longest = ca.if_else(accepted, h, 0), ca.if_else(accepted, TAYLOR.longest_step, shorter)
    results = [ends, powers, left - taken, next_longest, ca.vertcat(taken, h), side]
    return ca.Function("measure", [series, c, dc, graph.x, graph.p, dp, left, longest, ends_of_piece], results)


def _on_piece(s: ca.SX, h: ca.SX, low: ca.SX, high: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The length of a step of the coordinate with coefficients `s` (K + 1,) that stays between two ends, at most h,
    whether it does so, and the side on which it reaches an end, 0 for none.

    The coordinate stays away from both ends, or its first term that is more than rounding outweighs the others, so
    that it is monotone and its end shows whether it has reached an end of the piece.
    """
    start, room = s[0], ca.fmin(high - s[0], s[0] - low)
    length, terms, steep, within = h, ca.SX.zeros(TAYLOR.order), ca.SX(0), ca.SX(0)
    orders = ca.DM(range(1, TAYLOR.order + 1))
    for halvings in range(TAYLOR.tried_lengths):
        tried = h * 0.5**halvings
        moves = symbolic_powers(tried)[1:] * s[1:]
        sizes, weighted = ca.fabs(moves), orders * ca.fabs(moves)
        outweighs = [2 * ca.sum1(weighted[k + 1 :]) <= weighted[k] for k in range(2)]
        rounded = sizes[0] ** 2 <= TAYLOR.rounded_change * sizes[1] * (ca.fabs(start) + sizes[1])
        valid = ca.logic_or(ca.sum1(sizes) < room, ca.logic_or(outweighs[0], ca.logic_and(rounded, outweighs[1])))
        chosen = ca.logic_and(valid, ca.logic_not(within))
        length, terms, steep = (
            ca.if_else(chosen, new, old) for new, old in ((tried, length), (moves, terms), (outweighs[0], steep))
        )
        within = ca.logic_or(within, valid)
    length = ca.if_else(within, length, tried)
    move = ca.sum1(terms)
    rises, falls = ca.logic_and(move > 0, start + move >= high), ca.logic_and(move < 0, start + move <= low)
    side = ca.if_else(rises, 1, ca.if_else(falls, -1, 0))
    distance = ca.if_else(rises, high, low) - start
    share = distance / move
    share = ca.if_else(steep, share, ca.sqrt(share))
    for _ in range(TAYLOR.steps_to_end):
        value = share * ca.polyval(terms[::-1], share) - distance
        slope = ca.polyval((orders * terms)[::-1], share)
        share = ca.fmin(ca.fmax(share - value / slope, TAYLOR.shortest_cut), 1)
    return length * ca.if_else(side == 0, 1, share), within, side


def _truncated_length(c: ca.SX, size: ca.SX | float) -> ca.SX:
    """The step at which the last two terms of series (K + 1, rows) vanish beside the first two and `size`, by Jorba and
    Zou (2005), the source of `taylor_series`."""
    scale, before, last = (ca.norm_inf(ca.vec(part)) for part in (c[:2, :], c[-2, :], c[-1, :]))
    bound, order = TAYLOR.truncation * (scale + size), TAYLOR.order
    # The lesser one of two roots, chosen before it is taken, since a root takes as long as a hundred products.
    sooner = bound / before <= (before / last) ** (order - 1)
    return (bound / ca.if_else(sooner, before, last)) ** ca.if_else(sooner, 1 / (order - 1), 1 / order)


def _within_reach(coordinate: ca.SX, change: Room, h: ca.SX) -> ca.SX:
    """The length of a step, at most h, in which a coordinate with these coefficients (1, K + 1) changes no more than
    this from its start."""
    terms, longest = ca.densify(coordinate)[1:], h
    for farthest, each in zip(change, (-terms, terms), strict=True):
        # The terms after the first that lead to this side bound the change: it is a convex function of the length, by
        # the speed and the acceleration alone and by all terms.
        speed, later, distance = each[0], ca.fmax(each[1:], 0), ca.fmin(farthest, TAYLOR.unbounded)
        h = ca.fmin(h, 2 * distance / (speed + ca.sqrt(speed**2 + 4 * later[0] * distance)))
        moved = h * ca.polyval(ca.vertcat(speed, later.T)[::-1], h)
        h = h * ca.if_else(moved > distance, distance / moved, 1)
    return ca.fmax(h, ca.fmin(longest, TAYLOR.shortest_bound))


def _defect(graph: VectorField, ends: ca.SX, free: ca.SX, terms: ca.SX, shares: ca.SX, h: ca.SX) -> ca.SX:
    """The largest defect of the polynomial in the differential equation at the quarters of the step, times its length.
    The polynomial has the terms `free` (K + 1, n) and shares (n, s) in others (K + 1, s), and is `ends` at the end.

    It shows what a series cannot show where a law is flat to the last digit, as a saturated spring is.
    """
    orders, defects = ca.DM(range(TAYLOR.order + 1)), [ca.SX(0)]  # A state whose rate is another state has no defect.
    rows = [i for i, rate in enumerate(ca.vertsplit(graph.field(graph.x, graph.p)[0])) if not rate.is_symbolic()]
    rates = [(ca.diag(orders) @ part)[1:, :] for part in (free, terms)]
    for part in (0.25, 0.5, 0.75, 1.0):
        # Horner's rule, as the powers of the part would be as many constants.
        value = lambda a, b, part=part: _at(a, part).T + shares @ _at(b, part).T  # noqa: E731
        state = value(free, terms) if part < 1 else ends
        difference = value(*rates) - h * graph.field(state, graph.p)[0]
        defects += [ca.fabs(difference[i]) for i in rows]
    return ca.mmax(ca.vertcat(*defects))


def _at(terms: ca.SX, part: float) -> ca.SX:
    """The polynomials with these terms (K + 1, s) in a step at a part of it, (1, s)."""
    return ca.horzcat(*(ca.polyval(each[::-1], part) for each in ca.horzsplit(ca.densify(terms))))
