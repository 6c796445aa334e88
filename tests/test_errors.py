"""Numbers that a user gives are checked in one place, and the message names the value and the bounds."""

import re

import numpy as np
import pytest

from orbits import InputError
from orbits.errors import (
    MESSAGES,
    finite_number,
    list_of_names,
    one_of,
    range_of,
    shortened,
    true_or_false,
    unit_stated,
    whole_number,
)
from orbits.laws import number
from problems import runner


@pytest.mark.parametrize("value", [2, 5, np.int64(3)])
def test_whole_numbers_within_their_bounds(value):
    assert type(whole_number("order", value, "powers", 2, 5)) is int


@pytest.mark.parametrize("value", [1, 6, 2.0, True, "3", None, np.nan])
def test_other_numbers_are_refused(value):
    with pytest.raises(InputError, match=r"order = .*; it must be a number of powers, from 2 to 5"):
        whole_number("order", value, "powers", 2, 5)
    with pytest.raises(InputError, match=r"order = -1; it must be a number of powers, at least 0"):
        whole_number("order", -1, "powers", 0)


@pytest.mark.parametrize("value", [None, "sobol ", 1, ["grid"], np.zeros(0), np.array(["grid", "sobol"])])
def test_a_word_that_is_none_of_the_known_is_refused(value):
    assert one_of("sampling", "grid", ("grid", "sobol")) == "grid"
    with pytest.raises(InputError, match=r"sampling = .*; it must be one of grid, sobol"):
        one_of("sampling", value, ("grid", "sobol"))


@pytest.mark.parametrize("value", [None, 1, "True", np.zeros(0)])
def test_what_is_neither_true_nor_false_is_refused(value):
    assert true_or_false("in_si", np.bool_(True)) is True
    with pytest.raises(InputError, match=r"in_si = .*; it must be True or False"):
        true_or_false("in_si", value)
    with pytest.raises(InputError, match=r"in_si = .*; it must be True or False"):
        runner(in_si=value)


@pytest.mark.parametrize("names", [None, 3, np.array(np.nan), [1], {1: 2}])
def test_names_are_texts(names):
    assert list_of_names("quantities", np.array(["alpha"])) == list_of_names("quantities", "alpha") == ["alpha"]
    with pytest.raises(InputError, match="it must be a name, or a list of names"):
        list_of_names("quantities", names)


@pytest.mark.parametrize("ends", [(1, 2), [1.0, 2.0], np.array([1, 2]), range(1, 3), iter((1, 2))])
def test_a_range_is_a_pair_of_numbers_that_ascend(ends):
    assert range_of("over", ends) == (1.0, 2.0)


@pytest.mark.parametrize(
    ("ends", "reason"),
    [
        (np.array(3.0), "it must be a pair"),
        (3.0, "it must be a pair"),
        ("12", "it must be a pair"),
        ((1, 2, 3), "it must be a pair"),
        ((1, np.nan), "is not a finite number"),
        ((2, 2), "low must be below high"),
    ],
)
def test_other_ranges_are_refused(ends, reason):
    with pytest.raises(InputError, match=f"over = .*{reason}"):
        range_of("over", ends)


def test_a_long_message_keeps_its_remedy():
    message = str(InputError("the option '" + "x" * 10_000 + "' is too long: write a shorter one"))
    assert len(message) <= MESSAGES.longest
    assert message.startswith("the option 'xxx")
    assert message.endswith("write a shorter one")
    assert shortened("as it is") == "as it is"


def test_a_long_message_leaves_out_whole_words():
    words = "".join(f"parameter{number} " for number in range(100))
    head, tail = shortened(words).split(" ... ")
    assert words.startswith(head + " ")
    assert words.endswith(" " + tail)


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("620mm", "leave the unit 'mm' out and state the number alone, 0.62 for a machine in SI"),
        (" 1.5e1 kN ", "leave the unit 'kN' out and state the number alone, 15000 for a machine in SI"),
        ("8N/mm", "leave the unit 'N/mm' out and state the number alone, 8000 for a machine in SI"),
        ("3furlong", "leave the unit 'furlong' out and state the number alone$"),
    ],
)
def test_a_number_with_a_unit_is_refused_with_the_number(text, remedy):
    assert re.search(remedy, unit_stated(text))
    with pytest.raises(InputError, match=f"length = .* number.*: {remedy}"):
        number("length", text)
    with pytest.raises(InputError, match=f"length = .* number: {remedy}"):
        finite_number("length", text)


@pytest.mark.parametrize("value", ["big", "", "mm", "1e5", "3,4", 3.0, None, "2*m", "1 2", "1" * 100 + "mm"])
def test_what_is_no_number_with_a_unit(value):
    assert unit_stated(value) == ""
