"""Pages, docstrings and messages are plain English: no phrase that a native reader has to read twice.

A phrase belongs in the list only if it is never right. The list is short; the style itself is in CONTRIBUTING.
"""

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GITHUB = [path for path in sorted((ROOT / ".github").glob("*.md")) if path.name != "CHANGES.md"]
PAGES = [ROOT / "README.md", *sorted((ROOT / "studies" / "docs").rglob("*.md")), *GITHUB]
PAGES += [ROOT / "studies" / "paper" / "paper.md", *sorted((ROOT / "studies" / "notebooks").glob("*.ipynb"))]
# Packages whose docstrings and messages are read too.
PACKAGES = ("orbits", "problems")
# Saved theorems contain the sentences of these modules, so that they stay as they are.
THEOREMS = ("check_statement.py", "wording.py", "branch_words.py")
CODE = re.compile(r"^ *```.*?^ *```$|^\$\$.*?^\$\$|`[^`\n]*`", flags=re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"^ *[\w*]+(, [\w*]+)* : ", flags=re.MULTILINE)

# What is never right, and what to write instead.
PHRASES = {
    r"\b(is|are|was|were) (said|told) by\b": "the active voice: 'the table states it'",
    r"\b(is|are) told\b": "the active voice: 'the message says so'",
    r"\b(has|have) not(?=[,.;:)]| (a|an|the|in|at|of)\b)": "'does not have'",
    r"\bsays? nothing\b": "'has no meaning' or 'does not determine'",
    r"\bof which\b": "a sentence of its own",
    r"\b[Tt]hose that\b": "the noun: 'the rows that'",
    r"\bwhich no\b": "an active sentence with 'not'",
    r"\bno (earlier|later|other) ones? (is|are|do|does)\b": "'only' with the noun",
    r"\bas many as\b": "'the same number of'",
    r"\bso many\b": "'this number of' or 'a bounded number of'",
    r"\bbeside\b": "'near', 'next to', 'in addition to' or 'compared with'",
    r"(?<![Tt]here)\s(is|are) none\b": "'is not a ...'",
    r"(?<![Tt]here)\s(is|are) no (?!longer|more|less)": "'is not a ...'",
    r"\bnothing but\b": "'only'",
    r"\bbut for\b": "'except for'",
    r"\bso that such\b": "two sentences",
    r"\bwould pass for\b": "'would look like'",
    r"\bheld against\b": "'compared with'",
    r"\bthe (first|second|third) number\b(?! of)": "the name of the number",
    r"\bthere what\b": "the noun",
    r"\bfor ever\b": "'forever'",
}
STUMBLED = (
    "A parameter that the machine has not, as a damper of 0, is no second parameter.",
    "`bifurcations` follows there what is found from `starts`, without the attractor.",
    "No schedule takes it, so that such a machine is not steered.",
    "Intervals of launch speeds say nothing.",
    "What attracts is said by `multipliers`, and by no `stable_side`.",
    "What is a fold along `beta` is none along `alpha`.",
    "That of the energy, of which only the power 4/3 is lost.",
    "An error in them inside would pass for one of the problem.",
    "A step there that is smaller than the second number is the error of these equations.",
)


def found(text: str) -> Iterator[tuple[int, str, str]]:
    """The phrases to avoid in a text, each with its line and what to write instead."""
    for phrase, instead in PHRASES.items():
        for match in re.finditer(phrase.replace(" ", r"\s+"), text):
            yield text.count("\n", 0, match.start()) + 1, " ".join(match[0].split()), instead


def prose(page: Path) -> str:
    """The text of a page with its lines, but without its code and its equations."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".ipynb":
        text = "\n\n".join("".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] != "code")
    return CODE.sub(lambda match: "\n" * match[0].count("\n") or "code", text)


def texts(package: str) -> Iterator[tuple[str, str]]:
    """The docstrings and the messages of a package, without names of fields and code, each with its file and line."""
    for path in sorted(path for path in (ROOT / package).rglob("*.py") if path.name not in THEOREMS):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                text = FIELD.sub("", CODE.sub("code", node.value))
                yield f"{path.relative_to(ROOT)}:{node.lineno}", " ".join(text.split())


@pytest.mark.parametrize("sentence", STUMBLED)
def test_sentences_that_had_to_be_read_twice_are_found(sentence):
    assert [*found(sentence)]


def test_pages_have_no_phrase_to_avoid():
    wrong = [(page, *each) for page in PAGES for each in found(prose(page))]
    assert not wrong, "\n".join(f"{page.relative_to(ROOT)}:{line}: {text!r}: {to}" for page, line, text, to in wrong)


def test_docstrings_and_messages_have_no_phrase_to_avoid():
    wrong = [(place, *each[1:]) for package in PACKAGES for place, text in texts(package) for each in found(text)]
    assert not wrong, "\n".join(f"{place}: {text!r}: {instead}" for place, text, instead in wrong)
