"""A record in half cycles, from turning point to turning point, and whether two of them agree."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class Splitting:
    """The options with which a record is split, and its half cycles are compared.

    turn : an extension that comes back by this share of its range has turned
    noisy_turn, largest_turn : or by this many standard deviations of its noise, at most by this share of its range
    near_end : a half cycle is whole where its end is this near, as a share of the range of the neighbouring one, to the
        end of that
    parts, rows_of_part : the most parts of the common range in which half cycles are compared, and the fewest rows of
        each half cycle in a part
    significance, tails, tail_power : offsets differ from 0 where they are `significance` standard errors, times
        1 + tails/freedom**tail_power, which is the 1e-4 quantile of Student's distribution to 10 %
    rows_apart, apart : offsets also differ if this number of rows in succession are `apart` standard deviations of the
        noise apart
    joint_share, fewest_at_joint, first_rows : where a record closes, this share of the rows of the last half cycle, at
        least `fewest_at_joint`, are compared with `first_rows` first rows
    largest_spread : with more first rows if their variance by the last rows is at most this multiple of a row's
    skipped_share, stays : at most this share of the first half cycle may be before a branch; it then has to stay on the
        branch for `stays` times the rows up to the end of that share
    open_loop : a loop is open if its width is at least this multiple of the noise's effect
    without_force, slipping : a force below this share of the width of a loop counts as 0; the force of friction that
        begins to slip is between the shares `slipping`
    jump : ideal friction jumps at every turn; jumps at two turns agree to this factor
    rounding : differences below this share of the range of force are rounding
    """

    turn: float = 0.02
    noisy_turn: float = 6.0
    largest_turn: float = 0.45
    near_end: float = 0.05
    parts: int = 8
    rows_of_part: int = 4
    significance: float = 4.0
    tails: float = 12.0
    tail_power: float = 1.4
    rows_apart: int = 2
    apart: float = 5.0
    joint_share: float = 1 / 3
    fewest_at_joint: int = 4
    first_rows: int = 3
    largest_spread: float = 6.0
    skipped_share: float = 0.04
    stays: int = 3
    open_loop: float = 2.0
    without_force: float = 0.15
    slipping: tuple[float, float] = (0.3, 0.7)
    jump: float = 1.5
    rounding: float = 1e-9


SPLITTING = Splitting()
# The standard deviation of normal noise over its median size.
BY_MEDIAN = 1 / 0.6745
# That standard deviation over the median size of its fourth differences, whose variance is 70 times that of the noise.
BY_FOURTH_DIFFERENCES = 1 / (0.6745 * np.sqrt(70))


class HalfCycle(NamedTuple):
    """Rows `start` to `stop` of a record, on which the extension grows, `direction` 1, or falls, -1.

    low, high : its smallest and largest extension, the turning point at which it begins included
    """

    start: int
    stop: int
    direction: int
    low: float
    high: float

    @property
    def rows(self) -> slice:
        return slice(self.start, self.stop)

    @property
    def length(self) -> int:
        return self.stop - self.start


class Closure(NamedTuple):
    """How the beginning of a record is joined to its end.

    gap : by how much the end is above the first rows
    skip : the number of first rows after which the gap is within the noise; None where it nowhere is
    """

    gap: float
    skip: int | None


class Offset(NamedTuple):
    """By how much the force on one half cycle is above that on another, in parts of their common range.

    places, offsets, errors : (k,), the middle of a part, the offset there, and its standard error
    bounds : (k,), below which an offset is within the noise
    apart : the number of rows in succession that differ from the other half cycle beyond the noise
    """

    places: np.ndarray
    offsets: np.ndarray
    errors: np.ndarray
    bounds: np.ndarray
    apart: int

    @property
    def differs(self) -> bool:
        return bool((np.abs(self.offsets) > self.bounds).any()) or self.apart >= SPLITTING.rows_apart


def half_cycles(r: np.ndarray) -> list[HalfCycle]:
    """The half cycles of a record with extensions (n,), in order; wobbles smaller than the noise do not turn it.

    A turning point is the last row of the half cycle that it ends.
    """
    span = float(np.ptp(r))
    noise = (
        SPLITTING.noisy_turn * BY_FOURTH_DIFFERENCES * float(np.median(np.abs(np.diff(r, 4)))) if len(r) > 4 else 0.0
    )
    room = min(max(SPLITTING.turn * span, noise), SPLITTING.largest_turn * span)
    turns, direction = _turning_points(r.tolist(), room)
    ends = [-1, *turns, len(r) - 1]
    found = []
    for i, (before, last) in enumerate(pairwise(ends)):
        own = r[max(before, 0) : last + 1]
        found.append(HalfCycle(before + 1, last + 1, direction * (-1) ** i, float(own.min()), float(own.max())))
    return found


def _turning_points(values: list[float], room: float) -> tuple[list[int], int]:
    """The rows at which an extension turns by more than `room`, and the direction in which it begins."""
    turns, direction, first, extreme, low, high = list[int](), 0, 1, 0, 0, 0
    for i, value in enumerate(values):
        if direction == 0:
            low, high = (i if value < values[low] else low), (i if value > values[high] else high)
            if values[high] - values[low] > room:
                direction, extreme = (1, high) if high > low else (-1, low)
                first = direction
        elif direction * (value - values[extreme]) > 0:
            extreme = i
        elif direction * (values[extreme] - value) > room:
            turns.append(extreme)
            direction, extreme = -direction, i
    return turns, first


def are_whole(halves: Sequence[HalfCycle], r: np.ndarray) -> list[bool]:
    """Whether half cycles lead from one turning point to the next: the first and the last one may be parts."""
    whole = [True] * len(halves)
    if len(halves) > 1:
        first, last = halves[0], halves[-1]
        whole[0] = _reaches(r[0], halves[1], -first.direction)
        whole[-1] = _reaches(r[-1], halves[-2], last.direction)
    return whole


def _reaches(end: float, other: HalfCycle, direction: int) -> bool:
    """Whether an end of the record, on the upper side (1) or the lower one, is that of a neighbouring half cycle."""
    missing = other.high - end if direction > 0 else end - other.low
    return bool(missing <= SPLITTING.near_end * (other.high - other.low))


def row_noise(r: np.ndarray, force: np.ndarray, halves: Sequence[HalfCycle]) -> float:
    """The standard deviation of a row's force about the line through its neighbours, robust against few outliers."""
    sizes = []
    for half in halves:
        x, y = r[half.rows], force[half.rows]
        width = x[2:] - x[:-2]
        share = np.divide(x[1:-1] - x[:-2], width, out=np.full(len(width), 0.5), where=width != 0)
        off = y[1:-1] - y[:-2] - share * (y[2:] - y[:-2])
        sizes.append(off / np.sqrt(1 + share**2 + (1 - share) ** 2))
    every = np.abs(np.concatenate(sizes)) if sizes else np.zeros(0)
    return float(np.median(every) * BY_MEDIAN) if len(every) else 0.0


