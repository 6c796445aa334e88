"""Figures of controlled motions: states against time, and inputs below."""

from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..result import Axes
from .canvas import axes_or_new, dressed, finished
from .plot import DRAWN, mark_events
from .style import COLOURS, STYLE, label_of, small_type

if TYPE_CHECKING:
    from ..control import Control, ControlledLeg, OptimalFamily

DASHES = ("-", (0, (5, 2)), (0, (1, 1.5)))  # of curves beyond the number of colours


def plot_control(control: "Control", axes: Axes | None = None) -> Axes:
    """Plot the states of all stages against time, and the inputs in a panel below; return the axes of the states.

    Where a stage begins there is a dotted line, and its name above; a curve is interrupted where a stage does not have
    it. Raises `InputError` for axes that stand in no grid.
    """
    axes = axes_or_new(axes, 0.85)
    names = tuple(dict.fromkeys(name for leg in control.legs for name in leg.states))
    panels = [axes, *panels_below(axes, 1 if control.inputs else 0)]
    for panel, drawn, of_leg in zip(panels, (names, control.inputs), (_states_of, _inputs_of), strict=False):
        styles = zip(drawn, cycle([(colour, dash) for dash in DASHES for colour in COLOURS]), strict=False)
        for name, (colour, dash) in styles:
            t, values = _curve(control, name, of_leg)
            panel.plot(t, values, color=colour, ls=dash, lw=STYLE.line, label=label_of(name, control.unit_of(name)))
        panel.legend(frameon=False, fontsize=small_type(axes), loc="center left", bbox_to_anchor=(1.0, 0.5))
    for panel, kind in zip(panels, ("states", "inputs"), strict=False):
        panel.set_ylabel(kind)
    axes.figure.align_ylabels(panels)
    mark_stages(control, panels)
    _name_stages(control, axes)
    return finished_panels(control, panels)


def plot_optimal_family(family: "OptimalFamily", axes: Axes | None = None) -> Axes:
    """Plot the least cost of a family of optimal motions against its parameter, with its events marked; return the
    axes."""
    axes = axes_or_new(axes)
    axes.plot(family.values, family.costs, ".-", ms=5, lw=STYLE.line, color=COLOURS[0])
    mark_events(axes, family.values, family.costs, family.events)
    across, up = (label_of(name, family.unit_of(name)) for name in (family.name, "cost"))
    return finished(axes, xlabel=across, ylabel=up)


def _states_of(leg: "ControlledLeg", name: str, since: np.ndarray) -> np.ndarray | None:
    return leg.path(since)[:, leg.states.index(name)] if name in leg.states else None


def _inputs_of(leg: "ControlledLeg", name: str, since: np.ndarray) -> np.ndarray | None:
    return leg.inputs(since)[:, leg.inputs.names.index(name)] if name in leg.inputs.names else None


def _curve(control: Any, name: str, of_leg: Any) -> tuple[np.ndarray, np.ndarray]:
    """Times and values (k,) of a state or an input, with NaN between stages that do not join and where one has none.

    Times just before the ends of the intervals, where an input may jump, are among them.
    """
    times, values = [], []
    for leg in control.legs:
        ends = leg.inputs.times[1:]
        since = np.sort(
            np.concatenate([np.linspace(0, leg.duration, DRAWN.stage_samples), np.nextafter(ends, 0.0), ends])
        )
        found = of_leg(leg, name, since)
        times += [leg.start + since, [leg.start + leg.duration]]
        values += [np.full(len(since), np.nan) if found is None else found, [np.nan]]
    return np.concatenate(times), np.concatenate(values)


def panels_below(axes: Axes, count: int, height: float = 0.5) -> list[Axes]:
    """`count` panels below axes, each with this share of the axes' height, in the room that the axes had.

    Raises `InputError` for axes that stand in no grid.
    """
    if (room := axes.get_subplotspec()) is None:
        raise InputError(
            "these axes cannot be divided: make them with figure.add_subplot or matplotlib.pyplot.subplots"
        )
    grid = room.subgridspec(1 + count, 1, height_ratios=[1.0] + count * [height])
    axes.set_subplotspec(grid[0])
    return [dressed(axes.figure.add_subplot(grid[1 + i], sharex=axes), axes) for i in range(count)]


def mark_stages(control: "Control", panels: list[Axes]) -> None:
    """Draw a dotted line in all panels where a stage begins."""
    for panel in panels:
        for leg in control.legs[1:]:
            panel.axvline(leg.start, color="0.6", lw=0.8, ls=":", zorder=0.5)


def _name_stages(control: "Control", axes: Axes) -> None:
    """Write the names of the stages above the axes."""
    from matplotlib.transforms import blended_transform_factory

    place: dict[str, object] = {"transform": blended_transform_factory(axes.transData, axes.transAxes), "ha": "center"}
    for leg in control.legs:
        axes.text(
            leg.start + 0.5 * leg.duration,
            1.02,
            leg.phase,
            fontsize=small_type(axes),
            color="0.4",
            parse_math=False,
            **place,
        )


def finished_panels(motion: Any, panels: list[Axes], time: str | None = None) -> Axes:
    """The first of the panels, all open above and on the right; the last one has the label of the motion's time."""
    for panel in panels:
        panel.axhline(0, color="0.4", lw=0.8, zorder=0)
        panel.set(xlim=(0, motion.end), xlabel="")
        panel.tick_params(labelbottom=panel is panels[-1])
    panels[-1].set_xlabel(time or motion.heading("time"))
    return panels[0]
