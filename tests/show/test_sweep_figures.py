"""Figures of sweeps and diagrams can be read: titles, names, units, legends that name what is drawn."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from legibility import faults, smallest_text
from looks import check_looks

from orbits import InputError, existence, sweep
from orbits.show.diagram_cells import cells_of_diagram
from orbits.sweeps.boundaries import Boundaries
from orbits.sweeps.boundary_curves import BoundaryCurve
from problems import Hopper, hopper_in_si

NOTEBOOK, SMALLEST = 400, 7.0  # pixels: the width of a figure in a narrow notebook, and its smallest type there
HOPPER = Hopper("cubic", rest_length=9.0)
LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)
THREE = {"k": (4000.0, 16000.0), "b": (1e6, 4e6), "body_mass": (40.0, 80.0)}
FOUR = {**THREE, "b": (1e4, 4e6, "log"), "surface_gravity": (1.6, 10.0)}
TWO = {"beta": (-0.02, 0.3), "mass_ratio": (0.1, 10.0, "log")}


@cache
def diagram(both_ways: bool):
    return existence(Hopper("cubic"), "beta", (-0.02, 0.1), "rest_length", (6, 20), samples=6, both_ways=both_ways)


FIGURES = {
    "over one": lambda: sweep(HOPPER, {"beta": (-0.02, 1.0)}, 40, seed=1).plot(),
    "over one, in SI": lambda: sweep(LEG, {"k": (4000.0, 16000.0)}, 40, seed=1).plot(),
    "over one, families": lambda: sweep(HOPPER, {"beta": (-0.02, 1.0)}, 64, family=(1, 2, 3), seed=1).plot(),
    "surface of points": lambda: sweep(HOPPER, TWO, 128, seed=1).plot(),
    "surface on a grid": lambda: sweep(HOPPER, TWO, (12, 10), sampling="grid").plot(),
    "matrix": lambda: sweep(LEG, THREE, 64, seed=1).plot(),
    "matrix of four": lambda: sweep(LEG, FOUR, 64, seed=1).plot(),
    "existence": lambda: diagram(False).plot(),
    "existence, both ways": lambda: diagram(True).plot(),
    "existence, coloured": lambda: diagram(True).plot("alpha"),
}


@pytest.mark.parametrize("kind", FIGURES)
@pytest.mark.slow
def test_figures_can_be_read(kind):
    axes = FIGURES[kind]()
    assert faults(axes.figure) == []
    assert smallest_text(axes.figure, NOTEBOOK) >= SMALLEST
    assert "hopper, family 1" in (axes.get_title() or axes.figure.get_suptitle())
    check_looks(f"sweep: {kind}", axes.figure)


def names(axes) -> set[str]:
    return {text.get_text() for text in axes.get_legend().get_texts()}


def test_legends_name_only_what_is_there():
    motions = {"beta": (0.1, 1.0)}
    assert names(sweep(HOPPER, motions, 8, seed=1).plot()) == {"motions"}
    assert sweep(HOPPER, motions | {"mass_ratio": (0.5, 2.0)}, 8, seed=1).plot().get_legend() is None
    without = sweep(HOPPER, {"beta": (-0.02, -0.011)}, 8, seed=1)
    assert set(without["status"]) == {"no orbit"}
    assert names(without.plot()) == {"no orbits"}
    several = sweep(HOPPER, motions | {"mass_ratio": (0.5, 2.0), "rest_length": (8.0, 9.0)}, 2, seed=1)
    with pytest.raises(InputError, match="over 3 parameters needs a figure of its own"):
        several.plot(axes=without.plot())


@pytest.mark.slow
@pytest.mark.parametrize("both_ways", [False, True])
def test_edges_are_lines(both_ways):
    """Every edge of a diagram is one collection of lines, located or not, and nothing is marked by circles."""
    axes = diagram(both_ways).plot()
    assert axes.get_title() == "hopper, family 1\nspring r + β·r³, mass ratio = 1"
    assert len(axes.lines) == 0
    edges = {"edge of the orbits", "edge of the motions"}
    assert names(axes) == edges | {"motions", "no motions", "no orbits"}
    assert edges == {each.get_label() for each in axes.collections if type(each).__name__ == "LineCollection"}
    assert names(diagram(both_ways).plot("alpha")) == edges | {"no orbits"}


def test_curves_that_meet_in_a_cell_are_joined_where_they_meet():
    """Orbits end at x = 0.2. They are motions right of x = 0.5 and of x = 0.5 + 2 (0.7 - y)^2, which ends there."""
    y, low = np.linspace(1, 0, 33), np.linspace(0.2, 0.7, 33)
    curves = (
        BoundaryCurve("fold in x", (0.2,) * 33, tuple(y), ""),
        BoundaryCurve("collapse", (0.5,) * 33, tuple(y), ""),
        BoundaryCurve("masses touch", tuple(0.5 + 2 * (0.7 - low) ** 2), tuple(low), ""),
    )
    nodes, points = np.array([[0, 0], [1, 0], [0, 1], [0, 1]]), np.array([[0.2, 0], [1, 0.2], [0.2, 1], [0.5, 1]])
    no, other, motion = "no orbit", "inadmissible", "certified"
    statuses, all_of = np.array([[no, other], [other, motion], [no, other], [other, motion]]), np.ones(4, bool)
    found = Boundaries(nodes[:, 0] == 0, all_of, all_of, nodes, points, statuses)
    grid, corners = {"x": np.array([0.0, 0.0, 1.0, 1.0])}, np.array([[no, other], [no, motion]])
    cell = SimpleNamespace(
        along="x", grid=grid, values=(0.0, 1.0), statuses=corners, curves=curves, boundaries=found
    )  # fmt: skip
    ((polygons, edges),) = cells_of_diagram(cell)
    areas = dict.fromkeys((no, other, motion), 0.0)
    for status, polygon in polygons:
        x, up = np.array(polygon).T
        areas[status] += 0.5 * abs(x @ np.roll(up, -1) - up @ np.roll(x, -1))
    right = 0.15 + 0.25 - 2 / 3 * 0.5**3
    assert areas == pytest.approx({no: 0.2, other: 0.8 - right, motion: right}, abs=1e-3)
    for kind, edge in edges:
        x, up = np.array(edge).T
        exact = 0.2 if kind == "edge of the orbits" else np.where(up > 0.7, 0.5, 0.5 + 2 * (0.7 - up) ** 2)
        assert x == pytest.approx(exact + 0 * x, abs=2e-3)


@pytest.mark.parametrize(
    "over",
    [
        {"beta": (-0.02, 0.1)},
        {"beta": (-0.02, 0.1), "mass_ratio": (0.5, 2.0)},
        {"beta": (0.0, 0.1), "mass_ratio": (0.5, 2.0), "rest_length": (6.0, 9.0)},
    ],
)
@pytest.mark.parametrize("sampling", ["grid", "sobol"])
def test_figures(over, sampling, tmp_path):
    from orbits.show import save_figure

    found = sweep(Hopper("cubic", rest_length=8.0), over, 5 if sampling == "grid" else 30, sampling=sampling)
    axes = found.plot("flight_time")
    save_figure(np.ravel(axes)[0], tmp_path / "sweep.png")
    assert (tmp_path / "sweep.png").stat().st_size > 5000
