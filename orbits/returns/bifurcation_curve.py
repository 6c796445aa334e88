"""A curve of bifurcations of hops in two parameters, as a result."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..continuation import End
from ..model import title_of_machine
from ..result import Axes, Result, Row, shown
from .bifurcation import name_of_hops


@dataclass(frozen=True)
class PlaceOnCurve:
    """An event on a curve of bifurcations, located.

    kind : "turn" (the curve turns round in the second parameter), "cusp" (it does so in both parameters at once: two
        curves of folds meet), or "value" (a value of the second parameter in `at`)
    values : of the two parameters there
    alphas : the launch speeds (period,) of the periodic hops
    """

    kind: str
    values: tuple[float, float]
    alphas: tuple[float, ...]


@dataclass(frozen=True, eq=False, repr=False)
class BifurcationCurve(Result, what="curve of bifurcations", in_line=("kind", "along", "second", "end")):
    """A curve of bifurcations of hops in two parameters.

    kind : "flip", "fold" or "border collision"
    along : the parameter in which the bifurcation occurs
    second : the other parameter, along which the curve was followed
    machine : in words and numbers, at the first point
    impacts : the numbers of impacts (period,) of the hops; at a border collision, on one of its sides
    border : what happens at a border collision, in words; "" at other bifurcations
    values : of the two parameters (n, 2), `along` first, in order along the curve
    alphas : launch speeds (n, period) of the hops
    events : on the curve, in order
    end : how it ends
    units : of launch speeds and parameters, by name; empty for a dimensionless machine
    """

    kind: str
    along: str
    second: str
    machine: Mapping[str, Any]
    impacts: tuple[int, ...]
    values: np.ndarray
    alphas: np.ndarray
    events: tuple[PlaceOnCurve, ...]
    end: End
    border: str = ""
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.values)

    def title(self) -> str:
        hops = name_of_hops(len(self.impacts))
        machine = title_of_machine(self.machine)
        return f"{self.kind} of {hops} of {machine}, in {self.along} and {self.second}"

    def heads(self) -> list[str]:
        return ["", self.heading(self.along), self.heading(self.second), self.heading("alpha")]

    def _rows(self) -> Iterator[Row]:
        """The ends of the curve and the events between them."""
        events = [("first", self.values[0], self.alphas[0]), *((e.kind, e.values, e.alphas) for e in self.events)]
        for kind, (value, second), alphas in [*events, ("last", self.values[-1], self.alphas[-1])]:
            launches = ", ".join(f"{alpha:.12g}" for alpha in alphas)
            names = self.along, self.second, "alpha"
            own = dict(zip((f"{name} at {kind}" for name in names), (value, second, launches), strict=True))
            yield Row(kind, own, ("{:.12g}", "{:.12g}", "{}"))

    def _notes(self) -> list[str]:
        return [*([self.border] if self.border else []), f"end: {self.end.reason}"]

    def unit_of(self, name: str) -> str:
        """The unit of a column, see `Result`; the other launch speeds have that of the first."""
        return super().unit_of("alpha" if name.startswith("alpha ") else name)

    def at(self, value: float) -> list[float]:
        """The values of the first parameter at a value of the second, from points of the curve, or by linear
        interpolation between neighbours."""
        ahead = self.values[:, 1] - value
        found = self.values[ahead == 0, 0].tolist()
        for i in np.flatnonzero(ahead[1:] * ahead[:-1] < 0):
            share = ahead[i] / (ahead[i] - ahead[i + 1])
            found.append(float(self.values[i, 0] + share * (self.values[i + 1, 0] - self.values[i, 0])))
        return found

    def table(self) -> dict[str, np.ndarray]:
        """The points as columns; "alpha 2" is the second launch speed of a cycle."""
        launches = {f"alpha {i + 1}" if i else "alpha": column for i, column in enumerate(self.alphas.T)}
        return {self.along: self.values[:, 0], self.second: self.values[:, 1], **launches}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the curve in the plane of the two parameters, the second one upwards; returns the axes."""
        return shown("period_figures").plot_bifurcation_curve(self, axes)
