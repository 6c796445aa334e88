"""Figures of sweeps: a line, a map, or a matrix of scatter plots, by the number of parameters; and diagrams."""

from typing import Any

import numpy as np

from ..errors import InputError
from ..result import Axes
from .canvas import axes_or_new, colour_bar, entitled, legend_below, new_row
from .diagram_cells import cells_of_diagram
from .pages.sweep_view import MOTIONS
from .plot import DRAWN
from .style import COLOURS, NO_MOTIONS, NO_ORBITS, PALE, STYLE, label_of, machine_title, small_type

MAP = "viridis"  # of colours; it is read in print and by colour-blind readers
NOTHING = "0.93"  # the grey of parameters without an orbit
# Styles of the parts of a diagram, by the status of the members there, and of the edges between them.
STYLES: dict[str, dict[str, Any]] = {
    "certified": {"fc": COLOURS[0], "ec": COLOURS[0], "lw": 0.8, "label": "motions"},
    "inadmissible": {"fc": PALE, "ec": PALE, "lw": 0.8, "label": NO_MOTIONS},
    "no orbit": {"fc": NOTHING, "ec": NOTHING, "lw": 0.8, "label": NO_ORBITS, "zorder": 1.5},
    "ends": {"fc": NOTHING, "ec": NOTHING, "lw": 0.8, "label": "beyond a fold", "zorder": 1.5},
    "failed": {"fc": "white", "ec": "0.8", "hatch": "///", "lw": 0, "label": "not known", "zorder": 1.6},
    "not reached": {"fc": "white", "ec": "0.8", "hatch": "///", "lw": 0, "label": "not reached", "zorder": 1.6},
}
EDGES: dict[str, dict[str, Any]] = {
    "edge of the orbits": {"color": "0.1", "lw": 1.4, "zorder": 3},
    "edge of the motions": {"color": COLOURS[1], "lw": 1.4, "zorder": 3},
}


def plot_sweep(sweep: Any, quantity: str, axes: Axes | None = None) -> Axes:
    """Plot a quantity of a sweep over its parameters; return the axes, for more than two the first of the matrix, which
    takes no `axes`."""
    values = sweep[quantity]
    if values.dtype == object:
        raise InputError(f"'{quantity}' is not a number: choose one of {', '.join(sweep.numbers)}")
    if len(sweep.about["families"]) > 1 and len(sweep.parameters) > 1:
        raise InputError("a figure over two or more parameters shows one family: plot sweep.of_family(n)")
    if len(sweep.parameters) == 1:
        return _over_one(sweep, quantity, axes_or_new(axes))
    if len(sweep.parameters) == 2:
        return _surface(sweep, quantity, axes_or_new(axes, 0.75))
    if axes is not None:
        raise InputError(
            f"axes: a sweep over {len(sweep.parameters)} parameters needs a figure of its own: leave axes out"
        )
    return _matrix(sweep, quantity)


def _motions(sweep: Any) -> np.ndarray:
    """Which members (k,) are motions."""
    return np.isin(sweep["status"].astype(str), MOTIONS)


def _over_one(sweep: Any, quantity: str, axes: Axes) -> Axes:
    """A quantity over the one parameter; for each family a line, dotted where it has no motions."""
    (name,), families = sweep.parameters, sweep.about["families"]
    for k, family in enumerate(families):
        rows = np.flatnonzero(sweep.index % len(families) == k)
        rows = rows[np.argsort(sweep[name][rows], kind="stable")]
        x, y, motion = sweep[name][rows], sweep[quantity][rows], _motions(sweep)[rows]
        style = {"color": COLOURS[k % len(COLOURS)], **({"marker": "o", "ms": 3} if len(rows) <= 60 else {})}
        others, nothing = ~motion & np.isfinite(y), ~np.isfinite(y)
        names = [f"family {family}" if len(families) > 1 else "motions", NO_MOTIONS, NO_ORBITS]
        known = axes.get_legend_handles_labels()[1]
        own, dotted, ticks = (None if each in known else each for each in names)
        if (shown := motion & ~nothing).any():
            axes.plot(x, np.where(shown, y, np.nan), label=own, **style)
        if others.any():
            axes.plot(x, np.where(others, y, np.nan), ls=":", label=dotted, **style)
        if nothing.any():
            axes.plot(x[nothing], np.zeros(nothing.sum()), "|", color="0.4", ms=6, label=ticks,
                      transform=axes.get_xaxis_transform(), clip_on=False)  # fmt: skip
    return _labelled(axes, sweep, name, quantity)


