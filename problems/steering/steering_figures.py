"""Figures of driven machines: heights of the masses, inputs of the actuator, and effects of a disturbance."""

from typing import Any

import numpy as np

from orbits.result import Axes
from orbits.show import (
    COLOURS,
    STYLE,
    axes_or_new,
    finished_panels,
    label_of,
    legend_below,
    mark_stages,
    panels_below,
    plot_simulation,
    unit_labels,
)
from orbits.units import LIFTOFF_SPEED

LONGEST = 1.1  # of a disturbed motion that comes to rest is drawn, as a multiple of the undisturbed one


def plot_driven(driven: Any, axes: Axes | None = None) -> Axes:
    """Plot heights of the masses of a `Driven` against time, contact shaded, and in panels below the displacement of
    the spring's end, or the force, and its rate; return the axes of the heights."""
    axes = plot_simulation(driven.motion, axes_or_new(axes, 1.0))
    axes.get_legend().remove()
    panels, actuator = [axes, *panels_below(axes, 2, 0.4)], driven.actuator
    state, rate = (driven.unit_of(name) for name in (actuator.state, actuator.rate))
    t, (times, rates) = np.linspace(0, driven.end, 2001), driven.schedule(actuator.rate)
    panels[1].plot(t, driven(t)[:, -1], color=COLOURS[3], lw=STYLE.line)
    panels[1].set_ylabel(label_of("force" if actuator.is_force else "spring's end", state))
    panels[2].stairs(rates[actuator.rate], times, color=COLOURS[5], lw=STYLE.line, baseline=None)
    panels[2].set_ylabel(label_of("its rate", rate))
    axes.figure.align_ylabels(panels)
    mark_stages(driven, panels)
    legend_below(panels[-1], axes)
    return finished_panels(driven, panels)


def plot_disturbed(disturbed: Any, axes: Axes | None = None) -> Axes:
    """Plot heights of a `Disturbed` machine against time, its contact shaded, dashed without the disturbance; below by
    how much each launch speed is off. Return the axes of the heights."""
    nominal, run = disturbed.nominal, disturbed.run
    axes = plot_simulation(run, axes_or_new(axes, 0.85))
    axes.get_legend().remove()
    t = np.linspace(0, nominal.end, 4001)
    masses = [height for name, height in nominal.heights.items() if name != "centre of mass"]
    for height, label in zip(masses, ("undisturbed", None), strict=False):
        axes.plot(t, height(nominal(t)), color="0.1", lw=0.9, ls=(0, (4, 2)), label=label)
    (below,) = panels_below(axes, 1)
    times = disturbed.launch_times[: disturbed.compared]
    below.plot(times, disturbed.launch_errors, "o-", color=COLOURS[3], ms=5, lw=1.0, clip_on=False)
    unit = run.source.units.text(LIFTOFF_SPEED) if run.source.units else ""
    below.set_ylabel(label_of("launch speed off by", unit))
    finished_panels(run, [axes, below], "time" + unit_labels(run.source.units)[1])
    axes.figure.align_ylabels([axes, below])
    legend_below(below, axes)
    axes.set_xlim(0, min(max(run.end, nominal.end), LONGEST * nominal.end))
    return axes
