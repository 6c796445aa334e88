"""What matplotlib has drawn as figures of Bokeh: every result that has a plot has a page with hover and zoom.

Curves, marks, areas, cells of colours and texts are taken as they are drawn; a legend names what has a label.
"""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...result import Axes
from .bokeh_figures import EDGE, PAGE, bokeh, hover, legend_above, new_figure

DASHES = {"-": "solid", "--": "dashed", ":": "dotted", "-.": "dashdot"}
MARKS = {"s": "square", "^": "triangle", "v": "inverted_triangle", "D": "diamond", "d": "diamond", "x": "x", "X": "x"}
MARKS |= {"+": "cross", "P": "cross", "*": "star", "|": "dash", "_": "dash", "<": "triangle", ">": "triangle"}
BASELINES = {"center": "middle", "baseline": "alphabetic", "top": "top", "bottom": "bottom"}
PIXELS = 96 / 72  # of a point of matplotlib


class Cells(NamedTuple):
    """Coloured rectangles: their edges, (k,) each, the numbers that they stand for, and their colours."""

    left: np.ndarray
    right: np.ndarray
    bottom: np.ndarray
    top: np.ndarray
    value: np.ndarray
    colour: list[str]


def drawn_figures(axes: Axes) -> list[list[Any]]:
    """The panels of the figure that these axes are in as figures of Bokeh, row by row."""
    panels = [
        each for each in axes.figure.axes if each.get_visible() and each.axison and not hasattr(each, "_colorbar")
    ]
    labels = [[panel.get_title(), panel.get_xlabel(), panel.get_ylabel()] for panel in panels]  # before they are broken
    axes.figure.draw_without_rendering()  # limits and colours are known then
    rows, ranges = dict[tuple[int, ...], list[Any]](), dict[Any, Any]()
    places = [_row_of(panel) for panel in panels]
    for panel, texts, place in zip(panels, labels, places, strict=True):
        shared = [ranges[other] for other in panel.get_shared_x_axes().get_siblings(panel) if other in ranges]
        height = PAGE.heights_of_panels[len({*places}) > 1]
        figure = _Panel(panel, [words(text).replace("\n", ", ") for text in texts], height, *shared[:1]).figure
        ranges[panel] = figure.x_range
        rows.setdefault(place, []).append(figure)
    return [rows[place] for place in sorted(rows)]


def _row_of(panel: Axes) -> tuple[int, ...]:
    """The row of a panel in the grid of its figure, and within the place that it shares there with others."""
    place = panel.get_subplotspec()
    return (place.get_topmost_subplotspec().rowspan.start, place.rowspan.start) if place else (0, 0)


def words(text: str) -> str:
    """A text of matplotlib without its mathematics, which are raised fractions (`style.label_of`)."""
    return re.sub(r"(?<!\\)\$\^\{(.*?)\}\$", r"^(\1)", text).replace(r"\$", "$")


def _hex(colour: Any) -> str:
    """A colour with its opacity as Bokeh takes it; none for none."""
    from matplotlib.colors import to_hex

    return to_hex(colour, keep_alpha=True)


def _clear(colour: Any) -> bool:
    """Whether nothing is seen of a colour."""
    from matplotlib.colors import to_rgba

    return to_rgba(colour)[3] == 0


def _pale(colour: Any) -> bool:
    """Whether a colour is hardly seen on a white page."""
    return not _clear(colour) and min(colour[:3]) > PAGE.pale


