"""The figures of a sweep on a page: its members, and which of many are shown."""

from dataclasses import replace

import numpy as np
import pytest

from orbits import InputError, sweep
from problems import Hopper

pytest.importorskip("bokeh")

from orbits.show.pages.bokeh_figures import PAGE
from orbits.show.pages.sweep_view import sweep_figures

pytestmark = pytest.mark.extra("bokeh")


@pytest.mark.slow
def test_members_of_a_sweep_are_shown():
    swept = sweep(Hopper("cubic", rest_length=30), {"beta": [-0.05, -0.008, 0.0, 0.1]}, family=[1, 2])
    (figure,), told = sweep_figures(swept)
    (marks,) = figure.renderers
    data = marks.data_source.data
    known = np.isfinite(swept["alpha"])
    assert np.asarray(data["quantity"]).tolist() == swept["alpha"][known].tolist()
    assert np.asarray(data["p0"]).tolist() == swept["beta"][known].tolist()
    assert set(data["family"]) == {"family 1", "family 2"}
    assert told == f"{known.sum()} of 8 members have alpha."
    with pytest.raises(InputError, match="'status' is not a column of numbers"):
        sweep_figures(swept, "status")
    plane = sweep(Hopper("cubic"), {"beta": [-0.05, 0.1], "mass_ratio": [0.5, 1.0]}, quantities=["stroke"])
    ((figure,), _) = sweep_figures(plane, "stroke")
    crosses, marks = figure.renderers
    assert len(crosses.data_source.data["p0"]) == 2
    assert len(marks.data_source.data["p0"]) == 2
    assert sweep_figures(sweep(Hopper("cubic", rest_length=30), {"beta": [-0.5]})) == ([], "0 of 1 members have alpha.")
    both = sweep(Hopper("cubic"), {"beta": [0.0, 0.1], "mass_ratio": [0.5, 1.0]}, family=[1, 2])
    with pytest.raises(InputError, match="shows one family"):
        sweep_figures(both)
    assert len(sweep_figures(both.of_family(2))[0]) == 1


def test_of_a_large_sweep_some_members_are_shown():
    swept = sweep(Hopper("cubic", rest_length=30), {"beta": [0.0, 0.1]})
    count = 2 * PAGE.members + 2
    columns = {name: np.resize(column, count) for name, column in swept.columns.items()}
    (figure,), told = sweep_figures(replace(swept, index=np.arange(count), columns=columns))
    assert told.startswith("One of 3 members is shown: ")
    assert len(figure.renderers[0].data_source.data["p0"]) <= PAGE.members
