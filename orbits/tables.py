"""Tables of results as text and as HTML: names, numbers with their units, and words."""

from collections.abc import Mapping, Sequence
from typing import Any

# Rows of this name say in words what makes an orbit no motion.
VIOLATED = "violated"
DIGITS = 7  # of numbers in a table on a page; the printed one shows all that are known
WIDTH_OF_NAMES = 24  # column of names in a printed table, so that those of several results stand alike
# The colours are those of the page around, so that a table is legible on a light page and on a dark one.
RULE = "1px solid rgba(128,128,128,0.35)"
TABLE = "border-collapse:collapse;font:13px/1.45 system-ui,sans-serif;color:inherit;background:none;margin:0"
CAPTION = "text-align:left;font-weight:600;padding:2px 0 4px;color:inherit;caption-side:top"
VALUE_CELL = f"text-align:left;padding:2px 12px 2px 0;border-bottom:{RULE};vertical-align:top;background:none"
NAME_CELL = f"{VALUE_CELL};font-weight:400"
NUMBER_CELL = f"{VALUE_CELL};white-space:nowrap;font-variant-numeric:tabular-nums"  # of a column among others


def number_text(value: object, unit: str = "", digits: int = DIGITS) -> str:
    """A number with `digits` digits and its unit, "-" for None; anything else as it is, without a unit."""
    if value is None:
        return "-"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    text = f"{value:.{digits}g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}".rstrip()


def machine_numbers(words: Mapping[str, Any]) -> dict[str, tuple[float, str]]:
    """The numbers of a machine in words and numbers, as it describes itself, with their units, by name."""
    own = words.get("units", {})
    stated = {name: value for name, value in words.items() if type(value) in (int, float) and name != "restitution"}
    numbers = {name: words.get(name) for name in own} if own else {n.replace("_", " "): stated[n] for n in stated}
    numbers |= words.get("parameters", {})
    numbers |= {"ground_mass": ground["mass"]} if (ground := words.get("ground")) else {}
    return {name: (value, own.get(name) or "") for name, value in numbers.items() if value is not None}


def text_table(rows: Sequence[Sequence[str]], heads: Sequence[str] = ()) -> list[str]:
    """Rows of texts as the lines of a table: names and values, or columns below their headings."""
    if not heads:
        width = max([WIDTH_OF_NAMES, *(len(name) + 2 for name, *_ in rows)])
        return [f"  {name:<{width}}{text}".rstrip() for name, text in rows]
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    lines = ((f"{name:<{widths[0]}}", *map(str.rjust, row, widths[1:])) for name, *row in (heads, *rows))
    return ["  " + "  ".join(line).rstrip() for line in lines]


def escaped(text: str) -> str:
    """A text as HTML shows it."""
    from html import escape

    return escape(text)


def html_table(rows: Sequence[Sequence[str]], title: str, heads: Sequence[str] = ()) -> str:
    """Rows of texts as a table in HTML with its title, if any, above; the first text of a row is its heading.

    heads : headings of the columns, none for a table of names and values

    Every text is escaped.
    """
    above = "".join(f'<th scope="col" style="{NAME_CELL};font-weight:600">{escaped(text)}</th>' for text in heads)
    lines, style = [f'<table style="{TABLE}">'], NUMBER_CELL if heads else VALUE_CELL
    if title:
        lines.append(f'<caption style="{CAPTION}">{escaped(title)}</caption>')
    lines.append(f"<thead><tr>{above}</tr></thead><tbody>" if heads else "<tbody>")
    for name, *values in rows:
        cells = "".join(f'<td style="{style}">{escaped(text)}</td>' for text in values)
        lines.append(f'<tr><th scope="row" style="{NAME_CELL}">{escaped(name)}</th>{cells}</tr>')
    return "".join([*lines, "</tbody></table>"])
