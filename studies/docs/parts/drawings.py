"""Figures that are drawn while the site is built, by the code that stands beside them.

    ```{drawn} caption        the figures that this code saves, with the code
    ```{study} asteroid       the figures that studies/asteroid.py draws in its quick mode, with its source

Each runs in a process and a folder of its own, several at a time. What it saved is kept until its code or a module of
the packages changes.
"""

import hashlib
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).parents[3]
PICTURES = (".png", ".gif", ".svg")
WIDE = 1000  # pixels: wider figures have several panels, and scroll on a narrow screen, where they would be too small
PLACES = re.compile(r"^```\{(drawn|study)\}([^\n]*)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)


@cache
def engine() -> str:
    """A hash of all modules of the packages."""
    sources = sorted(path for package in ("orbits", "problems") for path in (ROOT / package).rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()


def study_path(name: str) -> Path:
    """The source of a study."""
    return ROOT / "studies" / f"{name}.py"


def command_of(kind: str, argument: str, code: str) -> tuple[list[str], str]:
    """What is run, as arguments of Python, and the source that the figures depend on."""
    if kind == "drawn":
        return ["-c", code], code
    source = study_path(argument).read_text(encoding="utf-8")
    quick = ["--quick"] if '"--quick"' in source else []
    return [str(study_path(argument)), *quick, "--output", "."], source


def place_of(folder: Path, kind: str, argument: str, code: str) -> Path:
    """Where the figures of a piece of code are kept; they are all there once there is a file `done` beside them."""
    _, source = command_of(kind, argument, code)
    return folder / hashlib.sha256(f"{engine()}{kind}{source}".encode()).hexdigest()[:20]


def draw(folder: Path, kind: str, argument: str, code: str) -> list[Path]:
    """The figures that a piece of code saves, from the folder where they are kept if they are there."""
    command, _ = command_of(kind, argument, code)
    place = place_of(folder, kind, argument, code)
    done = place / "done"
    if not done.exists():
        place.mkdir(parents=True, exist_ok=True)
        settings = {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", "OPENBLAS_NUM_THREADS": "1"}
        run = subprocess.run(
            [sys.executable, *command], cwd=place, env=os.environ | settings, capture_output=True, text=True
        )
        if run.returncode:
            raise RuntimeError(f"the figure of {argument or code!r} is not drawn: {run.stderr[-2000:]}")
        done.touch()
    return sorted(path for path in place.rglob("*") if path.suffix in PICTURES)


def kept(app) -> Path:
    """The folder where figures are kept."""
    return Path(app.doctreedir).parent / "figures"


def drawings_of(pages: Path) -> list[tuple[str, str, str]]:
    """Kind, argument and code of all drawings of the pages in a folder."""
    return [
        (kind, argument.strip(), body)
        for page in sorted(pages.rglob("*.md"))
        for kind, argument, body in PLACES.findall(page.read_text(encoding="utf-8"))
    ]


def draw_all(app) -> None:
    """Draw the figures of all pages, as many at a time as there are cores."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for drawing in [pool.submit(draw, kept(app), *each) for each in drawings_of(Path(app.srcdir))]:
            drawing.exception()  # the directive says it, with its place


class Drawing(SphinxDirective):
    """Figures with their caption."""

    has_content = True
    optional_arguments = 1
    final_argument_whitespace = True

    def figures(self, kind: str, argument: str, code: str, caption: str) -> list[nodes.Node]:
        try:
            paths = draw(kept(self.env.app), kind, argument, code)
        except (OSError, RuntimeError) as error:
            raise self.error(str(error)) from None
        if not paths:
            raise self.error(f"no figure is saved by {argument or code!r}")
        pictures = []
        for path in paths:
            # From the root of the sources, which Sphinx takes an absolute path to be relative to.
            uri = "/" + os.path.relpath(path, self.env.srcdir)
            pictures.append(nodes.figure("", nodes.image(uri=uri, alt=caption)))
        if kind == "drawn" and caption:
            pictures[-1] += nodes.caption("", caption)
        return pictures


class Drawn(Drawing):
    """Code, and the figures that it saves."""

    def run(self):
        code = "\n".join(self.content) + "\n"
        caption = self.arguments[0] if self.arguments else ""
        block = nodes.literal_block(code, code, language="python")
        return [block, *self.figures("drawn", "", code, caption)]


class Study(Drawing):
    """What a study asks, its figures, and its source to be unfolded."""

    def run(self):
        name = self.arguments[0].strip()
        source = study_path(name).read_text(encoding="utf-8")
        self.env.note_dependency(str(study_path(name)))
        text = re.match(r'"""(.*?)"""', source, flags=re.DOTALL)[1]
        said = nodes.container(classes=["study"])
        head = re.sub(r"\s+Run: .*", "", text, flags=re.DOTALL)
        for paragraph in head.split("\n\n"):
            said += nodes.paragraph("", " ".join(paragraph.split()))
        figures = self.figures("study", name, "", " ".join(text.split("\n")[0].split()))
        opened = nodes.raw("", f"<details><summary>studies/{name}.py</summary>", format="html")
        block = nodes.literal_block(source, source, language="python")
        return [said, *figures, opened, block, nodes.raw("", "</details>", format="html")]


def mark_wide(app, document, name: str) -> None:
    """Give the wide figures of a page the class of that name."""
    for image in document.findall(nodes.image):
        path = Path(app.srcdir, image["uri"].lstrip("/"))
        # The width of a PNG stands in its first chunk.
        if path.suffix == ".png" and int.from_bytes(path.read_bytes()[16:20], "big") > WIDE:
            image["classes"].append("wide")


def setup(app) -> dict:
    app.connect("doctree-resolved", mark_wide)
    app.add_directive("drawn", Drawn)
    app.add_directive("study", Study)
    app.connect("builder-inited", draw_all)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
