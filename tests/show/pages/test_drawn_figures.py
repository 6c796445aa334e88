"""Figures of matplotlib as figures of Bokeh: the same numbers, colours and names at the same places."""

import numpy as np
import pytest

from orbits import ReturnMap, bifurcations, existence, simulate, sweep
from orbits.show.canvas import new_axes, off_screen
from problems import Hopper

pytest.importorskip("bokeh")

from bokeh.models import ColorBar, HoverTool, Legend, WheelZoomTool

from orbits.show.pages.bokeh_figures import PAGE
from orbits.show.pages.drawn_figures import drawn_figures, words

pytestmark = pytest.mark.extra("bokeh")


@pytest.fixture
def axes():
    with off_screen():
        return new_axes()


def only(axes):
    """The one figure of axes."""
    ((figure,),) = drawn_figures(axes)
    return figure


def data_of(figure, name: str) -> dict:
    """The columns of the first artist with a name."""
    return next(each for each in figure.renderers if each.name == name).data_source.data


def legend_of(figure) -> list[str]:
    return [item.label.value for legend in figure.select(Legend) for item in legend.items]


def test_a_curve_and_marks_keep_their_numbers_and_colours(axes):
    x = np.linspace(0, 1, 7)
    axes.plot(x, x**2, "--", color="#D55E00", lw=3, label="square")
    axes.plot(x, x**3, "s", color="#009E73", alpha=0.5, label="cube")
    axes.set(xlim=(-1, 2), ylim=(3, -1), xlabel="x", ylabel="y", title="powers")
    figure = only(axes)
    assert [figure.x_range.start, figure.x_range.end, figure.y_range.start, figure.y_range.end] == [-1, 2, 3, -1]
    assert [figure.title.text, figure.xaxis.axis_label, figure.yaxis.axis_label] == ["powers", "x", "y"]
    line, marks = figure.renderers
    assert line.data_source.data["y"].tolist() == (x**2).tolist()
    assert (line.glyph.line_color, line.glyph.line_dash, line.glyph.line_width) == ("#d55e00ff", [6], 4.0)
    assert marks.data_source.data["y"].tolist() == (x**3).tolist()
    assert marks.glyph.fill_color == "#009e7380"
    assert legend_of(figure) == ["square", "cube"]
    (tool,) = figure.select(HoverTool)
    assert tool.renderers == [line, marks]
    assert figure.select_one(WheelZoomTool)


def test_areas_and_lines_across_are_where_they_are_drawn(axes):
    """An artist of another transform spans the axes as they are shown."""
    axes.set(xlim=(0, 10), ylim=(-2, 4))
    axes.axvspan(2.5, 5, fc="#e8e4d8", label="contact")
    axes.axhline(1.5, label="level")
    axes.fill_between([0, 1, 2], [0, 1, 0], label="area")
    figure = only(axes)
    contact = data_of(figure, "contact")
    assert (min(contact["x"][0]), max(contact["x"][0])) == pytest.approx((2.5, 5))
    assert (min(contact["y"][0]), max(contact["y"][0])) == pytest.approx((-2, 4))
    assert data_of(figure, "level")["x"] == pytest.approx([0, 10])
    assert data_of(figure, "level")["y"] == pytest.approx([1.5, 1.5])
    assert max(data_of(figure, "area")["y"][0]) == 1
    shaded = next(each for each in figure.renderers if each.name == "contact")
    assert shaded.glyph.line_color == "#9a937cff"  # or a page would hardly show a pale area


def test_cells_have_values_and_a_bar(axes):
    """Of grids in both orders of their axes, without the cells that have no value."""
    x, y = np.meshgrid([0.0, 1.0, 2.0], [10.0, 20.0], indexing="ij")
    z = np.ma.masked_invalid([[1.0, 2.0], [3.0, np.nan], [5.0, 6.0]])
    axes.figure.colorbar(axes.pcolormesh(x, y, z, shading="nearest"), ax=axes, label="value")
    figure = only(axes)
    cells = figure.renderers[0].data_source.data
    found = {
        ((a + b) / 2, (c + d) / 2): value
        for a, b, c, d, value in zip(
            *(cells[name] for name in ("left", "right", "bottom", "top", "value")), strict=True
        )
    }
    assert found == {(0, 10): 1, (0, 20): 2, (1, 10): 3, (2, 10): 5, (2, 20): 6}
    (bar,) = figure.select(ColorBar)
    assert (bar.title, bar.color_mapper.low, bar.color_mapper.high) == ("value", 1, 6)


