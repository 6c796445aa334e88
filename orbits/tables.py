"""Tables of results as text and as HTML: names, numbers with their units, and words.

A printed line has at most `LAYOUT.line` characters: a longer text continues below, set in, and so does a table of more
columns, with its first column again. No number is ever cut.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from math import ceil, floor, isfinite, log10
from typing import Any, NamedTuple

# Rows of this name say in words what makes an orbit no motion.
VIOLATED = "violated"
DIGITS = 7  # of numbers in a table on a page; the printed one shows all that are known


class Layout(NamedTuple):
    """The widths of printed tables in characters.

    line : of a line of a terminal
    names : of the column of names, so that those of several results stand alike
    longest_names : of that column; a longer name has lines of its own
    between : columns
    """

    line: int = 80
    names: int = 24
    longest_names: int = 40
    between: int = 2


LAYOUT = Layout()
# Spaces at which a line never ends: those around a sign of equality, before the unit of a number, and after +-.
TOGETHER = re.compile(r"(?<=[^ ]) (?== )|(?<= =) |(?<=\d) (?=[^\W\d_])|(?<=\+-) ")
SHORT_BRACKETS = re.compile(r"\([^()]{1,24}\)")  # nor does one end within these
HARD_SPACE = "\u00a0"
# Where a word that is longer than a line goes on in the next one: after these signs of a formula or of a file's name.
BREAKS = re.compile(r"(?<=[*/,;&?(=])|(?<=\+)(?<![eE]\+)")
# The colours are those of the page around, so that a table is legible on a light page and on a dark one.
RULE = "1px solid rgba(128,128,128,0.35)"
TABLE = "border-collapse:collapse;font:13px/1.45 system-ui,sans-serif;color:inherit;background:none;margin:0"
CAPTION = "text-align:left;font-weight:600;padding:2px 0 4px;color:inherit;caption-side:top"
VALUE_CELL = f"text-align:left;padding:2px 12px 2px 0;border-bottom:{RULE};vertical-align:top;background:none"
NAME_CELL = f"{VALUE_CELL};font-weight:400"
NUMBER_CELL = f"{VALUE_CELL};white-space:nowrap;font-variant-numeric:tabular-nums"  # of a column among others


def number_text(value: object, unit: str = "", digits: int = DIGITS, zeros: bool = False) -> str:
    """A number with `digits` digits and its unit; "-" for None, and anything else as it is, without a unit.

    zeros : whether zeros at the end are shown
    """
    if value is None:
        return "-"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    text = f"{value:#.{digits}g}".rstrip(".") if zeros else f"{value:.{digits}g}"
    text = text if isinstance(value, float) else str(value)
    return f"{text} {unit}".rstrip()


def digits_within(value: float, error: float, most: int) -> int:
    """How many significant digits of a value its error allows, from 1 to `most`: the last one is off by at most one.

    A value within its error has one digit, though none of them is known, and so has one whose error is not a number.
    All have `most` that are infinite or no number, and are printed as such.
    """
    if not isfinite(value):
        return most
    if not (0 < error < abs(value)):
        return 1 if error else most
    return max(1, min(most, floor(log10(abs(value))) - ceil(log10(error)) + 1))


def machine_numbers(words: Mapping[str, Any]) -> dict[str, tuple[float, str]]:
    """The numbers of a machine in words and numbers, as it describes itself, with their units, by name."""
    own = words.get("units", {})
    stated = {name: value for name, value in words.items() if type(value) in (int, float) and name != "restitution"}
    numbers = {name: words.get(name) for name in own} if own else {n.replace("_", " "): stated[n] for n in stated}
    numbers |= words.get("parameters", {})
    numbers |= {"ground_mass": ground["mass"]} if (ground := words.get("ground")) else {}
    return {name: (value, own.get(name) or "") for name, value in numbers.items() if value is not None}


def wrapped(text: str, width: int | None = None, indent: str = "", onward: str | None = None) -> list[str]:
    """A text as lines of at most this width, by default that of a terminal.

    indent, onward : what the first line begins with, and all others, by default the same

    Words longer than a line, as formulas, continue after a sign; what has none, as a number, stays whole. So do lines
    of the text that are set in already.
    """
    width, onward = width or LAYOUT.line, indent if onward is None else onward
    lines = list[str]()
    for part in text.split("\n"):
        if lines and part.startswith(" "):
            lines.append(part)
            continue
        line, begun = onward if lines else indent, False
        for word in re.findall(" *[^ ]+", _held_together(part)):
            pieces = [word] if len(word.lstrip(" ")) + len(onward) <= width else BREAKS.split(word)
            for piece in pieces:
                if begun and len(line) + len(piece) > width:
                    lines.append(line)
                    line, begun = onward, False
                line, begun = line + (piece if begun else piece.lstrip(" ")), True
        lines.append(line)
    return [line.replace(HARD_SPACE, " ").rstrip() for line in lines]


def _held_together(text: str) -> str:
    """A text with hard spaces where no line ends."""
    return SHORT_BRACKETS.sub(lambda found: found[0].replace(" ", HARD_SPACE), TOGETHER.sub(HARD_SPACE, text))


def text_table(rows: Sequence[Sequence[str]], heads: Sequence[str] = ()) -> list[str]:
    """Rows of texts as the lines of a table: names and values, or columns below their headings."""
    if heads:
        blocks = [[*_lines_of_columns(columns)] for columns in _blocks([heads, *rows])]
        return [line for block in blocks for line in ([""] if block is not blocks[0] else []) + block]
    longest = max([LAYOUT.names, *(len(name) + LAYOUT.between for name, *_ in rows)])
    width, lines = min(longest, LAYOUT.longest_names), list[str]()
    for name, text in rows:
        first, onward = f"  {name:<{width}}", " " * (2 + width)
        lines += [] if len(name) < width else wrapped(name, indent="  ")
        lines += wrapped(text, indent=first if len(name) < width else onward, onward=onward)
    return lines


def _longest_word(column: Sequence[str]) -> int:
    """The length of the longest word in a column."""
    return max(len(word) for text in column for word in _held_together(text).split(" "))


def _blocks(table: Sequence[Sequence[str]]) -> list[list[Sequence[str]]]:
    """The columns of a table in blocks, each with the first column, whose words fit into a line."""
    name, *columns = zip(*table, strict=True)
    blocks: list[list[Sequence[str]]] = [[name]]
    room = LAYOUT.line
    for column in columns:
        needed = LAYOUT.between + _longest_word(column)
        if not (begun := len(blocks[-1]) > 1) or room < needed:
            blocks += [[name]] if begun else []
            room = LAYOUT.line - LAYOUT.between - _longest_word(name)
        blocks[-1].append(column)
        room -= needed
    return blocks


def _lines_of_columns(columns: Sequence[Sequence[str]]) -> Iterator[str]:
    """The lines of a block: the widest columns of several words have narrower lines, as far as the block needs."""
    widths, least = ([function(column) for column in columns] for function in (_longest, _longest_word))
    while sum(widths) + LAYOUT.between * len(widths) > LAYOUT.line and widths != least:
        widest = max((width, i) for i, width in enumerate(widths) if width > least[i])[1]
        widths[widest] -= 1
    for number, row in enumerate(zip(*columns, strict=True)):
        cells = [wrapped(text, width) for text, width in zip(row, widths, strict=True)]
        # Numbers and headings end below each other, and texts of several lines begin so.
        ends = [i > 0 and (number == 0 or len(lines) == 1) for i, lines in enumerate(cells)]
        justify = [str.rjust if at_end else str.ljust for at_end in ends]
        for parts in zip_longest(*cells, fillvalue=""):
            line = (to(part, width) for to, part, width in zip(justify, parts, widths, strict=True))
            yield "  " + "  ".join(line).rstrip()


def _longest(column: Sequence[str]) -> int:
    return max(map(len, column))


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
