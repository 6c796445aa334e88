"""The rows of a record for a law: one branch, or the mean, of one cycle, with the drift between cycles."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orbits.errors import InputError, one_of

from .bench_record import BenchRecord
from .half_cycles import (
    SPLITTING,
    Closure,
    HalfCycle,
    Offset,
    are_whole,
    half_cycles,
    joint,
    offset_between,
    row_noise,
)
from .measured_rows import ROWS, MeasuredRows, mean_of_curves, rows_at

BRANCH_NAMES = ("loading", "unloading", "mean")
CYCLE_NAMES = ("last", "mean", "all")


class BranchOptions(NamedTuple):
    """When a record is a loop, and what is a branch of it."""

    fewest: int = 3  # rows on each branch of a detected loop
    # Rows on the way up and on the way down differ where their mean difference is this many times its standard error.
    loop_significance: float = 6.0
    loop_width: float = 5e-3  # share of the forces' range: a narrower loop is noise
    beyond_rest: float = 0.05  # share of the record's range by which a branch goes beyond rest on both sides
    # Steps of a record within which, beyond what counts as a turn, it comes back to its beginning.
    steps_from_start: float = 1.5
    drift_significance: float = 5.0  # standard errors at which a drift is clear


BRANCHES = BranchOptions()


class Choice(NamedTuple):
    """The rows of a law.

    drifts : (k, n), independent changes of the forces by what the record drifts, by one standard deviation each
    note : which rows, cycle and branch they are, and what was left out, in words; "" for all rows of a single sweep
    """

    rows: MeasuredRows
    drifts: np.ndarray
    note: str


def choose(record: BenchRecord, branch: str | None, cycle: int | str | None) -> Choice:
    """The rows on a branch of a cycle; see `springs.table`.

    Raises `InputError` where the record has several branches or cycles that differ and none is named, and for a branch
    or a cycle that it does not have.
    """
    if branch is not None:
        one_of("branch", branch, BRANCH_NAMES)
    if not (cycle is None or (isinstance(cycle, int) and not isinstance(cycle, bool))):
        one_of("cycle", cycle, CYCLE_NAMES)
    halves = half_cycles(record.extensions)
    counts = [np.median([half.length for half in halves if half.direction == side] or [0]) for side in (1, -1)]
    if len(halves) > 1 and min(counts) >= BRANCHES.fewest:
        return _Cycles(record, tuple(halves)).choose(branch, cycle)
    return _of_sweeps(record, halves, branch, cycle)


@dataclass(frozen=True)
class _Cycles:
    """The half cycles of a record that goes to and fro: those of cycle k have the places 2 k - 2 and 2 k - 1, k > 0."""

    record: BenchRecord
    halves: tuple[HalfCycle, ...]

    @cached_property
    def joint(self) -> Closure:
        """How the beginning of the record is joined to its last half cycle; it is not where that ends before."""
        r, force, last = self.record.extensions, self.record.forces, self.halves[-1]
        room = SPLITTING.turn * np.ptp(r) + BRANCHES.steps_from_start * max(abs(r[1] - r[0]), abs(r[-1] - r[-2]))
        if not last.low - room <= r[0] <= last.high + room:
            return Closure(0.0, None)
        return joint(r, force, self.halves, self.noise)

    @cached_property
    def noise(self) -> float:
        return row_noise(self.record.extensions, self.record.forces, self.halves)

    def offset(self, first: HalfCycle, second: HalfCycle) -> Offset:
        return offset_between(self.record.extensions, self.record.forces, first, second, self.noise)

    @cached_property
    def whole(self) -> list[bool]:
        """Whether each half cycle leads from turn to turn, and, of the first one, whether a later one repeats it."""
        whole = are_whole(self.halves, self.record.extensions)
        if whole[0]:
            later = [half for half, is_whole in zip(self.halves[2::2], whole[2::2], strict=True) if is_whole]
            if later:
                whole[0] = not self.offset(self.halves[0], later[0]).differs
            elif len(self.halves) == 2:
                whole[0] = self.joint.skip == 0
        return whole

    @property
    def count(self) -> int:
        """The number of cycles; the last half cycle may be part of one more, which does not count."""
        return max(1, len(self.halves) // 2 + (len(self.halves) % 2 and self.whole[-1]))

    def wholes(self, side: int) -> list[HalfCycle]:
        """The whole half cycles in a direction."""
        return [half for half, whole in zip(self.halves, self.whole, strict=True) if whole and half.direction == side]

    def choose(self, branch: str | None, cycle: int | str | None) -> Choice:
        """The rows on a branch, see the function `choose`."""
        sides = _directions(self.record, branch)
        found: dict[int, list[tuple[HalfCycle, ...]]] = {}
        if not (isinstance(cycle, int) or cycle == "last"):
            self.refuse_differences(sides)
        number = _number_of(cycle, self.count, self.record.name) if isinstance(cycle, int) else None
        for side in sides:
            if cycle in ("mean", "all"):
                found[side] = [(half,) for half in self.wholes(side)]
            else:
                found[side] = [group] if (group := self.group(side, number)) else []
        if branch is None:
            _refuse_loop(self.record, *(_numbers_of(found[side]) for side in (1, -1)))
        if missing := [side for side in sides if not found[side]]:
            raise InputError(self.why_missing(branch, missing[0]))
        return self.choice(branch, cycle, found)

    def group(self, side: int, number: int | None) -> tuple[HalfCycle, ...]:
        """The half cycles in a direction of a cycle, of the last whole one without a number; () where there is none."""
        pairs = [i for i in range(len(self.halves) - 1) if self.whole[i] and self.whole[i + 1]]
        if number is None or self.count == 1:
            if own := [i for i in pairs if i % 2 == 0] or pairs:
                return tuple(half for half in self.halves[own[-1] : own[-1] + 2] if half.direction == side)
            if whole := self.wholes(side):
                return (whole[-1],)
            first, skip = self.halves[0], self.joint.skip
            if len(self.halves) == 3 and first.direction == side and skip is not None:
                return self.halves[-1], first._replace(start=skip)
            among = self.halves[1:] if skip is None else self.halves
            if parts := [half for half in among if half.direction == side and self.passes_rest(half)]:
                return (parts[-1],)
        if number is None:
            return ()
        return tuple(half for half in self.halves[2 * number - 2 : 2 * number] if half.direction == side)

    def passes_rest(self, half: HalfCycle) -> bool:
        """Whether a part of a half cycle goes beyond rest on both sides."""
        room = BRANCHES.beyond_rest * float(np.ptp(self.record.extensions))
        return half.low < -room and half.high > room

    def refuse_differences(self, sides: Sequence[int]) -> None:
        """Raise `InputError` where whole cycles differ by more than the noise."""
        offsets = [self.offset(a, b) for side in sides for a, b in _neighbours(self.wholes(side))]
        if any(offset.differs for offset in offsets):
            numbers = [i for i in range(1, self.count + 1) if any(self.whole[2 * i - 2 : 2 * i])]
            raise InputError(_differ(self.record, "cycles", len(numbers), offsets, numbers))

    def why_missing(self, branch: str | None, side: int) -> str:
        """Why a branch cannot be had, and what can be chosen instead, in words."""
        name = branch or "loading and unloading"
        choices = ["cycle=1 for the first curve as it is"]
        if (branch is None and self.group(-side, None)) or branch in BRANCH_NAMES[:2]:
            other = next(each for each in BRANCH_NAMES[:2] if _directions(self.record, each) == (-side,))
            choices.insert(0, f'branch="{other}"')
        virgin = f"rows 1 to {self.halves[0].stop} are a virgin curve, others a part"
        return (
            f"{self.record.name}: no cycle has the whole branch of {name}: {virgin}: choose {', or '.join(choices)} "
            "(table:FILE?cycle=1), or record one more cycle"
        )

    def choice(
        self, branch: str | None, cycle: int | str | None, found: dict[int, list[tuple[HalfCycle, ...]]]
    ) -> Choice:
        """The rows of the groups of half cycles that were found in each direction."""
        if branch is None:  # both branches of a cycle together
            pairs = [sum(pair, ()) for pair in zip(found[1], found[-1], strict=False)]
            curves = [pairs]
        else:
            curves = list(found.values())
        rate, drift = self.drift(list(found), [half for groups in found.values() for group in groups for half in group])
        try:
            rows = self._mean_of([self._curve(groups, cycle) for groups in curves])
        except InputError as error:
            other = "" if cycle == "all" else ', or choose cycle="all" for those of all cycles (table:FILE?cycle=all)'
            raise InputError(f"{error} of a cycle{other}") from None
        times = self._times(rows.extensions, [group for groups in found.values() for group in groups])
        drifts = rate * np.array([times - times.mean(), np.full(len(times), times.mean())])
        parts = [self.note(found, cycle), branch, drift]
        return Choice(rows, drifts if rate else drifts[:0], ", ".join(filter(None, parts)))

    def _mean_of(self, curves: list[MeasuredRows]) -> MeasuredRows:
        return curves[0] if len(curves) == 1 else mean_of_curves(curves, self.record.name)

    def _times(self, r: np.ndarray, groups: Sequence[tuple[HalfCycle, ...]]) -> np.ndarray:
        """The mean number of the rows of groups of half cycles at extensions (n,)."""
        found = []
        for rows in map(_numbers_of, ([group] for group in groups)):
            order = rows[np.argsort(self.record.extensions[rows], kind="stable")]
            found.append(np.interp(r, self.record.extensions[order], order))
        return np.mean(found, axis=0)

    def _curve(self, groups: list[tuple[HalfCycle, ...]], cycle: int | str | None) -> MeasuredRows:
        """The rows of groups of half cycles: the mean of the groups, or all rows together."""
        each = [_numbers_of([group]) for group in groups]
        joined = each if cycle == "mean" else [np.concatenate(each)]
        r, force, label = self.record.extensions, self.record.forces, self.record.name
        return self._mean_of([rows_at(r[rows], force[rows], label) for rows in joined])

    def note(self, found: dict[int, list[tuple[HalfCycle, ...]]], cycle: int | str | None) -> str:
        """Which rows and cycles are used and which are left out, in words."""
        used = sorted({half for groups in found.values() for group in groups for half in group})
        rows = sum(half.length for half in used)
        total = len(self.record.extensions)
        if rows == total and self.count == 1:
            return ""
        spans = list[list[int]]()
        for half in used:
            if spans and spans[-1][1] == half.start:
                spans[-1][1] = half.stop
            else:
                spans.append([half.start, half.stop])
        named = " and ".join(f"{start + 1} to {stop}" for start, stop in spans[:3]) + (" and others" * (len(spans) > 3))
        places = [next(i for i, each in enumerate(self.halves) if each.stop == half.stop) for half in used]
        numbers = sorted({min(i // 2 + 1, self.count) for i in places})
        which = f"cycle {numbers[0]}" if len(numbers) == 1 else f"cycles {numbers[0]} to {numbers[-1]}"
        which = f"{'mean of ' if cycle == 'mean' else ''}{which} of {self.count}"
        left = min((half.start for half in used if half.stop == self.halves[0].stop), default=self.halves[0].stop)
        virgin = "row 1" if left == 1 else f"rows 1 to {left}"
        out = f"virgin {virgin} left out" if left and not self.whole[0] else ""
        return ", ".join(filter(None, (f"rows {named} of {total}", which, out)))

    def drift(self, sides: Sequence[int], used: Sequence[HalfCycle]) -> tuple[float, str]:
        """The drift of the force for each row, as one standard deviation, and what it is in a cycle, in words.

        It is the larger of the drift over all cycles and the drift next to the used cycle, with its error; for a single
        cycle it is half the gap between its ends, which may have other reasons.
        """
        rates, errors = list[float](), list[float]()
        unit = f" {self.record.units[1]}" if self.record.units[1] else ""
        for side in sides:
            whole = self.wholes(side)
            near = [pair for pair in pairwise(whole) if set(pair) & set(used)][-1:]
            for a, b in [*near, *([(whole[0], whole[-1])] if len(whole) > 2 else [])]:
                offset, rows = self.offset(a, b), (b.start + b.stop - a.start - a.stop) / 2
                if len(offset.offsets):
                    rates.append(float(np.median(offset.offsets)) / rows)
                    # The variance of a median of normal numbers is pi/2 times that of their mean.
                    errors.append(float(np.median(offset.errors)) * np.sqrt(np.pi / 2 / len(offset.errors)) / rows)
        if not rates:
            gap, skip = self.joint
            words = "" if skip == 0 or not gap else f"drift not known, ends {abs(gap):.2g}{unit} apart"
            return abs(gap) / (2 * len(self.record.extensions)), words
        i = int(np.argmax(np.abs(rates)))
        rows = 2 * float(np.mean([half.length for half in used]))
        clear = abs(rates[i]) > BRANCHES.drift_significance * errors[i]
        return float(np.hypot(rates[i], errors[i])), f"drift {abs(rates[i]) * rows:.2g}{unit} a cycle" if clear else ""


def _of_sweeps(record: BenchRecord, halves: list[HalfCycle], branch: str | None, cycle: int | str | None) -> Choice:
    """The rows of a record without cycles: one sweep, several in one direction, or rows in any order."""
    r, force, label = record.extensions, record.forces, record.name
    counts = {side: sum(half.length for half in halves if half.direction == side) for side in (1, -1)}
    side = max(counts, key=lambda each: counts[each])
    sweeps = [half for half in halves if half.direction == side]
    are_sweeps = len(halves) == 1 or np.median([half.length for half in sweeps]) >= ROWS.fewest
    wanted = _directions(record, branch)
    if branch is not None and not are_sweeps:
        turns = f"its {len(r)} rows turn {len(halves) - 1} times, with too few between two turns for a branch"
        raise InputError(f"{label}: {turns}: leave branch= out, or record more rows")
    if len(wanted) == 1 and wanted != (side,):
        found = f"{counts[wanted[0]]} rows on the branch '{branch}'"
        raise InputError(f"{label}: {found}; a table needs {ROWS.fewest}: leave branch= out, or record more rows")
    if not are_sweeps:
        if cycle is not None:
            raise InputError(f"cycle = {cycle!r}: {label} has no cycles, its rows are in no order: leave cycle out")
        ways = ([half for half in halves if half.direction == each] for each in (1, -1))
        _refuse_loop(record, *(_numbers_of([way]) for way in ways))
        return _all_rows(record, "")
    if isinstance(cycle, int) or cycle == "last":
        number = _number_of(cycle, len(sweeps), label)
        own = sweeps[number - 1]
        note = f"rows {own.start + 1} to {own.stop} of {len(r)}, sweep {number} of {len(sweeps)}"
        rows = rows_at(r[own.rows], force[own.rows], label)
        return Choice(rows, np.zeros((0, len(rows.extensions))), ", ".join(filter(None, (note, branch))))
    noise = row_noise(r, force, sweeps)
    offsets = [offset_between(r, force, a, b, noise) for a, b in _neighbours(sweeps)]
    if any(offset.differs for offset in offsets):
        raise InputError(_differ(record, "sweeps", len(sweeps), offsets, [*range(1, len(sweeps) + 1)]))
    return _all_rows(record, branch or "")


def _all_rows(record: BenchRecord, note: str) -> Choice:
    rows = rows_at(record.extensions, record.forces, record.name)
    return Choice(rows, np.zeros((0, len(rows.extensions))), note)


def _directions(record: BenchRecord, branch: str | None) -> tuple[int, ...]:
    """The directions in which the extension moves on a branch, both for the mean and without one.

    A record of one side alone is loaded away from rest, whichever sign it gives that side.
    """
    if branch not in ("loading", "unloading"):
        return 1, -1
    travel = record.sense * record.extensions
    away = -1.0 if travel.max(initial=0.0) <= SPLITTING.turn * np.ptp(travel) else 1.0
    loading = int(record.sense * away)
    return (loading,) if branch == "loading" else (-loading,)


def _numbers_of(groups: Sequence[Sequence[HalfCycle]]) -> np.ndarray:
    """The numbers of the rows on half cycles."""
    rows = [np.arange(half.start, half.stop) for group in groups for half in group]
    return np.concatenate(rows) if rows else np.zeros(0, int)


def _neighbours(halves: Sequence[HalfCycle]) -> list[tuple[HalfCycle, HalfCycle]]:
    """Each half cycle with the next one, and the first with the last."""
    return [*pairwise(halves), *([(halves[0], halves[-1])] if len(halves) > 2 else [])]


def _number_of(cycle: int | str, count: int, label: str) -> int:
    """The number of a cycle, from 1; raises `InputError` for one that there is not."""
    number = count if isinstance(cycle, str) else cycle
    if not 1 <= number <= count:
        raise InputError(f"cycle = {cycle}: {label} has cycles 1 to {count}")
    return number


def _differ(record: BenchRecord, what: str, count: int, offsets: Sequence[Offset], numbers: Sequence[int]) -> str:
    """Why one cycle has to be named, in words."""
    largest = max((each for each in offsets if each.differs), key=lambda each: np.abs(each.offsets).max(initial=0.0))
    unit = f" {record.units[1]}" if record.units[1] else ""
    size = ""
    if len(largest.offsets):
        i = int(np.abs(largest.offsets).argmax())
        size = f" by up to {abs(largest.offsets[i]):.3g}{unit} at extension {largest.places[i]:.4g}"
    named = f'cycle="last", or a number, cycle={numbers[0]} to {numbers[-1]}'
    reasons = "they drift, have not settled, or have different amplitudes"
    return (
        f"{record.name}: its {count} {what} differ{size}, more than their noise: {reasons}; choose one, {named} "
        "(table:FILE?cycle=last)"
    )


def _refuse_loop(record: BenchRecord, up: np.ndarray, down: np.ndarray) -> None:
    """Raise `InputError` where the rows on the way up and down are a loop."""
    r, force = record.extensions, record.forces
    width = _loop_width((r[up], force[up]), (r[down], force[down]))
    if abs(width) > BRANCHES.loop_width * np.ptp(force):
        named = 'name one, branch="loading" or branch="unloading", or both, branch="mean"'
        raise InputError(
            f"{record.name} is a loop: loading and unloading differ by {abs(width):.3g}, "
            f"{100 * abs(width) / np.ptp(force):.2g}% of the forces' range; {named} (table:FILE?branch=loading)"
        )


def _loop_width(up: tuple[np.ndarray, np.ndarray], down: tuple[np.ndarray, np.ndarray]) -> float:
    """The mean force of rows on the way up less that on the way down at the same extension; 0 if they share none."""

    def above(branch, other):
        order = np.argsort(branch[0], kind="stable")
        inside = (other[0] >= branch[0].min()) & (other[0] <= branch[0].max())
        return np.interp(other[0][inside], branch[0][order], branch[1][order]) - other[1][inside]

    if min(len(up[0]), len(down[0])) < BRANCHES.fewest:
        return 0.0
    # Both ways round, the errors of straight lines between the rows of a curved law cancel.
    a, b = above(up, down), -above(down, up)
    widths = np.r_[a, b]
    if len(widths) < 2 * BRANCHES.fewest:
        return 0.0
    # A loop may be wide on one side and narrow on the other: noise is no more than neighbouring widths differ by.
    spread = min(widths.std(), np.r_[np.diff(a), np.diff(b)].std() / np.sqrt(2))
    mean = float(widths.mean())
    return mean if abs(mean) > BRANCHES.loop_significance * spread / np.sqrt(len(widths)) else 0.0
