"""The results of the members of a sweep: hops, launches of the map, fixed points, and reasons why there are none."""

import tracemalloc

import numpy as np
import pytest

from orbits import find, sweep
from problems import Hopper, springs


def test_members_without_an_orbit_say_why():
    found = sweep(Hopper("cubic", rest_length=30.0), {"beta": [0.0, -0.01, -0.05]})
    assert found["status"].tolist() == ["certified", "inadmissible", "no orbit"]
    assert found["reason"][1].startswith("contact: the spring collapses")
    assert "no lossless orbit" in found["reason"][2]
    assert np.isnan(found["alpha"][2])
    assert {type(reason) for reason in found["reason"]} == {str}  # files take nothing else


def test_the_return_map_is_swept():
    from orbits import ReturnMap

    found = sweep(Hopper(), {"alpha": (4.0, 6.0)}, 50, outcome="map")
    hops = ReturnMap(Hopper())(found["alpha"])
    np.testing.assert_array_equal(found["next"], hops.next)
    assert found["status"].tolist() == hops.status.tolist()


def test_fixed_points_are_swept():
    found = sweep(Hopper(), {"mass_ratio": [0.5, 1.0]}, outcome="fixed_points", between=(4.0, 5.0))
    assert found["count"].tolist() == [1, 1]
    assert found["alpha"][1] == pytest.approx(4.493409457909064, rel=1e-12)


def test_damping_leaves_no_orbit():
    """Without damping a member is the machine's own orbit; with it the member says why there is none."""
    found = sweep(Hopper("cubic", rest_length=9.0), {"damping": [0.0, 0.1], "drag": [0.0, 0.01]})
    assert found["status"].tolist() == ["certified", *["no orbit"] * 3]
    assert found["alpha"][0] == pytest.approx(find(Hopper("cubic", rest_length=9.0)).alpha, abs=1e-14)
    assert all("damped machine loses energy" in reason for reason in found["reason"][1:])


def test_a_law_that_is_none_somewhere_fails_there():
    """Beyond c = 1 the stiffness of this spring is no number, which is no answer to whether it hops."""
    machine = Hopper("sqrt(a - c + 1)*r", parameters={"a": 0.0, "c": 0.0})
    found = sweep(machine, {"c": [0.0, 0.5, 2.0]})
    assert found["status"].tolist() == ["certified", "certified", "failed"]
    assert "stiffness" in found["reason"][2]
    assert np.isnan(found["alpha"][2])


def test_members_with_a_table_of_many_rows_take_little_memory():
    """A motion ends a step at each of the rows that it crosses, so that fewer motions are kept together."""
    r = np.linspace(-12, 12, 320)
    machine, most = Hopper(springs.table((r, r + 0.3 * r**3), noise=0), rest_length=10), 100 * 2**20
    tracemalloc.start(1)
    try:
        found = sweep(machine, {"mass_ratio": (0.3, 0.9)}, samples=512)
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()
    assert {*found["status"].tolist()} == {"certified"}
