"""On which parameters the quantities of a sweep depend: Sobol's indices."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, whole_number
from ..model import machine_in_words
from ..numerics import sobol_points
from ..result import Axes, Result, Row, shown
from .question import Question

CONFIDENCE = 0.95  # of the intervals of indices
RESAMPLES = 500  # by which intervals are found
# The numbers of each quantity and parameter.
INDICES = ("first", "first_low", "first_high", "total", "total_low", "total_high")


@dataclass(frozen=True, eq=False, repr=False)
class Indices(Result, Mapping[str, Mapping[str, Mapping[str, float]]], what="Sobol indices", dimension="index"):
    """Sobol's indices of quantities: the shares of their variance that are due to each parameter, "first" alone and
    "total" with others, and the ends "first_low", ... of their 95 % confidence intervals; a mapping,
    [quantity][parameter][index].

    machine : in words and numbers
    shares : the indices
    samples : their number
    """

    machine: Mapping[str, Any]
    shares: Mapping[str, Mapping[str, Mapping[str, float]]]
    samples: int

    def __getitem__(self, quantity: str) -> Mapping[str, Mapping[str, float]]:
        return self.shares[quantity]

    def __iter__(self) -> Iterator[str]:
        return iter(self.shares)

    def __len__(self) -> int:
        return len(self.shares)

    def _line(self) -> dict[str, object]:
        return {f"{quantity}, {name}": each["total"] for quantity, row in self.items() for name, each in row.items()}

    def title(self) -> str:
        return f"Sobol indices of {', '.join(self)}, from {self.samples} samples, with 95 % confidence intervals"

    def heads(self) -> list[str]:
        return ["quantity", "parameter", "first", "total"]

    def _rows(self) -> Iterator[Row]:
        """The indices of each quantity and parameter, with the ends of the intervals."""
        within = "{:.4f} ({:.4f} to {:.4f})"
        for quantity, row in self.items():
            for name, each in row.items():
                values = {f"parameter of {quantity}": name}
                yield Row(
                    quantity,
                    {**values, **{f"{n} of {quantity}, {name}": each[n] for n in INDICES}},
                    ("{}", within, within),
                )

    def table(self) -> dict[str, list[Any]]:
        """A row for each quantity and parameter."""
        rows = [(quantity, name, each) for quantity, row in self.items() for name, each in row.items()]
        columns: dict[str, list[Any]] = {"quantity": [row[0] for row in rows], "parameter": [row[1] for row in rows]}
        return columns | {index: [row[2][index] for row in rows] for index in INDICES}

    def plot(self, quantity: str | None = None, axes: Axes | None = None) -> Axes:
        """Plot the indices of a quantity, the first one if None; returns the axes."""
        return shown("shares").plot_indices(self, quantity, axes)


def sobol_indices(
    question: Question | None, quantities: Sequence[str] | None, samples: int, seed: int, solve: Callable
) -> Indices:
    """The indices of `Sweep.sensitivity`; `solve`, (table of parameters, quantities) -> the sweep of these members."""
    if question is None or not question.members.axes or question.outcome != "find" or len(question.families) > 1:
        raise InputError("Sobol's indices need a sweep of one family over ranges or distributions, with its machine")
    if (samples := whole_number("samples", samples, "samples", least=2)) & (samples - 1):
        raise InputError(f"samples = {samples}; for Sobol's indices it must be a power of 2")
    own, names, axes = ("alpha", "flight_time"), question.members.names, question.members.axes
    texts, count = (
        [*own, *question.quantities]
        if quantities is None
        else ([quantities] if isinstance(quantities, str) else [*quantities]),
        len(names),
    )
    shares = sobol_points(samples, 2 * count, seed)
    a, b = shares[:, :count], shares[:, count:]
    mixed = [np.where(np.arange(count) == i, b, a) for i in range(count)]
    places = np.concatenate([a, b, *mixed])
    table = {name: axis.at(column) for name, axis, column in zip(names, axes, places.T, strict=True)}
    more = solve(table, [text for text in texts if text not in own])
    found = {}
    for text in texts:
        values = more[text].reshape(count + 2, samples)
        if missing := int(np.isnan(values).sum()):
            raise InputError(
                f"'{text}': {missing} of {values.size} members have none, but Sobol's indices need all: "
                "narrow the ranges to where the machine hops"
            )
        found[text] = _indices(names, values, np.random.default_rng(seed))
    return Indices(machine_in_words(question.machine), found, samples)


def _indices(names: Sequence[str], values: np.ndarray, generator: np.random.Generator) -> dict[str, dict[str, float]]:
    """The indices of each parameter from values (d + 2, n) at the points A, B and A with each column of B, with the
    ends of the confidence interval from resampling these values (SciPy's own resampling takes no seed)."""
    drawn = generator.integers(0, values.shape[1], (RESAMPLES, values.shape[1]))
    whole, others = _first_and_total(values), np.array([_first_and_total(values[:, these]) for these in drawn])
    ends = np.quantile(others, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2], axis=0)
    return {
        name: {
            f"{order}{end}": float(part[k, i])
            for k, order in enumerate(("first", "total"))
            for end, part in (("", whole), ("_low", ends[0]), ("_high", ends[1]))
        }
        for i, name in enumerate(names)
    }


def _first_and_total(values: np.ndarray) -> np.ndarray:
    """Sobol's indices (2, d) of first and total order by SciPy; 0 for values that are all the same."""
    from scipy import stats

    if len(values) == 3:  # a single parameter causes all of the variance, a case that SciPy does not cover
        return np.full((2, 1), float(np.ptp(values[:2]) > 0))
    parts = {"f_A": values[:1], "f_B": values[1:2], "f_AB": values[2:, None]}
    with np.errstate(all="ignore"):
        result = stats.sobol_indices(func=parts, n=values.shape[1])
    return np.nan_to_num(np.reshape([result.first_order, result.total_order], (2, -1)))
