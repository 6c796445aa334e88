"""All periodic hops of a period whose launch speeds lie in a range, as a result; see `itineraries` for the search."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import Any, overload

import numpy as np

from ..errors import NoOrbit
from ..hops import simulate, slope_of_hop
from ..io import Document, conform
from ..model import Machine, machine_in_words
from ..numerics import ROOTS, solve
from ..result import Axes, Progress, Result, Row, reported, shown, stored
from ..units import LIFTOFF_SPEED, Units
from .bifurcation import WORDS_OF_STABILITY
from .hops import Hops
from .itineraries import MonotoneBranches, intervals_of, periodic_launches
from .map_pieces import MapPieces
from .periodic_hop import PERIODIC
from .returning_hops import ReturningHops

Cycle = ReturningHops  # its earlier name


@dataclass(frozen=True)
class _SavedHops:
    """One of the `PeriodicHops` in their file."""

    launches: tuple[float, ...]
    impacts: tuple[int, ...]
    branches: tuple[int, ...]
    error: float
    multiplier: float | None = None
    smallest_separation: float | None = None


@dataclass(frozen=True)
class MonotoneBranch:
    """An interval of launch speeds on which the map is smooth and monotone, with the number of impacts in its hops."""

    low: float
    high: float
    rising: bool
    impacts: int


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicHops(Result, Sequence[ReturningHops], what="periodic hops", dimension="launch", document_is_whole=True):
    """All hops of a period of a return map with launch speeds between two; a sequence of `ReturningHops`, ascending.

    machine : in words and numbers
    period : the number of hops after which a launch comes back, and not before
    low, high, inject : the range of launch speeds, and the injection of the map
    cycles : the hops
    branches : the monotone branches of the map, ascending, to which the itineraries refer; for period one only the
        parts that may touch the identity line
    itineraries : how many itineraries belong to launches
    error_of_map : how far the polynomials that represent the map in the search are from it
    unresolved : intervals of launch speeds in which the map is not resolved, since its borders accumulate after many
        bounces, or since the search ended because hops have very many impacts. The hops are complete except for those
        with a launch in one of these
    """

    machine: Mapping[str, Any]
    period: int
    low: float
    high: float
    inject: float
    cycles: tuple[ReturningHops, ...]
    branches: tuple[MonotoneBranch, ...] = ()
    itineraries: int = 0
    error_of_map: float = 0.0
    unresolved: tuple[tuple[float, float], ...] = field(default=())

    @overload
    def __getitem__(self, index: int) -> ReturningHops: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[ReturningHops]: ...

    def __getitem__(self, index: int | slice) -> ReturningHops | Sequence[ReturningHops]:
        return self.cycles[index]

    def __len__(self) -> int:
        return len(self.cycles)

    def in_units(self, units: Units, machine: Mapping[str, Any]) -> "PeriodicHops":
        """These hops in units, of the machine in words."""
        speed = units.of(LIFTOFF_SPEED)
        return replace(
            self, machine=machine, low=speed * self.low, high=speed * self.high, inject=speed * self.inject,
            cycles=tuple(each.in_units(units, machine) for each in self.cycles), error_of_map=speed * self.error_of_map,
            branches=tuple(replace(each, low=speed * each.low, high=speed * each.high) for each in self.branches),
            unresolved=tuple((speed * a, speed * b) for a, b in self.unresolved),
        )  # fmt: skip

    def unit_of(self, name: str) -> str:
        """The unit of a column, see `Result`; all speeds have that of a launch speed."""
        return super().unit_of("alpha" if name in ("next", "error", "inject", "low", "high") else name)

    def _line(self) -> dict[str, object]:
        return {"period": self.period, "low": self.low, "high": self.high, "cycles": len(self)}

    def title(self) -> str:
        unit = f" {self.unit_of('alpha')}".rstrip()
        added = f"with an injection of {self.inject:g}{unit}, launch speeds {self.low:g} to {self.high:g}{unit}"
        return f"hops of period {self.period} of a {self.machine.get('machine')} {added}: {len(self)}"

    def heads(self) -> list[str]:
        return [self.heading("alpha"), "next ones", "multiplier", "stability", "impacts", "branches"]

    def _rows(self) -> Iterator[Row]:
        """A row for each cycle."""
        for i, each in enumerate(self.cycles):
            values = {
                f"next ones of {i}": ", ".join(f"{x:.9g}" for x in each.alphas[1:]),
                f"multiplier of {i}": each.multiplier,
                f"stable {i}": WORDS_OF_STABILITY[each.stable],
                f"impacts of {i}": " ".join(map(str, each.impacts)),
                f"branches of {i}": " ".join(map(str, each.itinerary)),
            }
            yield Row(each.alpha, values, ("{}",) * len(values))

    def _notes(self) -> list[str]:
        unit = f" {self.unit_of('alpha')}".rstrip()
        searched = (
            f"all {self.itineraries} itineraries through its {len(self.branches)} monotone branches were searched"
        )
        if self.period == 1:
            searched = (
                f"all {len(self.branches)} monotone parts near the identity line were searched, by launches on a grid"
            )
        error = f"{self.error_of_map:.1g}{unit}"
        notes = [f"complete for polynomials whose largest compared difference from the map is {error}: {searched}"]
        if not self.branches:
            none = "complete: no launch there has a next launch, or hops lose nothing and an injection adds to each"
            none = "no launch on a grid there has a next launch near it" if self.period == 1 else none
            found = "without injection or damping only lossless hops come back: the ones that a search such as find_all"
            notes = [none if self.inject else f"{found} finds, which does not prove that there are no others"]
            notes = ["not complete: the map is not resolved"] if self.unresolved else notes
        if self.unresolved:
            length = sum(b - a for a, b in self.unresolved)
            near = ", ".join(f"{a:.9g}" for a, _ in self.unresolved[:4])
            text = f"{len(self.unresolved)} intervals of together {length:.2g}{unit}: near {near}"
            why = "its borders accumulate there, or the search ended because hops have very many impacts"
            notes.append(f"except for hops with a launch in {text}; {why}: a narrower range is resolved further")
        return notes

    def table(self) -> dict[str, list[Any]]:
        """A row for each launch: the number of its cycle, the hop, the launch speed, the impacts and the branch, and
        the multiplier, the stability and the error of the cycle."""
        rows = [
            (i, hop, *row, each.multiplier, each.stable, each.error)
            for i, each in enumerate(self.cycles)
            for hop, row in enumerate(zip_longest(each.alphas.tolist(), each.impacts, each.itinerary))
        ]
        names = "cycle", "hop", "alpha", "impacts", "branch", "multiplier", "stable", "error"
        return {name: [row[i] for row in rows] for i, name in enumerate(names)}

    def document(self) -> Document:
        cycles = [
            stored(
                _SavedHops(
                    tuple(each.alphas.tolist()), each.impacts, each.itinerary, each.error or 0.0, each.multiplier,
                    each.smallest_separation,
                )
            )
            for each in self.cycles
        ]  # fmt: skip
        return {**stored(replace(self, cycles=())), "cycles": cycles}

    @classmethod
    def of_saved(cls, document: object, machine: Machine | None = None) -> "PeriodicHops":
        """The hops of a saved document, see `Result`."""
        whole = cls._conform(document, Mapping[str, Any])
        found = cls(**cls._fields_in({**whole, "cycles": []}, machine))
        texts = {"alpha": found.unit_of("alpha")} if found.units else {}
        cycles = tuple(
            ReturningHops.of_speeds(
                each.launches, each.multiplier, "crossing" if each.branches else "lossless", texts, found.machine,
                smallest_separation=each.smallest_separation, impacts=each.impacts, error=each.error,
                itinerary=each.branches,
            )
            for each in conform(whole.get("cycles"), tuple[_SavedHops, ...], "cycles")
        )  # fmt: skip
        return replace(found, cycles=cycles)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot each cycle as its itinerary: the launch speeds hop by hop, with the branches of the map behind; returns
        the axes."""
        return shown("map_figures").plot_periodic_hops(self, axes)


