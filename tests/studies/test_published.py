"""Published cases: each is right, has its source, and stands on the page; a wrong one is said to be wrong."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from studies import published
from studies.published_cases import sources
from studies.published_cases.case import Case, Computed, computed, half_a_unit, our_text

CASES = [case for cases in published.SUBJECTS.values() for case in cases]


def rows(text):
    """The rows of the tables of cases on a page: the words, the number published, ours, the bound, and the source."""
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| **")]
    assert {len(row) for row in lines} == {5}
    return lines


def assert_right_and_on_page(found):
    """All agree with their sources, and the page has our numbers."""
    assert [each.case for each in found if not each.right] == []
    on_page = {row[0]: row[2] for row in rows(published.PAGE.read_text(encoding="utf-8"))}
    for each in found:
        words, _, ours, *_ = published.cells(each, 0)
        assert float(on_page[words]) == pytest.approx(float(ours), rel=1e-8, abs=1e-12)


def test_quick_cases_are_right(capsys):
    found = published.main(quick=True)
    assert_right_and_on_page(found)
    assert len(found) == sum(not case.slow for case in CASES)
    assert f"{len(found)} of {len(found)} cases are right" in capsys.readouterr().out


@pytest.mark.slow
def test_slow_cases_are_right():
    assert_right_and_on_page([computed(case) for case in CASES if case.slow])


def test_the_page_says_what_the_cases_say():
    """All but our own numbers, which the tests of the cases compare."""
    text = published.PAGE.read_text(encoding="utf-8")
    expected = published.page(
        {subject: [Computed(case, case.expected) for case in cases] for subject, cases in published.SUBJECTS.items()}
    )
    for row, other in zip(rows(text), rows(expected), strict=True):
        assert row[:2] + row[3:] == other[:2] + other[3:]
    others = [[line for line in each.splitlines() if not line.startswith("| **")] for each in (text, expected)]
    assert others[0] == others[1]


def test_each_case_has_its_source():
    """Each source is used, and has an author or a project and a year; cells of the page have no bars."""
    keys = [(case.name, case.quantity) for case in CASES]
    assert len(set(keys)) == len(keys) >= 40
    used = {case.source for case in (*CASES, *published.CANNOT)}
    assert used == {value for name, value in vars(sources).items() if name.isupper()}
    assert all(re.search(r"[A-Za-z]{3}", each) and re.search(r"\b(1[5-9]|20)\d\d\b", each) for each in used)
    texts = [text for case in CASES for text in (case.name, case.quantity, case.place)]
    assert all(text and "|" not in text for text in texts)


def test_what_differs_is_wrong(monkeypatch, capsys):
    right = Case("a", "b", "c", "d", ["1.52", "3"], lambda: [1.5249, 3.4])
    assert computed(right).right
    for numbers in ([1.526, 3.0], [1.52, 3.6], [np.nan, 3.0]):
        wrong = Case("a", "b", "c", "d", ["1.52", "3"], lambda numbers=numbers: numbers)
        assert not computed(wrong).right
    monkeypatch.setattr(published, "SUBJECTS", {"Wrong": [wrong]})
    assert not published.main()[0].right
    assert "WRONG a: b\n        published 1.52, ours nan, worst of 2" in capsys.readouterr().out
    with pytest.raises(ValueError, match="1 numbers are computed, 2 are published"):
        computed(Case("a", "b", "c", "d", ["1.52", "3"], lambda: [1.5]))
    with pytest.raises(ValueError, match="needs within="):
        Case("a", "b", "c", "d", [1.52], lambda: [1.5])


def test_numbers_are_printed_with_their_digits():
    assert [half_a_unit(text) for text in ("1.52", "3", "1.5e-3", "120")] == [0.005, 0.5, 5e-5, 0.5]
    assert [our_text(2 / 3, each) for each in ("0.7", "1", 0.5)] == ["0.67", "0.7", "0.6666666667"]


def test_the_command_ends_with_1_where_one_is_wrong(monkeypatch):
    source = Path(published.__file__).read_text(encoding="utf-8").partition("if __name__")
    names = {**vars(published), "main": lambda *_: [Computed(CASES[0], CASES[0].expected + 1)]}
    monkeypatch.setattr(sys, "argv", ["published.py", "--quick"])
    with pytest.raises(SystemExit) as ended:
        exec("if True" + source[2].partition(":")[1] + source[2].partition(":")[2], names)
    assert ended.value.code == 1
    monkeypatch.setattr(sys, "argv", ["published.py", "--quick", "--write"])
    with pytest.raises(SystemExit, match="2"):
        exec("if True" + source[2].partition(":")[1] + source[2].partition(":")[2], names)
