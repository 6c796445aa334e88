"""Bifurcation diagrams as their reader holds them: stretches, launches at a value, documents and figures."""

import json

import numpy as np
import pytest
from return_maps import of_the_paper

from orbits import InputError
from orbits.continuation import End
from orbits.returns import BifurcationDiagram, Branch


def test_a_branch_without_multipliers_is_not_called_unstable(tmp_path):
    end = End("reached", "")
    values, slopes = np.arange(6.0), np.array([0.5, np.nan, 0.6, np.nan, np.nan, 2.0])
    branch = Branch(1, values, values[:, None] + 5, slopes, (end, end))
    assert branch.stable == [True, None, True, None, None, False]
    assert branch.stretches() == [(0.0, 3.0, True), (3.0, 4.0, None), (4.0, 5.0, False)]
    machine = {"machine": "known", "spring": "r", "gravity": "1"}
    diagram = BifurcationDiagram("v", (0.0, 5.0), (4.0, 11.0), machine, (branch,), ())
    document = json.loads(diagram.save(tmp_path / "diagram.json").read_text())
    assert document["branches"][0]["stable"] == [True, None, True, None, None, False]
    table = diagram.save(tmp_path / "diagram.csv").read_text().splitlines()
    assert table[2] == "0,1,1,6,,,"
    assert "v = 3 to 4: stability unknown" in str(diagram)
    labels = diagram.plot().get_legend_handles_labels()[1]
    assert labels == [f"fixed points, {each}" for each in ("stable", "stability unknown", "unstable")]


def test_periodic_launches_at_the_ends_and_at_points_of_a_branch():
    end = End("reached", "")
    values = np.array([0.0, 1.0, 2.0])
    branch = Branch(1, values, values[:, None] + 5, values / 2, (end, end))
    back = Branch(1, values[::-1], values[::-1, None] + 8, values[::-1] / 2, (end, end))
    diagram = BifurcationDiagram("v", (0.0, 2.0), (4.0, 11.0), {}, (branch, back), ())
    for value in (0.0, 0.25, 1.0, 2.0):
        assert diagram.periodic(value) == [(1, value + 5, value / 2), (1, value + 8, value / 2)]
    assert diagram.periodic(2.1) == []
    around, closed = np.array([0.0, 1.0, 0.0]), End("closed", "")
    branch = Branch(1, around, np.array([[5.0], [6.0], [5.0]]), around, (closed, closed))
    assert BifurcationDiagram("v", (0.0, 1.0), (4.0, 7.0), {}, (branch,), ()).periodic(0.0) == [(1, 5.0, 0.0)]


def test_the_diagram_as_document_table_and_figure(tmp_path):
    diagram = of_the_paper()
    document = json.loads(diagram.save(tmp_path / "diagram.json").read_text())
    assert [event["kind"] for event in document["events"]] == ["fold", "flip", "flip", "border collision"]
    assert len(document["branches"][1]["alpha"][0]) == 2
    table = diagram.save(tmp_path / "diagram.csv").read_text().splitlines()
    assert table[0] == "branch,period,inject,alpha,other alpha,multiplier,stable"
    assert len(table) == 1 + sum(map(len, diagram.branches))
    axes = diagram.plot()
    labels = axes.get_legend_handles_labels()[1]
    assert {"fixed points, stable", "fixed points, unstable", "period two, stable", "fold", "flip"} <= set(labels)
    assert len(labels) == len(set(labels))
    assert f"{'flip':<24}inject = 0.0715873841" in str(diagram)
    assert "\n" not in repr(diagram)
    with pytest.raises(InputError, match="must end in"):
        diagram.save(tmp_path / "diagram.txt")
