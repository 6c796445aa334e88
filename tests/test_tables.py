"""Tables of results: numbers with their units, and pages that escape what they say."""

import numpy as np
import pytest
from cells import Cells

from orbits.tables import LAYOUT, digits_within, html_table, number_text, text_table, wrapped


def test_a_table_says_all_and_escapes_it():
    page = html_table([("a<b", "1 & 2"), ("c", '"x"')], "<script>", ("name", "value"))
    assert "<script>" not in page
    assert Cells(page).rows == [["name", "value"], ["a<b", "1 & 2"], ["c", '"x"']]
    assert page.count('scope="row"') == 2
    assert page.count('scope="col"') == 2
    assert "<caption" in page
    assert "<caption" not in html_table([("a", "b")], "")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (None, "m", "-"),
        (1 / 3, "m/s", "0.3333333 m/s"),
        (1e-20, "", "1e-20"),
        (np.float64(0.5), "N", "0.5 N"),
        (3, "", "3"),
        ("yes", "m", "yes"),
        (True, "m", "True"),
    ],
)
def test_numbers_have_their_unit(value, unit, text):
    assert number_text(value, unit) == text


FORMULA = "+".join(f"{n}.5*sin({n}*r)" for n in range(1, 40))


@pytest.mark.parametrize(("value", "text"), [(np.inf, "inf"), (-np.inf, "-inf"), (np.nan, "nan")])
@pytest.mark.parametrize("error", [1e-3, 0.0, np.inf, np.nan])
def test_what_is_no_finite_number_is_a_word(value, error, text):
    assert number_text(value, digits=digits_within(value, error, 15)) == text


@pytest.mark.parametrize(
    ("value", "error", "digits"),
    [
        (4.493409457909064, 9.1e-16, 15), (2.936, 1.3e-15, 15), (-1.5114, 2.9e-14, 14), (1284.6491965, 8.9e-7, 10),
        (0.7336, 4.8e-4, 3), (9.99, 1e-3, 4), (1.0, 0.0, 15), (3.0, 7.0, 1), (0.0, 1e-9, 1),
        (2.5, np.nan, 1), (2.5, np.inf, 1),
    ],
)  # fmt: skip
def test_the_last_digit_is_off_by_at_most_one(value, error, digits):
    assert digits_within(value, error, 15) == digits
    text = number_text(value, digits=digits)
    assert abs(float(text) - value) <= 0.5 * 10.0 ** (np.floor(np.log10(abs(value) or 1)) - digits + 1) * 1.001


def test_lines_fit_and_nothing_is_lost():
    text = f"the leg has mass = 60 kg, stiffness = 8000 N/m and the force {FORMULA} at +- 1.5e-16 for all r"
    for width in (40, 57, 80):
        lines = wrapped(text, width, indent="  ", onward="      ")
        assert max(map(len, lines)) <= width
        assert "".join("".join(lines).split()) == "".join(text.split())
        assert not any(line.endswith(("=", "+-", " 60", " 8000")) for line in lines)
    assert wrapped("1" * 90) == ["1" * 90]  # a number is not cut
    assert wrapped("wrong:\n    r^3\n     ^") == ["wrong:", "    r^3", "     ^"]


def test_a_table_of_names_goes_on_below():
    lines = text_table(
        [("alpha", "4.5 m/s"), ("a name of many words that is longer than its column", "x"), ("c", FORMULA)]
    )
    assert max(map(len, lines)) <= LAYOUT.line
    assert lines[0] == "  alpha                                   4.5 m/s"
    assert [line.strip() for line in lines[1:3]] == ["a name of many words that is longer than its column", "x"]
    assert "".join(line.strip() for line in lines[3:]).endswith(FORMULA)


def test_columns_that_do_not_fit_stand_below_with_the_first_one():
    numbers = [f"{n / 7:.15g}" for n in range(1, 9)]
    table = text_table([["alpha", *numbers], ["of all members", *numbers]], ["name", *"abcdefgh"])
    assert max(map(len, table)) <= LAYOUT.line
    blocks = "\n".join(table).split("\n\n")
    assert [block.split()[0] for block in blocks] == ["name"] * len(blocks)
    assert [x for block in blocks for x in block.splitlines()[1].split()[1:]] == numbers
