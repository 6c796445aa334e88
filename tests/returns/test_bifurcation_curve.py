"""A curve of bifurcations as a result: table, file, values between points, and picture."""

import numpy as np
import pytest

from orbits import BifurcationCurve
from orbits.continuation import End
from orbits.model import machine_in_words
from orbits.returns.bifurcation_curve import PlaceOnCurve
from problems import Hopper, hopper_in_si

VALUES = np.array([[0.1, 1.0], [0.2, 2.0], [0.25, 2.5], [0.2, 1.5]])
ALPHAS = np.array([[4.6, 4.5], [4.7, 4.6], [4.8, 4.6], [4.9, 4.6]])


def curve(machine=None, units=None) -> BifurcationCurve:
    events = (PlaceOnCurve("turn", (0.25, 2.5), (4.8, 4.6)), PlaceOnCurve("value", (0.2, 2.0), (4.7, 4.6)))
    own = machine_in_words(machine or Hopper()), (1, 2), VALUES, ALPHAS, events, End("reached", "mass_ratio = 1.5")
    return BifurcationCurve("fold", "inject", "mass_ratio", *own, units=units or {})


def test_values_at_a_value_of_the_second_parameter():
    """Points of the curve, and straight lines between them, on both sides of the turn."""
    assert curve().at(1.5) == pytest.approx([0.2, 0.15])
    assert curve().at(2.0) == pytest.approx([0.2, 0.225])
    assert curve().at(3.0) == []


def test_table_text_and_file(tmp_path):
    found = curve()
    assert [*found.table()] == ["inject", "mass_ratio", "alpha", "alpha 2"]
    text = str(found)
    assert "fold of hops of period two" in text
    assert "turn" in text
    assert "end: mass_ratio = 1.5" in text
    again = BifurcationCurve.load(found.save(tmp_path / "curve.json"))
    assert str(again) == text
    assert np.array_equal(again.values, VALUES)
    assert again.events == found.events
    assert found.save(tmp_path / "curve.csv").read_text().count("\n") == 5
    assert len(found) == 4


def test_units():
    leg = hopper_in_si(2.0, 2.0, stiffness=100.0)
    found = curve(leg, units={"alpha": "m/s", "inject": "m/s"})
    assert found.heading("alpha 2") == "alpha 2 (m/s)"
    assert found.heading("mass_ratio") == "mass_ratio"
