"""Figures of fitted hops: what was recorded, the motion, and the residuals."""

from itertools import cycle
from typing import Any, NamedTuple

import numpy as np

from orbits.errors import InputError, whole_number
from orbits.result import Axes
from orbits.show import (
    COLOURS,
    SHADE,
    STYLE,
    axes_or_new,
    headline,
    label_of,
    legend_below,
    panels_below,
)


class FigureOptions(NamedTuple):
    """The sizes of figures of fitted hops."""

    missing: float = 3.0  # sample intervals without a sample, over which no curve is drawn
    crowded: int = 2000  # samples, more of which are drawn as a picture
    height: float = 0.45  # of axes, over their width, for each channel


FIGURE = FigureOptions()


def plot_hop_fit(fit: Any, axes: Axes | None, record: int) -> Axes:
    """Plot each channel of one record of a `HopFit` with the fitted motion, contact shaded, and below the residuals in
    deviations; return the axes of the first channel."""
    k = whole_number("record", record, "records", 1) - 1
    if k >= len(fit.followed):
        raise InputError(f"record = {record}: the fit has {len(fit.followed)}")
    parts = [part for part in fit.parts if part.motion == k + 1]
    samples = {name: each[1:, each[0] == k] for name, each in fit.samples.items()}
    samples = {name: each for name, each in samples.items() if each.shape[1]}
    axes = axes_or_new(axes, FIGURE.height * (1 + len(samples)))
    panels = [axes, *panels_below(axes, len(samples), 1.0)]
    colours = dict(zip(fit.samples, cycle(COLOURS)))
    for panel, (name, (times, recorded, shown, used)) in zip(panels, samples.items(), strict=False):
        usual, marks = (
            (used > 0) & np.isfinite(shown),
            {"color": colours[name], "rasterized": len(times) > FIGURE.crowded},
        )
        panel.plot(times, recorded, ".", ms=3, label="recorded", **marks)
        panel.plot(*_interrupted(times, shown), color="0.15", lw=0.7 * STYLE.line, label="fitted motion")
        if not usual.all():
            panel.plot(times[~usual], recorded[~usual], "x", color="0.35", ms=4)
            named = "left out" in axes.get_legend_handles_labels()[1]
            axes.plot([], [], "x", color="0.35", ms=4, label="_" if named else "left out")
        panel.set_ylabel(label_of(name, fit.unit_of(name)))
        panel.tick_params(labelbottom=False)
        panels[-1].plot(times, np.where(usual, recorded - shown, np.nan) / fit.noise[name], ".", ms=2, **marks)
    for panel in panels:
        for part in parts:
            if part.phase == "contact":
                panel.axvspan(part.start, part.end, color=SHADE, lw=0, zorder=0)
    panels[-1].set(xlabel=label_of("time", fit.unit_of("start")), ylabel="residual / deviation")
    axes.figure.align_ylabels(panels)
    headline(axes, fit.machine.describe())
    legend_below(panels[-1], axes)
    return axes


def _interrupted(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A curve with NaN where samples are missing."""
    gaps = np.flatnonzero(np.diff(times) > FIGURE.missing * np.median(np.diff(times))) + 1
    return np.insert(times, gaps, times[gaps - 1]), np.insert(values, gaps, np.nan)
