"""What the cell of a notebook shows of a result: a small table, and a picture beside it or, on a narrow page, below."""

import base64
from collections.abc import Callable, Sequence
from html import escape
from io import BytesIO
from typing import Any

from ..plot import new_axes, off_screen
from .tables import html_table

PICTURE = (5.6, 3.8)  # inches
DOTS_PER_INCH = 130  # sharp on most screens, and a picture of some 30 kB
ROWS_OF_CELL = 30  # of a table in a cell; a design with the certificate of its orbit has fewer
NOTE = "font:13px/1.45 system-ui,sans-serif;margin:6px 0;max-width:56ch;overflow-wrap:anywhere"
TITLE = "font:600 13px/1.45 system-ui,sans-serif;margin:4px 0;overflow-wrap:anywhere"
SIDE_BY_SIDE = "display:flex;flex-wrap:wrap;gap:8px 28px;align-items:flex-start"


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
        with off_screen():
            axes = draw(axes=new_axes(*PICTURE))
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
