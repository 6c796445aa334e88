"""The return map of launches of several numbers, against SciPy's DOP853 with events."""

import numpy as np
import pytest
from columns import column, hop_of, next_launch

from orbits import InputError, ReturnMap, simulate
from problems import plate_hopper

LAUNCHES = np.array([[6.4, -1.2, 1.1], [6.1, -1.4, 0.9], [5.0, -0.5, 0.0], [7.0, 0.2, 2.0]])


@pytest.mark.parametrize(("spring", "cubic"), [("r", 0.0), ("r + 0.02*r**3", 0.02)])
@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_the_map_of_a_column(spring, cubic, damping):
    step = ReturnMap(column(spring, damping))
    hops = step(LAUNCHES)
    assert step.names == hops.names == ("alpha", "y1", "y1'")
    assert hops.statuses() == {"lifts_off": 4}
    for launch, following, loss in zip(LAUNCHES, hops.next, hops.loss, strict=True):
        expected, lost = next_launch(launch, damping, cubic)
        assert following == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert loss == pytest.approx(lost, rel=1e-9)


def test_a_lossless_hop_comes_back():
    for kind in ("column", "cubic column", "chain_hand"):
        machine, orbit = hop_of(kind)
        hops = ReturnMap(machine)(orbit)
        assert hops.next == pytest.approx(hops.launches, rel=1e-9)
        assert hops.loss < 1e-15


def test_launches_in_several_forms():
    step = ReturnMap(column())
    hops = step(LAUNCHES.reshape(2, 2, 3))
    assert hops.next.shape == (2, 2, 3)
    assert hops.loss.shape == hops.status.shape == (2, 2)
    named = step(dict(zip(step.names, LAUNCHES.T, strict=True)))
    assert np.array_equal(named.next, hops.next.reshape(4, 3))
    assert np.array_equal(step(LAUNCHES[0]).next, step({"alpha": 6.4, "y1": -1.2, "y1'": 1.1, "liftoff": 1.0}).next)
    assert hops.table()["next y1"].shape == (4,)
    assert str(hops).startswith("4 launches of 3 numbers: what becomes of them")


def test_what_becomes_of_other_launches():
    launches = [[np.nan, 0.0, 0.0], [-1.0, 0.0, 0.0], [1e16, 0.0, 0.0], [6.4, -1.2, 1.1]]
    assert ReturnMap(column())(launches).status.tolist() == ["invalid", "no_launch", "invalid", "lifts_off"]
    assert ReturnMap(column("r", 0.5))([3.0, 0.0, 0.0]).status in ("rests", "stays")
    assert ReturnMap(column(), cap=1)([6.1, -1.4, 0.9]).status == "cap"


def test_a_simulation_ends_where_the_map_is_undecided():
    machine = plate_hopper(restitution=0.6)
    step = ReturnMap(machine, cap=300)
    launches = np.array([[6.286551036629898, -0.11265776205267503, 1.448714871741501], [1.8, 0.03, 0.4]])
    runs = [simulate(machine, dict(zip(step.names, launch, strict=True)), hops=1, cap=300) for launch in launches]
    assert [*step(launches).status] == ["undecided", "lifts_off"]
    assert [run.status for run in runs] == ["undecided", "done"]


@pytest.mark.parametrize(
    "verb",
    [
        lambda step: step.fixed_points(4, 5), lambda step: step.basin(4, 5), lambda step: step.basins(4, 5),
        lambda step: step.preimages([(4, 5)], 4, 5), lambda step: step.plot(4, 5), lambda step: step.plot_basin(4, 5),
        lambda step: step.smallest_separation(4.6), lambda step: step.jumps(step(LAUNCHES)),
    ],
)  # fmt: skip
def test_intervals_of_speeds_are_refused(verb):
    with pytest.raises(InputError, match="have no meaning where a launch has 3 numbers, alpha, y1, y1'"):
        verb(ReturnMap(column()))
