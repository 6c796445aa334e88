"""On which parameters the quantities of a sweep depend: Sobol's indices."""

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..errors import InputError, whole_number
from .question import Question

CONFIDENCE = 0.95


def sobol_indices(
    question: Question | None, quantities: Sequence[str] | None, samples: int, seed: int, solve: Callable
) -> dict[str, dict[str, dict[str, float]]]:
    """As `Sweep.sensitivity`; `solve`, (table of parameters, quantities) -> the sweep of these members."""
    from scipy import stats

    if question is None or not question.members.axes or question.outcome != "find" or len(question.families) > 1:
        raise InputError("Sobol's indices are of a sweep of one family over ranges or distributions, with its machine")
    if (samples := whole_number("samples", samples, "samples", least=2)) & (samples - 1):
        raise InputError(f"samples = {samples}; Sobol's indices take a power of 2")
    own, names, axes = ("alpha", "flight_time"), question.members.names, question.members.axes
    texts, count = [*own, *question.quantities] if quantities is None else [*quantities], len(names)
    shares = stats.qmc.Sobol(2 * count, seed=seed).random(samples)
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
                f"'{text}': {missing} of {values.size} members have none, and Sobol's indices need them all: "
                "narrow the ranges to where the machine hops"
            )
        parts = {"f_A": values[:1], "f_B": values[1:2], "f_AB": values[2:, None]}
        result = stats.sobol_indices(func=parts, n=samples)
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a parameter that changes nothing has no confidence interval
            bounds = result.bootstrap(confidence_level=CONFIDENCE)
        found[text] = {name: _index(result, bounds, i) for i, name in enumerate(names)}
    return found


def _index(result: Any, bounds: Any, i: int) -> dict[str, float]:
    """The indices of one parameter, with their confidence intervals."""
    told = {}
    for name in ("first", "total"):
        told[name] = float(np.ravel(getattr(result, f"{name}_order"))[i])
        interval = getattr(bounds, f"{name}_order").confidence_interval
        for side in ("low", "high"):
            end = float(np.ravel(getattr(interval, side))[i])
            told[f"{name}_{side}"] = end if np.isfinite(end) else told[name]
    return told
