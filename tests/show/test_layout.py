"""The layout of figures at any width: lines, legends, ticks and panels, and back to what they were."""

from itertools import pairwise

import numpy as np
from legibility import faults

from orbits.show import STYLE, legend_below, new_axes, new_row
from orbits.show.canvas import set_width

TITLE = "a machine, with a value = 1, another value = 2, and a third value = 3, which is the last one of all values"


def boxes(texts):
    return [text.get_window_extent() for text in texts if text.get_text()]


def test_lines_are_broken_behind_commas_and_only_where_they_must_be():
    axes = new_axes()
    axes.set(title=TITLE, xlabel="x", ylabel="a name of an axis that is longer than the axis is high, at least here")
    axes.figure.draw_without_rendering()
    title = axes.get_title()
    assert title.replace("\n", " ") == TITLE
    assert all(line.endswith(",") for line in title.split("\n")[:-1])
    assert "\n" in axes.get_ylabel()
    assert not faults(axes.figure)
    set_width(axes, 300.0)
    axes.figure.draw_without_rendering()
    assert axes.get_title() == TITLE
    axes.set_title("another")  # it is broken anew, not the one before
    axes.figure.draw_without_rendering()
    assert axes.get_title() == "another"


def test_a_legend_has_the_columns_for_which_there_is_room():
    axes = new_axes()
    for k in range(6):
        axes.plot([0, 1], [k, 0], label=f"a curve with number {k}")
    legend_below(axes).set(xlabel="x", ylabel="y")
    counts = []
    for width in (STYLE.column, STYLE.page):
        set_width(axes, width)
        axes.figure.draw_without_rendering()
        legend = axes.get_legend()
        assert legend.get_window_extent().width < axes.figure.bbox.width
        assert legend.get_window_extent().y1 < axes.xaxis.label.get_window_extent().y0
        counts.append(len({round(box.x0) for box in boxes(legend.get_texts())}))
    assert counts[0] < counts[1]
    own = axes.legend(["mine"])  # another legend stays as it is
    set_width(axes, STYLE.column)
    axes.figure.draw_without_rendering()
    assert axes.get_legend() is own


def test_a_legend_is_close_to_an_axis_without_numbers():
    axes = new_axes()
    axes.plot([0, 1], [0, 1], label="curve")
    legend_below(axes).set(xticks=[], ylabel="y")
    axes.figure.draw_without_rendering()
    assert 0 < axes.bbox.y0 - axes.get_legend().get_window_extent().y1 < 20


def test_narrow_panels_are_below_each_other():
    panels = new_row(3, 0.9)
    for k, axes in enumerate(panels):
        axes.plot([0, 1], [0, k])
        axes.set(title=f"panel {k}", xlabel="x", ylabel="y")
    set_width(panels[0], STYLE.column)
    panels[0].figure.draw_without_rendering()
    places = [axes.get_position() for axes in panels]
    assert np.ptp([place.x0 for place in places]) < 1e-6
    assert all(one.y0 > other.y1 for one, other in pairwise(places))
    assert not faults(panels[0].figure)


def test_ticks_do_not_meet():
    axes = new_axes()
    axes.plot([123456.1, 123456.9], [0, 1])
    axes.ticklabel_format(useOffset=False)
    axes.set(xlabel="x", ylabel="y")
    assert not faults(axes.figure)
