"""Still pages: one HTML file each, with animated and interactive figures, and nothing to load from anywhere."""

from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError
from ...io import check_path, writing
from ...result import table_with_notes
from ...tables import html_table
from ..canvas import new_axes, off_screen
from .bokeh_figures import Change, apply, bokeh
from .drawn_figures import drawn_figures
from .family_view import FamilyFigure, ending, family_data
from .hop_view import HopFigures, hop_data
from .law_view import LawFigure, law_data
from .sweep_view import sweep_figures

if TYPE_CHECKING:
    from ...continuation import Family
    from ...periodic import Orbit
    from ...result import Result

PAGES = (".html",)
MOST_HOPS = 24  # of a family that are in its page
LARGEST_HOPS = 1_500_000  # bytes of them together, which become a third more in a page
# The colours of pages, light or dark as the browser is set. Figures are drawn for a white page; inverted, their colours
# keep their hues, and white becomes `--ground`.
THEME = """
:root { --ink: #222; --ground: #fff; --figure: none; color-scheme: light; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e8; --ground: #1a1a1a; --figure: invert(.9) hue-rotate(180deg); color-scheme: dark; }
}
"""
STYLE = """
body { margin: 0 auto; max-width: 1240px; padding: 0 12px 24px; color: var(--ink); background: var(--ground);
  font: 15px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.25rem; margin: 0.8em 0 0.2em; overflow-wrap: anywhere; }
h2 { font-size: 1rem; margin: 0.4em 0; }
p { margin: 0.3em 0 0.8em; overflow-wrap: anywhere; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 430px), 1fr)); gap: 8px 24px; }
.columns > *, .wide > * { min-width: 0; }
.figure { filter: var(--figure); color: #222; color-scheme: light; }
.table { overflow-x: auto; }
"""
# A browser loads nothing for a page, whatever its texts say: Bokeh would load a script for texts with TeX in them.
POLICY = "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:"
ZOOM = "To zoom, choose a tool next to a figure. Point at a curve for its numbers."
# The page of a family when one of its hops is chosen: the value "values[hop][i]" is assigned to the property
# "names[i]" of "models[i]". A click moves the slider to the nearest hop that has the quantity.
CHOOSE = """
values[cb_obj.value].forEach((value, i) => {
  models[i].setv({[names[i]]: value instanceof Map ? Object.fromEntries(value) : value});
});
"""
CLICK = """
const [i] = points.selected.indices;
if (i === undefined) return;
const known = row => row.filter(Number.isFinite);
const size = row => Math.max(...known(row)) - Math.min(...known(row)) || 1;
const across = size(places.map(place => place[0])), up = size(places.map(place => place[1]));
const {value, quantity} = points.data;
const far = places.map(([x, y]) => Math.hypot((x - value[i]) / across, (y - quantity[i]) / up));
points.selected.indices = [];
const nearest = far.indexOf(Math.min(...known(far)));
if (nearest >= 0) slider.value = nearest;
"""


def write_page(path: str | Path, title: str, sections: Sequence[Any]) -> Path:
    """Write a page in one file that loads nothing; returns its path.

    title : of the page, its first line the heading
    sections : one after the other, each (heading, list of parts): texts of HTML, and models of Bokeh, side by side
        where there is room

    Raises `InputError` for a path that is not a page's, and without Bokeh.
    """
    path = check_path(path, PAGES)
    models = [part for _, parts in sections for part in parts if not isinstance(part, str)]
    script, places, loaded, hint = "", tuple[str, ...](), "", ""
    if models:
        script, places = bokeh("embed").components(models, wrap_script=True)
        loaded = bokeh("resources").Resources(mode="inline", components=["bokeh", "bokeh-widgets"]).render_js()
        hint = f"<p>{ZOOM}</p>\n<noscript><p>The figures need JavaScript; the tables do not.</p></noscript>\n"
    left, body = iter(places), list[str]()
    for heading, parts in sections:
        body.append(f"<section aria-label='{escape(heading)}'><h2>{escape(heading)}</h2>" if heading else "<section>")
        kinds = [("table", part) if isinstance(part, str) else ("figure", next(left)) for part in parts]
        inner = "".join(f"<div class='{kind}'>{part}</div>" for kind, part in kinds)
        body.append(f"<div class='{'columns' if len(parts) > 1 else 'wide'}'>{inner}</div></section>")
    name, *others = title.splitlines()
    text = (
        "<!doctype html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        f"<title>{escape(name)}</title>\n<style>{THEME}{STYLE}</style>\n{loaded}\n</head>\n<body>\n<main>\n"
        f"<h1>{escape(name)}</h1>\n{''.join(f'<p>{escape(line)}</p>' for line in others)}\n{hint}"
        f"{''.join(body)}\n</main>\n{script}\n</body>\n</html>\n"
    )
    with writing("page", path) as target:
        target.write_text(text, encoding="utf-8")
    return path


def orbit_page(orbit: "Orbit", path: str | Path) -> Path:
    """Write the page of an `Orbit`: the animated machine, its certificate, heights, phase portrait, contact force, and
    the spring's law where the orbit knows its machine. See `write_page`."""
    check_path(path, PAGES)
    figures, data = HopFigures(), hop_data(orbit)
    figures.show(data, steady=False)
    table = html_table(orbit.rows(), "Certificate")
    first = "Animation and certificate", [_animation(figures), table]
    return write_page(path, data.title, [first, *_other_figures(figures, *_law_figures(orbit))])