def cycles_of(
    branches: MonotoneBranches, hops_from: Callable[[np.ndarray], Hops], period: int
) -> tuple[list[tuple[np.ndarray, np.ndarray, np.ndarray, float]], int]:
    """The cycles of a period, ascending, each with its launches, branches and impacts (period,) and its error; and the
    number of itineraries. The launches are those of the map `hops_from`, with the injection."""
    shorter = list[np.ndarray]()
    for part in (each for each in range(1, period) if period % each == 0):
        found = intervals_of(branches, part)
        launches, words = periodic_launches(branches, found)
        shorter.append(branches.cycle(launches, words)[0][:, :-1].ravel())
    known, found = np.sort(np.concatenate([[np.inf], *shorter])), intervals_of(branches, period)
    x, words = periodic_launches(branches, found)
    launches, errors, impacts = polished_cycles(branches, hops_from, branches.cycle(x, words)[0][:, :-1], words)
    cycles = list[tuple[np.ndarray, np.ndarray, np.ndarray, float]]()
    for row, word, counts, error in zip(launches, words, impacts, errors.tolist(), strict=True):
        at = int(np.argmin(row))
        row, word, counts = (np.roll(each, -at) for each in (row, word, counts))
        place = np.searchsorted(known, row[0])
        near = min(abs(known[max(place - 1, 0)] - row[0]), abs(known[min(place, len(known) - 1)] - row[0]))
        if period > 1 and near <= PERIODIC.same_cycle * row[0]:
            continue
        if any(np.abs(row - other[0]).max() <= PERIODIC.same_cycle * row[0] for other in cycles):
            continue
        cycles.append((row, word, counts, error))
    return sorted(cycles, key=lambda each: tuple(each[0].tolist())), len(found.words)


