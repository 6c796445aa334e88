"""The figure of a family on a page: motions, events, its end, and the hop that is shown."""

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

from orbits import InputError

pytest.importorskip("bokeh")

from orbits.show import FamilyData, FamilyFigure, family_data
from orbits.show.pages.family_view import LABELS

pytestmark = pytest.mark.extra("bokeh")


def test_a_family_has_its_motions_events_and_end(softening_family):
    data = family_data(softening_family)
    known = dict(zip(data.events["kind"], data.events["value"].tolist(), strict=True))
    assert known["fold"] == pytest.approx(-0.0106952149164040, rel=1e-9)  # the reference value
    assert [kind for kind in known if kind.startswith("end")] == ["end: escaped"]
    assert "end: escaped" in data.points["note"][-1]
    assert re.search(r"tends to \S+ \(about \de-\d+ off\)$", data.points["note"][-1])
    # Motions end where the contact collapses; there both lines meet.
    collapse = data.value.tolist().index(known["collapse"])
    assert np.isfinite(data.motions[: collapse + 1]).all()
    assert np.isnan(data.motions[collapse + 1 :]).all()
    assert np.isfinite(data.others[collapse:]).all()
    assert data.points["quantity"].tolist() == [point.alpha for point, _ in softening_family.in_order()]
    assert family_data(softening_family, "flight_time").labels == ("beta", "flight time")
    with pytest.raises(InputError, match="unknown quantity 'weight'"):
        family_data(softening_family, "weight")
    assert pickle.loads(pickle.dumps(data)).labels == data.labels


def test_events_are_named_where_they_are(softening_family):
    """Events that are close together have one label; the legend names the lines alone."""
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


def test_labels_of_events_hide_no_curve():
    """A curve that rises and falls steeply beside its end, which lies neither above nor below all of it."""
    value = np.linspace(0.0, 1.0, 400)
    quantity = np.interp(value, [0.0, 0.03, 0.2, 1.0], [0.88, 1.0, 0.5, 0.0])
    points = {"value": value, "quantity": quantity, "alpha": [""] * 400, "note": [""] * 400}
    events = {"value": [0.0, 0.6], "quantity": [0.88, 0.25], "kind": ["end: reached", "fold"]}
    figure = FamilyFigure()
    figure.show(FamilyData(value, quantity, np.full(400, np.nan), points, events, ("beta", "alpha")))
    labels = next(r.data_source.data for r in figure.figure.renderers if "label" in r.data_source.data)
    for i, label in enumerate(labels["label"]):
        for wide, high in ((270, 250), (500, 300)):
            x, y = wide * (value - events["value"][i]), high * (events["quantity"][i] - quantity)
            side = np.sign(labels["aside"][i])
            covers = (np.abs(y - labels["below"][i]) < 7) & (side * x > abs(labels["aside"][i]))
            assert not (covers & (side * x < abs(labels["aside"][i]) + 6 * len(label))).any()
