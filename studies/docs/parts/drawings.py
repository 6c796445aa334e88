"""Figures that are drawn while the site is built, by the code that stands beside them.

    ```{drawn} caption                  the figures that this code saves, with the code
    ```{study} asteroid                 the figures that studies/asteroid.py draws in its quick mode, with its source
    ```{theorem} how_to/proof.md words  a theorem in short, and the printed output of that page which has these words

A page in one file that the code saves is linked to. Each piece of code runs in a folder and a process of its own,
several at a time. What it saved is kept until its code or a module of the packages changes.
"""

import hashlib
import io
import multiprocessing
import os
import re
import runpy
import shutil
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import redirect_stdout
from functools import cache
from pathlib import Path

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).parents[3]
PAGES = "pages"  # the folder of the site for pages in one file
FIGURES_FIRST = ("gallery", "lesson")  # pages on which figures come before their code, which is folded
PICTURES = (".png", ".gif", ".svg")
WIDE = 1000  # pixels: wider figures have several panels, whose letters are small on a narrow screen
ENLARGE = "The picture alone, to enlarge it"
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
    """What is run, a file with its arguments, and the source that the figures depend on."""
    if kind == "drawn":
        return ["code"], code
    source = study_path(argument).read_text(encoding="utf-8")
    quick = ["--quick"] if '"--quick"' in source else []
    return [str(study_path(argument)), *quick, "--output", "."], source


def place_of(folder: Path, kind: str, argument: str, code: str) -> Path:
    """Where the figures of a piece of code are kept; they are all there once there is a file `done` beside them."""
    _, source = command_of(kind, argument, code)
    return folder / hashlib.sha256(f"{engine()}{kind}{source}".encode()).hexdigest()[:20]


def run(place: Path, kind: str, argument: str, code: str) -> None:
    """Run a piece of code in the folder where its figures are kept; meant for a process of its own."""
    command, _ = command_of(kind, argument, code)
    place.mkdir(parents=True, exist_ok=True)
    os.chdir(place)
    if kind == "drawn":
        Path(command[0]).write_text(code, encoding="utf-8")
    sys.argv = command
    with redirect_stdout(io.StringIO()):
        runpy.run_path(command[0], run_name="__main__")
    Path("done").touch()


def processes(most: int | None = None) -> Executor:
    """Processes that each run one piece of code; where the system can, they begin with the packages loaded."""
    methods = multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
    if "forkserver" in methods:
        context.set_forkserver_preload(["__main__", "parts.drawings", "parts.loaded"])
    return ProcessPoolExecutor(most, context, max_tasks_per_child=1)


def draw(folder: Path, kind: str, argument: str, code: str) -> Path:
    """The folder with what a piece of code saves, which runs if it has not before."""
    place = place_of(folder, kind, argument, code)
    if not (place / "done").exists():
        try:
            with processes(1) as apart:
                apart.submit(run, place, kind, argument, code).result()
        except Exception as error:
            cause = f"{error.__cause__ or ''}{error}"[-2000:]
            raise RuntimeError(f"the figure of {argument or code!r} is not drawn: {cause}") from None
    return place


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
    with processes() as apart:
        missing = {place_of(kept(app), *each): each for each in drawings_of(Path(app.srcdir))}
        missing = {place: each for place, each in missing.items() if not (place / "done").exists()}
        for drawing in [apart.submit(run, place, *each) for place, each in missing.items()]:
            drawing.exception()  # the directive says it, with its place


def saved_pages(place: Path) -> Iterator[tuple[Path, str]]:
    """The pages in one file that a piece of code saved, with their names in the site."""
    for path in sorted(place.rglob("*.html")):
        yield path, f"{path.stem}-{place.name[:6]}.html"


def copy_pages(app, error) -> None:
    """Copy the saved pages into the site."""
    if error is None and app.builder.format == "html":
        shutil.rmtree(Path(app.outdir, PAGES), ignore_errors=True)
        for drawing in drawings_of(Path(app.srcdir)):
            for path, name in saved_pages(place_of(kept(app), *drawing)):
                (target := Path(app.outdir, PAGES, name)).parent.mkdir(exist_ok=True)
                shutil.copy(path, target)


