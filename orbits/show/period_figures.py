"""Figures in the plane of two parameters of a return map: the periods that attract, and curves of bifurcations."""

from itertools import cycle
from typing import Any

import numpy as np

from ..result import Axes
from .plot import COLOURS, finished, new_axes, plain

# The colours of places where launches go on without a period, and of those where none goes on.
CHAOTIC_COLOUR, REST_COLOUR = "0.25", "0.93"
# The colours of the periods after those of all figures.
FURTHER_COLOURS = ("#882255", "#999933", "#44AA99", "#332288", "#AA4499", "#DDCC77", "#117733", "#661100", "#6699CC")
STYLES_OF_CURVES = {"flip": "-", "fold": "--", "border collision": ":"}


def plot_periods(diagram: Any, axes: Axes | None = None) -> Axes:
    """Plot a `PeriodDiagram`: a colour for each period, dark grey without one, pale where every launch ends; return the
    axes."""
    from matplotlib.colors import ListedColormap

    axes = axes or new_axes(6.8, 5.0)
    periods, several = diagram.period(), diagram.several
    known = np.unique(periods[periods > 0]).tolist()
    names = {-1: "no hops go on", 0: "without a period", **{p: f"period {p}" for p in known}}
    colours = {-1: REST_COLOUR, 0: CHAOTIC_COLOUR, **dict(zip(known, cycle((*COLOURS, *FURTHER_COLOURS))))}
    levels = [level for level in names if (periods == level).any()]
    numbers = np.searchsorted(levels, periods)
    look = ListedColormap([colours[level] for level in levels])
    limits = {"vmin": -0.5, "vmax": len(levels) - 0.5}
    axes.pcolormesh(diagram.values, diagram.others, numbers, cmap=look, **limits, shading="nearest", rasterized=True)
    for level in levels:
        axes.plot([], [], "s", ms=7, color=colours[level], mec="0.5", mew=0.5, label=names[level])
    if several.any():
        j, i = np.nonzero(several)
        look = {"marker": ".", "ls": "", "ms": 1.5, "mew": 0, "color": "white", "rasterized": True}
        axes.plot(diagram.values[i], diagram.others[j], **look)
        axes.plot([], [], "o", ms=4, mfc="white", mec="0.5", mew=0.7, label="several attract")
    axes.set_title(plain(diagram.title()), fontsize="medium", wrap=True)
    across, up = (diagram.heading(name).replace("_", " ") for name in (diagram.along, diagram.second))
    return finished(axes, xlabel=across, ylabel=up)


def plot_event_curve(curve: Any, axes: Axes | None = None) -> Axes:
    """Plot an `EventCurve` in the plane of its two parameters, with its events; return the axes."""
    own = axes is None
    axes = axes or new_axes(5.6, 4.4)
    count = len(curve.impacts)
    words = f"{curve.kind}, {'fixed points' if count == 1 else f'period {count}'}"
    colour = COLOURS[(count - 1) % len(COLOURS)] if own else "black"
    axes.plot(*curve.values.T, STYLES_OF_CURVES[curve.kind], color=colour, lw=1.6, label=words)
    places = np.array([event.values for event in curve.events if event.kind != "asked"]).reshape(-1, 2)
    if len(places):
        axes.plot(*places.T, "o", color="0.15", mfc="white", ms=5, zorder=4)
    if not own:
        return axes
    axes.set_title(plain(curve.title()), fontsize="medium", wrap=True)
    across, up = (curve.heading(name).replace("_", " ") for name in (curve.along, curve.second))
    return finished(axes, xlabel=across, ylabel=up)
