"""What README and pages show runs as it stands, every public name has a docstring and a page, and the site builds."""

import doctest
import inspect
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import chdir
from html.parser import HTMLParser
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import matplotlib.pyplot as plt
import numpy as np
import pytest
from browser import BROWSERS, chromium
from conftest import leave

import orbits
import problems
from orbits.show import animation
from problems.laws import springs

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "studies" / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
BLOCK = re.compile(r"^```(python|toml|text|output|console|\{drawn\}[^\n]*)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
# The pages whose code takes more than some seconds, or draws figures, which the site shows as they are drawn here.
LONG = (
    *(
        "README.md",
        "asteroid.md",
        "casadi.md",
        "chain.md",
        "command_line.md",
        "control.md",
        "design.md",
        "exact_orbits.md",
        "families.md",
        "gallery.md",
        "lesson.md",
    ),
    *("machine.md", "measured_spring.md", "pages.md", "proof.md", "return_map.md", "running.md", "si_leg.md"),
    *("spring.md", "start.md", "steps.md", "theory.md", "thousand_orbits.md"),
)
PYTHON = ("python", "{drawn}")
# What waits for a reader at the browser, or for a machine that a page only speaks of.
NOT_RUN = ("orbits explore",)
# The package that a block needs beside the required ones and those of the tests.
NEEDED = {"dataframe": "pandas", "dataset": "xarray", ".page(": "bokeh", "explore": "bokeh"}
NEEDED |= {"mujoco": "mujoco", "pydrake": "pydrake", "sympy": "sympy"}
# Toolkits that a page compares with; where one is missing, its page runs without the blocks that need it.
PEERS = ("rockit",)


def name_of(path: Path) -> str:
    """The path of a page from the project's root."""
    return str(path.relative_to(ROOT))


def blocks_of(page: Path) -> list[tuple[str, str]]:
    """The kinds and texts of a page's blocks of code that can be run; "{drawn}" is Python too, which stands alone."""
    return [(kind.partition(" ")[0], text) for kind, text in BLOCK.findall(page.read_text(encoding="utf-8"))]


def compiled(page: Path, text: str):
    """The code of a block; where it fails, the line is that of the page."""
    before = page.read_text(encoding="utf-8").partition(f"\n{text}```")[0].count("\n") + 1
    return compile("\n" * before + text, str(page), "exec")


def drawn_alone(page: Path, text: str, folder: Path) -> dict:
    """The names that a block has whose figures the site shows, which runs by itself in a folder of its own; the code is
    left beside the figures."""
    names: dict = {"__name__": "page"}
    folder.mkdir()
    (folder / "code").write_text(text, encoding="utf-8")
    with chdir(folder):
        exec(compiled(page, text), names)
    return names


def with_marks(page: Path):
    """A page as a parameter, with the marks of what its blocks need."""
    texts = [text for _, text in blocks_of(page)]
    extras = {package for word, package in NEEDED.items() if any(word in text for text in texts)}
    marks = [pytest.mark.extra(*sorted(extras))] if extras else []
    return pytest.param(page, id=name_of(page), marks=[*marks, *([pytest.mark.slow] if page.name in LONG else [])])


def is_left_out(text: str) -> bool:
    """Whether a block needs a peer that is not installed."""
    return any(f"from {peer} import" in text and find_spec(peer) is None for peer in PEERS)


def save_named(text: str) -> Path | None:
    """A file whose first line is a comment with its name, written to where the page runs; None for another block."""
    name = re.match(r"# ([\w.]+)", text)
    if name is None:
        return None
    path = Path(name[1])
    path.write_text(text, encoding="utf-8")
    return path


def differing(shown: str, printed: str) -> list[tuple[str, str]]:
    """The words in which a text differs from the end of what was printed. Numbers agree to five digits, those below
    1e-6 are rounding errors, and "..." stands for any one word, as for a time."""
    words = shown.split()
    pairs = list(zip(words, printed.split()[-len(words) :], strict=True))
    return [(word, other) for word, other in pairs if word not in ("...", other) and not close(word, other)]


def close(word: str, other: str) -> bool:
    """Whether two words are the same but for the last digits of a number."""
    number = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
    if re.sub(number, "#", word) != re.sub(number, "#", other):
        return False
    pairs = zip(re.findall(number, word), re.findall(number, other), strict=True)
    return all(float(a) == pytest.approx(float(b), rel=1e-5, abs=1e-6) for a, b in pairs)


def test_shown_output_is_compared():
    assert differing("alpha 2.93645918 +- 2.1e-15 in ... ms", "x\nalpha 2.93645919 +- 3e-15 in 140.7 ms") == []
    assert differing("alpha 2.9364 (family 1),", "alpha 2.9365 (family 2),") == [("2.9364", "2.9365"), ("1),", "2),")]


@pytest.mark.parametrize("page", [with_marks(page) for page in PAGES if blocks_of(page)])
def test_page_runs(page, orbits, tmp_path, monkeypatch, capsys, figures_of_site):
    """A page's Python runs from its top to its end and prints what the page shows, its files are machines that hop, and
    its commands exit with 0. Animations have few frames."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(animation, "_frames", lambda frames: 4)
    shutil.copy(springs.SAMPLE, tmp_path)
    names: dict = {"__name__": "page"}
    printed = ""
    left_out = False
    for number, (kind, text) in enumerate(blocks_of(page)):
        left_out = is_left_out(text) or (left_out and kind == "output")
        if left_out:
            continue
        if kind in PYTHON:
            if kind == "python":
                exec(compiled(page, text), names)
            else:
                names |= drawn_alone(page, text, folder := tmp_path / str(number))
                leave(folder, figures_of_site, f"{page.stem} {number}")
            plt.close("all")
            printed = capsys.readouterr().out
        elif kind == "output":
            assert differing(text, printed) == []
        elif kind == "console":
            for line in text.replace("\\\n", " ").splitlines():
                command = shlex.split(line.removeprefix("$ "), comments=True)
                if line.startswith("$ orbits") and " ".join(command[:2]) not in NOT_RUN:
                    done = orbits("", *command[1:])
                    assert done.code == 0, f"{line}: {done.err}"
        else:
            path = save_named(text)
            if kind == "toml":
                path = path or Path("machine.toml")
                path.write_text(text, encoding="utf-8")
                done = orbits("find --json --machine", path)
                assert (done.code, done.document["admissible"]) == (0, True), done.err


def test_readme_has_its_commands():
    """The first two lines of shell code install and test; continuous integration takes the second from there."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = re.search(r"^```sh\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)[1].splitlines()
    assert "pip install ." in lines[0]
    assert "orbits find" in lines[0]
    assert 'pip install -e ".[test]"' in lines[1]
    assert "pytest" in lines[1]


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 160


def broken_links(page: Path) -> list[str]:
    """What a page links to beside it that is not there, or without the heading that is named."""
    broken = []
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        path, _, anchor = unquote(target).partition("#")
        if urlsplit(target).scheme:
            continue
        file = (page.parent / path).resolve() if path else page
        if not file.exists():
            broken.append(f"{name_of(page)}: {target}")
        elif anchor and file.suffix == ".md":
            titles = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
            if anchor not in {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}:
                broken.append(f"{name_of(page)}: {target}")
    return broken


def test_links_in_the_repository():
    assert [link for page in PAGES for link in broken_links(page)] == []


def test_github_says_where_to_read_what_it_leaves_out():
    """Blocks that only the site fills are empty there; a note says where to read them, which the site does not have."""
    empty = re.compile(r"^```\{(?:eval-rst|commands|notebooks|study|include)\}", flags=re.MULTILINE)
    pages = {page: page.read_text(encoding="utf-8") for page in PAGES}
    bare = [name_of(page) for page, text in pages.items() if empty.search(text) and "on-github" not in text]
    assert bare == []


@pytest.mark.parametrize("what", ["springs.formula", "gravity.function", "leg = Mechanism"])
def test_extensions_are_short(what):
    texts = [text for page in PAGES for kind, text in blocks_of(page) if kind in PYTHON and what in text]
    frame = ("from ", "import ", "print(")
    lines = [[line for line in text.splitlines() if line.strip() and not line.startswith(frame)] for text in texts]
    assert min(map(len, lines)) < 15


def test_the_mechanism_that_is_shown_has_its_closed_form():
    """With a linear spring half the flight of the hopper with an inerter obeys tan x = x."""
    page = DOCS / "how_to" / "machine.md"
    text = next(text for kind, text in blocks_of(page) if "leg = Mechanism" in text)
    names: dict = {}
    exec(compiled(page, text), names)
    linear = names["leg"].with_values(c=0.0)
    m1, m2, k, _, b = (linear.values[name] for name in ("m1", "m2", "k", "c", "b"))
    x = names["find"](linear).flight_time / 2 * np.sqrt(k / (m1 * m2 / (m1 + m2) + b))
    assert x == pytest.approx(np.tan(x), rel=1e-12)


# Every public name.

PUBLIC = [(package, name) for package in (orbits, problems) for name in package.__all__]
# What is in a room, and can be imported from the package too.
FURTHER = {name: place for name, place in orbits.PLACE_OF.items() if name not in orbits.__all__}
OTHER_NAMES = {"BranchEnd", "DesignEvent", "FixedPoint", "PeriodicHop"}  # of `End`, `Event` and `ReturningHops`
PUBLIC += [(import_module(f"orbits.{place}"), name) for name, place in FURTHER.items() if name not in OTHER_NAMES]
DOCUMENTED = re.compile(r"^\.\. (?:autofunction|autoclass|autoexception|automodule|data):: (\S+)$", flags=re.MULTILINE)


def full_name(package, name: str) -> str:
    """Where a public name is described: a module that is public by a shorter name, under its own."""
    thing = getattr(package, name)
    return thing.__name__ if inspect.ismodule(thing) else f"{package.__name__}.{name}"


@pytest.mark.parametrize("name", FURTHER)
def test_further_names_are_imported_from_the_package_too(name):
    assert getattr(orbits, name) is getattr(import_module(f"orbits.{FURTHER[name]}"), name)


def test_every_public_name_has_a_page():
    described = DOCUMENTED.findall("\n".join(page.read_text(encoding="utf-8") for page in (DOCS / "api").glob("*.md")))
    assert len(set(described)) == len(described)
    assert not {full_name(package, name) for package, name in PUBLIC} - set(described)


def public_members(thing: type):
    """The public methods and properties that a class itself defines, by name."""
    for name, member in vars(thing).items():
        function = getattr(member, "__func__", getattr(member, "fget", getattr(member, "func", member)))
        if not name.startswith("_") and inspect.isfunction(function) and function.__name__ != "<lambda>":
            yield name, function


def test_every_public_name_has_a_docstring():
    bare = []
    for package, name in PUBLIC:
        thing = getattr(package, name)
        if inspect.isclass(thing):
            assert "doc" not in vars(thing), name
            # a dataclass without a docstring has its signature for one
            bare += [name] if (thing.__doc__ or "").startswith(f"{thing.__name__}(") else []
            # what a class of results overrides means what `Result` says of it
            documented = {member for member, _ in public_members(thing) if inspect.getdoc(getattr(thing, member))}
            bare += [f"{name}.{member}" for member, _ in public_members(thing) if member not in documented]
        if (callable(thing) or inspect.ismodule(thing)) and not inspect.getdoc(thing):
            bare.append(name)
    assert not bare, bare


# Examples in docstrings.

# The modules whose text has an example.
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for package in ("orbits", "problems")
    for path in (ROOT / package).rglob("*.py")
    if ">>>" in path.read_text(encoding="utf-8")
)
WITH_EXAMPLES = (
    *("find", "find_all", "follow", "follow_fold", "trace", "orbit_at", "prove", "prove_fold", "prove_absence"),
    *("ReturnMap", "multiplier", "simulate", "steer", "optimize", "pareto", "quantities", "sensitivities", "sweep"),
    *("prove_fixed_point", "prove_doubling"),
    *("uncertainty", "existence", "check", "Mechanism", "Orbit", "Family", "Stage", "StepControl", "linear_modes"),
    *("Hopper", "Juggler", "HeavyHand", "Chain", "hopper_in_si", "juggler_in_si", "inerter_hopper", "knee_hopper"),
    *("plate_hopper", "chain_hand", "springs.formula", "springs.potential", "springs.function", "springs.table"),
    *("gravity.formula", "gravity.function", "steering.keep_hopping", "steering.recover", "steering.start_up"),
)
# A fold costs second derivatives of a whole flight, a control and a front many iterations.
LONG_EXAMPLES = (
    "orbits.control.holding",
    "orbits.continuation.branch_curve",
    "orbits.continuation.follow",
    "orbits.periodic.branch_points",
    "orbits.sweeps.existence",
    "problems.machines.knee",
    "problems.machines.plate",
    "orbits.continuation.folds",
    "orbits.design.pareto",
    "orbits.returns.proofs",
    "orbits.proof.prove",
    "problems.steering.goals",
)
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def examples_of(module) -> list[doctest.DocTest]:
    """The examples in the docstrings of a module."""
    return [test for test in doctest.DocTestFinder(exclude_empty=True).find(module) if test.examples]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in LONG_EXAMPLES else []) for name in MODULES]
)
def test_examples_in_docstrings_run(name, tmp_path, monkeypatch):
    tests = examples_of(import_module(name))
    assert tests
    monkeypatch.chdir(tmp_path)
    for test in tests:
        said: list[str] = []
        doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=said.append)
        assert not said, "".join(said)