def resolution(force: np.ndarray) -> float:
    """The smallest step between different forces: that of a force that was rounded before it was saved."""
    steps = np.diff(np.unique(force))
    return float(steps.min()) if len(steps) else 0.0


def offset_between(r: np.ndarray, force: np.ndarray, first: HalfCycle, second: HalfCycle, noise: float) -> Offset:
    """The force on the second half cycle above that on the first, where both have been measured.

    noise : standard deviation of a row's force, the least one in each part
    In each part of their common range one parabola fits both, except for the offset.
    """
    low, high = max(first.low, second.low), min(first.high, second.high)
    inside = [np.flatnonzero((r[half.rows] >= low) & (r[half.rows] <= high)) + half.start for half in (first, second)]
    parts = int(np.clip(min(map(len, inside)) // SPLITTING.rows_of_part, 1, SPLITTING.parts))
    edges = np.linspace(low, high, parts + 1)
    found = [
        each
        for a, b in pairwise(edges)
        if (each := _offset_in_part(r, force, noise, *(rows[(r[rows] >= a) & (r[rows] <= b)] for rows in inside)))
        is not None
    ]
    columns = np.array(found).reshape(-1, 4).T
    floor = _floor(force)
    sparse, dense = sorted(inside, key=len)
    apart = _rows_apart(r, force, sparse, dense, SPLITTING.apart * noise + floor)
    return Offset(columns[0], columns[1], columns[2], np.maximum(columns[3], floor), apart)


def _rows_apart(r: np.ndarray, force: np.ndarray, rows: np.ndarray, others: np.ndarray, bound: float) -> int:
    """How many of some rows in succession are farther than a bound from the line through their neighbours among others,
    whose bend counts as its error."""
    if len(others) < 3:
        return 0
    order = others[np.argsort(r[others], kind="stable")]
    x, y = r[order], force[order]
    bend = np.abs(np.diff(y, 2, prepend=y[0], append=y[-1]))
    bend = np.maximum(bend, np.r_[bend[1:], 0.0])
    places = np.clip(np.searchsorted(x, r[rows]) - 1, 0, len(x) - 1)
    far = np.abs(force[rows] - np.interp(r[rows], x, y)) > bound + bend[places]
    return int(np.diff(np.flatnonzero(np.r_[True, ~far, True])).max()) - 1


def _offset_in_part(
    r: np.ndarray, force: np.ndarray, noise: float, first: np.ndarray, second: np.ndarray
) -> tuple[float, float, float, float] | None:
    """The place, offset, standard error and bound of two groups of rows; None where they are too few."""
    rows = np.r_[first, second]
    degree = 2 if len(rows) >= 8 else 1
    freedom = len(rows) - degree - 2
    if min(len(first), len(second)) < 2 or freedom < 1:
        return None
    middle, span = float(np.mean(r[rows])), float(np.ptp(r[rows])) or 1.0
    matrix = np.column_stack(
        [np.vander((r[rows] - middle) / span, degree + 1), np.repeat([0.0, 1.0], [len(first), len(second)])]
    )
    values, _, rank, _ = np.linalg.lstsq(matrix, force[rows], rcond=None)
    if rank < degree + 2:
        return None
    residual = force[rows] - matrix @ values
    size = max(noise, float(np.sqrt(residual @ residual / freedom)))
    error = size * float(np.sqrt(np.linalg.inv(matrix.T @ matrix)[-1, -1]))
    return middle, float(values[-1]), error, significant(freedom) * error


def significant(freedom: float) -> float:
    """The number of standard errors from which a difference with these degrees of freedom is significant."""
    return SPLITTING.significance * (1 + SPLITTING.tails / freedom**SPLITTING.tail_power)


def joint(r: np.ndarray, force: np.ndarray, halves: Sequence[HalfCycle], noise: float) -> Closure:
    """How the beginning of a record is joined to its last half cycle where that passes the same extension.

    The first rows are compared with the line or parabola through the last rows near them. Some of them may be on the
    way from rest to a branch, as with dry friction. A jump of the size of that at the first turn is not a gap: ideal
    friction jumps at every turn.
    """
    first, last = halves[0], halves[-1]
    goes_on = first.direction == last.direction
    count = max(int(SPLITTING.joint_share * last.length), SPLITTING.fewest_at_joint)
    ending = last.start + np.sort(np.argsort(np.abs(r[last.rows] - r[0]), kind="stable")[:count])
    if len(ending) < SPLITTING.first_rows:
        return Closure(0.0, 0)
    # Where the record turns between its end and its beginning, only the first row is on both branches.
    tried = max(int(SPLITTING.skipped_share * first.length), 1) if goes_on else 0
    used = min(SPLITTING.first_rows + SPLITTING.stays * tried, first.length) if goes_on else 1
    beginning = np.arange(first.start, first.start + used)
    middle, span = float(r[ending].mean()), float(np.ptp(r[ending])) or 1.0
    terms = 3 if len(ending) >= 2 * SPLITTING.first_rows else 2
    matrix, ahead = (np.vander((r[rows] - middle) / span, terms) for rows in (ending, beginning))
    values = np.linalg.lstsq(matrix, force[ending], rcond=None)[0]
    residual, freedom = force[ending] - matrix @ values, len(ending) - terms
    size = float(np.sqrt(residual @ residual / freedom))
    spread = np.einsum("ij,jk,ik->i", ahead, np.linalg.pinv(matrix.T @ matrix), ahead)
    # The noise of all rows has many degrees of freedom, unless the last rows have more than that.
    size = max(SPLITTING.significance * noise, significant(freedom) * size if size > 2 * noise else 0.0)
    bound = size * np.sqrt(1 + spread) + _floor(force)
    gaps, jump = ahead @ values - force[beginning], 0.0
    if not goes_on:
        turn, slope = first.stop - 1, abs(float(values[-2])) / span
        jump = max(0.0, abs(float(force[turn + 1] - force[turn])) - slope * abs(float(r[turn + 1] - r[turn])))
    is_near = np.abs(gaps) <= bound + SPLITTING.jump * jump
    # A curve that only passes the branch leaves it again on as long a way as it came.
    ends = [min(SPLITTING.first_rows + SPLITTING.stays * skip, used) for skip in range(tried + 1)]
    own = [slice(skip, end) for skip, end in enumerate(ends)]
    is_known = spread <= SPLITTING.largest_spread
    skip = next((k for k, rows in enumerate(own) if is_near[rows].all() and (k == 0 or is_known[rows].all())), None)
    if goes_on and skip is not None and not _may_be_steady(r, force, halves, gaps[0], skip, float(bound[0])):
        skip = None
    gap = float(gaps[: SPLITTING.first_rows].mean())
    return Closure(float(np.sign(gap) * max(0.0, abs(gap) - jump)), skip)


def _may_be_steady(
    r: np.ndarray, force: np.ndarray, halves: Sequence[HalfCycle], gap: float, skip: int, bound: float
) -> bool:
    """Whether a record of a loop is steady where its end and its beginning, which is `gap` below, are joined.

    A loop that begins without force is not, even if it comes back to that: a steady one has its friction there. Dry
    friction is steady once it slips, and has half the width of the loop before it.
    """
    second = halves[1]
    order = second.start + np.argsort(r[second.rows], kind="stable")
    width = gap + float(force[0]) - float(np.interp(r[0], r[order], force[order]))
    if abs(width) <= SPLITTING.open_loop * bound:
        return True
    if skip == 0:
        return abs(float(force[0])) > SPLITTING.without_force * abs(width)
    low, high = SPLITTING.slipping
    return low <= gap / width <= high


def _floor(force: np.ndarray) -> float:
    """The size below which a difference of forces is rounding, of the numbers or of the file."""
    return max(resolution(force), SPLITTING.rounding * float(np.ptp(force)))
