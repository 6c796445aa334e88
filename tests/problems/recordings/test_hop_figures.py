"""Figures of fitted hops."""

import pytest
from legibility import faults

from orbits import InputError
from tests.recorded_hops import fit_of_heights


def test_draws_record_motion_and_residuals():
    axes = fit_of_heights().plot()
    panels = axes.figure.axes
    assert [each.get_ylabel() for each in panels] == ["body height (m)", "foot height (m)", "residual / deviation"]
    legend = [text.get_text() for text in panels[-1].get_legend().get_texts()]
    assert legend[:2] == ["recorded", "fitted motion"]
    assert not faults(axes.figure)
    assert all(len(panel.patches) == 3 for panel in panels)  # the contacts


def test_refuses_a_record_that_there_is_not():
    with pytest.raises(InputError, match="record = 2: the fit has 1"):
        fit_of_heights().plot(record=2)
