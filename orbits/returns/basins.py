"""What launches between two speeds come to, and intervals of launches, as results: printed, plotted, saved."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, overload

from ..errors import InputError
from ..hops import STATUSES
from ..result import Axes, Result, Row, shown
from ..tables import number_text
from ..units import UNIT_TEXTS
from .destinations import CHAOS, DESTINATIONS, KINDS, UNDECIDED, Destination, length_of
from .map_pieces import Intervals

LISTED = 3  # launch speeds of a hop that its row names


class _OfLaunches:
    """A result about the launches between two speeds of a machine."""

    machine: Mapping[str, Any]
    low: float
    high: float

    @cached_property
    def units(self) -> Mapping[str, str]:
        """The unit of all launch speeds; empty for a dimensionless machine."""
        own = self.machine.get("units")
        text = "" if own is None else {**UNIT_TEXTS, **own}["alpha"]
        return dict.fromkeys(("alpha", "from", "to", "length", "inject"), text) if text else {}

    def _range(self) -> str:
        unit = f" {self.units['alpha']}" if self.units else ""
        return f"launches from {self.low:.6g} to {self.high:.6g}{unit}"

    def _share(self, intervals: Iterable[tuple[float, float]]) -> float:
        return length_of(intervals) / (self.high - self.low)


@dataclass(frozen=True, eq=False, repr=False)
class LaunchIntervals(
    _OfLaunches, Result, Sequence[tuple[float, float]], what="intervals of launches", dimension="interval",
    in_line=("low", "high", "share"),
):  # fmt: skip
    """Intervals of launch speeds between two, ascending: a sequence of pairs (lowest, highest).

    machine : in words and numbers
    low, high : the range of the launch speeds
    intervals : the pairs
    """

    machine: Mapping[str, Any]
    low: float
    high: float
    intervals: tuple[tuple[float, float], ...]

    @overload
    def __getitem__(self, index: int) -> tuple[float, float]: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[tuple[float, float]]: ...

    def __getitem__(self, index: int | slice) -> tuple[float, float] | Sequence[tuple[float, float]]:
        return self.intervals[index]

    def __len__(self) -> int:
        return len(self.intervals)

    def in_units(self, unit: float, machine: Mapping[str, Any]) -> Self:
        """These intervals in another unit of speed, of the machine in words."""
        own = tuple((a * unit, b * unit) for a, b in self.intervals)
        return replace(self, machine=machine, low=self.low * unit, high=self.high * unit, intervals=own)

    @property
    def share(self) -> float:
        """The share of the range that the intervals have."""
        return self._share(self.intervals)

    def title(self) -> str:
        return f"{self._range()}: {len(self)} intervals with {self.share:.3%} of them"

    def _rows(self) -> Iterator[Row]:
        """The longest interval and the first ones."""
        for i, (a, b) in enumerate(self.intervals[: 2 * LISTED]):
            yield Row(f"{i}", {f"from {i}": a, f"to {i}": b, f"length {i}": b - a}, ("{:.10g}", "{:.10g}", "{:.3g}"))

    def heads(self) -> list[str]:
        return ["interval", *map(self.heading, ("from", "to", "length"))]

    def _notes(self) -> list[str]:
        left = len(self) - 2 * LISTED
        return [f"... and {left} more, the last up to {self.intervals[-1][1]:.10g}"] if left > 0 else []

    def table(self) -> dict[str, list[float]]:
        return {"from": [a for a, _ in self.intervals], "to": [b for _, b in self.intervals]}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the intervals as bars; returns the axes."""
        return shown("map_figures").plot_intervals(self, axes)


