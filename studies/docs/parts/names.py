"""References to Python names: those in backticks lead to the page of the object where it has one, else they are code.

A name may be written short, as `find` or `Orbit.plot`; laws are named with their module, as `springs.formula`. What is
asked for by a role of Sphinx, as {py:func}, has to be there. The file of a study in backticks, as
`studies/reproduction.py` or `reproduction.py`, leads to a copy of it in the site.
"""

import re
from pathlib import Path

from docutils import nodes
from sphinx.addnodes import desc_signature, download_reference, pending_xref
from sphinx.util.docutils import SphinxRole
from sphinx.util.nodes import make_refnode

from orbits import PLACE_OF

PLACES = (f"orbits.{place}" for place in PLACE_OF.values())
PACKAGES = ("orbits", "problems", "problems.steering", "orbits.laws.law", *PLACES)
STUDIES = Path(__file__).parents[2]
# On this page names are those of modules, some of which functions have too.
OF_MODULES = "where"


class Name(SphinxRole):
    """The role of single backticks in docstrings: code, which `link_names` turns into a reference."""

    def run(self):
        return [nodes.literal(self.text, self.text)], []


def page_of(env, text: str):
    """The page and the anchor of a public name, None where there is none or the name is that of several things."""
    objects = env.domains["py"].objects
    name = text.removesuffix("()")
    for prefix in ("", *(f"{package}." for package in PACKAGES)):
        if prefix + name in objects and (prefix or "." in name):
            return objects[prefix + name]
    return None


def above(node):
    """The nodes that a node stands in, from the inside."""
    while node.parent is not None:
        node = node.parent
        yield node


def free_literals(document) -> list[nodes.literal]:
    """The code in a document that is no link yet, but on a name's own line and in headings."""
    linked = nodes.reference | nodes.title | nodes.term | pending_xref | download_reference
    literals = document.findall(nodes.literal)
    return [literal for literal in literals if not any(isinstance(outer, linked) for outer in above(literal))]


def link_studies(app, document) -> None:
    """Turn the file of a study into a reference to its copy in the site."""
    for literal in free_literals(document):
        found = re.fullmatch(r"(?:studies/)?(\w+\.py)", literal.astext())
        if found and (STUDIES / found[1]).is_file():
            target = f"/../{found[1]}"
            literal.replace_self(
                download_reference("", "", literal.deepcopy(), refdomain="", reftarget=target, reftype="download")
            )


def link_names(app, document, page: str) -> None:
    """Turn code that is a public name into a reference to it."""
    for literal in free_literals(document) if page != OF_MODULES else ():
        name = literal.astext()
        found = page_of(app.env, name)
        if found and (found.objtype != "module" or "." in name):
            literal.replace_self(
                make_refnode(app.builder, page, found.docname, found.node_id, literal.deepcopy(), name)
            )


def resolve(app, env, node, content):
    """The references in signatures, which name things as the sources do; most of them are no public names."""
    if node.get("refdomain") != "py" or not any(isinstance(outer, desc_signature) for outer in above(node)):
        return None
    found = page_of(env, node["reftarget"].rpartition(".")[2])
    if found:
        return make_refnode(app.builder, node["refdoc"], found.docname, found.node_id, content, node["reftarget"])
    return content


def setup(app) -> dict:
    app.add_role("name", Name())
    app.config.default_role = "name"
    app.connect("doctree-read", link_studies, priority=100)  # before Sphinx collects the files to copy
    app.connect("doctree-resolved", link_names)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
