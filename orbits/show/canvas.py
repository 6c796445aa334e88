"""Figures in the one style: they are begun here, with axes of some shape, finished with a legend, and written.

A figure begins with `axes_or_new(axes, shape)`, `new_axes(shape)` or `new_row(count, shape)`, where the shape is the
height of the axes over their width. `headline` states its machine, `label_of` names what is on its axes, and `finished`
gives it a legend. `save_figure(axes, path, width)` writes a figure at another width, for which it is laid out again.
"""

import sys
import threading
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, finite_number
from ..io import check_path, writing
from ..result import Axes
from .family_ends import MARKERS_OF_ENDS
from .style import (
    COLOURS,
    MARKERS,
    MOTIONS,
    NO_MOTIONS,
    NO_ORBITS,
    STYLE,
    grid_of,
    is_laid_out,
    machine_title,
    place_legend,
    small_type,
)

FIGURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".eps")
_OFF_SCREEN = ContextVar("off screen", default=False)


@contextmanager
def off_screen() -> Iterator[None]:
    """Where figures are drawn for a file or a page: `new_axes` hides them from pyplot, whatever is loaded."""
    token = _OFF_SCREEN.set(True)
    try:
        yield
    finally:
        _OFF_SCREEN.reset(token)


def _on_screen() -> bool:
    """Whether a new figure is one of pyplot's: in the main thread of a notebook's kernel, and of a program that has
    loaded pyplot, unless it is for a file."""
    if _OFF_SCREEN.get() or threading.current_thread() is not threading.main_thread():
        return False
    if "matplotlib.pyplot" in sys.modules:
        return True
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


def axes_or_new(axes: object, shape: float = 0.68) -> Axes:
    """The axes that are stated, or else new ones of a shape; raises `InputError` for anything but axes."""
    from matplotlib.axes import Axes as Known

    if not (axes is None or isinstance(axes, Known)):
        raise InputError(f"axes = {axes!r}; they must be Axes of matplotlib, such as figure.add_subplot() returns")
    return new_axes(shape) if axes is None else axes


def new_axes(shape: float = 0.68, width: float = STYLE.screen) -> Axes:
    """Axes on a new figure of a width in mm, whose height is the width times the shape.

    In a notebook, and where `matplotlib.pyplot` has been imported before, it is one of pyplot's figures, so that the
    cell or `plt.show()` shows it. Otherwise, in a thread and within `off_screen` no window and no global state of
    matplotlib knows it, and it is gone with the last reference to it.
    """
    axes = dressed(_new_figure(width, width * shape).add_subplot())
    axes.locator_params(steps=STYLE.steps)
    return axes


def new_row(count: int, shape: float = 0.8, rows: int = 1, width: float = STYLE.page) -> np.ndarray:
    """An array of `count` axes of a shape side by side on a new figure of a width in mm, or (rows, count) of them for
    more rows than one."""
    figure = _new_figure(width, rows * shape * width / count)
    figure.get_layout_engine().set(h_pad=0.06, w_pad=0.06)
    axes = figure.subplots(rows, count)
    for one in np.ravel(axes):
        dressed(one).locator_params(steps=STYLE.steps)
    return axes


def _new_figure(width: float, height: float) -> Any:
    """A figure of this size in mm, which is laid out whenever it is drawn."""
    from .layout import Layout

    options: dict[str, Any] = {
        "figsize": (width / STYLE.inch, height / STYLE.inch),
        "dpi": STYLE.dots,
        "layout": Layout(),
    }
    if _on_screen():
        from matplotlib import pyplot

        return pyplot.figure(**options)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(**options)
    FigureCanvasAgg(figure)
    return figure


