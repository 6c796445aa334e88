"""Common parts of the Bokeh figures: their styles, their tools, and ranges that do not jump."""

from html import escape
from importlib import import_module
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ...errors import InputError

# A model of Bokeh, the name of one of its properties, and its new value.
Change: TypeAlias = tuple[Any, str, Any]

TOOLS = "pan,box_zoom,wheel_zoom,reset,save"
# Glyphs that move in each frame are drawn on a canvas of their own, so that nothing else is drawn again for them.
MOVING = {"level": "overlay"}
GREY, INK = "#6b6b6b", "#333333"
EDGE = "#9a937c"  # around pale areas and their samples in legends, which it sets off from a light page and a dark one


class PageStyle(NamedTuple):
    """The ranges, samples and labels of figures on pages."""

    filled: float = 0.7  # a range stays as long as the data fill at least this share of it
    flat: float = 1e-9  # values that vary by a smaller share of themselves are constant
    margin: float = 0.06  # next to the data, as a share of their range
    spare: float = 0.1  # additional margin where the data have just grown and are likely to grow further
    # Events nearer than these shares of the figure's width and height have one label.
    near_events: tuple[float, float] = (0.2, 0.07)
    margin_of_labels: float = 0.1  # above and below the curve, for labels at its ends
    aside: int = 11  # pixels from an event to its label
    letter: int = 6  # pixels of the width of a letter
    half_line: int = 8  # pixels of half the height of a label
    on_phone: tuple[int, int] = (270, 250)  # pixels of the width and the height of a family on a phone
    # Multiples of `aside` away from the nearer edge, and down, the better ones first.
    places_of_labels: tuple[tuple[int, int], ...] = ((1, -1), (1, 1), (3, -1), (3, 1))
    avoided: int = 1000  # points of a curve that labels keep away from
    times: int = 160  # at which a hop of a family is sampled
    times_of_family: int = 40  # in addition for each number of its family
    most_times: int = 1200  # of a hop of any family
    extensions: int = 301  # at which a law is sampled
    title: int = 44  # characters that fit above the figure on a phone
    beside_law: float = 0.35  # margin beyond the used range on both sides, as a share of it
    map_samples: int = 1500  # launches of a map that is drawn
    web_hops: int = 60  # of the cobweb in a map
    cycles_per_second: float = 0.4  # of a player, at first
    # Members of a sweep that are shown: a page of more would be large, and their marks would cover each other.
    members: int = 10_000
    reason: int = 200  # characters of a member's reason in its tooltip
    heights_of_panels: tuple[int, int] = (440, 280)  # pixels: of a figure alone, and of one of several rows
    small_marks: tuple[tuple[str, float], ...] = ((".", 0.5), (",", 0.3))  # of matplotlib, with the share of their size
    pale: float = 0.7  # least of red, green and blue of a colour that needs an edge
    letters_of_legend: int = 60  # in a row, with room for what stands before each entry


PAGE = PageStyle()


def bokeh(module: str) -> Any:
    """A module of Bokeh by its name within the package; raises `InputError` where Bokeh is missing."""
    try:
        return import_module(f"bokeh.{module}")
    except ImportError:
        raise InputError("pages need Bokeh: install persistent-orbits[explore]") from None


def new_figure(title: str, height: int, **options: object) -> Any:
    """A figure of Bokeh as wide as its place, whose axes have fixed ranges unless the options state others.

    No tool takes a drag or a turn of the wheel before it is chosen, so that a page can be scrolled by touch.
    """
    new_range = bokeh("models").Range1d
    options = {"x_range": new_range(0, 1), "y_range": new_range(0, 1)} | options
    figure = bokeh("plotting").figure(
        **{"title": title, "height": height, "sizing_mode": "stretch_width", "tools": TOOLS} | options,
        active_drag=None,
        active_scroll=None,
    )
    figure.title.text_font_size, figure.title.text_color = "14px", INK
    figure.axis.axis_label_text_font_style, figure.axis.axis_label_text_font_size = "normal", "13px"
    figure.axis.major_label_text_font_size, figure.axis.minor_tick_line_color = "12px", None
    figure.xaxis.ticker.desired_num_ticks = 5
    figure.grid.grid_line_color, figure.outline_line_color = "#ececec", None
    figure.toolbar.logo, figure.toolbar.autohide, figure.min_border_right = None, False, 12
    return figure