def test_main_names_have_an_example():
    assert {*LONG_EXAMPLES} <= {*MODULES}
    homes = {name: package for package, name in PUBLIC}
    for name in WITH_EXAMPLES:
        thing: object = homes[name.split(".")[0]]
        for part in name.split("."):
            thing = getattr(thing, part)
        assert ">>>" in (inspect.getdoc(thing) or ""), name


# The site.


class Page(HTMLParser):
    """What a page loads and links to, and the names that can be linked to in it."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.names: set[str] = set()

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.names |= {given[key] for key in ("id", "name") if given.get(key)}
        # Links to other places are for readers; what a page itself loads has to lie beside it.
        key = {"a": "href", "link": "href", "script": "src", "img": "src"}.get(tag)
        if key and given.get(key):
            self.links.append(given[key] if tag == "a" else f"loaded {given[key]}")


def built_site(folder: Path, figures_of_site: Path) -> Path:
    """The built site, with the figures that other tests have drawn, all others but one being drawn here, where the
    packages are imported; the build ends with an error on any warning."""
    for package in ("bokeh", "flint", "furo", "myst_parser", "sphinx_copybutton"):
        pytest.importorskip(package)
    from studies.docs.parts.drawings import drawings_of, place_of, run

    figures = folder / ".cache" / "figures"
    for drawn in figures_of_site.iterdir():
        code = (drawn / "code").read_text(encoding="utf-8") if (drawn / "code").exists() else ""
        place = place_of(figures, "drawn" if code else "study", drawn.name, code)
        shutil.copytree(drawn, place)
        (place / "done").touch()
    for drawing in drawings_of(DOCS)[1:]:
        place = place_of(figures, *drawing)
        if not place.exists():
            with chdir("."), pytest.MonkeyPatch.context() as patch:
                patch.setattr(sys, "argv", sys.argv)
                run(place, *drawing)
                plt.close("all")
    command = [sys.executable, DOCS / "build.py", "--output", folder]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def follow_links(site: Path) -> None:
    """No link within the site leads nowhere, and nothing is loaded from elsewhere."""
    pages = {path.resolve(): Page() for path in site.rglob("*.html")}
    for path, page in pages.items():
        page.feed(path.read_text(encoding="utf-8"))
    assert len(pages) > 30
    for path, page in pages.items():
        for link in page.links:
            loaded, target = link.startswith("loaded "), urlsplit(link.removeprefix("loaded "))
            if target.scheme or target.netloc:
                assert not loaded or target.scheme == "data", f"{path.name} loads {link}"
                continue
            file = (path.parent / unquote(target.path)).resolve() if target.path else path
            assert file.exists(), f"{path.name} links to {link}"
            if target.fragment and file in pages:
                assert unquote(target.fragment) in pages[file].names, f"{path.name} links to {link}"
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*['\"]?(https?:)?//", sheet.read_text(encoding="utf-8")), sheet.name


def see_wide_figures(site: Path) -> None:
    """A figure of several panels is a link to the picture alone, which a reader with a narrow screen can enlarge."""
    text = (site / "gallery.html").read_text(encoding="utf-8")
    images = re.findall(r'(<a [^>]*?>)?<img ([^>]*?)src="_images/(\w+)\.png"', text)
    wide = {name for _, attributes, name in images if 'class="wide"' in attributes}
    assert {"existence", "spring_families", "benchmark", "figure_7"} <= wide
    assert wide == {name for link, _, name in images if f'href="_images/{name}.png"' in link}
    assert "heights" in {name for _, _, name in images} - wide


# What is wider than its place: the page, the part of it that would scroll, an equation in its line, and a picture.
TOO_WIDE = """
const page = document.documentElement, found = [];
const all = [page, document.querySelector(".content"), ...document.querySelectorAll(".equation")];
for (const each of all) if (each.scrollWidth > each.clientWidth + 1) found.push(each.id || each.className || "page");
for (const each of document.querySelectorAll("article img, article math")) {
  const {left, right} = each.getBoundingClientRect();
  if (!each.closest("table") && (left < -1 || right > page.clientWidth + 1)) found.push(each.alt || "math");
}
return found;
"""


def see_pages_at_all_widths(site: Path) -> None:
    """Nothing of a page is cut, and none scrolls sideways, from a phone to a wide screen."""
    with chromium() as page:
        for name in (
            "index",
            "lesson",
            "theory",
            "gallery",
            "how_to/steps",
            "how_to/running",
            "how_to/measured_spring",
        ):
            for width in (360, 400, 1024, 1100, 1200):
                page.resize(width)
                page.open(site / f"{name}.html")
                assert page.run(TOO_WIDE) == [], f"{name} at {width} pixels"


def see_theorems(site: Path) -> None:
    """A printed theorem is one line, which wraps, above the rows of its table, which do not; the gallery has it too,
    and pages to play with."""
    line = r'<span class="line" style="--indent:2">[^\n]*Let the hopper have [^\n]* mirror image of the landing\.'
    for page in ("how_to/proof.html", "gallery.html"):
        text = (site / page).read_text(encoding="utf-8")
        assert re.search(line, text), page
        assert re.search(r'<span class="line row">[^\n]*  alpha  ', text), page
    assert len({*(site / "pages").glob("*.html")}) == 7


def look_up_every_public_name(site: Path) -> None:
    """Each name, and each public member of a class, has its description."""
    text = "".join(path.read_text(encoding="utf-8") for path in (site / "api").glob("*.html"))
    described = set(re.findall(r'id="(?:module-)?([\w.]+)"', text))
    for package, name in PUBLIC:
        full = full_name(package, name)
        assert full in described
        thing = getattr(package, name)
        if inspect.isclass(thing):
            for member, _ in public_members(thing):
                assert f"{full}.{member}" in described


@pytest.mark.docs
def test_site(tmp_path, figures_of_site):
    """One test, so that one worker builds it once."""
    site = built_site(tmp_path, figures_of_site)
    follow_links(site)
    see_wide_figures(site)
    see_theorems(site)
    look_up_every_public_name(site)
    if any(map(shutil.which, BROWSERS)):
        see_pages_at_all_widths(site)
