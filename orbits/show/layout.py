"""The layout of figures in the style: whenever one is drawn, its texts and legends are fitted to its width."""

import re
import textwrap
from functools import partial
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import AutoLocator

from .style import STYLE, columns_of_legend, place_legend

GLUE = "\xa0"  # a blank at which a line is never broken


class Layout(ConstrainedLayoutEngine):
    """A constrained layout that breaks the lines of titles and names of axes where they have no room, takes as many
    ticks as there is room for, and gives legends below axes their columns and their distance."""

    def __init__(self) -> None:
        super().__init__()
        self.stacks = True  # whether narrow panels may be placed below each other
        self.size: tuple[float, ...] = ()  # of the figure when it was laid out
        self.whole = dict[Any, tuple[str, str]]()  # texts as they were set, and as they are broken
        self.ticks = dict[Any, int]()  # of axes, at most
        self.columns = dict[Any, int]()  # of the legends below axes
        self.depths = dict[Any, float]()  # of these, in their font sizes

    def execute(self, fig: Any) -> Any:
        """Lay the figure out, and again where what had to be fitted to the room that this left takes another one."""
        every = fig.findobj(lambda artist: hasattr(artist, "axison"))  # second axes and those within others too
        drawn = [axes for axes in every if axes.get_visible() and axes.axison]
        for axes in drawn:
            _give_type(axes)
            self._fit_legend(axes)
        result = super().execute(fig)
        for _ in range(STYLE.layouts):
            changed = [self._fit(text, fig.bbox.width) for text in fig.texts]
            for axes in drawn:
                if axes.get_adjustable() == "box":  # else an aspect changes the limits, and not the place
                    locate = axes.get_axes_locator()
                    axes.apply_aspect(locate(axes, None) if locate else None)
                changed += [self._fit_ticks(axes), self._fit_texts(axes), self._lower_legend(axes)]
            size = tuple(fig.get_size_inches())
            if size == self.size and not any(changed):
                break
            self.size, result = size, super().execute(fig)
        return result

    def _fit_ticks(self, axes: Any) -> bool:
        """Take as many ticks with numbers as there is room for; whether there are more or fewer."""
        changed = False
        for axis, room in ((axes.xaxis, axes.bbox.width), (axes.yaxis, axes.bbox.height)):
            if isinstance(locator := axis.get_major_locator(), AutoLocator):
                boxes = [label.get_window_extent() for label in axis.get_ticklabels() if label.get_text()]
                widest = max((box.width if axis is axes.xaxis else 1.5 * box.height for box in boxes), default=1.0)
                count = int(np.clip(room / (STYLE.tick * widest), 1, STYLE.ticks))
                locator.set_params(nbins=count, min_n_ticks=1)
                changed, self.ticks[axis] = changed or self.ticks.get(axis) != count, count
        return changed

    def _fit_legend(self, axes: Any) -> None:
        legend = axes.get_legend()
        if legend in self.columns:
            names = [text.get_text() for text in legend.get_texts()]
            if columns_of_legend(axes, names) != self.columns[legend]:
                place_legend(axes, legend.legend_handles, names)

    def _lower_legend(self, axes: Any) -> bool:
        """Move a legend below the numbers and the name of the axis; whether it has moved."""
        if (legend := axes.get_legend()) not in self.columns:
            return False
        em, box = legend.get_texts()[0].get_size() / 72 * axes.figure.dpi, axes.xaxis.get_tightbbox()
        below = axes.bbox.y0 if box is None else box.y0  # an axis may have neither numbers nor a name
        depth = (axes.bbox.y0 - below) / em + STYLE.legend_gap - STYLE.legend_below
        moved, self.depths[legend] = abs(depth - self.depths.get(legend, 0.0)) > STYLE.legend_gap / 2, depth
        legend.set_bbox_to_anchor((0.5, -depth * em / axes.bbox.height), axes.transAxes)
        return moved

    def _fit_texts(self, axes: Any) -> bool:
        """Break the lines of the title and the names of the axes; whether any has changed."""
        figure, box = axes.figure, axes.bbox
        left, right, middle = figure.bbox.x0, figure.bbox.x1, 0.5 * (box.x0 + box.x1)
        if place := axes.get_subplotspec():
            place = place.get_topmost_subplotspec()
            cell = figure.bbox.width / place.get_gridspec().ncols
            left, right = cell * place.colspan.start, cell * place.colspan.stop
        across = 2 * min(middle - left, right - middle)
        texts = ((axes.title, right - left), (axes.xaxis.label, across), (axes.yaxis.label, box.height + STYLE.margin))
        axes.title.set_x((0.5 * (left + right) - box.x0) / box.width)
        changed = [self._fit(text, room) for text, room in texts if text.get_text()]
        return any(changed)

    def _fit(self, text: Any, room: float) -> bool:
        """Break the lines of a text that are longer than the room in pixels; whether it has changed."""
        shown = text.get_text()
        whole, before = self.whole.get(text, (shown, shown))
        if before != shown:  # it was set anew
            whole = shown
        letters = max(map(len, whole.split("\n")))
        while True:
            lines = [part for line in whole.split("\n") for part in _broken(line, letters)]
            text.set_text("\n".join(lines))
            box = text.get_window_extent()
            length = (box.width if text.get_rotation() == 0 else box.height) + STYLE.margin
            if length <= room or letters < STYLE.shortest:
                break
            letters = min(letters - 1, int(letters * room / length) + 3)
        self.whole[text] = whole, text.get_text()
        return text.get_text() != shown

    def stack(self, figure: Any) -> None:
        """Place the panels of a figure below each other, unless they are a matrix."""
        places = {axes: axes.get_subplotspec() for axes in figure.axes if axes.get_subplotspec() is not None}
        cells = {(cell.num1, cell.num2): cell for cell in (each.get_topmost_subplotspec() for each in places.values())}
        if not self.stacks or not cells:
            return
        grid = next(iter(cells.values())).get_gridspec()
        new, within = figure.add_gridspec(len(cells), 1), dict[Any, Any]()
        rows = {cell: new[i] for i, cell in enumerate(sorted(cells))}
        for axes, place in places.items():
            cell, own = place.get_topmost_subplotspec(), place.get_gridspec()
            row = rows[cell.num1, cell.num2]
            if own is not grid:  # panels within a panel keep their shares of it
                ratios = {"width_ratios": own.get_width_ratios(), "height_ratios": own.get_height_ratios()}
                inner = within.setdefault(own, row.subgridspec(own.nrows, own.ncols, **ratios))
                row = inner[place.rowspan.start : place.rowspan.stop, place.colspan.start : place.colspan.stop]
            axes.set_subplotspec(row)


def _give_type(axes: Any) -> None:
    """Give texts of axes the type of the style where they have matplotlib's, as a new title or a second axis has."""
    sizes = {axes.title: "axes.titlesize", axes.xaxis.label: "axes.labelsize", axes.yaxis.label: "axes.labelsize"}
    for text, name in sizes.items():
        if text.get_size() == _usual(name):
            text.set_size(STYLE.type)
    for which, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        if any(label.get_size() == _usual(f"{which}tick.labelsize") for label in axis.get_ticklabels()[:1]):
            axes.tick_params(axis=which, labelsize=STYLE.small_type, width=STYLE.frame)


def _usual(name: str) -> float:
    """The size of type in points that matplotlib gives texts of a kind."""
    return FontProperties(size=rcParams[name]).get_size_in_points()


def _broken(line: str, letters: int) -> list[str]:
    """A line broken into ones of at most that many letters, behind commas if possible, and never within a word."""
    wrap = partial(textwrap.wrap, width=letters, break_long_words=False, break_on_hyphens=False)
    behind_commas = wrap(re.sub("(?<!,) ", GLUE, line))
    return [part for whole in behind_commas for part in wrap(whole.replace(GLUE, " "))] or [""]