def _surface(sweep: Any, quantity: str, axes: Axes) -> Axes:
    """A quantity over two parameters as colours, hatched where there is no motion and grey where there is nothing."""
    across, up = sweep.parameters
    shape = sweep.about["shape"]
    x, y, z, motion = sweep[across], sweep[up], sweep[quantity], _motions(sweep)
    axes.set_facecolor(NOTHING)
    contours = None
    if shape is not None and len(x) == np.prod(shape):
        grid: list[Any] = [column.reshape(shape) for column in (x, y, np.ma.masked_invalid(z), motion)]
        order = np.argsort(grid[0][:, 0]), np.argsort(grid[1][0])
        x, y, z, motion = (part[order[0]][:, order[1]] for part in grid)
        drawn = axes.pcolormesh(x, y, z, cmap=MAP, shading="nearest", rasterized=True)
        if z.count() and np.ptp(z.compressed()) > 0 and min(shape) > 2:
            contours = axes.contour(x, y, z, DRAWN.contours, colors="white", linewidths=0.7)
        if not motion.all() and min(shape) > 1:
            axes.contourf(x, y, ~motion * 1.0, [0.5, 1.5], colors="none", hatches=["////"])
            axes.fill_between([], [], fc="none", ec="0.3", hatch="////", lw=0, label=NO_MOTIONS)
    else:
        known = np.isfinite(z)
        axes.plot(x[~known], y[~known], "x", color="0.4", ms=4, label=NO_ORBITS if (~known).any() else None)
        drawn = axes.scatter(x[known], y[known], c=z[known], s=_size(len(x)), cmap=MAP)
        if (others := known & ~motion).any():
            axes.plot(x[others], y[others], "o", mfc="none", mec="0.1", ms=5, mew=0.8, label=NO_MOTIONS)
    bar = colour_bar(axes, drawn, _axis_label(sweep, quantity))
    if contours is not None:
        bar.add_lines(contours)
    return _labelled(axes, sweep, across, up)


def plot_existence(diagram: Any, quantity: str | None = None, axes: Axes | None = None) -> Axes:
    """Plot where a family has orbits in two parameters (light) and where they are motions (dark), or a quantity of the
    orbits in colours, and the edges of both; return the axes."""
    from matplotlib.collections import LineCollection, PolyCollection

    axes, sweep = axes_or_new(axes, 0.75), diagram.grid
    cells = list(cells_of_diagram(diagram))
    styles = (
        STYLES
        if quantity is None
        else {status: style for status, style in STYLES.items() if status not in ("certified", "inadmissible")}
    )
    if quantity is not None:
        x, y, z = (sweep[name].reshape(sweep.about["shape"]) for name in (*sweep.parameters, quantity))
        drawn = axes.pcolormesh(x, y, _beyond_edges(z), cmap=MAP, shading="nearest", rasterized=True)
        colour_bar(axes, drawn, _axis_label(sweep, quantity))
    for status, fill in styles.items():
        if shown := [polygon for polygons, _ in cells for own, polygon in polygons if own == status]:
            axes.add_collection(PolyCollection(shown, **fill, snap=False))  # cells with curved sides meet the others
    for kind, style in EDGES.items():
        if pieces := [piece for _, lines in cells for own, piece in lines if own == kind]:
            axes.add_collection(LineCollection(pieces, **style, label=kind, capstyle="round", snap=False))
    axes.set(xlim=diagram.between, ylim=(diagram.values[0], diagram.values[-1]))
    return _labelled(axes, sweep, diagram.along, diagram.across)


