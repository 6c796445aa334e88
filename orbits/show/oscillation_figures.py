"""Figures of oscillations and of their families along the energy."""

from itertools import cycle
from typing import Any

import numpy as np

from ..result import Axes
from .canvas import axes_or_new, finished, headline
from .family_ends import MARKERS_OF_ENDS, NAMES_OF_ENDS
from .plot import DRAWN
from .style import COLOURS, MARKERS, NO_MOTIONS, STYLE, label_of, plain


def plot_oscillation(oscillation: Any, axes: Axes | None = None) -> Axes:
    """Plot the coordinates of an `Oscillation` against time over a period; return the axes."""
    axes, t = axes_or_new(axes), np.linspace(0, oscillation.period, DRAWN.stage_samples)
    table = oscillation.table(t)
    names = [name for name in table if name != "time" and not name.endswith("'")]
    for name, colour in zip(names, cycle(COLOURS), strict=False):
        axes.plot(t, table[name], color=colour, lw=STYLE.line, label=label_of(name, oscillation.unit_of(name)))
    headline(axes, oscillation.machine)
    return finished(axes, xlim=(0, t[-1]), xlabel=label_of("time", oscillation.unit_of("time")), ylabel="coordinates")


def plot_oscillations(family: Any, quantity: str, axes: Axes | None = None, along: str = "energy") -> Axes:
    """Plot a column of an `OscillationFamily`, or of a `SwingFamily`, against another, with the events and how it ends;
    return the axes.

    Unstable oscillations, and those at which the ground would have to pull, are dashed. Further families go into the
    same axes.
    """
    first, axes = axes is None, axes_or_new(axes, 0.75)
    x, y = family.column(along), family.column(quantity)
    pulls, unstable = ~family.admissible, getattr(family, "unstable", np.zeros(len(family), bool))
    number = None if getattr(family, "bounces", True) else family.number
    name = f"mode {number}" if number else family.title().split()[0]
    (line,) = axes.plot(x, np.where(unstable | pulls, np.nan, y), lw=STYLE.line, label=name)
    known = set(axes.get_legend_handles_labels()[1])
    for name, chosen in (("unstable", unstable & ~pulls), (NO_MOTIONS, pulls)):
        if chosen.any():  # each with the neighbours of its points
            dashed = chosen | np.append(chosen[1:], False) | np.append(False, chosen[:-1])
            label = None if name in known else name
            axes.plot(x, np.where(dashed, y, np.nan), color=line.get_color(), lw=1.4, ls=(0, (4, 2)), label=label)
            known.add(name)
    for event in family.events:
        if event.kind == "value":
            continue
        at = family.at_event(event)
        style = {"marker": MARKERS.get(event.kind, "P"), "ls": "", "ms": 6, "mfc": "white", "mew": 1.4, "zorder": 4}
        label = None if (name := plain(event.kind)) in known else name
        known.add(name)
        axes.plot(at[along], at[quantity], color="0.15", label=label, **style)
    if family.end.kind != "reached":
        name = NAMES_OF_ENDS.get(family.end.kind, family.end.kind)
        style = {"marker": MARKERS_OF_ENDS.get(name, "p"), "ls": "", "ms": 8, "mfc": "white", "mew": 1.4, "zorder": 4}
        axes.plot(x[-1], y[-1], color="0.15", label=None if name in known else plain(name), **style)
    if first:
        headline(axes, family.machine, without=(along,))
    across, up = (label_of(name, family.unit_of(name)) for name in (along, quantity))
    return finished(axes, xlabel=across, ylabel=up)