def test_an_image_stands_as_it_is_shown(axes):
    axes.imshow([[1.0, 2.0], [3.0, 4.0]], aspect="auto")
    axes.set_xticks([0, 1], ["left", "right"])
    figure = only(axes)
    cells = figure.renderers[0].data_source.data
    first = next(i for i, value in enumerate(cells["value"]) if value == 1.0)
    assert (cells["left"][first], cells["bottom"][first], cells["top"][first]) == (-0.5, -0.5, 0.5)
    assert figure.y_range.start > figure.y_range.end  # the first row is at the top
    assert figure.xaxis[0].major_label_overrides == {0: "left", 1: "right"}


def test_panels_share_their_time():
    with off_screen():
        top = new_axes()
        low = top.figure.add_subplot(212, sharex=top)
    top.set_subplotspec(top.figure.add_gridspec(2, 1)[0])
    low.set_subplotspec(top.figure.add_gridspec(2, 1)[1])
    rows = drawn_figures(top)
    assert [len(row) for row in rows] == [1, 1]
    assert rows[0][0].x_range is rows[1][0].x_range


def test_axes_of_decades_and_circles_stay_so(axes):
    axes.loglog([1, 10], [1, 100])
    figure = only(axes)
    assert figure.x_scale.__class__.__name__ == figure.y_scale.__class__.__name__ == "LogScale"
    with off_screen():
        round_axes = new_axes()
    round_axes.set_aspect("equal")
    assert only(round_axes).match_aspect


def test_of_many_marks_some_are_shown(axes):
    axes.plot(np.arange(3 * PAGE.members), np.zeros(3 * PAGE.members), ",", label="many")
    axes.scatter(np.arange(2 * PAGE.members), np.zeros(2 * PAGE.members), c=np.arange(2 * PAGE.members))
    assert [len(each.data_source.data["x"]) for each in only(axes).renderers] == [PAGE.members] * 2


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("loss coefficient (s$^{1/3}$/m$^{1/3}$)", "loss coefficient (s^(1/3)/m^(1/3))"),
        (r"a price of 3 \$", "a price of 3 $"),
        ("plain", "plain"),
    ],
)
def test_raised_fractions_become_characters(text, expected):
    assert words(text) == expected


def test_a_text_beside_a_point_keeps_its_distance(axes):
    axes.annotate("name", (0.5, 0.25), (9, -18), textcoords="offset points", ha="left")
    (text,) = only(axes).renderers
    assert text.data_source.data["text"] == ["name"]
    assert (text.glyph.x_offset, text.glyph.y_offset) == pytest.approx((12, 24))  # pixels, downwards


@pytest.mark.slow
def test_every_result_with_a_plot_has_figures(softening_family):
    """With all of its labelled artists, and numbers at the pointer."""
    hopper = Hopper()
    diagram = bifurcations(hopper, "inject", (0.0, 0.1), (4.4, 4.7), sections=2)
    results = [
        simulate(Hopper(restitution=0.5), 4.7, hops=2),
        diagram,
        diagram.follow_event("flip", "mass_ratio", 1.1),
        ReturnMap(hopper)([4.4, 4.5]),
        ReturnMap(hopper, inject=0.03).periodic_hops(1, 4.4, 4.7),
        ReturnMap(hopper, inject=0.03).fixed_points(4, 5)[0],
        sweep(Hopper("cubic", rest_length=30), {"beta": [0.0, 0.1], "mass_ratio": [0.5, 1.0]}),
        existence(Hopper("cubic", rest_length=30), "beta", (-0.02, 0.01), "mass_ratio", (0.5, 1.0), samples=4),
        softening_family,
    ]
    for result in results:
        with off_screen():
            axes = result._draw(axes=new_axes())
        figures = [figure for row in drawn_figures(axes) for figure in row]
        named = {label for each in axes.figure.axes for label in each.get_legend_handles_labels()[1]}
        assert {words(label) for label in named} == {name for figure in figures for name in legend_of(figure)}
        assert all(figure.select(HoverTool) for figure in figures), type(result).__name__
