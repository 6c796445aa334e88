"""Figures of derivatives, indices and distributions show the numbers of their results."""

import numpy as np
import pytest
from legibility import faults
from scipy.integrate import trapezoid
from scipy.stats import norm

from orbits import InputError, sensitivities, sweep, uncertainty
from problems import Hopper, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, stiffness=5000.0, rest_length=0.8)


def test_derivatives_are_a_matrix_of_shares():
    """By dimensions alpha is in proportion to g and to 1/sqrt(k)."""
    found = sensitivities(LEG, 1, ["surface_gravity", "stiffness", "rest_length"], ["alpha", "flight_time"])
    axes = found.plot()
    texts = [text.get_text() for text in axes.texts]
    assert texts == ["1", "-0.5", "0", "0", "-0.5", "0"]
    assert [each.get_text() for each in axes.get_yticklabels()] == ["launch speed α", "flight time"]
    assert not faults(axes.figure)
    with pytest.raises(InputError, match="no derivatives"):
        sensitivities(LEG, 1, [], []).plot()


def test_indices_are_bars_with_intervals():
    found = sweep(LEG, {"stiffness": (4e3, 6e3), "body_mass": (55.0, 60.0)}, 4).sensitivity(samples=16)
    axes = found.plot("flight_time")
    heights = [bar.get_height() for bars in axes.containers if hasattr(bars, "patches") for bar in bars.patches]
    expected = [each[order] for order in ("first", "total") for each in found["flight_time"].values()]
    assert heights == pytest.approx(expected)
    assert "flight time" in axes.get_ylabel().replace("\n", " ")
    assert "foot mass = 3 kg" in axes.get_title()
    assert "body mass" not in axes.get_title()  # it varies
    assert not faults(axes.figure)
    with pytest.raises(InputError, match="no indices of 'stroke'"):
        found.plot("stroke")


def test_a_distribution_has_an_area_of_one():
    found = uncertainty(Hopper("cubic"), {"beta": norm(0.3, 0.01)}, samples=64)
    axes = found.plot()
    assert sum(bar.get_height() * bar.get_width() for bar in axes.patches) == pytest.approx(1)
    (curve,) = (line for line in axes.lines if line.get_label() == "linear")
    assert "β =" not in axes.get_title()  # it varies
    x, y = curve.get_data()
    assert trapezoid(y, x) == pytest.approx(1, abs=0.01)
    assert x[np.argmax(y)] == pytest.approx(found.mean["alpha"], abs=2 * found.linear["alpha"] / 10)
    assert not faults(axes.figure)
    with pytest.raises(InputError, match="has no 'stroke'"):
        found.plot("stroke")