class _Panel:
    """One panel as a figure of Bokeh, built artist by artist in the order in which matplotlib draws them."""

    def __init__(self, axes: Axes, labels: list[str], height: int, x_range: Any = None):
        models = bokeh("models")
        self.axes, self.renderers, self.cells, self.lines = axes, dict[Any, list[Any]](), list[Any](), list[Any]()
        options = {f"{one}_axis_type": getattr(axes, f"get_{one}scale")() for one in "xy"}
        if axes.get_aspect() == "auto":
            options |= {
                "x_range": x_range or models.Range1d(*axes.get_xlim()),
                "y_range": models.Range1d(*axes.get_ylim()),
            }
        else:  # as a circle is one
            options |= {"x_range": models.DataRange1d(), "y_range": models.DataRange1d(), "match_aspect": True}
        title, self.across, self.up = labels
        self.figure = new_figure(title, height, **options)
        self.figure.background_fill_color = _hex(axes.get_facecolor())
        self.figure.xaxis.axis_label, self.figure.yaxis.axis_label = self.across, self.up
        self._name_ticks(self.figure.xaxis, axes.xaxis)
        self._name_ticks(self.figure.yaxis, axes.yaxis)
        for artist in sorted(axes.get_children(), key=lambda each: each.get_zorder()):
            if artist.get_visible():
                self._add(artist)
        self._finish()

    def _name_ticks(self, axis: Any, of: Any) -> None:
        """Give an axis the words that stand at its ticks in place of numbers, where there are such."""
        texts = of.get_major_formatter()
        if type(texts).__name__ in ("FixedFormatter", "FuncFormatter") and of.get_majorticklocs().size:
            places = of.get_majorticklocs().tolist()
            names = [words(label.get_text()) for label in of.get_ticklabels()]
            axis.ticker = bokeh("models").FixedTicker(ticks=places)
            axis.major_label_overrides = dict(zip(places, names, strict=True))

    def _add(self, artist: Any) -> None:
        """Add an artist of matplotlib; anything but data, such as a spine, is left to Bokeh."""
        from matplotlib.collections import Collection, PathCollection, QuadMesh
        from matplotlib.image import AxesImage
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch
        from matplotlib.spines import Spine
        from matplotlib.text import Text

        if isinstance(artist, Line2D):
            self._add_line(artist)
        elif isinstance(artist, PathCollection):
            self._add_points(artist)
        elif isinstance(artist, QuadMesh | AxesImage):
            self._add_cells(artist)
        elif isinstance(artist, Collection):
            self._add_areas(artist, list(artist.get_paths()), getattr(artist, "hatches", [artist.get_hatch()]))
        elif isinstance(artist, Patch) and artist is not self.axes.patch and not isinstance(artist, Spine):
            self._add_areas(artist, [artist.get_path()], [artist.get_hatch()])
        elif isinstance(artist, Text) and artist in self.axes.texts:
            self._add_text(artist)

    def _in_data(self, points: Any, transform: Any) -> np.ndarray:
        """Points (k, 2) as they are counted along the axes; those of other transforms are taken at the limits."""
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        if transform == self.axes.transData:
            return points
        return np.asarray((transform - self.axes.transData).transform(points))

    def _keep(self, artist: Any, renderers: Sequence[Any], shows_values: bool = True) -> None:
        """Keep what an artist has become, for the legend and the tooltips."""
        self.renderers[artist] = [*renderers]
        label = str(artist.get_label())
        for renderer in renderers:
            renderer.name = "" if label.startswith("_") else words(label)
        self.lines += renderers if shows_values else []

    def _add_line(self, line: Any) -> None:
        from matplotlib.cbook import STEP_LOOKUP_MAP

        x, y = self._in_data(np.column_stack(line.get_data(orig=False)), line.get_transform()).T
        if line.get_drawstyle() in STEP_LOOKUP_MAP and len(x):
            x, y = STEP_LOOKUP_MAP[line.get_drawstyle()](x, y)
        colour, drawn = _hex(_seen(line.get_color(), line)), list[Any]()
        if line.get_linestyle() in DASHES:
            style = {"line_dash": DASHES[line.get_linestyle()], "line_width": PIXELS * line.get_linewidth()}
            drawn.append(self.figure.line("x", "y", source=_columns(x=x, y=y), line_color=colour, **style))
        if (mark := line.get_marker()) not in ("", " ", "None", "none", None):
            step = -(-len(x) // PAGE.members) or 1
            size = PIXELS * line.get_markersize() * dict(PAGE.small_marks).get(mark, 1.0)
            look = {
                "fill_color": _hex(_seen(line.get_markerfacecolor(), line)),
                "line_width": line.get_markeredgewidth(),
            }
            look |= {"line_color": _hex(_seen(line.get_markeredgecolor(), line)), "angle": np.pi / 2 * (mark == "|")}
            source = _columns(x=x[::step], y=y[::step])
            drawn.append(
                self.figure.scatter("x", "y", source=source, marker=MARKS.get(mark, "circle"), size=size, **look)
            )
        self._keep(line, drawn, shows_values=line.get_transform() == self.axes.transData)

    def _add_points(self, points: Any) -> None:
        places = self._in_data(np.ma.filled(points.get_offsets(), np.nan), points.get_offset_transform())
        step = -(-len(places) // PAGE.members) or 1
        rows = np.arange(0, len(places), step)
        colours = [_hex(each) for each in points.get_facecolor()] or ["#00000000"]
        edges = [_hex(each) for each in points.get_edgecolor()] or ["#00000000"]
        sizes = PIXELS * np.sqrt(np.resize(points.get_sizes(), len(places)))[rows]
        columns = {"x": places[rows, 0], "y": places[rows, 1], "size": sizes}
        columns |= {"fill": [colours[i % len(colours)] for i in rows], "edge": [edges[i % len(edges)] for i in rows]}
        if points.get_array() is not None:
            columns["value"] = np.asarray(points.get_array(), dtype=float)[rows]
        style = {"size": "size", "fill_color": "fill", "line_color": "edge"}
        drawn = self.figure.scatter("x", "y", source=_columns(**columns), **style)
        self._keep(points, [drawn], shows_values="value" not in columns)
        self.cells += [drawn] if "value" in columns else []
        self._add_bar(points)

    def _add_cells(self, artist: Any) -> None:
        cells = _cells_of_image(artist) if hasattr(artist, "get_extent") else _cells_of_mesh(artist)
        edges = {"left": "left", "right": "right", "bottom": "bottom", "top": "top"}
        drawn = self.figure.quad(**edges, source=_columns(**cells._asdict()), fill_color="colour", line_color=None)
        self._keep(artist, [drawn], shows_values=False)
        self.cells.append(drawn)
        self._add_bar(artist)

    def _add_areas(self, artist: Any, paths: list[Any], hatches: Sequence[Any]) -> None:
        """Add areas, and curves of a collection that are not filled."""
        transform = artist.get_transform()
        fills, edges = (np.reshape(_rgba(each), (-1, 4)) for each in (artist.get_facecolor(), artist.get_edgecolor()))
        widths, drawn = np.atleast_1d(artist.get_linewidth()), list[Any]()
        dashed = _dash_of(artist)
        for i, path in enumerate(paths):
            pieces = [self._in_data(each, transform) for each in path.to_polygons(closed_only=False) if len(each) > 1]
            xs, ys = ([piece[:, k] for piece in pieces] for k in (0, 1))
            fill = fills[i % len(fills)] if len(fills) else np.zeros(4)
            edge = edges[i % len(edges)] if len(edges) else np.zeros(4)
            hatch = hatches[i % len(hatches)] if len(hatches) else None
            if _pale(fill) and _clear(edge):
                edge = _rgba(EDGE)[0]
            style = {
                "line_color": _hex(edge),
                "line_width": PIXELS * float(widths[i % len(widths)]),
                "line_dash": dashed,
            }
            if _clear(fill) and not hatch:
                drawn.append(self.figure.multi_line("x", "y", source=_columns(x=xs, y=ys), **style))
                continue
            look = {"hatch_pattern": "right_diagonal_line", "hatch_color": _hex(edge)} if hatch else {}
            source = _columns(x=xs, y=ys)
            drawn.append(self.figure.patches("x", "y", source=source, fill_color=_hex(fill), **style, **look))
        if not paths and str(artist.get_label())[:1] != "_":
            hatch = {"hatch_pattern": "right_diagonal_line"} if artist.get_hatch() else {}
            drawn.append(self.figure.patches("x", "y", source=_columns(x=[], y=[]), fill_color=None, **hatch))
        self._keep(artist, drawn, shows_values=False)

    def _add_text(self, text: Any) -> None:
        """Add a text, or an annotation at an offset in points from its place."""
        beside = getattr(text, "anncoords", "") == "offset points"
        own = (text.xy, self.axes.transData) if beside else (text.get_position(), text.get_transform())
        ((x, y),) = self._in_data(*own)
        aside, up = PIXELS * np.array(text.xyann if beside else (0.0, 0.0))
        style = {"text_align": text.get_ha(), "text_baseline": BASELINES.get(text.get_va(), "middle")}
        style |= {"x_offset": float(aside), "y_offset": -float(up), "text_color": _hex(text.get_color())}
        source = _columns(x=[x], y=[y], text=[words(text.get_text())])
        self.figure.text("x", "y", "text", source=source, text_font_size="12px", **style)

    def _add_bar(self, mappable: Any) -> None:
        """Add the bar of colours that matplotlib has drawn of an artist, if there is one."""
        if (bar := mappable.colorbar) is None:
            return
        models = bokeh("models")
        kind = models.LogColorMapper if type(mappable.norm).__name__ == "LogNorm" else models.LinearColorMapper
        palette = [_hex(colour)[:7] for colour in mappable.cmap(np.linspace(0, 1, 256))]
        mapper = kind(palette=palette, low=float(mappable.norm.vmin), high=float(mappable.norm.vmax))
        label = words(bar.ax.get_ylabel() or bar.ax.get_xlabel())
        plain = {"title_text_font_style": "normal", "title_text_font_size": "12px", "height": 12}
        self.figure.add_layout(models.ColorBar(color_mapper=mapper, title=label, **plain), "below")

    def _finish(self) -> None:
        """Add the legend and the tooltips."""
        items = list[Any]()
        for handle, label in zip(*self.axes.get_legend_handles_labels(), strict=True):
            parts = handle if isinstance(handle, tuple) else (handle,)  # a container, such as bars, is a tuple
            if renderers := [drawn for part in parts for drawn in self.renderers.get(part, [])]:
                items.append(bokeh("models").LegendItem(label=words(label), renderers=renderers))
        if items:
            legend = self.axes.get_legend()
            names = [words(text.get_text()) for text in legend.get_texts()] if legend else []
            items.sort(key=lambda item: names.index(item.label.value) if item.label.value in names else len(names))
            widest = max(len(item.label.value) for item in items)
            legend_above(self.figure, *items, columns=max(1, min(4, PAGE.letters_of_legend // (widest + 6))))
        at_pointer = [(self.across, "$x{%.7g}"), (self.up, "$y{%.7g}")]
        if self.lines:
            self.figure.add_tools(hover(self.lines, [("", "$name"), (self.across, "@x{%.7g}"), (self.up, "@y{%.7g}")]))
        if self.cells:
            bars = [each.colorbar.ax.get_ylabel() for each in self.renderers if getattr(each, "colorbar", None)]
            value = (words(bars[0]) if bars else "value", "@value{%.7g}")
            self.figure.add_tools(hover(self.cells, [*at_pointer, value]))
        if not (self.lines or self.cells):
            named = [each for each in self.figure.renderers if each.name]
            self.figure.add_tools(hover(named, [("", "$name"), *at_pointer]))


def _columns(**columns: Any) -> Any:
    """A source of Bokeh with these columns."""
    return bokeh("models").ColumnDataSource(columns)


def _rgba(colours: Any) -> np.ndarray:
    from matplotlib.colors import to_rgba_array

    return to_rgba_array(colours)


def _seen(colour: Any, artist: Any) -> Any:
    """A colour with the opacity of an artist."""
    from matplotlib.colors import to_rgba

    return to_rgba(colour) if artist.get_alpha() is None else to_rgba(colour, artist.get_alpha())


def _dash_of(artist: Any) -> str:
    """The dashes of a collection or of a patch."""
    style = artist.get_linestyle()
    one = style[0] if isinstance(style, list) and style else style
    return ("solid" if one[1] is None else "dashed") if isinstance(one, tuple) else DASHES.get(one, "solid")


def _numbers(mappable: Any) -> np.ndarray:
    """The numbers that colours stand for, NaN where there is none."""
    return np.ma.filled(np.ma.asarray(mappable.get_array()).astype(float), np.nan)


def _cells_of_mesh(mesh: Any) -> Cells:
    """The cells of a mesh whose edges are parallel to the axes, in whatever order."""
    corners, values = np.asarray(mesh.get_coordinates()), _numbers(mesh)
    around = np.array([corners[i : i - 1 or None, j : j - 1 or None] for i in (0, 1) for j in (0, 1)])
    (left, bottom), (right, top) = (np.moveaxis(ends, -1, 0).reshape(2, -1) for ends in (around.min(0), around.max(0)))
    return _known_cells(left, right, bottom, top, values.ravel(), mesh)


def _cells_of_image(image: Any) -> Cells:
    """The cells of an image."""
    values, (left, right, bottom, top) = _numbers(image), image.get_extent()
    first, last = (top, bottom) if image.origin == "upper" else (bottom, top)
    x, y = (np.linspace(a, b, n + 1) for a, b, n in zip((left, first), (right, last), values.shape[::-1], strict=True))
    ends = [np.meshgrid(x[:-1], y[:-1]), np.meshgrid(x[1:], y[1:])]
    (left, bottom), (right, top) = ([each.ravel() for each in end] for end in ends)
    return _known_cells(left, right, bottom, top, values.ravel(), image)


def _known_cells(
    left: np.ndarray, right: np.ndarray, bottom: np.ndarray, top: np.ndarray, values: np.ndarray, mappable: Any
) -> Cells:
    """The cells with these edges and values (k,); those without a value are left out."""
    known = np.isfinite(values)
    colours = [_hex(each)[:7] for each in mappable.to_rgba(values[known])]
    return Cells(left[known], right[known], bottom[known], top[known], values[known], colours)
