"""References to Python names: those in backticks lead to the page of the object where it has one, else they are code.

A name may be written short, as `find` or `Orbit.plot`. What is asked for by a role of Sphinx, as {py:func}, has to be
there.
"""

from docutils import nodes
from sphinx.addnodes import desc_signature, pending_xref
from sphinx.util.docutils import SphinxRole
from sphinx.util.nodes import make_refnode

PACKAGES = ("orbits", "problems", "problems.springs", "problems.gravity", "problems.steering", "orbits.model.laws")


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


def link_names(app, document, page: str) -> None:
    """Turn code that is a public name into a reference to it, but on the name's own line and in headings."""
    for literal in list(document.findall(nodes.literal)):
        if any(
            isinstance(outer, nodes.reference | nodes.title | nodes.term | pending_xref) for outer in above(literal)
        ):
            continue
        found = page_of(app.env, literal.astext())
        if found and found.objtype != "module":
            name = literal.astext()
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
    app.connect("doctree-resolved", link_names)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
