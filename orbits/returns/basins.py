"""The basins of lossless hops as a result: printed, plotted, tabulated, saved and loaded."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

from ..errors import InputError
from ..result import Axes, Result, Row, shown
from .map_pieces import Intervals


@dataclass(frozen=True, eq=False, repr=False)
class Basins(Result, Mapping[float, Intervals], what="basins", dimension="stretch", in_line=("low", "high", "share")):
    """The launches between two speeds that come to a lossless hop; a mapping of lossless launch speeds to intervals.

    machine : in words and numbers
    low, high : the range of the launch speeds
    stretches : of each lossless launch speed, the intervals of launch speeds that come to it
    """

    machine: Mapping[str, Any]
    low: float
    high: float
    stretches: tuple[tuple[float, tuple[tuple[float, float], ...]], ...]

    def __getitem__(self, alpha: float) -> Intervals:
        return [*dict(self.stretches)[alpha]]

    def __iter__(self) -> Iterator[float]:
        return iter(alpha for alpha, _ in self.stretches)

    def __len__(self) -> int:
        return len(self.stretches)

    def in_units(self, unit: float, machine: Mapping[str, Any]) -> Self:
        """These basins in another unit of speed, of the machine in words."""
        stretches = tuple(
            (alpha * unit, tuple((a * unit, b * unit) for a, b in intervals)) for alpha, intervals in self.stretches
        )
        return replace(self, machine=machine, low=self.low * unit, high=self.high * unit, stretches=stretches)

    @cached_property
    def units(self) -> Mapping[str, str]:
        """The unit of all launch speeds; empty for a dimensionless machine."""
        known = super().units
        return dict.fromkeys(("alpha", "from", "to", "length"), known["alpha"]) if known else {}

    def share_of(self, alpha: float) -> float:
        """The share of the range that comes to a lossless hop; raises `InputError` for a speed of none."""
        if alpha not in self:
            raise InputError(f"alpha = {alpha!r} is none of the lossless launch speeds, which are {[*self]}")
        return sum(b - a for a, b in self[alpha]) / (self.high - self.low)

    @property
    def share(self) -> float:
        """The share of the range that comes to any lossless hop."""
        return sum(map(self.share_of, self))

    def title(self) -> str:
        unit = f" {self.units['alpha']}" if self.units else ""
        return f"launches from {self.low:.6g} to {self.high:.6g}{unit}: {self.share:.3%} come to a lossless hop"

    def heads(self) -> list[str]:
        return [self.heading("alpha"), "intervals", "from", "to", "share of the range"]

    def _rows(self) -> Iterator[Row]:
        """The lossless hops, each with the number of its intervals, the ends of all of them, and their share."""
        for alpha, intervals in self.items():
            numbers = (len(intervals), intervals[0][0], intervals[-1][1], self.share_of(alpha))
            names = (f"{name} of {alpha:.6g}" for name in ("intervals", "from", "to", "share"))
            yield Row(alpha, dict(zip(names, numbers, strict=True)), ("{}", "{:.10g}", "{:.10g}", "{:.4%}"))

    def table(self) -> dict[str, list[float]]:
        """A row for each interval: the lossless launch speed that it comes to, and its ends."""
        rows = [(alpha, a, b) for alpha, intervals in self.items() for a, b in intervals]
        return {name: [row[i] for row in rows] for i, name in enumerate(("alpha", "from", "to"))}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the intervals as bars, a row for each lossless hop; returns the axes. See `ReturnMap.plot_basin` for the
        same on the map."""
        return shown("map_figures").plot_basins(self, axes)
