"""What every result does: it draws itself, and a notebook shows it as a small table with a picture beside it.

The room `show`, which draws results, stands above all of them: `shown` is the one way up to it, taken when something is
drawn.
"""

import base64
from collections.abc import Callable, Sequence
from html import escape
from importlib import import_module
from io import BytesIO
from typing import Any, TypeAlias

from .tables import html_table

# A `matplotlib.axes.Axes`. The import waits until something is drawn, and its types differ between versions.
Axes: TypeAlias = Any
Report: TypeAlias = Callable[[float], None] | None  # called with the share of the frames that are drawn
PICTURE = (5.6, 3.8)  # inches
DOTS_PER_INCH = 130  # sharp on most screens, and a picture of some 30 kB
ROWS_OF_CELL = 30  # of a table in a cell; a design with the certificate of its orbit has fewer
NOTE = "font:13px/1.45 system-ui,sans-serif;margin:6px 0;max-width:56ch;overflow-wrap:anywhere"
TITLE = "font:600 13px/1.45 system-ui,sans-serif;margin:4px 0;overflow-wrap:anywhere"
SIDE_BY_SIDE = "display:flex;flex-wrap:wrap;gap:8px 28px;align-items:flex-start"


def shown(module: str) -> Any:
    """The module of the room `show` with this name, such as "plot" or "pages.still"."""
    return import_module(f"{__package__}.show.{module}")


def cell(
    title: str,
    rows: Sequence[Sequence[str]],
    draw: Callable[..., Any] | None = None,
    heads: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> str:
    """A result in HTML, for its `_repr_html_`: a table as `html_table` makes it, and a picture.

    draw : called with `axes`, draws the picture and returns the axes; None for none. Where that fails the reason stands
        in its place
    notes : texts below the table
    """
    table = html_table(without_middle(rows), "", heads) if rows else ""
    table += "".join(f'<p style="{NOTE}">{escape(note)}</p>' for note in notes)
    words = f'<div style="flex:0 1 auto;max-width:100%;overflow-x:auto">{table}</div>'
    beside = f'<div style="{SIDE_BY_SIDE}">{words}{_picture(title, draw) if draw else ""}</div>'
    return f'<div><p style="{TITLE}">{escape(title)}</p>{beside}</div>'


def _picture(title: str, draw: Callable[..., Any]) -> str:
    """The picture as a PNG within the page, or in words why there is none."""
    try:
        plot = shown("plot")
        with plot.off_screen():
            axes = draw(axes=plot.new_axes(*PICTURE))
        data = base64.b64encode(_small_png(axes.figure)).decode("ascii")
    except Exception as error:  # the table is worth showing without its picture
        reason = str(error) or type(error).__name__
        return f'<p style="{NOTE}">no picture: {escape(reason)}</p>'
    look = "flex:1 1 300px;min-width:0;max-width:600px;width:100%;height:auto"
    return f'<img alt="{escape(title)}" style="{look}" src="data:image/png;base64,{data}">'


def _small_png(figure: Any) -> bytes:
    """A figure as a PNG of 256 colours, a third as large as one of all."""
    from PIL import Image  # which matplotlib takes to write its own

    whole, small = BytesIO(), BytesIO()
    figure.savefig(whole, format="png", dpi=DOTS_PER_INCH)
    Image.open(whole).convert("RGB").quantize(256).save(small, format="png", optimize=True)
    return small.getvalue()


def without_middle(rows: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """The rows of a table, of more than `ROWS_OF_CELL` those at the beginning and at the end."""
    if len(rows) <= ROWS_OF_CELL:
        return list(rows)
    blank = [""] * (len(rows[0]) - 2)
    return [*rows[: ROWS_OF_CELL - 3], ("...", f"{len(rows) - ROWS_OF_CELL + 1} more", *blank), *rows[-2:]]