@dataclass(frozen=True, eq=False, repr=False)
class Basins(
    _OfLaunches, Result, Mapping[float, Intervals], what="basins", dimension="stretch", in_line=("low", "high", "share")
):
    """What the launches between two speeds come to: a mapping from the (smallest) launch speed of each attracting hop
    to the intervals of launch speeds that come to it.

    machine : in words and numbers
    low, high, inject : the range of the launch speeds, and the injection of the map
    destinations : hops that attract, and what else launches come to: each with its intervals; destinations without any
        are left out
    hops : the largest number of hops after which a launch reaches the immediate basin of its hop, the interval around
        the hop in which all launches come to it; launches that need more hops than allowed are undecided
    """

    machine: Mapping[str, Any]
    low: float
    high: float
    inject: float
    destinations: tuple[Destination, ...]
    hops: int

    def __getitem__(self, alpha: float) -> Intervals:
        return [*{each.launches[0]: each.intervals for each in self.attracting}[alpha]]

    def __iter__(self) -> Iterator[float]:
        return (each.launches[0] for each in self.attracting)

    def __len__(self) -> int:
        return len(self.attracting)

    @property
    def attracting(self) -> list[Destination]:
        """The hops that attract."""
        return [each for each in self.destinations if each.is_hop]

    def in_units(self, unit: float, machine: Mapping[str, Any]) -> Self:
        """These basins in another unit of speed, of the machine in words."""
        own = tuple(each.scaled(unit) for each in self.destinations)
        low, high, inject = (unit * each for each in (self.low, self.high, self.inject))
        return replace(self, machine=machine, low=low, high=high, inject=inject, destinations=own)

    def share_of(self, alpha: float | str) -> float:
        """The share of the range that comes to a hop with this (smallest) launch speed or, by a kind such as
        "undecided", to anything else; 0 if no launch does. Raises `InputError` for another speed or kind."""
        if isinstance(alpha, str):
            if alpha not in {*KINDS, *STATUSES, *(here := sorted({each.kind for each in self.destinations}))}:
                raise InputError(f"'{alpha}' is not where launches come to; here they come to {', '.join(here)}")
            return sum(self._share(each.intervals) for each in self.destinations if each.kind == alpha)
        if alpha not in self:
            raise InputError(f"alpha = {alpha!r} is not a launch speed of attracting hops, which are {[*self]}")
        return self._share(self[alpha])

    @property
    def share(self) -> float:
        """The share of the range that comes to any attracting hop."""
        return sum(map(self.share_of, self))

    @property
    def union(self) -> Intervals:
        """The intervals of the launches that come to any attracting hop, ascending."""
        return sorted(pair for each in self.attracting for pair in each.intervals)

    def title(self) -> str:
        unit = f" {self.units['alpha']}" if self.units else ""
        added = f" with an injection of {self.inject:.6g}{unit}" if self.inject else ""
        return f"{self._range()}{added}: {self.at_least}{self.share:.3%} come to {self.goal}"

    @property
    def at_least(self) -> str:
        """The words before a share that is a lower bound, since some launches are undecided; else empty."""
        return "at least " if any(each.kind == UNDECIDED for each in self.destinations) else ""

    @property
    def goal(self) -> str:
        """The name of the attracting hops."""
        is_stable = self.inject or any(each.kind == "stable" for each in self.attracting)
        return "an attracting hop" if is_stable else "a lossless hop"

    def heads(self) -> list[str]:
        return ["come to", self.heading("alpha"), "multiplier", "intervals", "from", "to", "share of the range"]

    def _rows(self) -> Iterator[Row]:
        """What launches come to, each with the number of its intervals, the ends of all of them, and their share."""
        for each in self.destinations:
            of = each.words + "".join(f" {alpha:.6g}" for alpha in each.launches[:1])
            joint = " to " if each.kind == CHAOS else ", "
            speeds = joint.join(f"{alpha:.9g}" for alpha in each.launches[:LISTED])
            speeds += ", ..." if len(each.launches) > LISTED else ""
            own, multiplier = each.intervals, number_text(each.multiplier, digits=6)
            numbers = (speeds or "-", multiplier, len(own), own[0][0], own[-1][1], self._share(own))
            names = (f"{name} of {of}" for name in ("alpha", "multiplier", "intervals", "from", "to", "share"))
            cells = ("{}", "{}", "{}", "{:.9g}", "{:.9g}", "{:.4%}")
            yield Row(each.words, dict(zip(names, numbers, strict=True)), cells)

    def _notes(self) -> list[str]:
        kinds = {each.kind: each for each in self.destinations}
        notes = [
            f"a launch comes to a hop if one of its first {self.hops} hops begins in the immediate basin of that hop"
        ] if self.attracting else []  # fmt: skip
        if CHAOS in kinds:
            notes.append(
                f"chaotic: launches stay between two speeds, and no attracting cycle of up to {DESTINATIONS.longest} "
                "launches was found there"
            )
        if UNDECIDED in kinds:
            a, b = max(kinds[UNDECIDED].intervals, key=lambda pair: pair[1] - pair[0])
            text = f"undecided: the longest interval is {a:.9g} to {b:.9g}, of length {b - a:.2g}"
            notes.append(text + ("; fewer launches are undecided in a narrower range" if len(kinds) > 1 else ""))
        return notes

    def table(self) -> dict[str, list[Any]]:
        """A row for each interval: what it comes to, with its smallest launch speed, and the ends of the interval."""
        rows = [
            (each.kind, each.launches[0] if each.launches else None, a, b)
            for each in self.destinations
            for a, b in each.intervals
        ]
        return {name: [row[i] for row in rows] for i, name in enumerate(("destination", "alpha", "from", "to"))}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the intervals as bars over the launch speeds, a row for each destination; returns the axes. See
        `ReturnMap.plot_basin` for the same on the map."""
        return shown("map_figures").plot_basins(self, axes)
