"""Diagrams in two parameters, against the folds and events of single families."""

import json
from functools import cache

import numpy as np
import pytest
from conftest import PROVED, middle
from scipy.optimize import brentq

from orbits import InputError, existence, find, find_all, follow, follow_fold
from orbits.design.designs_at_once import CONTINUED_STATUSES
from orbits.show.sweep_figures import STYLES
from problems import Chain, Hopper, rocking_block

MACHINE = Hopper("r + beta*r**3 + delta*r**5", rest_length=30.0, parameters={"beta": 0.0, "delta": 0.0})
BETWEEN, DELTAS = (-0.02, 0.01), [-4e-5, 0.0, 3e-5]
FOLD = middle(PROVED["fold"]["beta"])  # of the cubic spring
TO_ACCURACY = 1e-6 * (BETWEEN[1] - BETWEEN[0])


@pytest.fixture(scope="module")
def diagram():
    return existence(MACHINE, "beta", BETWEEN, "delta", DELTAS, samples=9, quantities=["stroke"])


@cache
def events():
    """The events of the family of the machine, to rounding."""
    return follow(MACHINE, "beta", -0.02, most=60).events


def event_of(kind: str, found=None):
    """The point of an event of a family; of that of the machine by default."""
    return next(event.point for event in found or events() if event.kind == kind)


@pytest.mark.slow
def test_the_edges_are_folds_and_the_collapse(diagram):
    """Without the fifth power: orbits from the fold on, motions from where the contact no longer collapses."""
    fold, collapse = FOLD, event_of("collapse").value
    (low, middle, motion), (begin, high, other) = diagram.stretches(1)
    assert (motion, other) == (False, True)
    assert low == pytest.approx(fold, abs=TO_ACCURACY)
    assert begin == middle == pytest.approx(collapse, abs=TO_ACCURACY)
    assert high == 0.01
    assert diagram.motions(1) == [(begin, 0.01)]
    assert [stretch.status for stretch in diagram.row(1)] == ["no orbit", "inadmissible", "certified"]
    with pytest.raises(InputError, match="it must be a number of rows, from 0 to"):
        diagram.row(-1)


def test_boundaries_lie_on_curves_of_events(diagram):
    """The edges of the middle row are the fold and the collapse, far more exactly than by bisection."""
    assert (diagram.boundaries.exact == diagram.boundaries.in_row).all()
    assert {curve.event for curve in diagram.curves} >= {"fold in beta", "collapse"}
    (low, begin, _), _ = diagram.stretches(1)
    assert low == pytest.approx(FOLD, abs=1e-13)
    assert begin == pytest.approx(event_of("collapse").value, abs=1e-13)
    assert diagram.rests_on.startswith("27 of 27 members were searched; ")
    assert diagram.rests_on.endswith("0 between members")


def test_logarithmic_rows():
    diagram = existence(Hopper("cubic"), "beta", (1e-3, 10.0, "log"), "mass_ratio", (0.1, 10.0, "log"), samples=3)
    assert diagram.grid["beta"].reshape(3, 3)[:, 0] == pytest.approx([1e-3, 0.1, 10.0])
    assert diagram.values == pytest.approx((0.1, 1.0, 10.0))
    assert (diagram.plot().get_xscale(), diagram.plot().get_yscale()) == ("log", "log")


def test_plot(diagram):
    axes = diagram.plot()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("β", "δ")
    shown = {"motions", "no motions", "no orbits", "edge of the motions", "edge of the orbits"}
    assert {text.get_text() for text in axes.get_legend().get_texts()} == shown
    coloured = diagram.plot("stroke")
    assert coloured.figure.axes[1].get_ylabel() == "stroke"
    with pytest.raises(InputError, match="no quantity 'clearance'; it has alpha"):
        diagram.plot("clearance")


def test_the_edges_in_the_figure_are_the_curves(diagram):
    """Between the rows, too: the fold by its own curve, which the line between the points on the rows misses."""
    curve, size = follow_fold(MACHINE, event_of("fold"), "beta", "delta", -4e-5, at=[-2e-5]), np.array([0.03, 7e-5])
    exact = next(np.array([point.also["beta"], point.value]) for point in curve.points if point.value == -2e-5) / size
    rows = np.array([(diagram.stretches(row)[0][0], DELTAS[row]) for row in (0, 1)]) / size
    (edge,) = [each for each in diagram.plot().collections if each.get_label() == "edge of the orbits"]
    off = [_distance(exact, np.array(line) / size) for line in (*edge.get_segments(), rows * size)]
    assert min(off) < 1e-5
    assert off[-1] > 20 * min(off)


