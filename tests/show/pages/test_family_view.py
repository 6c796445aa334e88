"""The figure of a family on a page: motions, events, its end, and the hop that is shown."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from orbits import InputError

pytest.importorskip("bokeh")

from orbits.show.pages.family_view import LABELS, FamilyFigure, family_data

pytestmark = pytest.mark.extra("bokeh")


def test_a_family_has_its_motions_events_and_end(softening_family):
    data = family_data(softening_family)
    known = dict(zip(data.events["kind"], data.events["value"].tolist(), strict=True))
    assert known["fold"] == pytest.approx(-0.0106952149164040, rel=1e-9)  # the reference value
    assert [kind for kind in known if kind.startswith("end")] == ["end: escaped"]
    assert "end: escaped" in data.points["note"][-1]
    assert "tends to" in data.points["note"][-1]
    # Motions end where the contact collapses; there both lines meet.
    collapse = data.value.tolist().index(known["collapse"])
    assert np.isfinite(data.motions[: collapse + 1]).all()
    assert np.isnan(data.motions[collapse + 1 :]).all()
    assert np.isfinite(data.others[collapse:]).all()
    assert data.points["quantity"].tolist() == [point.alpha for point, _ in softening_family.in_order()]
    assert family_data(softening_family, "flight_time").labels == ("beta", "flight time")
    with pytest.raises(InputError, match="no quantity 'weight'"):
        family_data(softening_family, "weight")
    assert pickle.loads(pickle.dumps(data)).labels == data.labels


def test_events_are_named_where_they_are(softening_family):
    """Those that are close together have one label; the legend names the lines alone."""
    figure = FamilyFigure()
    figure.show(family_data(softening_family))
    events = next(r.data_source.data for r in figure.figure.renderers if "label" in r.data_source.data)
    named = dict(zip(events["kind"], events["label"], strict=True))
    words = [LABELS.get(kind, kind) for kind in events["kind"]]
    assert sorted(", ".join(filter(None, named.values())).split(", ")) == sorted(words)
    assert named["end: escaped"] == "goes on without bound"
    data = family_data(softening_family)
    close = {"value": [data.value[0]] * 2, "quantity": [data.points["quantity"][0]] * 2, "kind": ["fold", "collapse"]}
    figure.show(replace(data, events=close))
    events = next(r.data_source.data for r in figure.figure.renderers if "label" in r.data_source.data)
    assert events["label"] == ["fold, collapse", ""]
    (legend,) = figure.figure.legend
    assert [item.label.value for item in legend.items] == ["motions", "no motions", "shown"]


def test_a_familys_figure_marks_the_hop_that_is_shown(softening_family):
    figure = FamilyFigure()
    figure.show(family_data(softening_family))
    figure.mark(0.0, softening_family[0].alpha)
    ring = figure.figure.renderers[-1].data_source
    assert ring.data == {"value": [0.0], "quantity": [softening_family[0].alpha]}
    figure.show(family_data(softening_family, "flight_time"))
    assert ring.data == {"value": [], "quantity": []}
    assert figure.figure.yaxis[0].axis_label == "flight time"