def polished_cycles(
    branches: MonotoneBranches, hops_from: Callable[[np.ndarray], Hops], launches: np.ndarray, words: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The cycles (k, n) of the map near those of its polynomials, by Newton's method on all their launches; their
    errors (k,), and the numbers of impacts (k, n)."""
    (k, n), impacts = launches.shape, np.zeros(launches.shape, int)
    if not k:
        return launches, np.zeros(0), impacts
    shift, best = np.roll(np.eye(n), 1, axis=1), np.full(k, np.inf)
    errors, found = np.zeros(k), launches.copy()
    for _ in range(PERIODIC.polishes):
        hops = hops_from(launches.ravel())
        residual = hops.next.reshape(k, n) - np.roll(launches, -1, axis=1)
        inside = np.clip(launches, *np.moveaxis(branches.ends[words], -1, 0))
        slopes = branches.slope(inside.ravel(), words.ravel()).reshape(k, n)
        slopes = np.nan_to_num(slopes, posinf=PERIODIC.steepest, neginf=-PERIODIC.steepest)
        matrix = slopes[:, :, None] * np.eye(n) - shift
        size = np.nan_to_num(np.abs(residual).max(1), nan=np.inf)
        better = size < best
        found[better], best[better] = launches[better], size[better]
        impacts[better] = hops.impacts.reshape(k, n)[better]
        inverse = solve(matrix, np.broadcast_to(np.eye(n), (k, n, n)))
        norms = np.nan_to_num(np.abs(inverse).sum(2).max(1), nan=np.inf)
        rounding = PERIODIC.rounding * launches.max(1)
        errors[better] = (norms * (np.minimum(size, 1.0) + rounding))[better]
        step = (inverse @ residual[:, :, None])[:, :, 0]
        moves = better & np.isfinite(step).all(1) & (size > ROOTS.unit * launches.max(1))
        if not moves.any():
            break
        launches = np.where(moves[:, None], launches - step, found)
    return found, errors, impacts


def slope_at(step: Any, alpha: float) -> float | None:
    """The slope of a return map at a launch speed, in the machine's units, None where it has none."""
    try:
        return slope_of_hop(step.impacts, alpha / (step.units.of(LIFTOFF_SPEED) if step.units else 1.0))
    except NoOrbit:
        return None


def separation_at(step: Any, alpha: float) -> float | None:
    """The smallest separation of the masses during the hop from a launch speed, None where they have none."""
    if step.impacts.model.separation(step.machine.values) is None:
        return None
    return simulate(step.machine, alpha, hops=1, cap=step.cap).smallest_separation


def lossless_hops(return_map: Any, period: int, low: float, high: float, lossless: list[float]) -> PeriodicHops:
    """The `PeriodicHops` of a map without injection and damping, where only lossless hops come back."""
    impacts, words = return_map(np.array(lossless)).impacts.tolist(), machine_in_words(return_map.machine)
    hops = ReturningHops.of_speeds
    cycles = tuple(
        hops([alpha], None, "lossless", machine=words, smallest_separation=separation_at(return_map, alpha),
             impacts=(count,), error=0.0)
        for alpha, count in zip(lossless, impacts, strict=True)
    )  # fmt: skip
    return PeriodicHops(words, period, low, high, 0.0, cycles)


def all_periodic_hops(return_map: Any, pieces: MapPieces, period: int, progress: Progress = None) -> PeriodicHops:
    """The `PeriodicHops` of a dimensionless return map whose pieces without injection are known."""
    branches = MonotoneBranches.of(pieces, return_map.inject)
    found, itineraries = cycles_of(branches, return_map, period) if len(branches.ends) else ([], 0)
    cycles, words = [], machine_in_words(return_map.machine)
    for launches, word, counts, error in reported(found, progress):
        slopes = [slope for a in launches.tolist() if (slope := slope_at(return_map, a)) is not None]
        apart = [each for a in launches.tolist() if (each := separation_at(return_map, a)) is not None]
        multiplier = float(np.prod(slopes)) if len(slopes) == len(launches) else None
        cycles.append(
            ReturningHops.of_speeds(
                launches, multiplier, machine=words, error=error,
                smallest_separation=min(apart, default=None), impacts=tuple(counts.tolist()),
                itinerary=tuple(word.tolist()),
            )
        )  # fmt: skip
    kinds = tuple(
        MonotoneBranch(a, b, rising, int(pieces.impacts[cell]))
        for (a, b), rising, cell in zip(
            branches.ends.tolist(), branches.rising.tolist(), branches.cells[:, 0], strict=True
        )
    )
    return PeriodicHops(
        words, period, pieces.low, pieces.high, return_map.inject, tuple(cycles), kinds, itineraries,
        float(pieces.errors.max(initial=0.0)), pieces.unresolved,
    )  # fmt: skip