def dressed(axes: Axes, like: Axes | None = None) -> Axes:
    """The axes, open above and on the right, with the colours and the type of the style, or of other axes in their
    figure."""
    size = STYLE.type if like is None else like.xaxis.label.get_size()
    small = size * STYLE.small_type / STYLE.type
    for text in (axes.title, axes.xaxis.label, axes.yaxis.label):
        text.set_size(size)
    for axis in (axes.xaxis, axes.yaxis):
        axis.offsetText.set_size(small)
    axes.tick_params(which="both", labelsize=small, width=STYLE.frame)
    axes.spines[:].set_linewidth(STYLE.frame)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_prop_cycle(color=COLOURS)
    return axes


def headline(axes: Axes, machine: Mapping[str, Any], first: str = "", without: Collection[str] = ()) -> Axes:
    """Give axes a title with a machine in words and numbers, as it describes itself, in lines that fit; return them.

    first : further words of its first line
    without : names of parameters whose values are not stated, as those along an axis
    """
    return entitled(axes, machine_title(machine, first, without))


def entitled(axes: Axes, text: str) -> Axes:
    """Give axes a title, whose lines are broken where they are too long; return them."""
    axes.set_title(text, fontsize=axes.xaxis.label.get_size(), wrap=not is_laid_out(axes))
    return axes


def colour_bar(axes: Axes, drawn: Any, label: str, own: Axes | None = None) -> Any:
    """The bar of the colours of what is drawn on axes, next to these or, level, in axes of its own."""
    place = {"ax": axes} if own is None else {"cax": own, "orientation": "horizontal"}
    bar = axes.figure.colorbar(drawn, label=label, **place)
    dressed(bar.ax, axes)
    bar.outline.set_visible(False)
    return bar


def finished(axes: Axes, legend: Mapping | None = None, **labels: object) -> Axes:
    """The axes with limits and labels, open above and on the right; with a legend below, or where `legend` says."""
    axes.set(**labels)
    axes.spines[["top", "right"]].set_visible(False)
    if legend is None:
        return legend_below(axes)
    axes.legend(frameon=False, fontsize=small_type(axes), **legend)
    return axes


def legend_below(axes: Axes, of: Axes | None = None) -> Axes:
    """Give axes a legend below them, in as many columns as there is room for; return them.

    of : the axes whose labelled curves it names, by default these
    """
    last = {MOTIONS, NO_MOTIONS, NO_ORBITS, *MARKERS, *MARKERS_OF_ENDS}  # curves are named before the marks on them
    entries = list(zip(*(of or axes).get_legend_handles_labels(), strict=True))
    entries.sort(key=lambda entry: entry[1] in last and hasattr(entry[0], "get_marker"))
    if entries:
        place_legend(axes, *map(list, zip(*entries, strict=True)))
    return axes


def set_width(axes: Axes, width: float) -> None:
    """Give the figure of some axes another width in mm and a height in proportion; panels that would be too narrow are
    placed below each other."""
    width = finite_number("width", width)
    if width < STYLE.panel:
        raise InputError(f"width = {width:g} mm; a figure must be at least {STYLE.panel:g} mm wide")
    figure = axes.figure
    (wide, high), (rows, columns, _) = figure.get_size_inches() * STYLE.inch, grid_of(axes)
    if is_laid_out(axes) and width / columns < STYLE.panel:
        figure.get_layout_engine().stack(figure)
    new_rows, new_columns, _ = grid_of(axes)
    larger = width / wide * columns / new_columns
    height = new_rows * (STYLE.around + (high / rows - STYLE.around) * larger)
    figure.set_size_inches(width / STYLE.inch, height / STYLE.inch)


def save_figure(axes: Axes, path: str | Path, width: float | None = None) -> Path:
    """Write the figure of some axes to a file, its kind from the ending; raises `InputError` when it cannot.

    width : in mm, 85 for a column of a journal and 174 for two; by default as it is
    """
    path = check_path(path, FIGURES)
    if width is not None:
        set_width(axes, width)
    drawn = BytesIO()  # Matplotlib's writers do not all end well where a disk is full
    axes.figure.savefig(drawn, format=path.suffix[1:].lower(), dpi=STYLE.resolution)
    with writing("figure", path) as target:
        target.write_bytes(drawn.getvalue())
    return path
