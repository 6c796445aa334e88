"""Equations as MathML, converted from LaTeX at build time by docutils: browsers draw it without scripts or fonts."""

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml


def inline(translator, node) -> None:
    """Write an equation within a line."""
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def block(translator, node) -> None:
    """Write an equation on lines of its own, with its number."""
    number = f'<span class="eqno">({node["number"]})</span>' if node["number"] else ""
    name = f' id="equation-{node["label"]}"' if node["label"] else ""
    equation = tex2mathml(node.astext().strip(), as_block=True)
    translator.body.append(f'<div class="math"{name}><div class="equation">{equation}</div>{number}</div>\n')
    raise nodes.SkipNode


def setup(app) -> dict:
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
