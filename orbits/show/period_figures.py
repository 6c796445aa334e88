"""Figures in the plane of two parameters of a return map: the periods that attract, and curves of bifurcations."""

from itertools import cycle
from typing import Any

import numpy as np

from ..result import Axes
from ..returns import name_of_hops
from .canvas import axes_or_new, finished, headline, legend_below
from .plot import DRAWN
from .style import COLOURS, STYLE, label_of

IN_REST, IN_CHAOS, WITHOUT_PERIOD = -2, -1, 0  # places where no launch goes on, and where one does without a period
# The colours of the periods after those of all figures.
FURTHER_COLOURS = ("#882255", "#999933", "#44AA99", "#332288", "#AA4499", "#DDCC77", "#117733", "#661100", "#6699CC")
STYLES_OF_CURVES: dict[str, tuple[Any, ...]] = {
    "flip": ("-", (0, (6, 1.2)), (0, (5, 1.2, 1, 1.2)), (0, (4, 1.2, 1, 1.2, 1, 1.2))),
    "fold": ((0, (3, 2)), (0, (3, 2, 1, 2)), (0, (2, 1)), (0, (2, 1, 1, 1))),
    **dict.fromkeys(("border collision", "non-smooth fold"), DRAWN.dashes_at_borders),
}


def plot_periods(diagram: Any, axes: Axes | None = None) -> Axes:
    """Plot a `PeriodDiagram`: a colour for each period, dark grey without one, pale where every launch ends; return the
    axes."""
    from matplotlib.colors import ListedColormap

    axes = axes_or_new(axes, 0.78)
    periods, several = diagram.period(), diagram.several
    status = np.take_along_axis(diagram.status, diagram.first[:, :, None], axis=2)[:, :, 0]
    periods = np.where(periods < 0, IN_REST, np.where(status == "chaotic", IN_CHAOS, periods))
    known = np.unique(periods[periods > 0]).tolist()
    names = {IN_REST: "no hops go on", IN_CHAOS: "chaotic", WITHOUT_PERIOD: f"no period up to {diagram.longest}"}
    names |= {period: f"period {period}" for period in known}
    colours = {
        IN_REST: "0.93",
        IN_CHAOS: "0.25",
        WITHOUT_PERIOD: "0.6",
        **dict(zip(known, cycle((*COLOURS, *FURTHER_COLOURS)))),
    }
    levels = [level for level in names if (periods == level).any()]
    numbers = np.searchsorted(levels, periods)
    look = ListedColormap([colours[level] for level in levels])
    limits = {"vmin": -0.5, "vmax": len(levels) - 0.5}
    axes.pcolormesh(diagram.values, diagram.others, numbers, cmap=look, **limits, shading="nearest", rasterized=True)
    for number, level in enumerate(levels):  # a mark on a place of its own colour, for the legend
        j, i = np.argwhere(numbers == number)[0]
        axes.plot(diagram.values[i], diagram.others[j], "s", ms=4, mew=0, color=colours[level], label=names[level])
    if several.any():
        j, i = np.nonzero(several)
        mark = {"marker": ".", "ls": "", "ms": 1.5, "mew": 0, "color": "white", "rasterized": True}
        axes.plot(diagram.values[i], diagram.others[j], **mark)
        axes.plot(diagram.values[i[:1]], diagram.others[j[:1]], "o", ms=3, mfc="white", mec="0.5", mew=0.7,
                  label="several attract")  # fmt: skip
    both = (diagram.along, diagram.second)
    headline(axes, diagram.machine, ", periods of the hops", both)
    across, up = (label_of(name, diagram.unit_of(name)) for name in both)
    return finished(axes, xlabel=across, ylabel=up)


def plot_bifurcation_curve(curve: Any, axes: Axes | None = None) -> Axes:
    """Plot an `BifurcationCurve` in the plane of its two parameters, with its events; return the axes."""
    own = axes is None
    axes = axes_or_new(axes, 0.78)
    count = len(curve.impacts)
    words = f"{curve.kind}, {name_of_hops(count).removeprefix('hops of ')}"
    colour = COLOURS[(count - 1) % len(COLOURS)] if own else "black"
    styles = STYLES_OF_CURVES[curve.kind]
    style = styles[min(int(count).bit_length(), len(styles)) - 1]
    axes.plot(*curve.values.T, ls=style, color=colour, lw=STYLE.line, label=words)
    places = np.array([event.values for event in curve.events if event.kind != "value"]).reshape(-1, 2)
    if len(places):
        axes.plot(*places.T, "o", color="0.15", mfc="white", ms=5, zorder=4)
    if not own:
        return legend_below(axes)
    names = (curve.along, curve.second)
    headline(axes, curve.machine, f", {curve.kind} of {name_of_hops(count)}", names)
    across, up = (label_of(name, curve.unit_of(name)) for name in names)
    return finished(axes, xlabel=across, ylabel=up)
