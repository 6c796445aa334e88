"""The results of a return map of launch speeds: hops, and what keeps a machine hopping."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..io import Document
from ..result import Axes, Result, Row, known, shown
from ..units import DIMENSIONS_OF_HOPS, Units
from .returning_hops import FixedPoints as FixedPoints, ReturningHops

FixedPoint = ReturningHops  # its earlier name
HOP_COLUMNS = ("alpha", "next", "loss", "impacts", "status")


class WithStatuses:
    """A table of launches; each has a `status`."""

    status: np.ndarray

    def statuses(self) -> dict[str, int]:
        """The number of launches of each status."""
        names, counts = np.unique(self.status, return_counts=True)
        return dict(zip(names.tolist(), counts.tolist(), strict=True))

    def _line(self) -> dict[str, int]:
        return self.statuses()

    def rows_of_statuses(self: Any, columns: Mapping[str, np.ndarray]) -> Iterator[Row]:
        """How many launches have each status, and the ranges of columns among these."""
        for status, count in self.statuses().items():
            yield Row(status.replace("_", " "), {status: count})
            for name, column in columns.items():
                inside = column[self.status == status]
                if np.isfinite(inside).any():
                    low, high = float(np.nanmin(inside)), float(np.nanmax(inside))
                    ends = {f"least {name} of {status}": low, f"largest {name} of {status}": high}
                    text = f"{{:.10g}} to {{:.10g}} {self.unit_of(name)}".rstrip()
                    yield Row(f"  {name}".replace("alpha", "launch speed"), ends, (text,))


@dataclass(frozen=True, repr=False)
class Hops(WithStatuses, Result, what="table of hops"):
    """The hops that begin with launches; each array has the shape of the launch speeds.

    alpha : launch speeds
    next : launch speeds at the next lift-off, with the injection; NaN without a next launch
    loss : loss of alpha**2 in the hop, without the injection; without a next launch, in its impacts
    impacts : number of impacts in the hop
    status : "lifts_off", or why there is no next launch, a name of `orbits.hops.impacts.STATUSES`
    units : of the numbers, by name; empty for a dimensionless machine
    machine : in words and numbers
    """

    alpha: np.ndarray
    next: np.ndarray
    loss: np.ndarray
    impacts: np.ndarray
    status: np.ndarray
    units: Mapping[str, str] = field(default_factory=dict)
    machine: Mapping[str, Any] = field(default_factory=dict)

    def injected(self, inject: Any) -> "Hops":
        """Hops without injection after which a speed, or one for each, is added; hops that then do not launch rest."""
        following = self.next + inject
        rests = following <= 0
        status = np.where(rests, "rests", self.status).astype(self.status.dtype)
        return replace(self, next=np.where(rests, np.nan, following), status=status)

    def in_units(self, units: Units) -> "Hops":
        """Dimensionless hops in these units."""
        return replace(units.convert(self, **DIMENSIONS_OF_HOPS), units=units.texts(DIMENSIONS_OF_HOPS))

    def title(self) -> str:
        return f"{self.status.size} launches: what becomes of them"

    def _rows(self) -> Iterator[Row]:
        """How many launches have each status, and the ranges of their numbers."""
        yield from self.rows_of_statuses({name: getattr(self, name) for name in HOP_COLUMNS[:-1]})

    def table(self) -> dict[str, np.ndarray]:
        return {name: np.ravel(getattr(self, name)) for name in HOP_COLUMNS}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the next launch speeds against the launch speeds; returns the axes."""
        return shown("map_figures").plot_hops(self, axes)

    def document(self) -> Document:
        columns = {name: known(getattr(self, name)) for name in DIMENSIONS_OF_HOPS}
        columns |= {name: np.ravel(getattr(self, name)).tolist() for name in ("impacts", "status")}
        return columns | ({"units": self.units} if self.units else {})


@dataclass(frozen=True)
class Upkeep:
    """What keeps a machine hopping with a launch speed.

    alpha : launch speed
    inject : injection, in launch speed per hop, with which this launch speed is a fixed point of the return map
    energy : energy that the injection adds in every hop, which equals the loss of the hop
    """

    alpha: float
    inject: float
    energy: float
