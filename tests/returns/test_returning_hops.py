"""The one result of hops that come back: from every search, from files of earlier versions, and under earlier names."""

import pickle

import pytest

import orbits
from orbits import ReturningHops, ReturnMap
from orbits.io import write_json
from orbits.returns import FixedPoint, PeriodicHop
from orbits.returns.periodic_hops import Cycle, PeriodicHops
from problems import Hopper

WORDS = {"machine": "hopper", "spring": "r", "gravity": "1", "mass_ratio": 1.0, "rest_length": None}
# As earlier versions wrote them.
OF_A_START = {
    "format": "persistent-orbits periodic hop 1", "names": ["alpha"],
    "launches": [[4.584204148349578], [4.506803039442879]], "kind": "crossing",
    "multipliers": {
        "format": "persistent-orbits multipliers 1", "names": ["alpha"], "launch": [4.584204148349578],
        "following": [4.584204148349579], "matrix": [[0.4051195258600935]], "hops": 2, "lossless": False, "losses": [],
        "units": {}, "machine": WORDS, "loses": False, "stability": "linearly stable", "real": [0.4051195258600935],
        "imaginary": [0.0],
    },
    "units": {}, "machine": WORDS, "stability": "linearly stable",
}  # fmt: skip
OF_A_RANGE = {
    "format": "persistent-orbits periodic hops 1", "machine": WORDS, "period": 2, "low": 4.4, "high": 4.7,
    "inject": 0.09, "cycles": [
        {"launches": [4.506803039442881, 4.584204148349578], "multiplier": 0.40511952586481614, "impacts": [1, 1],
         "branches": [2, 2], "error": 8.3845613704751e-14}
    ],
    "branches": [
        {"low": 4.4, "high": 4.493409457909064, "rising": True, "impacts": 2},
        {"low": 4.493409457909064, "high": 4.5001823895954915, "rising": True, "impacts": 1},
        {"low": 4.5001823895954915, "high": 4.7, "rising": False, "impacts": 1},
    ],
    "itineraries": 7, "error_of_map": 8.026291543620345e-15, "unresolved": [],
}  # fmt: skip
FIXED_POINTS = {
    "format": "persistent-orbits periodic hops 1", "machine": WORDS, "period": 1, "low": 4.0, "high": 8.0,
    "inject": 0.0, "cycles": [
        {"launches": [4.493409457909064], "impacts": [1], "branches": [], "error": 0.0, "smallest_separation": 0.5},
        {"launches": [7.725251836937707], "impacts": [2], "branches": [], "error": 0.0},
    ],
    "branches": [], "itineraries": 0, "error_of_map": 0.0, "unresolved": [],
}  # fmt: skip


def test_files_of_earlier_versions(tmp_path):
    hop = PeriodicHop.load(write_json(OF_A_START, tmp_path / "hop.json", "hop"))
    assert (hop.period, hop.alpha, hop.multiplier, hop.stable) == (2, 4.584204148349578, 0.4051195258600935, True)
    assert "alpha of hop 1          4.50680303944" in str(hop)
    assert {name: each for name, each in hop.saved().items() if name in OF_A_START} == OF_A_START
    path = write_json(OF_A_RANGE, tmp_path / "hops.json", "hops")
    (pair,) = hops = PeriodicHops.load(path)
    assert pair.launches.tolist() == [[4.506803039442881], [4.584204148349578]]
    assert (pair.kind, pair.impacts, pair.itinerary, pair.branches) == ("crossing", (1, 1), (2, 2), (2, 2))
    assert (pair.multiplier, pair.error, pair.stability) == (
        0.40511952586481614,
        8.3845613704751e-14,
        "linearly stable",
    )
    assert "4.50680303944  4.58420415  0.405119525865     stable      1 1       2 2" in str(hops)
    assert hops.saved() == OF_A_RANGE
    low, high = points = PeriodicHops.load(write_json(FIXED_POINTS, tmp_path / "points.json", "hops"))
    assert [(each.kind, each.multiplier, each.stable) for each in points] == [("lossless", None, None)] * 2
    assert (low.smallest_separation, high.smallest_separation) == (0.5, None)
    assert "7.72525183694" in str(points)
    assert points.saved() == FIXED_POINTS
    assert points.table()["branch"] == [None, None]


def test_earlier_names():
    assert {FixedPoint, Cycle, PeriodicHop, orbits.FixedPoint, orbits.PeriodicHop} == {ReturningHops}


@pytest.mark.parametrize("inject", [0.0, 0.08])
def test_all_searches_find_the_same(inject):
    step = ReturnMap(Hopper(), inject=inject)
    points, hops = step.fixed_points(4.3, 5.0, samples=400), step.periodic_hops(1, 4.3, 5.0)
    assert points == tuple(hops)
    assert pickle.loads(pickle.dumps(points)) == points
    assert len({*points, *hops}) == len(points)
    for point in points:
        found = step.periodic_hop(point.alpha)
        assert found.alphas == pytest.approx(point.alphas, rel=1e-12)
        assert (found.kind, found.impacts, found.stable) == (point.kind, point.impacts, point.stable)
        assert found.multiplier == (point.multiplier and pytest.approx(point.multiplier, rel=1e-9))
        assert point.spectrum.tolist() == ([] if point.multiplier is None else [point.multiplier])