def _beyond_edges(z: np.ndarray) -> np.ndarray:
    """The values (m, n) on a grid, where there are none the mean of the neighbours', so that colours reach to edges
    between the nodes."""
    padded = np.pad(z, 1, constant_values=np.nan)
    around = np.ma.masked_invalid(np.lib.stride_tricks.sliding_window_view(padded, (3, 3)))
    return np.ma.where(np.isfinite(z), z, around.mean(axis=(2, 3)))


def _matrix(sweep: Any, quantity: str) -> Axes:
    """Every pair of parameters, with the quantity as colour, and below the quantity over each parameter."""
    names, values = sweep.parameters, sweep[quantity]
    count, known = len(names), np.isfinite(values)
    panels: Axes = new_row(count, 1.2, count, STYLE.screen)
    engine = panels[0, 0].figure.get_layout_engine()
    engine.stacks = False
    engine.set(w_pad=0.02)
    size = _size(len(values)) / 2
    for i, j in np.ndindex(count, count):
        axes: Axes = panels[i, j]
        if j > i:
            axes.set_axis_off()
            continue
        x, y = sweep[names[j]], values if i == j else sweep[names[i]]
        if i != j:
            axes.plot(x[~known], y[~known], ".", color="0.8", ms=2, zorder=0, rasterized=True)
        drawn = axes.scatter(x[known], y[known], c=values[known], s=size, cmap=MAP, lw=0, rasterized=True)
        if i == j > 0:  # the axis has another meaning than those of its row
            entitled(axes, _axis_label(sweep, quantity)).title.set_size(small_type(axes))
        up = quantity if i == j == 0 else names[i] if i > j == 0 else ""
        labels = (_axis_label(sweep, name) for name in (names[j] if i == count - 1 else "", up))
        across, beside = (label.replace(" (", "\n(") for label in labels)  # a unit has a line of its own
        axes.set_xlabel(across, labelpad=12)  # below the power of ten of the ticks
        axes.set_ylabel(beside)
        for name, one in ((names[j], "x"), ("" if i == j else names[i], "y")):
            if name in sweep.about["logarithmic"]:
                _scale(axes, sweep, name, one)
            else:
                axes.ticklabel_format(axis=one, scilimits=(-3, 4))  # long numbers would meet
    figure, corner = panels[0, 0].figure, panels[0, 1].inset_axes((0.3, 0.6, count - 1.4, 0.1))
    corner.set_in_layout(False)
    colour_bar(panels[0, 0], drawn, _axis_label(sweep, quantity), corner)
    figure.suptitle(_title_of(sweep), fontsize=panels[0, 0].title.get_size())
    return panels[0, 0]


def _size(count: int) -> float:
    """The area of a mark, smaller for more of them."""
    return float(np.clip(6000 / count, 1.0, 24.0))


def _axis_label(sweep: Any, name: str) -> str:
    """A name for an axis, with its unit."""
    return label_of(name, sweep.unit_of(name)) if name else ""


def _title_of(sweep: Any) -> str:
    """The title of a figure: the machine with its families, and its laws, in two lines."""
    families = ", ".join(map(str, sweep.about["families"])) if sweep.about["outcome"] == "find" else ""
    return machine_title(sweep.about["machine"], families and f", family {families}", tuple(sweep.parameters))


def _scale(axes: Axes, sweep: Any, name: str, which: str) -> None:
    """A logarithmic axis for a parameter that is swept over decades."""
    if name in sweep.about["logarithmic"]:
        getattr(axes, f"set_{which}scale")("log")


def _labelled(axes: Axes, sweep: Any, across: str, up: str) -> Axes:
    """The axes with their title, names, scales and, where something has a label, a legend below."""
    axes.set(xlabel=_axis_label(sweep, across), ylabel=_axis_label(sweep, up))
    entitled(axes, _title_of(sweep))
    _scale(axes, sweep, across, "x")
    _scale(axes, sweep, up, "y")
    return legend_below(axes)