def _distance(point: np.ndarray, line: np.ndarray) -> float:
    """The distance of a point (2,) from a polyline (k, 2)."""
    ahead, away = line[1:] - line[:-1], point - line[:-1]
    shares = np.clip((ahead * away).sum(1) / np.maximum((ahead**2).sum(1), 1e-300), 0.0, 1.0)
    return float(np.linalg.norm(away - shares[:, None] * ahead, axis=1).min())


def test_files(diagram, tmp_path):
    document = json.loads(diagram.save(tmp_path / "a.json").read_text(encoding="utf-8"))
    assert (document["along"], document["across"], document["count"]) == ("beta", "delta", 27)
    assert [part["status"] for part in document["rows"][1]["stretches"]] == ["no orbit", "inadmissible", "certified"]
    lines = diagram.save(tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "delta,from beta,to beta,status"
    assert len(lines) == 1 + sum(len(diagram.row(row)) for row in range(3))
    with pytest.raises(InputError, match="must end in"):
        diagram.save(tmp_path / "a.txt")


@pytest.mark.extra("xarray")
def test_netcdf(diagram, tmp_path):
    import xarray

    with xarray.open_dataset(diagram.save(tmp_path / "a.nc")) as dataset:
        assert dataset["alpha"].dims == ("beta", "delta")
        assert dataset["boundary_beta"].values == pytest.approx(diagram.boundaries.points[:, 0], abs=0)


def test_rows_without_orbits_are_empty():
    """Beyond its limit the saturating spring has no orbit."""
    machine = Hopper("tanh(b*r)/b + c*r", parameters={"b": 0.2, "c": 0.0})
    diagram = existence(machine, "c", (-0.01, 0.0), "b", np.array([0.25, 0.4]), samples=2)
    assert diagram.stretches(1) == []
    assert diagram.motions(1) == []
    diagram.plot()


def test_questions_that_cannot_be_meant():
    for text, question in {
        "a second parameter": ("beta", (-1, 1), "beta", [1.0]),
        "no parameter 'gamma'": ("beta", (-1, 1), "gamma", [0.0]),
        "low must be below high": ("beta", (1, -1), "delta", [0.0]),
        "must be a range": ("beta", [1.0, 2.0], "delta", [0.0]),
        "has no values": ("beta", (-1, 1), "delta", []),
    }.items():
        with pytest.raises(InputError, match=text):
            existence(MACHINE, *question)
    with pytest.raises(InputError, match="samples = 1"):
        existence(MACHINE, "beta", (-1, 1), "delta", [0.0], samples=1)
    with pytest.raises(InputError, match="family"):
        existence(MACHINE, "beta", (-1, 1), "delta", [0.0], [1, 2])


@pytest.mark.slow
def test_the_edge_of_a_chain_is_the_fold_of_its_family():
    """Orbits continued from a hop, which end where the family that is followed along the row folds."""
    chain = Chain(springs="r + b*r**3", parameters={"b": 0.01})
    hop = find(chain, start=find_all(Chain(), Chain().starts(4, 5))[0])
    events = follow(chain, "m1", 0.85, start=hop, longest=0.3, most=60).events
    (fold,) = (event.point.value for event in events if event.kind == "fold")
    diagram = existence(chain, "m1", (0.85, 1.0), "b", [0.01], samples=5, start=hop)
    assert [part.status for part in diagram.row(0)] == ["ends", "certified"]
    assert diagram.unknown(0)  # beyond the fold there may be orbits of another family
    assert "in part not known" in str(diagram)
    assert diagram.motions(0)[0][0] == pytest.approx(fold, abs=2e-7)
    assert diagram.orbit_edges[0][0] == diagram.motions(0)[0][0]
    assert {*CONTINUED_STATUSES} == STYLES.keys()
    with pytest.raises(InputError, match="give an orbit of it"):
        existence(chain, "m1", (0.85, 1.0), "b", [0.01], samples=5)


@pytest.mark.slow
def test_the_edge_of_a_block_is_where_it_slides():
    """Steps for which the stated friction suffices end where single orbits need all of it."""
    block = rocking_block(2.0, 0.1, 0.3, 0.3, 0.3, 20.0, friction=0.4)
    diagram = existence(block, "stiffness", (10.0, 40.0), "body_inertia", [0.3], samples=4)
    needed = lambda k: find(block.with_values(stiffness=k)).certificate.friction_needed  # noqa: E731
    edge = brentq(lambda k: needed(k) - 0.4, 10.0, 40.0, xtol=1e-9)
    assert [part.status for part in diagram.row(0)] == ["certified", "inadmissible"]
    assert diagram.motion_edges[0][0] == pytest.approx(edge, abs=2e-6 * 30)
