"""Code and printed text line by line, so that nothing is cut on a narrow screen: lines wrap, with their continuation
indented, and only the rows of a printed table stay whole, and scroll in the box of their block."""

import re

from docutils import nodes
from sphinx.writers.html5 import HTML5Translator

PRINTED = ("output", "text")
# Columns of a printed line; one that is shorter than the second number, and had room for the first word of the next
# line, ends its paragraph.
FULL, NEARLY = 80, 50
# A row of a table has a gap between its columns, or stands far to the right, below the last column of another row.
ROW = re.compile(r" *\S.* {2,}\S| {8,}\S")


def indentation(line: str) -> int:
    """The number of spaces that a line begins with."""
    return len(line) - len(line.lstrip(" "))


def joined(text: str) -> str:
    """Printed text in which each indented paragraph, as that of a theorem, is one line, which the browser wraps."""
    lines: list[str] = []
    above = ""
    for line in text.split("\n"):
        same = line.strip() and 0 < indentation(line) == indentation(above)
        full = same and (len(above) > NEARLY or len(above) + 1 + len(line.split()[0]) > FULL)
        if lines and full and not ROW.match(line) and not ROW.match(above):
            divided = re.search(r"\w-$", above)  # a word at its hyphen
            lines[-1] += ("" if divided else " ") + line.strip()
        else:
            lines.append(line)
        above = line
    return "\n".join(lines)


def marked(html: str, printed: bool) -> str:
    """The lines of a highlighted block, each as an element that knows its indentation, and whether it is a row. An
    option of a command, which has hyphens, is not divided."""
    head, opening, rest = html.partition("<pre>")
    body, closing, tail = rest.rpartition("</pre>")
    lines = []
    for line in body.removesuffix("\n").split("\n"):
        plain = re.sub(r"<.*?>", "", line)
        row = " row" if printed and ROW.match(plain) else ""
        style = f' style="--indent:{indent}"' if (indent := indentation(plain)) and not row else ""
        line = re.sub(r"(?<=[\s>])--\w[\w-]*", r'<span class="option">\g<0></span>', line)
        lines.append(f'<span class="line{row}"{style}>{line}\n</span>')
    return head + opening + "".join(lines) + closing + tail


def visit_literal_block(translator, node) -> None:
    """Write a block as Sphinx does, and mark its lines."""
    printed = node.get("language") in PRINTED
    if printed and node.rawsource == node.astext():
        text = joined(node.astext())
        node.rawsource, node[:] = text, [nodes.Text(text)]
    try:
        HTML5Translator.visit_literal_block(translator, node)
    except nodes.SkipNode:
        translator.body[-1] = marked(translator.body[-1], printed)
        raise


def setup(app) -> dict:
    app.add_node(nodes.literal_block, override=True, html=(visit_literal_block, HTML5Translator.depart_literal_block))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
