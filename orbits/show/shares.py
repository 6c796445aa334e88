"""Figures of how quantities depend on parameters: derivatives, Sobol's indices, and the spread of uncertain ones."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..result import Axes
from .canvas import axes_or_new, entitled, finished, headline
from .plot import DRAWN
from .style import COLOURS, label_of, small_type

if TYPE_CHECKING:
    from ..design import Sensitivities

DIVERGING = "RdBu_r"  # of colours, from falling to rising


def plot_sensitivities(found: "Sensitivities", axes: Axes | None = None) -> Axes:
    """Plot relative derivatives as a matrix, a row for each quantity and a column for each parameter; return the
    axes."""
    rows, columns = [*found], [*found.parameters]
    if not (rows and columns):
        raise InputError("no derivatives to draw: name quantities and parameters")
    axes = axes_or_new(axes, 0.3 + 0.07 * len(rows))
    shares = np.array([[found.relative()[row][column] for column in columns] for row in rows])
    known = np.nan_to_num(shares, posinf=0.0, neginf=0.0)
    largest = float(np.abs(known).max()) or 1.0
    axes.imshow(known, cmap=DIVERGING, vmin=-1.6 * largest, vmax=1.6 * largest, aspect="auto")
    for i, j in np.ndindex(*shares.shape):
        rounded = round(float(shares[i, j]), 9) + 0.0  # a derivative of 0 has rounding errors
        text = f"{rounded:.3g}" if np.isfinite(shares[i, j]) else "-"
        axes.text(j, i, text, ha="center", va="center", fontsize=small_type(axes))
    axes.set_xticks(range(len(columns)), [label_of(each) for each in columns], rotation=20, ha="right")
    axes.set_yticks(range(len(rows)), [label_of(each) for each in rows])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set(xlabel="parameter", ylabel="quantity")
    return entitled(axes, "relative change per relative change")


def plot_indices(found: Any, quantity: str | None = None, axes: Axes | None = None) -> Axes:
    """Plot Sobol's indices of a quantity, the first one for None, as bars with their confidence intervals; return the
    axes."""
    quantity = next(iter(found)) if quantity is None else quantity
    if quantity not in found:
        raise InputError(f"no indices of '{quantity}' were computed; choose one of {', '.join(found)}")
    axes, each = axes_or_new(axes), found[quantity]
    for k, order in enumerate(("first", "total")):
        heights, low, high = (
            np.array([row[f"{order}{end}"] for row in each.values()]) for end in ("", "_low", "_high")
        )
        ends = np.maximum([heights - low, high - heights], 0.0)
        style = {"color": COLOURS[k], "ecolor": "0.3", "error_kw": {"lw": 1}, "label": f"{order} order"}
        axes.bar(
            np.arange(len(each)) + (k - 0.5) * DRAWN.width_of_bar,
            heights,
            DRAWN.width_of_bar,
            yerr=ends,
            capsize=3,
            **style,
        )
    axes.set_xticks(range(len(each)), [label_of(name) for name in each])
    axes.axhline(0, color="0.4", lw=0.8)
    headline(axes, found.machine, without=each)
    return finished(axes, xlabel="parameter", ylabel=f"share of the variance of {label_of(quantity)}")


def plot_uncertainty(found: Any, quantity: str | None = None, axes: Axes | None = None) -> Axes:
    """Plot the distribution of a quantity over the members that are motions, the first one for None, its 5 % and 95 %
    quantiles, and the normal distribution of the linear deviation; return the axes."""
    quantity = next(iter(found.mean)) if quantity is None else quantity
    if quantity not in found.mean:
        raise InputError(f"the uncertainty has no '{quantity}'; it has {', '.join(found.mean)}: name it in quantities")
    axes, sweep = axes_or_new(axes), found.sweep
    values = sweep[quantity][(sweep["status"] == "certified") & np.isfinite(sweep[quantity])]
    bars = int(np.clip(np.sqrt(len(values)), 5, DRAWN.bars))
    axes.hist(values, bars, density=True, color=COLOURS[4], ec="white", lw=0.5, label="members")
    mean, deviation = found.mean[quantity], found.linear[quantity]
    if 0 < deviation < np.inf:
        x = np.linspace(min(values.min(), mean - 3 * deviation), max(values.max(), mean + 3 * deviation), 201)
        height = np.exp(-0.5 * ((x - mean) / deviation) ** 2) / (deviation * np.sqrt(2 * np.pi))
        axes.plot(x, height, color=COLOURS[1], lw=1.6, label="linear")
    for i, share in enumerate(("5%", "95%")):
        place = found.quantiles[quantity][share]
        axes.axvline(place, color="0.3", lw=1, ls="--", label=None if i else "5 % and 95 %")
    headline(axes, found.machine, without=sweep.parameters)
    return finished(axes, xlabel=label_of(quantity, sweep.unit_of(quantity)), ylabel="density")
