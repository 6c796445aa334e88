"""Hops that come back to their first launch: what all searches for fixed points and periodic hops return."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ..hops import HopMultipliers
from ..io import Document
from ..result import Axes, Result, Row, shown, stored
from ..units import LENGTH, LIFTOFF_SPEED, Units
from .bifurcation import WORDS_OF_STABILITY


@dataclass(frozen=True, eq=False, repr=False)
class ReturningHops(
    Result, what="periodic hop", in_line=("kind", "launches", "multiplier"), document_is_whole=True
):  # fmt: skip
    """Hops that come back to their first launch after `period` hops, and not before; with period 1, a fixed point.

    names : of the d numbers of a launch
    launches : (period, d), in the order of the hops; the last leads to the first. For launch speeds from a search in a
        range, the first is the smallest
    kind : "lossless", or "crossing" where hops lose what an injection or a force adds
    multipliers : of all hops together, from the first launch; None without any, for example where a hop lands
        tangentially
    smallest_separation : of the masses; None where no separation is stated. If it is not above 0 they pass through each
        other, so the hops are not a motion of a real machine
    units : of the numbers of a launch, by name; empty for a dimensionless machine
    machine : in words and numbers
    impacts : the number of impacts in each hop, one more than its bounces; files of earlier versions may lack them
    error : bound on the rounding error of the launch speeds; None where it is not known
    itinerary : for hops from a search in a range, the monotone branch of the map on which each launch lies
    """

    names: tuple[str, ...]
    launches: np.ndarray
    kind: str
    multipliers: HopMultipliers | None = None
    smallest_separation: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    machine: Mapping[str, Any] = field(default_factory=dict)
    impacts: tuple[int, ...] = ()
    error: float | None = None
    itinerary: tuple[int, ...] = ()

    @classmethod
    def of_speeds(
        cls, speeds: ArrayLike, multiplier: float | None, kind: str = "crossing",
        units: Mapping[str, str] | None = None, machine: Mapping[str, Any] | None = None, **others: Any,
    ) -> Self:  # fmt: skip
        """Hops from launch speeds (period,) with the slope of the map over all of them; `others` as above."""
        launches, texts, words = np.array(speeds, dtype=float)[:, None], units or {}, machine or {}
        own = multiplier if multiplier is None else HopMultipliers(
            ("alpha",), launches[0], launches[0], np.array([[multiplier]]), len(launches), units=texts, machine=words,
        )  # fmt: skip
        return cls(("alpha",), launches, kind, own, units=texts, machine=words, **others)

    def in_units(self, units: Units, machine: Mapping[str, Any]) -> "ReturningHops":
        """Dimensionless hops from launch speeds in these units, of the machine in words."""
        speed, separation = units.of(LIFTOFF_SPEED), self.smallest_separation
        return self.of_speeds(
            speed * self.alphas, self.multiplier, self.kind, units.texts({"alpha": LIFTOFF_SPEED}), machine,
            smallest_separation=separation and units.of(LENGTH) * separation, impacts=self.impacts,
            error=self.error and speed * self.error, itinerary=self.itinerary,
        )  # fmt: skip

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ReturningHops) and self.saved() == other.saved()

    def __hash__(self) -> int:
        return hash((self.names, self.launches.tobytes()))

    @property
    def period(self) -> int:
        """The number of hops."""
        return len(self.launches)

    @property
    def alphas(self) -> np.ndarray:
        """The launch speeds (period,)."""
        return self.launches[:, self.names.index("alpha")]

    @property
    def alpha(self) -> float:
        """The first launch speed."""
        return float(self.alphas[0])

    @property
    def branches(self) -> tuple[int, ...]:
        """The `itinerary`."""
        return self.itinerary

    @property
    def spectrum(self) -> np.ndarray:
        """The multipliers (d,) by falling modulus; empty where there are none."""
        return np.zeros(0) if self.multipliers is None else self.multipliers.values

    @property
    def multiplier(self) -> float | None:
        """The multiplier of largest modulus, or its modulus if it is complex; None at lossless hops, where the map has
        no slope in the launch speed, and without multipliers."""
        if self.kind == "lossless" or self.multipliers is None:
            return None
        first = self.spectrum[0]
        return float(abs(first) if first.imag else first.real)

    @property
    def stable(self) -> bool | None:
        """Whether the hops attract their neighbours; None without a multiplier, as at lossless hops."""
        return None if self.multiplier is None else abs(self.multiplier) < 1

    @property
    def stability(self) -> str:
        """The stability in words, as in `HopMultipliers`."""
        return WORDS_OF_STABILITY[None] if self.multipliers is None else self.multipliers.stability

    def title(self) -> str:
        return f"hops of period {self.period} of a {self.machine.get('machine')}"

    def table(self) -> dict[str, np.ndarray]:
        """A row for each hop, with the numbers of its launch."""
        own = {name: self.launches[:, i] for i, name in enumerate(self.names)}
        return {"hop": np.arange(self.period)} | own

    def _rows(self) -> Iterator[Row]:
        yield Row.of("kind", self.kind)
        for i, launch in enumerate(self.launches):
            for name, number in zip(self.names, launch.tolist(), strict=True):
                of = f" of hop {i}" if self.period > 1 else ""
                yield Row.of(f"{name}{of}", number, self.unit_of(name))
        for i, value in enumerate(self.spectrum):
            text = f"{value.real:.10g}" + (f" {value.imag:+.10g}i" if value.imag else "")
            yield Row.of(f"multiplier {i}", text)
        if self.impacts:
            yield Row.of("impacts", " ".join(map(str, self.impacts)))
        if self.smallest_separation is not None:
            yield Row.of("smallest_separation", self.smallest_separation)

    def heads(self) -> list[str]:
        return []

    def _notes(self) -> list[str]:
        return [] if self.multipliers is None else self.multipliers._notes()

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the numbers of the launches, hop by hop; returns the axes."""
        return shown("launch_figures").plot_periodic_hop(self, axes)

    def document(self) -> Document:
        return {**stored(self), "stability": self.stability}


class FixedPoints(tuple[ReturningHops, ...]):
    """The fixed points of a return map, ascending, or the hops found from starts, in their order: `ReturningHops`.

    unresolved : intervals of launch speeds in which there may be others: borders of the map accumulate there, or the
        search has ended since hops have too many impacts; a narrower range is resolved farther
    """

    unresolved: tuple[tuple[float, float], ...]

    def __new__(cls, points: Iterable[Any] = (), unresolved: Iterable[tuple[float, float]] = ()) -> Self:
        found = super().__new__(cls, points)
        found.unresolved = tuple(unresolved)
        return found

    def __repr__(self) -> str:
        text = super().__repr__()
        if not self.unresolved:
            return text
        low, high = self.unresolved[0][0], self.unresolved[-1][1]
        number, length = len(self.unresolved), sum(b - a for a, b in self.unresolved)
        return f"{text}, and maybe others in {number} intervals of length {length:.2g} from {low:.9g} to {high:.9g}"

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (tuple(self), self.unresolved)
