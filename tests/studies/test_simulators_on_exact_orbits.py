"""Simulators on the exact orbits: how they read the cases, how errors are measured, and the page's tables."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from studies.exact_orbits import by_scipy, simulators, simulators_figure
from studies.exact_orbits.automaton import Automaton, Found
from studies.exact_orbits.bodies import bodies_of
from studies.exact_orbits.reader import Case

FOLDER = Path(simulators.__file__).parent
PAGE = FOLDER.parents[1] / "studies" / "docs" / "contact_models.md"


def case(name):
    return Case(FOLDER / "cases" / f"{name}.json")


def test_scipy_converges_and_its_landing_by_the_third_root():
    """A lossless landing is a triple zero, so that its time has the third root of the error of the states."""
    hop, errors, times = case("linear_hop"), [], []
    ready = by_scipy.prepared(hop, "DOP853")
    for tolerance in (1e-5, 1e-9, 1e-13):
        found = ready(tolerance)()
        errors.append(simulators.error_of(hop, found))
        times.append(abs(found.last[2] - float(hop["events"][-1]["time"])))
    assert errors[0] < 1e-3
    assert errors[2] < 1e-11
    slope = np.polyfit(np.log(errors), np.log(times), 1)[0]
    assert slope == pytest.approx(1 / 3, abs=0.1)


def test_the_error_is_scaled_and_away_from_jumps():
    ball = case("bouncing_ball")
    states = [dict(each["state"]) for each in ball["samples"]]
    compared = simulators.compared_samples(ball)
    first = ball["samples"][2]["time"] - ball["events"][0]["time"]
    assert len(compared) < 20
    assert 2 in compared
    assert first > 0.12712  # a hundredth of the duration
    assert simulators.error_of(ball, Found(states)) == 0
    states[2]["v"] += math.sqrt(2) / 100  # its size is the speed of the first impact
    assert simulators.error_of(ball, Found(states)) == pytest.approx(0.01)
    left_out = next(i for i in range(20) if i not in compared)
    states[left_out]["v"] += 1.0
    assert simulators.error_of(ball, Found(states)) == pytest.approx(0.01)


def test_guards_at_zero_have_to_rise_first():
    hop = case("linear_hop")
    landing = Automaton(hop).guard(hop["modes"]["flight"]["events"][0])
    assert landing({"y2": 0.0}) < 0 < landing({"y2": 1e-15})


def test_bodies_start_with_the_states_of_a_case_and_return_them():
    count = 0
    for path in sorted((FOLDER / "cases").glob("*.json")):
        stated = Case(path)
        try:
            bodies = bodies_of(stated)
        except NotImplementedError:  # with the reason in few words, which the page shows
            continue
        start = {each: float(x) for each, x in stated.at(stated["start"]["state"]).items()}
        places, speeds = ({name: pair[i] for name, pair in bodies.start(start).items()} for i in (0, 1))
        assert places.keys() == set(bodies.joints), path.stem
        found = bodies.state(places, speeds, 0)
        assert {each: found[each] for each in start} == pytest.approx(start, abs=1e-12), path.stem
        count += 1
    assert count > 15


@pytest.mark.slow
@pytest.mark.extra("mujoco", "pydrake", "heyoka")
def test_a_quick_run(tmp_path):
    """Every simulator lands a lossless hop; the bounces of a ball cost MuJoCo its accuracy."""
    for package in ("mujoco", "pydrake", "heyoka"):
        pytest.importorskip(package)
    results = simulators.main([], tmp_path / "run.json", quick=True)
    assert json.loads((tmp_path / "run.json").read_text()) == results
    least = {
        (row["case"], row["simulator"]): simulators_figure.best(
            simulators_figure.rows_of(results, case=row["case"], simulator=row["simulator"])
        )
        for row in results["rows"]
    }
    bounds = {"SciPy": 1e-8, "heyoka": 1e-8, "MuJoCo": 1e-6, "Drake": 5e-3, "here": 1e-13}
    for simulator, bound in bounds.items():
        assert least["linear_hop", simulator]["error"] < bound, simulator
    assert least["bouncing_ball", "SciPy"]["error"] < 1e-12
    assert least["bouncing_ball", "MuJoCo"]["error"] > 1e-3
    assert least["bouncing_ball", "Drake"] is None  # it has no coefficient of restitution
    rows = simulators_figure.rows_of(results, case="linear_hop", simulator="MuJoCo", way="RK4")
    assert simulators_figure.order(rows) == pytest.approx(2, abs=0.7)


def test_the_page_has_the_tables_of_the_record():
    """Every line of both, and the versions."""
    record = json.loads(simulators_figure.RECORD.read_text(encoding="utf-8"))
    page = PAGE.read_text(encoding="utf-8")
    for line in (*simulators_figure.reach_table(record), *simulators_figure.case_table(record)):
        assert line in page
    for version in record["versions"].values():
        assert version in page


def test_the_figures_are_those_of_the_record(tmp_path):
    record = json.loads(simulators_figure.RECORD.read_text(encoding="utf-8"))
    cases = [name for name in simulators_figure.SHOWN if any(row["case"] == name for row in record["rows"])]
    assert len(cases) == 4
    titles = simulators_figure.titles_of(cases)
    steps = simulators_figure.draw(record, "setting", cases, titles).figure.axes[:4]
    assert [axes.get_title() for axes in steps] == [titles[name] for name in cases]
    assert {"order 1", "order 2"} <= {line.get_label() for line in steps[1].lines}
    assert all(len(axes.lines) >= 4 for axes in steps)
