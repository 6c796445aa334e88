"""Tables of results: numbers with their units, and pages that escape what they say."""

import numpy as np
import pytest
from cells import Cells

from orbits.tables import html_table, number_text


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
