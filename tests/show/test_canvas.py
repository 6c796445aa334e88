"""Figures as they are begun and written: type by that of the axes, and the widths of journals."""

import re

import pytest
from matplotlib.figure import Figure

from orbits import InputError, find
from orbits.show import STYLE, new_axes, new_row, save_figure, small_type
from orbits.show.canvas import set_width
from problems import Hopper, hopper_in_si

MM = 72 / 25.4  # points
LEG = hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8)


def test_type_follows_that_of_the_axes():
    """On axes of a user's own the type is as large as theirs, and their figure keeps its layout."""
    own = Figure().add_subplot()
    own.xaxis.label.set_size(16)
    axes = find(Hopper()).plot(own)
    assert axes is own
    assert (axes.title.get_size(), axes.get_legend().get_texts()[0].get_size()) == (16, 14)
    new = new_axes()
    assert (new.title.get_size(), small_type(new)) == (STYLE.type, STYLE.small_type) == (8, 7)
    assert own.figure.get_layout_engine() is None


def test_axes_of_any_figure_are_drawn_on():
    """A part of a figure, and axes that stand in no grid, have legends that fit below them."""
    figure = Figure(figsize=(8, 4), layout="constrained")
    left, _ = figure.subfigures(1, 2)
    for axes in (left.add_subplot(), figure.add_axes((0.6, 0.4, 0.35, 0.5))):
        find(Hopper()).plot(axes)
        figure.draw_without_rendering()
        assert axes.get_legend().get_window_extent().width < 0.5 * figure.bbox.width


@pytest.mark.parametrize("width", [STYLE.column, STYLE.page])
def test_a_figure_is_written_as_wide_as_a_journal_wants_it(width, tmp_path):
    path = save_figure(find(LEG).plot(), tmp_path / "hop.pdf", width)
    (box,) = re.findall(rb"/MediaBox \[ ([\d. ]+) \]", path.read_bytes())
    assert float(box.split()[2]) == pytest.approx(width * MM)


def test_no_figure_is_too_narrow():
    for width, words in ((20, "at least 55 mm"), (float("nan"), "width"), ("85", "width")):
        with pytest.raises(InputError, match=words):
            set_width(new_axes(), width)


def test_panels_side_by_side_are_as_wide_as_a_page():
    left, right = new_row(2, 0.5)
    assert left.figure is right.figure
    assert left.figure.get_size_inches() * 25.4 == pytest.approx([STYLE.page, STYLE.page / 4])