def family_page(family: "Family", path: str | Path, quantity: str, hops: Iterable[tuple[object, object]]) -> Path:
    """Write the page of a `Family`: a quantity along it, its events, and some of its hops, as pairs
    (point, its `Orbit`), to choose by a slider or a click. See `write_page`."""
    check_path(path, PAGES)
    shown = FamilyFigure()
    shown.show(family_data(family, quantity), steady=False)
    head, *_ = str(family).splitlines()
    heads = ["event", family.heading(family.name), family.heading(quantity), "no motion, because"]
    rows = [_event_row(family, event, quantity) for event in family.events]
    ends = "".join(f"<p>{escape(f'{word}: {end.kind}, {ending(family, end)}.')}</p>" for word, end in _ends(family))
    table = html_table(rows, "", heads) if rows else ""
    sections: list[object] = [("The family", [shown.figure]), ("What happens along it", [ends + table])]
    return write_page(path, head, [*sections, *_choice(family, quantity, shown, list(hops))])


def _ends(family: "Family") -> list[tuple[str, Any]]:
    """The ends of a family with what they are called."""
    return [*([("Beginning", family.beginning)] if family.beginning else []), ("End", family.end)]


def sweep_page(sweep: Any, path: str | Path, quantity: str | None) -> Path:
    """Write the page of a `Sweep`: a quantity over its parameters. See `write_page`."""
    check_path(path, PAGES)
    figures, caption = sweep_figures(sweep, quantity)
    statuses = html_table([(name, str(count)) for name, count in sweep.statuses().items()], "Members by status")
    over, *shares = sweep.heads()
    tables = [statuses, html_table(sweep.rows(), "Quantiles", ["", *shares])] if shares else [statuses]
    title = "\n".join([sweep.title(), over, caption])
    return write_page(path, title, [*([("Members", figures)] if figures else []), ("In numbers", tables)])


def result_page(result: "Result", path: str | Path, draw: Callable[..., Any] | None, notes: Sequence[str]) -> Path:
    """Write the page of any result: what its plot draws, with hover and zoom, and its table. See `write_page`.

    draw : called with `axes`, draws the result and returns the axes; None for a result that has no plot
    notes : texts below the table

    Raises `InputError` for a bad path, and without Bokeh where there is a plot.
    """
    path, sections = check_path(path, PAGES), list[tuple[str, list[Any]]]()
    table = table_with_notes(result.rows(), result.heads(), notes)
    if draw is not None:
        try:
            with off_screen():
                axes = draw(axes=new_axes())
        except InputError as error:  # the table is worth showing without a figure
            table = f"<p>No figure: {escape(str(error))}</p>{table}"
        else:
            sections = [("", row) for row in drawn_figures(axes)]
    return write_page(path, result.title(), [*sections, ("In numbers", [table])])


def _animation(figures: HopFigures) -> object:
    """The player above the animated machine, about as high as the table next to them."""
    figures.machine.height = 440
    return bokeh("layouts").column(figures.player, figures.machine, sizing_mode="stretch_width")


def _other_figures(figures: HopFigures, *beside: object) -> list[object]:
    """The sections of a hop's other figures, and the parts next to the contact force."""
    return [("Over a cycle", [figures.heights, figures.portrait]), ("Forces", [figures.force, *beside])]


def _law_figures(orbit: "Orbit") -> list[object]:
    """The figure of the spring's law, where the orbit knows its machine and this states a force of its extension."""
    if orbit.source is None or orbit.source.model.tension is None:
        return []
    law = LawFigure()
    law.show(law_data(orbit.source, orbit), steady=False)
    return [law.figure]


def _event_row(family: "Family", event: Any, quantity: str) -> tuple[str, ...]:
    """The row of a table about an event."""
    numbers = event.point.value, family.quantity(event.point, quantity)
    words = "" if event.point.admissible else "; ".join(event.point.violations)
    return event.kind, *(f"{number:.10g}" for number in numbers), words


def _choice(family: "Family", quantity: str, shown: FamilyFigure, hops: list[tuple[Any, Any]]) -> list[object]:
    """The sections of a family's hops, with one hop shown; none without hops."""
    if not hops:
        return []
    models, figures = bokeh("models"), HopFigures()
    about = models.Div(sizing_mode="stretch_width", disable_math=True)
    changes, places = list[list[Change]](), list[tuple[float, float]]()
    size = sum(each.nbytes for each in vars(hop_data(hops[0][1])).values() if isinstance(each, np.ndarray))
    for point, orbit in hops[:: -(-size * len(hops) // LARGEST_HOPS)]:
        data = hop_data(orbit)
        place = point.value, family.quantity(point, quantity)
        table = html_table([(family.heading(family.name), f"{point.value:.7g}"), *orbit.rows()], "Certificate")
        changes.append([*figures.changes(data, steady=False), *shown.marks(*place), (about, "text", table)])
        places.append(place)
    apply(changes[0])
    slider = models.Slider(
        start=0, end=max(len(places) - 1, 1), step=1, value=0, title="Hop of the family", name="hop", show_value=False,
        sizing_mode="stretch_width",
    )  # fmt: skip
    put = {"models": [model for model, *_ in changes[0]], "names": [name for _, name, _ in changes[0]]}
    put["values"] = [[value for *_, value in each] for each in changes]
    slider.js_on_change("value", models.CustomJS(args=put, code=CHOOSE))
    click = {"slider": slider, "points": shown.points, "places": places}
    shown.points.selected.js_on_change("indices", models.CustomJS(args=click, code=CLICK))
    chosen = [("Choose a hop here, or click on the curve above", [slider]), ("The hop", [_animation(figures), about])]
    return [*chosen, *_other_figures(figures)]
