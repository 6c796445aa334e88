"""Figures that can be read: titles, names, units, legends that name what is drawn, and families with their hops."""

from functools import cache

import numpy as np
import pytest
from families import events
from legibility import faults, smallest_text
from looks import check_looks

from orbits import find, follow, orbit_at, pareto, simulate, starts
from orbits.show import new_axes, plot, spread, thumbnails
from problems import Chain, Hopper, hopper_in_si

NOTEBOOK, SMALLEST = 400, 7.0  # pixels: the width of a figure in a narrow notebook, and its smallest type there
LONG = Hopper("r + 0.1*r**3 + 0.02*r**5 + 0.1*tanh(0.2*r) + 0.1*sinh(0.1*r)", "1/(1 + z/150)**2", rest_length=20)
LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)
SOFTENING = Hopper("cubic", rest_length=30, parameters={"beta": 0.0})


@cache
def softening():
    """A family up to its fold and beyond."""
    return follow(SOFTENING, "beta", -0.02)


def families():
    """Two families in the same axes."""
    axes = None
    for number in (1, 2):
        family = follow(Hopper("tanh", rest_length=30), "b", 0.19, start=0.1, family=number)
        axes = family.plot(axes=axes, label=f"family {number}")
    return axes


def front():
    """A front of three designs."""
    over, limits = {"k": (500.0, 5e4), "b": (0.0, 1e7)}, ["stroke <= 0.25", "centre_of_mass_rise >= 0.1"]
    aims = "-centre_of_mass_rise", "largest_contact_force"
    return pareto(LEG, minimise=aims, over=over, subject_to=limits, family=2, points=3)


def with_thumbnails():
    """A family with small orbits above."""
    family = follow(SOFTENING, "beta", -0.02, at=[-0.005])
    small = [(point, orbit_at(SOFTENING, point, "beta")) for point in plot.spread(family, 5)]
    return plot.thumbnails(family.plot(), family, small)


FIGURES = {
    "orbit": lambda: find(Hopper()).plot(),
    "orbit in SI": lambda: find(LEG).plot(),
    "orbit of a long law": lambda: find(LONG).plot(),
    "orbit of a chain": lambda: find(Chain().mechanism, start=starts(Chain().mechanism, 4.0, 4.0)[0]).plot(),
    "phase portrait": lambda: plot.plot_phase_portrait(find(Hopper())),
    "phase portrait in SI": lambda: plot.plot_phase_portrait(find(LEG)),
    "phase portrait of a long law": lambda: plot.plot_phase_portrait(find(LONG)),
    "family": lambda: softening().plot(),
    "family in SI": lambda: follow(LEG, "body_mass", 80.0).plot(quantity="flight_time"),
    "families": families,
    "thumbnails": with_thumbnails,
    "front": lambda: plot.plot_front(front()),
    "simulation": lambda: simulate(Hopper(restitution=0.3, damping=0.01), 4.6, hops=3).plot(),
    "simulation in SI": lambda: simulate(LEG, 0.9, hops=3).plot(),
    "gap": lambda: plot.plot_gap(simulate(Hopper(), 4.0, hops=2)),
}
# A front is many designs, and the thumbnails are drawn on what the family is.
LONG_FIGURES = ("front", "thumbnails")


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow if kind in LONG_FIGURES else ()) for kind in FIGURES]
)
@pytest.mark.slow
def test_figures_can_be_read(kind):
    """No text leaves a figure or meets another, legends name what is drawn, and the type is large enough."""
    axes = FIGURES[kind]()
    assert faults(axes.figure) == []
    assert smallest_text(axes.figure, NOTEBOOK) >= SMALLEST
    assert axes.get_title() or axes.figure.get_suptitle()
    names = axes.get_xlabel() + axes.get_ylabel()
    assert ("SI" in kind or kind == "front") == any(unit in names for unit in ("(s)", "(m)", "(m/s)", "(kg)"))
    check_looks(kind, axes.figure)


def test_faults_are_found():
    """The test of figures sees each fault where it is."""
    axes = new_axes()
    axes.plot([0, 1], [0, 1], label="curve")
    axes.plot([], [], label="nothing")
    axes.legend(loc="lower left")
    axes.text(0.5, 0.5, "one")
    axes.text(0.5, 0.5, "another")
    axes.text(1.2, 0.5, "outside", in_layout=False)
    axes.text(0.1, 0.9, "small", fontsize=5)
    axes.set_ylabel("height")
    found = "\n".join(faults(axes.figure))
    words = ["nothing of 'nothing'", "'one' meets 'another'", "'outside' leaves", "'curve' runs under", "x axis"]
    words += ["'one' lies on a curve", "'small' has 5.0 points", "in a column: 'outside' leaves"]
    assert [each for each in words if each not in found] == []
    assert smallest_text(axes.figure, 1000) == pytest.approx(5 / 72 * 1000 / axes.figure.get_figwidth())


def test_plots(softening_family):
    axes = softening_family.plot(label="first")
    follow(Hopper("cubic"), "beta", -0.003, 0.0, 2).plot(axes=axes, label="second")
    solid, dashed, *_ = [line for line in axes.lines if len(line.get_xdata()) > 1]
    assert np.nanmin(solid.get_xdata()[~np.isnan(solid.get_ydata())]) == events(softening_family, "collapse")[0].value
    assert np.nanmax(dashed.get_ydata()) == softening_family[-1].alpha
    assert {text.get_text() for text in axes.get_legend().get_texts()} == {
        "first",
        "second",
        "collapse",
        "fold",
        "motions",
        "no motions",
        "goes on without bound",
        "end of the range",
    }


def test_thumbnails_are_spread_along_the_curve_and_leave_room_for_the_labels(softening_family):
    points = spread(softening_family, 6)
    assert (points[0], points[-1], len(points)) == (softening_family[0], softening_family[-1], 6)
    machine = Hopper("cubic", rest_length=30.0)
    axes = thumbnails(
        softening_family.plot(), softening_family, [(point, orbit_at(machine, point, "beta")) for point in points]
    )
    axes.figure.draw_without_rendering()
    frame = axes.figure.bbox
    for text in (axes.yaxis.label, axes.xaxis.label, axes.title):
        box = text.get_window_extent()
        assert min(box.x0, box.y0, frame.x1 - box.x1, frame.y1 - box.y1) >= 0
