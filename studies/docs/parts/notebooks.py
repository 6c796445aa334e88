"""The notebooks of the studies: their titles and first paragraphs, their code, and the files."""

import json
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.addnodes import download_reference
from sphinx.util.docutils import SphinxDirective

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"


class Notebooks(SphinxDirective):
    """A section for each notebook."""

    def run(self):
        self.env.note_reread()  # what it shows may change without the page
        sections = []
        for path in sorted(NOTEBOOKS.glob("*.ipynb")):
            self.env.note_dependency(str(path))
            cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
            texts = {kind: [c for c in cells if c["cell_type"] == kind] for kind in ("markdown", "code")}
            first = "".join(texts["markdown"][0]["source"]).strip() if texts["markdown"] else path.stem
            title, _, rest = first.partition("\n")
            section = nodes.section("", nodes.title("", title.lstrip("# ")), ids=[nodes.make_id(path.stem)])
            section["names"] = [path.stem]
            self.state.document.note_explicit_target(section)
            self.state.nested_parse(StringList(rest.strip().split("\n\n")[0].split("\n"), str(path)), 0, section)
            file = download_reference("", "", refdomain="", reftarget=f"/../notebooks/{path.name}", reftype="download")
            file += nodes.literal("", f"studies/notebooks/{path.name}")
            section += nodes.paragraph("", "", file)
            code = "\n\n".join("".join(cell["source"]).rstrip() for cell in texts["code"])
            section += nodes.literal_block(code, code, language="ipython3" if "%" in code else "python")
            sections.append(section)
        return sections


def setup(app) -> dict:
    app.add_directive("notebooks", Notebooks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
