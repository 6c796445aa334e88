"""The sensitivities of an orbit as a result: printed, plotted, tabulated, saved and loaded."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..result import Axes, Result, Row, shown


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(Result, Mapping[str, Mapping[str, float]], what="sensitivities", dimension="derivative"):
    """The derivatives of an orbit's quantities by the parameters of its machine; a mapping, [quantity][parameter].

    machine : in words and numbers
    slopes : the derivatives by quantity and parameter, in the machine's units
    at : the values of the quantities, and `parameters` those of the parameters, where the derivatives are taken
    """

    machine: Mapping[str, Any]
    slopes: Mapping[str, Mapping[str, float]]
    at: Mapping[str, float]
    parameters: Mapping[str, float]

    def __getitem__(self, quantity: str) -> Mapping[str, float]:
        return self.slopes[quantity]

    def __iter__(self) -> Iterator[str]:
        return iter(self.slopes)

    def __len__(self) -> int:
        return len(self.slopes)

    def relative(self) -> dict[str, dict[str, float]]:
        """The change of each quantity per change of each parameter, both as shares of their values: 1 where they are
        in proportion. NaN where a quantity is 0."""

        def share(quantity: str, name: str) -> float:
            value = self.at[quantity]
            return self.slopes[quantity][name] * self.parameters[name] / value if value else np.nan

        return {quantity: {name: share(quantity, name) for name in row} for quantity, row in self.slopes.items()}

    def _line(self) -> dict[str, object]:
        return {f"d {quantity}/d {name}": value for quantity, row in self.items() for name, value in row.items()}

    def title(self) -> str:
        return f"derivatives of {len(self)} quantities of a {self.machine['machine']} by {', '.join(self.parameters)}"

    def heads(self) -> list[str]:
        units = {name: self.unit_of(name) for name in self.parameters}
        return ["quantity", "value", *(f"d/d {name}{unit and f' (per {unit})'}" for name, unit in units.items())]

    def _rows(self) -> Iterator[Row]:
        """The quantities, each with its value and its derivatives."""
        for quantity, row in self.items():
            values = {quantity: self.at[quantity], **{f"d {quantity}/d {name}": row[name] for name in row}}
            yield Row(self.heading(quantity), values, ("{:.9g}", *("{:.7g}",) * len(row)))

    def table(self) -> dict[str, list[Any]]:
        """A row for each quantity and parameter: the value of each, the derivative with its unit, and the `relative`
        derivative."""
        pairs, shares = [(quantity, name) for quantity, row in self.items() for name in row], self.relative()
        units = [(self.unit_of(quantity), self.unit_of(name)) for quantity, name in pairs]
        return {
            "quantity": [quantity for quantity, _ in pairs],
            "parameter": [name for _, name in pairs],
            "value": [self.at[quantity] for quantity, _ in pairs],
            "value of parameter": [self.parameters[name] for _, name in pairs],
            "derivative": [self.slopes[quantity][name] for quantity, name in pairs],
            "unit": [f"{above or '1'} per {below or '1'}" if above or below else "" for above, below in units],
            "relative derivative": [shares[quantity][name] for quantity, name in pairs],
        }

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the `relative` derivatives as a matrix of quantities and parameters; returns the axes."""
        return shown("shares").plot_sensitivities(self, axes)
