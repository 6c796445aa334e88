"""References to Python names: those in backticks lead to the page of the object where it has one, and are code elsewhere.

A name may be written short, as `find` or `Orbit.plot`. What is asked for by a role of Sphinx, as {py:func}, has to be
there.
"""

from docutils import nodes
from sphinx.addnodes import pending_xref
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


def link_names(app, document, page: str) -> None:
    """Turn code that is a public name into a reference to it, but on the name's own line and in headings."""
    for literal in list(document.findall(nodes.literal)):
        outer, above = literal.parent, set()
        while outer is not None:
            above.add(type(outer))
            outer = outer.parent
        if above & {nodes.reference, nodes.title, nodes.term} or any(issubclass(kind, pending_xref) for kind in above):
            continue
        found = page_of(app.env, literal.astext())
        if found and found.objtype != "module":
            reference = make_refnode(app.builder, page, found.docname, found.node_id, literal.deepcopy(), literal.astext())
            literal.replace_self(reference)


def resolve(app, env, node, content):
    """The references in signatures, which name things as the sources do; most of them are no public names."""
    if node.get("refdomain") != "py" or node.get("py:module") is None and "py:class" not in node:
        return None
    if node.get("reftype") != "class" or node.get("refexplicit"):
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
