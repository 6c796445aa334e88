"""Figures of return maps: cobwebs, fixed points, basins, and what cannot be drawn."""

from dataclasses import replace

import numpy as np
import pytest
from legibility import faults
from looks import check_looks

from orbits import InputError, ReturnMap, find
from orbits.continuation import End
from orbits.returns import Bifurcation, BifurcationDiagram, Branch
from problems import Hopper, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8)


@pytest.mark.slow
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
    check_looks("map with a cobweb", axes.figure)
    check_looks("map of a leg", ReturnMap(LEG).plot(0.3, 0.8, samples=50, start=0.7, hops=50).figure)
    check_looks("hops", step(np.linspace(4.4, 4.7, 20)).plot().figure)


def test_the_figure_of_basins():
    """Stretches of launches, the total of which is stated; and where there are none."""
    step = ReturnMap(LEG)
    star = find(LEG).alpha
    axes = step.plot_basin(0.99 * star, 1.02 * star, samples=200)
    (intervals,) = step.basins(0.99 * star, 1.02 * star, samples=200).values()
    total = sum(b - a for a, b in intervals)
    assert axes.get_title() == (
        f"at least {100 * total / (0.03 * star):.3g}% come to a lossless hop: {total:.6g} of {0.03 * star:.6g} m/s"
    )
    check_looks("basins", axes.figure)
    none = step.plot_basin(0.3, 0.4, samples=50)
    assert none.get_title() == "no launch here comes to a lossless hop"


def test_the_figure_of_bifurcations():
    """Branches by stability, each named once, with events of all kinds and the launches that are visited."""
    ends, values = (End("reached", ""),) * 2, np.linspace(0.0, 0.4, 5)
    lower, upper = (4.0 + side * np.sqrt(values[2:] - 0.1) for side in (-1, 1))
    branches = (
        Branch(1, values, 4.0 + values[:, None] ** 2, np.array([0.5, 0.8, -1.2, -1.5, -2.0]), ends),
        Branch(2, values[2:], np.column_stack([lower, upper]), np.array([0.9, 0.5, 0.1]), ends),
        Branch(1, values, 5.0 - values[:, None], np.full(5, np.nan), ends),
    )
    kinds = enumerate(("flip", "fold", "branch point", "border collision"))
    events = [Bifurcation(kind, values[i], (4.0 + values[i] ** 2,) * (1 + i % 2)) for i, kind in kinds]
    visits = np.column_stack([np.repeat(values, 3), 4.5 + 0.1 * np.arange(15)])
    machine = Hopper().describe()
    diagram = BifurcationDiagram(
        "inject", (0.0, 0.4), (3.0, 6.0), machine, branches, (*events, events[0]), visits, {"alpha": "m/s"}
    )
    axes = diagram.plot()
    words = [f"{name}, {stability}" for name, stability in (
        ("fixed points", "stable"), ("fixed points", "unstable"), ("period two", "stable"),
        ("fixed points", "stability unknown"),
    )]  # fmt: skip
    kinds = ["flip", "fold", "branch point", "border collision"]
    assert axes.get_legend_handles_labels()[1] == ["visited in the long run", *words, *kinds]
    assert faults(axes.figure) == []
    check_looks("bifurcations", axes.figure)
    bare = replace(diagram, branches=branches[:1], events=(), visits=np.zeros((0, 2))).plot()
    assert bare.get_ylim() == pytest.approx((4.0 - 0.05 * 0.16, 4.16 + 0.05 * 0.16))
    with pytest.raises(InputError, match="nothing to draw"):
        replace(diagram, branches=(), visits=np.zeros((0, 2))).plot()


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"low": "a"}, "low = 'a' is not a finite number"),
        ({"low": 6.0}, "0 < low < high must hold"),
        ({"samples": 1}, "samples = 1"),
        ({"hops": -2}, "hops = -2"),
        ({"start": -1.0}, "launch speeds must be above 0"),
    ],
)
def test_figures_that_cannot_be_meant(asked, words):
    step = ReturnMap(Hopper())
    with pytest.raises(InputError, match=words):
        step.plot(**{"low": 4, "high": 5} | asked)
    if "start" not in asked:
        with pytest.raises(InputError, match=words):
            step.plot_basin(**{"low": 4, "high": 5} | asked)