class Drawing(SphinxDirective):
    """Figures with their caption."""

    has_content = True
    optional_arguments = 1
    final_argument_whitespace = True

    def figures(self, kind: str, argument: str, code: str, caption: str) -> list[nodes.Node]:
        try:
            place = draw(kept(self.env.app), kind, argument, code)
        except (OSError, RuntimeError) as error:
            raise self.error(str(error)) from None
        paths = sorted(path for path in place.rglob("*") if path.suffix in PICTURES)
        pages = [name for _, name in saved_pages(place)]
        if not paths and not pages:
            raise self.error(f"no figure and no page is saved by {argument or code!r}")
        shown: list[nodes.Node] = []
        for path in paths:
            # From the root of the sources, which Sphinx takes an absolute path to be relative to.
            uri = "/" + os.path.relpath(path, self.env.srcdir)
            shown.append(nodes.figure("", nodes.image(uri=uri, alt=caption)))
        if kind == "drawn" and caption and paths:
            shown[-1] += nodes.caption("", caption)
        up = "../" * self.env.docname.count("/")
        for name in pages:
            link = nodes.reference("", "Open the interactive page", refuri=f"{up}{PAGES}/{name}")
            shown.append(nodes.paragraph("", "", link, classes=["play"]))
        return shown


def folded(summary: str, *inside: nodes.Node) -> list[nodes.Node]:
    """Nodes below a line that unfolds them."""
    opening = nodes.raw("", f"<details><summary>{summary}</summary>", format="html")
    return [opening, *inside, nodes.raw("", "</details>", format="html")]


class Drawn(Drawing):
    """Code, and the figures that it saves; on some pages the figures come first."""

    def run(self):
        code = "\n".join(self.content) + "\n"
        figures = self.figures("drawn", "", code, self.arguments[0] if self.arguments else "")
        block = nodes.literal_block(code, code, language="python")
        return [*figures, *folded("The code", block)] if self.env.docname in FIGURES_FIRST else [block, *figures]


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
        block = nodes.literal_block(source, source, language="python")
        return [said, *figures, *folded(f"<code>studies/{name}.py</code>", block)]


class Theorem(SphinxDirective):
    """A theorem in short, and the printed statement of it, which a page shows, to be unfolded."""

    has_content = True
    required_arguments = 2
    final_argument_whitespace = True

    def run(self):
        page, words = self.arguments
        path = Path(self.env.srcdir, page)
        self.env.note_dependency(str(path))
        printed = re.findall(r"^```output\n(.*?)^```$", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        found = [text for text in printed if words in " ".join(text.split())]
        if len(found) != 1:
            raise self.error(f"{len(found)} printed texts of {page} have the words {words!r}")
        theorem = nodes.container(classes=["theorem"])
        self.state.nested_parse(self.content, self.content_offset, theorem)
        statement = nodes.literal_block(found[0], found[0], language="output")
        theorem.extend(folded("The theorem as it is printed", statement))
        return [theorem]


def mark_wide(app, document, name: str) -> None:
    """Give the wide figures of a page the class of that name, and a link each to the picture alone: there a reader with
    a narrow screen can enlarge it."""
    up = "../" * name.count("/")
    for image in list(document.findall(nodes.image)):
        path = Path(app.srcdir, image["uri"].lstrip("/"))
        # The width of a PNG stands in its first chunk.
        if path.suffix == ".png" and int.from_bytes(path.read_bytes()[16:20], "big") > WIDE:
            image["classes"].append("wide")
            _, file = app.env.images[image["uri"]]
            alone = nodes.reference("", "", image.deepcopy(), refuri=f"{up}_images/{file}", reftitle=ENLARGE)
            image.replace_self(alone)


def setup(app) -> dict:
    app.connect("doctree-resolved", mark_wide)
    app.add_directive("drawn", Drawn)
    app.add_directive("study", Study)
    app.add_directive("theorem", Theorem)
    app.connect("build-finished", copy_pages)
    app.connect("builder-inited", draw_all)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