def legend_above(figure: Any, *items: object, columns: int = 4) -> None:
    """Put a legend of `LegendItem`s between the title and the axes, where it hides no curve."""
    legend = bokeh("models").Legend(
        items=list(items), orientation="horizontal", ncols=columns, border_line_color=None, margin=0, padding=2,
        label_text_font_size="12px", glyph_width=18, spacing=8,
    )  # fmt: skip
    figure.add_layout(legend, "above")


def empty_columns(*names: str) -> dict[str, list]:
    """Empty columns of a source."""
    return {name: [] for name in names}


def hover(renderers: list[object], entries: list[tuple[str, str]], **options: object) -> Any:
    """A tool that shows the values at the pointer; `entries` is as for `tip`."""
    formatters = {text.split("{")[0]: "printf" for _, text in entries if "{" in text}
    return bokeh("models").HoverTool(renderers=renderers, tooltips=tip(entries), formatters=formatters, **options)


def tip(entries: list[tuple[str, str]]) -> str:
    """The text of a tooltip, narrow enough for a phone.

    entries : names and texts, where "@name{%.5g}" is a column in the format of C; a text without a name has none
    """
    names = (f"<span style='color:{GREY}'>{escape(name)}</span> " if name else "" for name, _ in entries)
    rows = "".join(f"<div>{name}{text}</div>" for name, (_, text) in zip(names, entries, strict=True))
    return f"<div style='max-width:15em;white-space:normal;overflow-wrap:anywhere;color:{INK}'>{rows}</div>"


def range_changes(shown: Any, low: float, high: float, steady: bool, margin: float = PAGE.margin) -> list[Change]:
    """The changes that make a `Range1d` show low to high: none for a steady one that shows that already, with half its
    margin, and is well filled by it."""
    if (size := high - low) <= PAGE.flat * max(abs(low), abs(high)):  # only rounding
        size = abs(high) or 1.0
        low, high = low - 0.5 * size, high + 0.5 * size
    start, end = shown.reset_start, shown.reset_end
    below, above = margin, margin
    if steady and start is not None:
        inside = start <= low - 0.5 * margin * size and high + 0.5 * margin * size <= end
        if inside and size >= PAGE.filled * (end - start):
            return []
        below, above = margin + PAGE.spare * (low < start), margin + PAGE.spare * (high > end)
    ends = {"start": low - below * size, "end": high + above * size}
    return [(shown, each + name, value) for name, value in ends.items() for each in ("", "reset_")]


def apply(changes: list[Change]) -> None:
    """Set those values that the models do not have yet, together where they are on a page already."""
    document = next((model.document for model, _, _ in changes if model.document is not None), None)
    held = document is not None and document.callbacks.hold_value is None
    if document is not None and held:
        document.hold("combine")
    try:
        for model, name, value in changes:
            if not _equal(getattr(model, name), value):  # Bokeh reports a change of arrays also where they are equal
                setattr(model, name, value)
    finally:
        if document is not None and held:
            document.unhold()


def _equal(old: Any, new: Any) -> bool:
    """Whether two values of a property are equal, in columns too."""
    if isinstance(new, dict):
        return isinstance(old, dict) and old.keys() == new.keys() and all(_equal(old[name], new[name]) for name in new)
    if isinstance(new, np.ndarray) or isinstance(old, np.ndarray):
        return np.array_equal(old, new)
    if isinstance(new, list):
        return isinstance(old, list) and len(old) == len(new) and all(map(_equal, old, new))
    return bool(old == new)
