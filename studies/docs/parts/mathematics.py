"""Equations as MathML, converted from LaTeX at build time by docutils: browsers draw it without scripts or fonts."""

import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

SPACE = r"\qquad"


def mathml(equation: str, **options: bool) -> str:
    """An equation of LaTeX as MathML; as in LaTeX primes are raised, and a function stands apart from a letter."""
    raised = re.sub("'+", lambda primes: "^{" + r"\prime" * len(primes[0]) + "}", equation)
    return re.sub(r"<mo>&ApplyFunction;</mo>(?=\s*<m[in])", '<mspace width="0.17em"/>', tex2mathml(raised, **options))


def inline(translator, node) -> None:
    """Write an equation within a line."""
    translator.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def parts(equation: str) -> list[str]:
    """The parts of an equation between wide spaces, each of which may have a line of its own on a narrow screen."""
    found = [""]
    for part in equation.split(SPACE):
        within = found[-1].count(r"\begin") > found[-1].count(r"\end")
        found[-1:] = [found[-1] + SPACE + part] if within else [found[-1], part]
    return found[1:]


def block(translator, node) -> None:
    """Write an equation on lines of its own, with its number."""
    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    name = f' id="equation-{node["label"]}"' if node.get("label") else ""
    equation = "".join(mathml(part.strip(), as_block=True) for part in parts(node.astext()))
    translator.body.append(f'<div class="math"{name}><div class="equation">{equation}</div>{number}</div>\n')
    raise nodes.SkipNode


def setup(app) -> dict:
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
