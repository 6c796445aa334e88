"""The figure of a law on a page: where the hop uses it, and where it ends."""

import numpy as np
import pytest

from orbits import find
from problems import Hopper, knee_hopper

pytest.importorskip("bokeh")

from bokeh.models import HoverTool

from orbits.show import LawFigure, hop_data, law_data

pytestmark = pytest.mark.extra("bokeh")
G = 9.80665


def test_a_law_is_shown_where_the_hop_uses_it(cubic_hop, leg_hop):
    data = law_data(cubic_hop.source, cubic_hop)
    assert data.force == pytest.approx(data.extension + 0.3 * data.extension**3)
    assert data.liftoff == pytest.approx((cubic_hop.liftoff_extension, 1.0))
    heights = hop_data(cubic_hop).height
    used = heights[0] - 8 - heights[1]
    assert data.used == pytest.approx((used.min(), used.max()), rel=1e-3)
    stiff = law_data(leg_hop.source, leg_hop)
    assert stiff.force == pytest.approx(20_000 * stiff.extension, abs=1e-9)
    assert stiff.liftoff[1] == pytest.approx(5 * G)
    assert stiff.labels == ("extension (m)", "force (N)")
    LawFigure().show(stiff)


def test_a_law_in_pieces_ends_where_it_is_stated(tmp_path):
    points = np.linspace(-9, 9, 61)
    table = "\n".join(["r,force", *(f"{r},{np.sinh(r / 3) * 3}" for r in points)])
    (tmp_path / "spring.csv").write_text(table)
    orbit = find(Hopper(f"table:{tmp_path / 'spring.csv'}", rest_length=30))
    data = law_data(orbit.source, orbit)
    low, high = data.used
    assert low - 0.35 * (high - low) < -9 <= data.extension[0] == pytest.approx(-9, rel=0.02)
    assert data.force == pytest.approx(3 * np.sinh(data.extension / 3), rel=1e-3, abs=1e-3)


def test_a_knees_spring_has_a_torque():
    orbit = find(knee_hopper(stiffness=600.0, rest_angle=2.6))
    data = law_data(orbit.source, orbit)
    assert data.labels == ("angle (rad)", "torque (N m)")
    assert data.force == pytest.approx(600 * (data.extension - 2.6), abs=1e-6)
    figure = LawFigure()
    figure.show(data)
    assert figure.figure.xaxis[0].axis_label == "angle (rad)"
    (shown,) = figure.figure.select(type=HoverTool)
    assert "angle" in shown.tooltips
    assert "torque" in shown.tooltips
