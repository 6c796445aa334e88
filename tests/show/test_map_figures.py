"""Figures of return maps: cobwebs, fixed points, basins, and what cannot be drawn."""

import numpy as np
import pytest

from orbits import InputError, ReturnMap
from problems import Hopper


@pytest.mark.slow
def test_basins_and_their_figure():
    """Launches of each basin come to the lossless hop that is told; together they are `basin`, and the figure tells
    the total."""
    step = ReturnMap(Hopper(mass_ratio=0.05))
    low, high = 4.6, 9.0
    basins = step.basins(low, high)
    assert list(basins) == pytest.approx([4.493409457909064, 7.725251836937707])
    for star, intervals in basins.items():
        alpha = np.array([0.3 * a + 0.7 * b for a, b in intervals])
        for _ in range(3000):
            alpha = step(alpha).next
        assert (alpha >= star - 1e-12).all()
        assert (alpha - star < 0.05).all()
    total = sum(b - a for intervals in basins.values() for a, b in intervals)
    assert total == pytest.approx(np.diff(step.basin(low, high)).sum(), rel=1e-4)
    axes = step.plot_basin(low, high)
    assert f"{100 * total / (high - low):.3g}% of the launches come to a lossless hop" in axes.get_title()
    labels = axes.get_legend_handles_labels()[1]
    assert sum("to 4.49341" in text or "to 7.72525" in text for text in labels) == 2


def test_the_figure_of_a_map_with_a_cobweb():
    """Corners on the identity line and on the map, in turn; fixed points are marked by whether they attract."""
    step = ReturnMap(Hopper(), inject=0.05)
    axes = step.plot(4.4, 4.7, start=4.55, hops=5, samples=50)
    labels = axes.get_legend_handles_labels()[1]
    assert labels == ["identity", "map", "from 4.55", "stable", "unstable"]
    (web,) = (line for line in axes.lines if line.get_label() == "from 4.55")
    x, y = web.get_data()
    assert (x[::2] == y[::2]).all()
    assert y[1::2] == pytest.approx(step(x[1::2]).next)
    assert len(x) == 11
    marks = [line for line in axes.lines if line.get_label() in ("stable", "unstable")]
    assert sorted(float(mark.get_xdata()[0]) for mark in marks) == [p.alpha for p in step.fixed_points(4.4, 4.7)]


def test_the_figure_of_a_map_without_next_launches():
    axes = ReturnMap(Hopper(damping=0.5)).plot(2.2, 2.6, samples=50)
    assert not np.isfinite(axes.lines[1].get_ydata()).any()
    assert axes.get_ylim()[0] < 2.2


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"low": "a"}, "low = 'a' is not a finite number"),
        ({"low": 6.0}, "0 < low < high"),
        ({"samples": 1}, "samples = 1"),
        ({"hops": -2}, "hops = -2"),
        ({"start": -1.0}, "launch speeds are above 0"),
    ],
)
def test_figures_that_cannot_be_meant(asked, words):
    step = ReturnMap(Hopper())
    with pytest.raises(InputError, match=words):
        step.plot(**{"low": 4, "high": 5} | asked)
    if "start" not in asked:
        with pytest.raises(InputError, match=words):
            step.plot_basin(**{"low": 4, "high": 5} | asked)
